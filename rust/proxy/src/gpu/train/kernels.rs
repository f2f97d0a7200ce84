use relume_gpu::{Binding, Bound, Gpu, GpuError, Kernel};

use super::optimise::Optimise;
use super::store::Store;
use super::{Buffers, GpuTraining};
use crate::light::Form;

/// Kernels that a gradient needs, with their buffers.
#[derive(Debug)]
pub(super) struct Kernels {
    pub inputs: Bound,
    pub sum_slots: Bound,
    pub scatter: Bound,
    pub targets: Kernel,
    pub products: Products,
}

/// Those of them that multiply matrices.
#[derive(Debug)]
pub(super) struct Products {
    /// True if both factors are rounded to 16 bits (`train/product_matrices.wgsl`).
    pub by_matrices: bool,
    pub forward: Bound,
    pub samples: Bound,
    pub loss: Bound,
    pub backward: Bound,
    pub weights: Bound,
}

impl Kernels {
    /// Kernels with products in 32 bits.
    pub fn new(
        gpu: &Gpu,
        buffers: &Buffers,
        store: &Store,
        optimise: &Optimise,
        form: Form,
    ) -> Result<Self, GpuError> {
        let bind = |stage: &str, entry: &str, bindings: &[Binding<'_>]| {
            gpu.kernel(&format!("train/{stage}"), entry, &[])?.bind(bindings)
        };
        let (draws, levels) = (buffers.draws.whole(), buffers.levels.whole());
        let (pixels, activations) = (store.pixels.whole(), buffers.activations.whole());
        let (scene, lights) = (store.scene.whole(), store.lights.whole());
        let inputs = [optimise.params.whole(), levels, draws, pixels, scene, lights, activations];
        let scatter = [levels, draws, pixels, activations, optimise.grid.whole()];
        let products =
            Products::new((buffers, store, optimise), false, |name, entry| gpu.kernel(name, entry, &[]))?;
        Ok(Self {
            inputs: gpu.kernel("train/inputs", "inputs", &[("FORM", form as u32)])?.bind(&inputs)?,
            sum_slots: bind("slots", "sum_slots", &[activations])?,
            scatter: bind("scatter", "scatter", &scatter)?,
            targets: gpu.kernel("train/targets", "store", &[])?,
            products,
        })
    }
}

impl Products {
    /// Makes kernels that `compile` makes of a module and an entry point.
    pub fn new(
        (buffers, store, optimise): (&Buffers, &Store, &Optimise),
        by_matrices: bool,
        compile: impl Fn(&str, &str) -> Result<Kernel, GpuError>,
    ) -> Result<Self, GpuError> {
        let (layers, activations) = (buffers.layers.whole(), buffers.activations.whole());
        let (params, draws) = (optimise.params.whole(), buffers.draws.whole());
        let (lights, targets) = (store.lights.whole(), store.targets.whole());
        let dense = [layers, activations, params];
        let loss = [layers, activations, params, draws, lights, targets, buffers.losses.whole()];
        Ok(Self {
            by_matrices,
            forward: compile("train/chains", "forward")?.bind(&dense)?,
            samples: compile("train/loss", "samples")?.bind(&loss)?,
            loss: compile("train/loss", "loss")?.bind(&loss)?,
            backward: compile("train/chains", "backward")?.bind(&dense)?,
            weights: compile("train/weights", "weights")?.bind(&[
                layers,
                activations,
                buffers.pieces.whole(),
            ])?,
        })
    }
}

impl GpuTraining {
    /// Products of kernels that `compile` makes.
    pub(super) fn products(
        &self,
        by_matrices: bool,
        compile: impl Fn(&str, &str) -> Result<Kernel, GpuError>,
    ) -> Result<Products, GpuError> {
        Products::new((&self.buffers, &self.store, &self.optimise), by_matrices, compile)
    }
}
