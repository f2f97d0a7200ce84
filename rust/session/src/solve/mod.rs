//! Solving lights (paper, sections 5.3 and 6.2): a request in JSON, bakes, and pictures in; lights, what to write into Blender, and
//! what became of each goal out.

pub(crate) mod bench;
mod gather_relight;
mod goals;
mod lights;
mod look;
mod proxy_relight;
mod request;
mod search;
mod solved;

#[cfg(test)]
mod compare_tests;

use relume_image::Image;
use relume_optimise::{Goal, Relight, View};
use relume_proxy::LightKind;
use relume_scene::Light;
use std::time::Instant;

use crate::progress::Monitor;
use crate::relighter::{RelightOptions, Relighter, With};
use crate::{LightSet, SessionError};

pub use goals::Pictures;
use lights::Unknowns;
pub use request::{
    Add, Answer, BoundsWish, Freedom, GoalKind, GoalWish, NewKind, Own, RegionWish, SolveRequest, Through,
    Wish,
};
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
    let scenes = relighters.iter().enumerate().map(|(number, relighter)| {
        let camera = relighter.camera();
        let goals =
            goals::goals(&wish.goals, number, (camera.width, camera.height), wish.keep_rest, pictures)?;
        SceneView::new(relighter, request, &unknowns, goals, monitor)
    });
    let scenes = scenes.collect::<Result<Vec<_>, SessionError>>()?;
    let search = Search { request, unknowns: &unknowns, scenes: &scenes, through, monitor, preview };
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

/// One view: what is there besides the lights to be solved.
pub(crate) struct SceneView<'a> {
    relighter: &'a Relighter,
    /// Static light, world and lights that stay.
    base: Image,
    /// Pictures for radiance 1 of lights of which only colour or strength may change.
    still: Vec<Option<Image>>,
    /// All as it is now.
    before: Image,
    goals: Vec<Goal>,
}

impl<'a> SceneView<'a> {
    fn new(
        relighter: &'a Relighter,
        request: &SolveRequest,
        unknowns: &Unknowns,
        goals: Vec<Goal>,
        monitor: &Monitor,
    ) -> Result<Self, SessionError> {
        let options = relighter.possible(&RelightOptions { with: With::Auto, denoise: true }, monitor);
        let relit = relighter.relight(&request.now.lights, &options, monitor)?;
        let mut base = Image::new(relit.world.width, relit.world.height, 3);
        base.add_scaled(&relit.static_light, &request.now.static_light);
        let mut before = base.clone();
        before.add_scaled(&relit.world, &request.now.world);
        if unknowns.world.is_none() {
            base.add_scaled(&relit.world, &request.now.world);
        }
        for (i, light) in relit.lights.iter().enumerate() {
            before.add_scaled(&light.image, &[1.0; 3]);
            if !unknowns.solves(i) {
                base.add_scaled(&light.image, &[1.0; 3]);
            }
        }
        let held: Vec<Light> =
            unknowns.held().map(|light| Light { radiance: [1.0; 3], ..light.clone() }).collect();
        let mut units = relighter.unit_images(&held, &options, monitor)?.into_iter();
        let picture = |place: lights::Picture| match place {
            lights::Picture::Moves => None,
            lights::Picture::World => Some(relit.world.clone()),
            lights::Picture::Held => units.next().map(|(image, _)| Image::clone(&image)),
        };
        let still = unknowns.pictures().map(picture).collect();
        Ok(Self { relighter, base, still, before, goals })
    }

    fn view<'b>(&'b self, relight: &'b dyn Relight) -> View<'b> {
        let still = self.still.iter().map(Option::as_ref).collect();
        View { relight, base: &self.base, still, goals: &self.goals }
    }

    fn size(&self) -> (usize, usize) {
        (self.base.width, self.base.height)
    }
}
