//! Records of lights where shadow rays see the scene otherwise than paths: objects without shadow or hidden from other rays,
//! materials without transparent shadows, and shaders that ask Light Path or look around.
//!
//! Cycles meets lights from dull surfaces and media by shadow rays. The records of a path stand for these, so there they lead
//! where a shadow ray would go, and the path itself goes on beside them without lights, up to where it is scattered. What Cycles
//! adds by hitting a large lamp from there is counted as if a shadow ray had met it.

use glam::Vec3;
use relume_dump::{AovSample, End, Lobe, Sight};
use relume_scene::{Material, Scene};

use super::{Features, Integrator, PathScratch, PathSink, SHADOW_PATH_GROUP, Walk, travel::Arrival};
use crate::{
    bvh::{Ray, RayKind, visibility_bits},
    emitters::may_be_transparent,
    media::{Media, TrackingNumbers},
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
    /// True if a medium asks for kinds of rays.
    media: bool,
}

impl ShadowDifferences {
    /// Differences within a scene and its media; nothing if there are none.
    pub fn new(scene: &Scene, media: Option<&Media>) -> Option<Self> {
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
        let media = media.is_some_and(Media::ask_light_path);
        let differs = media || instances.contains(&true) || hidden_blockers & KINDS & !of_camera != 0;
        differs.then_some(Self { instances, hidden_blockers, media })
    }

    /// True if rays of this kind do not meet everything that shadow rays meet, or media as these do.
    pub fn at_start(&self, kind: RayKind) -> bool {
        self.media || self.hidden_blockers & 1 << kind as u8 != 0
    }

    /// True if shadow rays may pass an instance otherwise than paths.
    pub fn at(&self, instance: u32) -> bool {
        self.instances[instance as usize]
    }
}

/// Most pieces of a shadow ray.
const PIECES: u32 = 1 << 12;

/// Bits of all kinds of rays.
const KINDS: u8 = 0b11_1111;

fn differs(material: &Material) -> bool {
    may_be_transparent(material)
        && (material.opaque_shadows || material.asks_light_path() || material.looks_around())
}

impl Walk {
    /// A shadow ray along the present ray, which may have blockers of its own.
    fn shadow(&self, blockers: Option<usize>) -> Self {
        let ray = Ray { kind: RayKind::Shadow, t_max: f32::INFINITY, ..self.ray };
        Self { ray, blockers, ..self.clone() }
    }

    /// Goes on with a record that a shadow ray has added to.
    fn record_after(&mut self, shadow: &Self) {
        if let (Some(route), Some(recorded)) = (&mut self.route, &shadow.route) {
            route.continue_record(recorded);
        }
    }
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
        let mut shadow = walk.shadow(None);
        walk.path.darken(met.map_or(walk.path.origin(), |point| point.position));
        if met.is_none_or(|point| self.pass_as_shadow(&mut shadow, point, scratch)) {
            self.follow_shadow(&mut shadow, SHADOW_PATH_GROUP, draws, scratch, sink);
        }
        walk.record_after(&shadow);
    }

    /// Records lights with blockers of their own along a ray that starts at a dull vertex, as their shadow rays would meet them.
    pub(super) fn record_linked(
        &self,
        walk: &mut Walk,
        draws: Draws,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let Some(classes) = &self.classes else { return };
        if walk.last.is_none() || !walk.path.starts_lit_ray() {
            return;
        }
        for set in 0..classes.sets() {
            let mut shadow = walk.shadow(Some(set));
            if classes.is_empty(set) {
                // Media do not dim lights without shadow either.
                let direction = shadow.ray.direction;
                self.record(&mut shadow, End::Escape(direction), sink);
            } else {
                let group = SHADOW_PATH_GROUP + PIECES * (set as u32 + 1);
                self.follow_shadow(&mut shadow, group, draws, scratch, sink);
            }
            walk.path.return_to(walk.path.origin());
            walk.record_after(&shadow);
        }
    }

    /// Number that the class of a path's current segment adds to its receiver.
    pub(super) fn class_offset(&self, walk: &Walk) -> u16 {
        let Some(classes) = &self.classes else { return 0 };
        let is_behind_glass = walk.path.sees_background && walk.path.lobe != Lobe::Camera;
        let is_without_world = walk.path.is_cut() || is_behind_glass && classes.tell_glass();
        let sight = match (walk.blockers, walk.last) {
            (Some(set), _) => Sight::Linked(set),
            (None, Some(_)) if is_without_world => Sight::ShadowWithoutWorld,
            (None, None) if is_without_world => Sight::SingularWithoutWorld,
            (None, Some(_)) => Sight::Shadow,
            (None, None) => Sight::Singular,
        };
        classes.offset(sight, walk.path.bounces_before())
    }

    /// Records the pieces of a shadow ray up to what stops it.
    fn follow_shadow(
        &self,
        shadow: &mut Walk,
        group: u32,
        draws: Draws,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let mut unseen = Features { sample: AovSample::default(), tint: None };
        for piece in 0..PIECES {
            let numbers = || TrackingNumbers::new(draws.at(group + piece));
            match self.arrive(shadow, &mut unseen, numbers, &mut scratch.media, sink) {
                Arrival::Escape => {
                    let direction = shadow.ray.direction;
                    self.record(shadow, End::Escape(direction), sink);
                    return;
                }
                Arrival::Lost | Arrival::Collision(_) => return,
                Arrival::Surface(hit) if shadow.path.lights_only.is_some_and(|only| only.is_at(&hit)) => {
                    return;
                }
                Arrival::Surface(hit) => {
                    let ray = shadow.ray;
                    let point =
                        self.materials.surface_point(self.scene, &hit, ray.origin, ray.direction, 0.0);
                    self.record(shadow, End::Vertex(point.position), sink);
                    if !self.pass_as_shadow(shadow, &point, scratch) {
                        return;
                    }
                }
            }
        }
    }

    /// Takes a shadow ray through a surface, or says that it ends there.
    fn pass_as_shadow(&self, shadow: &mut Walk, point: &SurfacePoint, scratch: &mut PathScratch) -> bool {
        let limits = &self.settings.bounces;
        let is_met = self.stops_shadow(shadow, point.instance);
        if is_met {
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
        self.leave(shadow, point, is_met);
        shadow.path.sees_lights(limits, false)
    }

    /// True if a shadow ray meets an instance.
    fn stops_shadow(&self, shadow: &Walk, instance: u32) -> bool {
        let is_blocker = |set| self.classes.as_ref().is_some_and(|classes| classes.blocks(set, instance));
        self.scene.instances[instance as usize].visible_shadow && shadow.blockers.is_none_or(is_blocker)
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
