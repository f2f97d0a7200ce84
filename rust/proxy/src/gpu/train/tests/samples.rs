//! Sources of samples on the device: the scene, and pools of images.

use super::super::pool::DevicePool;
use super::*;
use crate::pool::Pool;
use crate::trainer::Samples as SamplesOf;

const POOL: usize = 20;

/// Makes more images while it goes on than the pool has room for.
fn pooled() -> TrainConfig {
    let network = NetworkConfig::Fast { width: 8, layers: 1, grid: tiny_grid() };
    TrainConfig { network, targets: TargetMode::Pool { size: POOL, denoised: false }, ..short(60_000) }
}

fn weights(trainer: &Trainer) -> Vec<f32> {
    trainer.whole_state().expect("weights").params.clone()
}

fn pool_of(trainer: &mut Trainer) -> &mut Option<DevicePool> {
    &mut trainer.device.as_mut().expect("on the device").pool
}

/// The pool in buffers of three images.
fn in_parts(trainer: &Trainer) -> DevicePool {
    let training = &trainer.device.as_ref().expect("on the device").training;
    let pixels = trainer.features.pixel_count();
    DevicePool::in_parts(training, (POOL, pixels), 4 * 12 * pixels as u64 - 1).expect("room")
}

#[test]
fn samples_of_images_on_the_device_are_those_of_the_cpu() {
    let (setup, grid, room) = (setup(LightKind::Quad), tiny_grid(), SyntheticRoom::new(40, 24));
    let network = FastNetwork::new(8, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Fast { width: 8, layers: 1, grid }, 2, 8);
    let sampler = Sampler {
        kind: LightKind::Quad,
        size: SIZE,
        placement: LightPlacement::Segments,
        area_weight: 0.5,
        pixel_count: 960,
    };
    let scale = OutputScale { factor: 0.3, area: Some(sampler.middling_area()) };
    // Five images at a time, of numbers 11 and on.
    let mut pool = Pool::new((5, false), 1, 0);
    while pool.missing(0) > 0 {
        pool.fill(&sampler, &room, 0, 3).expect("images");
    }
    let expected = sampler.batch_from_pool(&pool, &scale, (2 * CHUNK, 8), (1, 2));
    let (pixels, numbers) = sampler.drawn_from_pool(&pool, (2 * CHUNK, 8), (1, 2));
    let demand = Demand { config: &config, scene: &setup.scene, chunks: 3, draws: 3, matrices: false };
    let gpu = gpu();
    let [there, here] = [0, 1].map(|_| GpuTraining::new(Arc::clone(&gpu), &network, &demand).expect("room"));
    here.write_chunks(1, &expected, &scale);
    // Two images in a buffer, and one in the last.
    let on_device = DevicePool::in_parts(&there, (5, 960), 2 * 12 * 960).expect("room");
    for (number, light, image) in pool.take_images() {
        let row = there.store.light_row(&light, sampler.weight(&light), &scale);
        on_device.put(&there, (number, &image), &row).expect("copied");
    }
    on_device.write_chunks(&there, 1, &pixels, &numbers);
    on_device.take(&there, 3).expect("taken");
    let stored = |training: &GpuTraining| {
        let (store, chunk) = (&training.store, CHUNK_TILES * TARGET_TILE);
        let floats = |buffer: &Buffer<f32>| gpu.read(buffer, buffer.len() / 3..buffer.len()).expect("read");
        let pixels = gpu.read(&store.pixels, CHUNK / 8..3 * CHUNK / 8).expect("read");
        assert_eq!(store.targets.len(), 3 * chunk);
        (pixels, floats(&store.scene), floats(&store.lights), floats(&store.targets))
    };
    let (found, expected) = (stored(&there), stored(&here));
    assert!(expected.3.iter().any(|value| *value > 0.0), "no light");
    assert_eq!(found, expected);
}

#[test]
fn a_pool_on_the_device_trains_as_one_that_is_not() {
    let config = pooled();
    let mut here = trainer(&config, 3).on_gpu(gpu()).expect("room");
    *pool_of(&mut here) = None;
    run(&mut here);
    let expected = weights(&here);

    let mut there = trainer(&config, 3).on_gpu(gpu()).expect("room");
    assert!(pool_of(&mut there).is_some());
    *pool_of(&mut there) = Some(in_parts(&there));
    run(&mut there);
    assert_eq!((there.steps(), there.samples()), (here.steps(), here.samples()));
    assert!(weights(&there) == expected, "in parts");
    let (SamplesOf::Pool(images), SamplesOf::Pool(kept)) = (&mut there.samples_of, &mut here.samples_of)
    else {
        unreachable!("a pool was asked for")
    };
    assert_eq!((images.take_images().count(), kept.take_images().count()), (0, POOL), "images here");

    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("training.safetensors");
    let mut first = trainer(&config, 3).on_gpu(gpu()).expect("room");
    while first.samples() < 30_000 {
        first.step(&room()).expect("a step");
    }
    first.save(&path).expect("saved");
    let mut second = Trainer::resume(&path).expect("resumed").on_gpu(gpu()).expect("room");
    run(&mut second);
    assert!(weights(&second) == expected, "resumed");
}

#[test]
fn a_pool_without_room_on_the_device_stays_on_the_cpu() {
    let (config, gpu) = (pooled(), gpu());
    let whole = gpu.free_memory();
    let mut roomy = trainer(&config, 3).on_gpu(Arc::clone(&gpu)).expect("room");
    let images = 12 * (POOL * roomy.features.pixel_count()) as u64;
    let taken = whole - gpu.free_memory();
    assert!(pool_of(&mut roomy).is_some() && taken > images);
    run(&mut roomy);
    let expected = weights(&roomy);
    drop(roomy);
    // Twice as much as the images take, but for a bit; what else belongs to them is small beside that.
    gpu.set_memory_budget(Some(taken - images + 2 * images - images / 4));
    let mut tight = trainer(&config, 3).on_gpu(Arc::clone(&gpu)).expect("room");
    assert!(pool_of(&mut tight).is_none());
    run(&mut tight);
    assert!(weights(&tight) == expected);
}

#[test]
fn a_picture_of_any_size_trains_in_little_memory() {
    let room = SyntheticRoom::new(1920, 1080);
    let network = NetworkConfig::Fast { width: 8, layers: 1, grid: tiny_grid() };
    let config = TrainConfig { network, ..short(40_000) };
    let mut large = Trainer::new(Arc::new(room.features()), LightKind::Sphere, config, 3).expect("valid");
    let gpu = gpu();
    // Many devices have buffers of 128 MiB at most; 16 values a pixel would fill one.
    gpu.set_memory_budget(Some(64 << 20));
    large = large.on_gpu(gpu).expect("room");
    let losses = std::iter::from_fn(|| (large.steps() < 8).then(|| large.step(&room).expect("a step").loss));
    let losses: Vec<f64> = losses.flatten().collect();
    assert!(!losses.is_empty() && losses.iter().all(|loss| loss.is_finite()), "{losses:?}");
}
