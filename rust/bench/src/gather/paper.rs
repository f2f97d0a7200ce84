//! Segments as the paper stores them, for comparing layouts: `rust/bench/shaders/paper.wgsl` tells how they lie. The paths are made
//! up: what a gather costs hardly depends on them.

use bytemuck::NoUninit;
use relume_gather::GpuLights;
use relume_gpu::{Buffer, Gpu, GpuError, Kernel};

use crate::shaders;

/// Threads of a workgroup (`shaders/gather/records.wgsl`).
const GROUP_SIZE: u32 = 64;
/// Largest buffer of a chunk, as of the dumps here.
const BUFFER_BYTES: u64 = 1 << 30;

/// Vertices of a path, and 32-bit words of each.
const VERTICES: usize = 7;
const WORDS: usize = 3;
const PATH_WORDS: usize = VERTICES * WORDS;
const SEGMENTS: usize = VERTICES - 1;
/// Bytes that are read for a segment.
pub const SEGMENT_BYTES: f64 = (4 * PATH_WORDS) as f64 / SEGMENTS as f64;
/// Paths that are made up; all others are copies of them.
const PATHS: usize = 200_000;

/// Arguments of `paper.wgsl`.
#[derive(Clone, Copy, NoUninit)]
#[repr(C)]
struct PaperArguments {
    pixels: u32,
    vertices: u32,
    lights: u32,
}

/// A picture's paths on the device.
pub struct PaperDump {
    chunks: Vec<PathChunk>,
    paths_per_pixel: usize,
}

/// The paths of some pixels, which fit a buffer.
struct PathChunk {
    vertices: Buffer<u32>,
    pixels: usize,
}

impl PaperDump {
    /// Makes a dump of at least so many segments, in paths of six, of so many pixels at most.
    pub fn new(gpu: &Gpu, segments: usize, pixels: usize) -> Result<Self, GpuError> {
        Self::in_buffers(gpu, segments, pixels, gpu.limits().buffer.min(BUFFER_BYTES))
    }

    /// [`PaperDump::new`] in buffers of at most so many bytes, or of a single pixel that has more.
    fn in_buffers(gpu: &Gpu, segments: usize, pixels: usize, bytes: u64) -> Result<Self, GpuError> {
        let paths = segments.div_ceil(SEGMENTS);
        let paths_per_pixel = paths.div_ceil(pixels);
        let pixel_words = paths_per_pixel * PATH_WORDS;
        let most = (bytes as usize / 4 / pixel_words).max(1);
        let made_up: Vec<u32> = (0..PATHS * PATH_WORDS).map(word).collect();
        let pattern = gpu.buffer_of("paths of the paper", &made_up)?;
        let all = paths.div_ceil(paths_per_pixel);
        let chunk = |first: usize| {
            let pixels = most.min(all - first);
            Ok(PathChunk { vertices: copies(gpu, &pattern, pixels * pixel_words)?, pixels })
        };
        let chunks = (0..all).step_by(most).map(chunk).collect::<Result<_, GpuError>>()?;
        Ok(Self { chunks, paths_per_pixel })
    }

    pub fn segments(&self) -> usize {
        self.chunks.iter().map(|chunk| chunk.pixels * self.paths_per_pixel * SEGMENTS).sum()
    }

    /// Threads of a pixel, as in the gather: each should have two loads of four.
    fn lanes(&self) -> u32 {
        ((self.paths_per_pixel * VERTICES) as u32 / 8).next_power_of_two().clamp(8, GROUP_SIZE)
    }

    /// The kernel for so many lights.
    pub fn kernel(&self, gpu: &Gpu, lights: usize) -> Result<Kernel, GpuError> {
        let constants = [("LIGHTS", lights as u32), ("LANES", self.lanes())];
        shaders::kernel(gpu, "paper", "add_paths", &constants)
    }

    /// Gathers all lights in one pass, with the kernel for as many. Images of the chunks, each light by light; does not wait for
    /// them.
    pub fn gather(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        lights: &GpuLights,
    ) -> Result<Vec<Buffer<f32>>, GpuError> {
        let (count, lanes) = (lights.lights.len(), self.lanes());
        let add = |chunk: &PathChunk| {
            let images = gpu.zeros("images", 3 * count * chunk.pixels)?;
            let (of_lights, receivers) = (lights.lights.whole(), lights.receivers.whole());
            let bound = kernel.bind(&[of_lights, receivers, chunk.vertices.whole(), images.whole()])?;
            let (pixels, vertices) = (chunk.pixels as u32, (self.paths_per_pixel * VERTICES) as u32);
            let arguments = PaperArguments { pixels, vertices, lights: count as u32 };
            let mut commands = gpu.commands("gather as in the paper");
            commands.run(&bound, pixels.div_ceil(GROUP_SIZE / lanes), bytemuck::bytes_of(&arguments));
            commands.submit()?;
            Ok(images)
        };
        self.chunks.iter().map(add).collect()
    }
}

/// A buffer of so many words, filled with copies of a pattern.
fn copies(gpu: &Gpu, pattern: &Buffer<u32>, words: usize) -> Result<Buffer<u32>, GpuError> {
    let buffer = gpu.zeros("vertices of paths", words)?;
    let mut commands = gpu.commands("copies");
    for start in (0..words).step_by(pattern.len()) {
        commands.copy_part(pattern, 0..pattern.len().min(words - start), &buffer, start);
    }
    commands.submit()?;
    Ok(buffer)
}

/// A word of the made-up paths: coordinates from 1 to 4 m, of either sign, and throughputs up to 1.
fn word(index: usize) -> u32 {
    let random = (index as u32 + 1).wrapping_mul(0x9e37_79b1);
    let random = (random ^ random >> 15).wrapping_mul(0x85eb_ca6b);
    let random = random ^ random >> 13;
    match index % WORDS {
        // Signs, and what is added to the bits of 1: all up to those of 4.
        0 | 1 => (random & 0x87ff_87ff) + 0x3c00_3c00,
        // Mantissas below an exponent of 0: 2^(15 - 24 + 9) is 1.
        _ => random & 0x07ff_ffff | 15 << 27,
    }
}

#[cfg(test)]
mod tests {
    use super::super::on_gpu::tests::gpu;
    use super::super::room::{light, room};
    use super::*;
    use crate::shaders::tests::arguments;
    use glam::DVec3;
    use relume_gather::{Gather, GpuGather};
    use relume_scene::LightShape;
    use std::mem::offset_of;
    use std::sync::Arc;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twin() {
        let fields = [
            ("pixels".into(), offset_of!(PaperArguments, pixels) as u32),
            ("vertices".into(), offset_of!(PaperArguments, vertices) as u32),
            ("lights".into(), offset_of!(PaperArguments, lights) as u32),
        ];
        assert_eq!(arguments("paper"), (size_of::<PaperArguments>() as u32, fields.into()));
        assert_eq!(shaders::tests::constant("paper", "VERTICES") as usize, VERTICES);
        assert_eq!(shaders::tests::constant("paper", "WORDS") as usize, WORDS);
        assert_eq!(shaders::tests::constant("paper", "GROUP_SIZE"), GROUP_SIZE);
    }

    /// Spheres between the made-up vertices.
    const SPHERES: [(glam::Vec3, f32); 3] = [
        (glam::Vec3::ZERO, 0.5),
        (glam::Vec3::new(0.2, -0.1, 0.3), 0.3),
        (glam::Vec3::new(0.0, 0.5, -0.4), 0.2),
    ];

    /// A normal 16-bit float.
    fn half(bits: u32) -> f64 {
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * 2.0_f32.powi(112);
        f64::from(if bits & 0x8000 == 0 { magnitude } else { -magnitude })
    }

    fn vertex(index: usize) -> DVec3 {
        let [xy, z] = [0, 1].map(|at| word(WORDS * index + at));
        DVec3::new(half(xy & 0xffff), half(xy >> 16), half(z & 0xffff))
    }

    /// Throughput of the segments from a vertex on that a sphere is crossed by; ends lie outside of it.
    fn crossed(first: usize, (center, radius): (glam::Vec3, f32)) -> f64 {
        let (start, end) = (vertex(first), vertex(first + 1));
        let (edge, to_center) = (end - start, center.as_dvec3() - start);
        let share = (to_center.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let is_crossed = (to_center - edge * share).length() < f64::from(radius);
        let red = f64::from(word(WORDS * first + 2) & 511) * f64::from(2.0_f32.powi(15 - 24));
        if is_crossed { red } else { 0.0 }
    }

    #[test]
    fn paths_of_the_paper_are_gathered_as_sums_of_64_bits_are() {
        let gpu = gpu();
        let gather = Gather::new(room(1).unwrap());
        let shape = |(center, radius)| LightShape::Sphere { center, radius };
        let prepared = SPHERES.map(|sphere| gather.prepare(&light(shape(sphere))).unwrap());
        let lights = GpuGather::new(Arc::clone(&gpu), &gather).unwrap().lights(&prepared).unwrap();
        for (segments, pixels) in [(6 * 200, 50), (6 * 90, 90)] {
            let dump = PaperDump::new(&gpu, segments, pixels).unwrap();
            assert_eq!((dump.segments(), dump.chunks.len()), (segments, 1));
            let kernel = dump.kernel(&gpu, SPHERES.len()).unwrap();
            let images = &dump.gather(&gpu, &kernel, &lights).unwrap()[0];
            let found = gpu.read(images, 0..images.len()).unwrap();
            let per_pixel = segments / SEGMENTS * VERTICES / pixels;
            for (light, sphere) in SPHERES.into_iter().enumerate() {
                for pixel in 0..pixels {
                    let vertices = pixel * per_pixel..(pixel + 1) * per_pixel;
                    let starts = vertices.filter(|vertex| vertex % VERTICES != VERTICES - 1);
                    let expected: f64 = starts.map(|first| crossed(first, sphere)).sum();
                    let found = f64::from(found[3 * (light * pixels + pixel)]);
                    assert!((found - expected).abs() <= 1e-5 * expected, "{pixel}: {found}, {expected}");
                }
            }
            assert!(found.iter().any(|value| *value > 0.0));
        }
    }

    #[test]
    fn paths_beyond_a_buffer_are_cut_at_pixels() {
        let gpu = gpu();
        let dump = PaperDump::in_buffers(&gpu, SEGMENTS * 100, 25, 2000).unwrap();
        // Four paths of 84 bytes each.
        assert_eq!(dump.chunks.iter().map(|chunk| chunk.pixels).collect::<Vec<_>>(), [5; 5]);
        assert_eq!(dump.segments(), SEGMENTS * 100);
    }
}
