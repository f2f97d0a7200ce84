//! Every way of gathering gives the same numbers, and factors and sets select what they name.

use glam::{Mat3, Vec3};
use relume_dump::{Dump, End, Lobe, Manifest, Segment, SegmentClasses, TileSamples};
use relume_scene::{Light, LightShape, LobeFactors, ReceiverSet};

use super::{Random, dump, light, manifest, segment};
use crate::kernel::Isa;
use crate::light::{FAR, PreparedLight, Profile};
use crate::{Balance, Gather, SampleSplit};

/// 6 x 6 pixels, passes of 1, 3 and 4 samples, up to 5 random segments a path.
fn random_dump() -> Dump {
    random_dump_of(6, &[1, 3, 4])
}

/// Random dump of a square image with passes of these sizes, of which some segments continue the ones before.
pub fn random_dump_of(size: usize, samples: &[u32]) -> Dump {
    random_paths(manifest(size, samples), 0.3)
}

/// [`random_dump_of`] of two objects, with segments of lights without shadow.
pub fn random_classes_of(size: usize, samples: &[u32]) -> Dump {
    let classes = SegmentClasses { blockers: vec![Vec::new()], ..SegmentClasses::default() };
    let receivers = vec!["A".into(), "B".into()];
    random_paths(Manifest { receivers, classes: Some(classes), ..manifest(size, samples) }, 0.3)
}

/// [`random_dump_of`] with segments that are whole rays.
pub fn random_rays_of(size: usize, samples: &[u32]) -> Dump {
    random_paths(manifest(size, samples), 0.0)
}

/// Random paths of which a share of segments continues the ones before.
fn random_paths(manifest: Manifest, continuing: f32) -> Dump {
    let (mut random, mut pieces) = (Random(3), Random(12));
    dump(manifest, |_, _, samples: &mut TileSamples| {
        let mut before = (Lobe::Camera, 0);
        for depth in 0..1 + (random.next() * 5.0) as usize {
            let lobe = Lobe::ALL[if depth == 0 { 0 } else { 1 + (random.next() * 6.0) as usize }];
            let throughput = Vec3::new(random.next(), random.next(), random.next());
            let receiver = (random.next() * 5.0) as u16;
            let escapes = random.next() < 0.2;
            let end = match escapes {
                true => End::Escape(random.point(1.0).normalize()),
                false => End::Vertex(random.point(3.0)),
            };
            let continues = depth > 0 && pieces.next() < continuing;
            before = if continues { before } else { (lobe, receiver) };
            let (lobe, receiver) = before;
            samples.push(Segment { end, throughput, lobe, receiver, continues });
            if escapes {
                break;
            }
        }
    })
}

/// Ten of each kind, some of them linked to a few receivers; sheared and stretched ones last.
pub fn random_lights() -> Vec<Light> {
    let mut random = Random(4);
    let mut lights = Vec::new();
    for kind in 0..80 {
        let (center, radius) = (random.point(2.0), random.range(0.3, 1.5));
        let (edge_u, direction) = (random.point(3.0), random.point(1.0).normalize());
        let edge_v = edge_u.cross(direction);
        let spread = random.range(0.5, 4.0);
        let shape = match kind % 6 {
            _ if kind >= 60 => odd_shape(&mut random, kind % 4, center, [edge_u, edge_v], spread),
            0 => LightShape::Sphere { center, radius },
            1 => LightShape::FacingDisk { center, radius },
            2 => LightShape::Spot {
                center,
                radius,
                axis: direction,
                half_angle: random.range(0.2, 1.5),
                blend: random.next(),
                soft_falloff: kind % 4 == 0,
            },
            3 => LightShape::Quad { center, edge_u, edge_v, spread },
            4 => LightShape::Ellipse { center, edge_u, edge_v, spread },
            _ => LightShape::Sun { direction, half_angle: random.range(0.1, 1.5) },
        };
        let lobes = LobeFactors { camera: random.next(), glossy: 0.5, ..LobeFactors::default() };
        let receivers = (kind % 5 == 0).then(|| ReceiverSet { receivers: vec![0, 3] });
        lights.push(Light { lobes, receivers, ..light(shape) });
    }
    lights
}

/// [`random_lights`], every second one as one that is connected, too.
pub fn prepare_random(gather: &Gather) -> Vec<PreparedLight> {
    let balance = Balance { connected: 3, crossed: 1 };
    let prepare = |(number, light)| match number % 2 {
        0 => gather.prepare(light),
        _ => gather.prepare_balanced(light, balance),
    };
    random_lights().iter().enumerate().map(prepare).collect::<Result<_, _>>().unwrap()
}

/// A sheared area light or a stretched spot, of four kinds.
fn odd_shape(random: &mut Random, kind: usize, center: Vec3, edges: [Vec3; 2], spread: f32) -> LightShape {
    let [edge_u, edge_v] = edges;
    if kind < 2 {
        return LightShape::Sheared {
            center,
            edge_u,
            edge_v: edge_v + random.range(-0.5, 0.5) * edge_u,
            facing: (edge_u.cross(edge_v).normalize() + random.point(0.3)).normalize(),
            spread,
            is_ellipse: kind == 0,
        };
    }
    LightShape::StretchedSpot {
        center,
        radius: random.range(0.3, 1.5),
        local_from_world: Mat3::from_rotation_x(random.range(0.0, 3.0))
            * Mat3::from_cols(Vec3::X, Vec3::new(random.range(-0.5, 0.5), 0.6, 0.2), Vec3::Z * 1.4),
        half_angle: random.range(0.2, 1.5),
        blend: random.next(),
        soft_falloff: kind == 2,
    }
}

#[test]
fn all_instruction_sets_and_one_by_one_are_equal_bit_by_bit() {
    let dump = random_dump();
    let portable = Gather::new(dump.clone()).with_isa(Isa::Portable);
    let lights = prepare_random(&portable);
    let halves = [SampleSplit::All, SampleSplit::First, SampleSplit::Second];
    for (isa, half) in Isa::available().into_iter().flat_map(|isa| halves.map(|half| (isa, half))) {
        let gather = Gather::new(dump.clone()).with_isa(isa);
        let many = gather.unit_images(&lights, half);
        assert_eq!(many, portable.unit_images(&lights, half), "{isa:?}");
        for (light, image) in lights.iter().zip(&many) {
            assert_eq!(&gather.unit_images(std::slice::from_ref(light), half)[0], image, "{isa:?}");
        }
        for (x, y) in [(0, 0), (5, 5), (3, 4)] {
            let pixel = gather.pixel(x, y, &lights, half);
            let expected: Vec<_> = many.iter().map(|image| image.pixel(x, y).to_vec()).collect();
            assert_eq!(pixel.iter().map(|rgb| rgb.to_vec()).collect::<Vec<_>>(), expected, "{isa:?}");
        }
    }
}

#[test]
fn lights_near_each_other_are_gathered_as_one_by_one() {
    let dump = random_dump();
    let portable = Gather::new(dump.clone()).with_isa(Isa::Portable);
    for radius in [0.2, 0.6, 3.0] {
        let mut random = Random(6);
        let center = random.point(0.5);
        let mut shape = |number: usize| match (center + random.point(0.3 * radius), number % 2) {
            (center, 0) => LightShape::Sphere { center, radius },
            (center, _) => {
                let (edge_u, edge_v) = (Vec3::X * radius, Vec3::Y * radius);
                LightShape::Quad { center, edge_u, edge_v, spread: std::f32::consts::PI }
            }
        };
        let lights: Vec<_> = (0..7).map(|number| light(shape(number))).collect();
        let lights = portable.prepare_all(&lights).unwrap();
        let expected: Vec<_> = lights
            .iter()
            .flat_map(|one| portable.unit_images(std::slice::from_ref(one), SampleSplit::All))
            .collect();
        assert!(expected.iter().any(|image| image.data.iter().any(|value| *value > 0.0)), "{radius}");
        for isa in Isa::available() {
            let gather = Gather::new(dump.clone()).with_isa(isa);
            assert_eq!(gather.unit_images(&lights, SampleSplit::All), expected, "{isa:?}, {radius}");
        }
    }
}

#[test]
fn the_kernel_equals_a_plain_loop_over_decoded_segments() {
    let dump = random_dump();
    let gather = Gather::new(dump.clone());
    let lights = gather.prepare_all(&random_lights()).unwrap();
    let images = gather.unit_images(&lights, SampleSplit::All);
    let mut lit = 0;
    for (light, image) in lights.iter().zip(&images) {
        // The third power of how a sheared light's directions are stretched triples their rounding.
        let tolerance = if matches!(light.profile, Profile::Sheared(_)) { 3e-5 } else { 1e-5 };
        for (x, y) in (0..6).flat_map(|y| (0..6).map(move |x| (x, y))) {
            let mut sum = Vec3::ZERO;
            for (shard, pixel) in dump.pixel(x, y) {
                for (record, s) in shard.pixel(pixel).map(|record| (record, shard.segment(record).unwrap())) {
                    let edge = match s.end {
                        End::Vertex(vertex) => vertex - s.origin,
                        End::Escape(direction) => direction * FAR,
                    };
                    let before = edge.normalize() * shard.ray_origin(record).distance(s.origin);
                    let from = s.origin - before;
                    let is_crossed = light.profile.evaluate(from, before, false) != 0.0;
                    let crossed = light.profile.evaluate(from, before + edge, s.flags.escaped());
                    let collected = if is_crossed { 0.0 } else { crossed };
                    sum += s.throughput * (light.factor(s.flags) * collected);
                }
            }
            let expected = (sum * 0.125).to_array();
            let found = image.pixel(x, y);
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance * b),
                "{found:?} {expected:?}"
            );
            lit += usize::from(sum != Vec3::ZERO);
        }
    }
    assert!(lit > 500, "only {lit} of 2160 values are lit: the test shows nothing");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let gather = Gather::new(random_dump());
    let lights = gather.prepare_all(&random_lights()).unwrap();
    let images = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| gather.unit_images(&lights, SampleSplit::All))
    };
    assert_eq!(images(1), images(3));
}

#[test]
fn the_halves_share_no_path_and_make_up_the_whole() {
    let gather = Gather::new(random_dump());
    let lights = gather.prepare_all(&random_lights()).unwrap();
    let [all, first, second] = [SampleSplit::All, SampleSplit::First, SampleSplit::Second]
        .map(|half| gather.unit_images(&lights, half));
    let samples = |half: SampleSplit| half.tile_samples(gather.dump(), 0) as f32;
    // Passes of 1, 3 and 4: 0 + 2 + 2 and 1 + 1 + 2.
    assert_eq!([SampleSplit::First, SampleSplit::Second, SampleSplit::All].map(samples), [4.0, 4.0, 8.0]);
    for ((all, first), second) in all.iter().zip(&first).zip(&second) {
        for ((all, first), second) in all.data.iter().zip(&first.data).zip(&second.data) {
            assert!((all - 0.5 * (first + second)).abs() <= 1e-5 * all.abs());
        }
    }
    assert_ne!(first, second);
}

/// One path of seven segments through the light at the origin, with different lobes and receivers.
fn crossing_dump() -> Dump {
    dump(manifest(1, &[1]), |_, _, samples: &mut TileSamples| {
        for (index, lobe) in Lobe::ALL.into_iter().enumerate() {
            let end = Vec3::new(0.0, 0.0, if index % 2 == 0 { -5.0 } else { 5.0 });
            let throughput = Vec3::splat(f32::from(1u8 << index));
            let receiver = index as u16;
            samples.push(Segment { end: End::Vertex(end), throughput, lobe, receiver, continues: false });
        }
        samples.push(segment(End::Escape(Vec3::X), Lobe::Diffuse));
    })
}

fn crossing_value(edit: impl FnOnce(&mut Light)) -> f32 {
    let mut lamp = light(LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 });
    lamp.lobes.camera = 1.0;
    edit(&mut lamp);
    let gather = Gather::new(crossing_dump());
    gather.pixel(0, 0, &[gather.prepare(&lamp).unwrap()], SampleSplit::All)[0][0]
}

#[test]
fn each_crossing_counts_once_with_the_factor_of_its_lobe() {
    assert_eq!(crossing_value(|_| ()), 1.0 + 2.0 + 4.0 + 8.0 + 16.0 + 32.0 + 64.0);
    let only = |lobes| crossing_value(|lamp| lamp.lobes = lobes);
    let none = LobeFactors { camera: 0.0, diffuse: 0.0, glossy: 0.0, transmission: 0.0, volume: 0.0 };
    assert_eq!(only(LobeFactors { camera: 1.0, ..none }), 1.0);
    assert_eq!(only(LobeFactors { diffuse: 0.5, ..none }), 1.0);
    assert_eq!(only(LobeFactors { glossy: 1.0, ..none }), 4.0 + 32.0);
    assert_eq!(only(LobeFactors { transmission: 1.0, ..none }), 8.0 + 64.0);
    assert_eq!(only(LobeFactors { volume: 2.0, ..none }), 32.0);
    assert_eq!(only(LobeFactors::default()), 126.0);
}

#[test]
fn light_linking_selects_receivers_but_not_camera_rays() {
    let linked = |receivers: &[u16]| {
        crossing_value(|lamp| lamp.receivers = Some(ReceiverSet { receivers: receivers.to_vec() }))
    };
    assert_eq!(linked(&[]), 1.0);
    assert_eq!(linked(&[2, 4]), 1.0 + 4.0 + 16.0);
    assert_eq!(linked(&[1, 2047, 65535]), 1.0 + 2.0);
}

#[test]
fn origin_records_start_segments_and_are_none() {
    let mut camera_vertices = manifest(1, &[2]);
    camera_vertices.camera_position = None;
    let mut samples = TileSamples::new(camera_vertices.tile_rect(0));
    samples.begin_pixel();
    for x in [0.0, 10.0] {
        samples.begin_path(Some(Vec3::new(x, 0.0, 5.0)));
        samples.push(segment(End::Vertex(Vec3::new(x, 0.0, -5.0)), Lobe::Diffuse));
    }
    let mut dump = Dump::in_memory(camera_vertices.clone()).unwrap();
    let shard = relume_dump::Shard::encode(&camera_vertices, 0, 0, &samples).unwrap();
    dump.insert(0, 0, std::sync::Arc::new(shard)).unwrap();
    let gather = Gather::new(dump);
    let value = |center| {
        let lamp = light(LightShape::Sphere { center, radius: 0.5 });
        gather.pixel(0, 0, &[gather.prepare(&lamp).unwrap()], SampleSplit::All)[0][0]
    };
    assert_eq!(value(Vec3::ZERO), 0.5);
    assert_eq!(value(Vec3::new(10.0, 0.0, 0.0)), 0.5);
    // On the line from the end of the first path to the start of the second, and from the world's origin.
    assert_eq!(value(Vec3::new(5.0, 0.0, 0.0)), 0.0);
    assert_eq!(value(Vec3::new(5.0, 0.0, 2.5)), 0.0);
}

#[test]
fn lights_that_are_none_are_refused_by_name() {
    let gather = Gather::new(crossing_dump());
    for shape in [
        LightShape::Sphere { center: Vec3::NAN, radius: 1.0 },
        LightShape::FacingDisk { center: Vec3::ZERO, radius: 0.0 },
        LightShape::Quad { center: Vec3::ZERO, edge_u: Vec3::X, edge_v: Vec3::X, spread: 1.0 },
        LightShape::Ellipse { center: Vec3::ZERO, edge_u: Vec3::X, edge_v: Vec3::Y, spread: f32::NAN },
        LightShape::Sun { direction: Vec3::ZERO, half_angle: 0.1 },
    ] {
        assert!(gather.prepare(&light(shape)).unwrap_err().to_string().contains("light 'Lamp'"));
    }
}

#[test]
fn visible_bounds_hold_what_camera_segments_reach() {
    let (min, max) = Gather::new(crossing_dump()).visible_bounds().unwrap();
    assert!(min.distance(Vec3::new(0.0, 0.0, -5.0)) < 1e-3 && max.distance(min) < 1e-3, "{min} {max}");
}

#[test]
fn halves_of_whole_passes_make_up_the_whole() {
    let dump = |passes: &[u32]| {
        let mut random = Random(11);
        dump(manifest(32, passes), move |_, _, samples: &mut TileSamples| {
            samples.push(segment(End::Vertex(Vec3::new(0.0, 0.0, 5.0)), Lobe::Camera));
            let z = if random.next() < 0.25 { -5.0 } else { 4.0 };
            samples.push(segment(End::Vertex(Vec3::new(0.0, 0.0, z)), Lobe::Diffuse));
        })
    };
    let gather = Gather::new(dump(&[1, 1, 2, 4]));
    let lamp = [gather.prepare(&light(LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 })).unwrap()];
    let of = |half| {
        let (part, rest) = gather.split(half);
        assert_eq!(
            (rest, part.dump().manifest().passes.len()),
            (SampleSplit::All, if half == SampleSplit::First { 3 } else { 1 })
        );
        part.unit_images(&lamp, rest).remove(0)
    };
    let (all, first, second) = (
        gather.unit_images(&lamp, SampleSplit::All).remove(0),
        of(SampleSplit::First),
        of(SampleSplit::Second),
    );
    assert!(first != second);
    for ((all, first), second) in all.data.iter().zip(&first.data).zip(&second.data) {
        assert!((0.5 * (first + second) - all).abs() < 1e-6);
    }
    let uneven = Gather::new(dump(&[4, 2]));
    assert_eq!(uneven.split(SampleSplit::First).1, SampleSplit::First);
}
