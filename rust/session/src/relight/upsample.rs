//! Light of few pixels at the full size, by what the pixels show (joint bilateral upsampling, Kopf et al. 2007).

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::Aovs;
use relume_image::Image;

/// Added to albedos by which light is divided: black surfaces may be shiny.
const LEAST_ALBEDO: f32 = 0.02;
/// Added to the difference of two pixels, so that alike ones share by their distance alone.
const ALIKE: f32 = 0.01;
/// Weight of a difference of depth by its share, beside the difference of normals.
const OF_DEPTH: f32 = 30.0;

/// RGB of the size of `fine` features from that of `coarse` ones, which are averages of `by` x `by` pixels. Several plates of
/// that size may stand below each other. Light goes by its share of the albedo, from pixels whose normal and depth are like
/// those of the pixel.
pub(crate) fn upsampled(image: &Image, by: usize, coarse: &Aovs, fine: &Aovs) -> Image {
    let (width, height) = (fine.depth.width, fine.depth.height);
    let plates = image.height / coarse.depth.height.max(1);
    let mut out = Image::new(width, height * plates, 3);
    let known = Pixels::of(coarse);
    let shares: Vec<Vec3> = (0..image.data.len() / 3)
        .map(|i| rgb(image, i) / (known.albedo(i % known.len()) + LEAST_ALBEDO))
        .collect();
    let pixels = Pixels::of(fine);
    out.data.par_chunks_exact_mut(3 * width).enumerate().for_each(|(row, values)| {
        let (plate, y) = (row / height, row % height);
        let shares = &shares[plate * known.len()..][..known.len()];
        let rows = Taps::new(y, by, known.height);
        for (x, value) in values.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let pixel = y * width + x;
            let columns = Taps::new(x, by, known.width);
            let (normal, depth) = (pixels.normal(pixel), pixels.depth(pixel));
            let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
            for (row, of_row) in rows.0 {
                for (column, of_column) in columns.0 {
                    let from = row * known.width + column;
                    let of_depth = (depth - known.depth(from)) / (depth + known.depth(from)).max(1e-6);
                    let apart = (normal - known.normal(from)).length_squared()
                        + OF_DEPTH * OF_DEPTH * of_depth * of_depth;
                    let weight = of_row * of_column / (ALIKE + apart);
                    sum += weight * shares[from];
                    weights += weight;
                }
            }
            *value = (sum / weights * (pixels.albedo(pixel) + LEAST_ALBEDO)).to_array();
        }
    });
    out
}

/// Two coarse pixels beside a fine one along an axis, and their weights, which are above 0.
struct Taps([(usize, f32); 2]);

impl Taps {
    fn new(fine: usize, by: usize, count: usize) -> Self {
        let place = (fine as f32 + 0.5) / by as f32 - 0.5;
        let (first, share) = (place.floor(), place - place.floor());
        let clamped = |number: f32| (number.max(0.0) as usize).min(count - 1);
        Self([(clamped(first), 1.0 - share), (clamped(first + 1.0), share)])
    }
}

/// Features by the number of a pixel.
struct Pixels<'a> {
    aovs: &'a Aovs,
    width: usize,
    height: usize,
}

impl<'a> Pixels<'a> {
    fn of(aovs: &'a Aovs) -> Self {
        Self { aovs, width: aovs.depth.width, height: aovs.depth.height }
    }

    fn len(&self) -> usize {
        self.width * self.height
    }

    fn albedo(&self, pixel: usize) -> Vec3 {
        rgb(&self.aovs.albedo, pixel)
    }

    fn normal(&self, pixel: usize) -> Vec3 {
        rgb(&self.aovs.normal, pixel)
    }

    fn depth(&self, pixel: usize) -> f32 {
        self.aovs.depth.data[pixel]
    }
}

fn rgb(image: &Image, pixel: usize) -> Vec3 {
    Vec3::from_slice(&image.data[3 * pixel..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::relight::frame::downsampled;

    const WHITE: f32 = 0.8;
    const DARK: f32 = 0.1;

    /// A wall whose albedo changes from column to column, and beside it, from column 5 on, a floor that is lit three times as much.
    fn features() -> (Aovs, Image) {
        let (width, height) = (12, 8);
        let floor = |x: usize| x >= 5;
        let make = |channels: usize, value: &dyn Fn(usize, usize) -> f32| {
            let mut image = Image::new(width, height, channels);
            for (i, out) in image.data.iter_mut().enumerate() {
                *out = value(i / channels % width, i % channels);
            }
            image
        };
        let albedo = |x: usize| if x.is_multiple_of(3) { WHITE } else { DARK };
        let aovs = Aovs {
            albedo: make(3, &|x, _| albedo(x)),
            normal: make(3, &|x, c| f32::from(if floor(x) { c == 2 } else { c == 1 })),
            depth: make(1, &|_, _| 2.0),
            emission: make(3, &|_, _| 0.0),
            world: make(3, &|_, _| 0.0),
            alpha: make(1, &|_, _| 1.0),
        };
        let light = make(3, &|x, _| (albedo(x) + LEAST_ALBEDO) * if floor(x) { 3.0 } else { 1.0 });
        (aovs, light)
    }

    fn halved(aovs: &Aovs) -> Aovs {
        let [albedo, normal, depth, emission, world, alpha] =
            [&aovs.albedo, &aovs.normal, &aovs.depth, &aovs.emission, &aovs.world, &aovs.alpha]
                .map(downsampled);
        Aovs { albedo, normal, depth, emission, world, alpha }
    }

    #[test]
    fn textures_stay_as_sharp_as_the_features_and_light_stays_on_its_surface() {
        let (fine, light) = features();
        let coarse = halved(&fine);
        let found = upsampled(&downsampled(&light), 2, &coarse, &fine);
        for (i, (found, expected)) in found.data.iter().zip(&light.data).enumerate() {
            let x = i / 3 % 12;
            // One column of the coarse picture has both surfaces: a little of the floor's light leaks from it.
            let limit = if (3..7).contains(&x) { 0.6 } else { 0.05 };
            assert!((found / expected - 1.0).abs() < limit, "{x}: {found} {expected}");
        }
    }

    #[test]
    fn plates_have_the_features_of_the_picture() {
        let (fine, light) = features();
        let coarse = halved(&fine);
        let once = downsampled(&light);
        let twice = Image { height: 2 * once.height, data: once.data.repeat(2), ..once.clone() };
        let found = upsampled(&twice, 2, &coarse, &fine);
        assert_eq!(found.data, upsampled(&once, 2, &coarse, &fine).data.repeat(2));
    }
}
