use relume_gpu::{Buffer, Gpu, GpuError};

use crate::LightParams;
use crate::analytic::scaled_params;
use crate::encoding::{LightEncoding, OutputScale};
use crate::gradient::Batch;
use crate::loss::TILE;
use crate::network::{CHUNK, CHUNK_TILES};

/// Values of a light, as in `train/store.wgsl`.
const LIGHT_ROW: usize = 49;
const LIGHT_WEIGHT: usize = 9;
const LIGHT_INVERSE_SCALE: usize = 10;
const LIGHT_INPUTS: usize = 11;

/// Chunks of samples on the device, from which steps draw.
#[derive(Debug)]
pub(super) struct Store {
    pub pixels: Buffer<u32>,
    pub lights: Buffer<f32>,
    pub targets: Buffer<f32>,
    slots: usize,
    encoding: LightEncoding,
}

impl Store {
    /// Room for `chunks` chunks of samples with `slots` lights a pixel.
    ///
    /// # Errors
    /// If there is none on the device.
    pub fn new(gpu: &Gpu, chunks: usize, slots: usize, encoding: LightEncoding) -> Result<Self, GpuError> {
        Ok(Self {
            pixels: gpu.zeros("pixels of samples", chunks * CHUNK / slots)?,
            lights: gpu.zeros("lights of samples", chunks * CHUNK_TILES * LIGHT_ROW)?,
            targets: gpu.zeros("targets of samples", chunks * CHUNK_TILES * TILE)?,
            slots,
            encoding,
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
        gpu.write(&self.pixels, first * CHUNK / self.slots, &batch.pixels);
        let mut rows = vec![0.0; batch.lights.len() * LIGHT_ROW];
        for ((row, light), weight) in rows.chunks_exact_mut(LIGHT_ROW).zip(&batch.lights).zip(&batch.weights)
        {
            row[LIGHT_WEIGHT] = *weight;
            row[LIGHT_INVERSE_SCALE] = 1.0 / scale.of(light).0;
            fill_row(row, light, &self.encoding);
        }
        gpu.write(&self.lights, first * CHUNK_TILES * LIGHT_ROW, &rows);
        gpu.write(&self.targets, first * CHUNK_TILES * TILE, &batch.targets);
    }
}

fn fill_row(row: &mut [f32], light: &LightParams, encoding: &LightEncoding) {
    let normalisation = &encoding.normalisation;
    row[..LIGHT_WEIGHT].copy_from_slice(&scaled_params(light, normalisation.center, normalisation.scale));
    let inputs = encoding.inputs();
    row[LIGHT_INPUTS..LIGHT_INPUTS + inputs].copy_from_slice(&encoding.encode(light)[..inputs]);
}
