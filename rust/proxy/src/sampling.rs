use glam::Vec3;
use relume_scene::LightShape;

use crate::encoding::{OutputScale, emitting_area};
use crate::gradient::Batch;
use crate::light::random_light;
use crate::loss::TILE;
use crate::pool::Pool;
use crate::simd::LANES;
use crate::{LightKind, LightParams, LightPlacement, PixelQueries, ProxyError, Rng, SizeRange, TargetSource};

/// Tries before a light is put into the box instead, when pixels have no finite segment.
const SEGMENT_TRIES: usize = 16;

/// Draws training lights and pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    pub kind: LightKind,
    pub size: SizeRange,
    pub placement: LightPlacement,
    /// [`crate::TrainConfig::area_weight`]
    pub area_weight: f32,
    pub pixel_count: u32,
}

impl Sampler {
    /// A light on a segment beside one of `pixels`, or in the box (paper, section 4.4). Beside it: a segment of the pixel
    /// itself would meet the light for certain, so that a small light's gather, of few paths, would be too bright.
    pub fn light(&self, source: &dyn TargetSource, pixels: &[u32], rng: &mut Rng) -> LightParams {
        let on_segment = |rng: &mut Rng| {
            (0..SEGMENT_TRIES).find_map(|_| {
                let pixel = pixels[rng.below(pixels.len() as u32) as usize];
                let beside = if pixel + 1 < self.pixel_count { pixel + 1 } else { pixel.saturating_sub(1) };
                source.segment_point(beside, rng).filter(|p| p.is_finite())
            })
        };
        let center = match self.placement {
            LightPlacement::Segments => on_segment(rng),
            LightPlacement::Bounds => None,
        };
        let center = center.unwrap_or_else(|| {
            let (low, high) = source.bounds();
            low + (high - low) * Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32())
        });
        random_light(self.kind, center, self.size, rng)
    }

    /// A light on a segment of any pixel.
    pub fn light_anywhere(&self, source: &dyn TargetSource, rng: &mut Rng) -> LightParams {
        let pixels: [u32; SEGMENT_TRIES] = std::array::from_fn(|_| rng.below(self.pixel_count));
        self.light(source, &pixels, rng)
    }

    /// Random groups of 32 pixels, each to be seen under `slots` random lights; without targets.
    pub fn drawn(
        &self,
        source: &dyn TargetSource,
        (samples, slots): (usize, usize),
        key: (u64, u64),
    ) -> Batch {
        let mut batch = Batch { slots, ..Batch::default() };
        for group in 0..samples / (slots * LANES) {
            let mut rng = Rng::stream(key.0, key.1, group as u64);
            let start = batch.pixels.len();
            batch.pixels.extend((0..LANES).map(|_| rng.below(self.pixel_count)));
            for _ in 0..slots {
                batch.lights.push(self.light(source, &batch.pixels[start..], &mut rng));
            }
        }
        batch.weights.extend(batch.lights.iter().map(|light| self.weight(light)));
        batch
    }

    /// [`Sampler::drawn`] with gathered targets.
    pub fn gathered(
        &self,
        source: &dyn TargetSource,
        scale: &OutputScale,
        (samples, slots): (usize, usize),
        key: (u64, u64),
    ) -> Result<Batch, ProxyError> {
        let mut batch = self.drawn(source, (samples, slots), key);
        let values = gather(source, &batch)?;
        fill_targets(&mut batch, scale, |tile, lane, _| {
            let (group, slot) = (tile / slots, tile % slots);
            values[(group * LANES + lane) * slots + slot]
        });
        Ok(batch)
    }

    /// Random groups of 32 pixels, each to be seen under `slots` random lights of the pool: their pixels, and the numbers of the
    /// lights' images.
    pub fn drawn_from_pool(
        &self,
        pool: &Pool,
        (samples, slots): (usize, usize),
        key: (u64, u64),
    ) -> (Vec<u32>, Vec<u64>) {
        let (mut pixels, mut images) = (Vec::new(), Vec::new());
        for group in 0..samples / (slots * LANES) {
            let mut rng = Rng::stream(key.0, key.1, group as u64);
            pixels.extend((0..LANES).map(|_| rng.below(self.pixel_count)));
            images.extend((0..slots).map(|_| pool.draw(&mut rng)));
        }
        (pixels, images)
    }

    /// [`Sampler::drawn_from_pool`] with lights and targets.
    ///
    /// # Panics
    /// If the pool's images were handed over.
    pub fn batch_from_pool(
        &self,
        pool: &Pool,
        scale: &OutputScale,
        (samples, slots): (usize, usize),
        key: (u64, u64),
    ) -> Batch {
        let (pixels, images) = self.drawn_from_pool(pool, (samples, slots), key);
        let lights: Vec<LightParams> = images.iter().map(|&number| pool.entry(number).light).collect();
        let weights = lights.iter().map(|light| self.weight(light)).collect();
        let mut batch = Batch { pixels, slots, lights, weights, ..Batch::default() };
        let image = |&number: &u64| pool.entry(number).image.as_ref().expect("an image that is here");
        let images: Vec<_> = images.iter().map(image).collect();
        fill_targets(&mut batch, scale, |tile, _, pixel| {
            let at = pixel as usize * 3;
            std::array::from_fn(|channel| images[tile].data[at + channel])
        });
        batch
    }

    /// The scale that brings the mean of a few thousand targets to 1.
    pub fn calibrate(
        &self,
        source: &dyn TargetSource,
        area: Option<f32>,
        seed: u64,
    ) -> Result<OutputScale, ProxyError> {
        let unit = OutputScale { factor: 1.0, area };
        let batch = self.gathered(source, &unit, (8192, 4), (seed, CALIBRATION_STREAM))?;
        let mean = batch.targets.iter().map(|t| f64::from(*t)).sum::<f64>() / batch.targets.len() as f64;
        let factor = if mean.is_finite() && mean > 1e-30 { mean as f32 } else { 1.0 };
        Ok(OutputScale { factor, area })
    }

    /// Weight of a light's samples in the loss.
    pub fn weight(&self, light: &LightParams) -> f32 {
        (emitting_area(light).value / self.middling_area()).powf(self.area_weight)
    }

    /// Area of a light of the geometric mean size, square metres.
    pub fn middling_area(&self) -> f32 {
        let size = (self.size.min * self.size.max).sqrt();
        let light = LightParams::facing_down(self.kind, Vec3::ZERO, size);
        emitting_area(&light).value
    }
}

/// Counter of the random streams that belong to no step.
const CALIBRATION_STREAM: u64 = 1 << 63;

/// Writes targets from `value(tile, lane, pixel)`, in units of the network's output.
fn fill_targets(batch: &mut Batch, scale: &OutputScale, value: impl Fn(usize, usize, u32) -> [f32; 3]) {
    let Batch { pixels, slots, lights, targets, .. } = batch;
    targets.resize(lights.len() * TILE, 0.0);
    for (tile, (light, target)) in lights.iter().zip(targets.chunks_exact_mut(TILE)).enumerate() {
        let inverse = 1.0 / scale.of(light).0;
        let group = tile / *slots;
        for (lane, pixel) in pixels[group * LANES..(group + 1) * LANES].iter().enumerate() {
            for (channel, x) in value(tile, lane, *pixel).into_iter().enumerate() {
                target[channel * LANES + lane] = x * inverse;
            }
        }
    }
}

/// Asks the source for all samples of a batch, pixel by pixel.
fn gather(source: &dyn TargetSource, batch: &Batch) -> Result<Vec<[f32; 3]>, ProxyError> {
    let shapes: Vec<LightShape> = batch.lights.iter().map(LightParams::shape).collect();
    let lights: Vec<LightShape> = (0..batch.pixels.len())
        .flat_map(|i| {
            let group = i / LANES;
            shapes[group * batch.slots..(group + 1) * batch.slots].iter().copied()
        })
        .collect();
    let mut values = vec![[0.0; 3]; lights.len()];
    let queries = PixelQueries { pixels: &batch.pixels, lights_per_pixel: batch.slots, lights: &lights };
    source.pixel_targets(&queries, &mut values)?;
    match values.iter().position(|value| value.iter().any(|x| !x.is_finite())) {
        Some(bad) => Err(ProxyError::BadTarget { pixel: batch.pixels[bad / batch.slots] }),
        None => Ok(values),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_image::Image;

    /// Pixels that see a few random points of a box: a light shines into a pixel by the share of them that it holds.
    struct Points(Vec<[Vec3; 8]>);

    impl Points {
        fn new(pixels: usize, seed: u64) -> Self {
            let mut rng = Rng::stream(seed, 0, 0);
            let mut point = || Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
            Self((0..pixels).map(|_| std::array::from_fn(|_| point())).collect())
        }

        fn share(points: &[Vec3], light: &LightShape) -> f32 {
            let LightShape::Sphere { center, radius } = light else { unreachable!("spheres are drawn") };
            points.iter().filter(|point| point.distance(*center) < *radius).count() as f32
                / points.len() as f32
        }
    }

    impl TargetSource for Points {
        fn bounds(&self) -> (Vec3, Vec3) {
            (Vec3::ZERO, Vec3::ONE)
        }
        fn segment_point(&self, pixel: u32, rng: &mut Rng) -> Option<Vec3> {
            Some(self.0[pixel as usize][rng.below(8) as usize])
        }
        fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
            let all =
                queries.iter().flat_map(|(pixel, lights)| lights.iter().map(move |light| (pixel, light)));
            all.zip(out)
                .for_each(|((pixel, light), out)| *out = [Self::share(&self.0[pixel as usize], light); 3]);
            Ok(())
        }
        fn images(&self, _: &[LightShape], _: bool) -> Result<Vec<Image>, ProxyError> {
            Ok(Vec::new())
        }
    }

    #[test]
    fn small_lights_are_no_brighter_to_learn_than_they_are() {
        let (source, others) = (Points::new(4096, 1), Points::new(512, 2));
        let sampler = Sampler {
            kind: LightKind::Sphere,
            size: SizeRange { min: 0.1, max: 0.101 },
            placement: LightPlacement::Segments,
            area_weight: 0.0,
            pixel_count: 4096,
        };
        let batch = sampler.drawn(&source, (1 << 17, 4), (3, 0));
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        let learned: Vec<f32> = gather(&source, &batch).unwrap().iter().map(|rgb| rgb[0]).collect();
        let truth: Vec<f32> =
            batch.lights.iter().map(|light| Points::share(others.0.as_flattened(), &light.shape())).collect();
        let ratio = mean(&learned) / mean(&truth);
        assert!((0.93..1.07).contains(&ratio), "{ratio}");
    }
}
