use relume_optimise::{
    Polished, Problem, RandomStarts, Relight, RunnerUp, Settings, Solution, SolverStep, idle_lights,
    is_uncertain, polish, random_starts, regroupings, relocations, solve,
};
use relume_proxy::{GpuProxy, LightKind};
use relume_scene::Light;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::gather_relight::GatherRelight;
use super::lights::Unknowns;
use super::proxy_relight::ProxyRelight;
use super::request::GoalKind;
use super::scene_view::{SceneView, Scenes};
use super::solved::reports;
use super::{InterimLights, Preview, SolveOptions, SolveRequest};
use crate::error::SessionError;
use crate::files::light_set::LightSet;
use crate::progress::{Monitor, Stage};
use crate::relight::relighter::Relighter;

/// Softness of the smoothed gather at the first and the last step.
const SOFTNESS: [f32; 2] = [0.2, 0.04];
/// Lights are rearranged so often at most, and so many arrangements tried each time.
const MOST_REARRANGEMENTS: usize = 3;
const ARRANGEMENTS_TRIED: usize = 4;
/// Share of the loss that another arrangement may leave.
const REARRANGING_PAYS: f64 = 0.8;
/// Least loss that is worth solving again: differences of a hundredth of white.
const VISIBLE: f64 = 1e-4;

/// Result of a search.
pub(super) struct SearchResult {
    /// Lights in the order of the unknowns.
    pub lights: Vec<Light>,
    /// Numbers of those that are not needed.
    pub idle: Vec<usize>,
    pub loss: f64,
    pub start_loss: f64,
    pub start: usize,
    /// Loss of each step of the exploration from that start, on that step's cells.
    pub losses: Vec<f64>,
}

impl SearchResult {
    /// The lights, dark where they are not needed.
    pub fn lit(&self) -> Vec<Light> {
        let lit = |(number, light): (usize, &Light)| match self.idle.contains(&number) {
            true => Light { radiance: [0.0; 3], ..light.clone() },
            false => light.clone(),
        };
        self.lights.iter().enumerate().map(lit).collect()
    }
}

/// A proxy on the GPU that is held for a search, and those before it.
struct HeldProxy<'a> {
    relighter: &'a Relighter,
    kind: LightKind,
    proxy: &'a GpuProxy,
    before: Option<&'a HeldProxy<'a>>,
}

impl<'a> HeldProxy<'a> {
    fn find(held: Option<&'a Self>, relighter: &Relighter, kind: LightKind) -> Option<&'a GpuProxy> {
        let held = held?;
        match std::ptr::eq(held.relighter, relighter) && held.kind == kind {
            true => Some(held.proxy),
            false => Self::find(held.before, relighter, kind),
        }
    }
}

/// Explores, polishes, rearranges and drops (`docs/solve.md`).
pub(super) struct Search<'a> {
    pub request: &'a SolveRequest,
    pub unknowns: &'a Unknowns,
    pub scenes: &'a Scenes<'a>,
    pub monitor: &'a Monitor,
    pub preview: &'a Preview<'a>,
}

impl Search<'_> {
    pub fn run(&self) -> Result<SearchResult, SessionError> {
        let gathers = self.scenes.gathered.iter().flatten();
        let gathers: Vec<GatherRelight> = gathers.filter_map(|scene| scene.by_gather(self.monitor)).collect();
        let relights = as_relights(&gathers);
        let by_gather = self.scenes.gathered.as_ref().map(|scenes| self.problem(scenes, &relights));
        let explored = match (&self.scenes.proxied, &by_gather) {
            (None, Some(problem)) => self.explore(problem, SOFTNESS)?,
            (proxied, _) => self.explore_proxies(proxied.as_deref().unwrap_or_default())?,
        };
        let Solution { lights, runner_up, loss, start_loss, start, losses, .. } = explored;
        let mut found = SearchResult { lights, idle: Vec::new(), loss, start_loss, start, losses };
        match &by_gather {
            Some(problem) if self.request.options.polish > 0 => {
                self.refine(problem, &mut found, runner_up)?;
                self.drop_idle(problem, &mut found)?;
                self.polish_kept(problem, &mut found)?;
            }
            Some(problem) => self.drop_idle(problem, &mut found)?,
            None => {
                let scenes = self.scenes.judging();
                let proxies = proxy_relights(scenes, &[], None);
                self.drop_idle(&self.problem(scenes, &as_relights(&proxies)), &mut found)?;
            }
        }
        Ok(found)
    }

    /// Polishes what was explored and rearranges it.
    fn refine(
        &self,
        problem: &Problem,
        found: &mut SearchResult,
        runner_up: Option<RunnerUp>,
    ) -> Result<(), SessionError> {
        let polished = self.polish(problem, &candidates(&found.lights, runner_up.as_ref()))?;
        if let (1, Some(second)) = (polished.candidate, runner_up) {
            (found.start, found.start_loss, found.losses) = (second.start, second.start_loss, second.losses);
        }
        (found.lights, found.loss) = (polished.lights, polished.loss);
        if self.request.options.starts > 1 && self.request.options.steps > 0 {
            self.rearrange(problem, found)?;
        }
        Ok(())
    }

    fn show(&self, found: &[Light]) {
        let (lights, world) = self.unknowns.all_lights(&self.request.now, found);
        let lights = LightSet { name: "Solving".into(), lights, notes: Vec::new() };
        (self.preview)(&InterimLights { lights, world });
    }

    fn problem<'b>(&self, scenes: &'b [SceneView], relights: &'b [&'b dyn Relight]) -> Problem<'b> {
        let views = scenes.iter().zip(relights).map(|(scene, relight)| scene.view(*relight)).collect();
        Problem { views, variables: self.unknowns.variables.clone() }
    }

    /// Through proxies, on the GPU where they are there.
    fn explore_proxies(&self, scenes: &[SceneView]) -> Result<Solution, SessionError> {
        let mut kinds = Vec::new();
        for kind in self.unknowns.moving().filter_map(LightKind::of_light) {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        let relighters = scenes.iter().map(|scene| scene.relighter);
        let proxies = relighters.flat_map(|relighter| kinds.iter().map(move |kind| (relighter, *kind)));
        self.explore_on(scenes, &proxies.collect::<Vec<_>>(), &kinds, None)
    }

    /// Locks proxies on the GPU one after the other, then explores.
    fn explore_on(
        &self,
        scenes: &[SceneView],
        proxies: &[(&Relighter, LightKind)],
        kinds: &[LightKind],
        held: Option<&HeldProxy>,
    ) -> Result<Solution, SessionError> {
        let Some(((relighter, kind), rest)) = proxies.split_first() else {
            let proxies = proxy_relights(scenes, kinds, held);
            return self.explore(&self.problem(scenes, &as_relights(&proxies)), [0.0; 2]);
        };
        let found = match HeldProxy::find(held, relighter, *kind) {
            Some(_) => None, // By a view before, of the same bake.
            None => relighter.on_gpu_proxy(*kind, self.monitor, |proxy| {
                let held = HeldProxy { relighter, kind: *kind, proxy, before: held };
                self.explore_on(scenes, rest, kinds, Some(&held))
            })?,
        };
        found.map_or_else(|| self.explore_on(scenes, rest, kinds, held), Ok)
    }

    fn explore(&self, problem: &Problem, softness: [f32; 2]) -> Result<Solution, SessionError> {
        let options = &self.request.options;
        let random = RandomStarts {
            count: options.starts.max(1),
            candidates: options.candidates,
            softness: softness[0],
            seed: options.seed,
        };
        let mut starts = match &options.from {
            Some(answer) => vec![self.unknowns.of_answer(&self.request.now, answer)?],
            None => self.unknowns.starts(random_starts(problem, &random)?),
        };
        // Where nothing may move and nothing is new all begin with the lights as they are.
        starts.dedup();
        self.race(problem, &starts, options.steps, softness)
    }

    fn race(
        &self,
        problem: &Problem,
        starts: &[Vec<Light>],
        iterations: usize,
        softness: [f32; 2],
    ) -> Result<Solution, SessionError> {
        let SolveOptions { learning_rate, pixel_fraction, least_cells, seed, .. } = self.request.options;
        let settings = Settings { iterations, learning_rate, pixel_fraction, least_cells, softness, seed };
        let stage = self.monitor.stage(Stage::Optimise, 0, iterations as u64);
        let furthest = AtomicU64::new(0);
        let best = Mutex::new(f64::INFINITY);
        let on_step = |step: SolverStep| {
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
        let steps = self.request.options.polish;
        let stage = self.monitor.stage(Stage::Polish, 0, steps as u64);
        let polished = polish(problem, candidates, steps, &mut |step| {
            stage.set(step.iteration as u64 + 1, &format!("loss {:.2e}", step.loss));
            self.show(step.lights);
            if self.monitor.cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        if self.monitor.cancelled() { Err(SessionError::Cancelled) } else { Ok(polished) }
    }

    /// Leaves local minima by other arrangements of the lights, as long as the goals are better served by that.
    fn rearrange(&self, problem: &Problem, found: &mut SearchResult) -> Result<(), SessionError> {
        for _ in 0..MOST_REARRANGEMENTS {
            if found.loss < VISIBLE {
                break;
            }
            if self.seems_to_meet_goals(found)? {
                // Noise may hide that it does not, or it does far too much: one other place is worth the time.
                if is_uncertain(problem, &found.lights)? {
                    self.relocate(problem, found)?;
                }
                break;
            }
            if !(self.relocate(problem, found)? || self.regroup(problem, found)?) {
                break;
            }
        }
        Ok(())
    }

    /// True if each stroke has what was asked for. A target can always be met better.
    fn seems_to_meet_goals(&self, found: &SearchResult) -> Result<bool, SessionError> {
        if self.request.options.goals.iter().any(|goal| goal.goal == GoalKind::Target) {
            return Ok(false);
        }
        for (number, scene) in self.scenes.judging().iter().enumerate() {
            let after = scene.picture(&found.lights, self.monitor)?;
            if !reports(self.request, number, scene, &after).all(|(_, report)| report.met) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Moves one of the lights somewhere else, if that pays.
    fn relocate(&self, problem: &Problem, found: &mut SearchResult) -> Result<bool, SessionError> {
        let others = relocations(problem, &found.lights, ARRANGEMENTS_TRIED, self.request.options.seed)?;
        self.polish_others(problem, found, &others.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Regroups the lights and solves again, if that pays.
    fn regroup(&self, problem: &Problem, found: &mut SearchResult) -> Result<bool, SessionError> {
        let [_, softness] = SOFTNESS;
        let others = regroupings(problem, &found.lights, softness, ARRANGEMENTS_TRIED)?;
        if others.is_empty() {
            return Ok(false);
        }
        let steps = self.request.options.steps / 2;
        let solution = self.race(problem, &others, steps, [2.0 * softness, softness])?;
        self.polish_others(problem, found, &candidates(&solution.lights, solution.runner_up.as_ref()))
    }

    /// Polishes other lights and takes them if that pays.
    fn polish_others(
        &self,
        problem: &Problem,
        found: &mut SearchResult,
        others: &[&[Light]],
    ) -> Result<bool, SessionError> {
        if others.is_empty() {
            return Ok(false);
        }
        let polished = self.polish(problem, others)?;
        let pays = polished.loss <= REARRANGING_PAYS * found.loss;
        if pays {
            (found.lights, found.loss) = (polished.lights, polished.loss);
        }
        Ok(pays)
    }

    /// Finds lights that are not needed.
    fn drop_idle(&self, problem: &Problem, found: &mut SearchResult) -> Result<(), SessionError> {
        let may_go = self.unknowns.may_go(self.request.options.remove);
        found.idle = idle_lights(problem, &found.lights, &may_go, 0.0)?;
        Ok(())
    }

    /// Polishes the others once more where lights are dropped, without them.
    fn polish_kept(&self, problem: &Problem, found: &mut SearchResult) -> Result<(), SessionError> {
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

/// The proxies of some views, those of these kinds on the GPU where they are held there.
fn proxy_relights<'a>(
    scenes: &[SceneView<'a>],
    kinds: &[LightKind],
    held: Option<&'a HeldProxy<'a>>,
) -> Vec<ProxyRelight<'a>> {
    let of = |scene: &SceneView<'a>| ProxyRelight {
        proxies: scene.relighter.proxies(),
        kinds: kinds.iter().map(|kind| (*kind, HeldProxy::find(held, scene.relighter, *kind))).collect(),
        size: scene.size(),
    };
    scenes.iter().map(of).collect()
}

fn as_relights<R: Relight>(relights: &[R]) -> Vec<&dyn Relight> {
    relights.iter().map(|relight| relight as &dyn Relight).collect()
}

/// Lights that are to be polished.
fn candidates<'a>(best: &'a [Light], second: Option<&'a RunnerUp>) -> Vec<&'a [Light]> {
    std::iter::once(best).chain(second.map(|second| &second.lights[..])).collect()
}
