//! Projections of panoramic cameras, in Blender's camera space (looking down -z). Follows Cycles'
//! `kernel/camera/projection.h`, whose own camera space looks down +x, or +y at a mirror ball.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Vec2, Vec3};

/// Steps of Newton's method for the inverse of a lens polynomial, as many as Cycles takes.
const NEWTON_STEPS: usize = 20;

/// A projection of directions to a film of 0..1 from its lower left corner.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Panorama {
    /// Longitude and latitude.
    Equirectangular {
        /// Left and right edge, radians to the right.
        longitude: [f32; 2],
        /// Lower and upper edge, radians upwards.
        latitude: [f32; 2],
    },
    /// Face of a cube, by equal angles.
    EquiangularCubemapFace,
    /// Reflection in a mirror ball.
    MirrorBall,
    /// Angle in proportion to the distance from the middle.
    FisheyeEquidistant {
        /// Angle of view, radians.
        fov: f32,
    },
    /// Solid angle in proportion to the area.
    FisheyeEquisolid {
        /// Focal length, millimetres.
        lens: f32,
        /// Angle of view, radians.
        fov: f32,
        /// Width and height of the film, millimetres; a Blender camera's follow from its sensor ([`Panorama::on_sensor`]).
        #[serde(default)]
        sensor: [f32; 2],
    },
    /// Negative angle as a polynomial of the distance from the middle in millimetres.
    FisheyeLensPolynomial {
        /// Coefficients of the powers 0 to 4, radians.
        coefficients: [f32; 5],
        /// Angle of view, radians.
        fov: f32,
        /// Width and height of the film, millimetres, as above.
        #[serde(default)]
        sensor: [f32; 2],
    },
    /// A cylinder around the camera, onto which it projects from its centre.
    CentralCylindrical {
        /// Left and right edge, radians to the right.
        longitude: [f32; 2],
        /// Lower and upper edge, in radii.
        height: [f32; 2],
    },
}

impl Panorama {
    /// Unit direction of a point of the film; nothing where the lens shows nothing.
    pub fn direction(&self, film: Vec2) -> Option<Vec3> {
        let centred = film - 0.5;
        let direction = match *self {
            Self::Equirectangular { longitude, latitude } => {
                let (sin_u, cos_u) = (-mix(longitude, film.x)).sin_cos();
                let (sin_v, cos_v) = mix(latitude, film.y).sin_cos();
                Vec3::new(cos_v * cos_u, cos_v * sin_u, sin_v)
            }
            Self::EquiangularCubemapFace => {
                Vec3::new(1.0, -(centred.x * FRAC_PI_2).tan(), (centred.y * FRAC_PI_2).tan())
            }
            Self::MirrorBall => {
                let on_ball = 2.0 * centred;
                let facing = 1.0 - on_ball.length_squared();
                if facing < 0.0 {
                    return None;
                }
                let normal = Vec3::new(on_ball.x, -facing.sqrt(), on_ball.y);
                -2.0 * normal.y * normal + Vec3::Y
            }
            Self::FisheyeEquidistant { fov } => {
                let place = 2.0 * centred;
                let distance = place.length();
                if distance > 1.0 {
                    return None;
                }
                fisheye(distance * fov * 0.5, place)
            }
            Self::FisheyeEquisolid { lens, fov, sensor } => {
                let place = centred * Vec2::from(sensor);
                let distance = place.length();
                if distance > 2.0 * lens * (fov * 0.25).sin() {
                    return None;
                }
                fisheye(2.0 * (distance / (2.0 * lens)).clamp(-1.0, 1.0).asin(), place)
            }
            Self::FisheyeLensPolynomial { coefficients, fov, sensor } => {
                let place = centred * Vec2::from(sensor);
                let angle = -polynomial(coefficients, place.length());
                if angle.abs() > 0.5 * fov {
                    return None;
                }
                fisheye(angle, place)
            }
            Self::CentralCylindrical { longitude, height } => {
                let (sin, cos) = (-mix(longitude, film.x)).sin_cos();
                Vec3::new(cos, sin, mix(height, film.y))
            }
        };
        self.blender_from_cycles(direction).try_normalize()
    }

    /// Point of the film in which a unit direction is seen; outside of it where it is not.
    pub fn film(&self, direction: Vec3) -> Vec2 {
        let d = self.cycles_from_blender(direction);
        // Distance from the middle in proportion to `radius`, at Cycles' angle around it.
        let around = |radius: f32| {
            let side = Vec2::new(d.y, d.z).normalize_or_zero();
            radius * Vec2::new(-side.x, side.y)
        };
        match *self {
            Self::Equirectangular { longitude, latitude } => Vec2::new(
                share(longitude, -d.y.atan2(d.x)),
                share(latitude, FRAC_PI_2 - d.z.clamp(-1.0, 1.0).acos()),
            ),
            Self::EquiangularCubemapFace => 0.5 + Vec2::new(-d.y.atan2(d.x), d.z.atan2(d.x)) * (2.0 / PI),
            Self::MirrorBall => {
                let half = d - Vec3::Y;
                let length = 2.0 * (-0.5 * half.y).max(0.0).sqrt();
                let scaled = if length > 0.0 { half / length } else { half };
                0.5 + 0.5 * Vec2::new(scaled.x, scaled.z)
            }
            Self::FisheyeEquidistant { fov } => 0.5 + around(Vec2::new(d.y, d.z).length().atan2(d.x) / fov),
            Self::FisheyeEquisolid { lens, sensor, .. } => {
                let angle = d.x.clamp(-1.0, 1.0).acos();
                0.5 + around(2.0 * lens * (angle * 0.5).sin()) / Vec2::from(sensor)
            }
            Self::FisheyeLensPolynomial { coefficients, sensor, .. } => {
                let distance = distance_of(coefficients, -d.x.clamp(-1.0, 1.0).acos());
                0.5 + around(distance) / Vec2::from(sensor)
            }
            Self::CentralCylindrical { longitude, height } => Vec2::new(
                share(longitude, -d.y.atan2(d.x)),
                share(height, d.z / Vec2::new(d.x, d.y).length()),
            ),
        }
    }

    /// This panorama on a film of this width and height in millimetres.
    pub fn on_sensor(self, film: Vec2) -> Self {
        match self {
            Self::FisheyeEquisolid { lens, fov, .. } => {
                Self::FisheyeEquisolid { lens, fov, sensor: film.to_array() }
            }
            Self::FisheyeLensPolynomial { coefficients, fov, .. } => {
                Self::FisheyeLensPolynomial { coefficients, fov, sensor: film.to_array() }
            }
            other => other,
        }
    }

    /// A vector of Cycles' camera space.
    pub fn cycles_from_blender(&self, v: Vec3) -> Vec3 {
        match self {
            Self::MirrorBall => Vec3::new(v.x, v.z, v.y),
            _ => Vec3::new(-v.z, -v.x, v.y),
        }
    }

    /// Axes of the aperture for a ray in a unit direction, into which Cycles turns its points.
    pub fn aperture_axes(&self, direction: Vec3) -> [Vec3; 2] {
        let towards = self.cycles_from_blender(direction);
        let u = (Vec3::X - towards.x * towards).normalize_or_zero();
        let v = towards.cross(u).normalize_or_zero();
        [self.blender_from_cycles(u), self.blender_from_cycles(v)]
    }

    fn blender_from_cycles(&self, v: Vec3) -> Vec3 {
        match self {
            Self::MirrorBall => Vec3::new(v.x, v.z, v.y),
            _ => Vec3::new(-v.y, v.z, -v.x),
        }
    }

    /// True if all its numbers are finite, and lens and sensor have a size.
    pub(crate) fn is_sound(&self) -> bool {
        let is_range = |[low, high]: [f32; 2]| low.is_finite() && high.is_finite() && low != high;
        let is_size = |value: f32| value > 0.0 && value.is_finite();
        match *self {
            Self::Equirectangular { longitude, latitude } => is_range(longitude) && is_range(latitude),
            Self::EquiangularCubemapFace | Self::MirrorBall => true,
            Self::FisheyeEquidistant { fov } => is_size(fov),
            Self::FisheyeEquisolid { lens, fov, sensor } => {
                is_size(lens) && is_size(fov) && sensor.into_iter().all(is_size)
            }
            Self::FisheyeLensPolynomial { coefficients, fov, sensor } => {
                is_size(fov)
                    && sensor.into_iter().all(is_size)
                    && coefficients.into_iter().all(f32::is_finite)
            }
            Self::CentralCylindrical { longitude, height } => is_range(longitude) && is_range(height),
        }
    }
}

/// Direction at an angle from the axis, towards a place from the middle.
fn fisheye(angle: f32, place: Vec2) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    let side = place.normalize_or(Vec2::Y);
    Vec3::new(cos, -side.x * sin, side.y * sin)
}

fn mix([low, high]: [f32; 2], share: f32) -> f32 {
    low + (high - low) * share
}

fn share([low, high]: [f32; 2], value: f32) -> f32 {
    (value - low) / (high - low)
}

fn polynomial(coefficients: [f32; 5], x: f32) -> f32 {
    coefficients.into_iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Distance at which a lens polynomial has a value.
fn distance_of(coefficients: [f32; 5], value: f32) -> f32 {
    let [bias, first, second, third, fourth] = coefficients;
    let mut distance = (value - bias) / first;
    for _ in 0..NEWTON_STEPS {
        let slope = polynomial([first, 2.0 * second, 3.0 * third, 4.0 * fourth, 0.0], distance);
        let step = (value - polynomial(coefficients, distance)) / slope;
        distance += step;
        if step.abs() < 1e-6 {
            break;
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSOR: [f32; 2] = [36.0, 24.0];

    fn all() -> [Panorama; 7] {
        [
            Panorama::Equirectangular { longitude: [-2.0, 3.0], latitude: [-1.0, 1.4] },
            Panorama::EquiangularCubemapFace,
            Panorama::MirrorBall,
            Panorama::FisheyeEquidistant { fov: 3.0 },
            Panorama::FisheyeEquisolid { lens: 10.5, fov: 3.0, sensor: SENSOR },
            Panorama::FisheyeLensPolynomial {
                coefficients: [-1e-5, -0.01, 0.0, -2e-5, 1e-7],
                fov: 3.0,
                sensor: SENSOR,
            },
            Panorama::CentralCylindrical { longitude: [-2.0, 1.0], height: [-0.5, 1.0] },
        ]
    }

    #[test]
    fn film_and_direction_are_inverse() {
        for panorama in all() {
            for film in [Vec2::new(0.5, 0.5), Vec2::new(0.4, 0.6), Vec2::new(0.7, 0.45), Vec2::new(0.35, 0.2)]
            {
                let direction = panorama.direction(film).unwrap();
                assert!((direction.length() - 1.0).abs() < 1e-5);
                let found = panorama.film(direction);
                assert!((found - film).length() < 1e-3, "{panorama:?}: {film} {found}");
            }
        }
    }

    #[test]
    fn the_middle_looks_ahead_the_right_to_the_right_and_the_top_up() {
        for panorama in all().into_iter().filter(|panorama| {
            !matches!(panorama, Panorama::Equirectangular { .. } | Panorama::CentralCylindrical { .. })
        }) {
            let at = |x, y| panorama.direction(Vec2::new(x, y)).unwrap();
            assert!((at(0.5, 0.5) - Vec3::NEG_Z).length() < 1e-4, "{panorama:?}");
            assert!(at(0.6, 0.5).x > 0.02 && at(0.5, 0.6).y > 0.02, "{panorama:?}");
        }
        let half = std::f32::consts::FRAC_PI_2;
        let whole = Panorama::Equirectangular { longitude: [-PI, PI], latitude: [-half, half] };
        let at = |x, y| whole.direction(Vec2::new(x, y)).unwrap();
        assert!((at(0.5, 0.5) - Vec3::NEG_Z).length() < 1e-6);
        assert!((at(0.75, 0.5) - Vec3::X).length() < 1e-6);
        assert!((at(0.3, 1.0) - Vec3::Y).length() < 1e-6);
    }

    #[test]
    fn lenses_show_nothing_in_the_corners() {
        let corner = Vec2::new(0.01, 0.99);
        for panorama in &all()[2..5] {
            assert_eq!(panorama.direction(corner), None, "{panorama:?}");
        }
    }

    #[test]
    fn axes_of_the_aperture_are_perpendicular_to_the_ray() {
        for panorama in all() {
            let direction = panorama.direction(Vec2::new(0.4, 0.6)).unwrap();
            let [u, v] = panorama.aperture_axes(direction);
            assert!((u.length() - 1.0).abs() < 1e-5 && (v.length() - 1.0).abs() < 1e-5);
            assert!([u.dot(v), u.dot(direction), v.dot(direction)].iter().all(|dot| dot.abs() < 1e-5));
        }
    }
}
