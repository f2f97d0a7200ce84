//! Passes that tell what each pixel shows, of whatever light: positions, texture coordinates, motion, pass indices and mattes of objects
//! and materials.
//!
//! Mattes are those of Cryptomatte (Friedman and Jones, "Fully automatic ID mattes with support for motion blur and
//! transparency", 2015; specification 1.2.0): the shares of a pixel that objects cover, by a hash of their names. As in Cycles,
//! camera rays count surfaces as far as these are not transparent, and go on behind them.

mod vector;

use std::collections::HashMap;

use glam::{Vec3, Vec4};
use relume_dump::TileRect;
use relume_scene::{Material, Scene};

use self::vector::Frames;
use crate::{
    bsdf::Surface,
    bvh::Ray,
    emitters::may_be_transparent,
    integrator::{CAMERA_GROUP, Integrator, TIME_GROUP},
    ray_offset::offset_origin,
    render::Tracer,
    sampler::PixelSampler,
    shading::SurfacePoint,
};

/// Wishes for data passes.
#[derive(Clone, Debug, PartialEq)]
pub struct DataPassSettings {
    /// Camera rays per pixel, those of a bake's first paths.
    pub samples: u32,
    /// Objects and materials that are told apart in a pixel.
    pub ranks: usize,
    /// Surfaces whose alpha is less are looked through for coordinates and pass indices. Unless nothing is behind, that is: only
    /// texture coordinates are 0 then.
    pub alpha_threshold: f32,
    /// Name of the asset that an object belongs to, for those whose name is another.
    pub assets: HashMap<String, String>,
}

/// Data of the pixels of some area, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DataPasses {
    /// World space, metres, where the first ray meets a surface of enough alpha; 0 where it meets none.
    pub positions: Vec<[f32; 3]>,
    /// Texture coordinates of the map that renders use, and 1 where there are some: means over the paths of the pixel, as in Cycles.
    /// Those that scatter at a surface of too little alpha have none.
    pub uvs: Vec<[f32; 3]>,
    /// Way on the film in pixels since the frame before and to the frame after, right and up, as Cycles has it: means over the rays that
    /// meet a surface of enough alpha. 0 unless both frames are known.
    pub vectors: Vec<[f32; 4]>,
    /// Pass index of the object there.
    pub object_indices: Vec<f32>,
    /// Pass index of the material there.
    pub material_indices: Vec<f32>,
    /// Ranks of objects for each pixel: [`matte_id`] and share of the pixel, the largest first.
    pub objects: Vec<[f32; 2]>,
    /// Ranks of materials likewise.
    pub materials: Vec<[f32; 2]>,
    /// Ranks of assets likewise.
    pub assets: Vec<[f32; 2]>,
}

impl DataPasses {
    /// Adds the pixels of an area below, which is as wide.
    pub fn append(&mut self, mut below: Self) {
        self.positions.append(&mut below.positions);
        self.uvs.append(&mut below.uvs);
        self.vectors.append(&mut below.vectors);
        self.object_indices.append(&mut below.object_indices);
        self.material_indices.append(&mut below.material_indices);
        self.objects.append(&mut below.objects);
        self.materials.append(&mut below.materials);
        self.assets.append(&mut below.assets);
    }
}

/// Name of the material of surfaces that have none, in Cycles.
const NO_MATERIAL: &str = "default_surface";

/// Traces data passes, part by part of the picture.
pub struct DataTracer<'t> {
    integrator: &'t Integrator<'t>,
    seed: u64,
    settings: &'t DataPassSettings,
    ids: MatteIds,
    frames: Option<Frames<'t>>,
}

impl<'t> DataTracer<'t> {
    /// Makes the names of a scene ready.
    pub fn new(tracer: &'t Tracer<'t>, settings: &'t DataPassSettings) -> Self {
        let integrator = &tracer.integrator;
        Self {
            integrator,
            seed: tracer.settings.seed,
            settings,
            ids: MatteIds::new(integrator.scene, settings),
            frames: None,
        }
    }

    /// Takes the scenes of the frames before and after, from which vectors are made.
    #[must_use]
    pub fn between(self, before: &'t Scene, after: &'t Scene) -> Self {
        Self { frames: Some(Frames { now: self.integrator.scene, before, after }), ..self }
    }

    /// Data of a part of the picture.
    pub fn trace(&self, rect: TileRect) -> DataPasses {
        let mut passes = DataPasses::default();
        let mut pixel = PixelData::new(self.settings.ranks);
        for y in rect.y..rect.y + rect.height {
            for x in rect.x..rect.x + rect.width {
                pixel.clear();
                let sampler = PixelSampler::new(self.seed, x as u32, y as u32);
                for sample in 0..self.settings.samples {
                    self.add_ray((x, y), sampler, sample, &mut pixel);
                }
                pixel.write(1.0 / self.settings.samples as f32, &mut passes);
            }
        }
        passes
    }

    /// Adds what the camera ray of one path meets.
    fn add_ray(&self, (x, y): (usize, usize), sampler: PixelSampler, sample: u32, pixel: &mut PixelData) {
        let Integrator { scene, bvh, materials, camera: cameras, settings, .. } = self.integrator;
        let time = cameras.time(y, || sampler.draw(sample, TIME_GROUP)[0]);
        let Some(camera) = cameras.ray(x, y, time, sampler.draw(sample, CAMERA_GROUP)) else { return };
        let mut ray = Ray { t_max: camera.length, ..Ray::new(camera.origin, camera.direction).at(time) };
        let (mut weight, mut straight, mut footprint, mut seeks_first) = (1.0, 1.0, camera.footprint, true);
        for passed in 0..=settings.bounces.transparent {
            let Some(hit) = bvh.intersect(&ray) else { return };
            footprint += camera.spread * hit.distance;
            let point = materials.surface_point(scene, &hit, ray.origin, ray.direction, footprint);
            let instance = &scene.instances[hit.instance as usize];
            let material = instance.material_of(scene, hit.primitive as usize);
            let shader = material.map(|material| &scene.materials[material]);
            let is_hull = shader.is_some_and(Material::is_hull);
            if instance.is_holdout && !is_hull {
                return;
            }
            if sample == 0 && seeks_first && !is_hull {
                pixel.first = FirstSurface {
                    position: point.position.to_array(),
                    object_index: instance.pass_index,
                    material_index: shader.map_or(0, |shader| shader.pass_index),
                };
            }
            let (transparency, straight_share) = match material {
                _ if is_hull => (1.0, 1.0),
                Some(material) if self.ids.are_clear[material] => {
                    let transparency = self.transparency(&point, passed, &mut pixel.surface);
                    (transparency, pixel.surface.straight_share())
                }
                _ => (0.0, 0.0),
            };
            let is_first = seeks_first && !is_hull && 1.0 - transparency >= self.settings.alpha_threshold;
            if let Some(uv) = is_first.then(|| materials.rendered_uv(scene, &point)).flatten() {
                pixel.uv += uv.extend(1.0) * straight;
            }
            let frames = self.frames.filter(|_| is_first);
            if let Some(vector) = frames.and_then(|frames| frames.vector(&point)) {
                pixel.vector += vector;
                pixel.vectors += 1.0;
            }
            straight *= straight_share;
            seeks_first &= !is_first;
            let covered = weight * (1.0 - transparency);
            if covered > 0.0 {
                pixel.objects.add(self.ids.objects[hit.instance as usize], covered);
                pixel.assets.add(self.ids.assets[hit.instance as usize], covered);
                pixel.materials.add(self.ids.materials[material.unwrap_or(scene.materials.len())], covered);
            }
            weight *= transparency;
            if weight <= 0.0 {
                return;
            }
            ray.t_max -= hit.distance;
            offset_origin(&mut ray, &point);
        }
    }

    /// Mean share of light that goes straight through a surface which the camera sees behind so many others.
    fn transparency(&self, met: &SurfacePoint, passed: u32, surface: &mut Surface) -> f32 {
        let mut point = *met;
        (point.ray.is_camera, point.ray.transparent_depth) = (true, passed);
        self.integrator.materials.evaluate(self.integrator.scene, &point, surface);
        surface.transparency().element_sum() / 3.0
    }
}

/// Hash of a name as Cryptomatte stores it: MurmurHash3 of 32 bits as a float, of which no exponent is that of zero, of
/// infinity or of what is not a number.
pub fn matte_id(name: &str) -> f32 {
    let hash = murmur3(name.as_bytes());
    let exponent = hash >> 23 & 255;
    f32::from_bits(if exponent == 0 || exponent == 255 { hash ^ 1 << 23 } else { hash })
}

/// MurmurHash3_x86_32 with the seed 0 (Appleby, public domain).
pub fn murmur3(bytes: &[u8]) -> u32 {
    let mix = |block: u32| block.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
    let mut blocks = bytes.chunks_exact(4);
    let mut hash = 0_u32;
    for block in &mut blocks {
        hash ^= mix(u32::from_le_bytes(block.try_into().expect("four bytes")));
        hash = hash.rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64);
    }
    let tail = blocks.remainder().iter().rev().fold(0, |tail, byte| tail << 8 | u32::from(*byte));
    hash ^= mix(tail) ^ bytes.len() as u32;
    hash = (hash ^ hash >> 16).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ hash >> 13).wrapping_mul(0xc2b2_ae35);
    hash ^ hash >> 16
}

/// Identifiers of everything in a scene, by its number.
struct MatteIds {
    objects: Vec<f32>,
    assets: Vec<f32>,
    /// Those of materials, then that of surfaces without one.
    materials: Vec<f32>,
    /// Materials that rays may go through, by their number.
    are_clear: Vec<bool>,
}

impl MatteIds {
    fn new(scene: &Scene, settings: &DataPassSettings) -> Self {
        let asset = |name: &String| matte_id(settings.assets.get(name).unwrap_or(name));
        let materials = scene.materials.iter().map(|material| matte_id(&material.name));
        Self {
            objects: scene.instances.iter().map(|instance| matte_id(&instance.name)).collect(),
            assets: scene.instances.iter().map(|instance| asset(&instance.name)).collect(),
            materials: materials.chain([matte_id(NO_MATERIAL)]).collect(),
            are_clear: scene.materials.iter().map(may_be_transparent).collect(),
        }
    }
}

/// Surface that the first ray of a pixel sees.
#[derive(Default)]
struct FirstSurface {
    position: [f32; 3],
    object_index: u32,
    material_index: u32,
}

/// Sums over the rays of one pixel.
struct PixelData {
    first: FirstSurface,
    uv: Vec3,
    /// Sum and number of vectors.
    vector: Vec4,
    vectors: f32,
    objects: Ranks,
    materials: Ranks,
    assets: Ranks,
    /// Scratch.
    surface: Surface,
}

impl PixelData {
    fn new(ranks: usize) -> Self {
        let [objects, materials, assets] = std::array::from_fn(|_| Ranks::new(ranks));
        let (first, surface) = Default::default();
        let vector = Vec4::ZERO;
        Self { first, uv: Vec3::ZERO, vector, vectors: 0.0, objects, materials, assets, surface }
    }

    fn clear(&mut self) {
        self.first = FirstSurface::default();
        self.uv = Vec3::ZERO;
        (self.vector, self.vectors) = (Vec4::ZERO, 0.0);
        for ranks in [&mut self.objects, &mut self.materials, &mut self.assets] {
            ranks.slots.clear();
        }
    }

    fn write(&mut self, scale: f32, passes: &mut DataPasses) {
        let FirstSurface { position, object_index, material_index } = self.first;
        passes.positions.push(position);
        passes.uvs.push((self.uv * scale).to_array());
        passes.vectors.push((self.vector / self.vectors.max(1.0)).to_array());
        passes.object_indices.push(object_index as f32);
        passes.material_indices.push(material_index as f32);
        self.objects.write(scale, &mut passes.objects);
        self.materials.write(scale, &mut passes.materials);
        self.assets.write(scale, &mut passes.assets);
    }
}

/// Identifiers that one pixel shows, with their weights.
struct Ranks {
    slots: Vec<[f32; 2]>,
    most: usize,
}

impl Ranks {
    fn new(most: usize) -> Self {
        Self { slots: Vec::with_capacity(most), most }
    }

    /// Adds to the weight of an identifier. Where there are more of them than ranks, the last one takes it, as in Cycles.
    fn add(&mut self, id: f32, weight: f32) {
        let known = self.slots.iter().position(|slot| slot[0] == id);
        match known.or_else(|| (self.slots.len() == self.most).then(|| self.most.saturating_sub(1))) {
            Some(slot) => {
                if let Some(slot) = self.slots.get_mut(slot) {
                    slot[1] += weight;
                }
            }
            None => self.slots.push([id, weight]),
        }
    }

    /// Writes all ranks, the largest first, and zeros for those that are free.
    fn write(&mut self, scale: f32, into: &mut Vec<[f32; 2]>) {
        self.slots.sort_by(|a, b| b[1].total_cmp(&a[1]));
        into.extend(self.slots.iter().map(|[id, weight]| [*id, weight * scale]));
        into.extend((self.slots.len()..self.most).map(|_| [0.0; 2]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_specification() {
        // Of `Cryptomatte`'s own test names, and of Blender's.
        assert_eq!(murmur3(b""), 0);
        assert_eq!(murmur3(b"hello"), 0x248b_fa47);
        assert_eq!(murmur3(b"hello, world"), 0x149b_bb7f);
        assert!(matte_id("hello").is_normal());
    }

    #[test]
    fn the_largest_ranks_come_first_and_the_last_takes_what_is_too_much() {
        let mut ranks = Ranks::new(2);
        for (id, weight) in [(1.0, 1.0), (2.0, 3.0), (1.0, 0.5), (3.0, 0.25)] {
            ranks.add(id, weight);
        }
        let mut written = Vec::new();
        ranks.write(0.5, &mut written);
        assert_eq!(written, [[2.0, 1.625], [1.0, 0.75]]);
    }
}
