//! Gabor noise: Lagae et al., "Procedural Noise using Sparse Gabor Convolution" (2009), with the impulses of Tavernier et al.,
//! "Making Gabor Noise Fast and Normalized" (2019), and phase and intensity of Tricard et al., "Procedural Phasor Noise" (2019).

use std::f32::consts::{PI, SQRT_2, TAU};

use glam::{Vec2, Vec3, Vec4};

use super::hash::random;

/// Impulses of a cell.
const IMPULSES: u8 = 8;
/// Mean square of an impulse's weight.
const SECOND_MOMENT: f32 = 0.5;

/// Waves of a Gabor texture.
#[derive(Clone, Copy, Debug)]
pub struct Waves {
    /// Waves per cell.
    pub frequency: f32,
    /// Share of the random part of their direction.
    pub isotropy: f32,
}

/// Value, phase and intensity of waves in the plane, mostly along an angle.
pub fn plane(at: Vec2, waves: &Waves, angle: f32) -> Vec4 {
    let cell = at.floor();
    let mut sum = Vec2::ZERO;
    for (x, y) in neighbours().flat_map(|y| neighbours().map(move |x| (x, y))) {
        let corner = cell + Vec2::new(x, y);
        for impulse in 0..IMPULSES {
            let key = |number: u8| [corner.x, corner.y, f32::from(3 * impulse + number)];
            let [a, b, c] = key(1);
            let center = Vec2::new(random([a, b, c]), random([c, a, b]));
            let from_center = at - cell - Vec2::new(x, y) - center;
            if from_center.length_squared() >= 1.0 {
                continue;
            }
            let angle = angle + (random(key(0)) - 0.5) * PI * waves.isotropy;
            let phase = TAU * waves.frequency * from_center.dot(Vec2::from_angle(angle));
            sum += sign(random(key(2))) * kernel(from_center.length_squared(), phase);
        }
    }
    outputs(sum, 0.25)
}

/// Value, phase and intensity of waves in space, mostly along the unit `direction`.
pub fn space(at: Vec3, waves: &Waves, direction: Vec3) -> Vec4 {
    let cell = at.floor();
    let mut sum = Vec2::ZERO;
    let rows = neighbours().flat_map(|z| neighbours().map(move |y| (y, z)));
    for (x, y, z) in rows.flat_map(|(y, z)| neighbours().map(move |x| (x, y, z))) {
        let corner = cell + Vec3::new(x, y, z);
        for impulse in 0..IMPULSES {
            let key = |number: u8| [corner.x, corner.y, corner.z, f32::from(3 * impulse + number)];
            let [a, b, c, d] = key(1);
            let center = Vec3::new(random([a, b, c, d]), random([c, a, d, b]), random([d, c, b, a]));
            let from_center = at - cell - Vec3::new(x, y, z) - center;
            if from_center.length_squared() >= 1.0 {
                continue;
            }
            let direction = turned(direction, waves.isotropy, key(0));
            let phase = TAU * waves.frequency * from_center.dot(direction);
            sum += sign(random(key(2))) * kernel(from_center.length_squared(), phase);
        }
    }
    outputs(sum, 0.25 / SQRT_2)
}

fn neighbours() -> impl Iterator<Item = f32> + Clone {
    [-1.0, 0.0, 1.0].into_iter()
}

/// A wave of unit length within a window, as cosine and sine parts.
fn kernel(distance_squared: f32, phase: f32) -> Vec2 {
    let window = 0.5 + 0.5 * (PI * distance_squared).cos();
    Vec2::from_angle(phase) * ((-PI * distance_squared).exp() * window)
}

fn sign(random: f32) -> f32 {
    if random < 0.5 { -1.0 } else { 1.0 }
}

/// A direction whose two angles are a little random.
fn turned(direction: Vec3, isotropy: f32, [a, b, c, d]: [f32; 4]) -> Vec3 {
    if isotropy == 0.0 {
        return direction;
    }
    let side = if direction.y < 0.0 { -1.0 } else { 1.0 };
    let inclination = direction.z.acos() + random([a, b, c, d]) * PI * isotropy;
    let azimuth =
        side * (direction.x / direction.truncate().length()).acos() + random([c, a, d, b]) * PI * isotropy;
    let (sin, cos) = inclination.sin_cos();
    (Vec2::from_angle(azimuth) * sin).extend(cos)
}

/// Value in x and w, phase in y and intensity in z; `energy` is the integral of the squared kernel.
fn outputs(sum: Vec2, energy: f32) -> Vec4 {
    let scale = 6.0 * (f32::from(IMPULSES) * SECOND_MOMENT * energy).sqrt();
    let value = sum.y / scale * 0.5 + 0.5;
    Vec4::new(value, (sum.y.atan2(sum.x) + PI) / TAU, sum.length() / scale, value)
}
