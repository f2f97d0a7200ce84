//! Layers of a frame, as far as they are there.

use super::LiveRequest;
use super::terms::{LightTerm, TermSource};
use super::view::{BakeView, shown_statics};
use super::world::WorldUnit;
use crate::device::image::ImageRef;
use crate::error::SessionError;
use crate::relight::film::Film;
use crate::relight::frame::{Coarse, FrameImages, WeightedImage, downsampled, weighted_sum};
use crate::relight::gathered::Gathered;
use crate::relight::source::UnitSource;
use crate::relight::units::{SharedImage, UnitCache};
use relume_gather::DenoiseQuality;
use relume_image::{Image, metrics};
use std::collections::BTreeMap;

/// Size and haste of a frame.
#[derive(Clone, Copy)]
pub(super) struct FrameQuality {
    /// 1 for the full size, 2 for half.
    pub scale: usize,
    /// True if older pictures of a light will do.
    pub is_drag: bool,
}

/// Layers of a frame, and what it is made from.
pub(super) struct FrameLayers<'a> {
    images: FrameImages<'a>,
    /// Source of each light's picture, by its name.
    pub sources: BTreeMap<String, UnitSource>,
    /// Fewest paths per pixel behind a gathered light.
    pub samples: u32,
    /// True if every layer was denoised by itself, as well as is asked for.
    pub is_best: bool,
    /// Side of the blocks of pixels in which something noisy is connected.
    block: usize,
}

impl<'a> FrameLayers<'a> {
    /// Layers that are there now. `stand_ins` are the answers of proxies, by term.
    pub fn new(
        request: &LiveRequest,
        view: &'a BakeView,
        (units, world): (&'a UnitCache, Option<&'a WorldUnit>),
        terms: &[LightTerm],
        stand_ins: &'a [Option<SharedImage>],
        quality: FrameQuality,
    ) -> Self {
        let (images, sources) = (FrameImages::default(), BTreeMap::new());
        let mut layers = Self { images, sources, samples: view.samples(), is_best: true, block: 1 };
        layers.add_statics(request, view, world, quality);
        let denoised = view.denoise(quality.scale).missing().is_none();
        for (number, (term, stand_in)) in terms.iter().zip(stand_ins).enumerate() {
            if term.source == TermSource::FirstView && stand_ins[number + 1].is_none() {
                continue;
            }
            let weight = term.light.radiance;
            let Some(unit) = units.get(&term.light) else { continue };
            let mut source = UnitSource::gathered(denoised);
            match stand_in {
                Some(image) => {
                    layers.images.clean.push(WeightedImage { image: (&**image).into(), weight });
                    source = UnitSource::Proxy;
                }
                None if unit.gathered.passes == 0 => continue,
                None if term.source == TermSource::FirstView => {
                    layers.images.clean.extend(weighted(unit.gathered.layers(), weight));
                }
                None if term.source == TermSource::DirectView => {
                    layers.images.clean.extend(weighted(unit.gathered.layers(), weight));
                    layers.samples = layers.samples.min(unit.gathered.samples);
                }
                None => layers.add(&unit.gathered, weight, view, quality),
            }
            if matches!(term.source, TermSource::Gather | TermSource::Proxy) {
                layers.sources.insert(term.light.name.clone(), source);
            }
        }
        layers
    }

    /// Adds static light and the world that is shown.
    fn add_statics(
        &mut self,
        request: &LiveRequest,
        view: &'a BakeView,
        world: Option<&'a WorldUnit>,
        quality: FrameQuality,
    ) {
        let shown = shown_statics(world.is_some());
        for (layer, weight) in view.statics[shown].iter().zip([request.static_light, request.world]) {
            match &layer.clean {
                _ if layer.black => {}
                Some(clean) => self.images.clean.push(WeightedImage { image: (&clean.image).into(), weight }),
                None => self.images.noisy.push(WeightedImage { image: (&layer.image).into(), weight }),
            }
            self.is_best &= layer.is_done(least_quality(view, quality));
        }
        if let Some(world) = world.filter(|world| !world.is_black()) {
            self.add(&world.gathered, request.world, view, quality);
        }
    }

    /// Adds a gathered picture, denoised if that is there.
    fn add(&mut self, gathered: &'a Gathered, weight: [f32; 3], view: &BakeView, quality: FrameQuality) {
        match &gathered.clean {
            Some((passes, clean)) if quality.is_drag || *passes == gathered.passes => {
                self.images.clean.push(WeightedImage { image: (&clean.image).into(), weight });
                self.is_best &= clean.quality >= least_quality(view, quality);
            }
            _ => {
                self.images.noisy.extend(weighted(gathered.layers(), weight));
                self.samples = self.samples.min(gathered.samples);
                self.is_best = false;
                self.block = self.block.max(gathered.block());
            }
        }
    }

    /// Scene-linear RGBA, the bottom row first. `sum` is memory for it, see [`FrameImages::sum`].
    pub fn image(
        &self,
        view: &BakeView,
        quality: FrameQuality,
        sum: &mut Image,
    ) -> Result<Image, SessionError> {
        let alpha = if quality.scale == 2 { &downsampled(&view.aovs.alpha) } else { &view.aovs.alpha };
        let coarse = (self.block > quality.scale).then(|| Coarse {
            scale: self.block,
            by: self.block / quality.scale,
            denoise: view.denoise(self.block),
        });
        self.images.sum(view.film, alpha, view.denoise(quality.scale), coarse, sum)
    }
}

/// Images of one weight.
fn weighted<'a>(
    images: impl Iterator<Item = ImageRef<'a>>,
    weight: [f32; 3],
) -> impl Iterator<Item = WeightedImage<'a>> {
    images.map(move |image| WeightedImage { image, weight })
}

/// Least quality of denoising that a frame is content with.
fn least_quality(view: &BakeView, quality: FrameQuality) -> DenoiseQuality {
    if quality.is_drag { DenoiseQuality::Fast } else { view.quality }
}

/// [`super::shared::Shown::noise`] of an RGBA picture of the full size.
pub(super) fn noise(
    request: &LiveRequest,
    (units, world): (&UnitCache, Option<&WorldUnit>),
    terms: &[LightTerm],
    stand_ins: &[Option<SharedImage>],
    (film, picture): (Film, &Image),
) -> Result<Option<f32>, SessionError> {
    let is_summed = |(term, stand_in): &(&LightTerm, &Option<SharedImage>)| {
        term.source == TermSource::Gather && stand_in.is_none()
    };
    let summed = terms.iter().zip(stand_ins).filter(is_summed);
    let world = world.filter(|world| !world.is_black()).map(|world| (Some(&world.gathered), request.world));
    let errors: Option<Vec<_>> = summed
        .map(|(term, _)| (units.get(&term.light).map(|unit| &unit.gathered), term.light.radiance))
        .chain(world)
        .map(|(gathered, weight)| Some(weighted(gathered?.errors()?, weight)))
        .collect();
    let Some(errors) = errors.filter(|errors| !errors.is_empty()) else { return Ok(None) };
    let errors: Vec<WeightedImage> = errors.into_iter().flatten().collect();
    // Passes are those of all lights, so that errors add up as the lights do.
    let mut noisy = film.top(weighted_sum(&errors, picture.width, picture.height * film.plates())?);
    let colors = picture.data.as_chunks::<4>().0.iter().flat_map(|[rgb @ .., _]| rgb).copied();
    let clean = Image { data: colors.collect(), ..Image::new(picture.width, picture.height, 3) };
    noisy.data.iter_mut().zip(&clean.data).for_each(|(error, value)| *error += value);
    Ok(Some(metrics::smape(&noisy, &clean) as f32))
}
