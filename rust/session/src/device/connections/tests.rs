use super::*;
use crate::test_box::{
    block, bulbs, closed_box_around, closed_box_of, closed_box_with, closed_box_with_strands, curtain,
    floor_in, fog, frosted, glossy, glossy_grey, grey, hair, principled_glass, red, refracting, sheet, smoke,
    tinted,
};
use glam::Affine3A;
use relume_dump::MemoryWriter;
use relume_gather::SampleSplit;
use relume_scene::{HairModel, Instance, LightShape, ReceiverSet};
use relume_trace::Control;

#[test]
fn connected_light_has_the_mean_of_crossings_and_less_noise() {
    for nodes in [vec![grey()], glossy_grey(0.6), glossy(red(), 0.6), glossy(red(), 0.25)] {
        let noise = compare_with_crossings(closed_box_of((24, 24), nodes).unwrap(), 1024, &lights_in_box());
        assert!(noise.iter().all(|noise| *noise < 0.3), "{noise:?}");
    }
}

#[test]
fn connected_light_of_translucent_surfaces_has_the_mean_of_crossings_on_both_sides() {
    let behind = |x: f32, radius| LightShape::Sphere { center: Vec3::new(x, 0.2, -1.4), radius };
    let lights: Vec<Light> = lights_in_box()
        .into_iter()
        .chain([Light::unit(behind(0.2, 0.05)), Light::unit(behind(-0.3, 0.3))])
        .collect();
    let noise = compare_with_crossings(closed_box_of((24, 24), curtain()).unwrap(), 1024, &lights);
    assert!(noise.iter().all(|noise| *noise < 0.3), "{noise:?}");
}

#[test]
fn connected_light_of_media_behind_translucent_surfaces_has_the_mean_of_crossings() {
    // Walls are the hull of fog that fills the box, so that light from outside crosses into it.
    let mut scene = closed_box_of((24, 24), curtain()).unwrap();
    let nodes = &mut scene.materials[0].nodes;
    let first = nodes.len() as u32;
    nodes.extend(fog(0.5));
    scene.materials[0].volume = Some(first);
    let behind = LightShape::Sphere { center: Vec3::new(0.2, 0.2, -1.4), radius: 0.1 };
    compare_with_crossings(scene, 1024, &[Light::unit(behind), bulbs(1).remove(0)]);
}

#[test]
fn connected_light_of_rough_glass_has_the_mean_of_crossings_and_less_noise() {
    let bulb =
        |y: f32, z: f32, radius| Light::unit(LightShape::Sphere { center: Vec3::new(0.05, y, z), radius });
    // In the block, behind it, before it, and above, so large that crossings count; all but one are behind the sheet.
    let lights = [
        bulb(0.02, -0.7, 0.04),
        bulb(0.02, -0.98, 0.015),
        bulb(0.02, -0.4, 0.04),
        bulb(0.5, -0.7, 0.15),
        bulbs(1).remove(0),
    ];
    let scenes = [
        (sheet(), frosted(0.5), vec![]),
        (sheet(), principled_glass(1.0), vec![]),
        (block(), frosted(0.7), vec![]),
        (block(), refracting(0.4), vec![]),
        (block(), principled_glass(0.0), vec![]),
        (block(), frosted(0.5), tinted(3.0)),
    ];
    for (mesh, nodes, medium) in scenes {
        let scene = closed_box_with((24, 24), mesh, nodes, medium).unwrap();
        let noise = compare_with_crossings(scene, 2048, &lights);
        assert!(noise.iter().all(|noise| *noise < 0.8), "{noise:?}");
    }
}

#[test]
fn connected_light_of_hair_has_the_mean_of_crossings_and_less_noise() {
    for model in [HairModel::Chiang, HairModel::Huang] {
        let scene = closed_box_with_strands((24, 24), hair(model)).unwrap();
        let noise = compare_with_crossings(scene, 1024, &lights_in_box());
        // Edges of strands count as noise, too.
        assert!(noise.iter().all(|noise| *noise < 0.8), "{noise:?}");
    }
}

#[test]
fn connected_light_in_media_has_the_mean_of_crossings_and_less_noise() {
    for medium in [fog(0.8), smoke(3.0)] {
        let scene = closed_box_around((24, 24), vec![grey()], medium).unwrap();
        let noise = compare_with_crossings(scene, 1024, &lights_in_box());
        assert!(noise.iter().all(|noise| *noise < 0.3), "{noise:?}");
    }
}

#[test]
fn fog_beyond_what_is_recorded_is_lit_as_by_crossings() {
    // Near the end of the box around the floor: most of the fog that is seen lit is beyond.
    let shapes = [0.05, 0.1].map(|radius| LightShape::Sphere { center: Vec3::new(0.0, 0.25, 0.05), radius });
    compare_with_crossings(floor_in((24, 24), fog(0.4)).unwrap(), 4096, &shapes.map(Light::unit));
}

#[test]
fn connected_light_of_shadow_catchers_has_the_mean_of_crossings_and_is_whole_where_nothing_stands() {
    let mut scene = box_with_blocker();
    scene.instances[0].is_shadow_catcher = true;
    let noise = compare_with_crossings(scene.clone(), 1024, &lights_in_box());
    assert!(noise.iter().all(|noise| *noise < 0.3), "{noise:?}");
    // Without the blocker nothing casts a shadow: light of catchers among all objects and among catchers is the same.
    scene.instances.pop();
    let settings = TraceSettings { samples: 4, ..TraceSettings::default() };
    let manifest = Tracer::new(&scene, &settings).unwrap().manifest();
    let gather = Gather::new(MemoryWriter::new(manifest.clone()).unwrap().snapshot());
    let connections = Connections::new(Arc::new(scene), &manifest, None, 1).unwrap();
    connections.prepare(1);
    let (lights, plate) = (bulbs(1), 24 * 24 * 3);
    let emitters = connections.emitters(&lights).unwrap();
    let connected = connections.images(&gather, &lights, &emitters, 1, &|| false).unwrap();
    let plates: Vec<&[f32]> = connected[0].1.image.data.chunks_exact(plate).collect();
    assert_eq!(plates[1], plates[2]);
    assert!(plates[1].iter().sum::<f32>() > 1.0 && plates[0].iter().all(|value| *value == 0.0));
}

#[test]
fn connected_light_that_not_everything_blocks_has_the_mean_of_crossings_and_less_noise() {
    let mut scene = box_with_blocker();
    let mut lights = bulbs(3);
    for (light, receivers) in lights.iter_mut().zip([vec![], vec![0], vec![1]]) {
        light.rules.blockers = Some(ReceiverSet { receivers });
    }
    scene.lights = lights.clone();
    let noise = compare_with_crossings(scene, 1024, &lights);
    assert!(noise.iter().all(|noise| *noise < 0.3), "{noise:?}");
}

/// A closed box, seen from its middle, and a small one in it that casts a shadow.
fn box_with_blocker() -> Scene {
    let mut scene = closed_box_of((24, 24), vec![grey()]).unwrap();
    let mut blocker = Instance { name: "blocker".into(), receiver: 1, ..scene.instances[0].clone() };
    let (scale, place) = (Vec3::splat(0.12), Vec3::new(0.0, 0.0, -0.75));
    blocker.world_from_object = Affine3A::from_scale_rotation_translation(scale, Default::default(), place);
    scene.instances.push(blocker);
    scene
}

#[test]
fn vertices_of_twelve_large_shots_stay_within_the_memory_of_one_but_for_their_first_level() {
    let paths = [1, 1, 2, 4, 8, 16];
    // Three vertices of 64 bytes for each pixel and path.
    let first = |width: usize, height: usize| 192 * width * height;
    let kept = |bytes, shots| levels_within(VERTEX_MEMORY / shots, bytes, paths.into_iter());
    assert_eq!(kept(first(640, 360), 1), 5, "16 paths are 0.7 GB");
    assert_eq!(kept(first(3840, 2160), 1), 1, "even one is more");
    for (width, height) in [(640, 360), (960, 540), (1920, 1080), (3840, 2160)] {
        let bytes = first(width, height);
        for shots in 1..=12 {
            let of_one = paths[..kept(bytes, shots)].iter().sum::<u32>() as usize * bytes;
            assert!(of_one <= bytes.max(VERTEX_MEMORY / shots), "{shots} shots, {width} x {height}");
        }
    }
}

#[test]
fn preparing_goes_on_where_it_was_stopped() {
    let scene = Arc::new(closed_box_of((24, 24), vec![grey()]).unwrap());
    let settings = TraceSettings { samples: 2, tile_size: 8, ..TraceSettings::default() };
    let manifest = Tracer::new(&scene, &settings).unwrap().manifest();
    let connections = Connections::new(scene, &manifest, None, 1).unwrap();
    let traced = || connections.levels[0].kept.iter().filter(|tile| tile.get().is_some()).count();
    let asked = AtomicUsize::new(0);
    assert!(!connections.prepare_next(&|| asked.fetch_add(1, Ordering::Relaxed) >= 4));
    assert_eq!((traced(), connections.ready()), (4, 0));
    let asked = AtomicUsize::new(0);
    assert!(connections.prepare_next(&|| {
        asked.fetch_add(1, Ordering::Relaxed);
        false
    }));
    assert_eq!((traced(), connections.ready()), (9, 1));
    assert!(!connections.is_prepared());
    while connections.prepare_next(&|| false) {}
    assert!(connections.is_prepared());
}

fn lights_in_box() -> Vec<Light> {
    let mut lights = bulbs(3);
    let panel = |edge: f32| LightShape::Quad {
        center: Vec3::new(0.2, 0.1, 0.9),
        edge_u: Vec3::Y * edge,
        edge_v: Vec3::X * edge,
        spread: std::f32::consts::PI,
    };
    let large = [panel(0.1), panel(1.2), LightShape::Sphere { center: Vec3::splat(0.7), radius: 0.6 }];
    lights.extend(large.map(Light::unit));
    lights
}

/// Checks means of lights, and returns the noise of each with connections over that of as many paths' crossings.
fn compare_with_crossings(scene: Scene, samples: u32, lights: &[Light]) -> Vec<f64> {
    let scene = Arc::new(scene);
    let settings = TraceSettings { samples, ..TraceSettings::default() };
    let tracer = Tracer::new(&scene, &settings).unwrap();
    let writer = MemoryWriter::new(tracer.manifest()).unwrap();
    tracer.trace(&writer, &Control::default()).unwrap();
    let gather = Gather::new(writer.snapshot());
    // As many paths as are connected.
    let few = Gather::new(gather.dump().passes(0..6));
    let connections = Connections::new(scene.clone(), gather.dump().manifest(), None, 1).unwrap();
    while connections.prepare_next(&|| false) {}
    let emitters = connections.emitters(lights).unwrap();
    let joined = connections.images(&gather, lights, &emitters, usize::MAX, &|| false).unwrap();
    let rest = gather.unit_images(&connections.crossed(&gather, lights).unwrap(), SampleSplit::All);
    let compare = |((light, mut image), (_, joined)): ((&Light, Image), (usize, Arc<ConnectedImage>))| {
        image.add_scaled(&joined.image, &[1.0; 3]);
        let crossed = &gather.unit_images(&[gather.prepare(light).unwrap()], SampleSplit::All)[0];
        // Both plates that show shadow catchers are alike.
        let alike = if scene.has_shadow_catchers() { 2.0 } else { 1.0 };
        for channel in 0..3 {
            let pairs = crossed.data.iter().zip(&image.data).skip(channel).step_by(3);
            let differences: Vec<f64> = pairs.map(|(a, b)| f64::from(a - b)).collect();
            let count = differences.len() as f64;
            let mean = differences.iter().sum::<f64>() / count;
            let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
            let standard_error = (alike * variance / count).sqrt();
            assert!(mean.abs() < 4.0 * standard_error, "channel {channel}: {mean} +- {standard_error}");
        }
        let noise = |image: &Image| {
            let rough = image.data.chunks_exact(3).zip(image.data[3..].chunks_exact(3));
            rough.map(|(a, b)| f64::from(a[0] - b[0]).powi(2)).sum::<f64>()
        };
        let few = &few.unit_images(&[few.prepare(light).unwrap()], SampleSplit::All)[0];
        noise(&image) / noise(few)
    };
    lights.iter().zip(rest).zip(joined).map(compare).collect()
}
