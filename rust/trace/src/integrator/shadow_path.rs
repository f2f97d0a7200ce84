//! Records of lights where shadow rays see the scene otherwise than paths: objects without shadow or hidden from other rays,
//! materials without transparent shadows, and shaders that ask Light Path.
//!
//! Cycles meets lights from dull surfaces and media by shadow rays. The records of a path stand for these, so there they lead
//! where a shadow ray would go, and the path itself goes on beside them without lights, up to where it is scattered. What Cycles
//! adds by hitting a large lamp from there is counted as if a shadow ray had met it.

use glam::Vec3;
use relume_dump::{AovSample, End};
use relume_scene::{Material, Scene};

use super::{Features, Integrator, PathScratch, PathSink, SHADOW_PATH_GROUP, Walk, travel::Arrival};
use crate::{
    bvh::{RayKind, visibility_bits},
    emitters::may_be_transparent,
    media::TrackingNumbers,
    ray_offset::offset_origin,
    sampler::Draws,
    shading::{RayInfo, SurfacePoint},
};

/// Parts of a scene that shadow rays see otherwise than paths.
#[derive(Debug)]
pub(crate) struct ShadowDifferences {
    /// For each instance: shadow rays pass it, or its surface, otherwise than paths.
    instances: Vec<bool>,
    /// Bit per [`RayKind`]: some object that blocks shadow rays is hidden from it.
    hidden_blockers: u8,
}

impl ShadowDifferences {
    /// Differences within a scene; nothing if there are none.
    pub fn new(scene: &Scene) -> Option<Self> {
        let by_material: Vec<bool> = scene.materials.iter().map(differs).collect();
        let instances: Vec<bool> = (scene.instances.iter())
            .map(|instance| {
                !instance.visible_shadow
                    || instance.materials.iter().any(|material| by_material.get(*material) == Some(&true))
            })
            .collect();
        let blockers = scene.instances.iter().filter(|instance| instance.visible_shadow);
        let hidden_blockers = blockers.fold(0, |hidden, instance| hidden | !visibility_bits(instance));
        let of_camera = 1 << RayKind::Camera as u8;
        let differs = instances.contains(&true) || hidden_blockers & KINDS & !of_camera != 0;
        differs.then_some(Self { instances, hidden_blockers })
    }

    /// True if rays of this kind do not meet everything that shadow rays meet.
    pub fn hides_blockers(&self, kind: RayKind) -> bool {
        self.hidden_blockers & 1 << kind as u8 != 0
    }

    /// True if shadow rays may pass an instance otherwise than paths.
    pub fn at(&self, instance: u32) -> bool {
        self.instances[instance as usize]
    }
}

/// Bits of all kinds of rays.
const KINDS: u8 = 0b11_1111;

fn differs(material: &Material) -> bool {
    may_be_transparent(material) && (material.opaque_shadows || material.asks_light_path())
}

impl Integrator<'_> {
    /// Records lights along the ray of a path as a shadow ray would meet them, from its start, or from the surface that it `met`.
    /// The path itself goes on without them.
    pub(super) fn record_shadow_path(
        &self,
        walk: &mut Walk,
        met: Option<&SurfacePoint>,
        draws: Draws,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let mut shadow = walk.clone();
        shadow.ray.kind = RayKind::Shadow;
        walk.path.darken(met.map_or(walk.path.origin(), |point| point.position));
        let mut unseen = Features { sample: AovSample::default(), tint: None };
        let mut goes_on = met.is_none_or(|point| self.pass_as_shadow(&mut shadow, point, scratch));
        for piece in 0.. {
            if !goes_on {
                break;
            }
            let numbers = || TrackingNumbers::new(draws.at(SHADOW_PATH_GROUP + piece));
            goes_on = match self.arrive(&mut shadow, &mut unseen, numbers, &mut scratch.media, sink) {
                Arrival::Escape => {
                    let direction = shadow.ray.direction;
                    self.record(&mut shadow, End::Escape(direction), sink);
                    false
                }
                Arrival::Lost | Arrival::Collision(_) => false,
                Arrival::Surface(hit) if shadow.path.lights_only.is_some_and(|only| only.is_at(&hit)) => {
                    false
                }
                Arrival::Surface(hit) => {
                    let ray = shadow.ray;
                    let point =
                        self.materials.surface_point(self.scene, &hit, ray.origin, ray.direction, 0.0);
                    self.record(&mut shadow, End::Vertex(point.position), sink);
                    self.pass_as_shadow(&mut shadow, &point, scratch)
                }
            };
        }
        if let (Some(route), Some(recorded)) = (&mut walk.route, &shadow.route) {
            route.continue_record(recorded);
        }
    }

    /// Takes a shadow ray through a surface, or says that it ends there.
    fn pass_as_shadow(&self, shadow: &mut Walk, point: &SurfacePoint, scratch: &mut PathScratch) -> bool {
        let instance = &self.scene.instances[point.instance as usize];
        let limits = &self.settings.bounces;
        if instance.visible_shadow {
            let through = self.shadow_transparency(point, shadow.path.shadow_info(), scratch);
            if through.max_element() <= 0.0 {
                return false;
            }
            shadow.path.pass_through(through, limits);
        } else {
            shadow.path.change(Vec3::ONE);
        }
        offset_origin(&mut shadow.ray, point);
        shadow.ray.t_max = f32::INFINITY;
        self.leave(shadow, point, instance.visible_shadow);
        shadow.path.sees_lights(limits, false)
    }

    /// Weight of light that goes straight through a surface as a shadow ray meets it.
    fn shadow_transparency(&self, point: &SurfacePoint, ray: RayInfo, scratch: &mut PathScratch) -> Vec3 {
        let instance = &self.scene.instances[point.instance as usize];
        let material = instance.material_of(self.scene, point.primitive as usize);
        if material.is_some_and(|material| self.scene.materials[material].opaque_shadows) {
            return Vec3::ZERO;
        }
        self.materials.evaluate(self.scene, &SurfacePoint { ray, ..*point }, &mut scratch.shadow);
        scratch.shadow.transparency()
    }
}
