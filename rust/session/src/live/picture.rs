//! A frame as layers: what was denoised by itself is summed, the rest is denoised together.

use super::LiveRequest;
use super::compose::{Layer, weighted_sum, with_alpha};
use super::gathered::Gathered;
use super::parts::{How, Part};
use super::units::Units;
use super::view::{SharedImage, View, half, shown_statics};
use super::world::WorldUnit;
use crate::error::SessionError;
use crate::relight::relighter::Maker;
use relume_gather::DenoiseQuality;
use relume_image::{Image, metrics};
use std::collections::BTreeMap;

/// How a frame is made.
#[derive(Clone, Copy)]
pub(super) struct Manner {
    /// 1 for the full size, 2 for half.
    pub scale: usize,
    /// Whether older pictures of a light will do.
    pub drag: bool,
}

/// The layers of a frame.
pub(super) struct Picture<'a> {
    clean: Vec<Layer<'a>>,
    noisy: Vec<Layer<'a>>,
    /// What made each light's part.
    pub makers: BTreeMap<String, Maker>,
    /// Fewest paths per pixel behind a gathered light.
    pub samples: u32,
    /// Whether everything was denoised by itself, and as well as is asked for.
    pub is_best: bool,
}

impl<'a> Picture<'a> {
    /// What there is of each part now.
    pub fn new(
        request: &LiveRequest,
        view: &'a View,
        (units, world): (&'a Units, Option<&'a WorldUnit>),
        parts: &[Part],
        stand_ins: &'a [Option<SharedImage>],
        manner: Manner,
    ) -> Self {
        let (clean, noisy, makers) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut picture = Self { clean, noisy, makers, samples: view.samples(), is_best: true };
        // Older pictures will do in a drag, and quick ones.
        let quality = if manner.drag { DenoiseQuality::Fast } else { view.quality };
        let shown = shown_statics(world.is_some());
        for (layer, weight) in view.statics[shown].iter().zip([request.static_light, request.world]) {
            match &layer.clean {
                _ if layer.black => {}
                Some(clean) => picture.clean.push(Layer { image: &clean.image, weight }),
                None => picture.noisy.push(Layer { image: &layer.image, weight }),
            }
            picture.is_best &= layer.is_done(quality);
        }
        if let Some(world) = world.filter(|world| !world.is_black()) {
            picture.add(&world.gathered, request.world, quality, manner);
        }
        let denoiser = view.denoise(manner.scale).missing().is_none();
        for (number, (part, stand_in)) in parts.iter().zip(stand_ins).enumerate() {
            if part.how == How::Glimpse && stand_ins[number + 1].is_none() {
                continue;
            }
            let weight = part.light.radiance;
            let Some(unit) = units.get(&part.light) else { continue };
            let mut maker = if denoiser { Maker::GatherDenoised } else { Maker::Gather };
            match stand_in {
                Some(image) => {
                    picture.clean.push(Layer { image, weight });
                    maker = Maker::Proxy;
                }
                None if unit.gathered.passes == 0 => continue,
                None if part.how == How::Glimpse => {
                    picture.clean.push(Layer { image: &unit.gathered.mean, weight });
                }
                None if part.how == How::View => {
                    picture.clean.push(Layer { image: &unit.gathered.mean, weight });
                    picture.samples = picture.samples.min(unit.gathered.samples);
                }
                None => picture.add(&unit.gathered, weight, quality, manner),
            }
            if matches!(part.how, How::Gather | How::Proxy) {
                picture.makers.insert(part.light.name.clone(), maker);
            }
        }
        picture
    }

    /// Adds what was gathered, denoised if that is there.
    fn add(&mut self, gathered: &'a Gathered, weight: [f32; 3], quality: DenoiseQuality, manner: Manner) {
        match &gathered.clean {
            Some((passes, clean)) if manner.drag || *passes == gathered.passes => {
                self.clean.push(Layer { image: &clean.image, weight });
                self.is_best &= clean.quality >= quality;
            }
            _ => {
                self.noisy.push(Layer { image: &gathered.mean, weight });
                self.samples = self.samples.min(gathered.samples);
                self.is_best = false;
            }
        }
    }

    /// Scene-linear RGBA, the bottom row first.
    pub fn image(&self, view: &View, manner: Manner) -> Result<Image, SessionError> {
        let alpha = if manner.scale == 2 { &half(&view.aovs.alpha) } else { &view.aovs.alpha };
        let mut sum = weighted_sum(&self.clean, alpha.width, alpha.height)?;
        if !self.noisy.is_empty() {
            let mut noisy = weighted_sum(&self.noisy, alpha.width, alpha.height)?;
            view.denoise(manner.scale).images(std::slice::from_mut(&mut noisy), DenoiseQuality::Fast)?;
            sum.add_scaled(&noisy, &[1.0; 3]);
        }
        Ok(with_alpha(&sum, alpha))
    }
}

/// [`super::shared::Shown::noise`] of an RGBA picture of the full size.
pub(super) fn noise(
    request: &LiveRequest,
    (units, world): (&Units, Option<&WorldUnit>),
    parts: &[Part],
    stand_ins: &[Option<SharedImage>],
    picture: &Image,
) -> Result<Option<f32>, SessionError> {
    let summed =
        parts.iter().zip(stand_ins).filter(|(part, stand_in)| part.how == How::Gather && stand_in.is_none());
    let world = world.filter(|world| !world.is_black()).map(|world| (Some(&world.gathered), request.world));
    let layers: Option<Vec<Layer>> = summed
        .map(|(part, _)| (units.get(&part.light).map(|unit| &unit.gathered), part.light.radiance))
        .chain(world)
        .map(|(gathered, weight)| {
            let image = &gathered?.error;
            (!image.is_empty()).then_some(Layer { image, weight })
        })
        .collect();
    let Some(layers) = layers.filter(|layers| !layers.is_empty()) else { return Ok(None) };
    // Passes are those of all lights, so that errors add up as the lights do.
    let mut noisy = weighted_sum(&layers, picture.width, picture.height)?;
    let colors = picture.data.as_chunks::<4>().0.iter().flat_map(|[rgb @ .., _]| rgb).copied();
    let clean = Image { data: colors.collect(), ..Image::new(picture.width, picture.height, 3) };
    noisy.data.iter_mut().zip(&clean.data).for_each(|(error, value)| *error += value);
    Ok(Some(metrics::smape(&noisy, &clean) as f32))
}
