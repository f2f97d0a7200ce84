use std::collections::HashMap;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_dump::RECEIVER_LIMIT;
use relume_gpu::{Buffer, Gpu, GpuError};

use crate::PreparedLight;
use crate::kernel::ROUNDING;
use crate::light::Profile;

const SPHERE: u32 = 0;
const FACING_DISK: u32 = 1;
const SPOT: u32 = 2;
const SOFT_SPOT: u32 = 3;
const QUAD: u32 = 4;
const ELLIPSE: u32 = 5;
const SUN: u32 = 6;

/// Bits of a receiver set in the words of the device.
pub type Receivers = [u32; RECEIVER_LIMIT as usize / 32];

/// A light as the kernels take it: `Light` of `shaders/gather/light.wgsl`, where the fields are described.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "described in the WGSL twin")]
pub struct GpuLight {
    pub center: [f32; 3],
    pub kind: u32,
    pub direction: [f32; 3],
    pub radius: f32,
    pub inverse_u: [f32; 3],
    pub reach2: f32,
    pub inverse_v: [f32; 3],
    pub receivers: u32,
    pub factors: [f32; 8],
    pub cos_half_angle: f32,
    pub inverse_blend: f32,
    pub tan_half: f32,
    pub normalisation: f32,
}

impl GpuLight {
    /// `magnitude` is the largest coordinate in the scene, `receivers` the number of the light's set.
    pub(super) fn new(light: &PreparedLight, magnitude: f32, receivers: u32) -> Self {
        let shared = Self { receivers, factors: light.factors, ..Self::default() };
        match light.profile {
            Profile::Sphere(ball) => shared.with_ball(SPHERE, ball.center, ball.radius, magnitude),
            Profile::FacingDisk(ball) => shared.with_ball(FACING_DISK, ball.center, ball.radius, magnitude),
            Profile::Spot { ball, axis, cos_half_angle, inverse_blend, soft_falloff } => {
                let kind = if soft_falloff { SOFT_SPOT } else { SPOT };
                let spot = Self { direction: axis.into(), cos_half_angle, inverse_blend, ..shared };
                spot.with_ball(kind, ball.center, ball.radius, magnitude)
            }
            Profile::Area { plane, spread } => Self {
                kind: if plane.is_ellipse { ELLIPSE } else { QUAD },
                center: plane.center.into(),
                direction: plane.normal.into(),
                inverse_u: plane.inverse_u.into(),
                inverse_v: plane.inverse_v.into(),
                tan_half: spread.map_or(0.0, |spread| spread.tan_half),
                normalisation: spread.map_or(0.0, |spread| spread.normalisation),
                ..shared
            },
            Profile::Sun { direction, chord2 } => {
                Self { kind: SUN, direction: direction.into(), reach2: chord2, ..shared }
            }
        }
    }

    pub(super) fn is_sun(&self) -> bool {
        self.kind == SUN
    }

    /// Half of the size of a box around what the light reaches.
    pub(super) fn half_extent(&self) -> Vec3 {
        if self.kind <= SOFT_SPOT {
            return Vec3::splat(self.reach2.sqrt());
        }
        let half_edge = |inverse: Vec3| 0.5 * inverse.abs() / inverse.length_squared();
        half_edge(self.inverse_u.into()) + half_edge(self.inverse_v.into())
    }

    fn with_ball(self, kind: u32, center: Vec3, radius: f32, magnitude: f32) -> Self {
        let slack = ROUNDING * magnitude.max(center.abs().max_element());
        let reach2 = (radius * 1.000_01 + slack).powi(2);
        Self { kind, center: center.into(), radius, reach2, ..self }
    }
}

/// Lights on the GPU, with the sets of objects that they are linked to.
#[derive(Debug)]
pub struct GpuLights {
    /// One per light. Kernels may write others, with numbers of the sets that there are.
    pub lights: Buffer<GpuLight>,
    /// Set 0 holds all receivers.
    pub receivers: Buffer<Receivers>,
}

impl GpuLights {
    pub(super) fn new(gpu: &Gpu, lights: &[PreparedLight], magnitude: f32) -> Result<Self, GpuError> {
        let mut sets = vec![[u32::MAX; RECEIVER_LIMIT as usize / 32]];
        let mut numbers = HashMap::new();
        let mut number = |bits: &[u64; RECEIVER_LIMIT as usize / 64]| {
            *numbers.entry(*bits).or_insert_with(|| {
                sets.push(std::array::from_fn(|word| (bits[word / 2] >> (word % 2 * 32)) as u32));
                sets.len() as u32 - 1
            })
        };
        let lights: Vec<_> = lights
            .iter()
            .map(|light| {
                let receivers = light.receivers.as_deref().map_or(0, &mut number);
                GpuLight::new(light, magnitude, receivers)
            })
            .collect();
        Ok(Self {
            lights: gpu.buffer_of("lights", &lights)?,
            receivers: gpu.buffer_of("light linking", &sets)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_has_the_layout_of_its_wgsl_twin() {
        relume_gpu::assert_mirror!(GpuLight as "gather/light", "Light", {
            center, kind, direction, radius, inverse_u, reach2, inverse_v, receivers, factors, cos_half_angle,
            inverse_blend, tan_half, normalisation,
        });
    }

    #[test]
    fn kinds_and_receiver_sets_are_those_of_the_wgsl() {
        let constant = |name| relume_gpu::layout::constant("gather/light", name).unwrap();
        let kinds = ["SPHERE", "FACING_DISK", "SPOT", "SOFT_SPOT", "QUAD", "ELLIPSE", "SUN"];
        assert_eq!(kinds.map(constant), [SPHERE, FACING_DISK, SPOT, SOFT_SPOT, QUAD, ELLIPSE, SUN]);
        assert_eq!(constant("RECEIVER_WORDS") as usize, size_of::<Receivers>() / size_of::<u32>());
    }
}
