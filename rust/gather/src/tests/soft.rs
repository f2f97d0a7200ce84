//! The smoothed gather tends to the exact one, and its derivatives are those of its values.

use glam::{Quat, Vec3};
use relume_scene::{LANES, Light, LightShape};

use super::kernels::{random_dump_of, random_lights};
use super::light;
use crate::{Gather, GatherError, Half, SoftGather};

/// A light moved along one of its lanes.
fn moved(light: &Light, lane: usize, by: f32) -> Light {
    let mut axis = [0.0; 3];
    axis[lane % 3] = by;
    let axis = Vec3::from(axis);
    let mut light = light.clone();
    match lane {
        0..3 => match &mut light.shape {
            LightShape::Sphere { center, .. }
            | LightShape::FacingDisk { center, .. }
            | LightShape::Spot { center, .. }
            | LightShape::Quad { center, .. }
            | LightShape::Ellipse { center, .. } => *center += axis,
            LightShape::Sun { .. } => {}
        },
        3..6 => {
            let turn = Quat::from_scaled_axis(axis);
            match &mut light.shape {
                LightShape::Spot { axis, .. } => *axis = turn * *axis,
                LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
                    (*edge_u, *edge_v) = (turn * *edge_u, turn * *edge_v);
                }
                LightShape::Sun { direction, .. } => *direction = turn * *direction,
                LightShape::Sphere { .. } | LightShape::FacingDisk { .. } => {}
            }
        }
        6 => match &mut light.shape {
            LightShape::Sphere { radius, .. }
            | LightShape::FacingDisk { radius, .. }
            | LightShape::Spot { radius, .. } => *radius *= by.exp(),
            LightShape::Quad { edge_u, .. } | LightShape::Ellipse { edge_u, .. } => *edge_u *= by.exp(),
            LightShape::Sun { half_angle, .. } => *half_angle *= by.exp(),
        },
        7 => match &mut light.shape {
            LightShape::Quad { edge_v, .. } | LightShape::Ellipse { edge_v, .. } => *edge_v *= by.exp(),
            _ => {}
        },
        _ => match &mut light.shape {
            LightShape::Spot { half_angle, .. } if lane == 8 => *half_angle += by,
            LightShape::Spot { blend, .. } if lane == 9 => *blend += by,
            _ => {}
        },
    }
    light
}

/// Whether the slopes of a lane are central differences of the values, root mean square over all cells: to 1 % for their
/// curvature, and to what a difference of two sums in `f32` can tell.
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
    let gather = Gather::new(random_dump_of(8, &[16]));
    let soft = SoftGather::new(&gather, 4);
    for (index, light) in random_lights().iter().enumerate() {
        for (lane, softness) in (0..LANES).flat_map(|lane| [0.01, 0.1, 0.7].map(|softness| (lane, softness)))
        {
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
    let gather = Gather::new(random_dump_of(8, &[16]));
    let soft = SoftGather::new(&gather, 1);
    let cells: Vec<u32> = (0..64).collect();
    for light in random_lights() {
        let prepared = gather.prepare(&light).unwrap();
        let exact = &gather.unit_images(std::slice::from_ref(&prepared), Half::All)[0];
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
