use std::sync::Arc;

use relume_gpu::{Buffer, Gpu, GpuError};

use crate::LightParams;
use crate::analytic::seen_values;
use crate::encoding::{LightEncoding, OutputScale};
use crate::gradient::Batch;
use crate::loss::TILE;
use crate::network::{CHUNK, CHUNK_TILES};
use crate::scene_cache::{PIXEL_ROW, SceneCache};

/// Values of a light, as in `train/store.wgsl`.
pub(super) const LIGHT_ROW: usize = 49;
pub(super) const LIGHT_WEIGHT: usize = 9;
pub(super) const LIGHT_INVERSE_SCALE: usize = 10;
pub(super) const LIGHT_INPUTS: usize = 11;

/// Chunks of samples on the device, from which steps draw.
#[derive(Debug)]
pub(super) struct Store {
    pub pixels: Buffer<u32>,
    /// Features of these pixels for the networks.
    pub scene: Buffer<f32>,
    pub lights: Buffer<f32>,
    pub targets: Buffer<f32>,
    slots: usize,
    encoding: LightEncoding,
    cache: Arc<SceneCache>,
}

impl Store {
    /// Room for `chunks` chunks of samples with `slots` lights a pixel.
    ///
    /// # Errors
    /// If there is none on the device.
    pub fn new(
        gpu: &Gpu,
        chunks: usize,
        slots: usize,
        encoding: LightEncoding,
        cache: &Arc<SceneCache>,
    ) -> Result<Self, GpuError> {
        let pixels = chunks * CHUNK / slots;
        Ok(Self {
            pixels: gpu.zeros("pixels of samples", pixels)?,
            scene: gpu.zeros("scene at pixels", pixels * PIXEL_ROW)?,
            lights: gpu.zeros("lights of samples", chunks * CHUNK_TILES * LIGHT_ROW)?,
            targets: gpu.zeros("targets of samples", chunks * CHUNK_TILES * TILE)?,
            slots,
            encoding,
            cache: Arc::clone(cache),
        })
    }

    /// Chunks that it has room for.
    pub fn chunks(&self) -> usize {
        self.targets.len() / (CHUNK_TILES * TILE)
    }

    /// Replaces the chunks from `first` on by those of a batch; its targets, if it has none, are to be gathered for outputs
    /// of this scale.
    pub fn write(&self, gpu: &Gpu, first: usize, batch: &Batch, scale: &OutputScale) {
        assert_eq!(batch.slots, self.slots, "lights per pixel");
        self.write_pixels(gpu, first, &batch.pixels);
        let lights = batch.lights.iter().zip(&batch.weights);
        let rows: Vec<_> = lights.map(|(light, weight)| self.light_row(light, *weight, scale)).collect();
        gpu.write(&self.lights, first * CHUNK_TILES * LIGHT_ROW, rows.as_flattened());
        gpu.write(&self.targets, first * CHUNK_TILES * TILE, &batch.targets);
    }

    /// Replaces the pixels of the chunks from `first` on.
    pub fn write_pixels(&self, gpu: &Gpu, first: usize, pixels: &[u32]) {
        let first = first * CHUNK / self.slots;
        gpu.write(&self.pixels, first, pixels);
        gpu.write(&self.scene, first * PIXEL_ROW, self.cache.rows(pixels).as_flattened());
    }

    /// The row of a light whose samples weigh this much, for outputs of this scale.
    pub fn light_row(&self, light: &LightParams, weight: f32, scale: &OutputScale) -> [f32; LIGHT_ROW] {
        let inputs = self.encoding.inputs();
        let mut row = [0.0; LIGHT_ROW];
        row[..LIGHT_WEIGHT].copy_from_slice(&seen_values(light, &self.encoding.normalisation));
        row[LIGHT_WEIGHT] = weight;
        row[LIGHT_INVERSE_SCALE] = 1.0 / scale.of(light).0;
        row[LIGHT_INPUTS..LIGHT_INPUTS + inputs].copy_from_slice(&self.encoding.encode(light)[..inputs]);
        row
    }
}
