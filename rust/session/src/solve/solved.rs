use relume_image::Image;
use relume_optimise::{Report, Worst, conflicts, report};
use relume_scene::{BlenderLight, BlenderLightKind, Light};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::HashSet;
use std::time::Instant;

use super::SceneView;
use super::lights::{Source, Unknowns};
use super::request::{GoalKind, SolveRequest, Through};
use super::search::Found;
use crate::progress::Monitor;
use crate::relighter::{RelightOptions, With};
use crate::{LightSet, SessionError};

/// Change of a part of what is to be kept from which it is told: a fiftieth, what may change on average.
const TOLD_STOPS: f32 = 0.03;

/// Solved lights.
#[derive(Clone, Debug, Serialize)]
pub struct Solved {
    /// All lights as they should be, gains multiplied in; removed ones are absent.
    pub lights: LightSet,
    /// Factor on the world's light.
    pub world: [f32; 3],
    /// Names of lights that were solved.
    pub changed: Vec<String>,
    /// Names of new ones.
    pub added: Vec<String>,
    /// Names of those that are not needed.
    pub removed: Vec<String>,
    /// Settings of Blender's lights for what was changed or added.
    pub blender: Vec<Value>,
    /// What became of each goal.
    pub report: Vec<GoalReport>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Names of lights that were solved and that hardly any path of a bake meets where they are now, so that all that is said of
    /// them is noise. Bake towards the answer ([`relume_trace::TraceSettings::towards`]) and solve on from it ([`super::Wish::from`]).
    pub rarely_met: Vec<String>,
    /// What is left of the loss.
    pub loss: f64,
    /// The loss at the start that it was found from.
    pub start_loss: f64,
    /// Number of that start; 0 is the lights as they were.
    pub start: usize,
    /// `gather` or `proxy`.
    pub through: &'static str,
    /// Time that it took.
    pub seconds: f64,
}

/// What became of a goal, and in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalReport {
    /// Its number in the request.
    pub number: usize,
    /// The figures.
    #[serde(flatten)]
    pub report: Report,
    /// One line for the artist.
    pub text: String,
}

pub(super) fn solved(
    request: &SolveRequest,
    unknowns: &Unknowns,
    scenes: &[SceneView],
    found: Found,
    through: Through,
    begin: Instant,
    monitor: &Monitor,
) -> Result<Solved, SessionError> {
    let mut new = Outcome::new(request, unknowns, &found);
    new.describe(request)?;
    let mut report = Vec::new();
    let mut warnings = new.warnings;
    for (number, scene) in scenes.iter().enumerate() {
        let after = picture(scene, request, &new.lights, new.world, monitor)?;
        report.extend(reports(request, number, scene, &after));
        warnings.extend(conflict_lines(request, number, scene));
    }
    report.sort_by_key(|report| report.number);
    let is_solved = |light: &&Light| new.changed.contains(&light.name) || new.added.contains(&light.name);
    let is_missed = |light: &&Light| scenes.iter().any(|scene| scene.relighter.misses(light));
    let rarely_met = new.lights.iter().filter(is_solved).filter(is_missed);
    let rarely_met = rarely_met.map(|light| light.name.clone()).collect();
    Ok(Solved {
        lights: LightSet { name: "Solved".into(), lights: new.lights, notes: Vec::new() },
        world: new.world,
        changed: new.changed,
        added: new.added,
        removed: new.removed,
        blender: new.blender,
        report,
        warnings,
        rarely_met,
        loss: found.loss,
        start_loss: found.start_loss,
        start: found.start,
        through: if through == Through::Proxy { "proxy" } else { "gather" },
        seconds: begin.elapsed().as_secs_f64(),
    })
}

/// The lights as they should be, and which of them are other than before.
struct Outcome {
    lights: Vec<Light>,
    world: [f32; 3],
    changed: Vec<String>,
    added: Vec<String>,
    removed: Vec<String>,
    blender: Vec<Value>,
    warnings: Vec<String>,
}

impl Outcome {
    fn new(request: &SolveRequest, unknowns: &Unknowns, found: &Found) -> Self {
        let (mut lights, world) = unknowns.all_lights(&request.now, &found.lights);
        let mut taken: HashSet<String> = request.now.lights.iter().map(|light| light.name.clone()).collect();
        let (mut changed, mut added, mut gone) = (Vec::new(), Vec::new(), Vec::new());
        let mut next_new = request.now.lights.len();
        for (i, source) in unknowns.sources.iter().enumerate() {
            let is_idle = found.idle.contains(&i);
            match source {
                Source::World => {}
                Source::Scene(place) if is_idle => gone.push(*place),
                Source::Scene(place) => changed.push(lights[*place].name.clone()),
                Source::New => {
                    if is_idle {
                        gone.push(next_new);
                    } else {
                        lights[next_new].name = free_name(&mut taken);
                        added.push(lights[next_new].name.clone());
                    }
                    next_new += 1;
                }
            }
        }
        let named = gone.iter().filter(|place| **place < request.now.lights.len());
        let removed = named.map(|place| lights[*place].name.clone()).collect();
        let kept = lights.into_iter().enumerate().filter(|(place, _)| !gone.contains(place));
        let lights = kept.map(|(_, light)| light).collect();
        Self { lights, world, changed, added, removed, blender: Vec::new(), warnings: Vec::new() }
    }

    /// Settings of Blender's lights. A light that Blender cannot have is a warning.
    fn describe(&mut self, request: &SolveRequest) -> Result<(), SessionError> {
        for light in
            self.lights.iter().filter(|l| self.changed.contains(&l.name) || self.added.contains(&l.name))
        {
            let described = request.described.iter().find(|value| value["name"] == light.name.as_str());
            let blender =
                described.and_then(|value| serde_json::from_value::<BlenderLight>(value.clone()).ok());
            let settings = match blender {
                Some(blender) => blender.with_light(light),
                None => BlenderLight::from_light(light),
            };
            match settings {
                Ok(settings) => self.blender.push(flat(&settings)),
                Err(error) => self.warnings.push(error.to_string()),
            }
        }
        Ok(())
    }
}

/// `Relume Light`, `Relume Light.001`, ...
fn free_name(taken: &mut HashSet<String>) -> String {
    let name = |number: usize| match number {
        0 => "Relume Light".to_string(),
        _ => format!("Relume Light.{number:03}"),
    };
    let name = (0..).map(name).find(|name| !taken.contains(name)).unwrap_or_default();
    taken.insert(name.clone());
    name
}

/// Settings under the names of Blender's properties.
fn flat(light: &BlenderLight) -> Value {
    let mut settings = Map::new();
    let mut set = |key: &str, value: Value| {
        settings.insert(key.into(), value);
    };
    set("name", json!(light.name));
    set("world_from_object", json!(light.world_from_object));
    set("energy", json!(light.energy));
    set("color", json!(light.color));
    match light.kind {
        BlenderLightKind::Point { radius, soft_falloff } => {
            set("type", json!("POINT"));
            set("radius", json!(radius));
            set("use_soft_falloff", json!(soft_falloff));
        }
        BlenderLightKind::Spot { radius, soft_falloff, spot_size, spot_blend } => {
            set("type", json!("SPOT"));
            set("radius", json!(radius));
            set("use_soft_falloff", json!(soft_falloff));
            set("spot_size", json!(spot_size));
            set("spot_blend", json!(spot_blend));
        }
        BlenderLightKind::Sun { angle } => {
            set("type", json!("SUN"));
            set("angle", json!(angle));
        }
        BlenderLightKind::Area { shape, size, size_y, spread } => {
            set("type", json!("AREA"));
            set("shape", json!(shape));
            set("size", json!(size));
            set("size_y", json!(size_y));
            set("spread", json!(spread));
        }
    }
    Value::Object(settings)
}

/// The view under some lights.
fn picture(
    scene: &SceneView,
    request: &SolveRequest,
    lights: &[Light],
    world: [f32; 3],
    monitor: &Monitor,
) -> Result<Image, SessionError> {
    let options = RelightOptions { with: With::Auto, denoise: true };
    let relit = scene.relighter.relight(lights, &options, monitor)?;
    let mut sum = Image::new(relit.world.width, relit.world.height, 3);
    sum.add_scaled(&relit.static_light, &request.now.static_light);
    sum.add_scaled(&relit.world, &world);
    relit.lights.iter().for_each(|light| sum.add_scaled(&light.image, &[1.0; 3]));
    Ok(sum)
}

/// Numbers in the request of a view's goals.
fn numbers(request: &SolveRequest, view: usize) -> Vec<usize> {
    let goals = request.wish.goals.iter().enumerate();
    goals.filter(|(_, goal)| goal.view == view).map(|(number, _)| number).collect()
}

fn reports(request: &SolveRequest, view: usize, scene: &SceneView, after: &Image) -> Vec<GoalReport> {
    let of = |(goal, number): (&relume_optimise::Goal, usize)| {
        let report = report(goal, &scene.before, after);
        let text = text(request.wish.goals[number].goal, number, &report);
        GoalReport { number, report, text }
    };
    scene.goals.iter().zip(numbers(request, view)).map(of).collect()
}

fn text(kind: GoalKind, number: usize, report: &Report) -> String {
    let verdict = if report.met { "reached" } else { "not reached" };
    let (asked, is) = (report.asked.unwrap_or_default().abs(), report.reached);
    let done = is * report.asked.unwrap_or(1.0).signum();
    let what = match kind {
        GoalKind::Target => {
            let place = report.worst.filter(|_| !report.met).map(|worst| {
                let side = if worst.off > 0.0 { "too dark" } else { "too bright" };
                format!("; most is missing at the {}: {:.1} stops {side}", place(&worst), worst.off.abs())
            });
            format!("target: {is:.1} dB (was {:.1}), {verdict}{}", report.before, place.unwrap_or_default())
        }
        GoalKind::Brighter => format!("brighter: {done:+.2} of {asked:.2} stops, {verdict}"),
        GoalKind::Darker | GoalKind::Shadow => format!("darker: {done:.2} of {asked:.2} stops, {verdict}"),
        GoalKind::Color => format!("colour: {is:.2} away (was {:.2}), {verdict}", report.before),
        GoalKind::Warmer => format!("warmer: {done:.0} of {asked:.0} mireds, {verdict}"),
        GoalKind::Cooler => format!("cooler: {done:.0} of {asked:.0} mireds, {verdict}"),
        GoalKind::Keep => {
            let place = report.worst.filter(|worst| worst.off.abs() > TOLD_STOPS).map(|worst| {
                let side = if worst.off > 0.0 { "darker" } else { "brighter" };
                format!("; most at the {}: {:.2} stops {side}", place(&worst), worst.off.abs())
            });
            format!("keep: changed by {:.1} %, {verdict}{}", 100.0 * is, place.unwrap_or_default())
        }
    };
    format!("Goal {}, {what}", number + 1)
}

/// Where a tile is, such as "top left".
fn place(worst: &Worst) -> String {
    let third = |fraction: f32, names: [&'static str; 3]| names[((fraction * 3.0) as usize).min(2)];
    let x = third(worst.x, ["left", "middle", "right"]);
    format!("{} {x}", third(worst.y, ["top", "middle", "bottom"]))
}

fn conflict_lines(request: &SolveRequest, view: usize, scene: &SceneView) -> Vec<String> {
    let numbers = numbers(request, view);
    let asked = &scene.goals[..numbers.len().min(scene.goals.len())];
    let line = |(a, b): (usize, usize)| {
        format!("Goals {} and {} ask for opposite things in the same place", numbers[a] + 1, numbers[b] + 1)
    };
    conflicts(asked).into_iter().map(line).collect()
}
