//! Speed of the gather on a GPU against what that GPU can read, measured in the same process just before.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use relume_dump::Flags;
use relume_gpu::Gpu;
use relume_scene::{Alpha, ColorEncoding, LightShape, Texels, Texture, World};

use super::chunk::{MOST_PENDING, RECORD_BYTES};
use super::world::GpuWorld;
use crate::bench::{Measurement, Room, light, room, sphere};
use crate::{Environment, Gather, GatherError, GpuGather, Half, PreparedLight, SoftGather};

/// Rounds, of which the best counts.
const ROUNDS: usize = 3;
/// Bytes that are read of a segment that the light is far from, in the order of paths.
const POSITION_BYTES: f64 = 8.0;

/// Width and height of the paper's picture, and its samples (table 1).
pub const PAPER: (usize, usize, usize) = (885, 500, 512);
/// Segments of a path: what measured scenes have on average, whose paths end where they leave the scene or carry next to nothing.
const PAPER_SEGMENTS: usize = 3;
/// Bytes of a record of a sorted dump, which lies beside that in the order of paths.
const SORTED_BYTES: u64 = 21;
/// How much more of the CPU's memory a dump takes while it is made than when it is there.
const CPU_FACTOR: u64 = 2;

/// Measures gathers on the device, from a made-up room. `megabytes` is the size of the positions; 1024 is well beyond
/// the caches of a graphics card.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure(gpu: &Arc<Gpu>, megabytes: usize) -> Result<Vec<Measurement>, GatherError> {
    let bench = Bench::new(gpu, Gather::new(room(megabytes)?))?;
    let read = fastest_read(gpu)?;
    let mut measurements = Vec::new();
    let spheres: Vec<_> = (0..32).map(sphere).collect();
    for count in [1, 8, 16, 32] {
        let segments = bench.gather(&spheres[..count])?;
        measurements.push(Measurement {
            // Many lights share one pass over the bytes: no limit by reading.
            limit: (count == 1).then_some(read / POSITION_BYTES * 1e-9),
            ..figure(&format!("gather of {count} sphere lights"), segments * 1e-9, "G segments/s")
        });
        if count == 1 {
            measurements.push(Measurement {
                limit: Some(read * 1e-9),
                ..figure(ONE_LIGHT_READS, segments * POSITION_BYTES * 1e-9, "GB/s")
            });
        }
    }
    let streaming = GpuGather::streaming(Arc::clone(gpu), &bench.cpu, MOST_PENDING);
    for (of, on_gpu) in [("", &bench.on_gpu), (" of a streamed dump", &streaming)] {
        let name = format!("pixel targets{of}, 4 lights a pixel");
        measurements.push(figure(&name, bench.targets(on_gpu, &spheres[..16])?, "targets/s"));
    }
    measurements.push(bench.world(read)?);
    measurements.extend(bench.smoothed(read)?);
    measurements.extend(bench.sorted(read)?);
    Ok(measurements)
}

/// Measures gathers of one light at a size like the paper's ([`PAPER`]), with as many of its samples as fit the memory of device
/// and CPU. The names say how many. The last figure is that of a light of a tenth of the scene; it is missing if there is no
/// room to sort the segments.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure_paper(
    gpu: &Arc<Gpu>,
    (width, height, most): (usize, usize, usize),
) -> Result<Vec<Measurement>, GatherError> {
    let samples = fitting_samples(gpu, (width, height, most));
    let size = (width, height, samples);
    let segments = PAPER_SEGMENTS;
    let cpu = Gather::new(Room { width, height, tile: 32, samples, segments }.dump()?);
    let bench = Bench::new(gpu, cpu)?;
    let (records, read) = (bench.cpu.dump().record_count() as f64, fastest_read(gpu)?);
    let time = |what: &str, bytes: f64, rate: f64| Measurement {
        name: paper_name(what, size),
        value: 1e3 * records / rate,
        unit: "ms",
        limit: Some(1e3 * records * bytes / read),
    };
    let rate = bench.gather(&[sphere(0)])?;
    let mut figures = vec![
        time(ONE_LIGHT, POSITION_BYTES, rate),
        Measurement {
            name: paper_name(ONE_LIGHT_READS, size),
            value: rate * POSITION_BYTES * 1e-9,
            unit: "GB/s",
            limit: Some(read * 1e-9),
        },
    ];
    if bench.on_gpu.sort()? {
        let bytes = bench.on_gpu.sorted_bytes(&bench.prepare(&[SMALL])?[0]).unwrap_or(POSITION_BYTES);
        figures.push(time(SMALL_LIGHT, bytes, bench.gather(&[SMALL])?));
    }
    Ok(figures)
}

/// A light of a tenth of the room.
const SMALL: LightShape = LightShape::Sphere { center: Vec3::new(1.0, -2.0, 0.5), radius: 0.4 };
const ONE_LIGHT: &str = "gather of 1 sphere light";
const ONE_LIGHT_READS: &str = "positions read for 1 sphere light";
const SMALL_LIGHT: &str = "gather of a light of a tenth of the room, sorted";

/// Names of the times of [`measure_paper`] of all of [`PAPER`].
pub fn paper_names() -> [String; 2] {
    [ONE_LIGHT, SMALL_LIGHT].map(|what| paper_name(what, PAPER))
}

fn paper_name(what: &str, (width, height, samples): (usize, usize, usize)) -> String {
    format!("{what}, {width} x {height} at {samples} samples")
}

/// At most so many samples, halved until the dump fits, sorted and not.
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

/// Bytes per second that the device moves at best, read by a kernel of ours or copied by its driver: which of them is faster
/// differs between devices.
fn fastest_read(gpu: &Gpu) -> Result<f64, GatherError> {
    Ok(gpu.peak_read()?.max(gpu.peak_copy()?))
}

fn figure(what: &str, value: f64, unit: &'static str) -> Measurement {
    Measurement { name: format!("{what}, on the GPU"), value, unit, limit: None }
}

struct Bench<'a> {
    gpu: &'a Arc<Gpu>,
    cpu: Gather,
    on_gpu: GpuGather,
    /// Calls that are submitted before they are waited for.
    calls: usize,
}

impl<'a> Bench<'a> {
    fn new(gpu: &'a Arc<Gpu>, cpu: Gather) -> Result<Self, GatherError> {
        let on_gpu = GpuGather::new(Arc::clone(gpu), &cpu)?;
        let calls = if gpu.summary().software { 1 } else { 20 };
        Ok(Self { gpu, cpu, on_gpu, calls })
    }

    /// Seconds of a call.
    fn seconds(&self, mut call: impl FnMut() -> Result<(), GatherError>) -> Result<f64, GatherError> {
        call()?;
        self.gpu.wait()?;
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let start = Instant::now();
            for _ in 0..self.calls {
                call()?;
            }
            self.gpu.wait()?;
            best = best.min(start.elapsed().as_secs_f64() / self.calls as f64);
        }
        Ok(best)
    }

    fn prepare(&self, shapes: &[LightShape]) -> Result<Vec<PreparedLight>, GatherError> {
        shapes.iter().map(|&shape| self.cpu.prepare(&light(shape))).collect()
    }

    /// Segments a second, times the lights.
    fn gather(&self, shapes: &[LightShape]) -> Result<f64, GatherError> {
        let lights = self.prepare(shapes)?;
        let seconds = self.seconds(|| self.on_gpu.gpu_images(&lights, Half::All).map(drop))?;
        Ok(self.cpu.dump().record_count() as f64 * lights.len() as f64 / seconds)
    }

    /// Targets a second of random pixels with lights of their own.
    fn targets(&self, on_gpu: &GpuGather, shapes: &[LightShape]) -> Result<f64, GatherError> {
        const LIGHTS: usize = 4;
        let manifest = self.cpu.dump().manifest();
        let all = (manifest.width * manifest.height) as u32;
        let count = if self.gpu.summary().software { 64 } else { 8192 };
        // Every pixel in an order without pattern.
        let pixels: Vec<u32> = (0..count).map(|index: u32| index.wrapping_mul(0x9e37_79b1) % all).collect();
        let repeated: Vec<_> = shapes.iter().copied().cycle().take(pixels.len() * LIGHTS).collect();
        let lights = on_gpu.lights(&self.prepare(&repeated)?)?;
        let out = self.gpu.zeros("targets", pixels.len() * LIGHTS * 3)?;
        let seconds =
            self.seconds(|| on_gpu.pixel_targets(&pixels, &lights, LIGHTS as u32, Half::All, &out))?;
        Ok((pixels.len() * LIGHTS) as f64 / seconds)
    }

    /// The world, with a map that fits into a cache; `read` is the limit in bytes a second.
    fn world(&self, read: f64) -> Result<Measurement, GatherError> {
        const SIZE: (usize, usize) = (512, 256);
        let texels = Texels::Float(vec![0.5; SIZE.0 * SIZE.1 * 4]);
        let (encoding, alpha) = (ColorEncoding::Linear, Alpha::default());
        let map = Texture { name: "bench".into(), width: SIZE.0, height: SIZE.1, texels, encoding, alpha };
        let world = World { color: [1.0; 3], texture: Some(0), ..World::default() };
        let environment = Environment::new(&world, &[map])?;
        let on_gpu = GpuWorld::new(self.gpu, &environment, SIZE.1)?;
        on_gpu.write(self.gpu, &environment, 0..SIZE.1);
        let manifest = self.cpu.dump().manifest();
        let image = self.gpu.zeros("image", manifest.width * manifest.height * 3)?;
        let seconds = self.seconds(|| self.on_gpu.add_world(&on_gpu, Half::All, &image))?;
        let records = self.cpu.dump().record_count() as f64;
        let escaped =
            |words: &[u32]| words.iter().filter(|word| Flags((*word >> 16) as u16).escaped()).count();
        let escapes: usize = self.cpu.dump().shards().map(|shard| escaped(shard.position_z_flags())).sum();
        // Flags of all records; direction and throughput of those that escape.
        let bytes = 4.0 * records + 8.0 * escapes as f64;
        Ok(Measurement {
            limit: Some(read * records / bytes * 1e-9),
            ..figure("gather of a world with a map", records / seconds * 1e-9, "G segments/s")
        })
    }

    /// What solving lights asks for: all cells of one light with all derivatives, from barely to widely smoothed.
    fn smoothed(&self, read: f64) -> Result<Vec<Measurement>, GatherError> {
        let soft = SoftGather::new(&self.cpu, 8);
        let cells: Vec<u32> = (0..(soft.cells().0 * soft.cells().1) as u32).collect();
        let light = light(sphere(0));
        let measure = |softness: f32| {
            let linearise = || self.on_gpu.linearise(&soft, &light, softness, &cells).map(drop);
            let segments = self.cpu.dump().record_count() as f64 / self.seconds(linearise)?;
            Ok(Measurement {
                limit: Some(read / POSITION_BYTES * 1e-9),
                ..figure(
                    &format!("derivatives of 1 sphere light at softness {softness}"),
                    segments * 1e-9,
                    "G segments/s",
                )
            })
        };
        [0.01, 0.1].into_iter().map(measure).collect()
    }

    /// A light of a tenth of the room from sorted segments; `read` is the limit in bytes a second.
    fn sorted(&self, read: f64) -> Result<Vec<Measurement>, GatherError> {
        let start = Instant::now();
        if !self.on_gpu.sort()? {
            return Ok(Vec::new());
        }
        let records = self.cpu.dump().record_count() as f64;
        let sort = records / start.elapsed().as_secs_f64();
        let bytes = self.on_gpu.sorted_bytes(&self.prepare(&[SMALL])?[0]).unwrap_or(POSITION_BYTES);
        let gather = self.gather(&[SMALL])?;
        let mut figures = vec![
            figure("sorting of segments by the CPU", sort * 1e-6, "M segments/s"),
            figure("bytes read of a sorted segment for a light of a tenth of the room", bytes, "B"),
            figure(SMALL_LIGHT, gather * 1e-9, "G segments/s"),
        ];
        figures[2].limit = Some(read / bytes * 1e-9);
        Ok(figures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    fn gpu() -> Arc<Gpu> {
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
