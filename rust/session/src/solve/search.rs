use relume_optimise::{
    Polished, Problem, RandomStarts, Relight, RunnerUp, Settings, Solution, Step, idle_lights, polish,
    random_starts, regroupings, solve,
};
use relume_proxy::{GpuProxy, LightKind};
use relume_scene::Light;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::gather_relight::{GatherRelight, Prepared};
use super::lights::Unknowns;
use super::proxy_relight::ProxyRelight;
use super::{Preview, SceneView, SoFar, SolveRequest, Through, Wish};
use crate::progress::{Monitor, Stage};
use crate::relighter::Relighter;
use crate::{LightSet, SessionError};

/// Softness of the smoothed gather at the first and the last step.
const SOFTNESS: [f32; 2] = [0.2, 0.04];
/// Lights are regrouped so often at most, and so many arrangements tried each time.
const MOST_REGROUPINGS: usize = 3;
const REGROUPINGS_TRIED: usize = 4;
/// Share of the loss that a regrouping may leave.
const REGROUPING_PAYS: f64 = 0.8;
/// Loss from which on a picture is better solved again: differences of a hundredth of white.
const VISIBLE: f64 = 1e-4;

/// What a search has found.
pub(super) struct Found {
    /// In the order of the unknowns.
    pub lights: Vec<Light>,
    /// Numbers of those that are not needed.
    pub idle: Vec<usize>,
    pub loss: f64,
    pub start_loss: f64,
    pub start: usize,
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

/// Explores, polishes, regroups and drops (`docs/solve.md`).
pub(super) struct Search<'a> {
    pub request: &'a SolveRequest,
    pub unknowns: &'a Unknowns,
    pub scenes: &'a [SceneView<'a>],
    pub through: Through,
    pub monitor: &'a Monitor,
    pub preview: &'a Preview<'a>,
}

impl Search<'_> {
    pub fn run(&self) -> Result<Found, SessionError> {
        let prepared: Vec<Option<Prepared>> =
            self.scenes.iter().map(|scene| Prepared::new(scene.relighter)).collect();
        let gathers =
            self.scenes.iter().zip(&prepared).map(|(scene, prepared)| {
                GatherRelight::new(scene.relighter, prepared.as_ref()?, self.monitor)
            });
        let gathers: Vec<Option<GatherRelight>> = gathers.collect();
        let by_gather: Option<Vec<&dyn Relight>> =
            gathers.iter().map(|gather| gather.as_ref().map(|gather| gather as &dyn Relight)).collect();
        let explored = match (&by_gather, self.through) {
            (Some(relights), Through::Auto | Through::Gather) => {
                self.explore(&self.problem(relights), SOFTNESS)?
            }
            _ => self.explore_proxies()?,
        };
        let Solution { lights, runner_up, loss, start_loss, start, .. } = explored;
        let mut found = Found { lights, idle: Vec::new(), loss, start_loss, start };
        if let (Some(relights), true) = (&by_gather, self.request.wish.polish > 0) {
            let problem = self.problem(relights);
            let polished = self.polish(&problem, &candidates(&found.lights, runner_up.as_ref()))?;
            if let (1, Some(second)) = (polished.candidate, runner_up) {
                (found.start, found.start_loss) = (second.start, second.start_loss);
            }
            (found.lights, found.loss) = (polished.lights, polished.loss);
            if self.request.wish.starts > 1 && self.request.wish.steps > 0 {
                self.regroup(&problem, &mut found)?;
            }
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
    fn explore_proxies(&self) -> Result<Solution, SessionError> {
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
    ) -> Result<Solution, SessionError> {
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

    fn explore(&self, problem: &Problem, softness: [f32; 2]) -> Result<Solution, SessionError> {
        let wish = &self.request.wish;
        let random = RandomStarts {
            count: wish.starts.max(1),
            candidates: wish.candidates,
            softness: softness[0],
            seed: wish.seed,
        };
        let starts = match &wish.from {
            Some(answer) => vec![self.unknowns.of_answer(&self.request.now, answer)?],
            None => self.unknowns.starts(random_starts(problem, &random)?),
        };
        self.race(problem, &starts, wish.steps, softness)
    }

    fn race(
        &self,
        problem: &Problem,
        starts: &[Vec<Light>],
        iterations: usize,
        softness: [f32; 2],
    ) -> Result<Solution, SessionError> {
        let Wish { learning_rate, pixel_fraction, seed, .. } = self.request.wish;
        let settings = Settings { iterations, learning_rate, pixel_fraction, softness, seed };
        let stage = self.monitor.stage(Stage::Optimise, 0, iterations as u64);
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
        let solution = solve(problem, starts, &settings, &on_step)?;
        if solution.cancelled { Err(SessionError::Cancelled) } else { Ok(solution) }
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

    /// Leaves local minima: regroups the lights and solves again, as long as the goals are better served by that.
    fn regroup(&self, problem: &Problem, found: &mut Found) -> Result<(), SessionError> {
        let [_, softness] = SOFTNESS;
        for _ in 0..MOST_REGROUPINGS {
            if found.loss < VISIBLE {
                break;
            }
            let others = regroupings(problem, &found.lights, softness, REGROUPINGS_TRIED)?;
            if others.is_empty() {
                break;
            }
            let steps = self.request.wish.steps / 2;
            let solution = self.race(problem, &others, steps, [2.0 * softness, softness])?;
            let polished =
                self.polish(problem, &candidates(&solution.lights, solution.runner_up.as_ref()))?;
            if polished.loss > REGROUPING_PAYS * found.loss {
                break;
            }
            (found.lights, found.loss) = (polished.lights, polished.loss);
        }
        Ok(())
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

/// What is to be polished.
fn candidates<'a>(best: &'a [Light], second: Option<&'a RunnerUp>) -> Vec<&'a [Light]> {
    std::iter::once(best).chain(second.map(|second| &second.lights[..])).collect()
}
