//! Expected values are Cycles 4.2, 4.5 and 5.2 renders of a white Lambertian plane below a light of 100 W: the
//! pixel is irradiance / pi.

use super::*;

const SPHERE: BlenderLightKind = BlenderLightKind::Point { radius: 0.5, soft_falloff: false };

fn light(kind: BlenderLightKind) -> BlenderLight {
    BlenderLight {
        name: "Lamp".into(),
        world_from_object: [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 2.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
        kind,
        energy: 100.0,
        color: white(),
        exposure: 0.0,
        temperature_color: white(),
        emission: white(),
        normalize: true,
        least_size: MIN_SIZE,
        lobes: LobeFactors::default(),
        receivers: None,
        map: None,
        rules: LightRules::default(),
    }
}

fn scaled(mut light: BlenderLight, scale: [f32; 3]) -> BlenderLight {
    for (row, factor) in scale.into_iter().enumerate() {
        light.world_from_object[row][row] *= factor;
    }
    light
}

fn area(shape: AreaShape, size: f32, size_y: f32, spread: f32) -> BlenderLight {
    light(BlenderLightKind::Area { shape, size, size_y, spread })
}

/// Mean irradiance / pi at the origin of a plane facing +z, by midpoint integration over directions.
fn probe(light: &BlenderLight) -> f32 {
    let (light, _) = light.to_light().unwrap();
    let (n_theta, n_phi) = (2000, 400);
    let mut sum = 0.0_f64;
    for i in 0..n_theta {
        // Stratified in sin^2: equal projected solid angle.
        let sin2 = (i as f32 + 0.5) / n_theta as f32;
        for j in 0..n_phi {
            let phi = (j as f32 + 0.5) / n_phi as f32 * 2.0 * PI;
            let (s, c) = (sin2.sqrt(), (1.0 - sin2).sqrt());
            sum += f64::from(profile(&light.shape, Vec3::new(s * phi.cos(), s * phi.sin(), c)));
        }
    }
    (sum / f64::from(n_theta * n_phi)) as f32 * light.radiance[0]
}

/// Radiance seen from the origin along `d` for shapes right above it (independent of the gather's own code).
fn profile(shape: &LightShape, d: Vec3) -> f32 {
    let hit = |inside: bool| if inside { 1.0 } else { 0.0 };
    match *shape {
        LightShape::Sphere { center, radius } => hit((center - d * d.dot(center)).length() < radius),
        LightShape::FacingDisk { center, radius } => {
            let t = center.length() / d.dot(center.normalize());
            hit(t > 0.0 && (d * t - center).length() < radius)
        }
        LightShape::Sun { direction, half_angle } => hit(d.dot(direction) > half_angle.cos()),
        LightShape::Quad { center, edge_u, edge_v, spread }
        | LightShape::Ellipse { center, edge_u, edge_v, spread } => {
            let normal = edge_u.cross(edge_v).normalize();
            let cos = -d.dot(normal);
            let local = d * (center.dot(normal) / d.dot(normal)) - center;
            let uv =
                [local.dot(edge_u) / edge_u.length_squared(), local.dot(edge_v) / edge_v.length_squared()];
            let inside = match shape {
                LightShape::Quad { .. } => uv.iter().all(|x| x.abs() < 0.5),
                _ => uv[0].powi(2) + uv[1].powi(2) < 0.25,
            };
            let focus = if spread < PI {
                let (half, angle) = (0.5 * spread, cos.clamp(-1.0, 1.0).acos());
                ((half.tan() - angle.tan()) / (half.tan() - half)).max(0.0)
            } else {
                1.0
            };
            hit(inside && cos > 0.0) * focus
        }
        LightShape::Spot { .. } | LightShape::StretchedSpot { .. } | LightShape::Sheared { .. } => {
            unreachable!("these are probed by their radiance")
        }
    }
}

fn assert_close(found: f32, expected: f32) {
    assert!((found / expected - 1.0).abs() < 4e-3, "found {found}, Cycles has {expected}");
}

#[test]
fn point_lights_match_cycles() {
    assert_close(probe(&light(SPHERE)), 0.63325);
    let soft = |radius| light(BlenderLightKind::Point { radius, soft_falloff: true });
    assert_close(probe(&soft(0.3)), 0.61932);
    assert_close(probe(&soft(1.0)), 0.50656);
    assert_close(probe(&scaled(soft(0.5), [2.0; 3])), 0.59591);
    assert_close(probe(&BlenderLight { normalize: false, ..light(SPHERE) }), 1.98911);
    assert_close(probe(&BlenderLight { exposure: 1.0, ..light(SPHERE) }), 1.26650);
}

#[test]
fn spot_has_the_radiance_of_a_point() {
    let spot = BlenderLightKind::Spot { radius: 0.5, soft_falloff: false, spot_size: 1.0, spot_blend: 0.5 };
    let (point, _) = light(SPHERE).to_light().unwrap();
    let (spot, _) = light(spot).to_light().unwrap();
    assert_eq!(spot.radiance, point.radiance);
    let LightShape::Spot { half_angle, axis, .. } = spot.shape else { panic!("not a spot") };
    assert_eq!((half_angle, axis), (0.5, Vec3::NEG_Z));
}

#[test]
fn spot_cone_follows_the_objects_scale() {
    // tan(0.5) * 3 reaches 0.8 and tan(0.5) / 3 does not reach 0.3, as probes at these offsets saw.
    let spot = BlenderLightKind::Spot { radius: 0.01, soft_falloff: true, spot_size: 1.0, spot_blend: 0.0 };
    let half_angle = |scale| match scaled(light(spot), scale).to_light().unwrap().0.shape {
        LightShape::Spot { half_angle, .. } => half_angle,
        _ => 0.0,
    };
    assert_close(half_angle([3.0, 3.0, 1.0]).tan(), 3.0 * 0.5_f32.tan());
    assert_close(half_angle([1.0, 1.0, 3.0]).tan(), 0.5_f32.tan() / 3.0);
    assert_close(half_angle([2.0, 2.0, 2.0]), 0.5);
}

#[test]
fn suns_match_cycles() {
    for angle in [0.1, 1.0, 2.5] {
        assert_close(probe(&light(BlenderLightKind::Sun { angle })), 31.831);
    }
    let raw = |angle| BlenderLight { normalize: false, ..light(BlenderLightKind::Sun { angle }) };
    assert_close(probe(&raw(1.0)), 22.98519);
    assert_close(probe(&raw(2.5)), 90.05682);
}

#[test]
fn area_lights_match_cycles() {
    use AreaShape::*;
    assert_close(probe(&area(Square, 1.0, 9.0, PI)), 2.33885);
    assert_close(probe(&scaled(area(Rectangle, 2.0, 1.0, PI), [1.0, 2.0, 1.0])), 1.90539);
    assert_close(probe(&scaled(area(Rectangle, 2.0, 1.0, PI), [-1.0, 2.0, 1.0])), 1.90540);
    assert_close(probe(&scaled(area(Rectangle, 2.0, 1.0, PI), [1.0, 2.0, -1.0])).max(1e-9), 1e-9);
    assert_close(probe(&area(Disk, 1.0, 9.0, PI)), 2.38399);
    let raw = BlenderLight { normalize: false, ..area(Square, 2.0, 0.0, PI) };
    assert_close(probe(&raw), 7.622);
}

#[test]
fn spread_keeps_the_power() {
    for (degrees, expected) in [(120.0_f32, 5.27372), (90.0, 8.85160), (40.0, 27.642)] {
        assert_close(probe(&area(AreaShape::Square, 1.0, 0.0, degrees.to_radians())), expected);
    }
}

#[test]
fn zero_sizes_keep_their_irradiance_and_say_so() {
    for kind in [
        BlenderLightKind::Point { radius: 0.0, soft_falloff: true },
        BlenderLightKind::Sun { angle: 0.0 },
        BlenderLightKind::Area { shape: AreaShape::Square, size: 0.0, size_y: 0.0, spread: PI },
    ] {
        let (light, notes) = light(kind).to_light().unwrap();
        assert!(light.radiance[0].is_finite() && !notes.is_empty(), "{light:?}");
        assert!(notes[0].contains("'Lamp'"));
    }
}

#[test]
fn damage_is_refused_by_name() {
    let refused = |light: BlenderLight| light.to_light().unwrap_err().to_string();
    assert!(
        refused(BlenderLight { energy: f32::NAN, ..light(SPHERE) })
            .contains("'Lamp': a value is not a finite")
    );
    assert!(refused(BlenderLight { exposure: 1000.0, ..light(SPHERE) }).contains("not a finite"));
    assert!(refused(scaled(area(AreaShape::Square, 1.0, 0.0, PI), [0.0; 3])).contains("scale is zero"));
    let negative = BlenderLightKind::Point { radius: -1.0, soft_falloff: true };
    assert!(refused(light(negative)).contains("negative"));
}

#[test]
fn json_needs_only_what_differs_from_the_defaults() {
    let json = r#"{"name": "Key", "kind": {"type": "AREA", "shape": "DISK", "size": 2.0}, "energy": 50,
        "world_from_object": [[1,0,0,0],[0,1,0,0],[0,0,1,3],[0,0,0,1]]}"#;
    let light: BlenderLight = serde_json::from_str(json).unwrap();
    assert!(light.normalize && light.lobes.camera == 0.0);
    let back: BlenderLight = serde_json::from_str(&serde_json::to_string(&light).unwrap()).unwrap();
    assert_eq!(back, light);
    let misspelt = json.replace("energy", "enregy");
    assert!(serde_json::from_str::<BlenderLight>(&misspelt).unwrap_err().to_string().contains("enregy"));
}

/// Lights without radius, whose radiance is more than the largest number.
#[test]
fn lights_too_bright_to_be_summed_are_refused_by_name() {
    for radius in [0.0, 0.5] {
        let kind = BlenderLightKind::Point { radius, soft_falloff: true };
        let error = BlenderLight { energy: f32::MAX, ..light(kind) }.to_light().unwrap_err();
        assert_eq!(error.to_string(), "light 'Lamp': it is brighter than 1e30; lower its power");
        assert!(BlenderLight { energy: 1e25, ..light(kind) }.to_light().is_ok());
    }
}

/// The light under a parent that is scaled unevenly.
fn sheared(light: BlenderLight) -> BlenderLight {
    let columns = [[1.0, 0.2, 0.0], [0.3, 0.6, 0.1], [0.0, -0.4, 1.5]];
    let mut rows = light.world_from_object;
    (0..3).for_each(|row| (0..3).for_each(|column| rows[row][column] = columns[column][row]));
    BlenderLight { world_from_object: rows, ..light }
}

#[test]
fn sheared_lights_keep_their_edges_and_face_along_their_own_z_axis() {
    let area = |shape| BlenderLightKind::Area { shape, size: 0.5, size_y: 0.2, spread: PI };
    for (form, round) in [(AreaShape::Rectangle, false), (AreaShape::Ellipse, true)] {
        let (light, notes) = sheared(light(area(form))).to_light().unwrap();
        let LightShape::Sheared { edge_u, edge_v, facing, is_ellipse, .. } = light.shape else {
            panic!("{:?}", light.shape)
        };
        assert_eq!((edge_u, is_ellipse), (Vec3::new(0.5, 0.1, 0.0), round));
        assert!(notes.len() == 1 && notes[0].contains("sheared"), "{notes:?}");
        assert!((edge_v.length() - 0.2 * 0.46f32.sqrt()).abs() < 1e-6, "{edge_v}");
        assert!((facing - Vec3::new(0.0, 0.4, -1.5).normalize()).length() < 1e-6, "{facing}");
        // Cycles' area: the product of the lengths, whatever the angle.
        let fill = if round { 0.25 * PI } else { 1.0 };
        let area = edge_u.length() * edge_v.length() * fill;
        assert_close(light.radiance[0], 100.0 / (PI * area));
    }
    let mut flat = light(area(AreaShape::Square));
    (0..3).for_each(|row| flat.world_from_object[row][1] = flat.world_from_object[row][0]);
    assert!(flat.to_light().unwrap_err().to_string().contains("flat"));
}

#[test]
fn a_stretched_spot_has_its_cone_in_its_own_space() {
    let spot =
        |spot_blend| BlenderLightKind::Spot { radius: 0.1, soft_falloff: true, spot_size: 1.0, spot_blend };
    let is_stretched = |light: &BlenderLight| matches!(light.to_light().unwrap().0.shape, LightShape::StretchedSpot { half_angle, .. } if half_angle == 0.5);
    for (light, expected) in [
        (scaled(light(spot(0.0)), [2.0, 2.0, 1.0]), false),
        // A soft edge is not as soft in the world.
        (scaled(light(spot(0.3)), [2.0, 2.0, 1.0]), true),
        (scaled(light(spot(0.3)), [2.0, 2.0, 2.0]), false),
        (scaled(light(spot(0.0)), [2.0, 0.7, 1.3]), true),
        (sheared(light(spot(0.0))), true),
    ] {
        assert_eq!(is_stretched(&light), expected, "{light:?}");
    }
}

#[test]
fn small_lights_keep_the_size_that_their_scene_shows() {
    let point = |radius| light(BlenderLightKind::Point { radius, soft_falloff: true });
    let radius = |light: &BlenderLight| light.to_light().unwrap().0.shape.sizes()[0];
    assert_eq!(radius(&point(1e-4)), MIN_SIZE);
    assert_eq!(point(1e-4).to_light().unwrap().1.len(), 1);
    let close = |radius| BlenderLight { least_size: 1e-3, ..point(radius) };
    assert_eq!((radius(&close(0.0)), radius(&close(2e-3))), (1e-3, 2e-3));
    assert!(close(0.0).to_light().unwrap().1.is_empty());
    assert!(BlenderLight { least_size: 0.0, ..point(0.1) }.to_light().is_err());
    assert!(!serde_json::to_string(&point(0.1)).unwrap().contains("least_size"));
}
