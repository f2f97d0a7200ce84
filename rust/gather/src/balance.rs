//! Balance between the two estimators of a light: crossings of segments, and points on it that vertices are connected to.
//!
//! Both see the same light from the same vertices, so that each vertex may count a share of it by either (multiple importance
//! sampling, Veach and Guibas 1995, with the power heuristic). A share depends on nothing but the place of the vertex, which both
//! know. Crossings of `crossed` paths have a variance of `p / crossed` where a segment crosses the light with probability `p`, and
//! connections of `connected` ones at most `p^2 / connected`. So crossings are better where `p` is above `connected / crossed`:
//! close to large lights.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use relume_dump::{Flags, Lobe};

use crate::light::{Plane, PreparedLight, Profile};

/// Density of the directions in which light is scattered by a lobe of [`Lobe::CONNECTED`], per steradian: the mean of diffuse ones;
/// of rough gloss that about the mirrored direction; of media that of even scattering. Refraction is far narrower about the bent
/// direction, and most of its paths look for lights: crossings find more there.
fn density(lobe: Lobe) -> f32 {
    match lobe {
        Lobe::RoughGlossy => 2.0,
        Lobe::RoughTransmission => 200.0,
        Lobe::Volume => 0.25 * FRAC_1_PI,
        _ => 0.5 * FRAC_1_PI,
    }
}

/// Numbers of paths per pixel by which lights are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Balance {
    /// Paths whose vertices are connected to lights.
    pub connected: u32,
    /// Paths whose segments may cross them.
    pub crossed: u32,
}

/// Shares of a light that count by crossings: all of it, unless it is connected. By code of the lobe what a squared distance in metres
/// is multiplied by; 0 where all of the light counts by crossings.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CrossedShares(pub [f32; 8]);

impl CrossedShares {
    /// Shares of a light, whose true area is `area_scale` of that of its profile.
    pub fn new(balance: Balance, profile: &Profile, area_scale: f32) -> Self {
        let odds = balance.connected as f32 / balance.crossed.max(1) as f32;
        let mut shares = Self::default();
        for lobe in Lobe::CONNECTED {
            shares.0[lobe as usize] = odds / (density(lobe) * area(profile) * area_scale);
        }
        shares
    }

    /// Share for what leaves a place by a lobe.
    pub fn at(&self, lobe: Lobe, profile: &Profile, place: Vec3) -> f32 {
        let scale = self.0[lobe as usize];
        if scale == 0.0 {
            return 1.0;
        }
        let ratio = scale * distance2(profile, place);
        1.0 / (1.0 + ratio * ratio)
    }
}

impl PreparedLight {
    /// The light as one that is connected, too.
    pub(crate) fn balanced(self, balance: Balance) -> Self {
        Self { crossed: CrossedShares::new(balance, &self.profile, self.area_scale), ..self }
    }

    /// Share of what a segment from `origin` sees that counts by crossings.
    pub(crate) fn crossed_share(&self, flags: Flags, origin: Vec3) -> f32 {
        flags.lobe().map_or(0.0, |lobe| self.crossed.at(lobe, &self.profile, origin))
    }
}

/// Area of a light as it is seen from the front, square metres; solid angle of a sun; of no meaning for a sheared area.
fn area(profile: &Profile) -> f32 {
    match profile {
        Profile::Sphere(ball)
        | Profile::FacingDisk(ball)
        | Profile::Spot { ball, .. }
        | Profile::StretchedSpot { ball, .. } => PI * ball.radius * ball.radius,
        Profile::Area { plane, .. } => {
            let share = if plane.is_ellipse { 0.25 * PI } else { 1.0 };
            share / (plane.inverse_u.length() * plane.inverse_v.length())
        }
        Profile::Sun { chord2, .. } => PI * chord2,
        Profile::Sheared(_) => 1.0,
    }
}

/// Squared distance of a place from a light: from the centre of a ball, from the next point of an area, but of one with a spread at
/// least that from which all of it shines to the place; 1 for a sun, 0 for a sheared area, all of whose light counts by crossings.
fn distance2(profile: &Profile, place: Vec3) -> f32 {
    match profile {
        Profile::Sphere(ball)
        | Profile::FacingDisk(ball)
        | Profile::Spot { ball, .. }
        | Profile::StretchedSpot { ball, .. } => ball.center.distance_squared(place),
        Profile::Area { plane, spread } => {
            let least = spread.map_or(0.0, |spread| area(profile) / (PI * spread.tan_half * spread.tan_half));
            nearest(plane, place).distance_squared(place).max(least)
        }
        Profile::Sun { .. } => 1.0,
        Profile::Sheared(_) => 0.0,
    }
}

/// Point of the rectangle of an area that is next to a place.
fn nearest(plane: &Plane, place: Vec3) -> Vec3 {
    let from_center = place - plane.center;
    [plane.inverse_u, plane.inverse_v]
        .into_iter()
        .map(|inverse| inverse / inverse.length_squared() * from_center.dot(inverse).clamp(-0.5, 0.5))
        .fold(plane.center, |point, along| point + along)
}
