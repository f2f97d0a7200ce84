//! Shadow catchers: objects that the camera sees only by what others take from their light, or add to it.
//!
//! Cycles splits a path where it meets the first catcher: one half goes on among all objects, the other among catchers alone, and
//! what lies before them is a matte (`kernel/integrator/shadow_catcher.h`). What the catcher shows is the ratio of the two, which no
//! sum over lights is. So the film has a plate for each of these sums. Plates are stored one below the other, as rows of one
//! picture, and their paths use the same random numbers: where nothing casts a shadow the ratio is 1.

use glam::Vec3;
use relume_scene::Scene;

use super::{Features, Integrator, PathScratch, PathSink, Walk};
use crate::{
    settings::PathSettings,
    shading::{Hit, SurfacePoint},
};

/// Part of the light of a film with shadow catchers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plate {
    /// Light of all that stands before catchers; all of it where there are none. Alpha is 0 on catchers.
    Matte,
    /// Light of catchers among all objects. Alpha is that of a film without catchers.
    Shadowed,
    /// Light of catchers among catchers alone. Alpha is the share of paths that meet one.
    Clear,
    /// World behind the matte and the catchers.
    Background,
}

/// Number of plates of a scene's film.
pub(crate) fn plate_count(scene: &Scene, settings: &PathSettings) -> usize {
    match (scene.has_shadow_catchers(), settings.film_transparent) {
        (false, _) => 1,
        (true, true) => 3,
        (true, false) => 4,
    }
}

impl Plate {
    /// Plate number `number`, from the top.
    pub fn numbered(number: usize) -> Self {
        match number {
            0 => Self::Matte,
            1 => Self::Shadowed,
            2 => Self::Clear,
            _ => Self::Background,
        }
    }

    /// True if light counts before a catcher is met.
    pub fn counts_at_once(self) -> bool {
        self == Self::Matte
    }

    /// Alpha where no light reaches the film.
    pub fn alpha_without_light(self) -> f32 {
        if self == Self::Clear { 0.0 } else { 1.0 }
    }
}

impl Walk {
    /// True if nothing that the plate shows can follow.
    pub fn is_lost_to_plate(&self) -> bool {
        !self.counts && !self.path.sees_background
    }

    /// True if what lies behind all surfaces is what the plate shows.
    pub fn shows_background(&self) -> bool {
        self.plate == Plate::Background && self.path.sees_background
    }
}

impl Features {
    /// Drops light that is not the plate's.
    pub fn keep_plate(&mut self, walk: &Walk) {
        if !walk.counts {
            (self.sample.emission, self.sample.world) = (Vec3::ZERO, Vec3::ZERO);
        }
        match walk.plate {
            Plate::Clear => self.sample.alpha = if walk.counts { 1.0 } else { 0.0 },
            Plate::Background => self.sample.emission = Vec3::ZERO,
            Plate::Matte | Plate::Shadowed => {}
        }
    }
}

impl Integrator<'_> {
    /// True if a path meets its first shadow catcher with a hit, before nothing but the film's background.
    pub(super) fn is_caught(&self, walk: &Walk, hit: &Hit) -> bool {
        let catches = self.catches && self.scene.instances[hit.instance as usize].catches_shadows();
        catches && walk.path.sees_background && (!walk.counts || walk.plate == Plate::Matte)
    }

    /// Goes on with what the path's plate shows of a catcher, or says that it ends there.
    pub(super) fn catch(
        &self,
        walk: &mut Walk,
        point: &SurfacePoint,
        scratch: &mut PathScratch,
        features: &mut Features,
        sink: &mut impl PathSink,
    ) -> bool {
        match walk.plate {
            Plate::Matte => {
                self.materials.evaluate(self.scene, point, &mut scratch.surface);
                features.record_surface(&scratch.surface);
                features.open_film(walk.path.throughput);
                return false;
            }
            Plate::Background => {
                walk.begin_segment(point.position);
                self.escape(walk, features, sink);
                return false;
            }
            Plate::Shadowed => {}
            Plate::Clear => (walk.path.catchers_only, walk.ray.catchers_only) = (true, true),
        }
        walk.counts = true;
        (features.sample.emission, features.sample.world) = (Vec3::ZERO, Vec3::ZERO);
        true
    }
}
