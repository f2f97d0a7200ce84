//! Solving lights (paper, sections 5.3 and 6.2): a request in JSON, bakes, and pictures in; lights, what to write into Blender, and
//! what became of each goal out.

mod gather_relight;
mod goals;
mod lights;
mod look;
mod proxy_relight;
mod request;
mod scene_view;
mod search;
mod solved;

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
    Add, Answer, BoundsWish, Freedom, GoalKind, GoalWish, NewKind, Own, RegionWish, SolveRequest, Through,
    Wish,
};
use scene_view::Scenes;
use search::Search;
pub use solved::{GoalReport, Solved};

/// Takes what there is so far.
pub type Preview<'a> = dyn Fn(&SoFar) + Sync + 'a;

/// The best of a search that goes on.
#[derive(Debug, serde::Serialize)]
pub struct SoFar {
    /// All lights, new ones included.
    pub lights: LightSet,
    /// Factor on the light of the world, linear RGB.
    pub world: [f32; 3],
}

/// Solves lights as they are seen from one or several bakes of one scene.
///
/// # Errors
/// If the request cannot be solved, in words that name the goal or the light; [`SessionError::Cancelled`].
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
    let wish = &request.wish;
    if let Some(i) = wish.goals.iter().position(|goal| goal.view >= relighters.len()) {
        return Err(SessionError::Settings(format!("goal {}: there is no such view", i + 1)));
    }
    let mut unknowns = Unknowns::new(request, relighters)?;
    let through = through(relighters, &unknowns, wish.through)?;
    unknowns.keep_inside_proxies(relighters, through);
    let goals = relighters.iter().enumerate().map(|(number, relighter)| {
        let camera = relighter.camera();
        goals::goals(&wish.goals, number, (camera.width, camera.height), wish.keep_rest, pictures)
    });
    let goals = goals.collect::<Result<Vec<_>, SessionError>>()?;
    let scenes = Scenes::new(relighters, request, &unknowns, &goals, through, monitor)?;
    let search = Search { request, unknowns: &unknowns, scenes: &scenes, monitor, preview };
    let found =
        search.run().map_err(|error| if monitor.cancelled() { SessionError::Cancelled } else { error })?;
    solved::solved(request, &unknowns, &scenes, found, through, begin, monitor)
}

/// What makes the gradients for all moving lights, in all views.
fn through(relighters: &[&Relighter], unknowns: &Unknowns, wanted: Through) -> Result<Through, SessionError> {
    let has_gather = relighters.iter().all(|relighter| relighter.gather().is_some());
    match wanted {
        Through::Auto | Through::Gather if has_gather => return Ok(Through::Gather),
        Through::Gather => {
            let reason = "this folder holds no bake to gather from; solve through proxies";
            return Err(SessionError::Settings(reason.into()));
        }
        _ => {}
    }
    let is_known = |light: &Light| relighters.iter().all(|view| view.proxies().knowing(light).is_some());
    let unknown: Vec<&Light> = unknowns.moving().filter(|light| !is_known(light)).collect();
    if unknown.is_empty() {
        return Ok(Through::Proxy);
    }
    let names: Vec<String> = unknown.iter().map(|light| format!("'{}'", light.name)).collect();
    let next = match (has_gather, unknown.iter().all(|light| LightKind::of(&light.shape).is_some())) {
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
