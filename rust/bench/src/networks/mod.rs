//! Speed of the kernels against the fused-multiply-add peak of one core, measured in the same process. Time is that of
//! the thread, which other processes disturb less than the clock on the wall.

mod multiply_adds;

use std::hint::black_box;
use std::sync::Arc;

use cpu_time::ThreadTime;
use relume_gpu::Gpu;
use relume_gpu::compare::{Layers, StepTargets};
use relume_proxy::synthetic::SyntheticRoom;
use relume_proxy::{
    GpuProxy, GridConfig, Isa, LightKind, LightParams, NetworkConfig, ProxyError, SizeRange, TargetMode,
    TrainConfig, Trainer, compare,
};

use crate::figure::{Figure, Limit};
use crate::peak::{self, Peaks};
use crate::timing::{best_of_rounds, seconds_on};

/// Extent of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetworkExtent {
    /// Rounds, of which the best counts. On the CPU the peak is measured again in each, so that both see the same clock.
    pub rounds: usize,
    /// Pixels of the image.
    pub size: [usize; 2],
    /// Samples of a training step; on the CPU, where the step of a wider network has fewer, at most.
    pub samples: usize,
    /// Width of the widest network.
    pub widest: usize,
}

impl NetworkExtent {
    /// Extent on the CPU.
    pub const CPU: Self = Self { rounds: ROUNDS, size: [160, 96], samples: 16_384, widest: 256 };
    /// Extent on a graphics card: an image of the paper's size.
    pub const CARD: Self = Self { rounds: ROUNDS, size: PAPER_SIZE, samples: 16_384, widest: 256 };
    /// Extent on a software driver: a tenth of it in both directions.
    pub const SOFTWARE: Self = Self { rounds: ROUNDS, size: [88, 50], samples: 1024, widest: 256 };
    /// Smallest extent, to see that it works.
    pub const TRIAL: Self = Self { rounds: 1, size: [20, 12], samples: 1024, widest: 64 };
}

const ROUNDS: usize = 7;

/// Inference and training (forward, backward, optimiser) of the usual networks on one thread, in samples per second.
///
/// # Errors
/// Does not fail unless the configurations in here are wrong.
pub fn kernels(extent: NetworkExtent) -> Result<Vec<Figure>, ProxyError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|error| ProxyError::Config(format!("no thread for the benchmark: {error}")))?;
    pool.install(|| {
        let mut figures = Vec::new();
        for (name, network, batch) in networks(extent) {
            figures.extend(measure(name, network, batch.min(extent.samples), extent)?);
        }
        Ok(figures)
    })
}

/// Name, network, and samples of a training step.
fn networks(extent: NetworkExtent) -> impl Iterator<Item = (&'static str, NetworkConfig, usize)> {
    let grid = GridConfig::default();
    let all = [
        ("reference 64/4", NetworkConfig::Reference { width: 64, layers: 4, grid }, 8192),
        ("reference 128/8", NetworkConfig::Reference { width: 128, layers: 8, grid }, 4096),
        ("reference 256/8", NetworkConfig::Reference { width: 256, layers: 8, grid }, 2048),
        ("fast 64x2", NetworkConfig::Fast { width: 64, layers: 2, grid }, 16_384),
        ("fast 128x2", NetworkConfig::Fast { width: 128, layers: 2, grid }, 8192),
    ];
    let width = |network: &NetworkConfig| match network {
        NetworkConfig::Reference { width, .. } | NetworkConfig::Fast { width, .. } => *width,
    };
    all.into_iter().filter(move |(_, network, _)| width(network) <= extent.widest)
}

/// Share of the pixels that a step of the light optimiser looks at.
const STEP_SHARE: usize = 20;

/// Inference of whole images, and steps of the light optimiser, of the usual networks on a GPU, in milliseconds; and iterations of
/// their training per second.
///
/// # Errors
/// If the device fails or has not the memory.
pub fn device(gpu: &Arc<Gpu>, extent: NetworkExtent) -> Result<Vec<Figure>, ProxyError> {
    let limits = NetworkLimits { peaks: peak::measure_peaks(gpu)?, read_back: peak::transfers(gpu)?[1] };
    let mut figures = Vec::new();
    for (name, network, _) in networks(extent) {
        figures.extend(measure_device(gpu, &limits, name, network.clone(), extent)?);
        figures.extend(measure_training(gpu, &limits.peaks, name, network, extent)?);
    }
    Ok(figures)
}

/// Limits of a device.
struct NetworkLimits {
    peaks: Peaks,
    /// Bytes a second to the CPU.
    read_back: f64,
}

/// Pixels of the paper's pictures (section 6.1).
const PAPER_SIZE: [usize; 2] = [885, 500];

/// Names that [`device`] gives the inference of a network at the paper's size: by matrices, and by the plain kernel.
#[cfg(test)]
pub fn inference_names(network: &str) -> [String; 2] {
    [true, false].map(|by_matrices| name_of(inference(by_matrices), network, PAPER_SIZE))
}

/// Names that [`device`] gives the training of a network on a card, at the paper's size: by matrices, and in 32 bits.
#[cfg(test)]
pub fn training_names(network: &str) -> [String; 2] {
    [true, false]
        .map(|by_matrices| name_of(&training(by_matrices, NetworkExtent::CARD.samples), network, PAPER_SIZE))
}

fn training(by_matrices: bool, samples: usize) -> String {
    format!("training on {samples} samples an iteration{}", if by_matrices { " by matrices" } else { "" })
}

fn inference(by_matrices: bool) -> &'static str {
    if by_matrices { "inference by matrices" } else { "inference kernel" }
}

fn name_of(task: &str, network: &str, [width, height]: [usize; 2]) -> String {
    format!("{task} {network}, {width} x {height}")
}

/// Times of an image and of a step of the light optimiser, and how far images are from sums of 64 bits.
fn measure_device(
    gpu: &Arc<Gpu>,
    NetworkLimits { peaks, read_back }: &NetworkLimits,
    name: &str,
    network: NetworkConfig,
    NetworkExtent { rounds, size: [width, height], .. }: NetworkExtent,
) -> Result<Vec<Figure>, ProxyError> {
    let mut trainer = device_trainer(network, [width, height])?;
    trainer.set_output_bias(2.0);
    let on_device = GpuProxy::new(Arc::clone(gpu), &trainer.proxy()?)?;
    let light = test_light();
    let count = width * height;
    let cost = count as f64 * trainer.multiply_adds().1 as f64;
    // Products, and what is read of the pixels.
    let limits = |peak: f64, times: f64, share: f64| {
        let bytes = share * on_device.image_bytes() as f64;
        [Limit::operations(1e3 * share * times * cost / peak), Limit::bytes(1e3 * bytes / peaks.read)]
    };
    let named = |task: &str, value: f64, unit| Figure::new(name_of(task, name, [width, height]), value, unit);
    let mut figures = Vec::new();
    for by_matrices in [false, true] {
        let task = inference(by_matrices);
        if let Some(seconds) = seconds_of_an_image(&on_device, &light, by_matrices)? {
            let peak = peaks.matrices.filter(|_| by_matrices).unwrap_or(peaks.multiply_adds);
            figures.push(named(task, 1e3 * seconds, "ms").within(&limits(peak, 1.0, 1.0)));
        }
        if let Some(error) = on_device.error(&light, by_matrices)? {
            figures.push(named(&format!("largest error of {task}"), error, OF_THE_LARGEST));
        }
    }
    let peak = peaks.matrices.filter(|_| on_device.by_matrices()).unwrap_or(peaks.multiply_adds);
    let image = best_of_rounds(rounds, || on_device.unit_image(&light).map(drop))?;
    let [products, pixels] = limits(peak, 1.0, 1.0);
    let copied = Limit::copies(1e3 * (3 * size_of::<f32>() * count) as f64 / read_back);
    let figure = named("unit image with read-back", 1e3 * image, "ms");
    figures.push(figure.within(&[products, pixels, copied]));

    // Forward, forward again and backward, by the plain units.
    let share = 1.0 / STEP_SHARE as f64;
    let step = named("light step on 5 % of the pixels", 1e3 * seconds_of_a_step(&on_device, rounds)?, "ms");
    figures.push(step.within(&limits(peaks.multiply_adds, 3.0, share)));
    Ok(figures)
}

/// Unit of an error.
const OF_THE_LARGEST: &str = "of the largest value";

fn test_light() -> LightParams {
    LightParams::round(LightKind::Sphere, glam::Vec3::new(0.3, -0.5, 1.0), 0.2)
}

/// Seconds of the kernel that makes a unit image, by matrices or not; nothing where there is no such kernel.
fn seconds_of_an_image(
    on_device: &GpuProxy,
    light: &LightParams,
    by_matrices: bool,
) -> Result<Option<f64>, ProxyError> {
    let mut is_there = true;
    let seconds = seconds_on(on_device.gpu(), |commands| {
        is_there = on_device.add_unit_image(commands, light, by_matrices)?;
        Ok::<(), ProxyError>(())
    })?;
    Ok(is_there.then_some(seconds))
}

/// Seconds of a step of the light optimiser.
fn seconds_of_a_step(on_device: &GpuProxy, rounds: usize) -> Result<f64, ProxyError> {
    let count = on_device.proxy().features().pixel_count();
    let layers = Layers::new(on_device.gpu(), &[&vec![[0.5; 3]; count]])?;
    let targets = one_target(count / STEP_SHARE, count);
    let light = [(test_light(), [1.0; 3])];
    best_of_rounds(rounds, || compare(&[on_device], &layers, &[], &light, &targets).map(drop))
}

/// Name of the widest of the networks that are measured, and seconds in which the plain kernel makes an image of it.
///
/// # Errors
/// If the device fails or has not the memory.
pub fn seconds_of_the_widest(gpu: &Arc<Gpu>, extent: NetworkExtent) -> Result<(String, f64), ProxyError> {
    let cost = |network: &NetworkConfig| match network {
        NetworkConfig::Reference { width, layers, .. } | NetworkConfig::Fast { width, layers, .. } => {
            width * width * layers
        }
    };
    let widest = networks(extent).max_by_key(|(_, network, _)| cost(network));
    let (name, network, _) = widest.ok_or_else(|| ProxyError::Config("no network to measure".into()))?;
    let trainer = device_trainer(network, extent.size)?;
    let on_device = GpuProxy::new(Arc::clone(gpu), &trainer.proxy()?)?;
    let seconds = seconds_of_an_image(&on_device, &test_light(), false)?.unwrap_or(f64::NAN);
    Ok((name_of(inference(false), name, extent.size), seconds))
}

/// A grey target at some of all pixels, every so manieth in an order without pattern.
fn one_target(count: usize, all: usize) -> StepTargets {
    let cells = (0..count).map(|i| (i as u32).wrapping_mul(0x9e37_79b1) % all as u32).collect();
    StepTargets::target(cells, vec![[0.3, 0.3, 0.3, 1.0 / count as f32]; count], 1.0)
}

fn device_trainer(network: NetworkConfig, [width, height]: [usize; 2]) -> Result<Trainer, ProxyError> {
    let config = TrainConfig {
        muon: matches!(network, NetworkConfig::Fast { .. }),
        network,
        ..TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 })
    };
    Trainer::new(Arc::new(SyntheticRoom::new(width, height).features()), LightKind::Sphere, config, 1)
}

/// Iterations of training in 32 bits, and by matrices of 16-bit floats where the device has them. The limit is that of products
/// in 32 bits, or of such matrices.
fn measure_training(
    gpu: &Arc<Gpu>,
    peaks: &Peaks,
    name: &str,
    network: NetworkConfig,
    NetworkExtent { rounds, size: [width, height], samples, .. }: NetworkExtent,
) -> Result<Vec<Figure>, ProxyError> {
    let mut figures = Vec::new();
    for matrices in [false, true] {
        let trainer = device_trainer(network.clone(), [width, height])?;
        let peak = peaks.wide_matrices.filter(|_| matrices).unwrap_or(peaks.multiply_adds);
        // Backward costs a product for the inputs and one for the weights.
        let limit = peak / (3.0 * (samples * trainer.multiply_adds().0) as f64);
        let room = SyntheticRoom::new(width, height);
        if let Some(seconds) = trainer.seconds_on_gpu(gpu, &room, (samples, rounds), matrices)? {
            let name = name_of(&training(matrices, samples), name, [width, height]);
            let figure = Figure::new(name, 1.0 / seconds, "iterations/s");
            figures.push(figure.within(&[Limit::operations(limit)]));
        }
    }
    Ok(figures)
}

/// Peak of one core, multiply-adds per second.
fn peak_rate(isa: Isa) -> f64 {
    let rounds = 20_000;
    let start = ThreadTime::now();
    black_box(multiply_adds::chains(isa, rounds));
    (rounds * multiply_adds::OF_A_ROUND) as f64 / start.elapsed().as_secs_f64()
}

fn measure(
    name: &str,
    network: NetworkConfig,
    batch: usize,
    NetworkExtent { rounds, size: [width, height], .. }: NetworkExtent,
) -> Result<[Figure; 2], ProxyError> {
    let isa = Isa::detect();
    let room = SyntheticRoom::new(width, height);
    let config = TrainConfig {
        muon: matches!(network, NetworkConfig::Fast { .. }),
        network,
        batch_start: batch,
        batch_end: batch,
        targets: TargetMode::Raw,
        ..TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 })
    };
    let mut trainer = Trainer::new(Arc::new(room.features()), LightKind::Sphere, config, 1)?;
    let proxy = trainer.proxy()?;
    let light = test_light();
    let mut pixels = vec![[0.0; 3]; room.features().pixel_count()];
    let fixed = trainer.first_batch(&room, batch)?;
    let (mut peak, mut infer, mut train) = (0.0f64, 0.0f64, 0.0f64);
    for _ in 0..rounds {
        peak = peak.max(peak_rate(isa));
        let start = ThreadTime::now();
        proxy.forward(&light, black_box(&mut pixels))?;
        infer = infer.max(pixels.len() as f64 / start.elapsed().as_secs_f64());
        let start = ThreadTime::now();
        trainer.descend(black_box(&fixed), 0.5)?;
        train = train.max(batch as f64 / start.elapsed().as_secs_f64());
    }
    let (train_cost, infer_cost) = trainer.multiply_adds();
    let figure = |task: &str, value: f64, cost: f64| {
        let name = format!("{task} {name}, one thread, {}", isa.name());
        Figure::new(name, value, "samples/s").within(&[Limit::operations(peak / cost)])
    };
    // Backward costs a product for the inputs and one for the weights.
    Ok([figure("inference", infer, infer_cost as f64), figure("training", train, 3.0 * train_cost as f64)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    /// There may be others, by matrices. Errors have no limit.
    fn check(figures: &[Figure], names: &[String]) {
        let has = |name: &String| figures.iter().any(|figure| figure.name == *name);
        assert!(names.iter().all(has), "{figures:?}");
        let good = |x: f64| x.is_finite() && x > 0.0;
        let share = |figure: &Figure| figure.share_of_limit().map_or(figure.unit == OF_THE_LARGEST, good);
        assert!(figures.iter().all(|figure| good(figure.value) && share(figure)), "{figures:?}");
    }

    #[test]
    fn networks_are_measured_on_the_cpu() {
        for (name, network, _) in networks(NetworkExtent::TRIAL) {
            let figures = measure(name, network, 1024, NetworkExtent::TRIAL).expect("measured");
            let isa = Isa::detect().name();
            let names = ["inference", "training"].map(|task| format!("{task} {name}, one thread, {isa}"));
            check(&figures, &names);
        }
    }

    fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    #[test]
    fn networks_are_measured_on_any_device() {
        let gpu = gpu();
        let peaks = Peaks { multiply_adds: 1e9, half: None, matrices: None, wide_matrices: None, read: 1e9 };
        let (extent, limits) = (NetworkExtent::TRIAL, NetworkLimits { peaks, read_back: 1e9 });
        for (name, network, _) in networks(NetworkExtent::TRIAL) {
            let figures = measure_device(&gpu, &limits, name, network.clone(), extent).expect("measured");
            let tasks = [
                "inference kernel",
                "largest error of inference kernel",
                "unit image with read-back",
                "light step on 5 % of the pixels",
            ];
            check(&figures, &tasks.map(|task| format!("{task} {name}, 20 x 12")));
            let figures = measure_training(&gpu, &peaks, name, network, extent).expect("measured");
            check(&figures, &[format!("training on 1024 samples an iteration {name}, 20 x 12")]);
        }
    }

    #[test]
    fn the_widest_network_is_that_with_most_products() {
        let (name, seconds) = seconds_of_the_widest(&gpu(), NetworkExtent::TRIAL).expect("measured");
        assert!(seconds > 0.0 && name == "inference kernel reference 64/4, 20 x 12", "{name}: {seconds}");
    }
}
