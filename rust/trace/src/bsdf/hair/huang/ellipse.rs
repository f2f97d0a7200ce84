use glam::{Vec2, Vec3};

/// Cross-section of a fibre whose major half axis, along x, is 1. Points are told by the angle `gamma` of `(sin gamma,
/// minor cos gamma)`, directions by their azimuth from z on (the paper's figure 5).
#[derive(Clone, Copy, Debug)]
pub(super) struct Ellipse {
    minor: f32,
    /// Half of the width that a ray sees.
    radius: f32,
    /// Angle of the point that a ray to the centre meets.
    center: f32,
}

impl Ellipse {
    /// Ellipse seen from the unit direction `wo`.
    pub fn new(minor: f32, wo: Vec3) -> Self {
        let across = Vec2::new(wo.x, wo.z).normalize_or(Vec2::Y);
        let radius = (across.y * across.y + minor * minor * across.x * across.x).sqrt();
        Self { minor, radius, center: (minor * across.x).atan2(across.y) }
    }

    /// Half of the width that the ray sees.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Angle of the point that a ray meets whose place across the seen width is the sine of `angle`.
    pub fn gamma(&self, angle: f32) -> f32 {
        self.center - angle
    }

    /// Place across the seen width, -1..1, of the point whose normal has the azimuth `phi`.
    pub fn place(&self, phi: f32) -> f32 {
        let (sin, cos) = phi.sin_cos();
        (self.center - sin.atan2(self.minor * cos)).sin()
    }

    /// Length of outline for each radian of `gamma`.
    pub fn arc(&self, gamma: f32) -> f32 {
        (1.0 - (1.0 - self.minor * self.minor) * gamma.sin().powi(2)).sqrt()
    }

    /// Point of the outline.
    fn point(&self, gamma: f32) -> Vec2 {
        let (sin, cos) = gamma.sin_cos();
        Vec2::new(sin, self.minor * cos)
    }

    /// Distance of two points of the outline.
    pub fn chord(&self, from: f32, to: f32) -> f32 {
        self.point(from).distance(self.point(to))
    }

    /// Unit normal at a point, tilted along the fibre.
    pub fn normal(&self, gamma: f32, tilt: f32) -> Vec3 {
        let (sin, cos) = gamma.sin_cos();
        let across = Vec2::new(self.minor * sin, cos).normalize_or(Vec2::Y);
        let (sin_tilt, cos_tilt) = tilt.sin_cos();
        Vec3::new(across.x * cos_tilt, sin_tilt, across.y * cos_tilt)
    }

    /// Angle of the inward normal where a line along `direction` leaves that starts at `gamma`: in the circle that the
    /// ellipse is squeezed from, a chord ends as it begins.
    pub fn opposite(&self, gamma: f32, direction: Vec3) -> f32 {
        2.0 * (self.minor * direction.x).atan2(direction.z) - gamma
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    #[test]
    fn lines_end_on_the_outline_where_they_are_said_to() {
        for minor in [1.0, 0.85, 0.3] {
            let ellipse = Ellipse::new(minor, Vec3::Z);
            for start in [-1.2f32, -0.3, 0.4, 1.0] {
                for azimuth in [PI - 0.4, PI, PI + 0.5] {
                    let direction = Vec3::new(azimuth.sin(), 0.3, azimuth.cos());
                    // The outward normal is half a turn from the inward one.
                    let end = ellipse.opposite(start, direction) + PI;
                    let way = ellipse.point(end) - ellipse.point(start);
                    let along = Vec2::new(direction.x, direction.z).normalize();
                    assert!(way.perp_dot(along).abs() < 1e-5, "{minor} {start} {azimuth}");
                    assert!((way.length() - ellipse.chord(start, end)).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn rays_meet_the_outline_at_their_place_across_the_width() {
        for minor in [1.0, 0.6] {
            for azimuth in [0.0f32, 0.7, 2.0] {
                let wo = Vec3::new(azimuth.sin(), 0.0, azimuth.cos());
                let ellipse = Ellipse::new(minor, wo);
                for place in [-0.9f32, 0.0, 0.5] {
                    let point = ellipse.point(ellipse.gamma(place.asin()));
                    // Across is the direction to the right of the ray as it is seen from the tip.
                    let across = point.perp_dot(Vec2::new(wo.x, wo.z));
                    assert!((across - -place * ellipse.radius()).abs() < 1e-5, "{minor} {azimuth} {place}");
                }
            }
        }
    }
}
