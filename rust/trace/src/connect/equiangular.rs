//! Equiangular sampling of a flight through media (Kulla and Fajardo 2012, "Importance Sampling Techniques for Path Tracing
//! in Participating Media"): as dense as a small light's irradiance, which distances to a collision know nothing of.

use glam::Vec3;

/// Middle of a light, and about how far it reaches around that, metres.
#[derive(Clone, Copy, Debug)]
pub struct LightCenter {
    /// World space.
    pub position: Vec3,
    /// Nearer than this its irradiance does not grow any more.
    pub radius: f32,
}

/// Distribution of distances along a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equiangular {
    /// Distance at which the flight is next to the light's middle.
    nearest: f32,
    /// Distance from there to the middle.
    height: f32,
    /// Angles of both ends as seen from the middle.
    ends: [f32; 2],
}

impl Equiangular {
    /// Distances of up to `length`, which may be infinite, from `start` in the unit `direction`.
    pub fn new(start: Vec3, direction: Vec3, length: f32, center: LightCenter) -> Self {
        let to_center = center.position - start;
        let nearest = to_center.dot(direction);
        let height = (to_center - nearest * direction).length().max(center.radius).max(1e-6);
        let angle = |distance: f32| ((distance - nearest) / height).atan();
        Self { nearest, height, ends: [angle(0.0), angle(length)] }
    }

    /// A distance by a number in 0..1.
    pub fn sample(&self, u: f32) -> f32 {
        let [from, to] = self.ends;
        self.nearest + self.height * (from + u * (to - from)).tan()
    }

    /// Density of a distance, per metre.
    pub fn density(&self, distance: f32) -> f32 {
        let [from, to] = self.ends;
        let along = distance - self.nearest;
        self.height / ((to - from) * (self.height * self.height + along * along))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_have_the_density_that_is_told() {
        for (length, radius) in [(3.0, 0.02), (f32::INFINITY, 0.02), (3.0, 1.5)] {
            let center = LightCenter { position: Vec3::new(1.2, 0.3, -0.1), radius };
            let angles = Equiangular::new(Vec3::ZERO, Vec3::X, length, center);
            for (from, to) in [(0.0, 0.5), (1.0, 1.1), (1.3, 3.0)] {
                let share = |from: f32, to: f32| {
                    let steps = 4000;
                    let width = (to - from) / steps as f32;
                    (0..steps).map(|i| angles.density(from + (i as f32 + 0.5) * width) * width).sum::<f32>()
                };
                let count = 20_000;
                let is_within =
                    |i: &i32| (from..to).contains(&angles.sample((*i as f32 + 0.5) / count as f32));
                let found = (0..count).filter(is_within).count() as f32 / count as f32;
                assert!((found - share(from, to)).abs() < 1e-3, "{found} of {from} to {to}");
            }
        }
    }
}
