use bytemuck::{NoUninit, Zeroable};

use super::arguments::{Batch, Chains, Inputs, Loss, Slots};
use crate::NetworkConfig;
use crate::analytic::FEATURES;
use crate::params::{ParamLayout, Role, Tensor};
use crate::scene_cache::{AUX, AUX_PAPER, FACTOR, SURFACE};

use crate::simd::LANES;

/// Instead of a place, where there is none.
const NOTHING: u32 = u32::MAX;
/// Rows and columns of a tile of a product, as in `train/product.wgsl`.
pub(super) const TILE: u32 = 64;
/// Widest network whose layers run in chains. A chain has a workgroup for each tile of columns, single layers one for each
/// tile of rows as well: wider layers would leave most of a large card idle.
const WIDEST_CHAIN: usize = 2 * TILE as usize;

/// Factors on the outputs of a pixel.
const FACTORS: usize = SURFACE - FACTOR;

/// Meaning of the columns of activations; numbers as in `train/batch.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Samples = 0,
    Pixels = 1,
    Lights = 2,
}

impl Batch {
    /// Columns in use.
    pub fn columns(&self, space: Space) -> u32 {
        per_space(self.samples, self.slots, space)
    }
}

fn per_space(samples: u32, slots: u32, space: Space) -> u32 {
    match space {
        Space::Samples => samples,
        Space::Pixels => samples / slots,
        Space::Lights => samples / LANES as u32,
    }
}

/// A dense layer: the mirror of `Layer` in `train/layers.wgsl`, which tells what the fields are.
#[repr(C)]
#[derive(Clone, Copy, Debug, NoUninit, Zeroable)]
pub(super) struct DenseLayer {
    pub weights: u32,
    pub stride: u32,
    pub bias: u32,
    pub inputs: u32,
    pub outputs: u32,
    pub space: u32,
    pub input: u32,
    pub output: u32,
    pub d_product: u32,
    pub d_input: u32,
    pub finish: u32,
    pub modulation: u32,
    pub product: u32,
    pub before: u32,
    pub before_modulation: u32,
    pub before_d_modulation: u32,
    pub before_product: u32,
    pub pixel_rows: u32,
    pub light_rows: u32,
}

impl DenseLayer {
    /// Meaning of its columns.
    pub fn space(&self) -> Space {
        match self.space {
            0 => Space::Samples,
            1 => Space::Pixels,
            _ => Space::Lights,
        }
    }
}

/// `FINISH_*` and `BEFORE_*` of `train/layers.wgsl`.
const FINISH_LINEAR: u32 = 0;
const RELU: u32 = 1;
const MODULATED: u32 = 2;
const TRUNK: u32 = 3;

/// A network as the kernels see it: its layers, the order in which they run, and where all values lie. Arguments hold
/// everything but the batch and what changes from step to step.
#[derive(Debug)]
pub(super) struct Plan {
    pub layers: Vec<DenseLayer>,
    /// Chains that run by pixel and by light, forwards and backwards.
    pub forward: Vec<Chains>,
    pub backward: Vec<Chains>,
    /// Chains that run by sample, up to the last layer, which is part of the loss.
    pub samples: Chains,
    /// True for one chain, false for single layers.
    pub chained: bool,
    pub inputs: Inputs,
    pub loss: Loss,
    pub slots: Slots,
    /// First value of the gradient by the encoded pixels.
    pub d_pixels: u32,
    /// Values of the activations.
    pub activations: u32,
    /// Parameters before the grid.
    pub dense: u32,
}

/// Hands out rows of activations.
struct Rooms {
    batch: Batch,
    used: u32,
}

impl Rooms {
    fn rows(&mut self, space: Space, rows: usize) -> u32 {
        let first = self.used;
        self.used += rows as u32 * self.stride(space);
        first
    }

    fn stride(&self, space: Space) -> u32 {
        per_space(self.batch.capacity, self.batch.slots, space)
    }
}

/// Shape of a network beyond its configuration.
pub(super) struct NetworkShape<'a> {
    pub layout: &'a ParamLayout,
    pub grid_levels: usize,
    pub grid_outputs: usize,
    pub light_inputs: usize,
    pub image: [usize; 2],
}

impl Plan {
    /// Plan for batches of up to `capacity` samples at a time, with `slots` lights a pixel.
    pub fn new(config: &NetworkConfig, shape: &NetworkShape<'_>, capacity: u32, slots: u32) -> Self {
        let rooms = Rooms { batch: Batch { samples: capacity, capacity, slots }, used: 0 };
        match *config {
            NetworkConfig::Fast { width, layers, .. } => Self::fast(width, layers, shape, rooms),
            NetworkConfig::Reference { width, layers, .. } => Self::reference(width, layers, shape, rooms),
        }
    }

    fn fast(width: usize, depth: usize, shape: &NetworkShape<'_>, mut rooms: Rooms) -> Self {
        let rooms = &mut rooms;
        let pixel_inputs = shape.grid_outputs + AUX;
        let modulations = 2 * width * (depth + 1);
        let pixels = rooms.rows(Space::Pixels, pixel_inputs);
        let d_pixels = rooms.rows(Space::Pixels, pixel_inputs);
        let factors = rooms.rows(Space::Pixels, FACTORS);
        let lights = rooms.rows(Space::Lights, shape.light_inputs);
        let features = rooms.rows(Space::Samples, FEATURES);
        let mut trunk =
            plain(shape, "trunk", Space::Pixels, &[pixel_inputs, width, width, width], pixels, rooms);
        let sizes = [shape.light_inputs, width, width, modulations];
        let encoder = plain(shape, "encoder", Space::Lights, &sizes, lights, rooms);
        let head = FastHead { width, depth, trunk: trunk[2], encoder: encoder[2], features };
        let head = head.layers(shape, rooms);
        let slots = Slots {
            samples: head[0].d_product,
            pixels: trunk[2].d_product,
            rows: width as u32,
            modulation: encoder[2].output,
            ..Zeroable::zeroed()
        };
        trunk[0].d_input = d_pixels;
        let chained = width <= WIDEST_CHAIN;
        // Trunk and encoder run side by side. The encoder has its many outputs alone, so that they are dealt out.
        let sides = |first, length| Chains { first, length, pitch: 3, count: 2, ..Zeroable::zeroed() };
        let single = [0, 1, 2].map(|first| sides(first, 1));
        Self {
            forward: if chained { vec![sides(0, 2), sides(2, 1)] } else { single.to_vec() },
            backward: if chained { vec![sides(0, 3)] } else { single.into_iter().rev().collect() },
            samples: chain(6, depth + 1),
            chained,
            inputs: inputs(shape, [pixels, lights, factors, features], AUX),
            loss: Loss { factors, ..Zeroable::zeroed() },
            slots,
            d_pixels,
            activations: rooms.used,
            dense: dense(shape.layout),
            layers: [trunk, encoder, head].concat(),
        }
    }

    fn reference(width: usize, depth: usize, shape: &NetworkShape<'_>, mut rooms: Rooms) -> Self {
        let rooms = &mut rooms;
        let pixel_rows = shape.grid_outputs + AUX_PAPER;
        let rows = pixel_rows + shape.light_inputs;
        let pixels = rooms.rows(Space::Pixels, pixel_rows);
        let d_pixels = rooms.rows(Space::Pixels, shape.grid_outputs);
        let lights = rooms.rows(Space::Lights, shape.light_inputs);
        let d_samples = rooms.rows(Space::Samples, rows);
        let mut sizes = vec![rows];
        sizes.extend(std::iter::repeat_n(width, depth));
        sizes.push(3);
        let mut layers = plain(shape, "mlp", Space::Samples, &sizes, pixels, rooms);
        let first = &mut layers[0];
        (first.d_input, first.pixel_rows, first.light_rows) = (d_samples, pixel_rows as u32, lights);
        Self {
            forward: Vec::new(),
            backward: Vec::new(),
            samples: chain(0, depth),
            chained: width <= WIDEST_CHAIN,
            inputs: inputs(shape, [pixels, lights, NOTHING, NOTHING], AUX_PAPER),
            loss: Loss { factors: NOTHING, ..Zeroable::zeroed() },
            slots: Slots {
                samples: d_samples,
                pixels: d_pixels,
                rows: shape.grid_outputs as u32,
                modulation: NOTHING,
                ..Zeroable::zeroed()
            },
            d_pixels,
            activations: rooms.used,
            dense: dense(shape.layout),
            layers,
        }
    }
}

/// One chain of layers.
fn chain(first: u32, length: usize) -> Chains {
    Chains { first, length: length as u32, count: 1, ..Zeroable::zeroed() }
}

/// Layers of a plain network, ReLU between them; the gradient by its input has no place yet.
fn plain(
    shape: &NetworkShape<'_>,
    name: &str,
    space: Space,
    sizes: &[usize],
    input: u32,
    rooms: &mut Rooms,
) -> Vec<DenseLayer> {
    let count = sizes.len() - 1;
    let mut layers: Vec<DenseLayer> = Vec::with_capacity(count);
    for index in 0..count {
        let weights = tensor(shape.layout, &format!("{name}.{index}.weight"));
        let before = layers.last().copied();
        layers.push(DenseLayer {
            bias: tensor(shape.layout, &format!("{name}.{index}.bias")).start as u32,
            input: before.map_or(input, |layer| layer.output),
            d_input: before.map_or(NOTHING, |layer| layer.d_product),
            before: before.map_or(0, |_| RELU),
            finish: if index + 1 == count { FINISH_LINEAR } else { RELU },
            ..layer(weights, space, rooms)
        });
    }
    layers
}

/// A layer of these weights, its output and gradient placed.
fn layer(weights: &Tensor, space: Space, rooms: &mut Rooms) -> DenseLayer {
    DenseLayer {
        weights: weights.start as u32,
        stride: weights.stride as u32,
        bias: NOTHING,
        d_input: NOTHING,
        pixel_rows: NOTHING,
        inputs: weights.cols as u32,
        outputs: weights.rows as u32,
        space: space as u32,
        output: rooms.rows(space, weights.rows),
        d_product: rooms.rows(space, weights.rows),
        ..Zeroable::zeroed()
    }
}

/// The head of the fast network.
struct FastHead {
    width: usize,
    depth: usize,
    /// Last layers of trunk and encoder.
    trunk: DenseLayer,
    encoder: DenseLayer,
    features: u32,
}

impl FastHead {
    fn layers(&self, shape: &NetworkShape<'_>, rooms: &mut Rooms) -> Vec<DenseLayer> {
        let space = Space::Samples;
        let stride = rooms.stride(Space::Lights);
        let modulation = |index: usize| (2 * self.width * index) as u32 * stride;
        let mut layers = vec![DenseLayer {
            input: self.features,
            finish: TRUNK,
            modulation: self.encoder.output,
            product: self.trunk.output,
            ..layer(tensor(shape.layout, "head.features.weight"), space, rooms)
        }];
        for index in 0..=self.depth {
            let before = layers[index];
            let name = if index < self.depth { index.to_string() } else { "output".into() };
            let weights = tensor(shape.layout, &format!("head.{name}.weight"));
            let mut next = DenseLayer {
                input: before.output,
                d_input: before.d_product,
                before: before.finish,
                before_modulation: before.modulation,
                before_d_modulation: self.encoder.d_product + modulation(index),
                before_product: before.product,
                ..layer(weights, space, rooms)
            };
            if index < self.depth {
                next.finish = MODULATED;
                next.modulation = self.encoder.output + modulation(index + 1);
                next.product = rooms.rows(space, self.width);
            } else {
                next.bias = tensor(shape.layout, "head.output.bias").start as u32;
            }
            layers.push(next);
        }
        layers
    }
}

fn inputs(shape: &NetworkShape<'_>, [pixels, lights, factors, values]: [u32; 4], known: usize) -> Inputs {
    Inputs {
        pixels,
        lights,
        factors,
        values,
        known: known as u32,
        light_inputs: shape.light_inputs as u32,
        levels: shape.grid_levels as u32,
        features: (shape.grid_outputs / shape.grid_levels) as u32,
        width: shape.image[0] as u32,
        height: shape.image[1] as u32,
        ..Zeroable::zeroed()
    }
}

/// The tensor of this name; networks name theirs as it is done here.
fn tensor<'a>(layout: &'a ParamLayout, name: &str) -> &'a Tensor {
    layout.tensors.iter().find(|tensor| tensor.name == name).unwrap_or_else(|| panic!("no tensor {name}"))
}

/// Parameters before the grid, which comes last.
fn dense(layout: &ParamLayout) -> u32 {
    layout.tensors.iter().find(|t| t.role == Role::Grid).map_or(layout.len, |t| t.start) as u32
}
