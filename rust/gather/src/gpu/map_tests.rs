//! Maps of emission on the GPU are those of the CPU.

use relume_scene::{Light, LightShape, MapDomain, MapKey};

use super::tests::gpu;
use super::*;
use crate::SoftGather;
use crate::tests::kernels::{random_dump_of, random_lights};
use crate::tests::{Random, mapped};

#[test]
fn maps_are_those_of_the_cpu_in_either_order_and_for_smoothed_lights() {
    let gather = Gather::new(random_dump_of(10, &[1, 3, 4, 40]));
    let mut random = Random(7);
    let domains = [(MapKey::WayBack, None), (MapKey::Normal, None), (MapKey::WayBack, Some(0.6))]
        .map(|(key, cone)| MapDomain { key, cone });
    let by_place = MapDomain { key: MapKey::Place, cone: None };
    let domain_of = |light: &Light, number: usize| match light.shape {
        LightShape::Quad { .. } | LightShape::Ellipse { .. } if number.is_multiple_of(2) => by_place,
        _ => domains[number % 3],
    };
    let lights: Vec<_> = random_lights()
        .iter()
        .filter(|light| !matches!(light.shape, LightShape::Sheared { .. } | LightShape::StretchedSpot { .. }))
        .enumerate()
        .map(|(number, light)| mapped(light, &mut random, domain_of(light, number)))
        .collect();
    let prepared = gather.prepare_all(&lights).unwrap();
    let expected = gather.unit_images(&prepared, SampleSplit::All);
    let plain =
        gather.prepare_all(&lights.iter().map(|l| Light { map: None, ..l.clone() }).collect::<Vec<_>>());
    assert_ne!(expected, gather.unit_images(&plain.unwrap(), SampleSplit::All));
    let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
    let all: Vec<usize> = (0..lights.len()).collect();
    assert!(on_gpu.sort().unwrap());
    for (small, large) in [(&[][..], &all[..]), (&all[..], &[])] {
        let groups = on_gpu.gather_as(&prepared, SampleSplit::All, small, large).unwrap();
        let values = on_gpu.image_values();
        for group in groups {
            for (number, &light) in group.lights.iter().enumerate() {
                let found = on_gpu.gpu.read(&group.sums, number * values..(number + 1) * values).unwrap();
                // WGSL allows an arc tangent some 2.4e-4 radians of error: a thousandth of a texel of these maps.
                let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-3 * *b + 1e-3;
                let differing = found.iter().zip(&expected[light].data).filter(differs).count();
                assert!(differing <= 3, "light {light}: {differing}");
            }
        }
    }
    let (soft, cells) = (SoftGather::new(&gather, 3), (0..16).collect::<Vec<u32>>());
    for light in &lights {
        let expected = soft.linearise(light, 0.1, &cells).unwrap();
        let found = on_gpu.linearise(&soft, light, 0.1, &cells).unwrap();
        let pairs = found.values.as_flattened().iter().zip(expected.values.as_flattened());
        let (mut error, mut whole) = (0.0, 0.0);
        pairs.for_each(|(a, b)| (error, whole) = (error + (a - b).powi(2), whole + b.powi(2)));
        assert!(error.sqrt() <= 1e-3 * whole.sqrt() && whole > 0.0, "{error} of {whole}");
    }
}
