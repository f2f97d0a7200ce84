//! Intersection of rays with the scene.
//!
//! [`SceneBvh`] holds one tree of the whole scene: triangles of meshes that are used once (or are small) stand in it
//! in world space, meshes that are used more often have a tree of their own that the world's tree refers to. obvhs
//! builds, we collapse to eight children a node and walk with AVX2.

mod build;
mod collapse;
mod scalar;
mod storage;
#[cfg(test)]
mod tests;
mod traverse;
mod tree;

#[cfg(target_arch = "x86_64")]
mod avx2;

use std::{mem::MaybeUninit, sync::Arc};

use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::{Instance, Scene};

use crate::shading::Hit;
use traverse::{NearestHit, STACK, traverse};
use tree::Tree;

/// A tree that could not be built.
#[derive(Debug, thiserror::Error)]
pub enum BvhError {
    /// More triangles than a triangle number can count.
    #[error("the scene has more than {limit} triangles; simplify its meshes or share them between objects")]
    TooManyTriangles {
        /// Most triangles that fit.
        limit: usize,
    },
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
    /// Scattering event that made the ray; objects can be invisible to a kind of ray.
    pub lobe: Lobe,
    /// Instance and primitive that it leaves, which it cannot meet again at once (as in Cycles).
    pub from: Option<(u32, u32)>,
}

impl Ray {
    /// An unlimited ray that meets what cameras see.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY, lobe: Lobe::Camera, from: None }
    }
}

/// All geometry of a scene, ready for rays.
#[derive(Clone, Debug)]
pub struct SceneBvh {
    tree: Arc<Tree>,
    /// Bit per [`Lobe`] for each instance.
    visibility: Vec<u8>,
    /// True if any instance is invisible to any lobe.
    any_hidden: bool,
    /// Instances whose transform swaps left and right, so that their triangles turn around in the world.
    mirrored: Vec<bool>,
    /// Instances that stand in the tree by reference.
    placed: Vec<bool>,
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "no other processor has it"))]
    use_avx2: bool,
}

impl SceneBvh {
    /// Builds the trees. The scene's indices have to be valid ([`Scene::validate`]); triangles without area are left
    /// out.
    pub fn new(scene: &Scene) -> Result<Self, BvhError> {
        let visibility: Vec<u8> = scene.instances.iter().map(visibility_bits).collect();
        let any_hidden = visibility.iter().any(|bits| *bits != ALL_VISIBLE);
        let mirrored = scene
            .instances
            .iter()
            .map(|instance| instance.world_from_object.matrix3.determinant() < 0.0)
            .collect();
        let tree = build::build(scene)?;
        let mut placed = vec![false; scene.instances.len()];
        tree.placements.iter().for_each(|placement| placed[placement.instance as usize] = true);
        Ok(Self { tree: Arc::new(tree), visibility, any_hidden, mirrored, placed, use_avx2: has_avx2() })
    }

    /// The nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.walk::<false>(ray).map(|found| self.hit(&found))
    }

    /// True if anything is hit.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        self.walk::<true>(ray).is_some()
    }

    fn walk<const ANY: bool>(&self, ray: &Ray) -> Option<NearestHit> {
        let mut on_stack = [const { MaybeUninit::uninit() }; STACK];
        if self.tree.stack_depth <= STACK {
            self.walk_with::<ANY>(ray, &mut on_stack)
        } else {
            self.walk_with::<ANY>(ray, &mut vec![MaybeUninit::uninit(); self.tree.stack_depth])
        }
    }

    fn walk_with<const ANY: bool>(&self, ray: &Ray, stack: &mut [MaybeUninit<u64>]) -> Option<NearestHit> {
        let lobe = 1 << ray.lobe as u8;
        let (from_placed, from_id) = self.source_primitive(ray);
        let sees = |instance: u32| !self.any_hidden || self.visibility[instance as usize] & lobe != 0;
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
        #[cfg(target_arch = "x86_64")]
        if self.use_avx2 {
            // SAFETY: `use_avx2` is set only where the processor has all features that the function enables.
            return unsafe { avx2::traverse_avx2::<ANY>(&self.tree, ray, stack, accept, enter) };
        }
        traverse::<scalar::Scalar, ANY>(&self.tree, ray, stack, accept, enter)
    }

    /// Instance of the primitive that the ray leaves if it is a placed one, and the primitive's number.
    fn source_primitive(&self, ray: &Ray) -> (u32, u32) {
        let Some((instance, primitive)) = ray.from else { return (u32::MAX, u32::MAX) };
        if self.placed[instance as usize] {
            (instance, primitive)
        } else {
            (u32::MAX, self.tree.first_ids[instance as usize] + primitive)
        }
    }

    fn hit(&self, found: &NearestHit) -> Hit {
        let cross = self.tree.blocks[found.block as usize].cross(found.lane as usize);
        let (instance, primitive, front) = if found.placement == u32::MAX {
            let instance = self.tree.instance_of[found.id as usize];
            let front = if self.mirrored[instance as usize] { -cross } else { cross };
            (instance, found.id - self.tree.first_ids[instance as usize], front)
        } else {
            let placement = &self.tree.placements[found.placement as usize];
            let front = placement.object_from_world.matrix3.transpose() * cross;
            (placement.instance, found.id, front)
        };
        // Widened edges (`EDGE_SLACK`) let a hit lie slightly outside.
        let (u, v) = (found.u.clamp(0.0, 1.0), found.v.clamp(0.0, 1.0));
        Hit { instance, primitive, barycentrics: [u.min(1.0 - v), v], distance: found.t, front }
    }
}

const ALL_VISIBLE: u8 = 0b1_1111;

/// Rays from volume scattering count as diffuse, too, as in Cycles (`path_state_ray_visibility`).
fn visibility_bits(instance: &Instance) -> u8 {
    [
        (instance.visible_camera, Lobe::Camera),
        (instance.visible_diffuse, Lobe::Diffuse),
        (instance.visible_glossy, Lobe::Glossy),
        (instance.visible_transmission, Lobe::Transmission),
        (instance.visible_diffuse || instance.visible_volume_scatter, Lobe::Volume),
    ]
    .into_iter()
    .fold(0, |bits, (visible, lobe)| bits | u8::from(visible) << lobe as u8)
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
