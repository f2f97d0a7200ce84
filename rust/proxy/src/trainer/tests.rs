use super::*;
use crate::synthetic::SyntheticRoom;
use crate::{GridConfig, LearningRates, LightPlacement, PixelQueries, SizeRange, TargetMode};

fn config(samples: u64) -> TrainConfig {
    let grid = GridConfig { levels: 4, ..GridConfig::default() };
    TrainConfig {
        network: NetworkConfig::Fast { width: 32, layers: 2, grid },
        batch_start: 2048,
        batch_end: 4096,
        lights_per_pixel: 8,
        samples,
        rates: LearningRates { adam: 8e-3, muon: 8e-3, grid: 4e-3, final_fraction: 0.01 },
        held_out: 4,
        ..TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 })
    }
}

fn trained(config: TrainConfig, kind: LightKind, room: &SyntheticRoom) -> Trainer {
    let mut trainer =
        Trainer::new(Arc::new(room.features()), kind, config, 3).expect("a valid configuration");
    while !trainer.done() {
        trainer.step(room).expect("a step");
    }
    trainer
}

#[test]
fn fast_network_learns_the_room_for_every_kind_of_light() {
    let room = SyntheticRoom::new(48, 32).with_noise(0.2);
    for kind in [LightKind::Sphere, LightKind::FacingDisk, LightKind::Quad] {
        let mut start = Trainer::new(Arc::new(room.features()), kind, config(1), 3).expect("valid");
        let before = start.validate(&room).expect("scores");
        let after = trained(config(400_000), kind, &room).validate(&room).expect("scores");
        assert!(after.psnr > 20.0 && after.psnr > before.psnr + 8.0, "{kind}: {before:?} to {after:?}");
    }
}

#[test]
fn scores_do_not_depend_on_how_many_held_out_images_are_made_at_once() {
    let room = SyntheticRoom::new(24, 16);
    let start = || Trainer::new(Arc::new(room.features()), LightKind::Sphere, config(1), 3).expect("valid");
    let (mut apart, mut together) = (start(), start());
    let made = [(); 3].map(|()| apart.hold_out(&room, 3).expect("images"));
    assert_eq!(made, [3, 1, 0]);
    assert_eq!(apart.validate(&room).expect("scores"), together.validate(&room).expect("scores"));
    assert_eq!(together.hold_out(&room, 3).expect("images"), 0, "they are kept");
}

#[test]
fn reference_network_learns_from_a_pool() {
    let room = SyntheticRoom::new(48, 32);
    let config = TrainConfig {
        network: NetworkConfig::Reference { width: 32, layers: 3, grid: GridConfig::default() },
        targets: TargetMode::Pool { size: 60, denoised: true },
        ..config(400_000)
    };
    let config = TrainConfig {
        rates: LearningRates { grid: 1e-2, ..config.rates },
        muon: false,
        scale_by_area: false,
        area_weight: 0.0,
        sample_reuse: 1,
        samples: 800_000,
        ..config
    };
    let after = trained(config, LightKind::Sphere, &room).validate(&room).expect("scores");
    assert!(after.psnr > 14.0, "{after:?}");
}

#[test]
fn training_does_not_depend_on_the_number_of_threads() {
    let room = SyntheticRoom::new(24, 16).with_noise(0.2);
    let weights = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| trained(config(40_000), LightKind::Sphere, &room).state.params)
    };
    assert!(weights(1) == weights(3), "three threads change the weights");
}

#[test]
fn lights_in_bounds_and_ranges_are_reported() {
    let room = SyntheticRoom::new(24, 16);
    let config = TrainConfig { placement: LightPlacement::Bounds, ..config(20_000) };
    let trainer = trained(config, LightKind::Sphere, &room);
    let (low, high) = room.bounds();
    let proxy = trainer.proxy().expect("weights");
    let ranges = proxy.info().trained_ranges.clone();
    for axis in 0..3 {
        let [least, greatest] = ranges[axis];
        assert!(least >= low[axis] && greatest <= high[axis] && least < greatest, "axis {axis}: {ranges:?}");
    }
    assert!(ranges[3][0] >= 0.0999 && ranges[3][1] <= 0.5001, "radius: {ranges:?}");
    let at = |place| LightParams::round(LightKind::Sphere, place, 0.2).shape();
    let (middle, extent) = (0.5 * (low + high), high - low);
    assert!(proxy.has_learned_place(&at(middle)));
    for axis in [glam::Vec3::X, glam::Vec3::Y, glam::Vec3::Z] {
        assert!(!proxy.has_learned_place(&at(middle + 0.7 * extent * axis)), "beyond {axis}");
        assert!(!proxy.has_learned_place(&at(middle - 0.7 * extent * axis)), "beyond -{axis}");
    }
}

/// A source that fails when told to.
struct Failing {
    room: SyntheticRoom,
    mode: std::sync::atomic::AtomicU8,
}

impl Failing {
    fn set(&self, mode: u8) {
        self.mode.store(mode, std::sync::atomic::Ordering::Relaxed);
    }
}

impl TargetSource for Failing {
    fn bounds(&self) -> (glam::Vec3, glam::Vec3) {
        self.room.bounds()
    }
    fn segment_point(&self, _pixel: u32, _rng: &mut Rng) -> Option<glam::Vec3> {
        None
    }
    fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
        self.room.pixel_targets(queries, out)?;
        match self.mode.load(std::sync::atomic::Ordering::Relaxed) {
            0 => Ok(()),
            1 => {
                out[17] = [f32::NAN; 3];
                Ok(())
            }
            _ => Err(ProxyError::targets("the disk is gone")),
        }
    }
    fn images(
        &self,
        _lights: &[relume_scene::LightShape],
        _denoised: bool,
    ) -> Result<Vec<Image>, ProxyError> {
        Ok(Vec::new())
    }
}

#[test]
fn bad_targets_stop_training_with_the_weights_of_the_step_before() {
    let source = Failing { room: SyntheticRoom::new(24, 16), mode: Default::default() };
    let features = Arc::new(source.room.features());
    // Each step wants fresh samples.
    let config = TrainConfig { sample_reuse: 1, batch_start: 4096, ..config(100_000) };
    let mut trainer = Trainer::new(features, LightKind::Sphere, config, 3).expect("valid");
    trainer.step(&source).expect("first step");
    trainer.step(&source).expect("second step");
    let before = trainer.state.params.clone();
    source.set(1);
    let error = trainer.step(&source).expect_err("NaN").to_string();
    assert!(error.contains("is not finite"), "{error}");
    source.set(2);
    assert!(trainer.step(&source).expect_err("no targets").to_string().contains("the disk is gone"));
    assert!(trainer.validate(&source).expect_err("no images").to_string().contains("target images"));
    assert_eq!((trainer.steps(), &trainer.state.params), (2, &before));
    let light = LightParams::round(LightKind::Sphere, glam::Vec3::Z, 0.2);
    assert!(
        trainer
            .proxy()
            .expect("weights")
            .unit_image(&light)
            .expect("still usable")
            .data
            .iter()
            .all(|x| x.is_finite())
    );
    source.set(0);
    trainer.step(&source).expect("the source is back");
}

#[test]
fn divergence_is_named_and_leaves_the_weights_alone() {
    let room = SyntheticRoom::new(24, 16);
    let mut trainer =
        Trainer::new(Arc::new(room.features()), LightKind::Sphere, config(20_000), 3).expect("valid");
    trainer.state.params[0] = f32::INFINITY;
    let before = trainer.state.params.clone();
    let error = trainer.step(&room).expect_err("infinite weights").to_string();
    assert!(error.contains("diverged at step 0"), "{error}");
    assert_eq!(trainer.state.params, before);
}

#[test]
fn senseless_configurations_and_features_are_refused() {
    let room = SyntheticRoom::new(24, 16);
    let new = |config: TrainConfig, features: PixelFeatures| {
        Trainer::new(Arc::new(features), LightKind::Sphere, config, 3).err().expect("refused").to_string()
    };
    let bad = TrainConfig { lights_per_pixel: 3, ..config(1) };
    assert!(new(bad, room.features()).contains("lights_per_pixel must be"));
    let bad = TrainConfig { size: SizeRange { min: 0.0, max: f32::NAN }, ..config(1) };
    assert!(new(bad, room.features()).contains("size.min must be"));
    let mut features = room.features();
    features.normal[5][1] = f32::NAN;
    assert!(new(config(1), features).contains("normal of pixel 5"));
    let mut features = room.features();
    features.depth.pop();
    assert!(new(config(1), features).contains("depth holds 383 pixels instead of 384"));
}

#[test]
fn proxies_refuse_other_lights_and_wrong_lengths() {
    let room = SyntheticRoom::new(24, 16);
    let proxy = Trainer::new(Arc::new(room.features()), LightKind::Sphere, config(1), 3)
        .expect("valid")
        .proxy()
        .expect("weights");
    let sphere = LightParams::round(LightKind::Sphere, glam::Vec3::Z, 0.2);
    let quad = LightParams::quad(glam::Vec3::Z, glam::Vec3::X, glam::Vec3::Y);
    assert!(
        proxy
            .unit_image(&quad)
            .expect_err("quad")
            .to_string()
            .contains("trained for sphere lights, not for quad")
    );
    assert!(matches!(proxy.forward(&sphere, &mut []), Err(ProxyError::Length { expected: 384, .. })));
    let outside = proxy.forward_pixels(&[384], &sphere, &mut [[0.0; 3]]);
    assert!(matches!(outside, Err(ProxyError::PixelOutside { pixel: 384, count: 384 })));
    assert_eq!(proxy.backward(&[], &sphere, &[]).expect("nothing to do"), vec![0.0; 4]);
    assert!(proxy.covers(&sphere.shape()) && !proxy.covers(&quad.shape()));
}

#[test]
fn spots_are_covered_from_the_narrowest_learned_cone_on() {
    let features = Arc::new(SyntheticRoom::new(24, 16).features());
    let trainer = Trainer::new(features, LightKind::Spot, config(8_000), 1).expect("valid");
    let proxy = trainer.proxy().expect("weights");
    let covers = |kind, radius, half_angle| {
        let cone = [half_angle, 0.0];
        proxy.covers(&LightParams::spot(kind, glam::Vec3::Z, radius, cone, glam::Vec3::NEG_Z).shape())
    };
    let radius = proxy.info().size.max;
    assert!(covers(LightKind::Spot, radius, 1.5) && covers(LightKind::Spot, radius, 0.05));
    assert!(!covers(LightKind::Spot, radius, 0.02), "a narrower cone");
    assert!(!covers(LightKind::Spot, 2.0 * radius, 0.5), "a larger light");
    assert!(!covers(LightKind::SphereSpot, radius, 0.5), "without soft falloff");
}

#[test]
fn subsets_and_coarse_images_show_the_same_pixels() {
    let room = SyntheticRoom::new(37, 19);
    let proxy = trained(config(8_000), LightKind::Sphere, &room).proxy().expect("weights");
    let light = LightParams::round(LightKind::Sphere, glam::Vec3::Z, 0.2);
    let whole = proxy.unit_image(&light).expect("image");
    for stride in [1, 2, 5] {
        let (pixels, [width, height]) = proxy.coarse_pixels(stride);
        assert_eq!(pixels.len(), width * height);
        let mut some = vec![[f32::NAN; 3]; pixels.len()];
        proxy.forward_pixels(&pixels, &light, &mut some).expect("pixels");
        for (pixel, value) in pixels.iter().zip(some) {
            let start = *pixel as usize * 3;
            assert_eq!(value[..], whole.data[start..start + 3], "stride {stride}, pixel {pixel}");
        }
    }
}

#[test]
fn proxy_gradients_follow_the_scale_with_area() {
    let room = SyntheticRoom::new(32, 20);
    let proxy = trained(config(200_000), LightKind::Sphere, &room).proxy().expect("weights");
    let light = LightParams::round(LightKind::Sphere, glam::Vec3::new(-0.3, -0.6, 1.5), 0.3);
    let pixels: Vec<u32> = (320..480).collect();
    let loss = |light: &LightParams| {
        let mut out = vec![[0.0; 3]; pixels.len()];
        proxy.forward_pixels(&pixels, light, &mut out).expect("pixels");
        out.iter().flatten().map(|x| f64::from(*x)).sum::<f64>()
    };
    let gradient = proxy.backward(&pixels, &light, &vec![[1.0; 3]; pixels.len()]).expect("gradient");
    for index in 0..4 {
        let moved = |step: f32| {
            let mut params = light.as_slice().to_vec();
            params[index] += step;
            loss(&LightParams::from_slice(LightKind::Sphere, &params).expect("four"))
        };
        let found = (moved(2e-3) - moved(-2e-3)) / 4e-3;
        let largest = gradient.iter().fold(0.0f64, |m, g| m.max(f64::from(g.abs())));
        let error = (found - f64::from(gradient[index])).abs();
        assert!(error < 0.05 * largest, "parameter {index}: quotient {found}, gradient {gradient:?}");
    }
}
