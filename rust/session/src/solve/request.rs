use crate::files::light_set::LightSet;
use crate::live::LiveRequest;
use relume_optimise::{Region, Settings};
use relume_scene::{BlenderLight, BlenderLightKind, Light};
use serde::Deserialize;
use serde::de::Error as _;
use serde_json::{Map, Value};
use std::collections::HashMap;

/// Request to solve lights, read from JSON. Places are fractions of the picture, (0, 0) its top left corner.
///
/// ```json
/// { "lights": [...], "gains": {}, "world": [1, 1, 1], "static": [1, 1, 1],
///   "free": {"Key": ["position", "strength"], "world": ["strength"]},
///   "bounds": {"min": [-2, -2, 0], "max": [2, 2, 3], "size": [0.05, 1], "stops": [-1, 1], "tint": 0.5, "degrees": 15},
///   "stay": 0, "each": {"Key": {"bounds": {"max": [2, 2, 1.5]}, "stay": 0.1}},
///   "add": {"count": 2, "type": "point"}, "remove": true,
///   "goals": [{"goal": "target", "image": "target.exr", "exposure_invariant": true},
///             {"goal": "brighter", "stops": 1, "where": {"rectangle": [0, 0, 0.5, 1]}},
///             {"goal": "warmer", "mireds": 60, "where": {"strokes": [{"radius": 0.05, "points": [[0.5, 0.5, 1]]}]}},
///             {"goal": "keep", "where": {"mask": "mask.png"}}],
///   "keep_rest": 0.1, "starts": 4, "steps": 300, "seed": 0 }
/// ```
///
/// The first four describe the present picture, as in [`LiveRequest::parse`]. Lights and values that `free` does not
/// name stay.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveRequest {
    /// The picture as it is.
    pub now: LiveRequest,
    /// The lights as they were written.
    pub(crate) described: Vec<Value>,
    /// The rest.
    pub options: SolveOptions,
}

/// Options of a solve.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolveOptions {
    /// Parameters that may change, by the light's name; `world` has colour and strength.
    pub free: HashMap<String, Vec<FreeParam>>,
    /// Bounds of all lights.
    pub bounds: BoundsOptions,
    /// Bounds and priors of single lights, by name, in place of those of all. The world has only `stops` and `tint`.
    #[serde(rename = "each")]
    pub per_light: HashMap<String, PerLightOptions>,
    /// New lights.
    pub add: Option<NewLights>,
    /// True if free lights that do nothing may go.
    pub remove: bool,
    /// Goals of the picture.
    pub goals: Vec<GoalRequest>,
    /// Weight of the picture staying as it is beside the goals; 0 for none.
    pub keep_rest: f32,
    /// Weight of lights staying where they are ([`relume_optimise::Variable::prior_weight`]).
    #[serde(rename = "stay")]
    pub prior_weight: f32,
    /// Starts, of which the best is kept.
    pub starts: usize,
    /// Random places tried for each light of a start.
    pub candidates: usize,
    /// Most steps of a start.
    pub steps: usize,
    /// Share of the pixels that a step looks at.
    pub pixel_fraction: f32,
    /// Least number of cells, of up to 8 x 8 pixels, that it looks at; below a hundred or so steps are noisy.
    pub least_cells: usize,
    /// Learning rate of Adam.
    pub learning_rate: f32,
    /// Seed.
    pub seed: u64,
    /// Most steps of the polish by exact pictures; 0 for none.
    pub polish: usize,
    /// Backend of the gradients.
    #[serde(rename = "through")]
    pub backend: Backend,
    /// Earlier answer to start from instead of the present lights and random places. With 0 steps it is only polished.
    pub from: Option<Answer>,
}

/// Earlier answer ([`super::Solved`], whose other fields may be present).
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Answer {
    /// Lights of that answer.
    #[serde(deserialize_with = "light_set")]
    pub lights: Vec<Light>,
    /// Factor on the world's light.
    #[serde(default = "white")]
    pub world: [f32; 3],
}

fn light_set<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<Light>, D::Error> {
    let value = Value::deserialize(deserializer)?;
    let set = LightSet::from_json(value);
    Ok(set.map_err(|reason| D::Error::custom(format!("\"from\": {reason}")))?.lights)
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self {
            free: HashMap::new(),
            bounds: BoundsOptions::default(),
            per_light: HashMap::new(),
            add: None,
            remove: false,
            goals: Vec::new(),
            keep_rest: 0.0,
            prior_weight: 0.0,
            starts: 4,
            candidates: 16,
            steps: 300,
            pixel_fraction: 0.05,
            least_cells: Settings::default().least_cells,
            learning_rate: 0.05,
            seed: 0,
            polish: 64,
            backend: Backend::Auto,
            from: None,
        }
    }
}

/// A value of a light that may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names of `relume_optimise::Locks`")]
pub enum FreeParam {
    Position,
    Direction,
    Size,
    Cone,
    Color,
    Strength,
}

/// Bounds of a light. An absent bound is that of all lights. Absent there, places and sizes follow the visible scene,
/// and strength, colour and direction are free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundsOptions {
    /// Lower corner of the box of centres, metres.
    pub min: Option<[f32; 3]>,
    /// Upper corner of the box of centres, metres.
    pub max: Option<[f32; 3]>,
    /// Smallest and largest radius or edge, metres.
    pub size: Option<[f32; 2]>,
    /// Smallest and largest half angle of a sun, radians.
    pub sun: Option<[f32; 2]>,
    /// Smallest and largest half angle of a spot's cone, radians.
    pub cone: Option<[f32; 2]>,
    /// Least and most strength (luminance of the power), in stops above the present one. New lights have none to go by.
    pub stops: Option<[f32; 2]>,
    /// Largest change in the ratio of two colour channels, in stops, from the present one; from white, for new lights.
    pub tint: Option<f32>,
    /// Largest turn of a spot, an area light or a sun from its present direction, degrees; not for new lights.
    pub degrees: Option<f32>,
}

/// More stops than there are between starlight and the sun.
const MOST_STOPS: f32 = 64.0;

impl BoundsOptions {
    /// These bounds, with those of all lights for absent ones.
    fn or(self, all: Self) -> Self {
        Self {
            min: self.min.or(all.min),
            max: self.max.or(all.max),
            size: self.size.or(all.size),
            sun: self.sun.or(all.sun),
            cone: self.cone.or(all.cone),
            stops: self.stops.or(all.stops),
            tint: self.tint.or(all.tint),
            degrees: self.degrees.or(all.degrees),
        }
    }

    /// Checks strength, colour and direction.
    fn check(&self) -> Result<(), String> {
        let are_stops = |[low, high]: [f32; 2]| -MOST_STOPS <= low && low <= high && high <= MOST_STOPS;
        if !self.stops.is_none_or(are_stops) {
            return Err(format!(
                "\"stops\" must be two numbers from -{MOST_STOPS} to {MOST_STOPS}, the first not above the second"
            ));
        }
        for (name, value) in [("degrees", self.degrees), ("tint", self.tint)] {
            if !value.is_none_or(|value| value.is_finite() && value >= 0.0) {
                return Err(format!("\"{name}\" must be a number that is not below 0"));
            }
        }
        Ok(())
    }
}

/// Options of one light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PerLightOptions {
    /// Bounds of the light.
    pub bounds: Option<BoundsOptions>,
    /// Weight of the light staying where it is.
    #[serde(rename = "stay")]
    pub prior_weight: Option<f32>,
}

/// Lights that may be added.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewLights {
    /// Largest number of new lights.
    pub count: usize,
    /// Type of the new lights.
    #[serde(default, rename = "type")]
    pub kind: NewLightKind,
}

/// Type of an added light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NewLightKind {
    /// A point light as Blender makes it.
    #[default]
    Point,
    /// A rectangular area light.
    Area,
    /// A spot.
    Spot,
    /// A sun.
    Sun,
}

/// Backend that makes the gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// The smoothed gather where there is a bake, else proxies.
    #[default]
    Auto,
    /// Proxies.
    Proxy,
    /// The smoothed gather.
    Gather,
}

/// A goal.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalRequest {
    /// Kind of goal.
    pub goal: GoalKind,
    /// The part of the picture; all of it if absent.
    #[serde(default, rename = "where")]
    pub region: Option<GoalRegion>,
    /// Weight beside other goals.
    #[serde(default = "one")]
    pub weight: f32,
    /// Number of the view, of several.
    #[serde(default)]
    pub view: usize,
    /// Name or path of the picture of a `target`.
    #[serde(default)]
    pub image: Option<String>,
    /// True if the exposure of a `target` does not matter.
    #[serde(default)]
    pub exposure_invariant: bool,
    /// Stops of `brighter`, `darker` and `shadow`.
    #[serde(default)]
    pub stops: Option<f32>,
    /// Mireds of `warmer` and `cooler`.
    #[serde(default)]
    pub mireds: Option<f32>,
    /// Linear RGB of `color`.
    #[serde(default)]
    pub color: Option<[f32; 3]>,
}

fn one() -> f32 {
    1.0
}

/// Kind of a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "their names say it")]
pub enum GoalKind {
    Target,
    Brighter,
    Darker,
    Shadow,
    Color,
    Warmer,
    Cooler,
    Keep,
}

/// The union of strokes, a rectangle and a mask.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct GoalRegion {
    /// Strokes and rectangle.
    #[serde(flatten)]
    pub drawn: Region,
    /// Name or path of a picture whose first channel is the weight.
    #[serde(default)]
    pub mask: Option<String>,
    /// Only pixels of the mask with this value count, such as an object's index.
    #[serde(default)]
    pub equals: Option<f32>,
}

impl SolveOptions {
    /// Bounds of a light, or of the world, by its name.
    pub(super) fn bounds_of(&self, name: &str) -> BoundsOptions {
        self.per_light.get(name).and_then(|per_light| per_light.bounds).unwrap_or_default().or(self.bounds)
    }
}

impl SolveRequest {
    /// Reads a request.
    ///
    /// # Errors
    /// Names the light, the goal or the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        let value: Map<String, Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let is_now = |key: &str| ["lights", "gains", "world", "static"].contains(&key);
        let (mut now, options): (Map<_, _>, Map<_, _>) = value.into_iter().partition(|(key, _)| is_now(key));
        let lights = now.entry("lights").or_insert_with(|| Value::Array(Vec::new()));
        let described = lights.get("lights").unwrap_or(lights).as_array().cloned().unwrap_or_default();
        let now = LiveRequest::from_json(now)?;
        let options: SolveOptions =
            serde_json::from_value(Value::Object(options)).map_err(|error| error.to_string())?;
        let request = Self { now, described, options };
        request.check()?;
        Ok(request)
    }

    /// A light as Blender has it, where it was written so.
    pub(super) fn blender_light(&self, name: &str) -> Option<BlenderLight> {
        let described = self.described.iter().find(|value| value["name"] == name)?;
        serde_json::from_value(described.clone()).ok()
    }

    /// True if a light is a square or a disk in Blender, and has to stay one.
    pub(super) fn has_one_size(&self, name: &str) -> bool {
        let kind = self.blender_light(name).map(|light| light.kind);
        matches!(kind, Some(BlenderLightKind::Area { shape, .. }) if shape.is_even())
    }

    fn check(&self) -> Result<(), String> {
        let options = &self.options;
        let known = |name: &str| name == "world" || self.now.lights.iter().any(|light| light.name == name);
        if let Some(name) = options.free.keys().find(|name| !known(name)) {
            return Err(format!("\"free\" names '{name}', which is not one of the lights"));
        }
        for (name, per_light) in &options.per_light {
            if !known(name) {
                return Err(format!("\"each\" names '{name}', which is not one of the lights"));
            }
            let bounds = per_light.bounds.unwrap_or_default();
            let BoundsOptions { stops, tint, .. } = bounds;
            if name == "world" && bounds != (BoundsOptions { stops, tint, ..BoundsOptions::default() }) {
                let reason =
                    "\"each\": the world is nowhere, so its \"bounds\" can only be \"stops\" and \"tint\"";
                return Err(reason.into());
            }
            bounds.check().map_err(|reason| format!("\"each\": of the bounds of '{name}', {reason}"))?;
            if !per_light.prior_weight.is_none_or(|stay| stay.is_finite() && stay >= 0.0) {
                return Err(format!("\"each\": \"stay\" of '{name}' must not be below 0"));
            }
        }
        options.bounds.check().map_err(|reason| format!("\"bounds\": {reason}"))?;
        if options.from.as_ref().is_some_and(|from| !from.world.iter().all(|value| value.is_finite())) {
            return Err("\"from\": the world's factor must be finite".into());
        }
        if options.add.is_some_and(|add| add.count > MOST_NEW) {
            return Err(format!("\"add\" may ask for {MOST_NEW} lights at most"));
        }
        if options.starts > 1024
            || options.steps > 100_000
            || options.candidates > 1024
            || options.polish > 10_000
        {
            return Err("\"starts\", \"candidates\", \"steps\" or \"polish\" is too large".into());
        }
        let finite = [options.keep_rest, options.prior_weight, options.pixel_fraction, options.learning_rate];
        if !finite.iter().all(|value| value.is_finite() && *value >= 0.0) {
            return Err(
                "\"keep_rest\", \"stay\", \"pixel_fraction\" and \"learning_rate\" must not be below 0"
                    .into(),
            );
        }
        options
            .goals
            .iter()
            .enumerate()
            .try_for_each(|(i, goal)| goal.check().map_err(|reason| format!("goal {}: {reason}", i + 1)))
    }
}

/// More new lights than this cannot be told apart by a picture.
const MOST_NEW: usize = 64;

impl GoalRequest {
    fn check(&self) -> Result<(), String> {
        let numbers = [Some(self.weight), self.stops, self.mireds];
        let colors = self.color.iter().flatten().copied();
        if !numbers.into_iter().flatten().chain(colors).all(|value| value.is_finite() && value >= 0.0) {
            return Err("its numbers must be finite and not below 0".into());
        }
        if self.weight == 0.0 {
            return Err("its weight is 0; leave it out instead".into());
        }
        if let Some(reason) = self.region.as_ref().and_then(|region| region.drawn.fault()) {
            return Err(reason.into());
        }
        match self.goal {
            GoalKind::Target if self.image.is_none() => Err("a target needs an \"image\"".into()),
            GoalKind::Color if self.color.is_none() => Err("a colour needs a \"color\"".into()),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIGHT: &str = r#"{"name": "Key", "shape": {"type": "sphere", "center": [0,0,2], "radius": 0.1}, "radiance": [1,1,1]}"#;

    #[test]
    fn a_request_is_read_and_its_faults_are_named() {
        let read = |rest: &str| SolveRequest::parse(&format!(r#"{{"lights": [{LIGHT}], {rest}}}"#));
        let good = read(
            r#""free": {"Key": ["position", "color"]}, "goals": [{"goal": "brighter", "stops": 1,
                "where": {"rectangle": [0, 0, 1, 1], "mask": "a.png"}}], "add": {"count": 2, "type": "area"}"#,
        );
        let options = good.unwrap().options;
        assert_eq!(options.free["Key"], [FreeParam::Position, FreeParam::Color]);
        assert_eq!(options.goals[0].region.as_ref().unwrap().drawn.rectangle, Some([0.0, 0.0, 1.0, 1.0]));
        let fault = |rest: &str| read(rest).unwrap_err();
        assert!(fault(r#""free": {"Kay": []}"#).contains("'Kay'"));
        assert!(fault(r#""goals": [{"goal": "target"}]"#).contains("goal 1: a target needs"));
        assert!(fault(r#""goals": [{"goal": "brighter", "stops": -1}]"#).contains("goal 1"));
        assert!(fault(r#""goals": [{"goal": "louder"}]"#).contains("louder"));
        assert!(fault(r#""gaols": []"#).contains("gaols"));
        assert!(
            fault(r#""goals": [{"goal": "keep", "where": {"rectangle": [0, 0, 1e9, 1]}}]"#)
                .contains("goal 1")
        );
        assert!(fault(r#""add": {"count": 100000}"#).contains("at most"));
        assert!(fault(r#""add": {"count": 1, "type": "tube"}"#).contains("tube"));
        assert!(SolveRequest::parse("[]").is_err());
    }
    #[test]
    fn what_is_said_of_one_light_is_read_and_its_faults_name_it() {
        let read = |each: &str| SolveRequest::parse(&format!(r#"{{"lights": [{LIGHT}], "each": {each}}}"#));
        let options = read(r#"{"Key": {"bounds": {"max": [1, 1, 1.5]}, "stay": 0.5}, "world": {"stay": 1}}"#);
        let per_light = options.unwrap().options.per_light;
        let bounds = BoundsOptions { max: Some([1.0, 1.0, 1.5]), ..BoundsOptions::default() };
        assert_eq!(per_light["Key"], PerLightOptions { bounds: Some(bounds), prior_weight: Some(0.5) });
        assert_eq!(per_light["world"].prior_weight, Some(1.0));
        let fault = |each: &str| read(each).unwrap_err();
        assert!(fault(r#"{"Kay": {}}"#).contains("'Kay'"));
        assert!(fault(r#"{"Key": {"stay": -1}}"#).contains("\"stay\" of 'Key'"));
        assert!(fault(r#"{"Key": {"box": 1}}"#).contains("box"));
        assert!(fault(r#"{"world": {"bounds": {"min": [0, 0, 0]}}}"#).contains("nowhere"));
        assert!(read(r#"{"world": {"bounds": {"stops": [-1, 1], "tint": 1}}}"#).is_ok());
    }
    #[test]
    fn bounds_that_nothing_is_within_are_named() {
        let read =
            |rest: &str| SolveRequest::parse(&format!(r#"{{"lights": [{LIGHT}], {rest}}}"#)).map(|_| ());
        for (bounds, field) in [
            (r#"{"stops": [1, -1]}"#, "stops"),
            (r#"{"stops": [0, 1e39]}"#, "stops"),
            (r#"{"degrees": -1}"#, "degrees"),
            (r#"{"degrees": 1e39}"#, "degrees"),
            (r#"{"tint": -0.5}"#, "tint"),
        ] {
            let of_all = read(&format!(r#""bounds": {bounds}"#)).unwrap_err();
            assert!(of_all.starts_with(&format!("\"bounds\": \"{field}\" must be")), "{of_all}");
            let one = read(&format!(r#""each": {{"Key": {{"bounds": {bounds}}}}}"#)).unwrap_err();
            assert!(one.contains(&format!("of 'Key', \"{field}\" must be")), "{one}");
        }
        assert_eq!(read(r#""bounds": {"stops": [0, 0], "tint": 0, "degrees": 0}"#), Ok(()));
    }
}
