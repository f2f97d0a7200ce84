//! One light solved through a proxy.

use relume_image::Image;
use relume_optimise::{Bounds, Criterion, Goal, Locks, Problem, Settings, Variable, View, solve};
use relume_proxy::{GpuProxy, LightKind, LightParams};
use relume_scene::Light;
use relume_session::{Proxies, ProxyRelight};
use std::ops::ControlFlow;
use std::time::Instant;

/// Runs, of which the best counts: the first compiles kernels.
const RUNS: usize = 3;
/// Steps, and the share of the pixels that each looks at (paper, section 6.2).
pub const STEPS: usize = 500;
pub const PIXELS: f32 = 0.01;

/// Seconds in which one sphere light is solved in so many steps through a proxy of 3 x 3 x 3 m from one start.
pub fn seconds_of_a_light(
    proxy: &GpuProxy,
    (width, height): (usize, usize),
    steps: usize,
) -> anyhow::Result<f64> {
    let proxies = Proxies::default();
    let kinds = vec![(LightKind::Sphere, Some(proxy))];
    let relight = ProxyRelight { proxies: &proxies, kinds, size: (width, height) };
    let base = Image::new(width, height, 3);
    let at = |x: f32| LightParams::round(LightKind::Sphere, glam::Vec3::new(x, -0.5, 1.0), 0.2);
    let image = proxy.unit_image(&at(0.5))?;
    let criterion = Criterion::Target { image, exposure_invariant: false };
    let goals = [Goal { criterion, pixels: None, weight: 1.0 }];
    let view = View { relight: &relight, base: &base, still: vec![None], goals: &goals };
    let light = Light::unit(at(-0.5).shape());
    let bounds = Bounds::new(glam::Vec3::splat(-1.5), glam::Vec3::splat(1.5), [0.1, 0.5]);
    let variable = Variable { light: light.clone(), locks: Locks::default(), bounds, prior_weight: 0.0 };
    let problem = Problem { views: vec![view], variables: vec![variable] };
    let settings = Settings { iterations: steps, pixel_fraction: PIXELS, ..Settings::default() };
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        let solution = solve(&problem, &[vec![light.clone()]], &settings, &|_| ControlFlow::Continue(()))?;
        // Those that it has spared itself by ending early count as well.
        let share = solution.losses.len() as f64 / steps as f64;
        best = best.min(start.elapsed().as_secs_f64() / share);
    }
    Ok(best)
}
