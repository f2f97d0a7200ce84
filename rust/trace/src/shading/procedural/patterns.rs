//! Textures without cells or octaves of their own: checker, gradient, wave, magic, brick.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{GradientKind, WaveDirection, WaveKind, WaveProfile};

use super::arrays::smooth;
use super::noise::Octaves;

/// Keeps points on whole coordinates, such as the faces of a unit cube, off the borders of a pattern.
fn off_borders(at: Vec3) -> Vec3 {
    (at + 1e-6) * 0.999_999
}

/// True if a Checker Texture shows its first colour.
pub fn checker(at: Vec3) -> bool {
    let cell = off_borders(at).floor();
    let is_odd = |x: f32| x as i32 & 1 == 1;
    is_odd(cell.x) ^ is_odd(cell.y) ^ is_odd(cell.z)
}

/// The Gradient Texture node, in 0..1.
pub fn gradient(kind: GradientKind, at: Vec3) -> f32 {
    let from_center = (0.999_999 - at.length()).max(0.0);
    let value = match kind {
        GradientKind::Linear => at.x,
        GradientKind::Quadratic => at.x.max(0.0).powi(2),
        GradientKind::Easing => smooth(at.x.clamp(0.0, 1.0)),
        GradientKind::Diagonal => (at.x + at.y) * 0.5,
        GradientKind::Radial => at.y.atan2(at.x) / TAU + 0.5,
        GradientKind::Spherical => from_center,
        GradientKind::QuadraticSphere => from_center * from_center,
    };
    value.clamp(0.0, 1.0)
}

/// Distortion of a wave texture by noise.
#[derive(Clone, Copy, Debug)]
pub struct Distortion {
    pub strength: f32,
    pub scale: f32,
    pub octaves: Octaves,
}

/// The Wave Texture node, in 0..1.
pub fn wave(
    (kind, direction, profile): (WaveKind, WaveDirection, WaveProfile),
    at: Vec3,
    phase: f32,
    distortion: &Distortion,
) -> f32 {
    let at = off_borders(at);
    let way = match kind {
        WaveKind::Bands => match direction {
            WaveDirection::X => at.x * 20.0,
            WaveDirection::Y => at.y * 20.0,
            WaveDirection::Z => at.z * 20.0,
            WaveDirection::Diagonal | WaveDirection::Spherical => at.element_sum() * 10.0,
        },
        WaveKind::Rings => {
            let from_axis = match direction {
                WaveDirection::X => at.with_x(0.0),
                WaveDirection::Y => at.with_y(0.0),
                WaveDirection::Z => at.with_z(0.0),
                WaveDirection::Spherical | WaveDirection::Diagonal => at,
            };
            from_axis.length() * 20.0
        }
    };
    let mut angle = way + phase;
    if distortion.strength != 0.0 {
        let noise = distortion.octaves.sum((at * distortion.scale).to_array());
        angle += distortion.strength * (noise * 2.0 - 1.0);
    }
    let turns = angle / TAU;
    match profile {
        WaveProfile::Sin => 0.5 + 0.5 * (angle - FRAC_PI_2).sin(),
        WaveProfile::Saw => turns - turns.floor(),
        WaveProfile::Tri => (turns - (turns + 0.5).floor()).abs() * 2.0,
    }
}

/// The Magic Texture node: sines of sums of sines, `depth` times over. Colour and, in w, its mean.
pub fn magic(at: Vec3, depth: u32, distortion: f32) -> Vec4 {
    // The rest by a whole turn keeps the digits of far points.
    let Vec3 { x: px, y: py, z: pz } = at % TAU;
    let mut x = ((px + py + pz) * 5.0).sin();
    let mut y = ((-px + py - pz) * 5.0).cos();
    let mut z = -((-px - py + pz) * 5.0).cos();
    if depth > 0 {
        (x, y, z) = (x * distortion, y * distortion, z * distortion);
    }
    for step in 1..=depth.min(10) {
        match step {
            1 => y = -(x - y + z).cos() * distortion,
            2 => x = (x - y - z).cos() * distortion,
            3 => z = (-x - y - z).sin() * distortion,
            4 => x = -(-x + y - z).cos() * distortion,
            5 => y = -(-x + y + z).sin() * distortion,
            6 => y = -(-x + y + z).cos() * distortion,
            7 => x = (x + y + z).cos() * distortion,
            8 => z = (x + y - z).sin() * distortion,
            9 => x = -(-x - y + z).cos() * distortion,
            _ => y = -(x - y + z).sin() * distortion,
        }
    }
    let sines = Vec3::new(x, y, z);
    let sines = if distortion == 0.0 { sines } else { sines / (distortion * 2.0) };
    let color = 0.5 - sines;
    color.extend(color.element_sum() / 3.0)
}

/// Layout of bricks.
#[derive(Clone, Copy, Debug)]
pub struct Bricks {
    pub width: f32,
    pub row_height: f32,
    /// Shift of every `offset_frequency`th row in widths of a brick.
    pub offset: f32,
    pub offset_frequency: u32,
    /// Width factor of every `squash_frequency`th row.
    pub squash: f32,
    pub squash_frequency: u32,
    pub mortar_size: f32,
    pub mortar_smooth: f32,
    pub bias: f32,
}

impl Bricks {
    /// Position of a brick's colour between the first and the second one, and coverage by mortar.
    pub fn tint_and_mortar(&self, at: Vec2) -> (f32, f32) {
        let row = (at.y / self.row_height).floor();
        let is_chosen = |frequency: u32| (row as i32).checked_rem(frequency as i32) == Some(0);
        let (mut width, mut shift) = (self.width, 0.0);
        if self.offset_frequency != 0 && self.squash_frequency != 0 {
            width *= if is_chosen(self.squash_frequency) { self.squash } else { 1.0 };
            shift = if is_chosen(self.offset_frequency) { width * self.offset } else { 0.0 };
        }
        let brick = ((at.x + shift) / width).floor();
        let (x, y) = (at.x + shift - width * brick, at.y - self.row_height * row);
        let number = ((row as i32) << 16).wrapping_add(brick as i32 & 0xffff);
        let tint = (brick_noise(number as u32) + self.bias).clamp(0.0, 1.0);
        let from_edge = x.min(y).min(width - x).min(self.row_height - y);
        (tint, self.mortar(from_edge))
    }

    fn mortar(&self, from_edge: f32) -> f32 {
        if from_edge >= self.mortar_size {
            return 0.0;
        }
        if self.mortar_smooth == 0.0 {
            return 1.0;
        }
        let depth = 1.0 - from_edge / self.mortar_size;
        smooth((depth / self.mortar_smooth).clamp(0.0, 1.0))
    }
}

/// The integer noise of libnoise, in 0..1.
fn brick_noise(number: u32) -> f32 {
    let n = number.wrapping_add(1013) & 0x7fff_ffff;
    let n = n >> 13 ^ n;
    let cubic = n.wrapping_mul(n).wrapping_mul(60_493).wrapping_add(19_990_303);
    let scrambled = n.wrapping_mul(cubic).wrapping_add(1_376_312_589) & 0x7fff_ffff;
    0.5 * (scrambled as f32 / 1_073_741_824.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mortar_of_a_negative_smoothness_is_none() {
        let bricks = |mortar_smooth| Bricks {
            width: 1.0,
            row_height: 1.0,
            offset: 0.0,
            offset_frequency: 1,
            squash: 1.0,
            squash_frequency: 1,
            mortar_size: 0.2,
            mortar_smooth,
            bias: 0.0,
        };
        let covered = |smooth| bricks(smooth).tint_and_mortar(Vec2::new(0.1, 0.5)).1;
        assert_eq!([covered(-0.5), covered(0.0), covered(0.5), covered(1.0)], [0.0, 1.0, 1.0, 0.5]);
    }
}
