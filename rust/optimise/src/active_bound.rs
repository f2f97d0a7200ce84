//! Bounds on strength, colour and direction. Those of places and sizes are approached and never met (`variable`); these are hard, and a step
//! that leads through one ends there: a light may start at one, and inactive ones change nothing.

use crate::problem::Problem;
use crate::variable::{Bounds, LUMINANCE, Locks, Mapping, PARAMS, Variable, luminance, power};
use glam::Vec3;
use relume_scene::{LANES, Light, LightShape, lane};
use serde::{Deserialize, Serialize};
use std::f32::consts::{LN_2, PI};

/// Distance, in the units of a bound, below which a light stands at it.
const NEAR: f32 = 1e-5;

/// Channels of a colour are taken as this share of its strongest where they are less, so that their ratios are finite.
const LEAST_CHANNEL: f32 = 1e-4;

/// All directions within an angle of one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DirectionCone {
    /// Their middle, of unit length.
    pub axis: Vec3,
    /// Radians, up to pi.
    pub angle: f32,
}

impl DirectionCone {
    pub(crate) fn is_sound(&self) -> bool {
        self.axis.is_normalized() && (0.0..=PI).contains(&self.angle)
    }

    /// Warps a uniformly random orientation into one whose axis is uniformly random in the cone.
    pub(crate) fn warped(&self, shape: &LightShape) -> LightShape {
        shape.axis().map_or(*shape, |axis| {
            let sine = (0.5 * self.angle_to(axis)).sin() * (0.5 * self.angle).sin();
            self.turned(shape, axis, 2.0 * sine.asin())
        })
    }

    fn within(&self, shape: &LightShape) -> LightShape {
        let is_out = |axis: &Vec3| self.angle_to(*axis) > self.angle;
        shape.axis().filter(is_out).map_or(*shape, |axis| self.turned(shape, axis, self.angle))
    }

    /// A shape, whose axis is given, turned until that is at an angle from the middle.
    fn turned(&self, shape: &LightShape, axis: Vec3, angle: f32) -> LightShape {
        let mut step = [0.0; LANES];
        step[lane::TURN].copy_from_slice(&(self.outward(axis) * (angle - self.angle_to(axis))).to_array());
        shape.moved(&step)
    }

    /// Rotation vector, of unit length, that takes an axis further from the middle.
    fn outward(&self, axis: Vec3) -> Vec3 {
        self.axis.cross(axis).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector())
    }

    fn angle_to(&self, axis: Vec3) -> f32 {
        self.axis.cross(axis).length().atan2(self.axis.dot(axis))
    }
}

/// All colours within some stops of one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChromaticityBound {
    /// Their middle: RGB of any brightness, each above 0.
    pub color: [f32; 3],
    /// Stops by which the ratio of two channels may at most differ from what it is there.
    pub stops: f32,
}

impl ChromaticityBound {
    /// Colours within some stops of that of a power; of white where it is black.
    fn around(power: [f32; 3], stops: f32) -> Self {
        Self { color: if luminance(power) > 0.0 { with_all_channels(power) } else { [1.0; 3] }, stops }
    }

    pub(crate) fn is_sound(&self) -> bool {
        self.color.iter().all(|channel| channel.is_finite() && *channel > 0.0)
            && self.stops.is_finite()
            && self.stops >= 0.0
    }

    /// Most that the logarithm of a ratio of channels may differ.
    fn log_range(&self) -> f32 {
        LN_2 * self.stops
    }

    /// Logarithm of each channel over the middle's.
    fn log_ratios(&self, power: [f32; 3]) -> [f32; 3] {
        let power = with_all_channels(power);
        std::array::from_fn(|c| (power[c] / self.color[c]).ln())
    }

    /// A power of the same luminance and the nearest of these colours.
    fn within(&self, power: [f32; 3]) -> [f32; 3] {
        let log_ratios = self.log_ratios(power);
        let [low, high] = [
            log_ratios.into_iter().fold(f32::MAX, f32::min),
            log_ratios.into_iter().fold(f32::MIN, f32::max),
        ];
        if luminance(power) <= 0.0 || high - low <= self.log_range() {
            return power;
        }
        let (middle, half) = (0.5 * (low + high), 0.5 * self.log_range());
        let held: [f32; 3] =
            std::array::from_fn(|c| self.color[c] * log_ratios[c].clamp(middle - half, middle + half).exp());
        held.map(|channel| channel * luminance(power) / luminance(held))
    }
}

fn with_all_channels(power: [f32; 3]) -> [f32; 3] {
    let least = LEAST_CHANNEL * power.into_iter().fold(f32::MIN_POSITIVE, f32::max);
    power.map(|channel| channel.max(least))
}

impl Bounds {
    /// Bounds that also hold a light's colour within some stops of what it is.
    pub fn tinted(self, light: &Light, stops: Option<f32>) -> Self {
        Self { color: stops.map(|stops| ChromaticityBound::around(power(light), stops)), ..self }
    }

    /// Bounds that also hold a light's strength within some stops of what it is, and its direction within an angle, radians.
    pub fn around(self, light: &Light, stops: Option<[f32; 2]>, angle: Option<f32>) -> Self {
        let strength = stops.map(|stops| stops.map(|stops| stops.exp2() * luminance(power(light))));
        let cone = |angle: f32| Some(DirectionCone { axis: light.shape.axis()?, angle: angle.min(PI) });
        Self { strength, direction: angle.and_then(cone), ..self }
    }

    /// A light as coloured, strong and directed as these bounds allow, what is locked as it is.
    fn within(&self, locks: &Locks, mut light: Light) -> Light {
        if let (Some(cone), false) = (self.direction, locks.direction) {
            light = light.reshaped(cone.within(&light.shape), light.radiance);
        }
        if let (Some(chromaticity), false) = (self.color, locks.color) {
            let power = power(&light);
            let held = chromaticity.within(power);
            if held != power {
                light.radiance = held.map(|power| power / light.shape.extent());
            }
        }
        if let (Some([low, high]), false) = (self.strength, locks.strength) {
            let strength = luminance(power(&light));
            let held = strength.clamp(low, high);
            if strength <= 0.0 {
                light.radiance = [held / light.shape.extent(); 3];
            } else if held != strength {
                light.radiance = light.radiance.map(|radiance| radiance * (held / strength));
            }
        }
        light
    }
}

impl Variable {
    pub(crate) fn within(&self, light: Light) -> Light {
        self.bounds.within(&self.locks, light)
    }
}

impl Problem<'_> {
    pub(crate) fn within(&self, lights: &[Light]) -> Vec<Light> {
        self.variables.iter().zip(lights).map(|(variable, light)| variable.within(light.clone())).collect()
    }
}

/// A bound by a light's unconstrained values, to first order.
pub(crate) struct ActiveBound {
    /// The product of a step with this is how much nearer the light comes, radians or natural logarithm of a strength or of a ratio of
    /// channels.
    pub(crate) normal: [f32; PARAMS],
    /// Step by which what is beyond the bound is brought back, for each of those units.
    outward: [f32; PARAMS],
    /// Distance of the bound.
    pub(crate) distance: f32,
}

impl ActiveBound {
    /// Distance that a step leads beyond the bound, in the length of steps; below 0 where it does not.
    pub(crate) fn overshoot(&self, step: &[f64]) -> f64 {
        let nearer: f64 = self.normal.iter().zip(step).map(|(n, s)| f64::from(*n) * s).sum();
        let length = self.normal.iter().map(|n| f64::from(*n).powi(2)).sum::<f64>().sqrt();
        if length > 0.0 { (nearer - f64::from(self.distance)) / length } else { f64::NEG_INFINITY }
    }

    /// Takes from a gradient, against which the light goes, what leads through the bound if it stands there.
    pub(crate) fn project(&self, gradient: &mut [f32; PARAMS]) {
        let pull: f32 = gradient.iter().zip(&self.outward).map(|(g, outward)| g * outward).sum();
        if pull < 0.0 && self.distance < NEAR {
            gradient.iter_mut().zip(&self.normal).for_each(|(slope, normal)| *slope -= pull * normal);
        }
    }
}

impl Mapping {
    /// The light after a step of the unconstrained values from where it is, within its bounds.
    pub(crate) fn step(&self, light: &Light, delta: &[f32; PARAMS]) -> Light {
        self.bounds.within(&self.locks, self.free_step(light, delta))
    }

    /// Bounds around a light.
    pub(crate) fn active_bounds(&self, light: &Light) -> impl Iterator<Item = ActiveBound> + use<> {
        self.direction_bound(light)
            .into_iter()
            .chain(self.strength_bounds(light))
            .chain(self.color_bounds(light))
    }

    fn direction_bound(&self, light: &Light) -> Option<ActiveBound> {
        let cone = self.bounds.direction.filter(|_| !self.locks.direction)?;
        let axis = light.shape.axis()?;
        let mut outward = [0.0; PARAMS];
        outward[lane::TURN].copy_from_slice(&cone.outward(axis).to_array());
        Some(ActiveBound { normal: outward, outward, distance: cone.angle - cone.angle_to(axis) })
    }

    fn strength_bounds(&self, light: &Light) -> Vec<ActiveBound> {
        let strength = luminance(power(light));
        let Some(ends) = self.bounds.strength.filter(|_| !self.locks.strength && strength > 0.0) else {
            return Vec::new();
        };
        let bound = |(end, sign): (f32, f32)| {
            let [mut normal, mut outward] = [[0.0; PARAMS]; 2];
            let d_power = LUMINANCE.map(|weight| sign * weight / strength);
            normal[LANES..].copy_from_slice(&self.power_gradient(light, d_power));
            outward[LANES..].copy_from_slice(&self.brightening(light).map(|step| sign * step));
            ActiveBound { normal, outward, distance: sign * (end / strength).ln() }
        };
        ends.into_iter().zip([-1.0, 1.0]).map(bound).collect()
    }

    /// One for each ratio of two channels, either way.
    fn color_bounds(&self, light: &Light) -> Vec<ActiveBound> {
        let strength = luminance(power(light));
        let Some(chromaticity) = self.bounds.color.filter(|_| !self.locks.color && strength > 0.0) else {
            return Vec::new();
        };
        let (log_ratios, power) = (chromaticity.log_ratios(power(light)), with_all_channels(power(light)));
        let bound = |(i, j): (usize, usize)| {
            let mut rates = [0.0; 3];
            (rates[i], rates[j]) = (0.5, -0.5);
            let brighter = (0..3).map(|c| rates[c] * LUMINANCE[c] * power[c]).sum::<f32>() / luminance(power);
            let d_power = std::array::from_fn(|c| 2.0 * rates[c] / power[c]);
            let [mut normal, mut outward] = [[0.0; PARAMS]; 2];
            normal[LANES..].copy_from_slice(&self.power_gradient(light, d_power));
            outward[LANES..].copy_from_slice(&self.growth(light, rates.map(|rate| rate - brighter)));
            ActiveBound {
                normal,
                outward,
                distance: chromaticity.log_range() - (log_ratios[i] - log_ratios[j]),
            }
        };
        (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).filter(|(i, j)| i != j).map(bound).collect()
    }
}

#[cfg(test)]
mod tests;
