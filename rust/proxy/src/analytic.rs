//! Closed-form features of a light as seen from a pixel's first hit. They enter the network as inputs, never as
//! factors: fur, volumes and glass have no single position, and the network is free to ignore them.

use std::ops::{Add, Div, Mul, Neg, Sub};

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

/// The parameters of a light, with lengths in units of the scene's scale and positions from its centre.
pub(crate) fn scaled_params(light: &LightParams, center: [f32; 3], scale: f32) -> [f32; MAX_PARAMS] {
    let mut params = [0.0; MAX_PARAMS];
    for (i, (to, from)) in params.iter_mut().zip(light.as_slice()).enumerate() {
        *to = (from - if i < 3 { center[i] } else { 0.0 }) / scale;
    }
    params
}

/// Features of a light, given by [`scaled_params`], at a surface: direction (3), nearness, cosine, mirror cosine and its
/// powers (2), two compressions of the unshadowed irradiance per area of the light, and its apparent size (round
/// lights) or the cosine at the light (quads). All stay finite inside the light.
#[inline(always)]
pub(crate) fn features<T: Real>(
    kind: LightKind,
    light: &[T; MAX_PARAMS],
    at: &PixelSurface<T>,
) -> [T; FEATURES] {
    let one = T::constant(1.0);
    let offset = difference([light[0], light[1], light[2]], at.position);
    let (area, flux, extra) = match kind {
        LightKind::Sphere | LightKind::FacingDisk => round_flux(light, offset),
        LightKind::Quad => quad_flux(light, offset),
    };
    let distance = (dot(offset, offset) + area).sqrt();
    let direction = scaled(offset, one / distance);
    let mirror = dot(at.mirror, direction);
    let lobe = mirror.ramp();
    let lobe4 = lobe * lobe * lobe * lobe;
    let lobe16 = lobe4 * lobe4 * lobe4 * lobe4;
    let irradiance = dot(at.normal, flux).ramp();
    // The constant bounds the slope at the horizon.
    let root = (irradiance + T::constant(1e-3)).sqrt();
    [
        direction[0],
        direction[1],
        direction[2],
        one / (one + T::constant(4.0) * distance),
        dot(at.normal, direction),
        mirror,
        lobe4,
        lobe16,
        irradiance / (one + irradiance),
        root / (one + root),
        extra,
    ]
}

/// Squared radius, vector irradiance per area of a small source, `L / |L|^3`, and the apparent size.
#[inline(always)]
fn round_flux<T: Real>(light: &[T; MAX_PARAMS], offset: Vector<T>) -> (T, Vector<T>, T) {
    let one = T::constant(1.0);
    let area = light[3] * light[3];
    let squared = dot(offset, offset) + area;
    let distance = squared.sqrt();
    (area, scaled(offset, one / (squared * distance)), light[3] / distance)
}

/// Area, vector irradiance per area of a Lambertian rectangle (Lambert's polygon formula; Arvo 1994, "The Irradiance
/// Jacobian for Partially Occluded Polyhedral Sources"), which points away from it behind its back, and the cosine of
/// the way to its centre at the light.
#[inline(always)]
fn quad_flux<T: Real>(light: &[T; MAX_PARAMS], offset: Vector<T>) -> (T, Vector<T>, T) {
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
    (area, scaled(flux, T::constant(-0.5) / area), cosine)
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
    acute + negative * (T::constant(std::f32::consts::PI) / sine - acute - acute)
}

/// Least-squares fit of `acos(x) / sqrt(1 - x^2)` on 0..1 by `(a + b x + c x^2) / (1 + d x + e x^2)`.
/// Largest relative error 1.7e-6.
const ANGLE_FIT: [f32; 5] = [1.570_793_7, 0.896_605_2, 0.025_226_796, 1.207_353_2, 0.285_271_6];
