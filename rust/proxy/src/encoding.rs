use std::f32::consts::PI;

use crate::analytic::{Dual, Real, dual_params, unit};
use crate::light::{Form, HALF_ANGLES};
use crate::scene_cache::Normalisation;
use crate::{LightKind, LightParams, MAX_PARAMS, SizeRange};

/// Largest number of inputs that stand for a light.
pub(crate) const MAX_LIGHT_INPUTS: usize = 14 + 6 * MAX_FREQUENCIES;
/// Most octaves of the centre's sines and cosines.
const MAX_FREQUENCIES: usize = 4;

/// Turns light parameters into network inputs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightEncoding {
    pub kind: LightKind,
    pub normalisation: Normalisation,
    /// Octaves of sines and cosines of the centre that are added.
    frequencies: usize,
    /// Middle and half width of the logarithm of sizes.
    log_middle: f32,
    log_half: f32,
}

impl LightEncoding {
    /// Sizes in `size` go to -1..1.
    pub fn new(kind: LightKind, normalisation: Normalisation, size: SizeRange) -> Self {
        let (low, high) = (size.min.ln(), size.max.ln());
        let (log_middle, log_half) = (0.5 * (low + high), (0.5 * (high - low)).max(0.1));
        Self { kind, normalisation, frequencies: 0, log_middle, log_half }
    }

    /// Adds sines and cosines of the centre, in octaves from a period of four half diagonals down.
    pub fn with_frequencies(self, frequencies: usize) -> Self {
        Self { frequencies: frequencies.min(MAX_FREQUENCIES), ..self }
    }

    /// Number of inputs: centre and log radius; of spots also axis, half angle and blend; of flat lights centre, normal,
    /// log width and height, and a tensor that tells the roll.
    pub fn inputs(&self) -> usize {
        self.plain_inputs() + 6 * self.frequencies
    }

    fn plain_inputs(&self) -> usize {
        match self.kind.form() {
            Form::Round => 4,
            Form::Cone => 9,
            Form::Flat => 14,
        }
    }

    /// The inputs of a light, [`LightEncoding::inputs`] of them.
    pub fn encode(&self, light: &LightParams) -> [f32; MAX_LIGHT_INPUTS] {
        self.inputs_of(&dual_params(light)).map(|input| input.value)
    }

    /// Gradient by the parameters, from that by the inputs.
    pub fn backward(&self, light: &LightParams, d_inputs: &[f32]) -> [f32; MAX_PARAMS] {
        let mut gradient = [0.0; MAX_PARAMS];
        for (input, d_input) in self.inputs_of(&dual_params(light)).iter().zip(d_inputs) {
            for (sum, d) in gradient.iter_mut().zip(input.d) {
                *sum += d * d_input;
            }
        }
        gradient
    }

    fn inputs_of(&self, p: &[Dual; MAX_PARAMS]) -> [Dual; MAX_LIGHT_INPUTS] {
        let mut out = [Dual::constant(0.0); MAX_LIGHT_INPUTS];
        let inverse_scale = Dual::constant(1.0 / self.normalisation.scale);
        for axis in 0..3 {
            out[axis] = (p[axis] - Dual::constant(self.normalisation.center[axis])) * inverse_scale;
        }
        match self.kind.form() {
            Form::Round => out[3] = self.log_size(p[3] * p[3]),
            Form::Cone => self.cone_inputs(p, &mut out),
            Form::Flat => self.flat_inputs(p, &mut out),
        }
        let start = self.plain_inputs();
        for octave in 0..self.frequencies {
            let factor = Dual::constant(std::f32::consts::FRAC_PI_2 * (1 << octave) as f32);
            for axis in 0..3 {
                let (sine, cosine) = (out[axis] * factor).sine_and_cosine();
                out[start + 6 * octave + axis] = sine;
                out[start + 6 * octave + 3 + axis] = cosine;
            }
        }
        out
    }

    /// Log radius, axis, and the cone's half angle and blend, which go to -1..1.
    fn cone_inputs(&self, p: &[Dual; MAX_PARAMS], out: &mut [Dual; MAX_LIGHT_INPUTS]) {
        out[3] = self.log_size(p[3] * p[3]);
        out[4..7].copy_from_slice(&unit([p[6], p[7], p[8]]));
        let to_unit = |x: Dual, [low, high]: [f32; 2]| {
            (x + x - Dual::constant(low + high)) * Dual::constant(1.0 / (high - low))
        };
        out[7] = to_unit(p[4], HALF_ANGLES);
        out[8] = to_unit(p[5], [0.0, 1.0]);
    }

    /// Normal, log sizes, and the six different entries of `(u u^T + v v^T) / (|u|^2 + |v|^2)`. That tensor is the same
    /// for all names that the two edges of one rectangle can be given, and turns with its roll.
    fn flat_inputs(&self, p: &[Dual; MAX_PARAMS], out: &mut [Dual; MAX_LIGHT_INPUTS]) {
        let (u, v) = ([p[3], p[4], p[5]], [p[6], p[7], p[8]]);
        let squared = |a: [Dual; 3]| a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
        let (uu, vv) = (squared(u), squared(v));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = (squared(normal) + Dual::constant(1e-20)).sqrt();
        for axis in 0..3 {
            out[3 + axis] = normal[axis] / length;
        }
        // The sum and the product of the sizes do not depend on which edge is called u; neither do these two.
        out[6] = self.log_size(length);
        out[7] = self.log_size((uu + vv) * Dual::constant(0.5));
        for (slot, (i, j)) in [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)].into_iter().enumerate() {
            out[8 + slot] = (u[i] * u[j] + v[i] * v[j]) / (uu + vv + Dual::constant(1e-20));
        }
    }

    /// Logarithm of a size given by its square, -1..1 over the trained range.
    fn log_size(&self, squared: Dual) -> Dual {
        let log = (squared + Dual::constant(1e-20)).ln() * Dual::constant(0.5);
        (log - Dual::constant(self.log_middle)) / Dual::constant(self.log_half)
    }
}

/// Factor of the network's output: a constant, and the light's area in units of that of a middling light, so that small
/// lights do not vanish under the loss.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OutputScale {
    /// Radiance of a network output of 1 at the middling light.
    pub factor: f32,
    /// Area of the middling light, square metres; `None` if outputs do not follow the area.
    pub area: Option<f32>,
}

impl OutputScale {
    /// The scale of one light and its gradient by the parameters.
    pub(crate) fn of(&self, light: &LightParams) -> (f32, [f32; MAX_PARAMS]) {
        let Some(area) = self.area else { return (self.factor, [0.0; MAX_PARAMS]) };
        let scale = emitting_area(light) * Dual::constant(self.factor / area);
        (scale.value, scale.d)
    }
}

/// Projected area of a light, square metres.
pub(crate) fn emitting_area(light: &LightParams) -> Dual {
    let p = dual_params(light);
    match light.kind().form() {
        Form::Round | Form::Cone => p[3] * p[3] * Dual::constant(PI),
        Form::Flat => {
            let squared = |i: usize| p[i] * p[i] + p[i + 1] * p[i + 1] + p[i + 2] * p[i + 2];
            let share = if light.kind() == LightKind::Ellipse { PI / 4.0 } else { 1.0 };
            (squared(3) * squared(6)).sqrt() * Dual::constant(share)
        }
    }
}
