//! Closed-form features of a light as seen from a pixel's first hit. They enter the network as inputs, never as
//! factors: fur, volumes and glass have no single position, and the network is free to ignore them.

use std::f32::consts::PI;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::light::Form;
use crate::scene_cache::Normalisation;
use crate::{LightKind, LightParams, MAX_PARAMS};

/// Numbers that the features are computed in: single values, vectors of lanes, and values with derivatives.
pub(crate) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Constant, the same value everywhere.
    fn constant(x: f32) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// The larger of this and zero.
    fn ramp(self) -> Self;
    /// Natural logarithm; single values only, lanes never ask for it.
    fn ln(self) -> Self;
}

/// Eight lanes.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub(crate) struct EightLanes(pub [f32; 8]);

/// A value and its derivatives by the light's parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual {
    pub value: f32,
    pub d: [f32; MAX_PARAMS],
}

macro_rules! lane_operator {
    ($trait:ident, $name:ident, $operator:tt) => {
        impl $trait for EightLanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let mut out = self.0;
                for i in 0..8 {
                    out[i] = self.0[i] $operator other.0[i];
                }
                Self(out)
            }
        }
    };
}

lane_operator!(Add, add, +);
lane_operator!(Sub, sub, -);
lane_operator!(Mul, mul, *);
lane_operator!(Div, div, /);

impl Neg for EightLanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Real for EightLanes {
    #[inline(always)]
    fn constant(x: f32) -> Self {
        Self([x; 8])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn ramp(self) -> Self {
        Self(self.0.map(|x| x.max(0.0)))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        Self(self.0.map(f32::ln))
    }
}

impl Dual {
    /// The light's parameter number `index`.
    pub fn parameter(value: f32, index: usize) -> Self {
        let mut d = [0.0; MAX_PARAMS];
        d[index] = 1.0;
        Self { value, d }
    }

    /// Sine and cosine.
    pub fn sine_and_cosine(self) -> (Self, Self) {
        let (sine, cosine) = self.value.sin_cos();
        (self.chain(sine, cosine), self.chain(cosine, -sine))
    }

    /// A function of this value with this value and slope.
    fn chain(self, value: f32, slope: f32) -> Self {
        Self { value, d: self.d.map(|d| d * slope) }
    }

    fn combine(self, other: Self, value: f32, by_self: f32, by_other: f32) -> Self {
        Self { value, d: std::array::from_fn(|i| self.d[i] * by_self + other.d[i] * by_other) }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.combine(other, self.value + other.value, 1.0, 1.0)
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.combine(other, self.value - other.value, 1.0, -1.0)
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.combine(other, self.value * other.value, other.value, self.value)
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        self.combine(other, quotient, 1.0 / other.value, -quotient / other.value)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl Real for Dual {
    fn constant(x: f32) -> Self {
        Self { value: x, d: [0.0; MAX_PARAMS] }
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    fn ramp(self) -> Self {
        if self.value > 0.0 { self } else { Self::constant(0.0) }
    }
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }
}

pub(crate) type Vector<T> = [T; 3];

#[inline(always)]
fn dot<T: Real>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn scaled<T: Real>(a: Vector<T>, s: T) -> Vector<T> {
    a.map(|x| x * s)
}

#[inline(always)]
fn sum<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    std::array::from_fn(|i| a[i] + b[i])
}

#[inline(always)]
fn difference<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Properties of a pixel that the features need.
#[derive(Clone, Copy)]
pub(crate) struct PixelSurface<T> {
    /// First hit, in units of the scene's scale.
    pub position: Vector<T>,
    /// Shading normal.
    pub normal: Vector<T>,
    /// Mirror direction of the camera's.
    pub mirror: Vector<T>,
}

/// Features of [`features`].
pub(crate) const FEATURES: usize = 11;

/// Side of the square that has the area of a disk of diameter 1: `sqrt(pi) / 2`.
const SIDE_OF_DISK: f32 = 0.886_226_9;
/// Least width of a cone's soft edge, as a share of the cone, so that a hard edge is differentiable.
const LEAST_EDGE: f32 = 0.05;

/// The parameters of a light, each with its own derivative.
pub(crate) fn dual_params(light: &LightParams) -> [Dual; MAX_PARAMS] {
    let mut params = [Dual::constant(0.0); MAX_PARAMS];
    for (i, value) in light.as_slice().iter().enumerate() {
        params[i] = Dual::parameter(*value, i);
    }
    params
}

/// The light as [`features`] see it, with derivatives by its parameters. Lengths are in units of the scene's scale and
/// positions from its centre. An ellipse is the rectangle of its proportions and area. A spot has the cosine of its
/// half angle in the place of the angle, and an axis of unit length.
pub(crate) fn seen_params(light: &LightParams, normalisation: &Normalisation) -> [Dual; MAX_PARAMS] {
    let mut params = dual_params(light);
    let (center, inverse) = (normalisation.center, Dual::constant(1.0 / normalisation.scale));
    for (p, center) in params.iter_mut().zip(center) {
        *p = (*p - Dual::constant(center)) * inverse;
    }
    match light.kind().form() {
        Form::Round => params[3] = params[3] * inverse,
        Form::Flat => {
            let side = if light.kind() == LightKind::Ellipse { SIDE_OF_DISK } else { 1.0 };
            params[3..].iter_mut().for_each(|p| *p = *p * inverse * Dual::constant(side));
        }
        Form::Cone => {
            params[3] = params[3] * inverse;
            params[4] = params[4].sine_and_cosine().1;
            let axis = unit([params[6], params[7], params[8]]);
            params[6..].copy_from_slice(&axis);
        }
    }
    params
}

/// Values of [`seen_params`].
pub(crate) fn seen_values(light: &LightParams, normalisation: &Normalisation) -> [f32; MAX_PARAMS] {
    seen_params(light, normalisation).map(|p| p.value)
}

/// The direction of a vector; a vector near zero is left short.
pub(crate) fn unit<T: Real>(a: Vector<T>) -> Vector<T> {
    scaled(a, T::constant(1.0) / (dot(a, a) + T::constant(1e-20)).sqrt())
}

/// A light as a surface sees it.
struct Source<T> {
    /// Area of a flat light, squared radius of a round one: added to squared distances, which keeps them above 0.
    area: T,
    /// Vector irradiance per area.
    flux: Vector<T>,
    /// Share of the light that goes to the surface.
    share: T,
    /// The last feature.
    extra: T,
}

/// Features of a light, given by [`seen_params`], at a surface: direction (3), nearness, cosine, mirror cosine and its
/// powers (2), two compressions of the unshadowed irradiance per area of the light, and its apparent size (round
/// lights), the cosine at the light (flat ones) or what its cone lets through (spots, whose powers and irradiance hold
/// that as a factor). All stay finite inside the light.
#[inline(always)]
pub(crate) fn features<T: Real>(form: Form, light: &[T; MAX_PARAMS], at: &PixelSurface<T>) -> [T; FEATURES] {
    let one = T::constant(1.0);
    let offset = difference([light[0], light[1], light[2]], at.position);
    let source = match form {
        Form::Round => round_source(light, offset),
        Form::Flat => flat_source(light, offset),
        Form::Cone => cone_source(light, offset),
    };
    let distance = (dot(offset, offset) + source.area).sqrt();
    let direction = scaled(offset, one / distance);
    let mirror = dot(at.mirror, direction);
    let lobe = mirror.ramp();
    let lobe4 = lobe * lobe * lobe * lobe;
    let lobe16 = lobe4 * lobe4 * lobe4 * lobe4;
    let irradiance = dot(at.normal, source.flux).ramp();
    // The constant bounds the slope at the horizon.
    let root = (irradiance + T::constant(1e-3)).sqrt();
    [
        direction[0],
        direction[1],
        direction[2],
        one / (one + T::constant(4.0) * distance),
        dot(at.normal, direction),
        mirror,
        lobe4 * source.share,
        lobe16 * source.share,
        irradiance / (one + irradiance),
        root / (one + root),
        source.extra,
    ]
}

/// A small source: `L / |L|^3`, and its apparent size.
#[inline(always)]
fn round_source<T: Real>(light: &[T; MAX_PARAMS], offset: Vector<T>) -> Source<T> {
    let one = T::constant(1.0);
    let area = light[3] * light[3];
    let squared = dot(offset, offset) + area;
    let distance = squared.sqrt();
    let flux = scaled(offset, one / (squared * distance));
    Source { area, flux, share: one, extra: light[3] / distance }
}

/// A small source in a cone: Cycles' smoothstep of the cosine to the axis, with an edge that the light's size widens to
/// both sides.
#[inline(always)]
fn cone_source<T: Real>(light: &[T; MAX_PARAMS], offset: Vector<T>) -> Source<T> {
    let one = T::constant(1.0);
    let Source { area, flux, extra: apparent, .. } = round_source(light, offset);
    let (edge, blend) = (light[4], light[5]);
    let distance = (dot(offset, offset) + area).sqrt();
    let cosine = -dot([light[6], light[7], light[8]], offset) / distance;
    let depth = one - edge;
    let soft = (one - edge * edge).ramp().sqrt() * apparent + T::constant(LEAST_EDGE) * depth;
    let inside = ((cosine - edge + soft) / (depth * blend + soft + soft)).ramp();
    let x = one - (one - inside).ramp();
    let share = x * x * (T::constant(3.0) - x - x);
    Source { area, flux: scaled(flux, share), share, extra: share }
}

/// A Lambertian rectangle (Lambert's polygon formula; Arvo 1994, "The Irradiance Jacobian for Partially Occluded
/// Polyhedral Sources"), whose flux points away from it behind its back, and the cosine of the way to its centre at the
/// light.
#[inline(always)]
fn flat_source<T: Real>(light: &[T; MAX_PARAMS], offset: Vector<T>) -> Source<T> {
    let one = T::constant(1.0);
    let half_u = scaled([light[3], light[4], light[5]], T::constant(0.5));
    let half_v = scaled([light[6], light[7], light[8]], T::constant(0.5));
    let corners = [
        difference(difference(offset, half_u), half_v),
        difference(sum(offset, half_u), half_v),
        sum(sum(offset, half_u), half_v),
        sum(difference(offset, half_u), half_v),
    ];
    let units = corners.map(|c| scaled(c, one / (dot(c, c) + T::constant(1e-8)).sqrt()));
    let mut flux = [T::constant(0.0); 3];
    for i in 0..4 {
        let (a, b) = (units[i], units[(i + 1) % 4]);
        flux = sum(flux, scaled(cross(a, b), angle_over_sine(dot(a, b))));
    }
    let normal = cross(half_u, half_v);
    let quarter = (dot(normal, normal) + T::constant(1e-16)).sqrt();
    let area = quarter * T::constant(4.0);
    let distance = (dot(offset, offset) + area).sqrt();
    let cosine = -dot(normal, offset) / (quarter * distance);
    // Seen from its front the corners run clockwise; from its back the sum changes sign, and the flux with it.
    Source { area, flux: scaled(flux, T::constant(-0.5) / area), share: one, extra: cosine }
}

/// `acos(x) / sqrt(1 - x^2)`, the angle between two unit vectors over the length of their cross product. For `x` above
/// 0 a rational fit; below, from the supplementary angle.
#[inline(always)]
fn angle_over_sine<T: Real>(x: T) -> T {
    let one = T::constant(1.0);
    let magnitude = x.ramp() + (-x).ramp();
    let numerator = T::constant(ANGLE_FIT[0])
        + magnitude * (T::constant(ANGLE_FIT[1]) + magnitude * T::constant(ANGLE_FIT[2]));
    let denominator = one + magnitude * (T::constant(ANGLE_FIT[3]) + magnitude * T::constant(ANGLE_FIT[4]));
    let acute = numerator / denominator;
    // 1 where x is negative, else 0, without a branch; the jump is where both forms agree.
    let negative = (-x).ramp() / (magnitude + T::constant(1e-20));
    let sine = ((one - x * x).ramp() + T::constant(1e-7)).sqrt();
    acute + negative * (T::constant(PI) / sine - acute - acute)
}

/// Least-squares fit of `acos(x) / sqrt(1 - x^2)` on 0..1 by `(a + b x + c x^2) / (1 + d x + e x^2)`.
/// Largest relative error 1.7e-6.
const ANGLE_FIT: [f32; 5] = [1.570_793_7, 0.896_605_2, 0.025_226_796, 1.207_353_2, 0.285_271_6];
