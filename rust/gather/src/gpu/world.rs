use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_dump::Manifest;
use relume_gpu::{Buffer, Gpu, GpuError};
use relume_image::Image;

use super::GpuGather;
use super::arguments::WorldArguments;
use super::kernels::{self, GROUP_SIZE, lanes};
use crate::environment::Map;
use crate::{Environment, GatherError, SampleSplit};

/// Share of the free memory that a map may take at a time: a streamed dump needs the rest.
const MAP_SHARE: u64 = 2;

/// `Environment` of `shaders/gather/world.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct GpuEnvironment {
    texture_from_world: [[f32; 4]; 3],
    color: [f32; 3],
    lobes: u32,
    width: u32,
    height: u32,
    first_row: u32,
    end_row: u32,
    first_without_world: u32,
    padding: [u32; 3],
}

impl GpuEnvironment {
    /// Arguments with some rows of the map.
    fn new(environment: &Environment, rows: &Range<usize>, first_without_world: u16) -> Self {
        let column = |column| environment.texture_from_world.col(column).extend(0.0).to_array();
        let (width, height) = environment.map.as_deref().map_or((0, 0), |map| (map.width, map.height));
        Self {
            texture_from_world: [0, 1, 2].map(column),
            color: environment.color.into(),
            lobes: environment.lobes,
            width: width as u32,
            height: height as u32,
            first_row: rows.start as u32,
            end_row: rows.end as u32,
            first_without_world: first_without_world.into(),
            padding: [0; 3],
        }
    }
}

/// Rows of a map in strips of at most so many bytes, or of a single row that has more; one strip without rows if there is no map.
fn strips(map: Option<&Map>, bytes: u64) -> Vec<Range<usize>> {
    let Some(map) = map else { return vec![Range::default()] };
    let rows = (bytes / (map.width * size_of::<Vec3>()) as u64).clamp(1, map.height as u64) as usize;
    (0..map.height).step_by(rows).map(|first| first..map.height.min(first + rows)).collect()
}

/// A world without its parts on the device, with some rows of its map.
#[derive(Debug)]
pub struct GpuWorld {
    environment: Buffer<GpuEnvironment>,
    texels: Buffer<Vec3>,
    /// See [`Manifest::first_without_world`].
    first_without_world: u16,
}

impl GpuWorld {
    /// Room for the world of a dump and so many rows of its map.
    ///
    /// # Errors
    /// If there is none, or the device was lost.
    pub fn new(
        gpu: &Gpu,
        manifest: &Manifest,
        environment: &Environment,
        rows: usize,
    ) -> Result<Self, GpuError> {
        let width = environment.map.as_deref().map_or(0, |map| map.width);
        Ok(Self {
            environment: gpu.zeros("world", 1)?,
            texels: gpu.zeros("map of the world", rows * width)?,
            first_without_world: manifest.first_without_world(),
        })
    }

    /// Replaces what is there, once the device has done what was submitted before.
    pub fn write(&self, gpu: &Gpu, environment: &Environment, rows: Range<usize>) {
        gpu.write(&self.environment, 0, &[GpuEnvironment::new(environment, &rows, self.first_without_world)]);
        if let Some(map) = &environment.map {
            gpu.write(&self.texels, 0, &map.texels[rows.start * map.width..rows.end * map.width]);
        }
    }
}

impl GpuGather {
    /// [`crate::Gather::world_image`]. Of a map that is larger than a buffer, or than half of the free memory, some rows at a time
    /// are on the device, with a pass over the dump for each strip of them.
    ///
    /// # Errors
    /// If there is no room for the image and a row of the map, or the device was lost.
    pub fn world_image(&self, environment: &Environment, half: SampleSplit) -> Result<Image, GatherError> {
        self.world_in_strips(environment, half, self.gpu.limits().buffer)
    }

    /// [`GpuGather::world_image`] with strips of at most so many bytes.
    fn world_in_strips(
        &self,
        environment: &Environment,
        half: SampleSplit,
        strip_bytes: u64,
    ) -> Result<Image, GatherError> {
        let manifest = self.dump.manifest();
        let image = self.gpu.zeros::<f32>("image of the world", self.image_values())?;
        let bytes = strip_bytes.min(self.gpu.free_memory() / MAP_SHARE);
        for layer in environment.layers() {
            let strips = strips(layer.map.as_deref(), bytes);
            let world = GpuWorld::new(&self.gpu, manifest, layer, strips[0].len())?;
            for rows in strips {
                world.write(&self.gpu, layer, rows);
                self.add_world(&world, half, &image)?;
            }
        }
        let data = self.gpu.read(&image, 0..image.len())?;
        Ok(Image { width: manifest.width, height: manifest.height, channels: 3, data })
    }

    /// Adds what a world with the rows that are there gives to an image. Does not wait for it.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn add_world(
        &self,
        world: &GpuWorld,
        half: SampleSplit,
        image: &Buffer<f32>,
    ) -> Result<(), GatherError> {
        self.each_chunk(half, |records, table| {
            let lanes = lanes(table.part_length);
            let kernel = kernels::world(&self.gpu, lanes)?;
            let mut bindings = vec![world.environment.whole(), world.texels.whole()];
            bindings.extend(table.bindings(records));
            bindings.push(image.whole());
            let mut commands = self.gpu.commands("gather the world");
            let groups = table.pixel_count.div_ceil(GROUP_SIZE / lanes);
            let arguments = WorldArguments { pixels: table.pixel_count };
            commands.run(&kernel.bind(&bindings)?, groups, bytemuck::bytes_of(&arguments));
            Ok(commands)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Mat3;
    use relume_dump::{Dump, End, Lobe};
    use relume_gpu::GpuChoice;
    use relume_scene::{Alpha, ColorEncoding, Texels, Texture, World, WorldPart};

    use super::*;
    use crate::Gather;
    use crate::tests::kernels::{random_classes_of, random_dump_of};
    use crate::tests::{Random, dump, manifest, segment};

    const HALVES: [SampleSplit; 3] = [SampleSplit::All, SampleSplit::First, SampleSplit::Second];

    fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    /// Texels without pattern, one in ten of them bright.
    fn sky(width: usize, height: usize) -> Texture {
        let mut random = Random(7);
        let texels =
            (0..width * height * 4).map(|_| random.next() * if random.next() < 0.1 { 20.0 } else { 1.0 });
        let (texels, encoding) = (Texels::Float(texels.collect()), ColorEncoding::Linear);
        Texture { name: "Sky".into(), width, height, texels, encoding, alpha: Alpha::default() }
    }

    fn colored() -> World {
        World { color: [0.5, 1.0, 2.0], ..World::default() }
    }

    fn mapped(width: usize, height: usize) -> Environment {
        let turn = Mat3::from_rotation_x(0.3) * Mat3::from_rotation_z(1.1) * 1.5;
        let world = World { texture: Some(0), texture_from_world: turn, ..colored() };
        Environment::new(&world, &[sky(width, height)]).unwrap()
    }

    /// Largest difference, relative to the values where these are above 1: texels are up to 20, and a map is as smooth as its
    /// texels are wide.
    fn difference(found: &Image, expected: &Image) -> f32 {
        assert_eq!((found.width, found.height, found.channels), (expected.width, expected.height, 3));
        let apart = |(a, b): (&f32, &f32)| (*a - *b).abs() / b.max(1.0);
        let largest = found.data.iter().zip(&expected.data).map(apart).fold(0.0, f32::max);
        println!("{largest:e} apart");
        largest
    }

    /// Places in a map of 40 texels are off by 40 times 2e-7, a few units in the last place, and 2e-6 of their own rounding: 1e-5
    /// of a texel, which is up to 40 brighter than its neighbours. Sums in another order are off by less.
    const ROUNDING: f32 = 4e-4;

    #[test]
    fn the_world_is_that_of_the_cpu() {
        let gather = Gather::new(random_dump_of(10, &[1, 3, 4, 40]));
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        assert!(on_gpu.is_resident());
        let plain = |world: &World| Environment::new(world, &[sky(40, 20)]).unwrap();
        let hidden = World { visible_camera: false, ..colored() };
        let shown = gather.world_image(&plain(&colored()), SampleSplit::All);
        assert_ne!(shown, gather.world_image(&plain(&hidden), SampleSplit::All), "no camera ray escapes");
        let part = WorldPart {
            rays: [true, false, true, false, false],
            color: [0.5, 2.0, 1.0],
            texture: None,
            texture_from_world: Mat3::IDENTITY,
        };
        let parted = plain(&World { parts: vec![part], ..colored() });
        assert_ne!(shown, gather.world_image(&parted, SampleSplit::All));
        for environment in [plain(&colored()), plain(&hidden), parted, mapped(40, 20), mapped(1, 1)] {
            for half in HALVES {
                let expected = gather.world_image(&environment, half);
                assert!(expected.data.iter().filter(|&&value| value > 0.0).count() > 250);
                let found = on_gpu.world_image(&environment, half).unwrap();
                assert!(difference(&found, &expected) < ROUNDING);
                assert_eq!(found, on_gpu.world_image(&environment, half).unwrap());
            }
        }
    }

    #[test]
    fn segments_of_lights_without_shadow_see_no_world() {
        let gather = Gather::new(random_classes_of(10, &[40]));
        let everywhere = Gather::new(random_dump_of(10, &[40]));
        let environment = Environment::new(&colored(), &[sky(40, 20)]).unwrap();
        let expected = gather.world_image(&environment, SampleSplit::All);
        assert!(difference(&everywhere.world_image(&environment, SampleSplit::All), &expected) > 0.1);
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        let found = on_gpu.world_image(&environment, SampleSplit::All).unwrap();
        assert!(difference(&found, &expected) < ROUNDING);
    }

    /// Each pixel sees a direction of its own.
    fn directions(directions: &[Vec3; 16]) -> Dump {
        dump(manifest(4, &[1]), |pixel, _, samples| {
            samples.push(segment(End::Escape(directions[pixel]), Lobe::Camera));
        })
    }

    /// Has one colour all around each pole: which column a direction straight up or down falls into is decided by its last bit.
    fn with_plain_poles(mut sky: Texture) -> Texture {
        let Texels::Float(texels) = &mut sky.texels else { unreachable!("made here") };
        let row = 4 * sky.width;
        let top = texels.len() - row;
        for first in [0, top] {
            let color: Vec<f32> = texels[first..first + 4].to_vec();
            texels[first..first + row].chunks_mut(4).for_each(|texel| texel.copy_from_slice(&color));
        }
        sky
    }

    #[test]
    fn poles_and_sides_of_the_map_are_those_of_the_cpu() {
        let near = |axis: Vec3| [axis, axis + 1e-3 * axis.any_orthogonal_vector(), axis + Vec3::splat(0.02)];
        let axes = [Vec3::Z, Vec3::NEG_Z, Vec3::NEG_X, Vec3::Y, Vec3::X].into_iter().flat_map(near);
        let all: Vec<_> = axes.chain([Vec3::ONE]).map(Vec3::normalize).collect();
        let gather = Gather::new(directions(all.as_slice().try_into().unwrap()));
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        let world = World { texture: Some(0), ..colored() };
        for (width, height) in [(40, 20), (2000, 1000)] {
            let environment = Environment::new(&world, &[with_plain_poles(sky(width, height))]).unwrap();
            let expected = gather.world_image(&environment, SampleSplit::All);
            let found = on_gpu.world_image(&environment, SampleSplit::All).unwrap();
            let tolerance = ROUNDING * width as f32 / 40.0;
            assert!(difference(&found, &expected) < tolerance);
        }
    }

    #[test]
    fn a_streamed_dump_and_a_map_larger_than_the_memory_give_the_same_world() {
        let (gather, gpu) = (Gather::new(random_dump_of(10, &[1, 3, 4, 6])), gpu());
        gpu.set_memory_budget(Some(60_000));
        let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
        assert!(!on_gpu.is_resident());
        // 86 KB.
        let environment = mapped(120, 60);
        assert!(strips(environment.map.as_deref(), 30_000).len() > 2);
        for half in HALVES {
            let found = on_gpu.world_image(&environment, half).unwrap();
            assert!(difference(&found, &gather.world_image(&environment, half)) < 3.0 * ROUNDING);
        }
        // All that a call has taken is given back.
        assert_eq!(gpu.free_memory(), 60_000);
    }

    #[test]
    fn a_map_larger_than_a_buffer_is_cut_into_strips() {
        let gather = Gather::new(random_dump_of(10, &[9]));
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        let environment = mapped(40, 20);
        let whole = on_gpu.world_image(&environment, SampleSplit::All).unwrap();
        // Seven rows; two; a single one although it has more.
        for (bytes, expected) in [(7 * 480 + 479, 3), (960, 10), (1, 20)] {
            let found = strips(environment.map.as_deref(), bytes);
            assert!(found.len() == expected && found.iter().cloned().flatten().eq(0..20), "{found:?}");
            let found = on_gpu.world_in_strips(&environment, SampleSplit::All, bytes).unwrap();
            assert!(difference(&found, &whole) < 1e-5);
        }
        assert_eq!(strips(None, 1), [Range::default()]);
    }

    #[test]
    fn without_room_or_device_there_is_an_error() {
        let (gather, gpu) = (Gather::new(random_dump_of(10, &[9])), gpu());
        let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
        gpu.set_memory_budget(Some(1000));
        let error = on_gpu.world_image(&mapped(40, 20), SampleSplit::All).unwrap_err();
        assert!(matches!(error, GatherError::Gpu(GpuError::OutOfMemory { .. })), "{error}");
        gpu.set_memory_budget(Some(1 << 30));
        gpu.lose();
        let error = on_gpu.world_image(&mapped(40, 20), SampleSplit::All).unwrap_err();
        assert!(matches!(error, GatherError::Gpu(GpuError::Lost(_))), "{error}");
    }

    #[test]
    fn the_environment_has_the_layout_of_its_wgsl_twin() {
        relume_gpu::assert_mirror!(GpuEnvironment as "gather/world", "Environment", {
            texture_from_world, color, lobes, width, height, first_row, end_row, first_without_world,
        });
    }
}
