use std::collections::VecDeque;

use relume_image::Image;
use relume_scene::LightShape;

use crate::sampling::Sampler;
use crate::{LightParams, ProxyError, Rng, TargetSource};

/// Images gathered in one pass over the paths.
const FILL: u64 = 8;
/// Images before the first step.
const FIRST: u64 = 16;
/// Counter of the random streams of pool lights.
const POOL_STREAM: u64 = (1 << 63) + 1;

/// Whole images for random lights, from which samples draw (paper, section 4.4). The pool grows while the network learns; at
/// its full size the oldest images leave. Image number `n` depends on the seed and `n` alone, and the number of images on
/// the samples trained alone, so that a resumed training makes what it has lost.
#[derive(Debug)]
pub(crate) struct Pool {
    size: u64,
    denoised: bool,
    /// Samples for which one more image is made.
    samples_per_image: u64,
    entries: VecDeque<PoolEntry>,
    /// Number of the next image.
    next: u64,
}

/// A light and its unit image, if that is not on a device.
#[derive(Debug)]
pub(crate) struct PoolEntry {
    pub light: LightParams,
    pub image: Option<Image>,
}

impl Pool {
    /// An empty pool of up to `size` images, for a training that has done `samples` samples and makes one more image for
    /// every `samples_per_image`.
    pub fn new((size, denoised): (usize, bool), samples_per_image: u64, samples: u64) -> Self {
        let mut pool =
            Self { size: size as u64, denoised, samples_per_image, entries: VecDeque::new(), next: 0 };
        pool.next = pool.wanted(samples).saturating_sub(pool.size);
        pool
    }

    /// Images that should have been made after so many samples.
    fn wanted(&self, samples: u64) -> u64 {
        FIRST + samples / (self.samples_per_image * FILL) * FILL
    }

    /// Images that are missing before a training that has done `samples` samples can go on.
    pub fn missing(&self, samples: u64) -> usize {
        self.wanted(samples).saturating_sub(self.next) as usize
    }

    /// Makes some of the missing images.
    pub fn fill(
        &mut self,
        sampler: &Sampler,
        source: &dyn TargetSource,
        samples: u64,
        seed: u64,
    ) -> Result<(), ProxyError> {
        let numbers = self.next..self.next + FILL.min(self.missing(samples) as u64);
        let draw = |number| sampler.light_anywhere(source, &mut Rng::stream(seed, POOL_STREAM, number));
        let lights: Vec<LightParams> = numbers.clone().map(draw).collect();
        let images = images_of(source, &lights, self.denoised, sampler.pixel_count as usize)?;
        let entry = |(light, image)| PoolEntry { light, image: Some(image) };
        self.entries.extend(lights.into_iter().zip(images).map(entry));
        self.next = numbers.end;
        while self.entries.len() as u64 > self.size {
            self.entries.pop_front();
        }
        Ok(())
    }

    /// Most images.
    pub fn size(&self) -> usize {
        self.size as usize
    }

    /// Number of the oldest image that is kept.
    fn oldest(&self) -> u64 {
        self.next - self.entries.len() as u64
    }

    /// The number of a uniformly random image.
    pub fn draw(&self, rng: &mut Rng) -> u64 {
        self.oldest() + u64::from(rng.below(self.entries.len() as u32))
    }

    /// An image that is kept, by its number.
    pub fn entry(&self, number: u64) -> &PoolEntry {
        &self.entries[(number - self.oldest()) as usize]
    }

    /// Hands over the images that have not been handed over yet, with their numbers and lights.
    pub fn take_images(&mut self) -> impl Iterator<Item = (u64, LightParams, Image)> {
        let numbers = self.oldest()..;
        let take = |(number, entry): (u64, &mut PoolEntry)| Some((number, entry.light, entry.image.take()?));
        numbers.zip(&mut self.entries).filter_map(take)
    }
}

/// Asks for images and checks their shape.
pub(crate) fn images_of(
    source: &dyn TargetSource,
    lights: &[LightParams],
    denoised: bool,
    pixel_count: usize,
) -> Result<Vec<Image>, ProxyError> {
    let shapes: Vec<LightShape> = lights.iter().map(LightParams::shape).collect();
    let images = source.images(&shapes, denoised)?;
    if images.len() != lights.len() {
        return Err(ProxyError::Length {
            what: "target images",
            expected: lights.len(),
            found: images.len(),
        });
    }
    for image in &images {
        if image.data.len() != 3 * pixel_count {
            let (expected, found) = (3 * pixel_count, image.data.len());
            return Err(ProxyError::Length { what: "values of a target image", expected, found });
        }
        if let Some(bad) = image.data.iter().position(|x| !x.is_finite()) {
            return Err(ProxyError::BadTarget { pixel: (bad / 3) as u32 });
        }
    }
    Ok(images)
}
