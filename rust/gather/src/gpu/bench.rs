//! Speed of the gather on a GPU against what that GPU can read, measured in the same process just before.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use relume_dump::Flags;
use relume_gpu::Gpu;
use relume_scene::{Alpha, ColorEncoding, LightShape, Texels, Texture, World};

use super::world::GpuWorld;
use crate::bench::{Measurement, light, room, sphere};
use crate::{Environment, Gather, GatherError, GpuGather, Half, PreparedLight, SoftGather};

/// Rounds, of which the best counts.
const ROUNDS: usize = 3;
/// Bytes that are read of a segment that the light is far from, in the order of paths.
const POSITION_BYTES: f64 = 8.0;

/// Measures the device, and gathers on it from a made-up room. `megabytes` is the size of the positions; 1024 is well beyond
/// the caches of a graphics card.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure(gpu: &Arc<Gpu>, megabytes: usize) -> Result<Vec<Measurement>, GatherError> {
    let bench = Bench::new(gpu, megabytes)?;
    let read = bench.read()?;
    let mut measurements = vec![figure("plain read", read * 1e-9, "GB/s")];
    measurements.push(figure("plain copy, bytes read and written", bench.copy()? * 1e-9, "GB/s"));
    let spheres: Vec<_> = (0..16).map(sphere).collect();
    for count in [1, 16] {
        let segments = bench.gather(&spheres[..count])?;
        measurements.push(Measurement {
            // Many lights share one pass over the bytes: no limit by reading.
            limit: (count == 1).then_some(read / POSITION_BYTES * 1e-9),
            ..figure(&format!("gather of {count} sphere lights"), segments * 1e-9, "G segments/s")
        });
    }
    measurements.push(figure("pixel targets, 4 lights a pixel", bench.targets(&spheres)?, "targets/s"));
    measurements.push(bench.world(read)?);
    measurements.extend(bench.smoothed(read)?);
    measurements.extend(bench.sorted(read)?);
    Ok(measurements)
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
    fn new(gpu: &'a Arc<Gpu>, megabytes: usize) -> Result<Self, GatherError> {
        let cpu = Gather::new(room(megabytes)?);
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

    /// Words of a buffer to measure the device with.
    fn words(&self) -> usize {
        let positions = self.cpu.dump().record_count() * 2;
        positions.min(self.gpu.limits().buffer as usize / 4) & !3
    }

    /// Bytes a second.
    fn read(&self) -> Result<f64, GatherError> {
        let words = self.gpu.zeros::<u32>("words", self.words())?;
        let sums = self.gpu.zeros::<u32>("sums", 1)?;
        let bound = self.gpu.kernel("gather/read", "read_all", &[])?.bind(&[words.whole(), sums.whole()])?;
        let groups = (self.words() / 4 / 256 / 16).clamp(1, 16_384) as u32;
        let seconds = self.seconds(|| {
            let mut commands = self.gpu.commands("read");
            commands.run(&bound, groups, &[]);
            Ok(commands.submit()?)
        })?;
        Ok(self.words() as f64 * 4.0 / seconds)
    }

    /// Bytes a second, those read and those written.
    fn copy(&self) -> Result<f64, GatherError> {
        let half = self.words() / 2;
        let make = |what| self.gpu.zeros::<u32>(what, half);
        let (from, to) = (make("source")?, make("destination")?);
        let seconds = self.seconds(|| {
            let mut commands = self.gpu.commands("copy");
            commands.copy(&from, &to);
            Ok(commands.submit()?)
        })?;
        Ok(2.0 * half as f64 * 4.0 / seconds)
    }

    fn prepare(&self, shapes: &[LightShape]) -> Result<Vec<PreparedLight>, GatherError> {
        shapes.iter().map(|&shape| self.cpu.prepare(&light(shape))).collect()
    }

    /// Segments a second, times the lights.
    fn gather(&self, shapes: &[LightShape]) -> Result<f64, GatherError> {
        let lights = self.prepare(shapes)?;
        let seconds = self.seconds(|| self.on_gpu.unit_buffers(&lights, Half::All).map(drop))?;
        Ok(self.cpu.dump().record_count() as f64 * lights.len() as f64 / seconds)
    }

    /// Targets a second of random pixels with lights of their own.
    fn targets(&self, shapes: &[LightShape]) -> Result<f64, GatherError> {
        const LIGHTS: usize = 4;
        let manifest = self.cpu.dump().manifest();
        let all = (manifest.width * manifest.height) as u32;
        let count = if self.gpu.summary().software { 64 } else { 8192 };
        // Every pixel in an order without pattern.
        let pixels: Vec<u32> = (0..count).map(|index: u32| index.wrapping_mul(0x9e37_79b1) % all).collect();
        let repeated: Vec<_> = shapes.iter().copied().cycle().take(pixels.len() * LIGHTS).collect();
        let lights = self.on_gpu.lights(&self.prepare(&repeated)?)?;
        let places = self.gpu.buffer_of("pixels", &pixels)?;
        let out = self.gpu.zeros("targets", pixels.len() * LIGHTS * 3)?;
        let seconds =
            self.seconds(|| self.on_gpu.pixel_targets(&places, &lights, LIGHTS as u32, Half::All, &out))?;
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
        let shape = LightShape::Sphere { center: Vec3::new(1.0, -2.0, 0.5), radius: 0.4 };
        let bytes = self.on_gpu.sorted_bytes(&self.prepare(&[shape])?[0]).unwrap_or(POSITION_BYTES);
        let gather = self.gather(&[shape])?;
        let mut figures = vec![
            figure("sorting of segments by the CPU", sort * 1e-6, "M segments/s"),
            figure("bytes read of a sorted segment for a light of a tenth of the room", bytes, "B"),
            figure("gather of a light of a tenth of the room, sorted", gather * 1e-9, "G segments/s"),
        ];
        figures[2].limit = Some(read / bytes * 1e-9);
        Ok(figures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    #[test]
    fn all_figures_are_measured_on_any_device() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let figures = measure(&gpu, 1).unwrap();
        assert_eq!(figures.len(), 11);
        for figure in figures {
            println!("{figure:?}");
            assert!(figure.value.is_finite() && figure.value > 0.0, "{figure:?}");
        }
    }
}
