//! Solving lights (paper, sections 5.3 and 6.2): a request in JSON, bakes, and pictures in; lights, what to write into Blender, and
//! what became of each goal out.

mod goals;
mod lights;
mod relights;
mod request;
mod solved;

use relume_image::Image;
use relume_optimise::{
    Goal, Polished, Problem, RandomStarts, Relight, RunnerUp, Settings, Solution, Step, View, idle_lights,
    polish, random_starts, solve,
};
use relume_proxy::{GpuProxy, LightKind};
use relume_scene::Light;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use crate::progress::{Monitor, Stage};
use crate::relighter::{RelightOptions, Relighter, With};
use crate::{LightSet, SessionError};

pub use goals::Pictures;
use lights::Unknowns;
use relights::{GatherRelight, Prepared, ProxyRelight};
pub use request::{
    Add, BoundsWish, Freedom, GoalKind, GoalWish, NewKind, RegionWish, SolveRequest, Through, Wish,
};
pub use solved::{GoalReport, Solved};

/// Softness of the smoothed gather at the first and the last step.
const SOFTNESS: [f32; 2] = [0.2, 0.04];

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
    let Some(first) = relighters.first() else {
        return Err(SessionError::Settings("no bake is given; name a bake folder".into()));
    };
    let wish = &request.wish;
    if let Some(i) = wish.goals.iter().position(|goal| goal.view >= relighters.len()) {
        return Err(SessionError::Settings(format!("goal {}: there is no such view", i + 1)));
    }
    let mut unknowns = Unknowns::new(request, first)?;
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
    let found = search.run()?;
    solved::solved(request, &unknowns, &scenes, found, through, begin, monitor)
}

/// What makes the gradients for all moving lights, in all views.
fn through(relighters: &[&Relighter], unknowns: &Unknowns, wanted: Through) -> Result<Through, SessionError> {
    let moving: Vec<&Light> = unknowns.moving().collect();
    let has_gather = relighters.iter().all(|relighter| relighter.gather().is_some());
    let uncovered = |relighter: &&Relighter| {
        moving
            .iter()
            .find(|light| relighter.proxies().covering(light).is_none())
            .map(|light| light.name.clone())
    };
    let without_proxy = relighters.iter().find_map(uncovered);
    match (wanted, without_proxy) {
        (Through::Auto | Through::Gather, _) if has_gather => Ok(Through::Gather),
        (Through::Gather, _) => Err(SessionError::Settings(
            "this folder holds no bake to gather from; solve through proxies".into(),
        )),
        (_, None) => Ok(Through::Proxy),
        (_, Some(name)) => Err(SessionError::Settings(format!(
            "light '{name}' is of a type or size that no proxy was trained for, or outside of where one was; \
             solve through the bake, or train a proxy for it"
        ))),
    }
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
        let options = RelightOptions { with: With::Auto, denoise: true };
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
        let mut units =
            relighter.relight(&held, &options, monitor)?.lights.into_iter().map(|light| light.image);
        let picture = |place: lights::Picture| match place {
            lights::Picture::Moves => None,
            lights::Picture::World => Some(relit.world.clone()),
            lights::Picture::Held => units.next(),
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

/// What a search has found.
pub(crate) struct Found {
    /// In the order of the unknowns.
    lights: Vec<Light>,
    /// What may be better after a polish.
    runner_up: Option<RunnerUp>,
    /// Numbers of those that are not needed.
    idle: Vec<usize>,
    loss: f64,
    start_loss: f64,
    start: usize,
}

/// A proxy on the GPU that is held for a search, and those before it.
struct Held<'a> {
    relighter: &'a Relighter,
    kind: LightKind,
    proxy: &'a GpuProxy,
    before: Option<&'a Held<'a>>,
}

impl<'a> Held<'a> {
    fn find(held: Option<&'a Self>, relighter: &Relighter, kind: LightKind) -> Option<&'a GpuProxy> {
        let held = held?;
        match std::ptr::eq(held.relighter, relighter) && held.kind == kind {
            true => Some(held.proxy),
            false => Self::find(held.before, relighter, kind),
        }
    }
}

struct Search<'a> {
    request: &'a SolveRequest,
    unknowns: &'a Unknowns,
    scenes: &'a [SceneView<'a>],
    through: Through,
    monitor: &'a Monitor,
    preview: &'a Preview<'a>,
}

impl Search<'_> {
    fn run(&self) -> Result<Found, SessionError> {
        let prepared: Vec<Option<Prepared>> =
            self.scenes.iter().map(|scene| Prepared::new(scene.relighter)).collect();
        let gathers =
            self.scenes.iter().zip(&prepared).map(|(scene, prepared)| {
                GatherRelight::new(scene.relighter, prepared.as_ref()?, self.monitor)
            });
        let gathers: Vec<Option<GatherRelight>> = gathers.collect();
        let by_gather: Option<Vec<&dyn Relight>> =
            gathers.iter().map(|gather| gather.as_ref().map(|gather| gather as &dyn Relight)).collect();
        let mut found = match (&by_gather, self.through) {
            (Some(relights), Through::Auto | Through::Gather) => {
                self.explore(&self.problem(relights), SOFTNESS)?
            }
            _ => self.explore_proxies()?,
        };
        if let (Some(relights), true) = (&by_gather, self.request.wish.polish > 0) {
            let problem = self.problem(relights);
            let second = found.runner_up.take();
            let mut candidates = vec![&found.lights[..]];
            candidates.extend(second.iter().map(|second| &second.lights[..]));
            let polished = self.polish(&problem, &candidates)?;
            if let (1, Some(second)) = (polished.candidate, &second) {
                (found.start, found.start_loss) = (second.start, second.start_loss);
            }
            (found.lights, found.loss) = (polished.lights, polished.loss);
            self.drop_idle(&problem, &mut found)?;
        }
        Ok(found)
    }

    fn show(&self, found: &[Light]) {
        let (lights, world) = self.unknowns.all_lights(&self.request.now, found);
        let lights = LightSet { name: "Solving".into(), lights, notes: Vec::new() };
        (self.preview)(&SoFar { lights, world });
    }

    fn problem<'b>(&'b self, relights: &'b [&'b dyn Relight]) -> Problem<'b> {
        let views = self.scenes.iter().zip(relights).map(|(scene, relight)| scene.view(*relight)).collect();
        Problem { views, variables: self.unknowns.variables.clone() }
    }

    /// Through proxies, on the GPU where they are there.
    fn explore_proxies(&self) -> Result<Found, SessionError> {
        let mut kinds = Vec::new();
        for kind in self.unknowns.moving().filter_map(|light| LightKind::of(&light.shape)) {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        let relighters = self.scenes.iter().map(|scene| scene.relighter);
        let wanted = relighters.flat_map(|relighter| kinds.iter().map(move |kind| (relighter, *kind)));
        self.explore_on(&wanted.collect::<Vec<_>>(), &kinds, None)
    }

    /// Takes hold of the wanted proxies on the GPU, one after the other, then explores.
    fn explore_on(
        &self,
        wanted: &[(&Relighter, LightKind)],
        kinds: &[LightKind],
        held: Option<&Held>,
    ) -> Result<Found, SessionError> {
        let Some(((relighter, kind), rest)) = wanted.split_first() else {
            let proxies = self.scenes.iter().map(|scene| ProxyRelight {
                proxies: scene.relighter.proxies(),
                kinds: kinds.iter().map(|kind| (*kind, Held::find(held, scene.relighter, *kind))).collect(),
                size: scene.size(),
            });
            let proxies: Vec<ProxyRelight> = proxies.collect();
            let relights: Vec<&dyn Relight> = proxies.iter().map(|proxy| proxy as &dyn Relight).collect();
            return self.explore(&self.problem(&relights), [0.0; 2]);
        };
        let found = match Held::find(held, relighter, *kind) {
            Some(_) => None, // By a view before, of the same bake.
            None => relighter.on_gpu_proxy(*kind, self.monitor, |proxy| {
                self.explore_on(rest, kinds, Some(&Held { relighter, kind: *kind, proxy, before: held }))
            })?,
        };
        found.map_or_else(|| self.explore_on(rest, kinds, held), Ok)
    }

    fn explore(&self, problem: &Problem, softness: [f32; 2]) -> Result<Found, SessionError> {
        let wish = &self.request.wish;
        let settings = Settings {
            iterations: wish.steps,
            learning_rate: wish.learning_rate,
            pixel_fraction: wish.pixel_fraction,
            softness,
            seed: wish.seed,
        };
        let random = RandomStarts {
            count: wish.starts.max(1),
            candidates: wish.candidates,
            softness: softness[0],
            seed: wish.seed,
        };
        let starts = self.unknowns.starts(random_starts(problem, &random)?);
        let stage = self.monitor.stage(Stage::Optimise, 0, wish.steps as u64);
        let furthest = AtomicU64::new(0);
        let best = Mutex::new(f64::INFINITY);
        let on_step = |step: Step| {
            let done = step.iteration as u64 + 1;
            if furthest.fetch_max(done, Ordering::Relaxed) < done {
                let starts =
                    if step.starts > 1 { format!("{} starts, ", step.starts) } else { String::new() };
                stage.set(done, &format!("{starts}loss {:.2e}", step.loss));
            }
            if let Ok(mut best) = best.lock()
                && (step.loss < *best || step.starts == 1)
            {
                *best = step.loss;
                self.show(step.lights);
            }
            if self.monitor.cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let solution = solve(problem, &starts, &settings, &on_step)?;
        if solution.cancelled {
            return Err(SessionError::Cancelled);
        }
        let Solution { lights, runner_up, loss, start_loss, start, .. } = solution;
        Ok(Found { lights, runner_up, idle: Vec::new(), loss, start_loss, start })
    }

    fn polish(&self, problem: &Problem, candidates: &[&[Light]]) -> Result<Polished, SessionError> {
        let steps = self.request.wish.polish;
        let stage = self.monitor.stage(Stage::Polish, 0, steps as u64);
        let polished = polish(problem, candidates, steps, &mut |step| {
            stage.set(step.iteration as u64 + 1, &format!("loss {:.2e}", step.loss));
            self.show(step.lights);
            if self.monitor.cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        if self.monitor.cancelled() { Err(SessionError::Cancelled) } else { Ok(polished) }
    }

    /// Finds lights that are not needed, and polishes the others without them.
    fn drop_idle(&self, problem: &Problem, found: &mut Found) -> Result<(), SessionError> {
        let may_go = self.unknowns.may_go(self.request.wish.remove);
        found.idle = idle_lights(problem, &found.lights, &may_go, 0.0)?;
        let kept: Vec<usize> = (0..found.lights.len()).filter(|i| !found.idle.contains(i)).collect();
        if found.idle.is_empty() || kept.is_empty() {
            return Ok(());
        }
        let mut rest = problem.clone();
        rest.variables = kept.iter().map(|i| problem.variables[*i].clone()).collect();
        for view in &mut rest.views {
            view.still = kept.iter().map(|i| view.still[*i]).collect();
        }
        let lights: Vec<Light> = kept.iter().map(|i| found.lights[*i].clone()).collect();
        let polished = self.polish(&rest, &[&lights])?;
        found.loss = polished.loss;
        for (i, light) in kept.into_iter().zip(polished.lights) {
            found.lights[i] = light;
        }
        Ok(())
    }
}
