use crate::progress::{Monitor, Stage};
use crate::relighter::{RelightOptions, Relighter};
use crate::{LightSet, SessionError};
use glam::Vec3;
use relume_image::Image;
use relume_optimise::{
    Bounds, Compare, Locks, Polished, Problem, Relight, RelightError, Settings, Solution, SphereLight,
    UnitImages, polish, random_starts, solve,
};
use relume_proxy::{GpuComparison, GpuProxy, LightKind, LightParams, Proxy};
use relume_scene::{Light, LightShape, LobeFactors};
use std::ops::ControlFlow;

/// A proxy of round lights, as the optimiser sees it.
#[derive(Clone, Copy)]
pub struct ProxyRelight<'a> {
    proxy: &'a Proxy,
}

impl<'a> ProxyRelight<'a> {
    /// None unless the proxy is of spheres or facing disks.
    pub fn new(proxy: &'a Proxy) -> Option<Self> {
        matches!(proxy.info().kind, LightKind::Sphere | LightKind::FacingDisk).then_some(Self { proxy })
    }

    fn params(&self, center: Vec3, radius: f32) -> LightParams {
        LightParams::round(self.proxy.info().kind, center, radius)
    }
}

impl Relight for ProxyRelight<'_> {
    fn size(&self) -> (usize, usize) {
        let [width, height] = self.proxy.info().image;
        (width, height)
    }

    fn forward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        out: &mut [[f32; 3]],
    ) -> Result<(), RelightError> {
        Ok(self.proxy.forward_pixels(pixels, &self.params(center, radius), out)?)
    }

    fn backward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        d_out: &[[f32; 3]],
    ) -> Result<[f32; 4], RelightError> {
        let gradient = self.proxy.backward(pixels, &self.params(center, radius), d_out)?;
        Ok(by_shape(&gradient))
    }
}

/// A proxy on a GPU, as the optimiser sees it.
struct GpuProxyRelight<'a> {
    on_gpu: &'a GpuProxy,
    cpu: ProxyRelight<'a>,
}

impl Relight for GpuProxyRelight<'_> {
    fn size(&self) -> (usize, usize) {
        self.cpu.size()
    }

    fn forward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        out: &mut [[f32; 3]],
    ) -> Result<(), RelightError> {
        Ok(self.on_gpu.forward_pixels(pixels, &self.cpu.params(center, radius), out)?)
    }

    fn backward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        d_out: &[[f32; 3]],
    ) -> Result<[f32; 4], RelightError> {
        let gradient = self.on_gpu.backward(pixels, &self.cpu.params(center, radius), d_out)?;
        Ok(by_shape(&gradient))
    }

    fn comparison<'a>(
        &'a self,
        base: &Image,
        target: &Image,
        exposure: f32,
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        let comparison = self.on_gpu.comparison(&base.data, &target.data, exposure)?;
        Ok(Some(Box::new(GpuCompare { relight: self, comparison })))
    }
}

/// Pictures compared on the GPU.
struct GpuCompare<'a> {
    relight: &'a GpuProxyRelight<'a>,
    comparison: GpuComparison<'a>,
}

impl Compare for GpuCompare<'_> {
    fn gradient(&self, lights: &[SphereLight], pixels: &[u32]) -> Result<(f64, Vec<[f32; 7]>), RelightError> {
        let params =
            |light: &SphereLight| (self.relight.cpu.params(light.center, light.radius), light.radiance);
        let lights: Vec<_> = lights.iter().map(params).collect();
        let (loss, gradients) = self.comparison.gradient(&lights, pixels)?;
        let by_light = gradients.iter().map(|gradient| {
            let ([x, y, z, radius], [r, g, b]) = (by_shape(&gradient.params), gradient.radiance);
            [x, y, z, radius, r, g, b]
        });
        Ok((loss, by_light.collect()))
    }
}

/// By centre and radius, of a gradient by a round light's parameters.
fn by_shape(gradient: &[f32]) -> [f32; 4] {
    std::array::from_fn(|i| gradient.get(i).copied().unwrap_or(0.0))
}

/// A gather of round lights, as the optimiser sees it.
struct GatherUnits<'a> {
    relighter: &'a Relighter,
    kind: LightKind,
    monitor: &'a Monitor,
}

impl UnitImages for GatherUnits<'_> {
    fn unit_images(&self, spheres: &[(Vec3, f32)]) -> Result<Vec<Image>, RelightError> {
        let light = |(center, radius): &(Vec3, f32)| {
            let shape = LightParams::round(self.kind, *center, *radius).shape();
            new_light(String::new(), shape, [1.0; 3])
        };
        let lights: Vec<Light> = spheres.iter().map(light).collect();
        Ok(self.relighter.gather_images(&lights, self.monitor)?)
    }
}

/// What to solve.
#[derive(Clone, Debug, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OptimiseOptions {
    /// Steps, learning rate, pixel subsets, seed.
    pub settings: Settings,
    /// What stays as it is; the same for all lights.
    pub locks: Locks,
    /// Lights to find from random starts; not used if start lights are given.
    pub count: usize,
    /// Random starts, of which the best is kept; with start lights, starts beside them.
    pub starts: usize,
    /// Most steps of the polish on gathered pictures that follows where there is a bake; 0 for none.
    pub polish: usize,
}

impl Default for OptimiseOptions {
    fn default() -> Self {
        Self { settings: Settings::default(), locks: Locks::default(), count: 1, starts: 8, polish: 16 }
    }
}

/// Solved lights.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Optimised {
    /// The start lights with the solved ones in their places, or the found lights.
    pub lights: LightSet,
    /// How it went through the proxy.
    pub solution: Solution,
    /// How the polish went; none without a bake.
    pub polished: Option<Polished>,
}

/// Finds round lights that make a target picture, through a proxy (paper, section 5.3). Without start lights, `count`
/// lights are found from random starts over the static layers; with them, those that the proxy covers are solved and
/// the others stay as they are.
///
/// # Errors
/// If there is no proxy of round lights, or the target does not fit.
pub fn optimise(
    relighter: &Relighter,
    target: &Image,
    start: Option<&LightSet>,
    options: &OptimiseOptions,
    monitor: &Monitor,
) -> Result<Optimised, SessionError> {
    let no_proxy =
        || SessionError::Settings("there is no proxy of point lights here; train one first".into());
    let kinds = [LightKind::Sphere, LightKind::FacingDisk];
    let wanted = |kind: &LightKind| {
        start.is_none_or(|set| set.lights.iter().any(|light| LightKind::of(&light.shape) == Some(*kind)))
    };
    let mut trained =
        kinds.iter().filter(|kind| wanted(kind)).filter_map(|kind| relighter.proxies().of(*kind));
    let proxy = &trained.next().ok_or_else(no_proxy)?.proxy;
    let relight = ProxyRelight::new(proxy).ok_or_else(no_proxy)?;

    let kept = start.map(|set| set.lights.clone()).unwrap_or_default();
    let (solved, fixed): (Vec<usize>, Vec<usize>) = (0..kept.len()).partition(|i| {
        LightKind::of(&kept[*i].shape) == Some(proxy.info().kind)
            && relighter.proxies().covering(&kept[*i]).is_some()
    });
    let fixed_lights: Vec<Light> = fixed.iter().map(|i| kept[*i].clone()).collect();
    let base = relighter.relight(&fixed_lights, &RelightOptions::default(), monitor)?.combined();

    let count = if start.is_some() { solved.len() } else { options.count };
    let locks = vec![options.locks; count];
    let problem = Problem { relight: &relight, target, base: &base, bounds: bounds(proxy), locks };
    let mut starts = Vec::new();
    if start.is_some() {
        starts.push(solved.iter().filter_map(|i| sphere(&kept[*i])).collect());
    }
    let any_locks = options.locks != Locks::default();
    if !(start.is_some() && any_locks) {
        // A random start does not know what the locks are to hold.
        let more = options.starts.saturating_sub(starts.len()).max(usize::from(starts.is_empty()));
        starts.extend(random_starts(&problem, more, options.settings.seed)?);
    }
    let kind = proxy.info().kind;
    let on_gpu = relighter.on_gpu_proxy(kind, monitor, |on_gpu| {
        let relight = GpuProxyRelight { on_gpu, cpu: relight };
        run(&Problem { relight: &relight, ..problem.clone() }, &starts, options, monitor)
    })?;
    let solution = match on_gpu {
        Some(solution) => solution,
        None => run(&problem, &starts, options, monitor)?,
    };
    let polished = match relighter.gather() {
        Some(_) if options.polish > 0 => {
            let exact = GatherUnits { relighter, kind, monitor };
            Some(run_polish(&problem, &exact, &solution.lights, options.polish, monitor)?)
        }
        _ => None,
    };
    let found = polished.as_ref().map_or(&solution.lights, |polished| &polished.lights);
    let lights = merged(&kept, &solved, found, kind);
    let name = start.map(|set| set.name.clone()).unwrap_or_else(|| "Solved".into());
    Ok(Optimised { lights: LightSet { name, lights, notes: Vec::new() }, solution, polished })
}

fn run(
    problem: &Problem,
    starts: &[Vec<SphereLight>],
    options: &OptimiseOptions,
    monitor: &Monitor,
) -> Result<Solution, SessionError> {
    let iterations = options.settings.iterations;
    let stage = monitor.stage(Stage::Optimise, 0, (starts.len() * iterations) as u64);
    let solution = solve(problem, starts, &options.settings, &mut |step| {
        let done = (step.start * iterations + step.iteration + 1) as u64;
        stage.set(done, &format!("start {} of {}, loss {:.2e}", step.start + 1, starts.len(), step.loss));
        if monitor.cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    if solution.cancelled { Err(SessionError::Cancelled) } else { Ok(solution) }
}

fn run_polish(
    problem: &Problem,
    exact: &GatherUnits,
    lights: &[SphereLight],
    steps: usize,
    monitor: &Monitor,
) -> Result<Polished, SessionError> {
    let stage = monitor.stage(Stage::Polish, 0, steps as u64);
    let polished = polish(problem, exact, lights, steps, &mut |step| {
        stage.set(step.iteration as u64 + 1, &format!("loss {:.2e}", step.loss));
        if monitor.cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    if monitor.cancelled() { Err(SessionError::Cancelled) } else { Ok(polished) }
}

/// Centres that the proxy has seen in training, radii that it was trained for.
fn bounds(proxy: &Proxy) -> Bounds {
    let info = proxy.info();
    let corner = |end: usize| Vec3::from_array(std::array::from_fn(|i| info.trained_ranges[i][end]));
    Bounds {
        center_min: corner(0),
        center_max: corner(1),
        radius_min: info.size.min,
        radius_max: info.size.max,
    }
}

fn sphere(light: &Light) -> Option<SphereLight> {
    match light.shape {
        LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
            Some(SphereLight { center, radius, radiance: light.radiance })
        }
        _ => None,
    }
}

/// The start lights with solved values, or new ones.
fn merged(kept: &[Light], solved: &[usize], found: &[SphereLight], kind: LightKind) -> Vec<Light> {
    let mut lights = kept.to_vec();
    for (i, found) in found.iter().enumerate() {
        let shape = LightParams::round(kind, found.center, found.radius).shape();
        match solved.get(i) {
            Some(place) => {
                lights[*place] = Light { shape, radiance: found.radiance, ..lights[*place].clone() }
            }
            None => lights.push(new_light(format!("Solved {}", i + 1), shape, found.radiance)),
        }
    }
    lights
}

fn new_light(name: String, shape: LightShape, radiance: [f32; 3]) -> Light {
    Light { name, shape, radiance, lobes: LobeFactors::default(), receivers: None }
}
