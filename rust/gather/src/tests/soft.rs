//! The smoothed gather tends to the exact one, and its derivatives are those of its values.

use glam::Vec3;
use relume_scene::{LANES, Light, LightShape};

use super::kernels::{random_dump_of, random_lights, random_rays_of};
use super::light;
use crate::{Gather, GatherError, SampleSplit, SoftGather};

/// A light moved along one of its lanes.
fn moved(light: &Light, lane: usize, by: f32) -> Light {
    let mut step = [0.0; LANES];
    step[lane] = by;
    Light { shape: light.shape.moved(&step), ..light.clone() }
}

/// Asserts that the slopes of a lane are central differences of the values, root mean square over all cells: to 1 % for
/// their curvature, and to what a difference of two sums in `f32` can tell.
fn slopes_are_differences(
    soft: &SoftGather<'_>,
    light: &Light,
    softness: f32,
    lane: usize,
    step: f32,
) -> bool {
    let cells: Vec<u32> = (0..(soft.cells().0 * soft.cells().1) as u32).collect();
    let linear = soft.linearise(light, softness, &cells).unwrap();
    let value = |by: f32| soft.linearise(&moved(light, lane, by), softness, &cells).unwrap().values;
    let (above, below) = (value(step), value(-step));
    let (mut error, mut slope, mut brightness) = (0.0, 0.0, 0.0);
    for (cell, channel) in (0..cells.len()).flat_map(|cell| (0..3).map(move |channel| (cell, channel))) {
        let difference = (above[cell][channel] - below[cell][channel]) / (2.0 * step);
        error += (linear.slopes[cell][lane][channel] - difference).powi(2);
        slope += difference.powi(2);
        brightness += linear.values[cell][channel].powi(2);
    }
    error.sqrt() <= 1e-2 * slope.sqrt() + 2e-6 / step * brightness.sqrt()
}

#[test]
fn slopes_of_all_lanes_of_all_shapes_are_finite_differences() {
    slopes_are_those_of_all_shapes(&Gather::new(random_rays_of(8, &[16])), &[0.01, 0.1, 0.7]);
}

#[test]
fn slopes_of_pieces_of_rays_are_finite_differences() {
    // The narrowest softness is left to whole rays: differences of few segments tell little.
    slopes_are_those_of_all_shapes(&Gather::new(random_dump_of(8, &[16])), &[0.1, 0.7]);
}

fn slopes_are_those_of_all_shapes(gather: &Gather, softnesses: &[f32]) {
    let soft = SoftGather::new(gather, 4);
    for (index, light) in random_lights().iter().enumerate() {
        for (lane, &softness) in (0..LANES).flat_map(|lane| softnesses.iter().map(move |s| (lane, s))) {
            // Angles change a picture as much as lengths do: the lever is a few metres.
            let step = if (3..6).contains(&lane) { 2e-3 * softness } else { 1e-2 * softness };
            let found = slopes_are_differences(&soft, light, softness, lane, step)
                || slopes_are_differences(&soft, light, softness, lane, 0.1 * step);
            assert!(found, "light {index} {:?}, lane {lane}, softness {softness}", light.shape);
        }
    }
}

#[test]
fn the_value_tends_to_the_exact_gather() {
    let gather = Gather::new(random_rays_of(8, &[16]));
    let soft = SoftGather::new(&gather, 1);
    let cells: Vec<u32> = (0..64).collect();
    // Stretched and sheared lights are smoothed as plain ones that are near them.
    let is_plain =
        |light: &Light| !matches!(light.shape, LightShape::Sheared { .. } | LightShape::StretchedSpot { .. });
    for light in random_lights().into_iter().filter(is_plain) {
        let prepared = gather.prepare(&light).unwrap();
        let exact = &gather.unit_images(std::slice::from_ref(&prepared), SampleSplit::All)[0];
        let norm = exact.data.iter().map(|b| b * b).sum::<f32>().sqrt();
        let errors = [0.3, 0.1, 0.01, 1e-5].map(|softness| {
            let values = soft.linearise(&light, softness, &cells).unwrap().values;
            let differences = values.as_flattened().iter().zip(&exact.data).map(|(a, b)| (a - b).powi(2));
            differences.sum::<f32>().sqrt() / norm
        });
        // At 1e-5, no segment happens to cross an edge within 0.1 mm.
        assert!(errors[3] < 1e-4 && errors[2] < 0.5 * errors[0], "{:?}: {errors:?}", light.shape);
    }
}

#[test]
fn all_is_finite_where_a_light_sits_on_the_vertices() {
    let gather = Gather::new(random_dump_of(4, &[4]));
    let soft = SoftGather::new(&gather, 4);
    let shards: Vec<_> = gather.dump().shards().collect();
    let vertices = (0..40).filter_map(|record| shards[0].segment(record)).map(|segment| segment.origin);
    for (origin, light) in vertices.flat_map(|origin| random_lights().into_iter().map(move |l| (origin, l))) {
        let mut step = [0.0; LANES];
        let to_origin = origin - light.shape.center().unwrap_or_default();
        step[..3].copy_from_slice(&to_origin.to_array());
        let light = Light { shape: light.shape.moved(&step), ..light };
        for softness in [1e-6, 1e-2, 1.0] {
            let linear = soft.linearise(&light, softness, &[0]).unwrap();
            let all = linear.values.as_flattened().iter().chain(linear.slopes.as_flattened().as_flattened());
            assert!(all.into_iter().all(|number| number.is_finite()), "{:?} at {softness}", light.shape);
        }
    }
}

#[test]
fn cells_are_means_of_pixels_whatever_the_threads_and_tiles() {
    let gather = Gather::new(random_rays_of(7, &[1, 3]));
    let lamp = light(LightShape::Quad { center: Vec3::X, edge_u: Vec3::X, edge_v: Vec3::Y, spread: 2.0 });
    let pixels = SoftGather::new(&gather, 1).linearise(&lamp, 0.1, &(0..49).collect::<Vec<_>>()).unwrap();
    // Cells of 3 pixels lie across the tiles of 4; those of the last column and row are 1 pixel wide and high.
    let soft = SoftGather::new(&gather, 3);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let [cells, on_one] =
        [3, 1].map(|threads| pool(threads).install(|| soft.linearise(&lamp, 0.1, &[8, 4, 1, 2]).unwrap()));
    assert_eq!(cells, on_one);
    let members = [vec![48], vec![24, 25, 26, 31, 32, 33, 38, 39, 40], vec![3, 4, 5, 10, 11, 12, 17, 18, 19]];
    for (cell, members) in members.iter().enumerate() {
        let mean =
            |of: &dyn Fn(usize) -> f32| members.iter().map(|&p| of(p)).sum::<f32>() / members.len() as f32;
        for channel in 0..3 {
            let (found, expected) =
                (cells.values[cell][channel], mean(&|pixel| pixels.values[pixel][channel]));
            assert!((found - expected).abs() <= 1e-5 * expected.abs() && expected != 0.0);
            let (found, expected) =
                (cells.slopes[cell][2][channel], mean(&|pixel| pixels.slopes[pixel][2][channel]));
            assert!((found - expected).abs() <= 1e-4 * expected.abs(), "{found} {expected}");
        }
    }
}

#[test]
fn what_cannot_be_smoothed_is_refused() {
    let gather = Gather::new(random_dump_of(6, &[1]));
    let soft = SoftGather::new(&gather, 4);
    assert_eq!(soft.cells(), (2, 2));
    let lamp = light(LightShape::Sphere { center: Vec3::ZERO, radius: 0.5 });
    for softness in [0.0, -1.0, 1.5, f32::NAN] {
        assert!(matches!(soft.linearise(&lamp, softness, &[0]), Err(GatherError::Softness(_))));
    }
    assert!(matches!(soft.linearise(&lamp, 0.1, &[3, 4]), Err(GatherError::Cell { cell: 4, cells: 4 })));
    let lamp = light(LightShape::Sphere { center: Vec3::ZERO, radius: 0.0 });
    assert!(matches!(soft.linearise(&lamp, 0.1, &[0]), Err(GatherError::Light { .. })));
}

#[test]
fn exact_cells_are_means_of_the_gathered_pictures_by_any_half() {
    // Passes of one sample fall to one half; those of three are cut. Cells lie across tiles, and the last ones are smaller.
    let gather = Gather::new(random_dump_of(7, &[1, 1, 3]));
    let soft = SoftGather::new(&gather, 3);
    let (lights, cells) = (random_lights(), [8, 0, 4, 2]);
    let prepared = gather.prepare_all(&lights).unwrap();
    for half in [SampleSplit::All, SampleSplit::First, SampleSplit::Second] {
        let found = soft.exact(&prepared, half, &cells).unwrap();
        let images = gather.unit_images(&prepared, half);
        for ((found, image), light) in found.iter().zip(&images).zip(&lights) {
            let means = image.shrunk(3).data.as_chunks::<3>().0.to_vec();
            let brightest = means.as_flattened().iter().fold(0.0_f32, |a, b| a.max(*b));
            for (found, cell) in found.iter().zip(cells) {
                let near = |(a, b): (&f32, f32)| (a - b).abs() <= 1e-5 * brightest;
                assert!(found.iter().zip(means[cell as usize]).all(near), "{half:?}, cell {cell}: {light:?}");
            }
        }
        assert!(found.iter().flatten().flatten().any(|value| *value > 0.0));
    }
    assert!(matches!(
        soft.exact(&prepared, SampleSplit::All, &[9]),
        Err(GatherError::Cell { cell: 9, cells: 9 })
    ));
}
