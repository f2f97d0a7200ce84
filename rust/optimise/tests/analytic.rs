//! The optimiser on a relighter with a closed formula: a floor and a wall under sphere lights, unshadowed.

use glam::Vec3;
use relume_image::Image;
use relume_optimise::{
    Bounds, Locks, OptimiseError, Problem, Relight, RelightError, Settings, SphereLight, UnitImages, polish,
    random_starts, solve,
};
use std::ops::ControlFlow;

const SIZE: usize = 32;

/// Lambertian floor (upper half of the pixels) and back wall: albedo r^2 cos / (d^2 + r^2), kept smooth at 0.
struct Room;

impl Room {
    fn surface(pixel: u32) -> (Vec3, Vec3, [f32; 3]) {
        let (x, y) = (pixel as usize % SIZE, pixel as usize / SIZE);
        let (s, t) = (x as f32 / SIZE as f32 * 4.0 - 2.0, y as f32 / SIZE as f32 * 4.0);
        let tint = [0.8, 0.3 + 0.5 * x as f32 / SIZE as f32, 0.4];
        if t < 2.0 {
            (Vec3::new(s, 2.0, 2.0 - t), -Vec3::Y, tint)
        } else {
            (Vec3::new(s, 4.0 - t, 0.0), Vec3::Z, tint)
        }
    }

    /// Value without the albedo, and its derivative by centre and radius.
    fn value(pixel: u32, center: Vec3, radius: f32) -> (f32, [f32; 4]) {
        let (position, normal, _) = Self::surface(pixel);
        let to = center - position;
        let q = to.length_squared() + radius * radius;
        let height = to.dot(normal);
        // The softened cosine keeps the formula smooth where the light crosses the plane.
        let root = (height * height + 0.01).sqrt();
        let (cosine, d_cosine) = (0.5 * (height + root), 0.5 * (1.0 + height / root));
        let (f, r2) = (cosine / (q * q.sqrt()), radius * radius);
        let d_f = normal * (d_cosine / (q * q.sqrt())) - to * (3.0 * f / q);
        let d_center = d_f * r2;
        let d_radius = 2.0 * radius * f - r2 * 3.0 * f / q * radius;
        (r2 * f, [d_center.x, d_center.y, d_center.z, d_radius])
    }
}

impl Relight for Room {
    fn size(&self) -> (usize, usize) {
        (SIZE, SIZE)
    }

    fn forward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        out: &mut [[f32; 3]],
    ) -> Result<(), RelightError> {
        for (out, pixel) in out.iter_mut().zip(pixels) {
            let value = Room::value(*pixel, center, radius).0;
            *out = Room::surface(*pixel).2.map(|albedo| albedo * value);
        }
        Ok(())
    }

    fn backward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        d_out: &[[f32; 3]],
    ) -> Result<[f32; 4], RelightError> {
        let mut sum = [0.0; 4];
        for (pixel, d) in pixels.iter().zip(d_out) {
            let albedo = Room::surface(*pixel).2;
            let d_value: f32 = (0..3).map(|c| d[c] * albedo[c]).sum();
            let slope = Room::value(*pixel, center, radius).1;
            (0..4).for_each(|i| sum[i] += d_value * slope[i]);
        }
        Ok(sum)
    }
}

fn picture(lights: &[SphereLight], base: &Image) -> Image {
    let pixels: Vec<u32> = (0..(SIZE * SIZE) as u32).collect();
    let mut image = base.clone();
    for light in lights {
        let mut unit = vec![[0.0; 3]; pixels.len()];
        Room.forward(light.center, light.radius, &pixels, &mut unit).unwrap();
        let unit = Image { width: SIZE, height: SIZE, channels: 3, data: unit.concat() };
        image.add_scaled(&unit, &light.radiance);
    }
    image
}

fn problem<'a>(target: &'a Image, base: &'a Image, lights: usize) -> Problem<'a> {
    let bounds = Bounds {
        center_min: Vec3::new(-2.0, -1.0, 0.2),
        center_max: Vec3::new(2.0, 1.8, 2.0),
        radius_min: 0.05,
        radius_max: 0.5,
    };
    Problem { relight: &Room, target, base, bounds, locks: vec![Locks::default(); lights] }
}

fn base() -> Image {
    Image { data: vec![0.02; SIZE * SIZE * 3], ..Image::new(SIZE, SIZE, 3) }
}

const HIDDEN: SphereLight =
    SphereLight { center: Vec3::new(0.7, 0.6, 1.1), radius: 0.25, radiance: [40.0, 25.0, 10.0] };

/// Power of the light: radius and radiance alone are hardly told apart by a small light.
fn power(light: &SphereLight) -> [f32; 3] {
    light.radiance.map(|r| r * light.radius * light.radius)
}

fn go(_: relume_optimise::Step) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

#[test]
fn hidden_light_is_found_from_random_starts() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let problem = problem(&target, &base, 1);
    let starts = random_starts(&problem, 4, 11).unwrap();
    let solution = solve(&problem, &starts, &Settings::default(), &mut go).unwrap();
    let found = &solution.lights[0];
    assert!(found.center.distance(HIDDEN.center) < 0.03, "{found:?}");
    for (got, want) in power(found).into_iter().zip(power(&HIDDEN)) {
        assert!((got / want - 1.0).abs() < 0.05, "{found:?}");
    }
    assert!(solution.loss < 1e-4 * solution.start_loss);
    assert_eq!(solution.trajectory.len(), 500);
}

#[test]
fn brightness_of_the_scene_does_not_matter() {
    let base = Image::new(SIZE, SIZE, 3);
    for scale in [1e-4, 1e4] {
        let hidden = SphereLight { radiance: HIDDEN.radiance.map(|r| r * scale), ..HIDDEN };
        let target = picture(&[hidden], &base);
        let problem = problem(&target, &base, 1);
        let starts = random_starts(&problem, 2, 5).unwrap();
        let solution = solve(&problem, &starts, &Settings::default(), &mut go).unwrap();
        assert!(solution.lights[0].center.distance(HIDDEN.center) < 0.05, "{scale}: {:?}", solution.lights);
    }
}

#[test]
fn two_lights_make_the_picture() {
    let base = base();
    let other = SphereLight { center: Vec3::new(-1.2, -0.3, 0.7), radius: 0.15, radiance: [5.0, 20.0, 60.0] };
    let target = picture(&[HIDDEN, other], &base);
    let problem = problem(&target, &base, 2);
    let starts = random_starts(&problem, 6, 3).unwrap();
    let solution = solve(&problem, &starts, &Settings::default(), &mut go).unwrap();
    let psnr = relume_image::metrics::psnr_reinhard(&picture(&solution.lights, &base), &target);
    assert!(psnr > 40.0, "{psnr} dB, {:?}", solution.lights);
}

#[test]
fn locked_parameters_do_not_move_and_free_ones_do() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let mut problem = problem(&target, &base, 1);
    problem.locks = vec![Locks { center: true, radius: true, radiance: false }];
    let start = SphereLight { radiance: [1.0; 3], ..HIDDEN };
    let solution = solve(&problem, &[vec![start]], &Settings::default(), &mut go).unwrap();
    assert_eq!((solution.lights[0].center, solution.lights[0].radius), (HIDDEN.center, HIDDEN.radius));
    for (got, want) in solution.lights[0].radiance.into_iter().zip(HIDDEN.radiance) {
        assert!((got / want - 1.0).abs() < 0.02, "{:?}", solution.lights);
    }
}

#[test]
fn same_seed_same_answer_and_cancel_keeps_the_best_so_far() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let problem = problem(&target, &base, 1);
    let starts = random_starts(&problem, 2, 1).unwrap();
    let settings = Settings { iterations: 60, ..Settings::default() };
    let first = solve(&problem, &starts, &settings, &mut go).unwrap();
    assert_eq!(first, solve(&problem, &starts, &settings, &mut go).unwrap());

    let mut stop = |step: relume_optimise::Step| match step.iteration {
        30 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = solve(&problem, &starts, &settings, &mut stop).unwrap();
    assert!(stopped.cancelled && stopped.loss <= stopped.start_loss);
    assert_eq!(stopped.trajectory.len(), 31);
}

#[test]
fn input_that_does_not_fit_is_named() {
    let (base, small) = (base(), Image::new(3, 3, 3));
    let target = picture(&[HIDDEN], &base);
    let settings = Settings::default();
    let starts = vec![vec![HIDDEN]];
    let message = |problem: &Problem, starts: &[Vec<SphereLight>], settings: &Settings| {
        solve(problem, starts, settings, &mut go).unwrap_err().to_string()
    };
    assert!(message(&problem(&small, &base, 1), &starts, &settings).contains("target is (3, 3)"));
    assert!(message(&problem(&target, &base, 1), &[], &settings).contains("start"));
    assert!(message(&problem(&target, &base, 2), &starts, &settings).contains("1 lights, 2"));
    let mut nan = target.clone();
    nan.data[7] = f32::NAN;
    assert!(message(&problem(&nan, &base, 1), &starts, &settings).contains("finite"));
    let mut empty = problem(&target, &base, 1);
    empty.bounds.center_max.x = -2.0;
    assert!(message(&empty, &starts, &settings).contains("centre"));
    let zero = Settings { learning_rate: f32::NAN, ..settings };
    assert!(message(&problem(&target, &base, 1), &starts, &zero).contains("learning rate"));
}

/// A relighter that predicts NaN everywhere.
struct Broken;

impl Relight for Broken {
    fn size(&self) -> (usize, usize) {
        (SIZE, SIZE)
    }
    fn forward(&self, _: Vec3, _: f32, _: &[u32], out: &mut [[f32; 3]]) -> Result<(), RelightError> {
        out.fill([f32::NAN; 3]);
        Ok(())
    }
    fn backward(&self, _: Vec3, _: f32, _: &[u32], _: &[[f32; 3]]) -> Result<[f32; 4], RelightError> {
        Ok([f32::NAN; 4])
    }
}

#[test]
fn nan_from_the_relighter_is_an_error_not_an_answer() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let problem = Problem { relight: &Broken, ..problem(&target, &base, 1) };
    let error = solve(&problem, &[vec![HIDDEN]], &Settings::default(), &mut go).unwrap_err();
    assert!(matches!(error, OptimiseError::Diverged), "{error}");
}

impl UnitImages for Room {
    fn unit_images(&self, spheres: &[(Vec3, f32)]) -> Result<Vec<Image>, RelightError> {
        let black = Image::new(SIZE, SIZE, 3);
        let unit = |(center, radius): &(Vec3, f32)| {
            picture(&[SphereLight { center: *center, radius: *radius, radiance: [1.0; 3] }], &black)
        };
        Ok(spheres.iter().map(unit).collect())
    }
}

/// About as far off as a briefly trained proxy leaves a light.
const ROUGH: SphereLight =
    SphereLight { center: Vec3::new(0.5, 0.75, 1.3), radius: 0.33, radiance: [21.0, 17.0, 5.0] };

#[test]
fn polish_takes_a_roughly_found_light_to_the_hidden_one() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let problem = problem(&target, &base, 1);
    let polished = polish(&problem, &Room, &[ROUGH], 30, &mut |_| ControlFlow::Continue(())).unwrap();
    let found = &polished.lights[0];
    assert!(found.center.distance(HIDDEN.center) < 2e-3, "{polished:?}");
    for (got, want) in power(found).into_iter().zip(power(&HIDDEN)) {
        assert!((got / want - 1.0).abs() < 5e-3, "{polished:?}");
    }
    assert!(polished.loss < 1e-6 * polished.start_loss, "{polished:?}");
}

#[test]
fn polish_leaves_locked_parameters_and_keeps_bounds() {
    let base = base();
    // Farther away than the bounds allow.
    let hidden = SphereLight { center: Vec3::new(2.6, 0.6, 1.1), ..HIDDEN };
    let target = picture(&[hidden], &base);
    let mut problem = problem(&target, &base, 1);
    problem.locks = vec![Locks { radius: true, ..Locks::default() }];
    let polished = polish(&problem, &Room, &[ROUGH], 30, &mut |_| ControlFlow::Continue(())).unwrap();
    let found = &polished.lights[0];
    assert_eq!(found.radius, ROUGH.radius);
    assert_eq!(found.center.x, problem.bounds.center_max.x, "{polished:?}");
    assert!(polished.loss < polished.start_loss);

    problem.locks = vec![Locks { center: true, radius: true, radiance: true }];
    let held = polish(&problem, &Room, &[ROUGH], 30, &mut |_| ControlFlow::Continue(())).unwrap();
    assert_eq!((held.lights[0], held.loss), (ROUGH, held.start_loss));
}

#[test]
fn polish_keeps_a_light_that_is_right_and_stops_when_told() {
    let base = base();
    let target = picture(&[HIDDEN], &base);
    let problem = problem(&target, &base, 1);
    let mut steps = 0;
    let mut stop = |_| {
        steps += 1;
        ControlFlow::Break(())
    };
    let polished = polish(&problem, &Room, &[HIDDEN], 30, &mut stop).unwrap();
    assert!(polished.lights[0].center.distance(HIDDEN.center) < 1e-5, "{polished:?}");
    assert!(polished.loss <= polished.start_loss);
    assert_eq!(steps, 1);
}
