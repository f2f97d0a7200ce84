use crate::active_bound::{ChromaticityBound, DirectionCone};
use glam::Vec3;
use relume_scene::{LANES, Light, LightShape, lane};
use serde::{Deserialize, Serialize};
use std::f32::consts::FRAC_PI_2;
use std::ops::Range;

/// Lanes of a light: those of its shape, then its power in each channel.
pub(crate) const PARAMS: usize = LANES + 3;
/// Rec.709 weights of luminance.
pub(crate) const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Parameters of a light that stay as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Locks {
    /// The centre.
    pub position: bool,
    /// Direction that it points to.
    pub direction: bool,
    /// Radius, width and height, or a sun's angle. The power stays whatever the size.
    pub size: bool,
    /// Angle and blend of a spot.
    pub cone: bool,
    /// The hue and saturation of its power.
    pub color: bool,
    /// The luminance of its power.
    pub strength: bool,
    /// Ratio of width to height of an area light, whatever its size: Blender's squares and disks have one size.
    pub proportion: bool,
}

impl Locks {
    /// Everything stays.
    pub const ALL: Self = Self {
        position: true,
        direction: true,
        size: true,
        cone: true,
        color: true,
        strength: true,
        proportion: true,
    };

    /// True if the shape stays, so that one picture of the light serves throughout.
    pub fn hold_shape(&self, shape: &LightShape) -> bool {
        (0..LANES).all(|number| self.holds(number) || !shape.has_lane(number))
    }

    /// True if nothing may move.
    pub fn hold_all(&self, shape: &LightShape) -> bool {
        self.hold_shape(shape) && self.color && self.strength
    }

    fn holds(&self, number: usize) -> bool {
        match number {
            0..3 => self.position,
            3..6 => self.direction,
            6..8 => self.size,
            _ => self.cone,
        }
    }

    /// The lane whose step a lane takes: that of the other side where both keep their proportion.
    pub(crate) fn lead(&self, number: usize) -> usize {
        if self.proportion && lane::SIZE.contains(&number) { lane::SIZE.start } else { number }
    }
}

/// Half angles of suns and spots end here: just above those of a half space, which Blender's lights may have.
const WIDEST: f32 = FRAC_PI_2 + 1e-3;

/// Bounds of the parameters of lights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lower corner of the box of centres, metres.
    pub center_min: Vec3,
    /// Upper corner.
    pub center_max: Vec3,
    /// Smallest and largest radius, or edge of an area light, metres, above 0.
    pub size: [f32; 2],
    /// Smallest and largest half angle of a sun, radians, above 0.
    pub sun: [f32; 2],
    /// Smallest and largest half angle of a spot's cone, radians.
    pub cone: [f32; 2],
    /// Least and most strength: luminance of radiance times extent, up to a constant Blender's; none for any. Solving ends at these
    /// two at once, not near them.
    pub strength: Option<[f32; 2]>,
    /// Colours that it may have; none for any. Met as those of strength are.
    pub color: Option<ChromaticityBound>,
    /// Directions that it may point to ([`LightShape::axis`]); none for anywhere.
    pub direction: Option<DirectionCone>,
}

impl Bounds {
    /// Bounds of centres and sizes, with all usual angles.
    pub fn new(center_min: Vec3, center_max: Vec3, size: [f32; 2]) -> Self {
        let (sun, cone) = ([0.0025, 1.0], [0.02, 1.5]);
        Self { center_min, center_max, size, sun, cone, strength: None, color: None, direction: None }
    }

    /// Bounds that hold a light as well.
    pub fn including(mut self, light: &Light) -> Self {
        if let Some(center) = light.shape.center() {
            self.center_min = self.center_min.min(center - 1e-3);
            self.center_max = self.center_max.max(center + 1e-3);
        }
        for number in lane::SIZE.chain([lane::CONE]).filter(|number| light.shape.has_lane(*number)) {
            let value = coordinate(&light.shape, number);
            let (range, most) = match (number, &light.shape) {
                (lane::CONE, _) => (&mut self.cone, WIDEST),
                (_, LightShape::Sun { .. }) => (&mut self.sun, WIDEST),
                _ => (&mut self.size, f32::INFINITY),
            };
            let value = if number == lane::CONE { value } else { value.exp() };
            *range = [range[0].min(0.99 * value), range[1].max((1.01 * value).min(most))];
        }
        self
    }

    /// Fault of the bounds, in words.
    pub(crate) fn fault(&self) -> Option<&'static str> {
        let rises = |[low, high]: [f32; 2]| 0.0 < low && low < high && high.is_finite();
        let is_range = |[low, high]: [f32; 2]| 0.0 <= low && low <= high && high.is_finite();
        let is_box = self.center_min.cmplt(self.center_max).all()
            && self.center_min.is_finite()
            && self.center_max.is_finite();
        match () {
            _ if !is_box => Some("the centre"),
            _ if !rises(self.size) => Some("the size"),
            _ if !(rises(self.sun) && self.sun[1] <= WIDEST) => Some("a sun's angle"),
            _ if !(rises(self.cone) && self.cone[1] <= WIDEST) => Some("a spot's angle"),
            _ if !self.strength.is_none_or(is_range) => Some("the strength"),
            _ if !self.color.is_none_or(|tint| tint.is_sound()) => Some("the colour"),
            _ if !self.direction.is_none_or(|cap| cap.is_sound()) => Some("the direction"),
            _ => None,
        }
    }
}

/// A light to be solved.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Light at the start, to which it is drawn by `prior_weight`.
    pub light: Light,
    /// Parameters that stay as they are.
    pub locks: Locks,
    /// Bounds of its parameters.
    pub bounds: Bounds,
    /// Weight by which it is drawn back to where it starts: the loss of having moved by the size of the box, by a
    /// radian or by a factor e in size or power. 0 for not at all.
    pub prior_weight: f32,
}

/// The map between steps of an unconstrained vector and a light: logistic within bounds for centre, logarithm of size, cone and
/// blend (paper, section 5.3), rotation vectors for directions, softplus for power. A blend may be 0 or 1, where a logistic function
/// of that range would not let it go: its own is wider, and what is beyond is cut off.
///
/// Power (radiance times extent) takes the place of the paper's radiance, so that a change of size alone changes no picture far
/// from the light, and a locked strength is what Blender means by it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mapping {
    pub(crate) bounds: Bounds,
    pub(crate) locks: Locks,
    /// Power that brings this light to the target's brightness. Steps of Adam have one size, whatever the scene's unit of
    /// light; this makes them meaningful.
    pub(crate) power_unit: f32,
}

impl Mapping {
    /// The light after a step of the unconstrained values from where it is, through whatever active bounds are there.
    pub(crate) fn free_step(&self, light: &Light, delta: &[f32; PARAMS]) -> Light {
        let power = self.stepped_power(light, delta);
        let lane_step = |lead: usize| self.lane_step(&light.shape, lead, delta[lead]);
        let shape = light.shape.moved(&std::array::from_fn(|i| lane_step(self.locks.lead(i))));
        let radiance = power.map(|power| power / shape.extent());
        light.reshaped(shape, radiance)
    }

    /// The light with one of its sizes at a share of its range, at the same power.
    pub(crate) fn with_size(&self, light: &Light, number: usize, share: f32) -> Light {
        let to = |range: Range<f32>| range.start + share * (range.end - range.start);
        let step = self
            .range(&light.shape, number)
            .map_or(0.0, |range| to(range) - coordinate(&light.shape, number));
        let shape = light
            .shape
            .moved(&std::array::from_fn(|i| if self.locks.lead(i) == number { step } else { 0.0 }));
        let radiance = power(light).map(|power| power / shape.extent());
        light.reshaped(shape, radiance)
    }

    /// Place of one of the light's sizes in its range, 0..1.
    pub(crate) fn size_share(&self, light: &Light, number: usize) -> f32 {
        let share =
            |range: Range<f32>| (coordinate(&light.shape, number) - range.start) / (range.end - range.start);
        self.range(&light.shape, number).map_or(0.5, share)
    }

    /// Derivative by the unconstrained values from that by the shape's lanes and by the radiance.
    pub(crate) fn pull_back(
        &self,
        light: &Light,
        d_shape: &[f32; LANES],
        d_radiance: [f32; 3],
    ) -> [f32; PARAMS] {
        let mut by_lane = *d_shape;
        // At a given power the radiance falls as the extent grows.
        let fall: f32 = (0..3).map(|c| d_radiance[c] * light.radiance[c]).sum();
        for (slope, i) in light.shape.extent_slopes().into_iter().zip(lane::SIZE) {
            by_lane[i] -= fall * slope;
        }
        let by_lane: [f32; LANES] = std::array::from_fn(|number| {
            let follows = |i: &usize| self.locks.lead(*i) == number;
            (0..LANES).filter(follows).map(|i| by_lane[i]).sum()
        });
        let extent = light.shape.extent();
        let d_power = self.power_gradient(light, d_radiance.map(|d| d / extent));
        std::array::from_fn(|i| match i.checked_sub(LANES) {
            Some(channel) => d_power[channel],
            None => by_lane[i] * self.lane_slope(&light.shape, i),
        })
    }

    /// True if an unconstrained value changes anything.
    pub(crate) fn is_free(&self, shape: &LightShape, number: usize) -> bool {
        match (number, self.locks.color, self.locks.strength) {
            (0..LANES, ..) => {
                shape.has_lane(number) && !self.locks.holds(number) && self.locks.lead(number) == number
            }
            (_, true, true) => false,
            (_, true, false) => number == LANES,
            _ => true,
        }
    }

    fn lane_step(&self, shape: &LightShape, number: usize, delta: f32) -> f32 {
        match self.range(shape, number) {
            _ if !self.is_free(shape, number) || delta == 0.0 => 0.0,
            None => delta,
            Some(range) => {
                let x = coordinate(shape, number);
                let width = range.end - range.start;
                let to = range.start + width * logistic(logit((x - range.start) / width) + delta);
                if number == lane::BLEND { to.clamp(0.0, 1.0) - x } else { to - x }
            }
        }
    }

    fn lane_slope(&self, shape: &LightShape, number: usize) -> f32 {
        match self.range(shape, number) {
            _ if !self.is_free(shape, number) => 0.0,
            None => 1.0,
            Some(range) => {
                let width = range.end - range.start;
                let s = logistic(logit((coordinate(shape, number) - range.start) / width));
                width * s * (1.0 - s)
            }
        }
    }

    /// Range of the [`coordinate`]; turns have none.
    fn range(&self, shape: &LightShape, number: usize) -> Option<Range<f32>> {
        let bounds = &self.bounds;
        let size = if matches!(shape, LightShape::Sun { .. }) { bounds.sun } else { bounds.size };
        match number {
            0..3 => Some(bounds.center_min[number]..bounds.center_max[number]),
            6..8 => Some(size[0].ln()..size[1].ln()),
            lane::CONE => Some(bounds.cone[0]..bounds.cone[1]),
            lane::BLEND => Some(-0.2..1.2),
            _ => None,
        }
    }

    fn stepped_power(&self, light: &Light, delta: &[f32; PARAMS]) -> [f32; 3] {
        let power = power(light);
        let step = |power: f32, delta: f32| {
            self.power_unit * softplus(inverse_softplus(power / self.power_unit) + delta)
        };
        match (self.locks.color, self.locks.strength) {
            (true, true) => power,
            (true, false) => {
                let (color, strongest) = color_and_strength(power);
                let strongest = step(strongest, delta[LANES]);
                color.map(|c| c * strongest)
            }
            (false, true) => {
                let tinted: [f32; 3] = std::array::from_fn(|c| power[c] * delta[LANES + c].exp());
                let factor = luminance(power) / luminance(tinted);
                if factor.is_finite() { tinted.map(|c| c * factor) } else { power }
            }
            (false, false) => std::array::from_fn(|c| step(power[c], delta[LANES + c])),
        }
    }

    pub(crate) fn power_gradient(&self, light: &Light, d_power: [f32; 3]) -> [f32; 3] {
        let power = power(light);
        match (self.locks.color, self.locks.strength) {
            (true, true) => [0.0; 3],
            (true, false) => {
                let (color, strongest) = color_and_strength(power);
                [(0..3).map(|c| d_power[c] * color[c]).sum::<f32>() * self.power_slope(strongest), 0.0, 0.0]
            }
            (false, true) => {
                let total: f32 = (0..3).map(|c| d_power[c] * power[c]).sum();
                let luminance = luminance(power).max(f32::MIN_POSITIVE);
                std::array::from_fn(|c| power[c] * (d_power[c] - total * LUMINANCE[c] / luminance))
            }
            (false, false) => std::array::from_fn(|c| d_power[c] * self.power_slope(power[c])),
        }
    }

    /// Step of the unconstrained values by which all of a power grows at one rate, to first order.
    pub(crate) fn brightening(&self, light: &Light) -> [f32; 3] {
        let strongest = color_and_strength(power(light)).1;
        if self.locks.color {
            [strongest / self.power_slope(strongest), 0.0, 0.0]
        } else {
            self.growth(light, [1.0; 3])
        }
    }

    /// Step of the unconstrained values by which each channel of a power, whose colour is free, grows at a rate, to first order.
    pub(crate) fn growth(&self, light: &Light, rates: [f32; 3]) -> [f32; 3] {
        let power = power(light);
        let step = |c: usize| if self.locks.strength { 1.0 } else { power[c] / self.power_slope(power[c]) };
        std::array::from_fn(|c| rates[c] * step(c))
    }

    fn power_slope(&self, power: f32) -> f32 {
        self.power_unit * logistic(inverse_softplus(power / self.power_unit))
    }
}

/// The value of a lane that has a range: a coordinate of the centre, logarithm of a size, angle or blend of a cone.
pub(crate) fn coordinate(shape: &LightShape, number: usize) -> f32 {
    match (number, shape) {
        (0..3, _) => shape.center().unwrap_or_default()[number],
        (6..8, _) => shape.sizes()[number - lane::SIZE.start].ln(),
        (lane::CONE, LightShape::Spot { half_angle, .. }) => *half_angle,
        (lane::BLEND, LightShape::Spot { blend, .. }) => *blend,
        _ => 0.0,
    }
}

/// Radiance times extent: Blender's power and strength up to a constant.
pub(crate) fn power(light: &Light) -> [f32; 3] {
    light.radiance.map(|radiance| radiance * light.shape.extent())
}

pub(crate) fn luminance(color: [f32; 3]) -> f32 {
    (0..3).map(|c| LUMINANCE[c] * color[c]).sum()
}

/// A colour whose strongest channel is 1, white for black, and that channel.
fn color_and_strength(power: [f32; 3]) -> ([f32; 3], f32) {
    let strongest = power.into_iter().fold(0.0, f32::max);
    if strongest > 0.0 { (power.map(|c| c / strongest), strongest) } else { ([1.0; 3], 0.0) }
}

fn logistic(u: f32) -> f32 {
    1.0 / (1.0 + (-u).exp())
}

/// Values at or beyond the bounds start just inside them, where the logistic function still has a slope.
fn logit(x: f32) -> f32 {
    let x = x.clamp(1e-3, 1.0 - 1e-3);
    (x / (1.0 - x)).ln()
}

fn softplus(u: f32) -> f32 {
    u.max(0.0) + (-u.abs()).exp().ln_1p()
}

/// Black starts as very dark, where softplus still has a slope.
fn inverse_softplus(x: f32) -> f32 {
    let x = x.max(1e-4);
    x + (-(-x).exp_m1()).ln()
}

#[cfg(test)]
#[path = "variable_tests.rs"]
pub(crate) mod tests;
