use crate::files::light_set::LightSet;
use crate::live::LiveRequest;
use relume_optimise::{Region, Settings};
use relume_scene::{BlenderLight, BlenderLightKind, Light};
use serde::Deserialize;
use serde::de::Error as _;
use serde_json::{Map, Value};
use std::collections::HashMap;

/// What is to be solved, as it is read from JSON. Places are fractions of the picture, (0, 0) its top left corner.
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
/// The first four say how the picture is now, as in [`LiveRequest::parse`]; lights and values that `free` does not name stay.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveRequest {
    /// The picture as it is.
    pub now: LiveRequest,
    /// The lights as they were written.
    pub(crate) described: Vec<Value>,
    /// The rest.
    pub wish: Wish,
}

/// What may change, and to what end.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Wish {
    /// What may change, by the light's name; `world` for the world's colour and strength.
    pub free: HashMap<String, Vec<Freedom>>,
    /// Where lights may go.
    pub bounds: BoundsWish,
    /// What is said of single lights, by their names, in place of `bounds` and `stay`; of the world's bounds only `stops` and `tint`.
    pub each: HashMap<String, Own>,
    /// New lights.
    pub add: Option<Add>,
    /// Whether free lights that do nothing may go.
    pub remove: bool,
    /// What the picture should do.
    pub goals: Vec<GoalWish>,
    /// How much the picture is to stay where no goal says otherwise; 0 for not at all.
    pub keep_rest: f32,
    /// How much lights are drawn to where they are ([`relume_optimise::Variable::stay`]).
    pub stay: f32,
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
    /// Adam's.
    pub learning_rate: f32,
    /// Seed.
    pub seed: u64,
    /// Most steps of the polish by exact pictures; 0 for none.
    pub polish: usize,
    /// What makes the gradients.
    pub through: Through,
    /// Where to start instead of now and in random places: an earlier answer. With 0 steps it is only polished.
    pub from: Option<Answer>,
}

/// Of an earlier answer ([`super::Solved`], whose other fields may be there too).
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Answer {
    /// All lights as they were found.
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

impl Default for Wish {
    fn default() -> Self {
        Self {
            free: HashMap::new(),
            bounds: BoundsWish::default(),
            each: HashMap::new(),
            add: None,
            remove: false,
            goals: Vec::new(),
            keep_rest: 0.0,
            stay: 0.0,
            starts: 4,
            candidates: 16,
            steps: 300,
            pixel_fraction: 0.05,
            least_cells: Settings::default().least_cells,
            learning_rate: 0.05,
            seed: 0,
            polish: 64,
            through: Through::Auto,
            from: None,
        }
    }
}

/// A value of a light that may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names of `relume_optimise::Locks`")]
pub enum Freedom {
    Position,
    Direction,
    Size,
    Cone,
    Color,
    Strength,
}

/// A box for centres, metres, the sizes between which a light may be, and how far it may go from how strong, coloured and
/// directed it is. What is absent is as for all lights; if it is absent there, what the camera sees and its parts, and any strength,
/// colour and direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundsWish {
    /// Lower corner.
    pub min: Option<[f32; 3]>,
    /// Upper corner.
    pub max: Option<[f32; 3]>,
    /// Smallest and largest radius or edge.
    pub size: Option<[f32; 2]>,
    /// Smallest and largest half angle of a sun, radians.
    pub sun: Option<[f32; 2]>,
    /// Smallest and largest half angle of a spot's cone, radians.
    pub cone: Option<[f32; 2]>,
    /// Least and most strength (luminance of the power) by how many stops it is above what it is now. New lights have none to go by.
    pub stops: Option<[f32; 2]>,
    /// By how many stops the ratio of two channels of the colour may at most differ from what it is now; of white, for new lights.
    pub tint: Option<f32>,
    /// Furthest that a spot, an area light or a sun may turn from where it points now, degrees; not for new lights.
    pub degrees: Option<f32>,
}

/// More stops than there are between starlight and the sun.
const MOST_STOPS: f32 = 64.0;

impl BoundsWish {
    /// These, and those of all lights for what is absent.
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

    /// What is wrong with strength, colour and direction.
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

/// What is said of one light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Own {
    /// Where it may go.
    pub bounds: Option<BoundsWish>,
    /// How much it is drawn to where it is.
    pub stay: Option<f32>,
}

/// Lights that may be added.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Add {
    /// At most so many.
    pub count: usize,
    /// What they are.
    #[serde(default, rename = "type")]
    pub kind: NewKind,
}

/// Type of an added light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NewKind {
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

/// What makes the gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Through {
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
pub struct GoalWish {
    /// What is asked for.
    pub goal: GoalKind,
    /// The part of the picture; all of it if absent.
    #[serde(default, rename = "where")]
    pub region: Option<RegionWish>,
    /// Weight beside other goals.
    #[serde(default = "one")]
    pub weight: f32,
    /// Which of several views.
    #[serde(default)]
    pub view: usize,
    /// Of `target`: name or path of a picture.
    #[serde(default)]
    pub image: Option<String>,
    /// Of `target`: whether its exposure does not matter.
    #[serde(default)]
    pub exposure_invariant: bool,
    /// Of `brighter`, `darker` and `shadow`: by how many stops.
    #[serde(default)]
    pub stops: Option<f32>,
    /// Of `warmer` and `cooler`: by how many mireds.
    #[serde(default)]
    pub mireds: Option<f32>,
    /// Of `color`: linear RGB.
    #[serde(default)]
    pub color: Option<[f32; 3]>,
}

fn one() -> f32 {
    1.0
}

/// What a goal is.
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
pub struct RegionWish {
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

impl Wish {
    /// Bounds of a light, or of the world, by its name.
    pub(super) fn bounds_of(&self, name: &str) -> BoundsWish {
        self.each.get(name).and_then(|own| own.bounds).unwrap_or_default().or(self.bounds)
    }
}

impl SolveRequest {
    /// Reads a request.
    ///
    /// # Errors
    /// In words that name the light, the goal or the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        let value: Map<String, Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let is_now = |key: &str| ["lights", "gains", "world", "static"].contains(&key);
        let (mut now, wish): (Map<_, _>, Map<_, _>) = value.into_iter().partition(|(key, _)| is_now(key));
        let lights = now.entry("lights").or_insert_with(|| Value::Array(Vec::new()));
        let described = lights.get("lights").unwrap_or(lights).as_array().cloned().unwrap_or_default();
        let now = LiveRequest::from_json(now)?;
        let wish: Wish = serde_json::from_value(Value::Object(wish)).map_err(|error| error.to_string())?;
        let request = Self { now, described, wish };
        request.check()?;
        Ok(request)
    }

    /// A light as Blender has it, where it was written so.
    pub(super) fn blender_light(&self, name: &str) -> Option<BlenderLight> {
        let described = self.described.iter().find(|value| value["name"] == name)?;
        serde_json::from_value(described.clone()).ok()
    }

    /// Whether a light is a square or a disk in Blender, and is to stay one.
    pub(super) fn has_one_size(&self, name: &str) -> bool {
        let kind = self.blender_light(name).map(|light| light.kind);
        matches!(kind, Some(BlenderLightKind::Area { shape, .. }) if shape.is_even())
    }

    fn check(&self) -> Result<(), String> {
        let wish = &self.wish;
        let known = |name: &str| name == "world" || self.now.lights.iter().any(|light| light.name == name);
        if let Some(name) = wish.free.keys().find(|name| !known(name)) {
            return Err(format!("\"free\" names '{name}', which is not one of the lights"));
        }
        for (name, own) in &wish.each {
            if !known(name) {
                return Err(format!("\"each\" names '{name}', which is not one of the lights"));
            }
            let bounds = own.bounds.unwrap_or_default();
            let BoundsWish { stops, tint, .. } = bounds;
            if name == "world" && bounds != (BoundsWish { stops, tint, ..BoundsWish::default() }) {
                let reason =
                    "\"each\": the world is nowhere, so its \"bounds\" can only be \"stops\" and \"tint\"";
                return Err(reason.into());
            }
            bounds.check().map_err(|reason| format!("\"each\": of the bounds of '{name}', {reason}"))?;
            if !own.stay.is_none_or(|stay| stay.is_finite() && stay >= 0.0) {
                return Err(format!("\"each\": \"stay\" of '{name}' must not be below 0"));
            }
        }
        wish.bounds.check().map_err(|reason| format!("\"bounds\": {reason}"))?;
        if wish.from.as_ref().is_some_and(|from| !from.world.iter().all(|value| value.is_finite())) {
            return Err("\"from\": the world's factor must be finite".into());
        }
        if wish.add.is_some_and(|add| add.count > MOST_NEW) {
            return Err(format!("\"add\" may ask for {MOST_NEW} lights at most"));
        }
        if wish.starts > 1024 || wish.steps > 100_000 || wish.candidates > 1024 || wish.polish > 10_000 {
            return Err("\"starts\", \"candidates\", \"steps\" or \"polish\" is too large".into());
        }
        let finite = [wish.keep_rest, wish.stay, wish.pixel_fraction, wish.learning_rate];
        if !finite.iter().all(|value| value.is_finite() && *value >= 0.0) {
            return Err(
                "\"keep_rest\", \"stay\", \"pixel_fraction\" and \"learning_rate\" must not be below 0"
                    .into(),
            );
        }
        wish.goals
            .iter()
            .enumerate()
            .try_for_each(|(i, goal)| goal.check().map_err(|reason| format!("goal {}: {reason}", i + 1)))
    }
}

/// More new lights than this cannot be told apart by a picture.
const MOST_NEW: usize = 64;

impl GoalWish {
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
        let wish = good.unwrap().wish;
        assert_eq!(wish.free["Key"], [Freedom::Position, Freedom::Color]);
        assert_eq!(wish.goals[0].region.as_ref().unwrap().drawn.rectangle, Some([0.0, 0.0, 1.0, 1.0]));
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
        let wish = read(r#"{"Key": {"bounds": {"max": [1, 1, 1.5]}, "stay": 0.5}, "world": {"stay": 1}}"#);
        let each = wish.unwrap().wish.each;
        let bounds = BoundsWish { max: Some([1.0, 1.0, 1.5]), ..BoundsWish::default() };
        assert_eq!(each["Key"], Own { bounds: Some(bounds), stay: Some(0.5) });
        assert_eq!(each["world"].stay, Some(1.0));
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
            let own = read(&format!(r#""each": {{"Key": {{"bounds": {bounds}}}}}"#)).unwrap_err();
            assert!(own.contains(&format!("of 'Key', \"{field}\" must be")), "{own}");
        }
        assert_eq!(read(r#""bounds": {"stops": [0, 0], "tint": 0, "degrees": 0}"#), Ok(()));
    }
}
