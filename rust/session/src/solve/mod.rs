//! Solving lights (paper, sections 5.3 and 6.2). In: a request in JSON, bakes, pictures. Out: lights, settings to write
//! into Blender, and a report of each goal.

mod gather_relight;
mod goals;
mod lights;
mod proxy_relight;
mod request;
mod scene_view;
mod search;
mod solved;
mod step_targets;

#[cfg(test)]
mod compare_tests;

use relume_proxy::LightKind;
use relume_scene::Light;
use std::time::Instant;

use crate::error::SessionError;
use crate::files::light_set::LightSet;
use crate::progress::Monitor;
use crate::relight::relighter::Relighter;

pub use goals::Pictures;
use lights::Unknowns;
pub use proxy_relight::ProxyRelight;
pub use request::{
    Answer, Backend, BoundsOptions, FreeParam, GoalKind, GoalRegion, GoalRequest, NewLightKind, NewLights,
    PerLightOptions, SolveOptions, SolveRequest,
};
use scene_view::Scenes;
use search::Search;
pub use solved::{GoalReport, Solved};

/// Receives interim lights.
pub type Preview<'a> = dyn Fn(&InterimLights) + Sync + 'a;

/// Best lights of a running search.
#[derive(Debug, serde::Serialize)]
pub struct InterimLights {
    /// Lights so far, new ones included.
    pub lights: LightSet,
    /// Factor on the light of the world, linear RGB.
    pub world: [f32; 3],
}

/// Solves lights in the views of one or several bakes of one scene.
///
/// # Errors
/// If the request cannot be solved, naming the goal or the light; [`SessionError::Cancelled`].
pub fn solve_lights(
    relighters: &[&Relighter],
    request: &SolveRequest,
    pictures: &Pictures,
    monitor: &Monitor,
    preview: &Preview,
) -> Result<Solved, SessionError> {
    let begin = Instant::now();
    if relighters.is_empty() {
        return Err(SessionError::Settings("no bake is given; name a bake folder".into()));
    }
    if relighters.iter().any(|relighter| relighter.catches_shadows()) {
        let reason = "scenes with shadow catchers cannot be solved yet; turn them off for the solve";
        return Err(SessionError::Settings(reason.into()));
    }
    let options = &request.options;
    if let Some(i) = options.goals.iter().position(|goal| goal.view >= relighters.len()) {
        return Err(SessionError::Settings(format!("goal {}: there is no such view", i + 1)));
    }
    let mut unknowns = Unknowns::new(request, relighters)?;
    let backend = choose_backend(relighters, &unknowns, options.backend)?;
    unknowns.keep_inside_proxies(relighters, backend);
    let goals = relighters.iter().enumerate().map(|(number, relighter)| {
        let camera = relighter.camera();
        goals::goals(&options.goals, number, (camera.width, camera.height), options.keep_rest, pictures)
    });
    let goals = goals.collect::<Result<Vec<_>, SessionError>>()?;
    let scenes = Scenes::new(relighters, request, &unknowns, &goals, backend, monitor)?;
    let search = Search { request, unknowns: &unknowns, scenes: &scenes, monitor, preview };
    let found =
        search.run().map_err(|error| if monitor.cancelled() { SessionError::Cancelled } else { error })?;
    solved::solved(request, &unknowns, &scenes, found, backend, begin, monitor)
}

/// Backend that makes the gradients for all moving lights, in all views.
fn choose_backend(
    relighters: &[&Relighter],
    unknowns: &Unknowns,
    backend: Backend,
) -> Result<Backend, SessionError> {
    let has_gather = relighters.iter().all(|relighter| relighter.gather().is_some());
    match backend {
        Backend::Auto | Backend::Gather if has_gather => return Ok(Backend::Gather),
        Backend::Gather => {
            let reason = "this folder holds no bake to gather from; solve through proxies";
            return Err(SessionError::Settings(reason.into()));
        }
        _ => {}
    }
    let is_known = |light: &Light| relighters.iter().all(|view| view.proxies().knowing(light).is_some());
    let unknown: Vec<&Light> = unknowns.moving().filter(|light| !is_known(light)).collect();
    if unknown.is_empty() {
        return Ok(Backend::Proxy);
    }
    let names: Vec<String> = unknown.iter().map(|light| format!("'{}'", light.name)).collect();
    let next = match (has_gather, unknown.iter().all(|light| LightKind::of_light(light).is_some())) {
        (true, true) => "solve through the bake, or train a proxy that knows them",
        (true, false) => "solve through the bake, or lock all of them but colour and strength",
        (false, true) => "solve in the folder of the bake, or train a proxy that knows them",
        (false, false) => "solve in the folder of the bake",
    };
    Err(SessionError::Settings(format!(
        "no proxy knows lights {}: they are of a type or size that none was trained for, or outside of where one was; {next}",
        names.join(", ")
    )))
}
