use super::Aov;
use crate::files::light_set::LightSet;
use crate::relight::source::Method;
use relume_scene::{Light, MOST_RADIANCE};
use serde::{Deserialize, Serialize};
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

/// Factors that a request has for one shot in place of those for all.
#[derive(Default, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
struct ShotFactors {
    gains: Option<HashMap<String, [f32; 3]>>,
    world: Option<[f32; 3]>,
    #[serde(rename = "static")]
    static_light: Option<[f32; 3]>,
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

    /// Parses the form of [`Self::parse`] for one shot of a list. One more field may have, by the names of shots, what
    /// is other there: `{"shots": {"Wide": {"gains": {"Key": [0, 0, 0]}, "world": [1, 1, 1], "static": [1, 1, 1]}}}`.
    ///
    /// # Errors
    /// In words that name the light, the shot or the field.
    pub fn parse_for(text: &str, shot: &str) -> Result<Self, String> {
        let mut fields: Map<String, Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let shots = fields.remove("shots").map(serde_json::from_value::<HashMap<String, ShotFactors>>);
        let mut shots = shots.transpose().map_err(|error| format!("\"shots\": {error}"))?.unwrap_or_default();
        if let Some(Value::Object(own)) = shots.remove(shot).map(serde_json::to_value).and_then(Result::ok) {
            fields.extend(own.into_iter().filter(|(_, value)| !value.is_null()));
        }
        Self::from_json(fields)
    }

    /// Reads a request that is part of some JSON.
    pub(crate) fn from_json(mut fields: Map<String, Value>) -> Result<Self, String> {
        let lights = fields.remove("lights").ok_or("a request needs \"lights\"")?;
        let options = serde_json::from_value(Value::Object(fields)).map_err(|error| error.to_string())?;
        Self::new(LightSet::from_json(lights)?, options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"lights": {"format": "relume-lights", "version": 1, "lights": [
            {"name": "Key", "shape": {"type": "sphere", "center": [0, 0, 1], "radius": 0.1}, "radiance": [2, 2, 2]}]},
        "gains": {"Key": [0, 0, 0]}, "world": [1, 1, 1],
        "shots": {"Close": {"gains": {"Key": [3, 3, 3]}}, "Top": {"world": [0, 0, 0]}}}"#;

    #[test]
    fn a_shot_has_its_own_factors_and_else_those_of_all() {
        let of = |shot| {
            let request = LiveRequest::parse_for(TEXT, shot).unwrap();
            (request.lights[0].radiance[0], request.world[0])
        };
        assert_eq!(["Close", "Top", "Wide"].map(of), [(6.0, 1.0), (0.0, 0.0), (0.0, 1.0)]);
        assert!(LiveRequest::parse(TEXT).unwrap_err().contains("shots"), "it is for a list");
        let faulty = TEXT.replace("\"world\": [0, 0, 0]", "\"wrold\": [0, 0, 0]");
        let fault = LiveRequest::parse_for(&faulty, "Wide").unwrap_err();
        assert!(fault.contains("shots") && fault.contains("wrold"), "{fault}");
    }
}
