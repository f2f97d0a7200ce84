use super::Aov;
use crate::files::light_set::{KnownLights, LightSet};
use crate::relight::source::Method;
use relume_scene::{Light, MOST_RADIANCE};
use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Json<L> {
    lights: L,
    #[serde(default)]
    gains: HashMap<String, [f32; 3]>,
    #[serde(default = "one")]
    world: [f32; 3],
    #[serde(default = "one", rename = "static")]
    static_light: [f32; 3],
    #[serde(default)]
    interactive: bool,
    half: Option<bool>,
    #[serde(default, rename = "with")]
    method: Method,
    aov: Option<Aov>,
}

fn one() -> [f32; 3] {
    [1.0; 3]
}

impl LiveRequest {
    /// Reads `{"lights": [...], "gains": {"Key": [1, 1, 1]}, "world": [1, 1, 1], "static": [1, 1, 1], "interactive": false,
    /// "half": null, "with": "auto", "aov": null}`; the lights are a light set ([`LightSet::parse`]), gains go by their names.
    ///
    /// # Errors
    /// Names the light or the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        Self::parse_knowing(text, &mut KnownLights::default())
    }

    /// [`LiveRequest::parse`], quicker if most lights are those of the text before.
    ///
    /// # Errors
    /// Fails like [`LiveRequest::parse`].
    pub fn parse_knowing(text: &str, known: &mut KnownLights) -> Result<Self, String> {
        let json: Json<&RawValue> = serde_json::from_str(text).map_err(|error| error.to_string())?;
        Self::of(known.parse(json.lights.get())?, json)
    }

    /// Reads a request that is part of some JSON.
    pub(crate) fn from_json(value: Value) -> Result<Self, String> {
        let mut json: Json<Value> = serde_json::from_value(value).map_err(|error| error.to_string())?;
        Self::of(LightSet::from_json(json.lights.take())?, json)
    }

    fn of<L>(set: LightSet, json: Json<L>) -> Result<Self, String> {
        let LightSet { mut lights, notes, .. } = set;
        for light in &mut lights {
            let gain = json.gains.get(&light.name).copied().unwrap_or(one());
            light.radiance = std::array::from_fn(|c| light.radiance[c] * gain[c]);
        }
        let is_bearable = |values: &[f32; 3]| values.iter().all(|value| value.abs() <= MOST_RADIANCE);
        match lights.iter().find(|light| !is_bearable(&light.radiance)) {
            Some(light) => {
                let limit = format!("it is brighter than {MOST_RADIANCE:e} with its row");
                let advice = "lower its power, exposure or multiplier";
                return Err(format!("light '{}': {limit}; {advice}", light.name));
            }
            None if !is_bearable(&json.world) || !is_bearable(&json.static_light) => {
                return Err(format!(
                    "the gains of world and static must be numbers of at most {MOST_RADIANCE:e}"
                ));
            }
            None => {}
        }
        let Json { world, static_light, interactive, half, method, aov, .. } = json;
        Ok(Self { lights, world, static_light, interactive, half, method, aov, notes })
    }
}
