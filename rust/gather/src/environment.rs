use glam::{Mat3, Vec3};
use rayon::prelude::*;
use relume_dump::{Flags, Lobe, decode_direction, decode_rgb9e5};
use relume_image::Image;
use relume_scene::{ColorEncoding, Texels, Texture, World};

use std::sync::Arc;

use crate::{Gather, GatherError, SampleSplit};

/// A world to relight with: what escaped segments see.
#[derive(Clone, Debug)]
pub struct Environment {
    pub(crate) color: Vec3,
    pub(crate) map: Option<Arc<Map>>,
    pub(crate) texture_from_world: Mat3,
    /// Bit per [`Lobe`] that sees it.
    pub(crate) lobes: u32,
    /// Light that segments of other lobes see.
    parts: Vec<Self>,
}

/// Linear RGB; row 0 is the bottom.
#[derive(Clone, Debug)]
pub(crate) struct Map {
    pub width: usize,
    pub height: usize,
    pub texels: Vec<Vec3>,
}

impl Environment {
    /// Takes a world; `textures` is the list that its index refers to.
    ///
    /// # Errors
    /// If the texture's size and texels disagree.
    pub fn new(world: &World, textures: &[Texture]) -> Result<Self, GatherError> {
        let map = |texture: Option<usize>| {
            let texture = texture.and_then(|index| textures.get(index));
            Ok::<_, GatherError>(texture.map(Map::new).transpose()?.map(Arc::new))
        };
        let parts = world.parts.iter().map(|part| {
            Ok(Self {
                color: part.color.into(),
                map: map(part.texture)?,
                texture_from_world: part.texture_from_world,
                lobes: bits(part.rays),
                parts: Vec::new(),
            })
        });
        Ok(Self {
            color: world.color.into(),
            map: map(world.texture)?,
            texture_from_world: world.texture_from_world,
            lobes: bits(world.rays()),
            parts: parts.collect::<Result<_, GatherError>>()?,
        })
    }

    /// Another world of the same texture, which is shared, without parts; the texture that `world` itself names is not looked at.
    pub fn with_texture_for(&self, world: &World) -> Self {
        Self {
            color: world.color.into(),
            map: self.map.clone(),
            texture_from_world: world.texture_from_world,
            lobes: bits(world.rays()),
            parts: Vec::new(),
        }
    }

    /// The layer that segments of a lobe see.
    fn layer(&self, lobe: Lobe) -> Option<&Self> {
        self.layers().find(|layer| layer.lobes & 1 << lobe as u32 != 0)
    }

    /// Its own light and its parts, each for lobes of its own.
    pub(crate) fn layers(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.parts)
    }

    /// Radiance from a unit direction, RGB, scene-linear; not that of its parts.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let texel = |map: &Map| map.lookup(self.texture_from_world * direction);
        self.map.as_deref().map_or(self.color, |map| self.color * texel(map))
    }
}

/// Bit mask of the lobes whose kinds of rays see it.
fn bits(rays: [bool; 5]) -> u32 {
    let sees = |lobe: Lobe| u32::from(rays[lobe.ray_kind() as usize]) << lobe as u32;
    Lobe::ALL.into_iter().map(sees).sum()
}

impl Map {
    fn new(texture: &Texture) -> Result<Self, GatherError> {
        let (found, expected) = match &texture.texels {
            Texels::Byte(values) => (values.len(), texture.width * texture.height * 4),
            Texels::Float(values) => (values.len(), texture.width * texture.height * 4),
        };
        if found != expected || expected == 0 {
            return Err(GatherError::Environment { name: texture.name.clone(), found, expected });
        }
        let from_byte = |value: u8| match texture.encoding {
            ColorEncoding::Srgb => linear_from_srgb(f32::from(value) / 255.0),
            ColorEncoding::Linear => f32::from(value) / 255.0,
        };
        let texels = match &texture.texels {
            Texels::Byte(values) => {
                let table: Vec<_> = (0..=255).map(from_byte).collect();
                let linear = |value: u8| table[usize::from(value)];
                values
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|&[r, g, b, _]| Vec3::from([r, g, b].map(linear)))
                    .collect()
            }
            Texels::Float(values) => {
                values.as_chunks::<4>().0.iter().map(|&[r, g, b, _]| Vec3::new(r, g, b)).collect()
            }
        };
        Ok(Self { width: texture.width, height: texture.height, texels })
    }

    /// Bilinear, repeated in both directions as Cycles does.
    fn lookup(&self, direction: Vec3) -> Vec3 {
        let [u, v] = equirectangular(direction);
        let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let texel = |dx: isize, dy: isize| {
            let column = (x0 as isize + dx).rem_euclid(self.width as isize) as usize;
            let row = (y0 as isize + dy).rem_euclid(self.height as isize) as usize;
            self.texels[row * self.width + column]
        };
        let lower = texel(0, 0).lerp(texel(1, 0), x - x0);
        let upper = texel(0, 1).lerp(texel(1, 1), x - x0);
        lower.lerp(upper, y - y0)
    }
}

/// Blender's equirectangular map: u = 1/2 towards +x and falls towards +y, v = 1 straight up
/// (`direction_to_equirectangular` of `intern/cycles/kernel/camera/projection.h`, but for its arc cosine, which has half of the
/// digits near the poles).
fn equirectangular(direction: Vec3) -> [f32; 2] {
    use std::f32::consts::{PI, TAU};
    let from_top = direction.truncate().length().atan2(direction.z);
    [0.5 - direction.y.atan2(direction.x) / TAU, 1.0 - from_top / PI]
}

/// IEC 61966-2-1.
fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

impl Gather {
    /// Contribution of the world to the image, RGB, from the escaped segments.
    pub fn world_image(&self, environment: &Environment, half: SampleSplit) -> Image {
        let tiles: Vec<_> = (0..self.dump.manifest().tile_count())
            .into_par_iter()
            .map(|tile| self.world_tile(tile, environment, half))
            .collect();
        self.assemble(&tiles, 0)
    }

    fn world_tile(&self, tile: usize, environment: &Environment, half: SampleSplit) -> Vec<[f32; 3]> {
        let manifest = self.dump.manifest();
        let mut sums = vec![Vec3::ZERO; manifest.tile_rect(tile).pixel_count()];
        for shard in self.dump.tile(tile) {
            let (xy, z_flags, throughput) =
                (shard.position_xy(), shard.position_z_flags(), shard.throughput());
            for (pixel, sum) in sums.iter_mut().enumerate() {
                for record in half.records(shard, pixel) {
                    let flags = Flags((z_flags[record] >> 16) as u16);
                    let is_without_world = flags.receiver() >= manifest.first_without_world();
                    let lobe = flags.lobe().filter(|_| flags.escaped() && !is_without_world);
                    if let Some(layer) = lobe.and_then(|lobe| environment.layer(lobe)) {
                        let radiance = layer.radiance(decode_direction(xy[record]));
                        *sum += decode_rgb9e5(throughput[record]) * radiance;
                    }
                }
            }
        }
        let scale = 1.0 / half.tile_samples(&self.dump, tile).max(1) as f32;
        sums.into_iter().map(|sum| (sum * scale).to_array()).collect()
    }
}
