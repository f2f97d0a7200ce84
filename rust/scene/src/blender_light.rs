//! Blender's light parameters to radiance and shape, as Cycles means them.
//!
//! Checked against Cycles 4.2, 4.5 and 5.2 with an irradiance probe below each light (`blend_tests/test_lights.py`).
//! With `P = energy * 2^exposure * color * temperature * emission`:
//!
//! | light | radiance | not normalised |
//! |---|---|---|
//! | point, spot of radius r | `P / (4 pi^2 r^2)`: intensity `P / (4 pi)`, whatever the radius or the cone | `P / pi` |
//! | sun of half angle a | `P / (pi sin^2 a)`: irradiance `P` | `P` |
//! | area of area A | `P / (pi A)`, A with the object's scale | `P / pi` |

use crate::{EmissionMap, Light, LightRules, LightShape, LobeFactors, MOST_RADIANCE, PlacedMap, ReceiverSet};
use glam::{Mat3, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// A light object of Blender with its light data. Read from a file or from a JSON light set.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlenderLight {
    /// Object name.
    pub name: String,
    /// Rows of the object's world matrix.
    pub world_from_object: [[f32; 4]; 4],
    /// Type and what belongs to it.
    pub kind: BlenderLightKind,
    /// `Light.energy`: watts; sun: W/m2.
    pub energy: f32,
    /// `Light.color`.
    #[serde(default = "white")]
    pub color: [f32; 3],
    /// `Light.exposure` (Blender 4.5 and later), stops.
    #[serde(default)]
    pub exposure: f32,
    /// `Light.temperature_color`, or white where `use_temperature` is off.
    #[serde(default = "white")]
    pub temperature_color: [f32; 3],
    /// Colour times strength of the light's Emission node, or white without nodes.
    #[serde(default = "white")]
    pub emission: [f32; 3],
    /// `Light.normalize` (Blender 4.5 and later): power does not depend on size.
    #[serde(default = "yes")]
    pub normalize: bool,
    /// Smallest radius or edge that it is given, metres: paths meet a smaller one too rarely.
    #[serde(default = "min_size", skip_serializing_if = "is_min_size")]
    pub least_size: f32,
    /// Ray visibility, 0 or 1 each in Blender.
    #[serde(default)]
    pub lobes: LobeFactors,
    /// Receivers of light linking.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receivers: Option<ReceiverSet>,
    /// Factors on the emission by direction in the object's space, by place on an area and by distance; none where there are none.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_map")]
    pub map: Option<Arc<EmissionMap>>,
    /// Shadow linking, bounces and Multiple Importance.
    #[serde(default, skip_serializing_if = "LightRules::is_default")]
    pub rules: LightRules,
}

/// Settings that differ between Blender's light types. Lengths in metres, angles in radians.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "type", rename_all = "SCREAMING_SNAKE_CASE", deny_unknown_fields)]
pub enum BlenderLightKind {
    /// Shines everywhere.
    Point {
        /// `shadow_soft_size`; the object's scale does not touch it.
        radius: f32,
        /// `use_soft_falloff`.
        #[serde(default = "yes")]
        soft_falloff: bool,
    },
    /// Shines in a cone along its local -z.
    Spot {
        /// `shadow_soft_size`.
        radius: f32,
        /// `use_soft_falloff`.
        #[serde(default = "yes")]
        soft_falloff: bool,
        /// `spot_size`, the full angle.
        spot_size: f32,
        /// `spot_blend`, 0..1.
        spot_blend: f32,
    },
    /// Shines along its local -z from infinity.
    Sun {
        /// `angle`, the full angular diameter.
        angle: f32,
    },
    /// Shines along its local -z from a flat shape in its local xy plane.
    Area {
        /// `shape`.
        shape: AreaShape,
        /// `size`.
        size: f32,
        /// `size_y`, for rectangle and ellipse.
        #[serde(default)]
        size_y: f32,
        /// `spread`.
        #[serde(default = "lambertian")]
        spread: f32,
    },
}

/// Blender's area light shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum AreaShape {
    Square,
    Rectangle,
    Disk,
    Ellipse,
}

impl AreaShape {
    /// True if it has one size for both sides.
    pub fn is_even(self) -> bool {
        matches!(self, Self::Square | Self::Disk)
    }
}

/// JSON form of a table that lights share.
mod optional_map {
    use super::{Arc, EmissionMap};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(
        map: &Option<Arc<EmissionMap>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        map.as_deref().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Arc<EmissionMap>>, D::Error> {
        Ok(Option::<EmissionMap>::deserialize(deserializer)?.map(Arc::new))
    }
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn yes() -> bool {
    true
}

fn min_size() -> f32 {
    MIN_SIZE
}

fn is_min_size(size: &f32) -> bool {
    *size == MIN_SIZE
}

fn lambertian() -> f32 {
    PI
}

/// A light that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("light '{light}': {reason}")]
pub struct LightError {
    /// Object name.
    pub light: String,
    /// Fault and next step, in words.
    pub reason: String,
}

/// [`BlenderLight::least_size`] where nothing is known of the scene.
pub const MIN_SIZE: f32 = 0.01;

/// Radius of a spot, metres, from which surfaces are taken to lie within it.
const WIDE_SPOT: f32 = 0.5;

/// Smallest half angle of a sun, radians: about half of the real sun's.
pub const MIN_SUN_HALF_ANGLE: f32 = 0.0025;

impl BlenderLight {
    /// The light in physical units, and what had to be changed, in words for the user.
    pub fn to_light(&self) -> Result<(Light, Vec<String>), LightError> {
        self.validate()?;
        let mut notes = Vec::new();
        let (shape, radiance_per_power) = match self.kind {
            BlenderLightKind::Point { radius, soft_falloff } => {
                let sphere = self.sphere(radius, &mut notes);
                (point_shape(self.origin(), sphere.radius, soft_falloff), sphere.radiance_per_power)
            }
            BlenderLightKind::Spot { radius, soft_falloff, spot_size, spot_blend } => {
                let sphere = self.sphere(radius, &mut notes);
                let (center, radius, blend) = (self.origin(), sphere.radius, spot_blend.clamp(0.0, 1.0));
                if !soft_falloff && radius > WIDE_SPOT {
                    let what = "what lies within its radius is some 5 % brighter in Cycles";
                    notes.push(format!(
                        "light '{}': {what}. Lower the radius, or use soft falloff",
                        self.name
                    ));
                }
                let shape = if self.has_round_cone(blend) {
                    let (axis, half_angle) = (self.emission_direction()?, self.cone_half_angle(spot_size));
                    LightShape::Spot { center, radius, axis, half_angle, blend, soft_falloff }
                } else {
                    self.note_on_shear(&mut notes);
                    let local_from_world = self.local_from_world()?;
                    let half_angle = own_half_angle(spot_size);
                    LightShape::StretchedSpot {
                        center,
                        radius,
                        local_from_world,
                        half_angle,
                        blend,
                        soft_falloff,
                    }
                };
                (shape, sphere.radiance_per_power)
            }
            BlenderLightKind::Sun { angle } => self.sun(angle, &mut notes)?,
            BlenderLightKind::Area { shape, size, size_y, spread } => {
                self.area(shape, size, size_y, spread, &mut notes)?
            }
        };
        let light = Light {
            name: self.name.clone(),
            shape,
            radiance: self.power().map(|power| power * radiance_per_power),
            lobes: self.lobes,
            receivers: self.receivers.clone(),
            map: self.placed_map()?,
            rules: self.rules.clone(),
        };
        // So that NaN, of no power times no end of it, is refused as well.
        if !light.radiance.iter().all(|radiance| radiance.abs() <= MOST_RADIANCE) {
            let reason = format!("it is brighter than {MOST_RADIANCE:e}; lower its power");
            return Err(self.error(&reason));
        }
        Ok((light, notes))
    }

    /// True for an area light.
    pub(crate) fn is_area(&self) -> bool {
        matches!(self.kind, BlenderLightKind::Area { .. })
    }

    /// The table of its directions or places as it lies about the light.
    fn placed_map(&self) -> Result<Option<PlacedMap>, LightError> {
        let Some(map) = &self.map else { return Ok(None) };
        if self.is_area() && !is_square(self.axes(), 1e-4) {
            let reason = "it is sheared, which its texture would not follow; clear the scale of its parent";
            return Err(self.error(reason));
        }
        Ok(Some(PlacedMap { map: Arc::clone(map), local_from_world: self.local_from_world()? }))
    }

    /// `P` of the table above, RGB.
    fn power(&self) -> [f32; 3] {
        let scale = self.energy * self.exposure.exp2();
        std::array::from_fn(|c| scale * self.color[c] * self.temperature_color[c] * self.emission[c])
    }

    fn sphere(&self, radius: f32, notes: &mut Vec<String>) -> SphereSize {
        let used = radius.max(self.least_size);
        if used > radius && self.has_guessed_size() {
            notes.push(format!("light '{}': radius {radius} m is taken as {used} m", self.name));
        }
        // Cycles gives a point without radius the intensity of a disk of unit area.
        let area = if radius > 0.0 { PI * radius * radius } else { 1.0 };
        let intensity_per_power = if self.normalize { 1.0 / (4.0 * PI) } else { area / PI };
        SphereSize { radius: used, radiance_per_power: intensity_per_power / (PI * used * used) }
    }

    fn sun(&self, angle: f32, notes: &mut Vec<String>) -> Result<(LightShape, f32), LightError> {
        let half_angle = (0.5 * angle).clamp(MIN_SUN_HALF_ANGLE, 0.5 * PI);
        if half_angle > 0.5 * angle {
            let degrees = (2.0 * MIN_SUN_HALF_ANGLE).to_degrees();
            notes.push(format!("light '{}': the sun's angle is taken as {degrees:.2} degrees", self.name));
        }
        let irradiance_per_power = |half_angle: f32| PI * half_angle.sin().powi(2);
        let radiance_per_power = match self.normalize || angle <= 0.0 {
            true => 1.0 / irradiance_per_power(half_angle),
            false => irradiance_per_power(0.5 * angle) / irradiance_per_power(half_angle),
        };
        let direction = -self.emission_direction()?;
        Ok((LightShape::Sun { direction, half_angle }, radiance_per_power))
    }

    fn area(
        &self,
        shape: AreaShape,
        size: f32,
        size_y: f32,
        spread: f32,
        notes: &mut Vec<String>,
    ) -> Result<(LightShape, f32), LightError> {
        let size_y = if shape.is_even() { size } else { size_y };
        let axes = self.axes();
        let (true_u, true_v) = (axes.x_axis * size, axes.y_axis * size_y);
        let mut edge_of = |edge: Vec3, axis: Vec3| {
            if edge.length() < self.least_size {
                if self.has_guessed_size() {
                    notes.push(format!("light '{}': an edge is taken as {MIN_SIZE} m", self.name));
                }
                return axis.try_normalize().map(|axis| axis * self.least_size);
            }
            Some(edge)
        };
        let (Some(edge_u), Some(mut edge_v)) = (edge_of(true_u, axes.x_axis), edge_of(true_v, axes.y_axis))
        else {
            return Err(self.error("its scale is zero; set a scale above zero"));
        };
        let is_sheared = !is_square(axes, 1e-4);
        if is_sheared && edge_u.cross(edge_v).length() <= 1e-3 * edge_u.length() * edge_v.length() {
            return Err(self.error("its transform makes it flat; clear its transform"));
        }
        // Shapes emit along cross(u, v), Blender's along -z, also where the matrix mirrors.
        if edge_u.cross(edge_v).dot(self.emission_direction()?) < 0.0 {
            edge_v = -edge_v;
        }
        let round = matches!(shape, AreaShape::Disk | AreaShape::Ellipse);
        let fill = if round { 0.25 * PI } else { 1.0 };
        let area_of = |u: Vec3, v: Vec3| u.length() * v.length() * fill;
        let (area, true_area) = (area_of(edge_u, edge_v), area_of(true_u, true_v));
        let radiance_per_power = if self.normalize { 1.0 / (PI * area) } else { true_area / (PI * area) };
        let (center, spread) = (self.origin(), spread.clamp(1e-3, PI));
        let shape = if is_sheared {
            self.note_on_shear(notes);
            let facing = self.emission_direction()?;
            LightShape::Sheared { center, edge_u, edge_v, facing, spread, is_ellipse: round }
        } else if round {
            LightShape::Ellipse { center, edge_u, edge_v, spread }
        } else {
            LightShape::Quad { center, edge_u, edge_v, spread }
        };
        Ok((shape, radiance_per_power))
    }

    /// Says that a light is sheared so far that it shows: rays, light samples and the light tree of Cycles see it in
    /// different shapes, so that no one shape gives its picture.
    fn note_on_shear(&self, notes: &mut Vec<String>) {
        if !is_square(self.axes(), 0.02) {
            let what = "its object is sheared; close to it and at the edge of its light the picture differs from Cycles";
            notes.push(format!(
                "light '{}': {what}. Clear the uneven scale of its parent to be exact",
                self.name
            ));
        }
    }

    /// True if the cone of a spot is round in the world too, and its edge as soft there.
    fn has_round_cone(&self, blend: f32) -> bool {
        let Mat3 { x_axis, y_axis, z_axis } = self.axes();
        let [x, y, z] = [x_axis.length(), y_axis.length(), z_axis.length()];
        let keeps_edge = blend == 0.0 || (x - z).abs() <= 1e-2 * x.max(z);
        (x - y).abs() <= 1e-3 * x.max(y) && keeps_edge && is_square(self.axes(), 1e-4)
    }

    /// Directions in the object's own space.
    fn local_from_world(&self) -> Result<Mat3, LightError> {
        let Mat3 { x_axis, y_axis, z_axis } = self.axes();
        let volume = x_axis.cross(y_axis).dot(z_axis).abs();
        if volume <= 1e-6 * x_axis.length() * y_axis.length() * z_axis.length() {
            return Err(self.error("its transform makes it flat; clear its transform"));
        }
        Ok(self.axes().inverse())
    }

    /// Half of a round cone in world space: Cycles measures it in the spot's own, scaled space.
    fn cone_half_angle(&self, spot_size: f32) -> f32 {
        let axes = self.axes();
        let [x, y, z] = [axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length()];
        let half = own_half_angle(spot_size);
        let widening = (x * y).sqrt() / z;
        if half >= 0.499 * PI || (widening - 1.0).abs() < 1e-4 {
            half
        } else {
            (half.tan() * widening).atan()
        }
    }

    /// True if nobody has said which sizes cannot be told apart in the picture.
    fn has_guessed_size(&self) -> bool {
        is_min_size(&self.least_size)
    }

    pub(crate) fn axes(&self) -> Mat3 {
        let column = |c: usize| Vec3::from_array(std::array::from_fn(|row| self.world_from_object[row][c]));
        Mat3::from_cols(column(0), column(1), column(2))
    }

    fn origin(&self) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|row| self.world_from_object[row][3]))
    }

    pub(crate) fn emission_direction(&self) -> Result<Vec3, LightError> {
        (-self.axes().z_axis)
            .try_normalize()
            .ok_or_else(|| self.error("its scale is zero; set a scale above zero"))
    }

    fn validate(&self) -> Result<(), LightError> {
        let sizes = match self.kind {
            BlenderLightKind::Point { radius, .. } => [radius, 0.0, 0.0],
            BlenderLightKind::Spot { radius, spot_size, spot_blend, .. } => [radius, spot_size, spot_blend],
            BlenderLightKind::Sun { angle } => [angle, 0.0, 0.0],
            BlenderLightKind::Area { size, size_y, spread, .. } => [size, size_y, spread],
        };
        let colors = [self.color, self.temperature_color, self.emission];
        let mut numbers =
            self.world_from_object.iter().flatten().chain(colors.iter().flatten()).chain(&sizes);
        if !(numbers.all(|n| n.is_finite()) && self.power().iter().all(|p| p.is_finite())) {
            return Err(self.error("a value is not a finite number; reset its transform and settings"));
        }
        if !(self.least_size > 0.0 && self.least_size.is_finite()) {
            return Err(self.error("its least size is not above 0"));
        }
        if sizes.iter().any(|size| *size < 0.0) {
            return Err(self.error("a size is negative; make it positive"));
        }
        Ok(())
    }

    pub(crate) fn error(&self, reason: &str) -> LightError {
        LightError { light: self.name.clone(), reason: reason.into() }
    }
}

/// True if axes are perpendicular but for a cosine of `tolerance`.
fn is_square(Mat3 { x_axis: x, y_axis: y, z_axis: z }: Mat3, tolerance: f32) -> bool {
    [(x, y), (y, z), (z, x)].iter().all(|(a, b)| a.dot(*b).abs() <= tolerance * a.length() * b.length())
}

/// Half of the cone in the object's own space.
fn own_half_angle(spot_size: f32) -> f32 {
    (0.5 * spot_size).clamp(0.0, 0.5 * PI)
}

struct SphereSize {
    radius: f32,
    radiance_per_power: f32,
}

fn point_shape(center: Vec3, radius: f32, soft_falloff: bool) -> LightShape {
    match soft_falloff {
        true => LightShape::FacingDisk { center, radius },
        false => LightShape::Sphere { center, radius },
    }
}

#[cfg(test)]
#[path = "blender_light_tests.rs"]
mod tests;
