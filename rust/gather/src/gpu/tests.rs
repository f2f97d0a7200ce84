//! The GPU gathers what the CPU does. Any device will do, a software driver included; that there is none is a failure.

use glam::Vec3;
use relume_dump::{End, Lobe};
use relume_gpu::{GpuChoice, GpuError};
use relume_scene::{Light, LightShape};

use super::*;
use crate::tests::kernels::{prepare_random, random_dump_of, random_lights};
use crate::tests::{Random, dump, light, manifest, segment};

const HALVES: [SampleSplit; 3] = [SampleSplit::All, SampleSplit::First, SampleSplit::Second];

pub fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best)
        .expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

/// Relative error of sums of at most some hundred positive values in another order, of a weight that the GPU computes with
/// divisions and roots of 2.5 units in the last place (6e-8 each).
const ROUNDING: f32 = 1e-5;
/// Weights end in a smooth way at 0, where their error is absolute: that of a cosine, 3e-7, times the slope of the blend of
/// the test's narrowest cone edge, 50, or of its narrowest spread, 200.
const WEIGHT_ROUNDING: f32 = 6e-5;

/// Values of an image that differ by more than rounding: those where a segment was decided otherwise.
fn differing(found: &Image, expected: &Image) -> usize {
    assert_eq!((found.width, found.height, found.channels), (expected.width, expected.height, 3));
    let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > ROUNDING * *b + WEIGHT_ROUNDING;
    found.data.iter().zip(&expected.data).filter(differs).count()
}

fn mean(image: &Image) -> f64 {
    image.data.iter().map(|&value| f64::from(value)).sum::<f64>() / image.data.len() as f64
}

#[test]
fn images_equal_those_of_the_cpu_for_every_light_and_half() {
    let gather = Gather::new(random_dump_of(10, &[1, 3, 4, 40]));
    let lights = prepare_random(&gather);
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    assert!(on_gpu.is_resident());
    let (mut lit, mut different) = (0, 0);
    for half in HALVES {
        let (found, expected) =
            (on_gpu.unit_images(&lights, half).unwrap(), gather.unit_images(&lights, half));
        assert_eq!(found.len(), expected.len());
        for (index, (found, expected)) in found.iter().zip(&expected).enumerate() {
            lit += expected.data.iter().filter(|&&value| value > 0.0).count();
            let here = differing(found, expected);
            assert!(here <= 3, "{here} values of light {index} differ");
            different += here;
            assert!((mean(found) - mean(expected)).abs() <= 1e-5 * mean(expected) + 1e-3 * here as f64);
        }
    }
    println!("{different} of {lit} values differ");
    // 1.6 million tests of a segment, each with an edge of about 1e-6 of its size that may be decided otherwise.
    assert!(lit > 20_000 && different <= 6, "{different} of {lit} values differ");
}

#[test]
fn results_do_not_depend_on_the_run_or_on_the_lights_beside() {
    let gather = Gather::new(random_dump_of(6, &[8]));
    let lights = gather.prepare_all(&random_lights()[..6]).unwrap();
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let many = on_gpu.unit_images(&lights, SampleSplit::All).unwrap();
    assert_eq!(many, on_gpu.unit_images(&lights, SampleSplit::All).unwrap());
    for (light, image) in lights.iter().zip(&many) {
        assert_eq!(&on_gpu.unit_images(std::slice::from_ref(light), SampleSplit::All).unwrap()[0], image);
    }
    assert!(on_gpu.unit_images(&[], SampleSplit::All).unwrap().is_empty());
}

/// A dump of 17 shards of up to 700 records, of which 60 KB hold about a fifth.
fn streamed(gpu: &Arc<Gpu>) -> (Gather, GpuGather) {
    let gather = Gather::new(random_dump_of(10, &[1, 3, 4, 6]));
    gpu.set_memory_budget(Some(60_000));
    let on_gpu = GpuGather::new(Arc::clone(gpu), &gather).unwrap();
    assert!(!on_gpu.is_resident());
    (gather, on_gpu)
}

#[test]
fn a_dump_larger_than_the_memory_is_streamed_with_the_same_results() {
    let gpu = gpu();
    let (gather, on_gpu) = streamed(&gpu);
    let lights = gather.prepare_all(&random_lights()[..18]).unwrap();
    let resident = GpuGather::new(super::tests::gpu(), &gather).unwrap();
    for half in HALVES {
        let found = on_gpu.unit_images(&lights, half).unwrap();
        let expected = resident.unit_images(&lights, half).unwrap();
        // A tile whose shards lie in two chunks is summed in another order.
        assert!(found.iter().zip(&expected).all(|(found, expected)| differing(found, expected) == 0));
    }
    // All that a call has taken is given back.
    assert_eq!(gpu.free_memory(), 60_000);
}

#[test]
fn a_dump_on_the_device_leaves_room_for_every_table_and_the_images() {
    let (gather, gpu) = (Gather::new(random_dump_of(10, &[1, 3, 4, 6])), gpu());
    // The least memory, nearly, with which it stays there.
    let on_gpu = (0..).find_map(|step| {
        gpu.set_memory_budget(Some(60_000 + 1000 * step));
        let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
        on_gpu.is_resident().then_some(on_gpu)
    });
    let on_gpu = on_gpu.unwrap();
    let images = 2 * LIGHTS[LIGHTS.len() - 1] * on_gpu.image_values();
    let _images = gpu.zeros::<f32>("images", images).unwrap();
    for chunk in on_gpu.resident.as_ref().unwrap() {
        for half in HALVES {
            chunk.table(&gpu, &on_gpu.dump, half).unwrap();
        }
        let table = chunk.table(&gpu, &on_gpu.dump, SampleSplit::All).unwrap();
        chunk.numbers(&gpu, &table, on_gpu.pixel_count()).unwrap();
    }
}

#[test]
fn a_shard_larger_than_the_memory_is_cut() {
    let (gather, gpu) = (Gather::new(random_dump_of(4, &[100])), gpu());
    let light = gather.prepare_all(&random_lights()[..1]).unwrap();
    let expected = gather.unit_images(&light, SampleSplit::All);
    let largest = gather.dump().shards().map(|shard| shard.record_count() as u64).max().unwrap();
    // The image and the light take less than a kilobyte.
    let budget = largest * RECORD_BYTES / 3;
    gpu.set_memory_budget(Some(budget));
    let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
    assert!(!on_gpu.is_resident());
    let found = on_gpu.unit_images(&light, SampleSplit::All).unwrap();
    assert_eq!(differing(&found[0], &expected[0]), 0);
    assert_eq!(gpu.free_memory(), budget);
}

#[test]
fn a_shard_larger_than_a_buffer_is_cut() {
    let (gather, gpu) = (Gather::new(random_dump_of(6, &[1, 30])), gpu());
    let lights = gather.prepare_all(&random_lights()[..6]).unwrap();
    let whole = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
    let cut = GpuGather::in_chunks(Arc::clone(&gpu), &gather, 200).unwrap();
    assert!(cut.resident.as_ref().unwrap().len() > 5 * whole.resident.as_ref().unwrap().len());
    for half in HALVES {
        let [found, expected] = [&cut, &whole].map(|gather| gather.unit_images(&lights, half).unwrap());
        assert!(found.iter().zip(&expected).all(|(found, expected)| differing(found, expected) == 0));
    }
    let pixels: Vec<u32> = (0..36).collect();
    let [found, expected] = [&cut, &whole].map(|gather| {
        let out = gpu.zeros::<f32>("targets", 3 * 36).unwrap();
        let lights = gather.lights(&vec![lights[0].clone(); 36]).unwrap();
        gather.pixel_targets(&pixels, &lights, 1, SampleSplit::All, &out).unwrap();
        Image { width: 6, height: 6, channels: 3, data: gpu.read(&out, 0..out.len()).unwrap() }
    });
    assert_eq!(differing(&found, &expected), 0);
    assert!(mean(&found) > 0.0);
}

#[test]
fn sorted_segments_give_the_same_images() {
    // Four groups, two of them narrow; small and large lights.
    let gather = Gather::new(random_dump_of(20, &[1, 2, 9]));
    let mut lights = random_lights();
    for light in lights.iter_mut().step_by(2) {
        match &mut light.shape {
            LightShape::Sphere { radius, .. } | LightShape::FacingDisk { radius, .. } => *radius *= 0.3,
            LightShape::Spot { radius, .. } | LightShape::StretchedSpot { radius, .. } => *radius *= 0.3,
            LightShape::Quad { edge_u, .. }
            | LightShape::Ellipse { edge_u, .. }
            | LightShape::Sheared { edge_u, .. } => *edge_u *= 0.1,
            LightShape::Sun { half_angle, .. } => *half_angle *= 0.2,
        }
    }
    let lights = gather.prepare_all(&lights).unwrap();
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let in_path_order = on_gpu.unit_images(&lights, SampleSplit::All).unwrap();
    assert!(!on_gpu.sort_within(1.0, &|| true).unwrap() && on_gpu.sorted.get().is_none());
    assert!(!on_gpu.sort_within(0.0, &|| false).unwrap() && on_gpu.sorted.get().is_none());
    assert!(on_gpu.sort().unwrap());
    let sorted = on_gpu.sorted.get().unwrap();
    let paying =
        lights.iter().filter(|light| sorted.pays(&GpuLight::new(light, on_gpu.magnitude, 0))).count();
    assert!((5..lights.len()).contains(&paying), "{paying} of {} are small", lights.len());
    let sorted = on_gpu.unit_images(&lights, SampleSplit::All).unwrap();
    assert_eq!(sorted, on_gpu.unit_images(&lights, SampleSplit::All).unwrap());
    let in_pieces = GpuGather::new(gpu(), &gather).unwrap();
    let pieces = Sorted::in_chunks(in_pieces.gpu(), gather.dump(), [150, 50], &|| false).unwrap().unwrap();
    in_pieces.sorted.set(pieces).unwrap();
    assert_eq!(sorted, in_pieces.unit_images(&lights, SampleSplit::All).unwrap());
    for (sorted, in_path_order) in sorted.iter().zip(&in_path_order) {
        // Sums of about 30 values in another order, and 2^-32 of the largest weight lost of each, which a narrow spread makes
        // some hundred times the others.
        let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 3e-6 * *b + 1e-7;
        assert_eq!(sorted.data.iter().zip(&in_path_order.data).find(differs), None);
    }
    for half in [SampleSplit::First, SampleSplit::Second] {
        let (found, expected) =
            (on_gpu.unit_images(&lights, half).unwrap(), gather.unit_images(&lights, half));
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(differing(found, expected), 0);
        }
    }
}

#[test]
fn cut_rays_collect_the_same_in_any_order() {
    let gather = Gather::new(crate::tests::pieces::cut_rays());
    let lights = gather.prepare_all(&random_lights()).unwrap();
    let expected = gather.unit_images(&lights, SampleSplit::All);
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let in_path_order = on_gpu.unit_images(&lights, SampleSplit::All).unwrap();
    assert!(on_gpu.sort().unwrap());
    let all: Vec<_> = (0..lights.len()).collect();
    let sorted = on_gpu.gather_as(&lights, SampleSplit::All, &all, &[]).unwrap();
    let values = on_gpu.image_values();
    for group in sorted {
        for (number, &light) in group.lights.iter().enumerate() {
            let data = on_gpu.gpu.read(&group.sums, number * values..(number + 1) * values).unwrap();
            let sorted = Image { data, ..in_path_order[light].clone() };
            let differing = [&sorted, &in_path_order[light]].map(|image| differing(image, &expected[light]));
            // A ray that passes the edge of a light within rounding.
            assert!(differing.iter().all(|&values| values <= 3), "{differing:?}: light {light}");
        }
    }
    assert!(expected.iter().flat_map(|image| &image.data).filter(|value| **value > 0.0).count() > 5000);
}

/// Every pixel has a segment of its own along an axis, 64 times, and one that escapes along another: blocks without extent.
fn bundles(place: &[Vec3]) -> Dump {
    dump(manifest(4, &[64]), |pixel, _, samples| {
        let axis = Vec3::AXES[pixel % 3];
        samples.push(segment(End::Vertex(place[pixel]), Lobe::Camera));
        samples.push(segment(End::Vertex(place[pixel] + 2.0 * axis), Lobe::Diffuse));
        samples.push(segment(End::Escape(Vec3::AXES[(pixel + 1) % 3]), Lobe::Diffuse));
    })
}

/// Lights that these segments cross close to their edges.
fn grazed(place: &[Vec3]) -> Vec<Light> {
    const RADIUS: f32 = 0.2;
    let mut lights = Vec::new();
    for (pixel, &place) in place.iter().enumerate() {
        let [along, beside, third] = [0, 1, 2].map(|axis| Vec3::AXES[(pixel + axis) % 3]);
        let side = if pixel % 2 == 0 { 0.97 } else { -0.97 };
        let center = place + along + side * RADIUS * third;
        lights.push(light(LightShape::Sphere { center, radius: RADIUS }));
        // Its normal is `-along`.
        let (edge_u, edge_v) = (2.0 * RADIUS * third, 2.0 * RADIUS * beside);
        lights.push(light(LightShape::Quad { center, edge_u, edge_v, spread: std::f32::consts::PI }));
        let direction = beside + (side * RADIUS).tan() * third;
        lights.push(light(LightShape::Sun { direction, half_angle: RADIUS }));
        let center = place + 2.0 * along + beside + side * RADIUS * third;
        lights.push(light(LightShape::FacingDisk { center, radius: RADIUS }));
    }
    lights
}

#[test]
fn lights_at_whose_edges_blocks_pass_are_not_missed() {
    let mut random = Random(5);
    let place: Vec<_> = (0..16).map(|_| random.point(4.0)).collect();
    let gather = Gather::new(bundles(&place));
    let lights = gather.prepare_all(&grazed(&place)).unwrap();
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    assert!(on_gpu.sort().unwrap());
    let expected = gather.unit_images(&lights, SampleSplit::All);
    for (index, image) in expected.iter().enumerate() {
        let (x, y) = (index / 4 % 4, index / 16);
        assert!(image.pixel(x, y)[0] >= 0.99, "light {index} does not reach its pixel");
        assert!(on_gpu.sorted.get().unwrap().pays(&GpuLight::new(&lights[index], on_gpu.magnitude, 0)));
    }
    for (found, expected) in on_gpu.unit_images(&lights, SampleSplit::All).unwrap().iter().zip(&expected) {
        assert_eq!(differing(found, expected), 0);
    }
}

#[test]
fn lights_are_gathered_in_the_way_that_was_measured_to_be_quicker() {
    let mut random = Random(5);
    let place: Vec<_> = (0..16).map(|_| random.point(4.0)).collect();
    let gather = Gather::new(bundles(&place));
    let small = gather.prepare(&grazed(&place)[0]).unwrap();
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let in_path_order = on_gpu.unit_images(std::slice::from_ref(&small), SampleSplit::All).unwrap();
    let pays_after = |seconds: Option<[f64; 2]>| {
        let sorted = Sorted::new(on_gpu.gpu(), gather.dump(), &|| false).unwrap().unwrap();
        let light = GpuLight::new(&small, on_gpu.magnitude, 0);
        if let Some(seconds) = seconds {
            sorted.weigh(&light, seconds);
        }
        sorted.pays(&light)
    };
    assert!(pays_after(None) && pays_after(Some([0.9, 1.0])));
    assert!(!pays_after(Some([1.1, 1.0])));

    on_gpu.weigh_sorted(&|| false).unwrap();
    assert!(on_gpu.sorted.get().is_none() && on_gpu.sort().unwrap());
    let sorted = on_gpu.sorted.get().unwrap();
    on_gpu.weigh_sorted(&|| true).unwrap();
    assert_eq!(sorted.byte_cost(), None);
    on_gpu.weigh_sorted(&|| false).unwrap();
    assert!(sorted.byte_cost().is_some_and(|cost| cost.is_finite() && cost > 0.0));
    let found = on_gpu.unit_images(std::slice::from_ref(&small), SampleSplit::All).unwrap();
    assert_eq!(differing(&found[0], &in_path_order[0]), 0);
}

#[test]
fn far_from_the_origin_lights_that_escaping_paths_pass_are_not_missed() {
    // Kilometres from the origin to where paths escape along an axis, and from there to a light that they pass at its far side.
    const PLACE: f32 = 50e3;
    const WAY: f32 = 10e3;
    let place = PLACE * Vec3::X;
    let gather = Gather::new(dump(manifest(4, &[64]), |pixel, _, samples| {
        samples.push(segment(End::Vertex(place), Lobe::Camera));
        samples.push(segment(End::Escape(if pixel == 0 { Vec3::Y } else { Vec3::NEG_Y }), Lobe::Diffuse));
    }));
    let lights =
        [LightShape::Sphere { center: place + WAY * Vec3::Y + 4.0 * Vec3::X, radius: 5.0 }].map(light);
    let lights = gather.prepare_all(&lights).unwrap();
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    assert!(on_gpu.sort().unwrap());
    assert!(on_gpu.sorted.get().unwrap().pays(&GpuLight::new(&lights[0], on_gpu.magnitude, 0)));
    let [expected, found] = [
        gather.unit_images(&lights, SampleSplit::All),
        on_gpu.unit_images(&lights, SampleSplit::All).unwrap(),
    ];
    assert!(expected[0].pixel(0, 0)[0] > 0.99);
    assert_eq!(differing(&found[0], &expected[0]), 0);
}

#[test]
fn without_room_segments_stay_as_they_are() {
    let gpu = gpu();
    let (gather, on_gpu) = streamed(&gpu);
    assert!(!on_gpu.sort().unwrap());
    let light = gather.prepare(&random_lights()[0]).unwrap();
    assert_eq!(on_gpu.sorted_bytes(&light), None);
    assert_eq!(gpu.free_memory(), 60_000);
}

#[test]
fn images_without_room_are_an_error() {
    let gpu = gpu();
    let (gather, on_gpu) = streamed(&gpu);
    let lights = gather.prepare_all(&random_lights()).unwrap();
    let error = on_gpu.unit_images(&lights, SampleSplit::All).unwrap_err();
    assert!(matches!(error, GatherError::Gpu(GpuError::OutOfMemory { .. })), "{error}");
    on_gpu.unit_images(&lights[..1], SampleSplit::All).unwrap();
}

#[test]
fn images_on_the_device_are_those_that_are_read_back() {
    let gpu = gpu();
    let gather = Gather::new(random_dump_of(6, &[4]));
    let lights = gather.prepare_all(&random_lights()[..18]).unwrap();
    let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
    let images = on_gpu.unit_images(&lights, SampleSplit::First).unwrap();
    let gpu_images = on_gpu.gpu_images(&lights, SampleSplit::First).unwrap();
    assert_eq!(images.len(), gpu_images.len());
    for (image, on_gpu) in images.iter().zip(&gpu_images) {
        assert_eq!(image.data, on_gpu.read().unwrap());
        assert_eq!((image.width, image.height), (on_gpu.width(), on_gpu.height()));
    }
}

#[test]
fn a_device_lost_in_mid_work_is_an_error_that_says_so() {
    let gpu = gpu();
    let gather = Gather::new(random_dump_of(6, &[4]));
    let lights = gather.prepare_all(&random_lights()[..3]).unwrap();
    let resident = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
    let (_, streamed) = streamed(&gpu);
    resident.unit_images(&lights, SampleSplit::All).unwrap();
    gpu.lose();
    for gather in [&resident, &streamed] {
        let error = gather.unit_images(&lights, SampleSplit::All).unwrap_err();
        assert!(matches!(error, GatherError::Gpu(GpuError::Lost(_))), "{error}");
    }
    gpu.set_memory_budget(Some(1 << 30));
    let error = resident.sort().unwrap_err();
    assert!(matches!(error, GatherError::Gpu(GpuError::Lost(_))), "{error}");
    let error = GpuGather::new(gpu, &gather).unwrap_err();
    assert!(matches!(error, GatherError::Gpu(GpuError::Lost(_))), "{error}");
}

/// Values of pixels for lights that `sharing` neighbours have in common, those of the GPU, and as the CPU has them.
fn targets(
    gather: &Gather,
    on_gpu: &GpuGather,
    (pixels, sharing): (&[u32], usize),
    per_pixel: usize,
    half: SampleSplit,
) -> [Image; 2] {
    let all = gather.prepare_all(&random_lights()).unwrap();
    let lights: Vec<_> =
        (0..pixels.len() / sharing * per_pixel).map(|index| all[index * 7 % all.len()].clone()).collect();
    let out = on_gpu.gpu.buffer_of("targets", &vec![9.0; lights.len() * sharing * 3]).unwrap();
    let lights_on_gpu = on_gpu.lights(&lights).unwrap();
    on_gpu.pixel_targets(pixels, &lights_on_gpu, per_pixel as u32, half, &out).unwrap();
    let shape = Image::new(per_pixel, pixels.len(), 3);
    let found = Image { data: on_gpu.gpu.read(&out, 0..out.len()).unwrap(), ..shape.clone() };
    let width = gather.dump().manifest().width;
    let of_pixel = |(&place, lights): (&u32, &[PreparedLight])| {
        gather.pixel(place as usize % width, place as usize / width, lights, half)
    };
    let runs = pixels.chunks(sharing).zip(lights.chunks(per_pixel));
    let pairs = runs.flat_map(|(run, lights)| run.iter().map(move |place| (place, lights)));
    let expected = pairs.flat_map(of_pixel).flatten().collect();
    [found, Image { data: expected, ..shape }]
}

#[test]
fn pixels_with_lights_of_their_own_equal_those_of_the_cpu() {
    let gather = Gather::new(random_dump_of(10, &[1, 3, 20]));
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let pixels: Vec<u32> = (0..150).map(|index| index * 37 % 100).collect();
    for (sharing, per_pixel, half) in
        [(1, 1, SampleSplit::All), (1, 4, SampleSplit::First), (5, 19, SampleSplit::Second)]
    {
        let [found, expected] = targets(&gather, &on_gpu, (&pixels, sharing), per_pixel, half);
        assert!(expected.data.iter().filter(|&&value| value > 0.0).count() > 100);
        assert_eq!(differing(&found, &expected), 0);
    }
    assert_eq!(on_gpu.copied_bytes(), 0);
}

#[test]
fn pixels_of_a_streamed_dump_equal_those_of_the_cpu() {
    let gpu = gpu();
    let (gather, on_gpu) = streamed(&gpu);
    let pixels: Vec<u32> = (0..150).map(|index| index * 37 % 100).collect();
    let mut first = None;
    for (sharing, per_pixel, half) in [
        (1, 1, SampleSplit::All),
        (5, 4, SampleSplit::First),
        (25, 19, SampleSplit::Second),
        (1, 1, SampleSplit::All),
    ] {
        let [found, expected] = targets(&gather, &on_gpu, (&pixels, sharing), per_pixel, half);
        assert!(expected.data.iter().filter(|&&value| value > 0.0).count() > 100);
        assert_eq!(differing(&found, &expected), 0);
        // Whatever the cuts.
        if (per_pixel, half) == (1, SampleSplit::All) {
            let found = found.data;
            assert_eq!(first.get_or_insert_with(|| found.clone()), &found);
            gpu.set_memory_budget(Some(90_000));
        }
    }
    // All that calls have taken is given back.
    assert_eq!(gpu.free_memory(), 90_000);
}

#[test]
fn targets_of_a_streamed_dump_copy_the_drawn_pixels_alone() {
    let gpu = gpu();
    let (gather, on_gpu) = streamed(&gpu);
    let dump = gather.dump();
    let records = |pixels: &[u32], half: SampleSplit| -> usize {
        let of = |(shard, pixel): (&Arc<relume_dump::Shard>, usize)| half.records(shard, pixel).len();
        let of_pixel = |pixel: &u32| dump.pixel(*pixel as usize % 10, *pixel as usize / 10).map(of).sum();
        pixels.iter().map(|pixel| usize::next_multiple_of(of_pixel(pixel), 4)).sum()
    };
    let mut copied = 0;
    for (pixels, once, half) in [
        (&[3, 57, 3][..], &[3, 57][..], SampleSplit::All),
        (&[8], &[8], SampleSplit::First),
        (&[99, 0], &[0, 99], SampleSplit::Second),
    ] {
        let read = gpu.bytes_read();
        targets(&gather, &on_gpu, (pixels, 1), 2, half);
        // What the test itself looks at.
        assert_eq!(gpu.bytes_read() - read, (pixels.len() * 2 * 3 * size_of::<f32>()) as u64);
        let expected = records(once, half) as u64 * RECORD_BYTES;
        assert!(expected > 0);
        assert_eq!(on_gpu.copied_bytes() - copied, expected);
        copied = on_gpu.copied_bytes();
    }
    // A block of a training at the paper's size: 128 pixels of 512 paths with 3 segments, for 4,096 samples that are each used
    // four times.
    let block = 128 * 512 * 3 * RECORD_BYTES;
    let whole = 885 * 500 * 512 * 3 * RECORD_BYTES;
    let of_training = (32 << 20) / (4 * 4096) * block;
    println!("{block} bytes a block, {of_training} bytes a training of 32 M samples, {whole} bytes the dump");
    assert!(of_training < whole);
}

#[test]
fn a_dump_without_samples_is_black() {
    let gather = Gather::new(Dump::in_memory(crate::tests::manifest(5, &[2])).unwrap());
    let lights = gather.prepare_all(&random_lights()[..2]).unwrap();
    let images = GpuGather::new(gpu(), &gather).unwrap().unit_images(&lights, SampleSplit::All).unwrap();
    assert_eq!(images, [Image::new(5, 5, 3), Image::new(5, 5, 3)]);
}
