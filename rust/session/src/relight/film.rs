//! Film of a bake. With shadow catchers it has several plates, which are gathered like one tall picture and become a picture in
//! the end: what a catcher shows is a ratio of sums over lights.

use crate::error::SessionError;
use rayon::prelude::*;
use relume_dump::{Aovs, Manifest};
use relume_image::Image;
use relume_scene::Camera;
use std::borrow::Cow;

/// Matte, light of catchers among all objects and among catchers alone, and the background where the film is opaque.
const PLATES: [usize; 3] = [1, 3, 4];

/// Film of a bake.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Film {
    plates: usize,
}

/// Place of what shadow catchers show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CatcherPlace {
    /// In the picture: shadows are alpha, or dim the world behind.
    #[default]
    Picture,
    /// Only in a layer of its own, to be multiplied into a photograph (Cycles' Shadow Catcher pass).
    Layer,
}

/// Picture that a film shows.
pub(crate) struct Developed {
    /// RGB of all that stands before shadow catchers.
    pub matte: Image,
    /// RGB of the world behind that, darkened by shadows; nothing without catchers, and where the film is transparent.
    pub backdrop: Option<Image>,
    /// Film alpha, with shadows.
    pub alpha: Image,
    /// RGB factor of what catchers show, to multiply into a photograph; none without catchers.
    pub catcher: Option<Image>,
}

impl Film {
    /// Film without shadow catchers.
    pub const PLAIN: Self = Self { plates: 1 };

    /// Film of a bake.
    ///
    /// # Errors
    /// If the bake's size is not that of its camera.
    pub fn of(manifest: &Manifest, camera: &Camera) -> Result<Self, SessionError> {
        let plates = manifest.height / camera.height.max(1);
        if !PLATES.contains(&plates) || !manifest.height.is_multiple_of(camera.height) {
            return Err(SessionError::Settings("the bake is not of its camera's size; bake again".into()));
        }
        Ok(Self { plates })
    }

    /// True if there are shadow catchers.
    pub fn catches(self) -> bool {
        self.plates > 1
    }

    /// Number of plates.
    pub fn plates(self) -> usize {
        self.plates
    }

    /// True if half of its rows are rows of single plates.
    pub fn can_be_halved(self, rows: usize) -> bool {
        !self.catches() || (rows / self.plates).is_multiple_of(2)
    }

    /// Plate number `number` of a tall image.
    pub fn plate(self, image: &Image, number: usize) -> Image {
        let rows = image.height / self.plates;
        image.rows(number * rows, rows)
    }

    /// First plate of an image; the image itself without catchers.
    pub fn top(self, image: Image) -> Image {
        if self.catches() { self.plate(&image, 0) } else { image }
    }

    /// Features of the picture's pixels. Catchers count as they are.
    pub fn features(self, aovs: &Aovs) -> Cow<'_, Aovs> {
        if !self.catches() {
            return Cow::Borrowed(aovs);
        }
        let top = |image: &Image| self.plate(image, 0);
        Cow::Owned(Aovs {
            albedo: top(&aovs.albedo),
            normal: top(&aovs.normal),
            depth: top(&aovs.depth),
            emission: top(&aovs.emission),
            world: top(&aovs.world),
            alpha: self.plate(&aovs.alpha, 1),
        })
    }

    /// Picture of all light on a film, RGB, and the film's alpha (Cycles' `film_calculate_shadow_catcher` and
    /// `film_calculate_shadow_catcher_matte_with_shadow`).
    pub fn develop(self, light: Image, alpha: &Image, place: CatcherPlace) -> Developed {
        if !self.catches() {
            return Developed { matte: light, backdrop: None, alpha: alpha.clone(), catcher: None };
        }
        let matte = self.plate(&light, 0);
        let [shadowed, clear] = [1, 2].map(|plate| self.plate(&light, plate));
        let [of_matte, of_film, caught] = [0, 1, 2].map(|plate| self.plate(alpha, plate));
        let mut catcher = Image::new(matte.width, matte.height, 3);
        let pixels = catcher.data.par_chunks_exact_mut(3).enumerate();
        pixels.for_each(|(pixel, factors)| {
            let cover = of_film.data[pixel].clamp(0.0, 1.0);
            for (channel, factor) in factors.iter_mut().enumerate() {
                let (with, without) = (shadowed.data[3 * pixel + channel], clear.data[3 * pixel + channel]);
                let is_lit = caught.data[pixel] > 0.0 && without > 0.0;
                let ratio = if is_lit { with / without } else { 1.0 };
                *factor = (1.0 - cover) + cover * ratio;
            }
        });
        let mut shown = of_matte;
        shown.data.iter_mut().for_each(|alpha| *alpha = alpha.clamp(0.0, 1.0));
        if place == CatcherPlace::Picture {
            let factors = catcher.data.as_chunks::<3>().0;
            for (alpha, [r, g, b]) in shown.data.iter_mut().zip(factors) {
                *alpha += (1.0 - *alpha) * (1.0 - ((r + g + b) / 3.0).clamp(0.0, 1.0));
            }
        }
        let backdrop = (self.plates == 4 && place == CatcherPlace::Picture).then(|| {
            let mut world = self.plate(&light, 3);
            for (rgb, alpha) in world.data.as_chunks_mut::<3>().0.iter_mut().zip(&mut shown.data) {
                *rgb = rgb.map(|value| value * (1.0 - *alpha));
                *alpha = 1.0;
            }
            world
        });
        Developed { matte, backdrop, alpha: shown, catcher: Some(catcher) }
    }
}

impl Developed {
    /// RGB of the whole picture.
    pub fn picture(self) -> (Image, Image) {
        let mut picture = self.matte;
        self.backdrop.iter().for_each(|backdrop| picture.add_scaled(backdrop, &[1.0; 3]));
        (picture, self.alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two pixels: a catcher, half of which a grey object covers, and one in the open.
    fn developed(plates: usize, world: f32, place: CatcherPlace) -> Developed {
        let film = Film { plates };
        let grey = |values: &[f32]| values.iter().flat_map(|value| [*value; 3]).collect::<Vec<_>>();
        let plates = [[0.3, 0.0], [0.1, 0.5], [0.4, 0.5], [world, world]];
        let data = plates[..film.plates].iter().flat_map(|row| grey(row)).collect();
        let light = Image { data, ..Image::new(2, film.plates, 3) };
        let alpha = [[0.5, 0.0], [1.0, 1.0], [0.5, 1.0], [1.0, 1.0]];
        let data = alpha[..film.plates].concat();
        film.develop(light, &Image { data, ..Image::new(2, film.plates, 1) }, place)
    }

    #[test]
    fn shadows_are_alpha_on_a_transparent_film_and_dim_the_world_on_an_opaque_one() {
        let (picture, alpha) = developed(3, 0.0, CatcherPlace::Picture).picture();
        // A quarter of the light is left: 1 - 0.25 of the catcher's half, over which the object's half lies.
        assert_eq!(alpha.data, [0.5 * 0.75 + 0.5, 0.0]);
        assert_eq!(picture.data, [0.3, 0.3, 0.3, 0.0, 0.0, 0.0]);
        let (picture, alpha) = developed(4, 2.0, CatcherPlace::Picture).picture();
        assert_eq!(alpha.data, [1.0, 1.0]);
        assert_eq!(picture.data, [0.55, 0.55, 0.55, 2.0, 2.0, 2.0]);
    }

    #[test]
    fn a_pass_of_its_own_takes_shadows_out_of_the_picture() {
        let developed = developed(3, 0.0, CatcherPlace::Layer);
        assert_eq!(developed.alpha.data, [0.5, 0.0]);
        assert_eq!(developed.catcher.unwrap().data, [0.25, 0.25, 0.25, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn films_without_catchers_stay_as_they_are() {
        let (light, alpha) = (Image { data: vec![0.5; 6], ..Image::new(1, 2, 3) }, Image::new(1, 2, 1));
        let developed = Film::PLAIN.develop(light.clone(), &alpha, CatcherPlace::Picture);
        assert!(developed.matte == light && developed.alpha == alpha && developed.catcher.is_none());
    }
}
