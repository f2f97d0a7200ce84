//! Steps of solving on the GPU, each against the same on the CPU, and what of them is read back.

use glam::Vec3;
use relume_gpu::{Gpu, GpuChoice};
use relume_image::Image;
use relume_optimise::{
    Bounds, Compare, Criterion, Goal, Locks, LossGradient, Problem, Relight, RelightError, Settings,
    SolverStep, TermTarget, Variable, View, solve,
};
use relume_proxy::{GpuProxy, LightKind, LightParams, Proxy};
use relume_scene::{LANES, Light};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use super::gather_relight::{GatherRelight, SolveDump};
use super::proxy_relight::tests::trained;
use super::proxy_relight::{ProxyRelight, by_lane};
use crate::device::compute::Compute;
use crate::files::proxies::Proxies;
use crate::progress::Monitor;
use crate::relight::relighter::Relighter;
use crate::test_box::{boxed, bulbs};

/// Most that gradients on the GPU differ from those of the CPU, as a share of the largest of a light (`ARCHITECTURE.md`).
const BY_GATHER: f32 = 3e-4;
const BY_PROXY: f32 = 2e-4;
/// Largest relative difference of losses. Logarithms of WGSL are good to 2^-21 from 1/2 to 2, and a residual has two,
/// times at most 0.3.
const LOSS: f64 = 1e-5;
const RESIDUAL: f64 = 0.6 / (1 << 21) as f64;

/// Pictures of which only comparisons are those of a GPU; each of them is checked.
struct Checked<'a> {
    device: &'a dyn Relight,
    cpu: &'a dyn Relight,
    gpu: &'a Gpu,
    tolerance: f32,
    checks: AtomicUsize,
    /// Bytes that a comparison reads besides a loss for each goal.
    bytes: OnceLock<u64>,
}

impl<'a> Checked<'a> {
    fn new(device: &'a dyn Relight, cpu: &'a dyn Relight, gpu: &'a Gpu, tolerance: f32) -> Self {
        Self { device, cpu, gpu, tolerance, checks: AtomicUsize::new(0), bytes: OnceLock::new() }
    }
}

struct CheckedCompare<'a> {
    checked: &'a Checked<'a>,
    device: Box<dyn Compare + 'a>,
    layers: Vec<Vec<[f32; 3]>>,
}

impl Relight for Checked<'_> {
    fn size(&self) -> (usize, usize) {
        self.cpu.size()
    }
    fn cell(&self) -> usize {
        self.cpu.cell()
    }
    fn values(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        self.cpu.values(light, softness, cells)
    }
    fn pull_back(&self, _: &Light, _: f32, _: &[u32], _: &[[f32; 3]]) -> Result<[f32; LANES], RelightError> {
        Err("a step asked for a gradient on the CPU".into())
    }
    fn comparison<'a>(
        &'a self,
        base: &[[f32; 3]],
        still: &[&[[f32; 3]]],
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        let device = self.device.comparison(base, still)?.ok_or("there is no comparison on the GPU")?;
        let layers = std::iter::once(&base).chain(still).map(|picture| picture.to_vec()).collect();
        Ok(Some(Box::new(CheckedCompare { checked: self, device, layers })))
    }
}

impl Compare for CheckedCompare<'_> {
    fn gradient(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        softness: f32,
        targets: &[TermTarget],
    ) -> Result<Option<LossGradient>, RelightError> {
        let before = self.checked.gpu.bytes_read();
        let found = self.device.gradient(lights, still, softness, targets)?.ok_or("the GPU gave up")?;
        // As many for few cells as for many.
        let bytes = self.checked.gpu.bytes_read() - before - 4 * targets.len() as u64;
        assert_eq!(bytes, *self.checked.bytes.get_or_init(|| bytes));
        let expected = self.on_cpu(lights, still, softness, targets)?;
        let (tolerance, loss) = (self.checked.tolerance, expected.loss);
        let weight: f64 = targets.iter().map(|target| f64::from(target.weight)).sum();
        let most = LOSS * loss + 2.0 * (weight * loss).sqrt() * RESIDUAL;
        assert!((found.loss - loss).abs() < most, "{} for {loss}: {:?}", found.loss, targets[0].criterion);
        for (found, expected) in found.lights.iter().zip(&expected.lights) {
            assert_near(&found.0, &expected.0, tolerance);
            assert_near(&found.1, &expected.1, tolerance);
        }
        for (found, expected) in found.still.iter().zip(&expected.still) {
            assert_near(found, expected, tolerance);
        }
        assert_eq!((found.lights.len(), found.still.len()), (lights.len(), still.len()));
        self.checked.checks.fetch_add(1, Ordering::Relaxed);
        Ok(Some(found))
    }
}

fn assert_near(found: &[f32], expected: &[f32], tolerance: f32) {
    let largest = expected.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= tolerance * largest, "{found:?} for {expected:?}");
    }
}

impl CheckedCompare<'_> {
    fn on_cpu(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        softness: f32,
        targets: &[TermTarget],
    ) -> Result<LossGradient, RelightError> {
        let mut sums = LossGradient {
            loss: 0.0,
            lights: vec![([0.0; LANES], [0.0; 3]); lights.len()],
            still: vec![[0.0; 3]; still.len()],
        };
        for target in targets {
            let (cpu, cells) = (self.checked.cpu, target.cells.clone());
            let at = |layer: &Vec<[f32; 3]>| cells.iter().map(|cell| layer[*cell as usize]).collect();
            let layers: Vec<Vec<[f32; 3]>> = self.layers.iter().map(at).collect();
            let units = lights.iter().map(|light| cpu.values(light, softness, &cells));
            let units = units.collect::<Result<Vec<_>, _>>()?;
            let radiances = lights.iter().map(|light| light.radiance);
            let mut picture = layers[0].clone();
            for (radiance, unit) in
                still.iter().copied().chain(radiances).zip(layers[1..].iter().chain(&units))
            {
                for (sum, unit) in picture.iter_mut().zip(unit) {
                    (0..3).for_each(|c| sum[c] += radiance[c] * unit[c]);
                }
            }
            let (loss, d_picture) = target.clone().compare(picture);
            sums.loss += loss;
            let pull = |sum: &mut [f32; 3], unit: &[[f32; 3]]| {
                for (d, unit) in d_picture.iter().zip(unit) {
                    (0..3).for_each(|c| sum[c] += d[c] * unit[c]);
                }
            };
            sums.still.iter_mut().zip(&layers[1..]).for_each(|(sum, unit)| pull(sum, unit));
            for ((light, unit), (by_shape, by_radiance)) in lights.iter().zip(&units).zip(&mut sums.lights) {
                pull(by_radiance, unit);
                let times = |d: &[f32; 3]| std::array::from_fn(|c| d[c] * light.radiance[c]);
                let d_unit: Vec<[f32; 3]> = d_picture.iter().map(times).collect();
                let pulled = cpu.pull_back(light, softness, &cells, &d_unit)?;
                by_shape.iter_mut().zip(pulled).for_each(|(sum, d)| *sum += d);
            }
        }
        Ok(sums)
    }
}

/// Every kind of goal, for all of the picture and for parts that overlap.
fn goals(target: &Image) -> Vec<Vec<Goal>> {
    let pixels = target.pixel_count();
    let part = |first: usize| Some((0..pixels).map(|i| f32::from((i + first) % 7 < 4) * 0.8).collect());
    let image = || target.clone();
    let criteria = [
        Criterion::Target { image: image(), exposure_invariant: false },
        Criterion::Target { image: image(), exposure_invariant: true },
        Criterion::Brightness { stops: 1.0 },
        Criterion::Brightness { stops: -0.5 },
        Criterion::Color { color: [0.9, 0.5, 0.2] },
        Criterion::Temperature { mireds: 60.0 },
        Criterion::Temperature { mireds: -60.0 },
        Criterion::Keep,
    ];
    let goal = |(number, criterion): (usize, &Criterion)| Goal {
        criterion: criterion.clone(),
        pixels: if number % 2 == 0 { None } else { part(number) },
        weight: 0.5 + 0.1 * number as f32,
    };
    let all: Vec<Goal> = criteria.iter().enumerate().map(goal).collect();
    let alone = all.iter().map(|goal| vec![goal.clone()]);
    alone.chain([all.clone()]).collect()
}

/// An image without pattern, up to some brightness.
fn image((width, height): (usize, usize), most: f32, of: u32) -> Image {
    let value = |i: u32| {
        let mixed = (i + 9973 * of + 1).wrapping_mul(0x9e37_79b1);
        most * (0.1 + (mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca77) as f32 / u32::MAX as f32)
    };
    Image { width, height, channels: 3, data: (0..3 * (width * height) as u32).map(value).collect() }
}

/// Some steps towards each kind of goal, with one light that stays.
fn check(checked: &Checked, lights: &[Light], softness: [f32; 2]) {
    let size = checked.size();
    let (base, held) = (image(size, 0.2, 1), image(size, 0.4, 2));
    let bounds = Bounds::new(Vec3::splat(-0.9), Vec3::splat(2.0), [0.05, 0.6]);
    let variable = |light: &Light| Variable {
        light: Light { radiance: [1.0, 0.8, 0.5], ..light.clone() },
        locks: Locks::default(),
        bounds,
        prior_weight: 0.0,
    };
    let mut variables: Vec<Variable> = lights.iter().map(variable).collect();
    let locks = Locks { color: false, strength: false, ..Locks::ALL };
    variables.insert(1, Variable { locks, ..variable(&lights[0]) });
    let mut still = vec![None; variables.len()];
    still[1] = Some(&held);
    // Not as they were before, where nothing would be missing of what is to be kept.
    let dimmed = |variable: &Variable| Light { radiance: [0.7, 0.5, 0.4], ..variable.light.clone() };
    let start: Vec<Light> = variables.iter().map(dimmed).collect();
    for goals in goals(&image(size, 1.5, 3)) {
        let view = View { relight: checked, base: &base, still: still.clone(), goals: &goals };
        let problem = Problem { views: vec![view], variables: variables.clone() };
        let settings = Settings { iterations: 2, pixel_fraction: 0.5, softness, ..Settings::default() };
        let before = checked.checks.load(Ordering::Relaxed);
        let steps = |_: SolverStep| ControlFlow::Continue(());
        solve(&problem, std::slice::from_ref(&start), &settings, &steps).unwrap();
        // The start, and each step and its end.
        assert_eq!(checked.checks.load(Ordering::Relaxed), before + 5, "{:?}", goals[0].criterion);
    }
}

fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
}

#[test]
fn steps_through_the_gather_are_those_of_the_cpu_and_leave_pictures_on_the_gpu() {
    let (gpu, folder) = (gpu(), tempfile::tempdir().unwrap());
    let open = || Relighter::from_dump(boxed((48, 32), 8).unwrap(), folder.path()).unwrap();
    let (on_gpu, on_cpu) = (open().on(&Compute::with(Arc::clone(&gpu), false)), open());
    let monitor = Monitor::default();
    let prepared = [&on_gpu, &on_cpu].map(|relighter| SolveDump::new(relighter, &[], &monitor).unwrap());
    let device = GatherRelight::new(&on_gpu, &prepared[0], &monitor).unwrap();
    let cpu = GatherRelight::new(&on_cpu, &prepared[1], &monitor).unwrap();
    check(&Checked::new(&device, &cpu, &gpu, BY_GATHER), &bulbs(3), [0.3, 0.02]);
}

/// Proxies on the CPU.
struct OnCpu([Proxy; 2]);

impl OnCpu {
    fn of(&self, light: &Light) -> (&Proxy, LightParams) {
        let params = LightParams::from_shape(&light.shape).unwrap();
        (&self.0[usize::from(params.kind() == LightKind::Quad)], params)
    }
}

impl Relight for OnCpu {
    fn size(&self) -> (usize, usize) {
        let [width, height] = self.0[0].info().image;
        (width, height)
    }
    fn values(&self, light: &Light, _: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        let (proxy, params) = self.of(light);
        let mut values = vec![[0.0; 3]; cells.len()];
        proxy.forward_pixels(cells, &params, &mut values)?;
        Ok(values)
    }
    fn pull_back(
        &self,
        light: &Light,
        _: f32,
        cells: &[u32],
        d_values: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError> {
        let (proxy, params) = self.of(light);
        Ok(by_lane(&params, &proxy.backward(cells, &params, d_values)?))
    }
}

#[test]
fn steps_through_two_kinds_of_proxies_are_those_of_the_cpu_and_leave_pictures_on_the_gpu() {
    let gpu = gpu();
    let cpu = OnCpu([LightKind::Sphere, LightKind::Quad].map(trained));
    let on_gpu = cpu.0.each_ref().map(|proxy| GpuProxy::new(Arc::clone(&gpu), proxy).unwrap());
    let kinds = on_gpu.iter().map(|proxy| (proxy.proxy().info().kind, Some(proxy))).collect();
    let device = ProxyRelight { proxies: &Proxies::default(), kinds, size: cpu.size() };
    let sphere = |x: f32| LightParams::round(LightKind::Sphere, Vec3::new(x, -0.3, 1.2), 0.3).shape();
    let quad = LightParams::quad(Vec3::new(0.1, 0.3, 1.6), 0.3 * Vec3::Y, Vec3::new(0.35, 0.0, 0.1)).shape();
    let lights = [sphere(0.4), quad, sphere(-0.5)].map(Light::unit);
    check(&Checked::new(&device, &cpu, &gpu, BY_PROXY), &lights, [0.0; 2]);
}
