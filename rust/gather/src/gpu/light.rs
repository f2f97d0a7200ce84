use std::collections::HashMap;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_dump::RECEIVER_LIMIT;
use relume_gpu::{Buffer, Gpu, GpuError};

use crate::PreparedLight;
use crate::emission_map::{PreparedKey, PreparedMap};
use crate::kernel::ROUNDING;
use crate::light::{FAR, Profile};

const SPHERE: u32 = 0;
const FACING_DISK: u32 = 1;
const SPOT: u32 = 2;
const SOFT_SPOT: u32 = 3;
const QUAD: u32 = 4;
const ELLIPSE: u32 = 5;
const SUN: u32 = 6;
const STRETCHED_SPOT: u32 = 7;
const STRETCHED_SOFT_SPOT: u32 = 8;
const SHEARED_QUAD: u32 = 9;
const SHEARED_ELLIPSE: u32 = 10;

const WAY_BACK: u32 = 0;
const NORMAL: u32 = 1;
const PLACE: u32 = 2;

/// Bits of a receiver set in the words of the device.
pub type Receivers = [u32; SET_WORDS];
const SET_WORDS: usize = RECEIVER_LIMIT as usize / 32;

/// A light as the kernels take it: `Light` of `shaders/gather/light.wgsl`, where the fields are described.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "described in the WGSL struct")]
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
    pub row_x: [f32; 3],
    pub length_u: f32,
    pub row_y: [f32; 3],
    pub length_v: f32,
    pub row_z: [f32; 3],
    pub determinant: f32,
    pub center_row_z: [f32; 3],
    pub map_cone: f32,
    pub map_rows: u32,
    pub map_width: u32,
    pub map_height: u32,
    pub map_key: u32,
    pub falloff_power: f32,
    pub falloff_smooth: f32,
    pub crossed: [f32; 8],
    pub padding: [u32; 2],
}

impl GpuLight {
    /// `magnitude` is the largest coordinate in the scene, `receivers` the number of the light's set. The map is left out.
    pub(super) fn new(light: &PreparedLight, magnitude: f32, receivers: u32) -> Self {
        let shared = Self { receivers, factors: light.factors, crossed: light.crossed.0, ..Self::default() };
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
            Profile::StretchedSpot { ball, cone, soft_falloff } => {
                let kind = if soft_falloff { STRETCHED_SOFT_SPOT } else { STRETCHED_SPOT };
                let rows = cone.local_from_world.transpose();
                let spot = Self {
                    cos_half_angle: cone.cos_half_angle,
                    inverse_blend: cone.inverse_blend,
                    row_x: rows.x_axis.into(),
                    row_y: rows.y_axis.into(),
                    row_z: rows.z_axis.into(),
                    ..shared
                };
                spot.with_ball(kind, ball.center, ball.radius, magnitude)
            }
            Profile::Sheared(sheared) => {
                let [row_x, row_y, row_z] = sheared.edge_rows.map(<[f32; 3]>::from);
                let [inverse_u, inverse_v, center_row_z] = sheared.center_rows.map(<[f32; 3]>::from);
                let [length_u, length_v] = sheared.lengths;
                // Where it seems to be differs from place to place, so that nothing can be left out.
                let radius = if sheared.stays_in_place() { 0.5 * (length_u + length_v) } else { 2.0 * FAR };
                let kind = if sheared.is_ellipse { SHEARED_ELLIPSE } else { SHEARED_QUAD };
                let light = Self {
                    direction: sheared.facing.into(),
                    inverse_u,
                    inverse_v,
                    tan_half: sheared.spread.map_or(0.0, |spread| spread.tan_half),
                    normalisation: sheared.spread.map_or(0.0, |spread| spread.normalisation),
                    row_x,
                    length_u,
                    row_y,
                    length_v,
                    row_z,
                    determinant: sheared.determinant,
                    center_row_z,
                    ..shared
                };
                light.with_ball(kind, sheared.center, radius, magnitude)
            }
            Profile::Sun { direction, chord2 } => {
                Self { kind: SUN, direction: direction.into(), reach2: chord2, ..shared }
            }
        }
    }

    /// The light with its map, which begins at this row of the table of receivers.
    fn with_map(self, map: &PreparedMap, first_row: u32) -> Self {
        let rows = map.local_from_world.transpose();
        let [row_x, row_y] = match &map.key {
            PreparedKey::Place(plane) => [plane.inverse_u, plane.inverse_v],
            PreparedKey::WayBack | PreparedKey::Normal(_) => [rows.x_axis, rows.y_axis],
        };
        Self {
            row_x: row_x.into(),
            row_y: row_y.into(),
            row_z: rows.z_axis.into(),
            map_cone: map.map.domain.cone.unwrap_or(0.0),
            map_rows: first_row,
            map_width: map.map.width as u32,
            map_height: map.map.height() as u32,
            map_key: match map.key {
                PreparedKey::WayBack => WAY_BACK,
                PreparedKey::Normal(_) => NORMAL,
                PreparedKey::Place(_) => PLACE,
            },
            falloff_power: map.map.falloff.power,
            falloff_smooth: map.map.falloff.smooth,
            ..self
        }
    }

    /// Kind of the light as smoothed lights have it, which are neither stretched nor sheared.
    pub(super) fn plain_kind(&self) -> u32 {
        match self.kind {
            STRETCHED_SPOT => SPOT,
            STRETCHED_SOFT_SPOT => SOFT_SPOT,
            SHEARED_QUAD => QUAD,
            SHEARED_ELLIPSE => ELLIPSE,
            kind => kind,
        }
    }

    pub(super) fn is_sun(&self) -> bool {
        self.kind == SUN
    }

    /// Half of the size of a box around what the light reaches.
    pub(super) fn half_extent(&self) -> Vec3 {
        if self.kind <= SOFT_SPOT || self.kind > SUN {
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

/// Lights on the GPU, with the sets of objects that they are linked to, and their maps.
#[derive(Debug)]
pub struct GpuLights {
    /// One per light. Kernels may write others, with numbers of the sets that there are.
    pub lights: Buffer<GpuLight>,
    /// Set 0 holds all receivers. Behind the sets lie the texels of maps, each map from a row of its own on.
    pub receivers: Buffer<Receivers>,
}

impl GpuLights {
    pub(super) fn new(gpu: &Gpu, lights: &[PreparedLight], magnitude: f32) -> Result<Self, GpuError> {
        let mut sets = vec![[u32::MAX; SET_WORDS]];
        let mut numbers = HashMap::new();
        let mut number = |bits: &[u64; RECEIVER_LIMIT as usize / 64]| {
            *numbers.entry(*bits).or_insert_with(|| {
                sets.push(std::array::from_fn(|word| (bits[word / 2] >> (word % 2 * 32)) as u32));
                sets.len() as u32 - 1
            })
        };
        let mut on_device: Vec<_> = lights
            .iter()
            .map(|light| {
                let receivers = light.receivers.as_deref().map_or(0, &mut number);
                GpuLight::new(light, magnitude, receivers)
            })
            .collect();
        let mut rows_of = HashMap::new();
        for (on_device, light) in on_device.iter_mut().zip(lights) {
            let Some(map) = &light.map else { continue };
            let first_row = *rows_of.entry(Arc::as_ptr(&map.map)).or_insert_with(|| {
                let first_row = sets.len() as u32;
                sets.extend(map.map.texels.chunks(SET_WORDS).map(row));
                first_row
            });
            *on_device = on_device.with_map(map, first_row);
        }
        Ok(Self {
            lights: gpu.buffer_of("lights", &on_device)?,
            receivers: gpu.buffer_of("light linking and maps", &sets)?,
        })
    }
}

/// A row of the table of receivers that holds these words.
fn row(words: &[u32]) -> Receivers {
    std::array::from_fn(|word| words.get(word).copied().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_has_the_layout_of_its_wgsl_twin() {
        relume_gpu::assert_mirror!(GpuLight as "gather/light", "Light", {
            center, kind, direction, radius, inverse_u, reach2, inverse_v, receivers, factors, cos_half_angle,
            inverse_blend, tan_half, normalisation, row_x, length_u, row_y, length_v, row_z, determinant, center_row_z,
            map_cone, map_rows, map_width, map_height, map_key, falloff_power, falloff_smooth, crossed,
        });
    }

    #[test]
    fn kinds_and_receiver_sets_are_those_of_the_wgsl() {
        let constant = |name| relume_gpu::layout::constant("gather/light", name).unwrap();
        let kinds = [
            ("SPHERE", SPHERE),
            ("FACING_DISK", FACING_DISK),
            ("SPOT", SPOT),
            ("SOFT_SPOT", SOFT_SPOT),
            ("QUAD", QUAD),
            ("ELLIPSE", ELLIPSE),
            ("SUN", SUN),
            ("STRETCHED_SPOT", STRETCHED_SPOT),
            ("STRETCHED_SOFT_SPOT", STRETCHED_SOFT_SPOT),
            ("SHEARED_QUAD", SHEARED_QUAD),
            ("SHEARED_ELLIPSE", SHEARED_ELLIPSE),
        ];
        for (name, kind) in kinds {
            assert_eq!(constant(name), kind, "{name}");
        }
        assert_eq!(constant("RECEIVER_WORDS") as usize, size_of::<Receivers>() / size_of::<u32>());
    }
}
