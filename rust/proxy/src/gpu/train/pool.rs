use bytemuck::bytes_of;
use relume_gpu::{Bound, Buffer, GpuError};
use relume_image::Image;

use super::store::LIGHT_ROW;
use super::{GpuTraining, arguments};
use crate::network::{CHUNK, CHUNK_TILES};

/// Most of the free memory that images take; the rest is for the dump that they are gathered from.
const SHARE: f64 = 0.5;
/// Largest buffer of images: larger ones are harder to find room for.
const PART_BYTES: u64 = 1 << 30;

/// The images of a pool on the device, from which the samples of the store are taken there. An image has the place of its number
/// modulo the size of the pool, so that a new one replaces the oldest.
#[derive(Debug)]
pub(super) struct DevicePool {
    /// Most images.
    size: u64,
    /// Values of an image, and images of a part but the last.
    values: usize,
    images: usize,
    /// Whole images, place by place.
    parts: Vec<PoolPart>,
    /// Rows of the images' lights.
    lights: Buffer<f32>,
    /// Place of the image of each tile of the store.
    places: Buffer<u32>,
}

#[derive(Debug)]
struct PoolPart {
    images: Buffer<f32>,
    take: Bound,
}

impl DevicePool {
    /// Room for `size` images of `pixels` pixels beside a training; nothing if they do not fit.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn new(training: &GpuTraining, size: usize, pixels: usize) -> Result<Option<Self>, GpuError> {
        let gpu = &training.gpu;
        if (12 * pixels * size) as f64 > SHARE * gpu.free_memory() as f64 {
            return Ok(None);
        }
        match Self::in_parts(training, (size, pixels), gpu.limits().buffer.min(PART_BYTES)) {
            Err(GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. }) => Ok(None),
            made => made.map(Some),
        }
    }

    /// [`DevicePool::new`] in buffers of at most so many bytes, but at least an image each.
    pub(super) fn in_parts(
        training: &GpuTraining,
        (size, pixels): (usize, usize),
        bytes: u64,
    ) -> Result<Self, GpuError> {
        let (gpu, store) = (&training.gpu, &training.store);
        let values = 3 * pixels;
        let images = (bytes as usize / (4 * values)).max(1);
        let lights = gpu.zeros("lights of the pool", size * LIGHT_ROW)?;
        let places = gpu.zeros("images of samples", store.chunks() * CHUNK_TILES)?;
        let kernel = gpu.kernel("train/pool", "store", &[])?;
        let part = |first: usize| {
            let buffer = gpu.zeros("images of the pool", images.min(size - first) * values)?;
            let take = kernel.bind(&[
                buffer.whole(),
                lights.whole(),
                places.whole(),
                store.pixels.whole(),
                store.lights.whole(),
                store.targets.whole(),
            ])?;
            Ok(PoolPart { images: buffer, take })
        };
        let parts = (0..size).step_by(images).map(part).collect::<Result<_, GpuError>>()?;
        Ok(Self { size: size as u64, values, images, parts, lights, places })
    }

    fn place(&self, number: u64) -> usize {
        (number % self.size) as usize
    }

    /// Copies image `number` to the device, with the row of its light, and waits until it is there.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn put(
        &self,
        training: &GpuTraining,
        (number, image): (u64, &Image),
        row: &[f32; LIGHT_ROW],
    ) -> Result<(), GpuError> {
        let (gpu, place) = (&training.gpu, self.place(number));
        gpu.write(&self.lights, place * LIGHT_ROW, row);
        gpu.write(&self.parts[place / self.images].images, place % self.images * self.values, &image.data);
        // Else the driver would hold all of them a second time.
        gpu.wait_for(gpu.submit_writes()?)
    }

    /// Replaces the chunks of the store from `first` on by samples of these pixels and, tile by tile, the images of these numbers.
    pub fn write_chunks(&self, training: &GpuTraining, first: usize, pixels: &[u32], numbers: &[u64]) {
        let places: Vec<u32> = numbers.iter().map(|&number| self.place(number) as u32).collect();
        training.gpu.write(&self.places, first * CHUNK_TILES, &places);
        training.store.write_pixels(&training.gpu, first, pixels);
    }

    /// Takes lights and targets of the first chunks of the store from their images.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn take(&self, training: &GpuTraining, chunks: usize) -> Result<(), GpuError> {
        let mut commands = training.gpu.commands("samples of the pool");
        for (index, part) in self.parts.iter().enumerate() {
            let arguments = arguments::Pool {
                tiles: (chunks * CHUNK_TILES) as u32,
                slots: training.batch.slots,
                first: (index * self.images) as u32,
                images: (part.images.len() / self.values) as u32,
                pixels: (self.values / 3) as u32,
            };
            commands.run(&part.take, (chunks * CHUNK / 64) as u32, bytes_of(&arguments));
        }
        commands.submit()
    }
}
