use serde::{Deserialize, Serialize};

use crate::{LightKind, ProxyError, SizeRange};

/// Everything that decides a training, besides its features, its targets and its seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// The network.
    pub network: NetworkConfig,
    /// Placement of training lights.
    pub placement: LightPlacement,
    /// Sizes of training lights.
    pub size: SizeRange,
    /// Source of target values.
    pub targets: TargetMode,
    /// Samples (pixel and light) of the whole training; the learning rate and the batch follow the share done.
    pub samples: u64,
    /// Samples a step at the start; rounded up to a multiple of 1,024.
    pub batch_start: usize,
    /// Samples a step at the end; doubles on the way.
    pub batch_end: usize,
    /// Different lights for which each drawn pixel is gathered: 1, 2, 4, 8, 16 or 32.
    pub lights_per_pixel: usize,
    /// Times that each target value is trained on, on average, before another is made.
    pub sample_reuse: usize,
    /// Let outputs follow the light's area, so that small lights count as much as large ones in the loss.
    pub scale_by_area: bool,
    /// Weigh samples by this power of the light's area. The fewer segments cross a light, the noisier are its targets:
    /// relative to the output their variance goes with one over the area.
    pub area_weight: f32,
    /// Learning rates.
    pub rates: LearningRates,
    /// Use Muon (orthogonalised momentum) for hidden matrices; Adam for all if false.
    pub muon: bool,
    /// Decay of the running mean of weights that proxies are made of; 0 uses the last weights.
    pub ema_decay: f32,
    /// Held-out lights on which PSNR and SMAPE are measured.
    pub held_out: usize,
}

/// Peak learning rates; all fall to `final_fraction` of it along a cosine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearningRates {
    /// Weights and biases under Adam.
    pub adam: f32,
    /// Root mean square of a step of the hidden matrices under Muon.
    pub muon: f32,
    /// Hash grid.
    pub grid: f32,
    /// Share of the peak that is left at the end.
    pub final_fraction: f32,
}

/// The network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum NetworkConfig {
    /// The paper's (section 4.3): grid, albedo, depth, normal and light parameters into one plain ReLU network.
    Reference {
        /// Neurons of a hidden layer.
        width: usize,
        /// Hidden layers.
        layers: usize,
        /// Encoding of the pixel coordinates.
        grid: GridConfig,
    },
    /// Factorised: trunk per pixel, encoder per light, modulated head per pixel and light.
    Fast {
        /// Neurons of a hidden layer of trunk, encoder and head.
        width: usize,
        /// Hidden matrices of the head.
        layers: usize,
        /// Encoding of the pixel coordinates.
        grid: GridConfig,
    },
}

/// Multiresolution hash grid over the image (Mueller et al. 2022, "Instant Neural Graphics Primitives").
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridConfig {
    /// Resolutions, at most 32.
    pub levels: usize,
    /// Values an entry, a power of two up to 8.
    pub features_per_level: usize,
    /// Largest number of entries of a level; finer levels are hashed.
    pub log2_hashmap_size: u32,
    /// Cells of the coarsest level along the longer side of the image.
    pub base_resolution: usize,
    /// Cells of the finest level along the longer side, as a share of its pixels.
    pub finest_cells_per_pixel: f32,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self {
            levels: 8,
            features_per_level: 2,
            log2_hashmap_size: 16,
            base_resolution: 8,
            finest_cells_per_pixel: 0.5,
        }
    }
}

/// Placement of training lights (paper, section 4.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum LightPlacement {
    /// Uniformly on a random segment of a random pixel.
    Segments,
    /// Uniformly in the box of visible positions.
    Bounds,
}

/// Source of target values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum TargetMode {
    /// Each sample is gathered for itself, without denoising.
    Raw,
    /// A pool of whole images, from which each sample draws (paper, section 4.4).
    Pool {
        /// Most images in the pool; 300 in the paper.
        size: usize,
        /// Denoise them.
        denoised: bool,
    },
}

impl NetworkConfig {
    /// Checks every field; the message names it and what it may be.
    pub(crate) fn validate(&self) -> Result<(), String> {
        let (Self::Reference { width, layers, grid } | Self::Fast { width, layers, grid }) = self;
        let checks = [
            ((1..=2048).contains(width), "network width must be 1 to 2048"),
            ((1..=64).contains(layers), "network layers must be 1 to 64"),
            ((1..=32).contains(&grid.levels), "grid levels must be 1 to 32"),
            (
                matches!(grid.features_per_level, 1 | 2 | 4 | 8),
                "grid features_per_level must be 1, 2, 4 or 8",
            ),
            ((4..=24).contains(&grid.log2_hashmap_size), "grid log2_hashmap_size must be 4 to 24"),
            ((1..=65_536).contains(&grid.base_resolution), "grid base_resolution must be 1 to 65536"),
            (
                in_range(grid.finest_cells_per_pixel, 1e-3, 4.0),
                "grid finest_cells_per_pixel must be 0.001 to 4",
            ),
        ];
        match checks.iter().find(|(ok, _)| !ok) {
            Some((_, message)) => Err((*message).to_owned()),
            None => Ok(()),
        }
    }
}

impl TrainConfig {
    /// The default: the fast network on raw targets.
    pub fn fast(size: SizeRange) -> Self {
        Self {
            network: NetworkConfig::Fast { width: 64, layers: 2, grid: GridConfig::default() },
            placement: LightPlacement::Segments,
            size,
            targets: TargetMode::Raw,
            samples: 32 << 20,
            batch_start: 2048,
            batch_end: 16_384,
            lights_per_pixel: 32,
            sample_reuse: 4,
            scale_by_area: true,
            area_weight: 0.5,
            rates: LearningRates { adam: 4e-3, muon: 4e-3, grid: 2e-3, final_fraction: 0.01 },
            muon: true,
            ema_decay: 0.99,
            held_out: 8,
        }
    }

    /// The paper's network and loss at batches that a CPU can do, and on raw targets: in the minutes that a CPU is given, they
    /// serve better than the paper's pool of denoised images, which by then holds few lights.
    pub fn reference(size: SizeRange) -> Self {
        Self {
            network: NetworkConfig::Reference {
                width: 256,
                layers: 8,
                grid: GridConfig { levels: 16, ..GridConfig::default() },
            },
            targets: TargetMode::Raw,
            batch_start: 1024,
            batch_end: 4096,
            rates: LearningRates { adam: 2e-3, muon: 0.0, grid: 1e-2, final_fraction: 0.01 },
            scale_by_area: false,
            area_weight: 0.0,
            muon: false,
            ema_decay: 0.0,
            ..Self::fast(size)
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`ProxyError::Config`] names the field and what it may be.
    pub fn validate(&self, kind: LightKind) -> Result<(), ProxyError> {
        self.network.validate().map_err(ProxyError::Config)?;
        let checks = [
            (in_range(self.size.min, 1e-6, self.size.max), "size.min must be above 0 and at most size.max"),
            (self.size.max.is_finite(), "size.max must be finite"),
            (self.samples > 0, "samples must be above 0"),
            (
                matches!(self.lights_per_pixel, 1 | 2 | 4 | 8 | 16 | 32),
                "lights_per_pixel must be 1, 2, 4, 8, 16 or 32",
            ),
            ((1..=1024).contains(&self.sample_reuse), "sample_reuse must be 1 to 1024"),
            (batch_ok(self.batch_start) && batch_ok(self.batch_end), "batches must be 1024 to 4194304"),
            (self.batch_start <= self.batch_end, "batch_start must not be above batch_end"),
            (in_range(self.rates.adam, 0.0, 1.0), "rates.adam must be 0 to 1"),
            (in_range(self.rates.muon, 0.0, 1.0), "rates.muon must be 0 to 1"),
            (in_range(self.rates.grid, 0.0, 1.0), "rates.grid must be 0 to 1"),
            (in_range(self.rates.final_fraction, 0.0, 1.0), "rates.final_fraction must be 0 to 1"),
            (in_range(self.area_weight, 0.0, 2.0), "area_weight must be 0 to 2"),
            (self.ema_decay >= 0.0 && self.ema_decay < 1.0, "ema_decay must be 0 to below 1"),
            (self.pool_ok(), "a pool's size must be 1 to 100000"),
        ];
        match checks.iter().find(|(ok, _)| !ok) {
            Some((_, message)) => Err(ProxyError::Config(format!("{message} ({kind} lights)"))),
            None => Ok(()),
        }
    }

    fn pool_ok(&self) -> bool {
        match self.targets {
            TargetMode::Raw => true,
            TargetMode::Pool { size, .. } => (1..=100_000).contains(&size),
        }
    }
}

fn in_range(x: f32, low: f32, high: f32) -> bool {
    x >= low && x <= high
}

fn batch_ok(batch: usize) -> bool {
    (1024..=4_194_304).contains(&batch)
}
