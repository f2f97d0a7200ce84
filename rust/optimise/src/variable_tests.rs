use super::*;

pub(crate) fn lights() -> Vec<Light> {
    let (center, edge_u, edge_v) =
        (Vec3::new(0.5, 0.5, 2.2), Vec3::new(-0.1, 0.3, 0.3), Vec3::new(0.6, 0.0, 0.2));
    [
        LightShape::Sphere { center, radius: 0.2 },
        LightShape::FacingDisk { center, radius: 0.2 },
        LightShape::Spot {
            center,
            radius: 0.2,
            axis: Vec3::new(-0.6, 0.0, -0.8),
            half_angle: 0.7,
            blend: 0.3,
            soft_falloff: false,
        },
        LightShape::Quad { center, edge_u, edge_v, spread: 1.0 },
        LightShape::Ellipse { center, edge_u, edge_v, spread: std::f32::consts::PI },
        LightShape::Sun { direction: Vec3::new(0.0, 0.6, 0.8), half_angle: 0.1 },
    ]
    .map(|shape| Light { name: "Lamp".into(), radiance: [100.0, 3.0, 0.5], ..Light::unit(shape) })
    .into()
}

fn mapping(locks: Locks) -> Mapping {
    let bounds = Bounds::new(Vec3::new(-1.0, 0.0, 2.0), Vec3::new(3.0, 5.0, 9.0), [0.05, 0.8]);
    Mapping { bounds, locks, power_unit: 3.0 }
}

fn locks(color: bool, strength: bool) -> Locks {
    Locks { color, strength, ..Locks::default() }
}

#[test]
fn a_step_and_its_opposite_leave_a_light_as_it_was() {
    for light in lights() {
        for locks in [locks(false, false), locks(true, false)] {
            let map = mapping(locks);
            let mut delta = [0.1; PARAMS];
            delta[4] = -0.2;
            let back = map.step(&map.step(&light, &delta), &delta.map(|v| -v));
            for c in 0..3 {
                assert!((back.radiance[c] / light.radiance[c] - 1.0).abs() < 2e-3, "{back:?}");
            }
            for number in (0..LANES).filter(|i| !lane::TURN.contains(i) && light.shape.has_lane(*i)) {
                let (a, b) = (coordinate(&back.shape, number), coordinate(&light.shape, number));
                assert!((a - b).abs() < 1e-4, "lane {number}: {a} for {b}");
            }
        }
    }
}

#[test]
fn wild_steps_stay_in_bounds() {
    let map = mapping(Locks::default());
    for light in lights() {
        for u in [-1e6, -3.0, 50.0, 1e6] {
            let mut delta = [u; PARAMS];
            delta[lane::TURN].fill(0.3);
            let light = map.step(&light, &delta);
            if let Some(center) = light.shape.center() {
                assert!(center.cmpge(map.bounds.center_min - 1e-5).all(), "{center}");
                assert!(center.cmple(map.bounds.center_max + 1e-5).all(), "{center}");
                assert!((0.0499..0.8001).contains(&light.shape.sizes()[0]), "{:?}", light.shape);
            }
            assert!(light.radiance.iter().all(|r| *r >= 0.0 && r.is_finite()), "{light:?}");
        }
    }
}

#[test]
fn hard_and_soft_edges_of_cones_are_reached_and_left_again() {
    let (map, spot) = (mapping(Locks::default()), lights()[2].clone());
    let blend = |light: &Light| coordinate(&light.shape, lane::BLEND);
    let stepped = |light: &Light, by: f32| {
        let mut delta = [0.0; PARAMS];
        delta[lane::BLEND] = by;
        map.step(light, &delta)
    };
    for (out, end) in [(-9.0, 0.0), (9.0, 1.0)] {
        let at_end = stepped(&spot, out);
        assert_eq!(blend(&at_end), end);
        let back = stepped(&at_end, -0.5 * out.signum());
        assert!((blend(&back) - end).abs() > 0.05, "{back:?}");
    }
}

#[test]
fn locks_hold_what_they_name_and_nothing_else() {
    let delta = [0.1; PARAMS];
    for light in lights() {
        assert_eq!(mapping(Locks::ALL).step(&light, &delta), light);
        let power_locked = mapping(locks(true, true)).step(&light, &delta);
        assert_ne!(power_locked.shape, light.shape);
        let (before, after) = (power(&light), power(&power_locked));
        (0..3).for_each(|c| assert!((after[c] / before[c] - 1.0).abs() < 1e-4, "{before:?} {after:?}"));
        let mut tint = [0.0; PARAMS];
        tint[LANES + 2] = 0.5;
        let tinted = mapping(locks(false, true)).step(&light, &tint);
        assert!((luminance(power(&tinted)) / luminance(before) - 1.0).abs() < 1e-4);
        assert!(tinted.radiance[2] > 1.5 * light.radiance[2]);
        let stronger = mapping(locks(true, false)).step(&light, &[1.0; PARAMS]);
        let ratio = power(&stronger)[0] / before[0];
        assert!(ratio > 1.01 && (power(&stronger)[2] / before[2] / ratio - 1.0).abs() < 1e-4);
    }
}

#[test]
fn sides_that_keep_their_proportion_grow_as_one() {
    let map = mapping(Locks { proportion: true, ..Locks::default() });
    let ratio = |light: &Light| light.shape.sizes()[0] / light.shape.sizes()[1];
    for light in lights().iter().filter(|light| light.shape.has_lane(lane::SIZE.end - 1)) {
        let mut delta = [0.0; PARAMS];
        (delta[lane::SIZE.start], delta[lane::SIZE.start + 1]) = (0.3, -0.2);
        for other in [map.step(light, &delta), map.with_size(light, lane::SIZE.start, 0.9)] {
            assert!(other.shape.sizes()[0] > 1.05 * light.shape.sizes()[0], "{other:?}");
            assert!((ratio(&other) / ratio(light) - 1.0).abs() < 1e-4, "{other:?}");
        }
    }
}

#[test]
fn pull_back_is_the_slope_of_the_step() {
    // Any smooth function of a light will do.
    let value = |light: &Light| {
        let center = light.shape.center().unwrap_or_default();
        let [a, b] = light.shape.sizes();
        let axis = match light.shape {
            LightShape::Spot { axis, half_angle, blend, .. } => axis * (1.0 + half_angle + 2.0 * blend),
            LightShape::Sun { direction, .. } => direction,
            LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
                edge_u.normalize() + 2.0 * edge_v.normalize()
            }
            _ => Vec3::ZERO,
        };
        let radiance = 0.01 * light.radiance[0] + 0.2 * light.radiance[1] + light.radiance[2];
        f64::from(center.dot(Vec3::new(1.0, 0.5, -0.2)) + axis.dot(Vec3::new(0.3, -1.0, 0.4)))
            + f64::from(2.0 * a.ln() + b.ln() + radiance)
    };
    for light in lights() {
        let proportion = Locks { proportion: true, ..Locks::default() };
        for locks in [locks(false, false), locks(true, false), locks(false, true), proportion] {
            let map = mapping(locks);
            let by_lane: [f32; LANES] = std::array::from_fn(|i| {
                let at = |delta: f32| {
                    let mut step = [0.0; LANES];
                    step[i] = delta;
                    value(&Light { shape: light.shape.moved(&step), ..light.clone() })
                };
                ((at(1e-2) - at(-1e-2)) / 2e-2) as f32
            });
            let slopes = map.pull_back(&light, &by_lane, [0.01, 0.2, 1.0]);
            for i in 0..PARAMS {
                let at = |delta: f32| {
                    let mut step = [0.0; PARAMS];
                    step[i] = delta;
                    value(&map.step(&light, &step))
                };
                let slope = (at(1e-2) - at(-1e-2)) / 2e-2;
                let error = (slope - f64::from(slopes[i])).abs();
                assert!(error < 1e-2 * slope.abs() + 3e-3, "{light:?} {i}: {slope} for {}", slopes[i]);
            }
        }
    }
}

#[test]
fn bounds_hold_the_widest_spots_and_suns_that_there_are() {
    let bounds = Bounds::new(Vec3::splat(-1.0), Vec3::splat(1.0), [0.1, 1.0]);
    let half_angle = std::f32::consts::FRAC_PI_2;
    let mut widest = lights();
    widest.retain_mut(|light| match &mut light.shape {
        LightShape::Spot { half_angle: angle, .. } | LightShape::Sun { half_angle: angle, .. } => {
            *angle = half_angle;
            true
        }
        _ => false,
    });
    for light in widest {
        let with = bounds.including(&light);
        assert_eq!(with.fault(), None, "{light:?}");
        assert!(with.cone[1].max(with.sun[1]) > half_angle, "{light:?} does not fit in");
    }
}
