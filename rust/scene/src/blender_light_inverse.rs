use crate::{
    AreaShape, BlenderLight, BlenderLightKind, Light, LightError, LightRules, LightShape, LobeFactors,
};
use glam::{Mat3, Quat, Vec3};
use std::sync::Arc;

/// Relative difference below which values count as equal.
const EQUAL: f32 = 1e-4;

impl BlenderLight {
    /// This light of Blender's as it has to be set to be that light in physical units: the inverse of [`BlenderLight::to_light`].
    /// Scale, soft falloff, spread, exposure, temperature, nodes and normalisation stay as they are; so do colour and sizes that
    /// need not change. A square becomes a rectangle and a disk an ellipse where they have to.
    ///
    /// # Errors
    /// If the light is of another type, or its colour cannot be had under this temperature or these nodes.
    pub fn with_light(&self, light: &Light) -> Result<Self, LightError> {
        let mut new = self.clone();
        new.kind = self.kind_of(&light.shape)?;
        new.set_axes(match &light.map {
            // The edges of an area say how it is turned about its axis; what else points somewhere needs its map for that.
            Some(placed) if self.map.is_some() && !self.is_area() => placed.local_from_world.inverse(),
            _ => self.axes_of(&light.shape)?,
        });
        if let Some(center) = light.shape.center() {
            (0..3).for_each(|row| new.world_from_object[row][3] = center[row]);
        }
        // What the light would be at a power of 1 and white.
        let (unit, _) = Self { energy: 1.0, color: [1.0; 3], ..new.clone() }.to_light()?;
        let is_missing = |c: usize| unit.radiance[c] == 0.0 && light.radiance[c] != 0.0;
        if (0..3).any(is_missing) {
            return Err(
                self.error("its temperature or nodes give none of a colour that it needs; make it white")
            );
        }
        let share =
            |c: usize| if unit.radiance[c] == 0.0 { 0.0 } else { light.radiance[c] / unit.radiance[c] };
        let wanted = std::array::from_fn(share);
        (new.energy, new.color) = self.energy_and_color(wanted);
        new.lobes = light.lobes;
        new.receivers = light.receivers.clone();
        new.rules = light.rules.clone();
        Ok(new)
    }

    /// A light of Blender's that is this light, with default settings.
    pub fn from_light(light: &Light) -> Result<Self, LightError> {
        let kind = match light.shape {
            LightShape::Sheared { .. } | LightShape::StretchedSpot { .. } => {
                let reason = "a new light cannot be sheared; copy one that is".into();
                return Err(LightError { light: light.name.clone(), reason });
            }
            LightShape::Sphere { radius, .. } => BlenderLightKind::Point { radius, soft_falloff: false },
            LightShape::FacingDisk { radius, .. } => BlenderLightKind::Point { radius, soft_falloff: true },
            LightShape::Spot { radius, half_angle, blend, soft_falloff, .. } => BlenderLightKind::Spot {
                radius,
                soft_falloff,
                spot_size: 2.0 * half_angle,
                spot_blend: blend,
            },
            LightShape::Quad { spread, .. } => area(AreaShape::Rectangle, spread),
            LightShape::Ellipse { spread, .. } => area(AreaShape::Ellipse, spread),
            LightShape::Sun { half_angle, .. } => BlenderLightKind::Sun { angle: 2.0 * half_angle },
        };
        let mut world_from_object = [[0.0; 4]; 4];
        (0..4).for_each(|i| world_from_object[i][i] = 1.0);
        let plain = Self {
            name: light.name.clone(),
            world_from_object,
            kind,
            energy: 1.0,
            color: [1.0; 3],
            exposure: 0.0,
            temperature_color: [1.0; 3],
            emission: [1.0; 3],
            normalize: true,
            least_size: crate::MIN_SIZE,
            lobes: LobeFactors::default(),
            receivers: None,
            map: light.map.as_ref().map(|placed| Arc::clone(&placed.map)),
            rules: LightRules::default(),
        };
        plain.with_light(light)
    }

    fn kind_of(&self, shape: &LightShape) -> Result<BlenderLightKind, LightError> {
        let axes = self.axes();
        let [scale_x, scale_y, scale_z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(Vec3::length);
        let (now, _) = self.to_light()?;
        let sizes = (now.shape.sizes(), shape.sizes());
        let kept = |i: usize, of_blender: f32, new: f32| {
            if (sizes.1[i] / sizes.0[i] - 1.0).abs() < EQUAL { of_blender } else { new }
        };
        Ok(match (self.kind, shape) {
            (
                BlenderLightKind::Point { radius, soft_falloff },
                LightShape::Sphere { .. } | LightShape::FacingDisk { .. },
            ) => BlenderLightKind::Point { radius: kept(0, radius, sizes.1[0]), soft_falloff },
            (
                BlenderLightKind::Spot { radius, soft_falloff, .. },
                LightShape::Spot { half_angle, blend, .. },
            ) => {
                // The inverse of how a scaled spot widens its cone.
                let widening = (scale_x * scale_y).sqrt() / scale_z;
                let narrow = *half_angle < 0.499 * std::f32::consts::PI && (widening - 1.0).abs() >= EQUAL;
                let own = if narrow { (half_angle.tan() / widening).atan() } else { *half_angle };
                let radius = kept(0, radius, sizes.1[0]);
                BlenderLightKind::Spot { radius, soft_falloff, spot_size: 2.0 * own, spot_blend: *blend }
            }
            (
                BlenderLightKind::Spot { radius, soft_falloff, .. },
                LightShape::StretchedSpot { half_angle, blend, .. },
            ) => BlenderLightKind::Spot {
                radius: kept(0, radius, sizes.1[0]),
                soft_falloff,
                spot_size: 2.0 * half_angle,
                spot_blend: *blend,
            },
            (BlenderLightKind::Sun { angle }, LightShape::Sun { half_angle, .. }) => {
                BlenderLightKind::Sun { angle: kept(0, angle, 2.0 * half_angle) }
            }
            (
                BlenderLightKind::Area { shape: form, size, size_y, spread },
                LightShape::Quad { .. } | LightShape::Ellipse { .. } | LightShape::Sheared { .. },
            ) => {
                let old_y = if form.is_even() { size } else { size_y };
                let (size, size_y) =
                    (kept(0, size, sizes.1[0] / scale_x), kept(1, old_y, sizes.1[1] / scale_y));
                let stays_even = form.is_even() && (size_y / size - 1.0).abs() < EQUAL;
                let form = match form {
                    AreaShape::Square if !stays_even => AreaShape::Rectangle,
                    AreaShape::Disk if !stays_even => AreaShape::Ellipse,
                    form => form,
                };
                BlenderLightKind::Area { shape: form, size, size_y, spread }
            }
            _ => return Err(self.error("it is of another type than what it is to become")),
        })
    }

    /// Axes of the object for the orientation of a shape, as long and as handed as they are.
    fn axes_of(&self, shape: &LightShape) -> Result<Mat3, LightError> {
        let axes = self.axes();
        let aimed = |direction: Vec3| -> Result<Mat3, LightError> {
            let (from, to) = (self.emission_direction()?, direction.normalize());
            Ok(if from.distance(to) < EQUAL {
                axes
            } else {
                Mat3::from_quat(Quat::from_rotation_arc(from, to)) * axes
            })
        };
        match *shape {
            // Neither of these turns.
            LightShape::Sphere { .. }
            | LightShape::FacingDisk { .. }
            | LightShape::Sheared { .. }
            | LightShape::StretchedSpot { .. } => Ok(axes),
            LightShape::Spot { axis, .. } => aimed(axis),
            LightShape::Sun { direction, .. } => aimed(-direction),
            LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
                let emission = edge_u.cross(edge_v).normalize();
                // `to_light` turns the second edge over in a matrix that does not mirror.
                let flip = if axes.determinant() > 0.0 { -1.0 } else { 1.0 };
                Ok(Mat3::from_cols(
                    edge_u.normalize() * axes.x_axis.length(),
                    edge_v.normalize() * flip * axes.y_axis.length(),
                    -emission * axes.z_axis.length(),
                ))
            }
        }
    }

    fn set_axes(&mut self, axes: Mat3) {
        for (column, axis) in [axes.x_axis, axes.y_axis, axes.z_axis].into_iter().enumerate() {
            (0..3).for_each(|row| self.world_from_object[row][column] = axis[row]);
        }
    }

    /// Energy and colour whose product is this, the colour as it is if it can stay, else as bright as it is. The energy of a
    /// light that takes light away is negative, not its colour.
    fn energy_and_color(&self, product: [f32; 3]) -> (f32, [f32; 3]) {
        let dot = |a: [f32; 3], b: [f32; 3]| (0..3).map(|c| a[c] * b[c]).sum::<f32>();
        let largest =
            |of: [f32; 3]| of.into_iter().fold(0.0, |a: f32, b| if b.abs() > a.abs() { b } else { a });
        let peak = largest(product);
        if peak == 0.0 {
            return (0.0, self.color);
        }
        let along = dot(product, self.color) / dot(self.color, self.color);
        if along.is_finite()
            && (0..3).all(|c| (product[c] - along * self.color[c]).abs() <= EQUAL * peak.abs())
        {
            return (along, self.color);
        }
        let brightness = largest(self.color);
        let energy = peak / if brightness > 0.0 { brightness } else { 1.0 };
        (energy, product.map(|value| value / energy))
    }
}

fn area(shape: AreaShape, spread: f32) -> BlenderLightKind {
    BlenderLightKind::Area { shape, size: 1.0, size_y: 1.0, spread }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EmissionMap;
    use crate::LANES;
    use std::f32::consts::PI;

    fn lights() -> Vec<BlenderLight> {
        let matrix = |scale: [f32; 3], turn: Quat| {
            let axes = Mat3::from_quat(turn) * Mat3::from_diagonal(Vec3::from(scale));
            glam::Mat4::from_mat3_translation(axes, Vec3::new(0.5, 1.5, 2.5)).transpose().to_cols_array_2d()
        };
        let turn = Quat::from_scaled_axis(Vec3::new(0.4, -0.8, 0.3));
        let kinds = [
            BlenderLightKind::Point { radius: 0.3, soft_falloff: false },
            BlenderLightKind::Point { radius: 0.3, soft_falloff: true },
            BlenderLightKind::Spot { radius: 0.2, soft_falloff: true, spot_size: 1.0, spot_blend: 0.4 },
            BlenderLightKind::Sun { angle: 0.1 },
            BlenderLightKind::Area { shape: AreaShape::Rectangle, size: 0.6, size_y: 0.4, spread: 2.0 },
            BlenderLightKind::Area { shape: AreaShape::Square, size: 0.6, size_y: 9.0, spread: PI },
            BlenderLightKind::Area { shape: AreaShape::Disk, size: 0.6, size_y: 9.0, spread: 1.0 },
        ];
        let scales = [[1.0, 1.0, 1.0], [2.0, 2.0, 1.5], [1.5, -0.5, 1.0]];
        let both = kinds.into_iter().flat_map(|kind| scales.map(|scale| (kind, scale)));
        both.map(|(kind, scale)| BlenderLight {
            name: "Lamp".into(),
            world_from_object: matrix(scale, turn),
            kind,
            energy: 60.0,
            color: [1.0, 0.6, 0.3],
            exposure: 1.0,
            temperature_color: [1.0, 0.9, 0.8],
            emission: [1.0, 1.0, 0.5],
            normalize: scale[0] < 2.0,
            least_size: crate::MIN_SIZE,
            lobes: LobeFactors::default(),
            receivers: None,
            map: None,
            rules: LightRules::default(),
        })
        .collect()
    }

    fn assert_same(found: &Light, wanted: &Light, about: &BlenderLight) {
        for c in 0..3 {
            let ratio = found.radiance[c] / wanted.radiance[c];
            assert!((ratio - 1.0).abs() < 1e-3, "{about:?}: {found:?} for {wanted:?}");
        }
        let numbers = |light: &Light| {
            let value = serde_json::to_value(light.shape).unwrap();
            let mut numbers = Vec::new();
            collect(&value, &mut numbers);
            numbers
        };
        let pairs: Vec<_> = numbers(found).into_iter().zip(numbers(wanted)).collect();
        assert!(pairs.iter().all(|(a, b)| (a - b).abs() < 1e-4), "{about:?}: {found:?} for {wanted:?}");
    }

    fn collect(value: &serde_json::Value, into: &mut Vec<f64>) {
        match value {
            serde_json::Value::Number(number) => into.extend(number.as_f64()),
            serde_json::Value::Array(list) => list.iter().for_each(|value| collect(value, into)),
            serde_json::Value::Object(map) => map.values().for_each(|value| collect(value, into)),
            _ => {}
        }
    }

    #[test]
    fn a_light_that_stays_is_written_as_it_was() {
        for blender in lights() {
            let (light, _) = blender.to_light().unwrap();
            let again = blender.with_light(&light).unwrap();
            assert_eq!(again.color, blender.color, "{blender:?}");
            assert!((again.energy / blender.energy - 1.0).abs() < 1e-4, "{blender:?}");
            assert_same(&again.to_light().unwrap().0, &light, &blender);
        }
    }

    #[test]
    fn a_light_that_moves_is_what_it_moved_to() {
        for blender in lights() {
            let (light, _) = blender.to_light().unwrap();
            let shape = light.shape.moved(&[0.5, -1.0, 0.2, 0.3, 0.6, -0.4, 0.3, -0.2, 0.1, 0.2]);
            let wanted = Light { shape, radiance: [3.0, 4.0, 9.0], ..light };
            let moved = blender.with_light(&wanted).unwrap();
            assert_same(&moved.to_light().unwrap().0, &wanted, &blender);
            assert!((moved.color.into_iter().fold(0.0, f32::max) - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_map_turns_with_its_light_and_is_kept() {
        let domain = crate::MapDomain { key: crate::MapKey::WayBack, cone: Some(0.5) };
        let map = Some(Arc::new(EmissionMap {
            domain,
            width: 1,
            texels: vec![7],
            falloff: crate::Falloff::default(),
        }));
        for blender in lights() {
            let blender = BlenderLight { map: map.clone(), ..blender };
            let is_ball =
                matches!(blender.kind, BlenderLightKind::Point { .. } | BlenderLightKind::Spot { .. });
            let Ok((light, _)) = blender.to_light() else {
                assert!(!is_ball);
                continue;
            };
            let text = serde_json::to_string(&blender).unwrap();
            assert_eq!(serde_json::from_str::<BlenderLight>(&text).unwrap(), blender);
            let shape = light.shape.moved(&[0.5, -1.0, 0.2, 0.3, 0.6, -0.4, 0.3, -0.2, 0.1, 0.2]);
            let wanted = light.reshaped(shape, light.radiance);
            let found = blender.with_light(&wanted).unwrap().to_light().unwrap().0;
            let [found, wanted] = [found, wanted].map(|light| light.map.unwrap());
            assert!(Arc::ptr_eq(&found.map, &wanted.map));
            let apart = found.local_from_world - wanted.local_from_world;
            assert!(apart.to_cols_array().iter().all(|value| value.abs() < 1e-4), "{blender:?}");
            let axis = shape.axis().map(|axis| found.local_from_world * axis);
            assert!(axis.is_none_or(|axis| axis.normalize().z.abs() > 0.999));
        }
    }

    #[test]
    fn new_lights_are_what_they_should_be() {
        for blender in lights() {
            let (light, _) = blender.to_light().unwrap();
            let step: [f32; LANES] = [0.1; LANES];
            let light = Light { shape: light.shape.moved(&step), ..light };
            if matches!(light.shape, LightShape::StretchedSpot { .. }) {
                assert!(BlenderLight::from_light(&light).is_err());
                continue;
            }
            assert_same(&BlenderLight::from_light(&light).unwrap().to_light().unwrap().0, &light, &blender);
        }
    }

    #[test]
    fn black_lights_and_those_that_take_light_away_keep_sound_colours() {
        let lamp = lights()[0].clone();
        for (energy, color, wanted) in [
            (0.0, [1.0, 0.6, 0.3], [0.0; 3]),
            (60.0, [0.0; 3], [0.0; 3]),
            (60.0, [0.0; 3], [3.0, 4.0, 9.0]),
            (-60.0, [1.0, 0.6, 0.3], [-3.0, -4.0, -9.0]),
            (60.0, [1.0, 0.6, 0.3], [-1.0, -2.0, -0.5]),
            (60.0, [1.0, 0.6, 0.3], [0.0; 3]),
        ] {
            let blender = BlenderLight { energy, color, ..lamp.clone() };
            let light = Light { radiance: wanted, ..blender.to_light().unwrap().0 };
            let written = blender.with_light(&light).unwrap();
            assert!(written.energy.is_finite() && written.color.into_iter().all(|c| c >= 0.0), "{written:?}");
            let found = written.to_light().unwrap().0.radiance;
            for c in 0..3 {
                assert!((found[c] - wanted[c]).abs() <= 1e-3 * wanted[c].abs(), "{found:?} for {wanted:?}");
            }
        }
    }

    #[test]
    fn a_colour_that_nodes_take_away_is_an_error() {
        let blue = BlenderLight { emission: [0.0, 0.0, 1.0], ..lights()[0].clone() };
        let (light, _) = blue.to_light().unwrap();
        let red = Light { radiance: [1.0, 0.0, 0.0], ..light };
        assert!(blue.with_light(&red).unwrap_err().to_string().contains("'Lamp'"));
    }
}
