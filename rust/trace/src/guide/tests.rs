use super::target::TargetPlace;
use super::*;

fn light(shape: &LightShape) -> Light {
    Light { name: "light".into(), ..Light::unit(*shape) }
}

fn guide(shapes: &[LightShape]) -> Guide {
    let lights: Vec<Light> = shapes.iter().map(light).collect();
    Guide::new(&lights, 0.5).expect("lights")
}

impl Guide {
    fn seen_from(&self, point: Vec3) -> Cones {
        let mut cones = Cones::default();
        self.fill_cones(point, Horizon::default(), &mut cones);
        cones
    }

    fn seen(&self) -> Cones {
        self.seen_from(Vec3::ZERO)
    }
}

fn number(i: usize, factor: f64) -> f32 {
    ((i as f64 + 0.5) * factor).fract() as f32
}

fn samples(cones: &Cones) -> impl Iterator<Item = Vec3> {
    // Irrational steps of Roberts's sequence.
    (0..200_000).map(move |i| {
        cones.sample([number(i, 0.819_172_51), number(i, 0.671_043_61), number(i, 0.549_700_48)])
    })
}

/// A direction out of all.
fn on_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(radius * cos_phi, radius * sin_phi, z)
}

fn ball(center: Vec3, radius: f32) -> LightShape {
    LightShape::Sphere { center, radius }
}

#[test]
fn densities_are_those_of_what_is_drawn() {
    let sun = LightShape::Sun { direction: Vec3::Y, half_angle: 0.005 };
    let near = ball(Vec3::new(0.0, 1.0, 0.3), 0.4);
    let far = ball(Vec3::new(4.0, 0.0, 2.0), 1e-4);
    let u = Vec3::new(0.6, 0.0, 0.8);
    let strip =
        LightShape::Quad { center: 2.0 * Vec3::X, edge_u: 1.2 * u, edge_v: 0.04 * Vec3::Y, spread: PI };
    let oval =
        LightShape::Ellipse { center: 2.0 * Vec3::X, edge_u: 0.2 * u, edge_v: 0.9 * Vec3::Y, spread: 1.0 };
    let grazing = LightShape::Quad {
        center: Vec3::new(1.0, 0.3, 0.0),
        edge_u: Vec3::X,
        edge_v: 0.4 * Vec3::Z + 0.1 * Vec3::Y,
        spread: PI,
    };
    let sheared = |is_ellipse| LightShape::Sheared {
        center: Vec3::new(1.0, 0.3, 0.2),
        edge_u: 0.5 * u,
        edge_v: Vec3::new(0.1, 0.4, 0.3),
        facing: Vec3::new(-0.8, 0.0, 0.6),
        spread: PI,
        is_ellipse,
    };
    let all = vec![sun, near, far, strip, oval];
    let [slanted, slanted_oval] = [false, true].map(|is_ellipse| vec![sheared(is_ellipse)]);
    for shapes in
        [vec![sun], vec![near], vec![far], vec![strip], vec![oval], vec![grazing], slanted, slanted_oval, all]
    {
        let cones = guide(&shapes).seen();
        // The integral of 1 over a half-space and over the rest, where there is any density.
        let mut integrals = [0.0_f64; 2];
        let mut reached = 0;
        for direction in samples(&cones) {
            let density = cones.density(direction);
            assert!(direction.is_normalized());
            if density > 0.0 {
                reached += 1;
                integrals[usize::from(direction.x > 0.0)] += 1.0 / f64::from(density) / 200_000.0;
            }
        }
        // Rounding at the rims of cones.
        assert!(reached > 199_000, "{reached}");
        let mut expected = [0.0_f64; 2];
        for i in 0..2_000_000 {
            let direction =
                on_sphere([number(i, 0.754_877_666_246_692_7), number(i, 0.569_840_290_998_053_2)]);
            if cones.density(direction) > 0.0 {
                expected[usize::from(direction.x > 0.0)] += f64::from(2.0 * TAU) / 2e6;
            }
        }
        for (found, expected) in integrals.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 0.02 * expected.max(0.01),
                "{shapes:?}: {found} for {expected}"
            );
        }
    }
}

#[test]
fn half_of_the_directions_meet_the_light() {
    for radius in [0.003, 0.05, 0.5] {
        let center = Vec3::new(1.0, -2.0, 0.5);
        let cones = guide(&[ball(center, radius)]).seen();
        let hits = samples(&cones)
            .filter(|direction| center.cross(*direction).length() <= radius * (1.0 + 1e-4))
            .count();
        assert!(hits > 100_000, "{hits} of 200000");
    }
}

#[test]
fn lights_are_left_to_chance_where_it_meets_them_or_they_do_not_shine() {
    let all = Vec3::new(3.0, 0.0, 0.0);
    assert!(guide(&[ball(all, 2.0)]).seen().share == 0.0);
    assert!(guide(&[ball(all, 3.1)]).seen().share == 0.0);
    let spot = |axis: Vec3| LightShape::Spot {
        center: all,
        radius: 0.1,
        axis,
        half_angle: 0.5,
        blend: 0.0,
        soft_falloff: true,
    };
    assert!(guide(&[spot(Vec3::X)]).seen().share == 0.0);
    let to_us = guide(&[spot(-Vec3::X)]).seen();
    assert_eq!((to_us.lobes.len(), to_us.share > 0.49), (1, true));
    let quad = LightShape::Quad { center: all, edge_u: 0.1 * Vec3::Y, edge_v: 0.1 * Vec3::Z, spread: PI };
    assert!(guide(&[quad]).seen().share == 0.0);
    assert!(guide(&[quad]).seen_from(Vec3::new(6.0, 0.0, 0.0)).share > 0.0);
}

#[test]
fn lights_below_both_normals_are_not_guided_to() {
    let guide = guide(&[LightShape::Sun { direction: Vec3::Z, half_angle: 0.005 }]);
    let share = |normals| {
        let mut cones = Cones::default();
        guide.fill_cones(Vec3::ZERO, Horizon(normals), &mut cones);
        cones.share
    };
    let (down, level) = (Vec3::new(0.6, 0.0, -0.8), Vec3::new(1.0, 0.0, -0.001));
    assert_eq!(share(Some([down, -Vec3::Z])), 0.0);
    assert!(share(Some([down, level])) > 0.0 && share(Some([Vec3::Z, down])) > 0.0 && share(None) > 0.0);
}

#[test]
fn chance_to_meet_a_strip_is_that_of_its_solid_angle() {
    let center = Vec3::new(0.0, 0.0, 3.0);
    let strip = LightShape::Quad { center, edge_u: 1.2 * Vec3::X, edge_v: -0.03 * Vec3::Y, spread: PI };
    let chance = hit_probability(None, Vec3::ZERO, &light(&strip)).unwrap();
    assert!((chance / (1.2 * 0.03 / (9.0 * PI)) - 1.0).abs() < 0.03, "{chance}");
    let far = Vec3::new(0.0, 0.0, -3000.0);
    let chance_from_far = hit_probability(None, far, &light(&strip)).unwrap();
    assert!((chance_from_far / chance * 1001.0_f32.powi(2) - 1.0).abs() < 1e-3, "{chance_from_far}");
    let guide = guide(&[strip]);
    let guided = hit_probability(Some(&guide), Vec3::ZERO, &light(&strip)).unwrap();
    let meets = |direction: Vec3| {
        let place = direction * (3.0 / direction.z);
        direction.z > 0.0 && place.x.abs() <= 0.6 && place.y.abs() <= 0.015
    };
    let drawn = samples(&guide.seen()).filter(|direction| meets(*direction)).count() as f32 / 200_000.0;
    assert!((guided / (0.5 * drawn + 0.5 * chance) - 1.0).abs() < 0.03, "{guided}, {drawn} drawn");
}

#[test]
fn there_is_none_without_lights_or_share() {
    let light = light(&ball(Vec3::ZERO, 1.0));
    assert!(Guide::new(&[], 0.5).is_none() && Guide::new(&[light], 0.0).is_none());
}

#[test]
fn of_too_many_lights_the_strongest_are_guided_to() {
    let at = |i: usize| light(&ball(Vec3::new(3.0, 0.3 * i as f32, 0.0), 0.01));
    let mut lights: Vec<Light> = (0..MOST_LIGHTS + 1).map(at).collect();
    lights[MOST_LIGHTS].radiance = [2.0; 3];
    let guide = Guide::new(&lights, 0.5).unwrap();
    assert_eq!(guide.targets.len(), MOST_LIGHTS);
    assert!((guide.targets[0].brightness - 2.0).abs() < 1e-6);
}

#[test]
fn suns_are_guided_to_before_any_lamp() {
    let lamp = light(&ball(Vec3::X, 1.0));
    let sun = light(&LightShape::Sun { direction: Vec3::Z, half_angle: 0.005 });
    let lights: Vec<Light> = [vec![lamp; MOST_LIGHTS], vec![sun]].concat();
    let guide = Guide::new(&lights, 0.5).unwrap();
    assert!(matches!(guide.targets[0].place, TargetPlace::Sky { .. }));
}

#[test]
fn lights_that_take_light_away_are_guided_to_like_others() {
    let shape = ball(Vec3::new(2.0, 1.0, 0.0), 0.05);
    let bright = light(&shape);
    let dark = Light { radiance: [-1.0; 3], ..bright.clone() };
    let chances = [&bright, &dark].map(|one| {
        let guide = Guide::new(&[one.clone(), light(&ball(Vec3::X, 0.01))], 0.5);
        hit_probability(guide.as_ref(), Vec3::ZERO, one).unwrap()
    });
    assert!(chances[0] > 0.1 && chances[0] == chances[1], "{chances:?}");
}

#[test]
fn chance_to_meet_a_light_is_that_of_what_is_drawn() {
    let lamp = ball(Vec3::new(2.0, -1.0, 1.0), 0.05);
    let moved = ball(Vec3::new(2.0, 1.5, 1.0), 0.05);
    let guide = guide(&[lamp]);
    let cones = guide.seen();
    let at = |shape: &LightShape| hit_probability(Some(&guide), Vec3::ZERO, &light(shape)).unwrap();
    let by_chance = hit_probability(None, Vec3::ZERO, &light(&lamp)).unwrap();
    assert!((by_chance / (0.05 * 0.05 / 6.0) - 1.0).abs() < 0.01, "{by_chance}");
    let hit = |direction: &Vec3| Vec3::new(2.0, -1.0, 1.0).cross(*direction).length() <= 0.05;
    let drawn = samples(&cones).filter(hit).count() as f32 / 200_000.0;
    let expected = 0.5 * drawn + 0.5 * by_chance;
    assert!((at(&lamp) / expected - 1.0).abs() < 0.02, "{} for {expected}", at(&lamp));
    assert!(at(&moved) < by_chance && at(&moved) > 0.4 * by_chance, "{}", at(&moved));
    let away = LightShape::Spot {
        center: Vec3::new(2.0, -1.0, 1.0),
        radius: 0.05,
        axis: Vec3::X,
        half_angle: 0.5,
        blend: 0.0,
        soft_falloff: true,
    };
    assert!(hit_probability(None, Vec3::ZERO, &light(&away)).is_none());
}
