//! Arguments of the kernels: twins of the structs of the same names in `shaders/train/*.wgsl`, which tell what the
//! fields are.

use bytemuck::{NoUninit, Pod, Zeroable};

macro_rules! arguments {
    ($($name:ident { $($field:ident: $type:ty),* $(,)? })*) => {
        $(#[repr(C)]
        #[derive(Clone, Copy, Debug, NoUninit, Zeroable)]
        pub(super) struct $name { $(pub $field: $type),* })*
    };
}

arguments! {
    Batch { samples: u32, capacity: u32, slots: u32 }
    Inputs {
        batch: Batch, first_draw: u32, pixels: u32, lights: u32, factors: u32, values: u32, known: u32, light_inputs: u32,
        levels: u32, features: u32, width: u32, height: u32,
    }
    Chains { batch: Batch, first: u32, length: u32, pitch: u32, count: u32, scale: f32 }
    Loss { chain: Chains, first_draw: u32, factors: u32, weight: f32, first_sum: u32 }
    Weights { batch: Batch, layers: u32, piece: u32, add: u32, parameters: u32, scale: f32 }
    Slots { batch: Batch, samples: u32, pixels: u32, rows: u32, modulation: u32 }
    Scatter {
        batch: Batch, first_draw: u32, d_pixels: u32, levels: u32, features: u32, width: u32, height: u32, grid: u32,
    }
    Reduction { batch: Batch, piece: u32, dense: u32, parameters: u32, losses: u32 }
    Rates {
        parameters: u32, adam: f32, grid: f32, first_correction: f32, second_correction: f32, mean_share: f32,
        matrices: u32, size: u32, stride: u32, muon: f32, linear: f32, cubic: f32, quintic: f32,
    }
    Targets { samples: u32, slots: u32, first_block: u32, blocks: u32, block: u32 }
    Pool { tiles: u32, slots: u32, first: u32, images: u32, pixels: u32 }
    Muon {
        size: u32, stride: u32, matrices: u32, left: u32, right: u32, turned: u32, plus: u32, to: u32, factor: f32,
        share: f32, step: f32, mean_share: f32,
    }
}

/// Progress of the steps on the device.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct TrainProgress {
    pub loss: f32,
    pub loss_sum: f32,
    pub steps: u32,
    pub diverged: u32,
    pub bad_target: u32,
}
