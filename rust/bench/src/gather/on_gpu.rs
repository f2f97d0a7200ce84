//! Speed of the gather on a GPU against what that GPU can read, measured in the same process just before.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use relume_dump::Flags;
use relume_gather::{
    Environment, Gather, GatherError, GpuGather, GpuLights, GpuWorld, PreparedLight, SampleSplit, SoftGather,
};
use relume_gpu::Gpu;
use relume_scene::{Alpha, ColorEncoding, LightShape, Texels, Texture, World};

use super::paper::{PaperDump, SEGMENT_BYTES};
use super::room::{POSITION_BYTES, Room, light, room, sphere};
use crate::figure::{Figure, Limit};
use crate::peak;

/// Rounds, of which the best counts.
const ROUNDS: usize = 3;
/// Bytes of a record on the device.
const RECORD_BYTES: u64 = 12;
/// Multiply-adds, or what takes as long, of the test whether a sphere is near a segment (`is_near` in `light.wgsl`): five times
/// three coordinates, a division, and three comparisons.
const LIGHT_TEST: f64 = 19.0;

/// Width and height of the paper's picture, and its samples (table 1).
pub const PAPER: (usize, usize, usize) = (885, 500, 512);
/// Segments of a path: what measured scenes have on average, whose paths end where they leave the scene or carry next to nothing.
const PAPER_SEGMENTS: usize = 3;
/// Lights that the paper's size is measured for.
const PAPER_LIGHTS: [usize; 3] = [1, 8, 32];
/// Bytes of a record of a sorted dump, which lies beside that in the order of paths.
const SORTED_BYTES: u64 = 21;
/// Ratio of the CPU's memory that a dump takes while it is made to that when it is there.
const CPU_FACTOR: u64 = 2;

/// Measures gathers on the device, from a made-up room. `megabytes` is the size of the positions; 1024 is well beyond
/// the caches of a graphics card.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure(gpu: &Arc<Gpu>, megabytes: usize) -> Result<Vec<Figure>, GatherError> {
    let bench = Bench::new(gpu, Gather::new(room(megabytes)?))?;
    let peaks = GatherPeaks::new(gpu)?;
    let mut figures = Vec::new();
    let spheres: Vec<_> = (0..32).map(sphere).collect();
    for count in [1, 8, 16, 32] {
        let segments = bench.gather(&spheres[..count])?;
        let rate = figure(&format!("gather of {count} sphere lights"), segments * 1e-9, "G segments/s");
        // Many lights share one pass over the bytes.
        let limits = peaks.segments(POSITION_BYTES / count as f64, 1.0);
        figures.push(rate.within(&limits.map(|limit| scaled(limit, 1e-9))));
        if count == 1 {
            let bytes = figure(ONE_LIGHT_READS, segments * POSITION_BYTES * 1e-9, "GB/s");
            figures.push(bytes.within(&[Limit::bytes(peaks.read * 1e-9)]));
        }
    }
    figures.extend(bench.all_targets(&spheres[..16], &peaks)?);
    figures.push(bench.world(peaks.read)?);
    figures.extend(bench.smoothed(peaks.read)?);
    figures.extend(bench.sorted(peaks.read)?);
    Ok(figures)
}

/// Measures gathers at a size like the paper's ([`PAPER`]), with as many of its samples as fit the memory of device
/// and CPU: of some lights in one call, from records as they lie here and as many as they lie in the paper's memory, and of one
/// light of a tenth of the scene, which is missing if there is no room to sort the segments. The names say how many samples.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure_paper(
    gpu: &Arc<Gpu>,
    (width, height, most): (usize, usize, usize),
) -> Result<Vec<Figure>, GatherError> {
    let samples = fitting_samples(gpu, (width, height, most));
    let size = (width, height, samples);
    let segments = PAPER_SEGMENTS;
    let cpu = Gather::new(Room { width, height, tile: 32, samples, segments }.dump()?);
    let bench = Bench::new(gpu, cpu)?;
    let (records, peaks) = (bench.cpu.dump().record_count() as f64, GatherPeaks::new(gpu)?);
    let spheres: Vec<_> = (0..32).map(sphere).collect();
    let mut figures = Vec::new();
    for count in PAPER_LIGHTS {
        let seconds = records * count as f64 / bench.gather(&spheres[..count])?;
        figures.extend(paper_figures((LAYOUT, count), size, (records, seconds), &peaks));
    }
    if bench.on_gpu.sort()? {
        let bytes = bench.on_gpu.sorted_bytes(&bench.prepare(&[SMALL])?[0]).unwrap_or(POSITION_BYTES);
        let time = Figure::new(paper_name(SMALL_LIGHT, size), 1e3 * records / bench.gather(&[SMALL])?, "ms");
        figures.push(time.within(&[Limit::bytes(1e3 * records * bytes / peaks.read)]));
    }
    let lights = PAPER_LIGHTS.map(|count| bench.on_gpu.lights(&bench.prepare(&spheres[..count])?));
    drop(bench);
    figures.extend(as_in_the_paper(gpu, size, lights, &peaks)?);
    Ok(figures)
}

/// Layout of segments: a name, and bytes of each that are read.
type Layout = (&'static str, f64);
const LAYOUT: Layout = ("", POSITION_BYTES);
const LAYOUT_OF_THE_PAPER: Layout = (" in the paper's layout", SEGMENT_BYTES);

/// Time of a gather of so many lights from so many segments; of one light also bytes a second.
fn paper_figures(
    ((layout, bytes), count): (Layout, usize),
    size: (usize, usize, usize),
    (segments, seconds): (f64, f64),
    peaks: &GatherPeaks,
) -> Vec<Figure> {
    let (s, all) = (if count == 1 { "" } else { "s" }, peaks.segments(bytes, count as f64));
    let time = Figure::new(
        paper_name(&format!("gather of {count} sphere light{s}{layout}"), size),
        1e3 * seconds,
        "ms",
    );
    let mut figures =
        vec![time.within(&all.map(|limit| Limit { value: 1e3 * segments / limit.value, ..limit }))];
    if count == 1 {
        let name = paper_name(&format!("{ONE_LIGHT_READS}{layout}"), size);
        let rate = Figure::new(name, segments * bytes * 1e-9 / seconds, "GB/s");
        figures.push(rate.within(&[Limit::bytes(peaks.read * 1e-9)]));
    }
    figures
}

/// Gathers of some of the lights from as many segments as a dump of this size has, as they lie in the paper's memory.
fn as_in_the_paper(
    gpu: &Gpu,
    size: (usize, usize, usize),
    lights: [Result<GpuLights, GatherError>; PAPER_LIGHTS.len()],
    peaks: &GatherPeaks,
) -> Result<Vec<Figure>, GatherError> {
    let (width, height, samples) = size;
    let dump = PaperDump::new(gpu, width * height * samples * PAPER_SEGMENTS, width * height)?;
    let mut figures = Vec::new();
    for (count, lights) in PAPER_LIGHTS.into_iter().zip(lights) {
        let lights = lights?;
        let kernel = dump.kernel(gpu, count)?;
        let gather = || dump.gather(gpu, &kernel, &lights).map(drop).map_err(GatherError::from);
        let seconds = seconds(gpu, gather)?;
        let measured = (dump.segments() as f64, seconds);
        figures.extend(paper_figures((LAYOUT_OF_THE_PAPER, count), size, measured, peaks));
    }
    Ok(figures)
}

/// Seconds of a gather of one light, of what [`measure`] gathers.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn seconds_of_a_light(gpu: &Arc<Gpu>, megabytes: usize) -> Result<f64, GatherError> {
    let bench = Bench::new(gpu, Gather::new(room(megabytes)?))?;
    Ok(bench.cpu.dump().record_count() as f64 / bench.gather(&[sphere(0)])?)
}

/// Limits of a device.
struct GatherPeaks {
    /// Bytes a second that it moves, read by a kernel of ours or copied by its driver: which of them is faster differs between
    /// devices.
    read: f64,
    multiply_adds: f64,
    /// Bytes a second from the CPU.
    upload: f64,
}

impl GatherPeaks {
    fn new(gpu: &Gpu) -> Result<Self, GatherError> {
        Ok(Self {
            read: peak::read(gpu)?.max(peak::copy(gpu)?),
            multiply_adds: peak::multiply_adds(gpu)?,
            upload: peak::transfers(gpu)?[0],
        })
    }

    /// Segments a second of which so many bytes are read and so many lights are tested.
    fn segments(&self, bytes: f64, lights: f64) -> [Limit; 2] {
        [Limit::bytes(self.read / bytes), Limit::operations(self.multiply_adds / (LIGHT_TEST * lights))]
    }
}

fn scaled(limit: Limit, factor: f64) -> Limit {
    Limit { value: limit.value * factor, ..limit }
}

/// Lights of a pixel of which targets are measured.
const LIGHTS: usize = 4;
/// A light of a tenth of the room.
const SMALL: LightShape = LightShape::Sphere { center: Vec3::new(1.0, -2.0, 0.5), radius: 0.4 };
#[cfg(test)]
const ONE_LIGHT: &str = "gather of 1 sphere light";
const ONE_LIGHT_READS: &str = "positions read for 1 sphere light";
const SMALL_LIGHT: &str = "gather of a light of a tenth of the room, sorted";

/// Names of the times of [`measure_paper`] of all of [`PAPER`].
#[cfg(test)]
pub fn paper_names() -> [String; 2] {
    [ONE_LIGHT, SMALL_LIGHT].map(|what| paper_name(what, PAPER))
}

fn paper_name(what: &str, (width, height, samples): (usize, usize, usize)) -> String {
    format!("{what}, {width} x {height} at {samples} samples")
}

/// Largest number of samples, halved until the dump fits, sorted and not.
fn fitting_samples(gpu: &Gpu, (width, height, most): (usize, usize, usize)) -> usize {
    let halves = std::iter::successors(Some(most), |samples| Some(samples / 2));
    let fits = |samples: &usize| {
        let records = (width * height * samples * PAPER_SEGMENTS) as u64;
        records * (RECORD_BYTES + SORTED_BYTES) <= gpu.free_memory() / 10 * 9
            && available_memory().is_none_or(|bytes| CPU_FACTOR * records * RECORD_BYTES <= bytes)
    };
    halves.take_while(|samples| *samples > 1).find(fits).unwrap_or(1)
}

/// Bytes of the CPU's memory that nobody uses, where the system says.
fn available_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kibibytes| kibibytes << 10)
}

fn figure(what: &str, value: f64, unit: &'static str) -> Figure {
    Figure::new(format!("{what}, on the GPU"), value, unit)
}

/// Seconds of a call that submits work.
fn seconds(gpu: &Gpu, mut call: impl FnMut() -> Result<(), GatherError>) -> Result<f64, GatherError> {
    // Calls that are submitted before they are waited for.
    let calls = if gpu.summary().software { 1 } else { 20 };
    call()?;
    gpu.wait()?;
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let start = Instant::now();
        for _ in 0..calls {
            call()?;
        }
        gpu.wait()?;
        best = best.min(start.elapsed().as_secs_f64() / calls as f64);
    }
    Ok(best)
}

struct Bench<'a> {
    gpu: &'a Arc<Gpu>,
    cpu: Gather,
    on_gpu: GpuGather,
}

impl<'a> Bench<'a> {
    fn new(gpu: &'a Arc<Gpu>, cpu: Gather) -> Result<Self, GatherError> {
        let on_gpu = GpuGather::new(Arc::clone(gpu), &cpu)?;
        Ok(Self { gpu, cpu, on_gpu })
    }

    fn prepare(&self, shapes: &[LightShape]) -> Result<Vec<PreparedLight>, GatherError> {
        shapes.iter().map(|&shape| self.cpu.prepare(&light(shape))).collect()
    }

    /// Segments a second, times the lights.
    fn gather(&self, shapes: &[LightShape]) -> Result<f64, GatherError> {
        let lights = self.prepare(shapes)?;
        let seconds = seconds(self.gpu, || self.on_gpu.gpu_images(&lights, SampleSplit::All).map(drop))?;
        Ok(self.cpu.dump().record_count() as f64 * lights.len() as f64 / seconds)
    }

    /// Targets from the dump on the device, and from one that is streamed.
    fn all_targets(&self, shapes: &[LightShape], peaks: &GatherPeaks) -> Result<[Figure; 2], GatherError> {
        let manifest = self.cpu.dump().manifest();
        let records = self.cpu.dump().record_count() as f64 / (manifest.width * manifest.height) as f64;
        // The lights of a pixel share its records.
        let shared = POSITION_BYTES / LIGHTS as f64;
        let read = peaks.segments(shared, 1.0).map(|limit| scaled(limit, 1.0 / records));
        let copied = Limit::copies(peaks.upload * LIGHTS as f64 / (records * RECORD_BYTES as f64));
        // Nothing stays on a device without memory.
        self.gpu.set_memory_budget(Some(0));
        let streaming = GpuGather::new(Arc::clone(self.gpu), &self.cpu);
        self.gpu.set_memory_budget(None);
        let streaming = streaming?;
        let figure = |of: &str, on_gpu, limits: &[Limit]| {
            let name = format!("pixel targets{of}, {LIGHTS} lights a pixel");
            Ok::<_, GatherError>(figure(&name, self.targets(on_gpu, shapes)?, "targets/s").within(limits))
        };
        Ok([
            figure("", &self.on_gpu, &read)?,
            figure(" of a streamed dump", &streaming, &[read[0], read[1], copied])?,
        ])
    }

    /// Targets a second of random pixels with lights of their own.
    fn targets(&self, on_gpu: &GpuGather, shapes: &[LightShape]) -> Result<f64, GatherError> {
        let manifest = self.cpu.dump().manifest();
        let all = (manifest.width * manifest.height) as u32;
        let count = if self.gpu.summary().software { 64 } else { 8192 };
        // Every pixel in an order without pattern.
        let pixels: Vec<u32> = (0..count).map(|index: u32| index.wrapping_mul(0x9e37_79b1) % all).collect();
        let repeated: Vec<_> = shapes.iter().copied().cycle().take(pixels.len() * LIGHTS).collect();
        let lights = on_gpu.lights(&self.prepare(&repeated)?)?;
        let out = self.gpu.zeros("targets", pixels.len() * LIGHTS * 3)?;
        let seconds = seconds(self.gpu, || {
            on_gpu.pixel_targets(&pixels, &lights, LIGHTS as u32, SampleSplit::All, &out)
        })?;
        Ok((pixels.len() * LIGHTS) as f64 / seconds)
    }

    /// The world, with a map that fits into a cache; `read` is the limit in bytes a second.
    fn world(&self, read: f64) -> Result<Figure, GatherError> {
        const SIZE: (usize, usize) = (512, 256);
        let texels = Texels::Float(vec![0.5; SIZE.0 * SIZE.1 * 4]);
        let (encoding, alpha) = (ColorEncoding::Linear, Alpha::default());
        let map = Texture { name: "bench".into(), width: SIZE.0, height: SIZE.1, texels, encoding, alpha };
        let world = World { color: [1.0; 3], texture: Some(0), ..World::default() };
        let environment = Environment::new(&world, &[map])?;
        let manifest = self.cpu.dump().manifest();
        let on_gpu = GpuWorld::new(self.gpu, manifest, &environment, SIZE.1)?;
        on_gpu.write(self.gpu, &environment, 0..SIZE.1);
        let image = self.gpu.zeros("image", manifest.width * manifest.height * 3)?;
        let seconds = seconds(self.gpu, || self.on_gpu.add_world(&on_gpu, SampleSplit::All, &image))?;
        let records = self.cpu.dump().record_count() as f64;
        let escaped =
            |words: &[u32]| words.iter().filter(|word| Flags((*word >> 16) as u16).escaped()).count();
        let escapes: usize = self.cpu.dump().shards().map(|shard| escaped(shard.position_z_flags())).sum();
        // Flags of all records; direction and throughput of those that escape.
        let bytes = 4.0 * records + 8.0 * escapes as f64;
        let rate = figure("gather of a world with a map", records / seconds * 1e-9, "G segments/s");
        Ok(rate.within(&[Limit::bytes(read * records / bytes * 1e-9)]))
    }

    /// Cells as a solver asks for them: all cells of one light with all derivatives, from barely to widely smoothed.
    fn smoothed(&self, read: f64) -> Result<Vec<Figure>, GatherError> {
        let soft = SoftGather::new(&self.cpu, 8);
        let cells: Vec<u32> = (0..(soft.cells().0 * soft.cells().1) as u32).collect();
        let light = light(sphere(0));
        let measure = |softness: f32| {
            let linearise = || self.on_gpu.linearise(&soft, &light, softness, &cells).map(drop);
            let segments = self.cpu.dump().record_count() as f64 / seconds(self.gpu, linearise)?;
            let name = format!("derivatives of 1 sphere light at softness {softness}");
            let limit = Limit::bytes(read / POSITION_BYTES * 1e-9);
            Ok(figure(&name, segments * 1e-9, "G segments/s").within(&[limit]))
        };
        [0.01, 0.1].into_iter().map(measure).collect()
    }

    /// A light of a tenth of the room from sorted segments; `read` is the limit in bytes a second.
    fn sorted(&self, read: f64) -> Result<Vec<Figure>, GatherError> {
        let start = Instant::now();
        if !self.on_gpu.sort()? {
            return Ok(Vec::new());
        }
        let records = self.cpu.dump().record_count() as f64;
        let sort = records / start.elapsed().as_secs_f64();
        let bytes = self.on_gpu.sorted_bytes(&self.prepare(&[SMALL])?[0]).unwrap_or(POSITION_BYTES);
        let gather = self.gather(&[SMALL])?;
        let rate = figure(SMALL_LIGHT, gather * 1e-9, "G segments/s");
        Ok(vec![
            figure("sorting of segments by the CPU", sort * 1e-6, "M segments/s"),
            figure("bytes read of a sorted segment for a light of a tenth of the room", bytes, "B"),
            rate.within(&[Limit::bytes(read / bytes * 1e-9)]),
        ])
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    pub fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    #[test]
    fn all_figures_are_measured_on_any_device() {
        let figures = measure(&gpu(), 1).unwrap();
        assert_eq!(figures.len(), 13);
        for figure in figures {
            println!("{figure:?}");
            assert!(figure.value.is_finite() && figure.value > 0.0, "{figure:?}");
        }
    }

    #[test]
    fn samples_of_the_paper_are_halved_until_they_fit() {
        let gpu = gpu();
        let records = (PAPER.0 * PAPER.1 * PAPER_SEGMENTS) as u64;
        for (budget, samples) in [(0, 1), (33 * 8 * records / 9 * 10 + 10, 8), (33 * 15 * records, 8)] {
            gpu.set_memory_budget(Some(budget));
            assert_eq!(fitting_samples(&gpu, (PAPER.0, PAPER.1, 16)), samples, "{budget}");
        }
        gpu.set_memory_budget(None);
        assert_eq!(fitting_samples(&gpu, (PAPER.0, PAPER.1, 2)), 2);
    }
}
