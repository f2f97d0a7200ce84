use super::Aov;
use crate::files::light_set::LightSet;
use crate::relight::source::Method;
use relume_scene::{Light, MOST_RADIANCE};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::HashMap;

/// Request for a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveRequest {
    /// The lights, with their gains multiplied in.
    pub lights: Vec<Light>,
    /// Factor on the world's light.
    pub world: [f32; 3],
    /// Factor on what the scene itself emits.
    pub static_light: [f32; 3],
    /// True during a drag: quick before exact, and another request follows.
    pub interactive: bool,
    /// True for half the size during a drag; by default on machines that are too slow for the full one.
    pub half: Option<bool>,
    /// Method that makes the pictures.
    pub method: Method,
    /// Feature that is shown in place of the lights.
    pub aov: Option<Aov>,
    /// Changes made on reading the lights, for the user.
    pub notes: Vec<String>,
}

/// Everything of a request but its lights. JSON: `{"gains": {"Key": [1, 1, 1]}, "world": [1, 1, 1], "static": [1, 1, 1],
/// "interactive": false, "half": null, "with": "auto", "aov": null}`.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RequestOptions {
    /// Factors on the light of lights, by their names.
    pub gains: HashMap<String, [f32; 3]>,
    /// Factor on the world's light.
    pub world: [f32; 3],
    /// Factor on the light of emissive surfaces.
    #[serde(rename = "static")]
    pub static_light: [f32; 3],
    /// Quick before exact.
    pub interactive: bool,
    /// Half the size while interactive; by default on slow machines.
    pub half: Option<bool>,
    /// Method that makes the pictures.
    #[serde(rename = "with")]
    pub method: Method,
    /// Layer that is shown in place of the lights.
    pub aov: Option<Aov>,
}

impl Default for RequestOptions {
    fn default() -> Self {
        let (world, static_light) = ([1.0; 3], [1.0; 3]);
        let (gains, method) = (HashMap::new(), Method::default());
        Self { gains, world, static_light, interactive: false, half: None, method, aov: None }
    }
}

impl LiveRequest {
    /// Builds a request, with the gains multiplied into the lights.
    ///
    /// # Errors
    /// If a light or a factor is too bright, in words that name it.
    pub fn new(set: LightSet, options: RequestOptions) -> Result<Self, String> {
        let LightSet { mut lights, notes, .. } = set;
        for light in &mut lights {
            let gain = options.gains.get(&light.name).copied().unwrap_or([1.0; 3]);
            light.radiance = std::array::from_fn(|c| light.radiance[c] * gain[c]);
        }
        let is_bearable = |values: &[f32; 3]| values.iter().all(|value| value.abs() <= MOST_RADIANCE);
        match lights.iter().find(|light| !is_bearable(&light.radiance)) {
            Some(light) => {
                let limit = format!("it is brighter than {MOST_RADIANCE:e} with its row");
                let advice = "lower its power, exposure or multiplier";
                return Err(format!("light '{}': {limit}; {advice}", light.name));
            }
            None if !is_bearable(&options.world) || !is_bearable(&options.static_light) => {
                return Err(format!(
                    "the gains of world and static must be numbers of at most {MOST_RADIANCE:e}"
                ));
            }
            None => {}
        }
        let RequestOptions { world, static_light, interactive, half, method, aov, .. } = options;
        Ok(Self { lights, world, static_light, interactive, half, method, aov, notes })
    }

    /// Parses the JSON form of [`RequestOptions`] with one more field, `lights`: a light set ([`LightSet::parse`]).
    ///
    /// # Errors
    /// In words that name the light or the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        Self::from_json(serde_json::from_str(text).map_err(|error| error.to_string())?)
    }

    /// Reads a request that is part of some JSON.
    pub(crate) fn from_json(mut fields: Map<String, Value>) -> Result<Self, String> {
        let lights = fields.remove("lights").ok_or("a request needs \"lights\"")?;
        let options = serde_json::from_value(Value::Object(fields)).map_err(|error| error.to_string())?;
        Self::new(LightSet::from_json(lights)?, options)
    }
}
