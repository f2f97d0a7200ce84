//! Light sets in JSON.
//!
//! ```json
//! { "format": "relume-lights", "version": 1, "name": "Evening", "lights": [
//!   { "name": "Key", "shape": { "type": "sphere", "center": [0, 0, 2], "radius": 0.1 }, "radiance": [50, 40, 30] },
//!   { "name": "Rim", "kind": { "type": "AREA", "shape": "RECTANGLE", "size": 1, "size_y": 0.5 }, "energy": 100,
//!     "world_from_object": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]] } ] }
//! ```
//!
//! A light is either [`Light`] (`shape` and `radiance`) or Blender's parameters ([`BlenderLight`]: `kind` and
//! `energy`). A bare list of lights is read too.

use crate::error::SessionError;
use relume_scene::{BlenderLight, Light, MOST_RADIANCE};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::io::Write;
use std::path::Path;

const FORMAT: &str = "relume-lights";
const VERSION: u32 = 1;

/// A named list of lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSet {
    /// Name by the artist; the file name if it has none.
    pub name: String,
    /// The lights.
    pub lights: Vec<Light>,
    /// Changes made on reading, for the user.
    pub notes: Vec<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File<L> {
    format: String,
    version: u32,
    #[serde(default)]
    name: String,
    lights: Vec<L>,
}

impl LightSet {
    /// Reads a light set.
    ///
    /// # Errors
    /// [`SessionError::Lights`] names the file, the light and the field.
    pub fn read(path: &Path) -> Result<Self, SessionError> {
        let fail = |reason: String| SessionError::Lights { path: path.to_path_buf(), reason };
        let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
        let mut set = Self::parse(&text).map_err(fail)?;
        if set.name.is_empty() {
            set.name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        }
        Ok(set)
    }

    /// The lights that a bake's scene came with; none if the folder does not hold them.
    ///
    /// # Errors
    /// Fails like [`LightSet::read`].
    pub fn of_bake(folder: &Path) -> Result<Self, SessionError> {
        let path = folder.join(crate::files::names::LIGHTS_FILE);
        if path.exists() { Self::read(&path) } else { Ok(Self::default()) }
    }

    /// Parses the text of a light set.
    ///
    /// # Errors
    /// Names the light and the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        Self::from_json(serde_json::from_str(text).map_err(|error| error.to_string())?)
    }

    /// Reads a light set that is part of some JSON.
    pub(crate) fn from_json(value: Value) -> Result<Self, String> {
        let file = if value.is_array() {
            let lights = serde_json::from_value(value).map_err(|error| error.to_string())?;
            File { format: FORMAT.into(), version: VERSION, name: String::new(), lights }
        } else {
            serde_json::from_value::<File<Value>>(value).map_err(|error| error.to_string())?
        };
        if file.format != FORMAT || file.version != VERSION {
            return Err(format!(
                "it says {} version {}, expected {FORMAT} {VERSION}",
                file.format, file.version
            ));
        }
        let mut set = Self { name: file.name, ..Self::default() };
        for (i, value) in file.lights.into_iter().enumerate() {
            let name = name_in(&value);
            let read = ParsedLight::from_json(value);
            set.push(read.map_err(|reason| format!("light {i} '{name}': {reason}"))?);
        }
        Ok(set)
    }

    /// Adds a light.
    pub fn push(&mut self, read: ParsedLight) {
        self.lights.push(read.light);
        self.notes.extend(read.notes);
    }

    /// Writes the lights, atomically.
    pub fn write(&self, path: &Path) -> Result<(), SessionError> {
        Ok(relume_image::write_atomically(path, |writer| {
            serde_json::to_writer_pretty(&mut *writer, self)?;
            writer.write_all(b"\n")
        })?)
    }
}

/// Serializes in the form of its file.
impl Serialize for LightSet {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (format, name) = (FORMAT.to_string(), self.name.clone());
        File { format, version: VERSION, name, lights: self.lights.clone() }.serialize(serializer)
    }
}

/// A light and what was changed on reading it.
#[derive(Clone, Debug, PartialEq)]
pub struct ParsedLight {
    /// The light.
    pub light: Light,
    /// Changes, in words for the user.
    pub notes: Vec<String>,
}

impl ParsedLight {
    /// Parses one light of a light set.
    ///
    /// # Errors
    /// In words that name the light and the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let name = name_in(&value);
        Self::from_json(value).map_err(|reason| format!("light '{name}': {reason}"))
    }

    fn from_json(value: Value) -> Result<Self, String> {
        if value.get("kind").is_some() {
            let light: BlenderLight = serde_json::from_value(value).map_err(|error| error.to_string())?;
            let (light, notes) = light.to_light().map_err(|error| error.reason)?;
            return Ok(Self { light, notes });
        }
        if value.get("shape").is_none() {
            return Err("it has neither \"shape\" (with \"radiance\") nor \"kind\" (with \"energy\")".into());
        }
        let light: Light = serde_json::from_value(value).map_err(|error| error.to_string())?;
        check(&light)?;
        Ok(Self { light, notes: Vec::new() })
    }
}

fn name_in(value: &Value) -> String {
    value.get("name").and_then(Value::as_str).unwrap_or("unnamed").to_string()
}

/// Values that would make a light without area or direction; Blender's lights are checked by their own reader.
pub(crate) fn check(light: &Light) -> Result<(), String> {
    use relume_scene::LightShape as Shape;
    let positive = |x: f32| x > 0.0 && x.is_finite();
    let unit = |v: relume_scene::glam::Vec3| (v.length() - 1.0).abs() < 1e-3;
    let checks: &[(bool, &str)] = match &light.shape {
        Shape::Sphere { radius, center } | Shape::FacingDisk { radius, center } => {
            &[(positive(*radius), "radius must be above 0"), (center.is_finite(), "center must be finite")]
        }
        Shape::Spot { center, radius, axis, half_angle, .. } => &[
            (positive(*radius), "radius must be above 0"),
            (center.is_finite(), "center must be finite"),
            (unit(*axis), "axis must have length 1"),
            (positive(*half_angle), "half_angle must be above 0"),
        ],
        Shape::Quad { center, edge_u, edge_v, spread }
        | Shape::Ellipse { center, edge_u, edge_v, spread } => &[
            (positive(edge_u.length()) && positive(edge_v.length()), "edge_u and edge_v must not be zero"),
            (center.is_finite(), "center must be finite"),
            (positive(*spread), "spread must be above 0"),
        ],
        Shape::Sheared { center, edge_u, edge_v, facing, spread, .. } => &[
            (positive(edge_u.cross(*edge_v).length()), "edge_u and edge_v must span an area"),
            (center.is_finite(), "center must be finite"),
            (unit(*facing), "facing must have length 1"),
            (positive(*spread), "spread must be above 0"),
        ],
        Shape::StretchedSpot { center, radius, local_from_world, half_angle, .. } => &[
            (positive(*radius), "radius must be above 0"),
            (center.is_finite(), "center must be finite"),
            (positive(local_from_world.determinant().abs()), "local_from_world must have an inverse"),
            (positive(*half_angle), "half_angle must be above 0"),
        ],
        Shape::Sun { direction, half_angle } => &[
            (unit(*direction), "direction must have length 1"),
            (positive(*half_angle), "half_angle must be above 0"),
        ],
    };
    let is_bearable = light.radiance.iter().all(|radiance| radiance.abs() <= MOST_RADIANCE);
    let radiance = (is_bearable, "radiance must be a number of at most 1e30");
    match checks.iter().chain([&radiance]).find(|(ok, _)| !ok) {
        Some((_, reason)) => Err((*reason).into()),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_scene::LightShape;

    const SPHERE: &str = r#"{"name": "Key", "shape": {"type": "sphere", "center": [0, 1, 2], "radius": 0.1}, "radiance": [5, 4, 3]}"#;
    const AREA: &str = r#"{"name": "Rim", "kind": {"type": "AREA", "shape": "SQUARE", "size": 1}, "energy": 100,
        "world_from_object": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]}"#;

    #[test]
    fn both_kinds_of_lights_are_read() {
        let set = LightSet::parse(&format!("[{SPHERE}, {AREA}]")).unwrap();
        assert_eq!(set.lights[0].radiance, [5.0, 4.0, 3.0]);
        assert!(matches!(set.lights[1].shape, LightShape::Quad { .. }));
        // 100 W over 1 m2 of Lambertian emitter: P / (pi A).
        assert!((set.lights[1].radiance[0] - 100.0 / std::f32::consts::PI).abs() < 1e-3);
    }

    #[test]
    fn a_light_of_a_set_can_be_read_alone() {
        for text in [SPHERE, AREA] {
            let set = LightSet::parse(&format!("[{text}]")).unwrap();
            let read = ParsedLight::parse(text).unwrap();
            assert_eq!((set.lights, set.notes), (vec![read.light], read.notes));
        }
        let error = ParsedLight::parse(&SPHERE.replace("0.1", "-1")).unwrap_err();
        assert!(error.starts_with("light 'Key'") && error.contains("radius"), "{error}");
    }

    #[test]
    fn lights_too_bright_to_be_summed_are_refused_by_name() {
        let too_bright = |light: &str, from: &str, to: &str| {
            LightSet::parse(&format!("[{}]", light.replace(from, to))).unwrap_err()
        };
        let error = too_bright(SPHERE, "[5, 4, 3]", "[5, 2e30, 3]");
        assert!(error.contains("'Key'") && error.contains("at most 1e30"), "{error}");
        let error = too_bright(AREA, "100", "1e36");
        assert!(error.contains("'Rim'") && error.contains("lower its power"), "{error}");
    }

    #[test]
    fn written_sets_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("evening.json");
        let set = LightSet::parse(&format!("[{SPHERE}, {AREA}]")).unwrap();
        set.write(&path).unwrap();
        let read = LightSet::read(&path).unwrap();
        assert_eq!((read.name.as_str(), &read.lights), ("evening", &set.lights));
    }

    #[test]
    fn mistakes_are_named_with_their_light() {
        for (text, word) in [
            (SPHERE.replace("0.1", "-1"), "radius"),
            (SPHERE.replace("radiance", "power"), "radiance"),
            (SPHERE.replace("sphere", "torus"), "torus"),
            (AREA.replace("energy", "watts"), "watts"),
            (r#"{"name": "Key"}"#.to_string(), "shape"),
        ] {
            let message = LightSet::parse(&format!("[{text}]")).unwrap_err();
            assert!(message.contains(word) && message.starts_with("light 0 '"), "{message}");
        }
        for (text, word) in [
            ("[", "EOF"),
            (r#"{"format": "looks", "version": 1, "lights": []}"#, "looks"),
            (r#"{"format": "relume-lights", "version": 9, "lights": []}"#, "9"),
            (r#"{"format": "relume-lights", "version": 1, "lamps": []}"#, "lamps"),
        ] {
            let message = LightSet::parse(text).unwrap_err();
            assert!(message.contains(word), "{message}");
        }
    }
}
