//! Intersection of rays with the scene.
//!
//! [`SceneBvh`] holds one tree of the whole scene: triangles of meshes that are used once (or are small) stand in it
//! in world space. Meshes that are used more often, strands and points have trees of their own that the world's tree
//! refers to. obvhs builds, we collapse to eight children a node and walk with AVX2.

mod build;
mod collapse;
#[cfg(test)]
mod motion_tests;
mod scalar;
mod spheres;
mod storage;
#[cfg(test)]
mod strand_tests;
mod strands;
#[cfg(test)]
mod tests;
mod traverse;
mod tree;
mod tube;

#[cfg(target_arch = "x86_64")]
mod avx2;

use std::{mem::MaybeUninit, sync::Arc};

use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::{Instance, STILL, Scene};

use crate::shading::Hit;
use traverse::{NearestHit, STACK, traverse};
use tree::{Child, PlacedKind, Tree};

/// A tree that could not be built.
#[derive(Debug, thiserror::Error)]
pub enum BvhError {
    /// More triangles than a triangle number can count.
    #[error("the scene has more than {limit} triangles; simplify its meshes or share them between objects")]
    TooManyTriangles {
        /// Most triangles that fit.
        limit: usize,
    },
    /// More keys of strands than a piece's number can count.
    #[error("an object has hair of more than {limit} keys; divide it between objects")]
    TooManyKeys {
        /// Most keys that fit.
        limit: usize,
    },
}

/// Kind of a ray, by which objects are visible: that of the lobe which made it, or a shadow ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[expect(missing_docs, reason = "the kinds of ray visibility in Blender")]
pub enum RayKind {
    Camera,
    Diffuse,
    Glossy,
    Transmission,
    Volume,
    Shadow,
    Raycast,
}

impl From<Lobe> for RayKind {
    fn from(lobe: Lobe) -> Self {
        match lobe {
            Lobe::Camera => Self::Camera,
            Lobe::Diffuse => Self::Diffuse,
            Lobe::Glossy | Lobe::RoughGlossy => Self::Glossy,
            Lobe::Transmission | Lobe::RoughTransmission => Self::Transmission,
            Lobe::Volume => Self::Volume,
        }
    }
}

/// A ray, and what it may meet.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, world space, metres.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Hits are farther than this.
    pub t_min: f32,
    /// Hits are nearer than this.
    pub t_max: f32,
    /// Time within the shutter's interval, 0..1.
    pub time: f32,
    /// Objects can be invisible to a kind of ray.
    pub kind: RayKind,
    /// True if it meets shadow catchers alone.
    pub catchers_only: bool,
    /// Instance and primitive that it leaves, which it cannot meet again at once (as in Cycles).
    pub from: Option<(u32, u32)>,
}

impl Ray {
    /// An unlimited ray that meets what cameras see.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let (time, kind) = (STILL, RayKind::Camera);
        let catchers_only = false;
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY, time, kind, catchers_only, from: None }
    }

    /// The ray at a time.
    pub fn at(self, time: f32) -> Self {
        Self { time, ..self }
    }
}

/// All geometry of a scene, ready for rays.
#[derive(Clone, Debug)]
pub struct SceneBvh {
    tree: Arc<Tree>,
    /// Bit per [`RayKind`] for each instance, and the same bits above for rays that meet shadow catchers alone.
    visibility: Vec<u16>,
    /// True if any instance is invisible to any ray of the scene.
    any_hidden: bool,
    /// Instances whose transform swaps left and right, so that their triangles turn around in the world.
    mirrored: Vec<bool>,
    /// Number of the first placement of each instance that stands in the tree by reference; [`NOT_PLACED`] for others.
    placements: Vec<u32>,
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "no other processor has it"))]
    use_avx2: bool,
}

impl SceneBvh {
    /// Builds the trees. The scene's indices have to be valid ([`Scene::validate`]); triangles without area are left
    /// out.
    pub fn new(scene: &Scene) -> Result<Self, BvhError> {
        let bits = |instance: &Instance| {
            let bits = u16::from(visibility_bits(instance));
            if instance.catches_shadows() { bits | bits << CATCHERS_ONLY } else { bits }
        };
        let visibility: Vec<u16> = scene.instances.iter().map(bits).collect();
        let any_hidden = visibility.iter().any(|bits| *bits != ALL_VISIBLE);
        let mirrored = scene
            .instances
            .iter()
            .map(|instance| instance.world_from_object.matrix3.determinant() < 0.0)
            .collect();
        let tree = build::build(scene)?;
        let mut placements = vec![NOT_PLACED; scene.instances.len()];
        for (number, placement) in tree.placements.iter().enumerate().rev() {
            placements[placement.instance as usize] = number as u32;
        }
        Ok(Self { tree: Arc::new(tree), visibility, any_hidden, mirrored, placements, use_avx2: has_avx2() })
    }

    /// Memory of the trees.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// The nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.walk::<false>(ray).map(|found| self.hit(ray, &found))
    }

    /// The nearest hit with one instance alone, on either side and whatever sees it. A material of its
    /// mesh has to ask for that ([`relume_scene::Material::meets_itself`]).
    pub fn intersect_within(&self, ray: &Ray, instance: u32) -> Option<Hit> {
        let first = self.placements[instance as usize];
        // Nothing can be met of what is scaled to nothing.
        if first == NOT_PLACED {
            return None;
        }
        let pieces = self.tree.placements[first as usize..].iter();
        let piece =
            pieces.take_while(|piece| piece.instance == instance).position(|piece| piece.is_at(ray.time))?;
        let placement = first as usize + piece;
        let from = ray.from.map_or(u32::MAX, |(_, triangle)| triangle);
        let accept = |_: u32, id: u32| id != from;
        self.with_stack(|stack| {
            let root = Some(Child::placement(placement));
            self.traverse::<false>(ray, root, stack, accept, |_| true, |_| u32::MAX)
        })
        .map(|found| self.hit(ray, &found))
    }

    /// True if anything is hit.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        self.walk::<true>(ray).is_some()
    }

    fn walk<const ANY: bool>(&self, ray: &Ray) -> Option<NearestHit> {
        let kind = 1 << (ray.kind as u8 + if ray.catchers_only { CATCHERS_ONLY } else { 0 });
        let (from_placed, from_id) = self.source_primitive(ray);
        let sees = |instance: u32| !self.any_hidden || self.visibility[instance as usize] & kind != 0;
        let placed_instance = |placement: u32| self.tree.placements[placement as usize].instance;
        let accept = |placement: u32, id: u32| {
            if placement == u32::MAX {
                (id != from_id || from_placed != u32::MAX)
                    && (!self.any_hidden || sees(self.tree.instance_of[id as usize]))
            } else {
                id != from_id || placed_instance(placement) != from_placed
            }
        };
        let enter = |placement: u32| sees(placed_instance(placement));
        let source =
            |placement: u32| if placed_instance(placement) == from_placed { from_id } else { u32::MAX };
        self.with_stack(|stack| self.traverse::<ANY>(ray, self.tree.root, stack, accept, enter, source))
    }

    #[inline(always)]
    fn with_stack<T>(&self, walk: impl FnOnce(&mut [MaybeUninit<u64>]) -> T) -> T {
        let mut on_stack = [const { MaybeUninit::uninit() }; STACK];
        if self.tree.stack_depth <= STACK {
            walk(&mut on_stack)
        } else {
            walk(&mut vec![MaybeUninit::uninit(); self.tree.stack_depth])
        }
    }

    #[inline(always)]
    fn traverse<const ANY: bool>(
        &self,
        ray: &Ray,
        root: Option<Child>,
        stack: &mut [MaybeUninit<u64>],
        accept: impl Fn(u32, u32) -> bool,
        enter: impl Fn(u32) -> bool,
        source: impl Fn(u32) -> u32,
    ) -> Option<NearestHit> {
        #[cfg(target_arch = "x86_64")]
        if self.use_avx2 {
            // SAFETY: `use_avx2` is set only where the processor has all features that the function enables.
            return unsafe {
                avx2::traverse_avx2::<ANY>(&self.tree, ray, root, stack, accept, enter, source)
            };
        }
        traverse::<scalar::Scalar, ANY>(&self.tree, ray, root, stack, accept, enter, source)
    }

    /// Instance of the primitive that the ray leaves if it is a placed one, and the primitive's number.
    fn source_primitive(&self, ray: &Ray) -> (u32, u32) {
        let Some((instance, primitive)) = ray.from else { return (u32::MAX, u32::MAX) };
        if self.placements[instance as usize] != NOT_PLACED {
            (instance, primitive)
        } else {
            (u32::MAX, self.tree.first_ids[instance as usize] + primitive)
        }
    }

    fn hit(&self, ray: &Ray, found: &NearestHit) -> Hit {
        if found.placement != u32::MAX
            && let kind @ (PlacedKind::Strands(_) | PlacedKind::Points | PlacedKind::MovingPoints) =
                self.tree.placements[found.placement as usize].kind
        {
            return self.curved_hit(ray, found, kind);
        }
        let lane = found.lane as usize;
        let (instance, primitive, front) = if found.placement == u32::MAX {
            let cross = self.tree.blocks[found.block as usize].cross(lane);
            let instance = self.tree.instance_of[found.id as usize];
            let front = if self.mirrored[instance as usize] { -cross } else { cross };
            (instance, found.id - self.tree.first_ids[instance as usize], front)
        } else {
            let placement = &self.tree.placements[found.placement as usize];
            let block = found.block as usize;
            let cross = match placement.kind {
                PlacedKind::MovingMesh => self.tree.moving_block(block, placement, ray.time).cross(lane),
                _ => self.tree.blocks[block].cross(lane),
            };
            let front = placement.object_from_world_at(ray.time).matrix3.transpose() * cross;
            (placement.instance, found.id, front)
        };
        // Widened edges (`EDGE_SLACK`) let a hit lie slightly outside.
        let (u, v) = (found.u.clamp(0.0, 1.0), found.v.clamp(0.0, 1.0));
        Hit {
            instance,
            primitive,
            barycentrics: [u.min(1.0 - v), v],
            distance: found.t,
            time: ray.time,
            front,
        }
    }

    /// A hit on a strand or a sphere.
    fn curved_hit(&self, ray: &Ray, found: &NearestHit, kind: PlacedKind) -> Hit {
        let placement = &self.tree.placements[found.placement as usize];
        let (object_from_world, instance) = (placement.object_from_world_at(ray.time), placement.instance);
        let direction = object_from_world.transform_vector3(ray.direction);
        let position = object_from_world.transform_point3(ray.origin) + direction * found.t;
        let normal = match kind {
            PlacedKind::Strands(set) => {
                let along = [found.u, placement.share_at(ray.time)];
                self.tree.strand_sets[set as usize].normal(found.id, along, position, direction)
            }
            PlacedKind::MovingPoints => {
                let block = self.tree.moving_spheres(found.block as usize, placement, ray.time);
                block.radius_vector(found.lane as usize, position)
            }
            _ => self.tree.sphere_blocks[found.block as usize].radius_vector(found.lane as usize, position),
        };
        let front = object_from_world.matrix3.transpose() * normal;
        let barycentrics = [found.u, found.v];
        Hit { instance, primitive: found.id, barycentrics, distance: found.t, time: ray.time, front }
    }
}

/// Stands for the placement of an instance whose triangles are in the world's tree.
const NOT_PLACED: u32 = u32::MAX;

const ALL_VISIBLE: u16 = 0b111_1111;

/// Place of the bits of rays that meet shadow catchers alone.
const CATCHERS_ONLY: u8 = 8;

/// Bit for each [`RayKind`] that sees an instance. Rays from volume scattering count as diffuse, too, as in Cycles (`path_state_ray_visibility`).
pub(crate) fn visibility_bits(instance: &Instance) -> u8 {
    let bits = [
        (instance.visible_camera, RayKind::Camera),
        (instance.visible_diffuse, RayKind::Diffuse),
        (instance.visible_glossy, RayKind::Glossy),
        (instance.visible_transmission, RayKind::Transmission),
        (instance.visible_diffuse || instance.visible_volume_scatter, RayKind::Volume),
        (instance.visible_shadow, RayKind::Shadow),
    ]
    .into_iter()
    .fold(0, |bits, (visible, kind)| bits | u8::from(visible) << kind as u8);
    // What some ray sees, rays of nodes do.
    bits | u8::from(bits != 0 && instance.visible_raycast) << RayKind::Raycast as u8
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    std::is_x86_feature_detected!("avx2")
        && std::is_x86_feature_detected!("fma")
        && std::is_x86_feature_detected!("bmi1")
        && std::is_x86_feature_detected!("bmi2")
        && std::is_x86_feature_detected!("lzcnt")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_avx2() -> bool {
    false
}
