use super::*;

/// 20 x 11 x 9 voxels of some function, in bricks that are not full.
fn grid(channels: usize, value: impl Fn(Vec3) -> [f32; 4]) -> Grid {
    let size = [20, 11, 9];
    let voxel = |n: usize| Vec3::new((n % 20) as f32, (n / 20 % 11) as f32, (n / 220) as f32);
    let values: Vec<f32> = (0..20 * 11 * 9).flat_map(|n| value(voxel(n))[..channels].to_vec()).collect();
    let object_from_index = Affine3A::IDENTITY;
    DenseGrid { name: "density", size, channels, values: &values, object_from_index }.to_grid(0.0).unwrap()
}

fn linear(p: Vec3) -> f32 {
    1.0 + 0.5 * p.x - 0.25 * p.y + 2.0 * p.z
}

/// Positions between voxels, none at the border.
fn inside() -> impl Iterator<Item = Vec3> {
    let fraction = |i: u32, factor: f32| (i as f32 * factor).fract();
    (0..200).map(move |i| {
        let unit = Vec3::new(fraction(i, 0.618_034), fraction(i, 0.754_878), fraction(i, 0.569_84));
        1.0 + unit * Vec3::new(16.9, 7.9, 5.9)
    })
}

#[test]
fn both_interpolations_keep_linear_functions() {
    let grid = grid(1, |p| [linear(p); 4]);
    for position in inside() {
        for interpolation in [GridInterpolation::Linear, GridInterpolation::Cubic] {
            let found = grid.value(position, interpolation);
            assert!(
                (found - linear(position)).abs().max_element() < 5e-5,
                "{position} {interpolation:?} {found}"
            );
        }
    }
}

/// It raises a parabola by the variance of the kernel, a third.
#[test]
fn the_cubic_one_is_a_b_spline() {
    let grid = grid(1, |p| [p.x * p.x + 40.0; 4]);
    for position in inside() {
        let expected = position.x * position.x + 1.0 / 3.0 + 40.0;
        assert!(
            (grid.value(position, GridInterpolation::Cubic).x / expected - 1.0).abs() < 3e-6,
            "{position}"
        );
    }
}

#[test]
fn values_fall_to_the_background_outside() {
    let grid = grid(1, |_| [3.0; 4]);
    let value = |x, y, z| grid.value(Vec3::new(x, y, z), GridInterpolation::Linear).x;
    assert_eq!([value(-1.0, 5.0, 5.0), value(-0.25, 5.0, 5.0), value(0.0, 5.0, 5.0)], [0.0, 2.25, 3.0]);
    assert_eq!([value(19.0, 5.0, 5.0), value(19.5, 5.0, 5.0), value(20.0, 5.0, 5.0)], [3.0, 1.5, 0.0]);
    assert_eq!(value(f32::MAX, 0.0, f32::MIN), 0.0);
    assert_eq!(value(f32::NAN, 0.0, 0.0), 0.0);
}

#[test]
fn colors_are_divided_by_their_fourth_channel_after_interpolation() {
    let grid = grid(4, |p| {
        let density = 0.5 + p.x;
        [0.25 * density, 0.5 * density, density, density]
    });
    for position in inside() {
        let color = grid.value(position, GridInterpolation::Linear);
        assert!((color - Vec3::new(0.25, 0.5, 1.0)).abs().max_element() < 2e-6, "{position} {color}");
    }
}

#[test]
fn bounds_hold_what_look_ups_give_and_are_reached() {
    let uneven = |p: Vec3| (p.dot(Vec3::new(0.31, 0.43, 0.27))).sin() + 0.02 * p.x * p.z;
    let grid = grid(1, |p| [uneven(p); 4]);
    let bounds = grid.bounds();
    let mut reached = [0_usize; 2];
    for n in 0..40_000_u32 {
        let fraction = |factor: f64| (f64::from(n) * factor).fract() as f32;
        let unit = Vec3::new(fraction(0.819_172_5), fraction(0.671_043_6), fraction(0.549_700_5));
        let position = unit * Vec3::new(26.0, 17.0, 15.0) - 3.0;
        let [low, high] = bounds.range((position / 8.0).floor().as_ivec3());
        for interpolation in [GridInterpolation::Linear, GridInterpolation::Cubic] {
            let value = grid.value(position, interpolation).x;
            assert!(
                low <= value && value <= high,
                "{position} {interpolation:?}: {value} of {low} to {high}"
            );
            reached[0] += usize::from(value < low + 0.2 * (high - low));
            reached[1] += usize::from(value > high - 0.2 * (high - low));
        }
    }
    assert!(reached[0] > 100 && reached[1] > 100, "{reached:?}");
    assert_eq!(bounds.range(IVec3::splat(1000)), [0.0, 0.0]);
}

#[test]
fn empty_bricks_take_no_memory_and_are_no_part_of_the_volume() {
    let grid = grid(1, |p| [if p.x > 16.5 && p.y > 2.5 { 1.0 } else { 0.0 }; 4]);
    assert_eq!(grid.active, Some([IVec3::new(17, 3, 0), IVec3::new(19, 10, 8)]));
    // Background, and four of the twelve bricks.
    assert_eq!((grid.bricks.counts, grid.values.len()), (UVec3::new(3, 2, 2), 5 * BRICK_VOXELS));
}

#[test]
fn arrays_of_another_size_are_refused_by_name() {
    let size = |size| DenseGrid {
        name: "flame",
        size,
        channels: 1,
        values: &[1.0; 8],
        object_from_index: Affine3A::IDENTITY,
    };
    assert!(size([2, 2, 2]).to_grid(0.0).is_ok());
    for wrong in [[2, 2, 3], [usize::MAX, 2, 2], [0, 2, 2]] {
        assert!(size(wrong).to_grid(0.0).unwrap_err().contains("grid 'flame': 8 numbers"), "{wrong:?}");
    }
}

#[test]
fn voxels_fill_their_box() {
    let place = DenseGrid::place([4, 2, 1], [Vec3::NEG_ONE, Vec3::ONE]);
    assert_eq!(place.transform_point3(Vec3::ZERO), Vec3::new(-0.75, -0.5, 0.0));
    assert_eq!(place.transform_point3(Vec3::new(3.0, 1.0, 0.0)), Vec3::new(0.75, 0.5, 0.0));
}
