//! A ray that is cut by transparent surfaces or null collisions collects what the whole ray does.

use glam::{IVec3, Vec3};
use relume_dump::{Dump, End, Lobe, Segment, TileSamples};
use relume_scene::{Light, LightShape};

use super::kernels::random_lights;
use super::{Random, dump, light, manifest, segment};
use crate::kernel::Isa;
use crate::{Gather, SampleSplit, SoftGather};

/// Step of the position grid of these dumps, metres: all vertices lie on it, so that pieces of a ray lie on one line.
const STEP: f32 = 1.0 / 2048.0;

/// A ray: its origin and direction in steps of the grid, and where it ends or is cut, in lengths of that direction.
struct GridRay {
    origin: IVec3,
    direction: IVec3,
    cuts: Vec<i32>,
    escapes: bool,
}

/// Half of the rays leave the scene after their last cut.
fn random_rays(count: usize) -> Vec<GridRay> {
    let mut random = Random(21);
    let mut grid_point = |extent: f32| (random.point(extent) / STEP).as_ivec3();
    let mut rays: Vec<_> = (0..count)
        .map(|_| GridRay {
            origin: grid_point(2.5),
            direction: grid_point(0.05),
            cuts: Vec::new(),
            escapes: false,
        })
        .collect();
    for (index, ray) in rays.iter_mut().enumerate() {
        let mut cuts: Vec<_> = (0..2 + index % 7).map(|_| 1 + (random.next() * 120.0) as i32).collect();
        cuts.sort_unstable();
        cuts.dedup();
        (ray.cuts, ray.escapes) = (cuts, index % 2 == 0);
    }
    rays
}

/// A pixel for each ray; with one piece each if not `cut`. Paths go along the diagonal of the grid first.
fn rays_dump(rays: &[GridRay], cut: bool) -> Dump {
    let size = (rays.len() as f32).sqrt() as usize;
    let [low, high] = [-32768.0, 32767.0].map(|steps: f32| Vec3::splat(steps * STEP));
    dump(manifest(size, &[1]), |pixel, _, samples: &mut TileSamples| {
        let ray = &rays[pixel];
        let at = |steps: i32| (ray.origin + ray.direction * steps).as_vec3() * STEP;
        for vertex in [low, high, at(0)] {
            samples.push(Segment { throughput: Vec3::ZERO, ..segment(End::Vertex(vertex), Lobe::Camera) });
        }
        let mut ends: Vec<_> = ray.cuts.iter().map(|&steps| End::Vertex(at(steps))).collect();
        if ray.escapes {
            ends.push(End::Escape(ray.direction.as_vec3().normalize()));
        }
        let first = if cut { 0 } else { ends.len() - 1 };
        for (number, &end) in ends[first..].iter().enumerate() {
            samples.push(Segment { continues: number > 0, ..segment(end, Lobe::Glossy) });
        }
    })
}

/// A dump of rays that are cut into up to nine pieces.
pub fn cut_rays() -> Dump {
    rays_dump(&random_rays(1024), true)
}

/// Sums of the differences of two sets of values and of the values.
fn apart<'a>(pairs: impl Iterator<Item = (&'a f32, &'a f32)>) -> (f64, f64) {
    pairs.fold((0.0, 0.0), |(error, sum), (a, b)| (error + f64::from((a - b).abs()), sum + f64::from(*b)))
}

fn lit(image: &relume_image::Image) -> usize {
    image.data.iter().filter(|value| **value > 0.0).count()
}

#[test]
fn cut_rays_collect_what_whole_rays_do_from_every_light_with_all_instructions() {
    let rays = random_rays(1024);
    let [whole, cut] = [false, true].map(|cut| Gather::new(rays_dump(&rays, cut)));
    assert!(cut.dump().record_count() > whole.dump().record_count() + 2000);
    let lights = whole.prepare_all(&random_lights()).unwrap();
    let expected = whole.unit_images(&lights, SampleSplit::All);
    let mut values = 0;
    for isa in Isa::available() {
        let cut = cut.clone().with_isa(isa);
        for ((light, expected), many) in
            lights.iter().zip(&expected).zip(cut.unit_images(&lights, SampleSplit::All))
        {
            let found = &cut.unit_images(std::slice::from_ref(light), SampleSplit::All)[0];
            assert_eq!(&many, found, "{isa:?}");
            values += lit(expected);
            // Values of narrow spreads and cones go to 0 with their rounding. A stored direction is off by up to 1e-4: of
            // a thousand rays, none or one passes the edge of a light as near as that.
            let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-3 * *b + 1e-3;
            let differing = found.data.iter().zip(&expected.data).filter(differs).count();
            assert!(differing <= 3, "{differing} values differ, {isa:?}: {light:?}");
        }
    }
    assert!(values > 5000, "{values} values are lit");
}

/// The light that rays along x collect from a lamp, which start at `from` and are cut at some places.
fn along_x(shape: LightShape, from: f32, cuts: &[f32]) -> f32 {
    let dump = dump(manifest(1, &[1]), |_, _, samples: &mut TileSamples| {
        let at = |x: f32| End::Vertex(Vec3::new(x, 0.1, 0.0));
        samples.push(segment(at(from), Lobe::Camera));
        for (number, &x) in cuts.iter().enumerate() {
            samples.push(Segment { continues: number > 0, ..segment(at(x), Lobe::Diffuse) });
        }
    });
    let gather = Gather::new(dump);
    gather.pixel(0, 0, &[gather.prepare(&light(shape)).unwrap()], SampleSplit::All)[0][0]
}

#[test]
fn a_light_around_cuts_counts_once() {
    let sphere = LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 };
    // From outside, the ray crosses the surface where it enters; from inside, where it leaves.
    assert_eq!(along_x(sphere, -4.0, &[-0.5, 4.0]), 1.0);
    assert_eq!(along_x(sphere, -4.0, &[-2.0, -0.5, 0.0, 0.5, 2.0, 4.0]), 1.0);
    assert_eq!(along_x(sphere, -0.6, &[-0.5, 0.5, 4.0]), 1.0);
    // It ends inside.
    assert_eq!(along_x(sphere, -4.0, &[-2.0, -0.5]), 1.0);
    assert_eq!(along_x(sphere, -0.6, &[-0.5, 0.5]), 0.0);
    // A disk that faces the ray's origin, not the last cut, which is far beside its axis: seen from there it would be
    // turned, and cross the ray behind its end.
    let disk = LightShape::FacingDisk { center: Vec3::new(0.0, 0.9, 0.0), radius: 1.0 };
    assert_eq!(along_x(disk, -40.0, &[-0.5, 0.2]), 1.0);
    assert_eq!(along_x(disk, -0.5, &[0.2]), 0.0);
    // A spot shines from the half of its sphere that faces the ray's origin.
    let spot = LightShape::Spot {
        center: Vec3::ZERO,
        radius: 1.0,
        axis: Vec3::NEG_X,
        half_angle: 0.5,
        blend: 0.0,
        soft_falloff: false,
    };
    assert_eq!(along_x(spot, -4.0, &[-0.5, 4.0]), 1.0);
    let turned = LightShape::Spot {
        center: Vec3::ZERO,
        radius: 1.0,
        axis: Vec3::Y,
        half_angle: 0.5,
        blend: 0.0,
        soft_falloff: false,
    };
    // Out of its cone, also for the piece that starts inside, where rays that begin there see no cone.
    assert_eq!(along_x(turned, -4.0, &[-0.5, 4.0]), 0.0);
}

#[test]
fn smoothed_lights_see_whole_rays_too() {
    let rays = random_rays(256);
    let [whole, cut] = [false, true].map(|cut| Gather::new(rays_dump(&rays, cut)));
    let [whole, cut] = [&whole, &cut].map(|gather| SoftGather::new(gather, 1));
    let cells: Vec<u32> = (0..256).collect();
    let mut lit = 0;
    let is_smoothed_as_is = |light: &&Light| !matches!(light.shape, LightShape::Sheared { .. });
    for light in random_lights().iter().filter(is_smoothed_as_is) {
        for softness in [0.0005, 0.01] {
            let [expected, found] =
                [&whole, &cut].map(|soft| soft.linearise(light, softness, &cells).unwrap());
            let values = found.values.as_flattened().iter().zip(expected.values.as_flattened());
            let (error, sum) = apart(values);
            assert!(error <= 2e-3 * sum, "{error} of {sum}: {light:?} at {softness}");
            lit += usize::from(sum > 0.0);
        }
    }
    assert!(lit > 100, "{lit} lights are seen");
}
