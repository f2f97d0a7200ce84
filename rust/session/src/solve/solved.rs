use relume_optimise::{Criterion, Goal, Report, Worst, conflicts, report};
use relume_scene::{BlenderLight, BlenderLightKind, Light};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::HashSet;
use std::time::Instant;

use super::lights::{Unknowns, VariableSource};
use super::request::{Backend, GoalKind, SolveRequest};
use super::scene_view::{SceneView, Scenes, ViewPictures};
use super::search::SearchResult;
use crate::error::SessionError;
use crate::files::light_set::LightSet;
use crate::progress::Monitor;

/// Least differences of a part of the picture that are reported: a fiftieth, what may change on average, and as little
/// warmth.
const TOLD_STOPS: f32 = 0.03;
const TOLD_MIREDS: f32 = 5.0;

/// Solved lights.
#[derive(Clone, Debug, Serialize)]
pub struct Solved {
    /// Lights of the answer, gains multiplied in; removed ones are absent.
    pub lights: LightSet,
    /// Factor on the world's light.
    pub world: [f32; 3],
    /// Names of solved lights that hardly any path of a bake meets, so that their pictures are noise. Bake towards the
    /// answer ([`relume_trace::TraceSettings::guide_targets`]) and solve on from it ([`super::SolveOptions::from`]).
    pub changed: Vec<String>,
    /// Names of new ones.
    pub added: Vec<String>,
    /// Names of those that are not needed.
    pub removed: Vec<String>,
    /// Settings of Blender's lights for what was changed or added.
    pub blender: Vec<Value>,
    /// Report of each goal.
    pub report: Vec<GoalReport>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
    /// Names of solved lights that hardly any path of a bake meets, so that their pictures are noise. Bake towards the
    /// answer ([`relume_trace::TraceSettings::guide_targets`]) and solve on from it ([`super::SolveOptions::from`]).
    #[serde(rename = "rarely_met")]
    pub under_sampled: Vec<String>,
    /// Loss at the end.
    pub loss: f64,
    /// The loss at the start that it was found from.
    pub start_loss: f64,
    /// Number of that start; 0 is the lights as they were.
    pub start: usize,
    /// Loss of each step of the exploration. Each looks at other cells, and lights are softest at the first.
    pub losses: Vec<f64>,
    /// `gather` or `proxy`.
    #[serde(rename = "through")]
    pub backend: &'static str,
    /// Time that it took.
    pub seconds: f64,
}

/// Report of a goal, with a text.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalReport {
    /// Number of the goal in the request.
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
    scenes: &Scenes,
    found: SearchResult,
    backend: Backend,
    begin: Instant,
    monitor: &Monitor,
) -> Result<Solved, SessionError> {
    let mut new = NewLightSet::new(request, unknowns, &found);
    new.describe(request)?;
    let mut report = Vec::new();
    let mut warnings = new.warnings;
    let scenes = scenes.judging();
    for (number, scene) in scenes.iter().enumerate() {
        scene.relighter.warn_of(&new.lights, monitor);
        let after = scene.picture(&found.lit(), monitor)?;
        report.extend(reports(request, number, scene, &after).map(|report| in_words(request, report)));
        warnings.extend(conflict_lines(request, number, scene));
    }
    report.sort_by_key(|report| report.number);
    let is_solved = |light: &&Light| new.changed.contains(&light.name) || new.added.contains(&light.name);
    let is_under_sampled =
        |light: &&Light| scenes.iter().any(|scene| scene.relighter.is_under_sampled(light));
    let under_sampled = new.lights.iter().filter(is_solved).filter(is_under_sampled);
    let under_sampled = under_sampled.map(|light| light.name.clone()).collect();
    Ok(Solved {
        lights: LightSet { name: "Solved".into(), lights: new.lights, notes: Vec::new() },
        world: new.world,
        changed: new.changed,
        added: new.added,
        removed: new.removed,
        blender: new.blender,
        report,
        warnings,
        under_sampled,
        loss: found.loss,
        start_loss: found.start_loss,
        start: found.start,
        losses: found.losses,
        backend: if backend == Backend::Proxy { "proxy" } else { "gather" },
        seconds: begin.elapsed().as_secs_f64(),
    })
}

/// The lights as they should be, and which of them are other than before.
struct NewLightSet {
    lights: Vec<Light>,
    world: [f32; 3],
    changed: Vec<String>,
    added: Vec<String>,
    removed: Vec<String>,
    blender: Vec<Value>,
    warnings: Vec<String>,
}

impl NewLightSet {
    fn new(request: &SolveRequest, unknowns: &Unknowns, found: &SearchResult) -> Self {
        let (mut lights, world) = unknowns.all_lights(&request.now, &found.lights);
        let mut taken: HashSet<String> = request.now.lights.iter().map(|light| light.name.clone()).collect();
        let (mut changed, mut added, mut gone) = (Vec::new(), Vec::new(), Vec::new());
        let mut next_new = request.now.lights.len();
        for (i, source) in unknowns.sources.iter().enumerate() {
            let is_idle = found.idle.contains(&i);
            match source {
                VariableSource::World => {}
                VariableSource::Scene(place) if is_idle => gone.push(*place),
                VariableSource::Scene(place) => changed.push(lights[*place].name.clone()),
                VariableSource::New => {
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
            let settings = match request.blender_light(&light.name) {
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

/// Numbers in the request of a view's goals.
fn numbers(request: &SolveRequest, view: usize) -> Vec<usize> {
    let goals = request.options.goals.iter().enumerate();
    goals.filter(|(_, goal)| goal.view == view).map(|(number, _)| number).collect()
}

/// Reports of the goals in one view, with their numbers.
pub(super) fn reports<'a>(
    request: &SolveRequest,
    view: usize,
    scene: &'a SceneView,
    after: &'a ViewPictures,
) -> impl Iterator<Item = (usize, Report)> + use<'a> {
    let goals = numbers(request, view).into_iter().zip(&scene.goals);
    goals.map(|(number, goal)| (number, goal_report(goal, scene, after)))
}

/// Report of a goal, by the picture without noise or the noisy one, whichever is worse. Noise is no difference from a target
/// where the former is right.
fn goal_report(goal: &Goal, scene: &SceneView, after: &ViewPictures) -> Report {
    let clean = report(goal, &scene.before.clean, &after.clean);
    if scene.is_connected && matches!(goal.criterion, Criterion::Target { .. }) {
        return clean;
    }
    clean.or_worse(report(goal, &scene.before.exact, &after.exact))
}

fn in_words(request: &SolveRequest, (number, report): (usize, Report)) -> GoalReport {
    GoalReport { number, text: text(request.options.goals[number].goal, number, &report), report }
}

fn text(kind: GoalKind, number: usize, report: &Report) -> String {
    let verdict = if report.met { "reached" } else { "not reached" };
    let (asked, is) = (report.asked.unwrap_or_default().abs(), report.reached);
    let done = is * report.asked.unwrap_or(1.0).signum();
    let what = match kind {
        GoalKind::Target => {
            let worst = report.worst.filter(|_| !report.met);
            let words = [["too dark", "too bright"], ["too cool", "too warm"], ["too magenta", "too green"]];
            let most = largest_difference("; most is missing", worst, words);
            format!("target: {is:.1} dB (was {:.1}), {verdict}{most}", report.before)
        }
        GoalKind::Brighter => format!("brighter: {done:+.2} of {asked:.2} stops, {verdict}"),
        GoalKind::Darker => format!("darker: {done:.2} of {asked:.2} stops, {verdict}"),
        GoalKind::Shadow => format!("shadow: {done:.2} of {asked:.2} stops, {verdict}"),
        GoalKind::Color => format!("colour: {is:.2} away (was {:.2}), {verdict}", report.before),
        GoalKind::Warmer => format!("warmer: {done:.0} of {asked:.0} mireds, {verdict}"),
        GoalKind::Cooler => format!("cooler: {done:.0} of {asked:.0} mireds, {verdict}"),
        GoalKind::Keep => {
            let words = [["darker", "brighter"], ["cooler", "warmer"], ["more magenta", "greener"]];
            let most = largest_difference("; most", report.worst, words);
            format!("keep: changed by {:.1} %, {verdict}{most}", 100.0 * is)
        }
    };
    format!("Goal {}, {what}", number + 1)
}

/// Words for too little and too much of a value.
type SideWords = [&'static str; 2];

/// Largest difference of a picture from its goal, such as "; most at the top left: 0.30 stops darker, 40 mireds
/// warmer". Empty if nobody would see it. The sides are words for light, warmth and green.
fn largest_difference(begin: &str, worst: Option<Worst>, [light, warmth, green]: [SideWords; 3]) -> String {
    let Some(worst) = worst else { return String::new() };
    let side = |off: f32, [missing, too_much]: SideWords| if off > 0.0 { missing } else { too_much };
    let stops = |off: f32, sides: SideWords| {
        (off.abs() > TOLD_STOPS).then(|| format!("{:.2} stops {}", off.abs(), side(off, sides)))
    };
    let mireds = (worst.mireds.abs() > TOLD_MIREDS)
        .then(|| format!("{:.0} mireds {}", worst.mireds.abs(), side(worst.mireds, warmth)));
    let differences = [stops(worst.off, light), mireds, stops(worst.green, green)];
    let differences: Vec<String> = differences.into_iter().flatten().collect();
    if differences.is_empty() {
        return String::new();
    }
    format!("{begin} at the {}: {}", tile_position(&worst), differences.join(", "))
}

/// Place of a tile, such as "top left".
fn tile_position(worst: &Worst) -> String {
    let third = |fraction: f32, names: [&'static str; 3]| names[((fraction * 3.0) as usize).min(2)];
    let x = third(worst.x, ["left", "middle", "right"]);
    format!("{} {x}", third(worst.y, ["top", "middle", "bottom"]))
}

fn conflict_lines(request: &SolveRequest, view: usize, scene: &SceneView) -> Vec<String> {
    let numbers = numbers(request, view);
    let asked = &scene.goals[..numbers.len().min(scene.goals.len())];
    let line = |(a, b): (usize, usize)| {
        format!("Goals {} and {} contradict each other in the same place", numbers[a] + 1, numbers[b] + 1)
    };
    conflicts(asked, &scene.before.clean).into_iter().map(line).collect()
}
