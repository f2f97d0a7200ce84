use bytemuck::{NoUninit, Zeroable};

use super::arguments::{Batch, Expansion, Features, Inputs, Loss, Slots};
use crate::NetworkConfig;
use crate::analytic::FEATURES;
use crate::params::{ParamLayout, Role, Tensor};
use crate::scene_cache::{AUX, AUX_PAPER, FACTOR, SURFACE};
use crate::simd::LANES;

/// Instead of an offset, where there is none.
const NONE: u32 = u32::MAX;

/// What the columns of activations stand for; numbers as in `train/batch.wgsl`.
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

/// A dense layer: the twin of `Layer` in `train/layers.wgsl`, which tells what the fields are.
#[repr(C)]
#[derive(Clone, Copy, Debug, NoUninit, Zeroable)]
pub(super) struct Layer {
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
}

impl Layer {
    /// What its columns are.
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

/// Rows of the table of layers that run in one dispatch.
pub(super) type Rows = std::ops::Range<u32>;

/// A network as the kernels see it: its layers, the order in which they run, and where all values lie. Arguments hold
/// everything but the batch and what changes from step to step.
#[derive(Debug)]
pub(super) struct Plan {
    pub layers: Vec<Layer>,
    /// Forwards, up to the last layer, which is part of the loss.
    pub forward: Vec<Rows>,
    /// Backwards, before and after the sums over the lights of each pixel.
    pub backward: [Vec<Rows>; 2],
    pub inputs: Inputs,
    pub features: Option<Features>,
    pub expansion: Option<Expansion>,
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

/// What is needed of a network besides its configuration.
pub(super) struct Shape<'a> {
    pub layout: &'a ParamLayout,
    pub grid_levels: usize,
    pub grid_outputs: usize,
    pub light_inputs: usize,
    pub image: [usize; 2],
}

impl Plan {
    /// For batches of up to `capacity` samples at a time, with `slots` lights a pixel.
    pub fn new(config: &NetworkConfig, shape: &Shape<'_>, capacity: u32, slots: u32) -> Self {
        let rooms = Rooms { batch: Batch { samples: capacity, capacity, slots }, used: 0 };
        match *config {
            NetworkConfig::Fast { width, layers, .. } => Self::fast(width, layers, shape, rooms),
            NetworkConfig::Reference { width, layers, .. } => Self::reference(width, layers, shape, rooms),
        }
    }

    fn fast(width: usize, depth: usize, shape: &Shape<'_>, mut rooms: Rooms) -> Self {
        let rooms = &mut rooms;
        let pixel_inputs = shape.grid_outputs + AUX;
        let modulations = 2 * width * (depth + 1);
        let pixels = rooms.rows(Space::Pixels, pixel_inputs);
        let d_pixels = rooms.rows(Space::Pixels, pixel_inputs);
        let surfaces = rooms.rows(Space::Pixels, SURFACE);
        let lights = rooms.rows(Space::Lights, shape.light_inputs);
        let features = rooms.rows(Space::Samples, FEATURES);
        let trunk = plain(shape, "trunk", Space::Pixels, &[pixel_inputs, width, width, width], pixels, rooms);
        let sizes = [shape.light_inputs, width, width, modulations];
        let encoder = plain(shape, "encoder", Space::Lights, &sizes, lights, rooms);
        let head = Head { width, depth, trunk: trunk[2], encoder: encoder[2], features };
        let (mut head, d_first) = head.layers(shape, rooms);
        let mut layers: Vec<Layer> = trunk.iter().zip(&encoder).flat_map(|(t, e)| [*t, *e]).collect();
        layers[0].d_input = d_pixels;
        layers.append(&mut head);
        let last = layers.len() as u32 - 1;
        let forward = [0..2, 2..4, 4..6].into_iter().chain((6..last).map(|row| row..row + 1)).collect();
        let before = (7..=last).rev().map(|row| row..row + 1).collect();
        Self {
            forward,
            backward: [before, vec![4..6, 2..4, 0..1]],
            inputs: inputs(shape, [pixels, lights, surfaces], [AUX, SURFACE]),
            features: Some(Features { surfaces, values: features, ..Zeroable::zeroed() }),
            expansion: None,
            loss: loss(&layers[last as usize], surfaces + FACTOR as u32 * rooms.stride(Space::Pixels)),
            slots: Slots {
                samples: d_first,
                pixels: trunk[2].d_product,
                rows: width as u32,
                modulation: encoder[2].output,
                ..Zeroable::zeroed()
            },
            d_pixels,
            activations: rooms.used,
            dense: dense(shape.layout),
            layers,
        }
    }

    fn reference(width: usize, depth: usize, shape: &Shape<'_>, mut rooms: Rooms) -> Self {
        let rooms = &mut rooms;
        let pixel_rows = shape.grid_outputs + AUX_PAPER;
        let rows = pixel_rows + shape.light_inputs;
        let pixels = rooms.rows(Space::Pixels, pixel_rows);
        let d_pixels = rooms.rows(Space::Pixels, shape.grid_outputs);
        let lights = rooms.rows(Space::Lights, shape.light_inputs);
        let samples = rooms.rows(Space::Samples, rows);
        let d_samples = rooms.rows(Space::Samples, rows);
        let mut sizes = vec![rows];
        sizes.extend(std::iter::repeat_n(width, depth));
        sizes.push(3);
        let mut layers = plain(shape, "mlp", Space::Samples, &sizes, samples, rooms);
        layers[0].d_input = d_samples;
        let last = layers.len() as u32 - 1;
        Self {
            forward: (0..last).map(|row| row..row + 1).collect(),
            backward: [(0..=last).rev().map(|row| row..row + 1).collect(), Vec::new()],
            inputs: inputs(shape, [pixels, lights, 0], [AUX_PAPER, 0]),
            features: None,
            expansion: Some(Expansion {
                pixels,
                lights,
                samples,
                pixel_rows: pixel_rows as u32,
                light_rows: shape.light_inputs as u32,
                ..Zeroable::zeroed()
            }),
            loss: loss(&layers[last as usize], NONE),
            slots: Slots {
                samples: d_samples,
                pixels: d_pixels,
                rows: shape.grid_outputs as u32,
                modulation: NONE,
                ..Zeroable::zeroed()
            },
            d_pixels,
            activations: rooms.used,
            dense: dense(shape.layout),
            layers,
        }
    }
}

/// Layers of a plain network, ReLU between them; the gradient by its input has no place yet.
fn plain(
    shape: &Shape<'_>,
    name: &str,
    space: Space,
    sizes: &[usize],
    input: u32,
    rooms: &mut Rooms,
) -> Vec<Layer> {
    let count = sizes.len() - 1;
    let mut layers: Vec<Layer> = Vec::with_capacity(count);
    for index in 0..count {
        let weights = tensor(shape.layout, &format!("{name}.{index}.weight"));
        let before = layers.last().copied();
        layers.push(Layer {
            bias: tensor(shape.layout, &format!("{name}.{index}.bias")).start as u32,
            input: before.map_or(input, |layer| layer.output),
            d_input: before.map_or(NONE, |layer| layer.d_product),
            before: before.map_or(0, |_| RELU),
            finish: if index + 1 == count { FINISH_LINEAR } else { RELU },
            ..layer(weights, space, rooms)
        });
    }
    layers
}

/// A layer of these weights, its output and gradient placed.
fn layer(weights: &Tensor, space: Space, rooms: &mut Rooms) -> Layer {
    Layer {
        weights: weights.start as u32,
        stride: weights.stride as u32,
        bias: NONE,
        inputs: weights.cols as u32,
        outputs: weights.rows as u32,
        space: space as u32,
        output: rooms.rows(space, weights.rows),
        d_product: rooms.rows(space, weights.rows),
        ..Zeroable::zeroed()
    }
}

/// The head of the fast network.
struct Head {
    width: usize,
    depth: usize,
    /// Last layers of trunk and encoder.
    trunk: Layer,
    encoder: Layer,
    features: u32,
}

impl Head {
    /// All its layers, and where the gradient by the sum of modulated trunk and features lies.
    fn layers(&self, shape: &Shape<'_>, rooms: &mut Rooms) -> (Vec<Layer>, u32) {
        let space = Space::Samples;
        let stride = rooms.stride(Space::Lights);
        let modulation = |index: usize| (2 * self.width * index) as u32 * stride;
        let mut layers = vec![Layer {
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
            let mut next = Layer {
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
        let d_first = layers[0].d_product;
        (layers, d_first)
    }
}

fn inputs(
    shape: &Shape<'_>,
    [pixels, lights, surfaces]: [u32; 3],
    [known, surface_rows]: [usize; 2],
) -> Inputs {
    Inputs {
        pixels,
        lights,
        surfaces,
        known: known as u32,
        light_inputs: shape.light_inputs as u32,
        surface_rows: surface_rows as u32,
        levels: shape.grid_levels as u32,
        features: (shape.grid_outputs / shape.grid_levels) as u32,
        width: shape.image[0] as u32,
        height: shape.image[1] as u32,
        ..Zeroable::zeroed()
    }
}

fn loss(last: &Layer, factors: u32) -> Loss {
    Loss {
        weights: last.weights,
        stride: last.stride,
        bias: last.bias,
        inputs: last.inputs,
        input: last.input,
        d_product: last.d_product,
        factors,
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
