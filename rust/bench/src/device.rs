//! Parts that measure a GPU.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use glam::Vec3;
use relume_dump::MemoryWriter;
use relume_gather::{Gather, GpuGather, SampleSplit};
use relume_gpu::{Checks, Gpu};
use relume_proxy::synthetic::SyntheticRoom;
use relume_proxy::{GpuProxy, LightKind, SizeRange, TrainConfig, Trainer};
use relume_scene::{Light, LightShape};
use relume_session::Device;
use relume_trace::{Control, TraceSettings, Tracer};

use crate::figure::{Figure, Limit};
use crate::gather::on_gpu as gathers;
use crate::networks::{self, NetworkExtent};
use crate::scenes::closed_box;
use crate::{FigureRecord, live, peak, records, solve};

/// Numbers that the driver states, best rates of the device, and fixed costs of work on it.
pub fn limits(gpu: &Arc<Gpu>) -> Result<Vec<FigureRecord>> {
    let says = |property: relume_gpu::Property| {
        FigureRecord::from(Figure::new(format!("driver: {}", property.name), property.value, ""))
    };
    let mut records: Vec<FigureRecord> = gpu.properties().into_iter().map(says).collect();
    let mut add = |name: &str, value: f64, unit| records.push(Figure::new(name, value, unit).into());
    let peaks = peak::measure_peaks(gpu)?;
    // A multiply-add is two operations.
    let multiply_adds = [
        ("32-bit floats", Some(peaks.multiply_adds)),
        ("16-bit floats", peaks.half),
        ("16-bit matrices", peaks.matrices),
        ("16-bit matrices with sums of 32 bits", peaks.wide_matrices),
    ];
    for (what, rate) in multiply_adds {
        rate.iter().for_each(|rate| add(&format!("peak of {what}"), 2e-12 * rate, "TFLOP/s"));
    }
    add("plain read of several buffers", 1e-9 * peaks.read, "GB/s");
    add("plain copy, bytes read and written", 1e-9 * peak::copy(gpu)?, "GB/s");
    let [upload, read] = peak::transfers(gpu)?;
    add("copy from the CPU to the device", 1e-9 * upload, "GB/s");
    add("copy from the device to the CPU", 1e-9 * read, "GB/s");
    let costs = peak::measure_costs(gpu)?;
    add("a dispatch that waits for the one before", 1e6 * costs.dispatch, "us");
    add("a submission", 1e6 * costs.submit, "us");
    add("a submission that is waited for", 1e6 * costs.wait, "us");
    Ok(records)
}

/// Seconds from the first path to the first relit picture: one path a pixel is traced by the CPU and copied, a light
/// is gathered, and its picture comes back. Kernels are compiled, as on the first use in a process.
pub fn first_picture(gpu: &Arc<Gpu>, size: (usize, usize)) -> Result<Vec<FigureRecord>> {
    let scene = closed_box(size)?;
    let tracer = Tracer::new(&scene, &TraceSettings { samples: 1, ..TraceSettings::default() })?;
    let shape = LightShape::Sphere { center: Vec3::new(0.3, 0.2, 0.4), radius: 0.2 };
    let start = Instant::now();
    let writer = MemoryWriter::new(tracer.manifest())?;
    tracer.trace(&writer, &Control::default())?;
    let traced = start.elapsed().as_secs_f64();
    let gather = Gather::new(writer.snapshot());
    let on_gpu = GpuGather::new(Arc::clone(gpu), &gather)?;
    let lights = [gather.prepare(&Light::unit(shape))?];
    let images = on_gpu.unit_images(&lights, SampleSplit::All)?;
    let seconds = start.elapsed().as_secs_f64();
    // Three words a record, and a picture.
    let words = [3 * gather.dump().record_count(), images[0].data.len()];
    let [copied, read] = words.map(|words| (size_of::<u32>() * words) as f64);
    let [upload, read_back] = peak::transfers(gpu)?;
    let limit = Limit::copies(copied / upload + read / read_back);
    let (width, height) = size;
    let figure = |what: &str, seconds: f64| {
        Figure::new(format!("first picture, closed box, {width} x {height}, {what}"), seconds, "s")
    };
    let after = figure("of that after tracing", seconds - traced).within(&[limit]);
    Ok(vec![figure("in all", seconds).into(), after.into()])
}

/// The strength of a light dragged among others that are known: all are summed up anew, and one picture comes back, which is the
/// limit.
pub fn edit(device: &Device, gpu: &Gpu, (width, height): (usize, usize)) -> Result<Vec<FigureRecord>> {
    let (seconds, bytes) = live::strength_edit(device, gpu, (width, height))?;
    let name = format!("strength of one of {} lights dragged, {width} x {height}", live::LIGHTS);
    let [_, read] = peak::transfers(gpu)?;
    let picture = Figure::new(format!("{name}, to the picture"), 1e3 * seconds, "ms");
    let picture = picture.within(&[Limit::copies(1e3 * bytes / read)]);
    let copied = Figure::new(format!("{name}, copied to the CPU"), 1e-6 * bytes, "MB");
    Ok(vec![picture.into(), copied.into()])
}

/// Gathers from a made-up room of one size on every card.
pub fn gather(gpu: &Arc<Gpu>, megabytes: usize) -> Result<Vec<FigureRecord>> {
    Ok(records(gathers::measure(gpu, megabytes)?))
}

/// Gathers of one light in a picture of this width and height with so many samples.
pub fn paper_gather(gpu: &Arc<Gpu>, size: (usize, usize, usize)) -> Result<Vec<FigureRecord>> {
    Ok(records(gathers::measure_paper(gpu, size)?))
}

/// Inference, light steps and training of the usual networks.
pub fn networks(gpu: &Arc<Gpu>, extent: NetworkExtent) -> Result<Vec<FigureRecord>> {
    Ok(records(networks::device(gpu, extent)?))
}

/// A gather and the widest network with kernels that check their indices and loops, beside the same without.
pub fn checks(gpu: &Gpu, megabytes: usize, extent: NetworkExtent) -> Result<Vec<FigureRecord>> {
    let measure = |checks: Checks| {
        let second = gpu.open_second(checks)?;
        let gather = gathers::seconds_of_a_light(&second, megabytes)?;
        let (network, inference) = networks::seconds_of_the_widest(&second, extent)?;
        let figure = |name: String, seconds: f64| {
            Figure::new(format!("{name}, with checks of indices and loops"), 1e3 * seconds, "ms")
        };
        Ok::<_, anyhow::Error>([
            figure("gather of 1 sphere light".into(), gather),
            figure(network, inference),
        ])
    };
    let [unchecked, checked] = [measure(Checks::Off)?, measure(Checks::On)?];
    let record = |(unchecked, checked): (Figure, Figure)| FigureRecord {
        peer: Some("without".into()),
        peer_value: Some(unchecked.value),
        ratio: Some(checked.value / unchecked.value),
        ..checked.into()
    };
    Ok(unchecked.into_iter().zip(checked).map(record).collect())
}

/// One light solved in so many steps as in the paper's section 6.2, through the default network. The limit is that of its products.
pub fn light(gpu: &Arc<Gpu>, (width, height): (usize, usize), steps: usize) -> Result<Vec<FigureRecord>> {
    let config = TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 });
    let features = Arc::new(SyntheticRoom::new(width, height).features());
    let trainer = Trainer::new(features, LightKind::Sphere, config, 1)?;
    let proxy = GpuProxy::new(Arc::clone(gpu), &trainer.proxy()?)?;
    let seconds = solve::seconds_of_a_light(&proxy, (width, height), steps)?;
    // Each step goes forward, forward again and backward.
    let evaluated = 3.0 * (steps * width * height) as f64 * f64::from(solve::PIXELS);
    let limit = evaluated * trainer.multiply_adds().1 as f64 / peak::multiply_adds(gpu)?;
    let figure = Figure::new(solve_name((width, height), steps), seconds, "s");
    Ok(vec![figure.within(&[Limit::operations(limit)]).into()])
}

/// Name of the figure of [`light`].
pub fn solve_name((width, height): (usize, usize), steps: usize) -> String {
    let share = 100.0 * solve::PIXELS;
    format!("one light solved, {steps} steps on {share} % of {width} x {height} pixels")
}
