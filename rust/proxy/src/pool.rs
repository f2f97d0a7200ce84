use relume_image::Image;
use relume_scene::LightShape;

use crate::sampling::Sampler;
use crate::{LightParams, ProxyError, Rng, TargetMode, TargetSource};

/// Images gathered in one call, so that a step never blocks for long.
const FILL: usize = 8;
/// Counter of the random streams of pool lights.
const POOL_STREAM: u64 = (1 << 63) + 1;

/// Whole images for random lights, from which samples draw (paper, section 4.4). Image number `n` depends on the seed
/// and `n` alone, and lies in place `n % size`, so that a resumed training rebuilds the pool from one number.
#[derive(Debug)]
pub(crate) struct Pool {
    size: usize,
    replace: usize,
    every: u64,
    denoised: bool,
    entries: Vec<PoolEntry>,
    /// Number of the next image.
    next: u64,
}

/// A light and its unit image.
#[derive(Debug)]
pub(crate) struct PoolEntry {
    pub light: LightParams,
    pub image: Image,
}

impl Pool {
    /// An empty pool, if the mode has one, that goes on after `next` images.
    pub fn new(mode: TargetMode, next: u64) -> Option<Self> {
        let TargetMode::Pool { size, replace, every, denoised } = mode else { return None };
        Some(Self { size, replace, every, denoised, entries: Vec::new(), next })
    }

    /// Images made so far.
    pub fn made(&self) -> u64 {
        self.next
    }

    /// Images that are still missing.
    pub fn missing(&self) -> usize {
        self.size - self.entries.len()
    }

    /// Adds a few of the missing images. After a resume these are the last ones that were made.
    pub fn fill(
        &mut self,
        sampler: &Sampler,
        source: &dyn TargetSource,
        seed: u64,
    ) -> Result<(), ProxyError> {
        let held = self.entries.len() as u64;
        let fresh = self.next < self.size as u64 || held == 0 && self.next == 0;
        let count = FILL.min(self.missing()) as u64;
        if fresh {
            let made = self.make(held..held + count, sampler, source, seed)?;
            self.entries.extend(made);
            self.next = self.next.max(self.entries.len() as u64);
        } else {
            // Place p holds the greatest number below `next` that is p modulo the size.
            let size = self.size as u64;
            let number = |place: u64| self.next - 1 - (self.next - 1 - place) % size;
            let numbers: Vec<u64> = (held..held + count).map(number).collect();
            let made = self.make(numbers.into_iter(), sampler, source, seed)?;
            self.entries.extend(made);
        }
        Ok(())
    }

    /// Replaces the oldest images if this step is due.
    pub fn refresh(
        &mut self,
        step: u64,
        sampler: &Sampler,
        source: &dyn TargetSource,
        seed: u64,
    ) -> Result<(), ProxyError> {
        if step == 0 || !step.is_multiple_of(self.every) {
            return Ok(());
        }
        let numbers = self.next..self.next + self.replace as u64;
        for (number, entry) in numbers.clone().zip(self.make(numbers, sampler, source, seed)?) {
            self.entries[(number % self.size as u64) as usize] = entry;
        }
        self.next += self.replace as u64;
        Ok(())
    }

    /// A uniformly random image.
    pub fn draw(&self, rng: &mut Rng) -> &PoolEntry {
        &self.entries[rng.below(self.entries.len() as u32) as usize]
    }

    fn make(
        &self,
        numbers: impl Iterator<Item = u64>,
        sampler: &Sampler,
        source: &dyn TargetSource,
        seed: u64,
    ) -> Result<Vec<PoolEntry>, ProxyError> {
        let draw = |number| sampler.light_anywhere(source, &mut Rng::stream(seed, POOL_STREAM, number));
        let lights: Vec<LightParams> = numbers.map(draw).collect();
        images_of(source, &lights, self.denoised, sampler.pixel_count as usize).map(|images| {
            lights.into_iter().zip(images).map(|(light, image)| PoolEntry { light, image }).collect()
        })
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
