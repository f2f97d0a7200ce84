use super::*;
use crate::synthetic::SyntheticRoom;
use crate::{GridConfig, LightKind, LightParams, NetworkConfig, SizeRange, TargetMode};

fn tiny(config: TrainConfig) -> TrainConfig {
    let grid = GridConfig { levels: 2, log2_hashmap_size: 6, ..GridConfig::default() };
    let network = match config.network {
        NetworkConfig::Reference { .. } => NetworkConfig::Reference { width: 16, layers: 2, grid },
        NetworkConfig::Fast { .. } => NetworkConfig::Fast { width: 16, layers: 1, grid },
    };
    TrainConfig { network, batch_start: 1024, batch_end: 2048, samples: 40_960, held_out: 2, ..config }
}

fn configs() -> [TrainConfig; 2] {
    let size = SizeRange { min: 0.1, max: 0.4 };
    let pool = TargetMode::Pool { size: 12, denoised: false };
    [tiny(TrainConfig::fast(size)), tiny(TrainConfig { targets: pool, ..TrainConfig::reference(size) })]
}

fn trainer(config: TrainConfig, kind: LightKind) -> Trainer {
    let features = Arc::new(SyntheticRoom::new(20, 12).features());
    let mut trainer = Trainer::new(features, kind, config, 5).expect("a valid configuration");
    trainer.set_scene_hash("abc");
    trainer
}

fn run(trainer: &mut Trainer, steps: u64) {
    let source = SyntheticRoom::new(20, 12).with_noise(0.1);
    let end = trainer.steps() + steps;
    while trainer.steps() < end {
        trainer.step(&source).expect("a step");
    }
}

#[test]
fn resumed_training_equals_an_uninterrupted_one_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    for (config, kind) in configs().into_iter().zip([LightKind::Quad, LightKind::Sphere]) {
        let path = folder.path().join("training.safetensors");
        let mut whole = trainer(config.clone(), kind);
        run(&mut whole, 25);
        let mut first = trainer(config.clone(), kind);
        run(&mut first, 11);
        first.save(&path).expect("saved");
        let from_memory = trainer(config, kind).from_snapshot(first.snapshot().expect("weights"));
        drop(first);
        let from_file = Trainer::resume(&path).expect("resumed");
        for mut second in [from_file, from_memory] {
            run(&mut second, 14);
            assert_eq!(whole.state.params, second.state.params, "weights");
            assert_eq!(whole.state.mean, second.state.mean, "mean weights");
            assert_eq!(whole.state.optimiser.second, second.state.optimiser.second, "moments");
            assert_eq!(whole.info(), second.info());
        }
    }
}

#[test]
fn opened_proxies_give_the_same_pixels() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("proxy.safetensors");
    for config in configs() {
        let mut trainer = trainer(config, LightKind::Sphere);
        run(&mut trainer, 9);
        let proxy = trainer.proxy().expect("weights");
        proxy.save(&path).expect("saved");
        let opened = Proxy::open(&path).expect("opened");
        let light = LightParams::round(LightKind::Sphere, glam::Vec3::new(0.1, 0.2, 1.0), 0.2);
        assert_eq!(opened.info(), proxy.info());
        assert_eq!(opened.unit_image(&light).expect("image"), proxy.unit_image(&light).expect("image"));
        let error = Trainer::resume(&path).err().expect("a proxy is no training").to_string();
        assert!(error.contains("proxy.safetensors: a finished proxy"), "{error}");
        trainer.save(&path).expect("saved");
        assert_eq!(Proxy::open(&path).expect("opened").info(), proxy.info());
    }
}

#[test]
fn damaged_files_are_refused_without_a_panic() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("proxy.safetensors");
    let [config, _] = configs();
    let mut trainer = trainer(config, LightKind::Sphere);
    run(&mut trainer, 1);
    trainer.save(&path).expect("saved");
    let bytes = std::fs::read(&path).expect("read");
    assert!(fuzz_open(&bytes));
    let header_end = 8 + u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
    let sampled = |limit: usize| (0..bytes.len()).filter(move |i| *i < limit || i % 997 == 0);
    for length in sampled(64) {
        assert!(!fuzz_open(&bytes[..length]), "cut to {length} bytes");
    }
    for position in sampled(header_end) {
        let mut damaged = bytes.clone();
        damaged[position] ^= 1 << (position % 8);
        // Only white space after the header may change without changing what the file says.
        let harmless = bytes[position] == b' ' && damaged[position].is_ascii_whitespace();
        assert!(harmless || !fuzz_open(&damaged), "bit {} of byte {position} flipped", position % 8);
    }
    assert!(!fuzz_open(&[]) && !fuzz_open(&[0xff; 64]));
}

#[test]
fn other_format_versions_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("proxy.safetensors");
    let [config, _] = configs();
    trainer(config, LightKind::Sphere).proxy().expect("weights").save(&path).expect("saved");
    let mut bytes = std::fs::read(&path).expect("read");
    let needle = format!(r#"\"format_version\":{FORMAT_VERSION}"#);
    let at = bytes.windows(needle.len()).position(|w| w == needle.as_bytes()).expect("a version");
    bytes[at + needle.len() - 1] = b'7';
    std::fs::write(&path, bytes).expect("written");
    let error = Proxy::open(&path).expect_err("another version").to_string();
    assert!(
        error.contains("format 7") && error.contains(&format!("reads format {FORMAT_VERSION}")),
        "{error}"
    );
}

#[test]
fn failed_save_keeps_the_old_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let [config, _] = configs();
    let proxy = trainer(config, LightKind::Sphere).proxy().expect("weights");
    let error =
        proxy.save(&folder.path().join("missing/proxy.safetensors")).expect_err("no folder").to_string();
    assert!(error.contains("missing/proxy.safetensors"), "{error}");
}
