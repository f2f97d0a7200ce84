//! World, light positions, sums and noise.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use relume_dump::{End, Lobe, Manifest, Segment, SegmentClasses, Sight, TileSamples};
use relume_image::Image;
use relume_scene::{
    Alpha, ColorEncoding, Light, LightRules, LightShape, ReceiverSet, Texels, Texture, World,
};

use super::{Random, dump, light, manifest, segment};
use crate::{Environment, Gather, Noise, SampleSplit, relight};

fn world(color: [f32; 3], texture: Option<usize>) -> World {
    World { color, texture, texture_from_world: Mat3::IDENTITY, visible_camera: true, ..World::default() }
}

fn texture(width: usize, height: usize, texels: Texels) -> Texture {
    let encoding = ColorEncoding::Srgb;
    Texture { name: "Sky".into(), width, height, texels, encoding, alpha: Alpha::default() }
}

/// 8 x 4 texels, red = column, green = row, blue = 1.
fn numbered() -> Texture {
    let texels = (0..32).flat_map(|i| [(i % 8) as f32, (i / 8) as f32, 1.0, 1.0]);
    texture(8, 4, Texels::Float(texels.collect()))
}

#[test]
fn the_equirectangular_map_is_blenders() {
    let environment = Environment::new(&world([2.0, 2.0, 2.0], Some(0)), &[numbered()]).unwrap();
    // Horizon, as Blender shows it: +x in the middle of the image, -y right of it, +y left, -x at both ends.
    let at = |direction: Vec3| environment.radiance(direction) * 0.5;
    assert!((at(Vec3::X).x - 3.5).abs() < 1e-3);
    assert!((at(Vec3::NEG_Y).x - 5.5).abs() < 1e-3);
    assert!((at(Vec3::Y).x - 1.5).abs() < 1e-3);
    // Between the last column and the first.
    assert!((at(Vec3::NEG_X).x - 3.5).abs() < 1e-3);
    // Row centres lie at 22.5 degrees steps from straight down.
    for row in 0..4 {
        let elevation = (row as f32 + 0.5) * PI / 4.0 - PI / 2.0;
        let direction = Vec3::new(elevation.cos(), 0.0, elevation.sin());
        assert!((at(direction).y - row as f32).abs() < 1e-3, "{row}: {}", at(direction));
    }
    let turned = World { texture_from_world: Mat3::from_rotation_z(PI / 2.0), ..world([1.0; 3], Some(0)) };
    let turned = Environment::new(&turned, &[numbered()]).unwrap();
    assert!((turned.radiance(Vec3::X).x - 1.5).abs() < 1e-3);
}

#[test]
fn byte_textures_are_decoded_and_bad_sizes_refused() {
    let gray = texture(1, 1, Texels::Byte(vec![188, 188, 188, 255]));
    let environment = Environment::new(&world([1.0; 3], Some(0)), &[gray]).unwrap();
    assert!((environment.radiance(Vec3::Z).x - 0.5028865).abs() < 1e-5);
    let short = texture(2, 2, Texels::Byte(vec![0; 15]));
    let error = Environment::new(&world([1.0; 3], Some(0)), &[short]).unwrap_err();
    assert!(error.to_string().contains("'Sky' has 15 values instead of 16"), "{error}");
}

#[test]
fn a_constant_world_gives_the_share_of_escaping_paths() {
    let dump = dump(manifest(5, &[1, 4]), |pixel, sample, samples: &mut TileSamples| {
        samples.push(segment(End::Vertex(Vec3::ONE), Lobe::Camera));
        match pixel % 5 {
            // All escape, after a diffuse bounce.
            0 => samples.push(segment(End::Escape(Vec3::Z), Lobe::Diffuse)),
            // Two of five.
            1 if sample < 2 => samples.push(segment(End::Escape(Vec3::Z), Lobe::Diffuse)),
            // The camera passes through glass.
            2 => samples.push(Segment { continues: true, ..segment(End::Escape(Vec3::Z), Lobe::Camera) }),
            _ => samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Diffuse)),
        }
    });
    let gather = Gather::new(dump);
    let image = |visible_camera| {
        let world = World { visible_camera, ..world([1.0, 2.0, 0.0], None) };
        gather.world_image(&Environment::new(&world, &[]).unwrap(), SampleSplit::All)
    };
    let (shown, hidden) = (image(true), image(false));
    for x in 0..5 {
        let share = [1.0, 0.4, 1.0, 0.0, 0.0][x];
        assert_eq!(shown.pixel(x, 3), [share, 2.0 * share, 0.0]);
        let share = [1.0, 0.4, 0.0, 0.0, 0.0][x];
        assert_eq!(hidden.pixel(x, 3), [share, 2.0 * share, 0.0]);
    }
}

/// Two objects; lights that nothing blocks, that only object 1 blocks, and that light one bounce.
fn classes() -> Manifest {
    let classes = SegmentClasses {
        bounce_limits: vec![1],
        blockers: vec![vec![], vec![1]],
        ..SegmentClasses::default()
    };
    Manifest { receivers: vec!["A".into(), "B".into()], classes: Some(classes), ..manifest(1, &[1]) }
}

#[test]
fn worlds_and_lights_count_along_classes_of_their_own() {
    let known = SegmentClasses { film_glass: true, fast_gi: true, ..SegmentClasses::default() };
    let manifest =
        Manifest { receivers: vec!["A".into()], classes: Some(known.clone()), ..manifest(1, &[1]) };
    let dump = dump(manifest, |_, _, samples: &mut TileSamples| {
        samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Camera));
        for class in 0..known.count() {
            let back = Segment { throughput: Vec3::ZERO, ..segment(End::Vertex(Vec3::ZERO), Lobe::Diffuse) };
            let throughput = Vec3::splat((1 << class) as f32);
            let crossing = segment(End::Escape(Vec3::Z), Lobe::Transmission);
            samples.push(Segment { throughput, receiver: class as u16, ..crossing });
            samples.push(back);
        }
    });
    let gather = Gather::new(dump);
    let lamp = light(LightShape::Sphere { center: Vec3::Z * 3.0, radius: 0.5 });
    let lit = |rules: LightRules| {
        let prepared = gather.prepare(&Light { rules, ..lamp.clone() }).unwrap();
        gather.unit_images(&[prepared], SampleSplit::All)[0].data[0]
    };
    let of =
        |sights: &[Sight]| -> f32 { sights.iter().map(|sight| (1 << known.class(*sight, 0)) as f32).sum() };
    let shadow = [Sight::Shadow, Sight::ShadowWithoutWorld];
    let singular = [Sight::Singular, Sight::SingularWithoutWorld];
    assert_eq!(lit(LightRules::default()), of(&shadow) + of(&singular));
    assert_eq!(lit(LightRules { is_sampled_only: true, ..LightRules::default() }), of(&shadow));
    let white = Environment::new(&world([1.0; 3], None), &[]).unwrap();
    let seen = gather.world_image(&white, SampleSplit::All).data[0];
    assert_eq!(seen, of(&[Sight::Shadow, Sight::Singular, Sight::World]));
}

#[test]
fn lights_count_along_the_segments_of_their_rules() {
    let manifest = classes();
    let known = manifest.classes.clone().unwrap();
    // Each class has its own throughput, and object 1 has 100 times that of object 0.
    let of_class = |class: usize| (1 << class) as f32;
    let dump = dump(manifest, |_, _, samples: &mut TileSamples| {
        samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Camera));
        for (class, object) in (0..known.count()).flat_map(|class| [(class, 0), (class, 1)]) {
            let back = Segment { throughput: Vec3::ZERO, ..segment(End::Vertex(Vec3::ZERO), Lobe::Diffuse) };
            let throughput = Vec3::splat(of_class(class) * [1.0, 256.0][object]);
            let receiver = (object + 2 * class) as u16;
            let crossing = segment(End::Escape(Vec3::Z), Lobe::Diffuse);
            samples.push(Segment { throughput, receiver, ..crossing });
            samples.push(back);
        }
    });
    let gather = Gather::new(dump);
    let sum = |classes: &[(Sight, u32)]| -> f32 {
        classes.iter().map(|&(sight, bounces)| of_class(known.class(sight, bounces))).sum()
    };
    let found = |rules: LightRules, receivers: Option<Vec<u16>>| {
        let receivers = receivers.map(|receivers| ReceiverSet { receivers });
        let lamp = light(LightShape::Sphere { center: Vec3::Z * 3.0, radius: 0.5 });
        let prepared = gather.prepare(&Light { rules, receivers, ..lamp }).unwrap();
        gather.unit_images(&[prepared], SampleSplit::All)[0].data[0]
    };
    let (near, far) = (1, 2);
    let singular = [(Sight::Singular, near), (Sight::Singular, far)];
    let shadow = [(Sight::Shadow, near), (Sight::Shadow, far)];
    let linked = |set| [(Sight::Linked(set), near), (Sight::Linked(set), far)];
    let blockers = |receivers| Some(ReceiverSet { receivers });
    let usual = LightRules::default();
    let ordinary = sum(&shadow) + sum(&singular);
    assert_eq!(found(usual.clone(), Some(vec![0])), ordinary);
    assert_eq!(found(usual.clone(), None), 257.0 * ordinary);
    assert_eq!(found(LightRules { is_sampled_only: true, ..usual.clone() }, Some(vec![0])), sum(&shadow));
    let few = LightRules { max_bounces: Some(1), ..usual.clone() };
    assert_eq!(found(few, Some(vec![0])), sum(&shadow[..1]) + sum(&singular));
    for (set, receivers) in [(0, vec![]), (1, vec![1])] {
        let rules = LightRules { blockers: blockers(receivers), ..usual.clone() };
        assert_eq!(found(rules, Some(vec![0])), sum(&linked(set)) + sum(&singular));
    }
    let unknown = LightRules { blockers: blockers(vec![0]), ..usual };
    assert_eq!(found(unknown, Some(vec![0])), ordinary);
    // The world counts along what everything blocks.
    let environment = Environment::new(&world([1.0; 3], None), &[]).unwrap();
    assert_eq!(gather.world_image(&environment, SampleSplit::All).data[0], 257.0 * ordinary);
}

#[test]
fn segment_points_are_uniform_over_segments_and_along_them() {
    // One segment down 2 m, one along x by 6 m and y by 1 m, and an escape back along x to the end of the box.
    let dump = dump(manifest(1, &[1]), |_, _, samples: &mut TileSamples| {
        samples.push(segment(End::Vertex(Vec3::new(0.0, 0.0, 3.0)), Lobe::Camera));
        samples.push(segment(End::Vertex(Vec3::new(6.0, 1.0, 3.0)), Lobe::Diffuse));
        samples.push(segment(End::Escape(Vec3::new(-1.0, 0.0, 0.0)), Lobe::Diffuse));
    });
    let gather = Gather::new(dump);
    let mut random = Random(9);
    let mut counts = [0; 3];
    let mut mean = Vec3::ZERO;
    // The box and a tenth of its diagonal.
    let end = -0.1 * Vec3::new(6.0, 1.0, 0.0).length();
    for _ in 0..3000 {
        let point = gather.segment_point(0, 0, [random.next(), random.next()]).unwrap();
        let (down, back) = (point.x.abs() < 1e-3 && point.y < 1e-3, (point.y - 1.0).abs() < 1e-3);
        assert!(point.x <= 6.001 && point.x >= end - 1e-3 && point.z > 2.999 && point.z <= 5.0, "{point}");
        counts[if down {
            0
        } else if back {
            2
        } else {
            1
        }] += 1;
        mean += point / 3000.0;
    }
    assert!(counts.iter().all(|&count| (850..1150).contains(&count)), "{counts:?}");
    let expected = Vec3::new((3.0 + 0.5 * (6.0 + end)) / 3.0, 0.5, 10.0 / 3.0);
    assert!((mean - expected).abs().max_element() < 0.15, "{mean} {expected}");
}

#[test]
fn relight_weighs_and_sums() {
    let unit = |value: f32| Image { width: 3, height: 40, channels: 3, data: vec![value; 360] };
    let (a, b) = (unit(1.0), unit(0.5));
    let sum = relight((3, 40), &[(&a, [1.0, 2.0, 3.0]), (&b, [2.0, 0.0, 4.0])]);
    assert!((0..40).all(|y| sum.pixel(1, y) == [2.0, 2.0, 5.0]));
    assert_eq!(relight((3, 40), &[]), Image::new(3, 40, 3));
}

#[test]
fn noise_between_halves_predicts_the_error_of_the_whole() {
    // Each path sees the light with probability 1/4: the variance of the mean of n samples is 3/16 / n.
    let (size, samples) = (32, 64);
    let mut random = Random(5);
    let dump = dump(manifest(size, &[samples]), |_, _, samples: &mut TileSamples| {
        samples.push(segment(End::Vertex(Vec3::new(0.0, 0.0, 5.0)), Lobe::Camera));
        let z = if random.next() < 0.25 { -5.0 } else { 4.0 };
        samples.push(segment(End::Vertex(Vec3::new(0.0, 0.0, z)), Lobe::Diffuse));
    });
    let gather = Gather::new(dump);
    let lamp = gather.prepare(&light(LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 })).unwrap();
    let [first, second] = [SampleSplit::First, SampleSplit::Second]
        .map(|half| gather.unit_images(std::slice::from_ref(&lamp), half).remove(0));
    let noise = Noise::between(&first, &second);
    let expected = (3.0 / 16.0 / samples as f32).sqrt();
    // 1024 independent pixels: the estimate of a standard deviation is good to 1/sqrt(2 * 1024) = 2.2 %.
    assert!((noise.rmse / expected - 1.0).abs() < 0.09, "{noise:?} {expected}");
    assert!((noise.mean - 0.25).abs() < 0.01 && (noise.relative() - 4.0 * expected).abs() < 0.02);
    assert_eq!(Noise::default().relative(), 0.0);
}
