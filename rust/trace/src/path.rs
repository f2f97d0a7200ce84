//! State of a path from bounce to bounce, with the rules of Cycles' `kernel/integrator/path_state.h`.

use glam::Vec3;
use relume_dump::{End, Lobe, Segment};

use crate::{
    bsdf::{BsdfSample, LightClass},
    settings::BounceLimits,
    shading::{Hit, RayInfo},
};

/// State of one path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathState {
    /// `T_k` of the current segment.
    pub throughput: Vec3,
    /// Scattering event that made the current segment; transparent surfaces do not change it.
    pub lobe: Lobe,
    /// True if that event was diffuse, on either side of the surface.
    pub is_diffuse: bool,
    /// True if that or an earlier event was.
    pub was_diffuse: bool,
    /// True if that event was a mirror or clear glass.
    is_singular: bool,
    /// Place of that event, or the camera's.
    origin: Vec3,
    /// Class that lights along the present segment are collected under ([`BsdfSample::light`]).
    pub light: LightClass,
    /// Class of the segment after the path's first scattering event.
    pub first_lobe: Lobe,
    /// Receiver number of the object that the path last scattered at; transparent surfaces do not change it, so that
    /// light linking works through them (Cycles' `mis_ray_object`).
    pub receiver: u16,
    /// True if nothing but the film's background is seen along the current ray so far: from the camera, through transparent
    /// surfaces and glass that the film shows through (Cycles' `PATH_RAY_TRANSPARENT_BACKGROUND`).
    pub sees_background: bool,
    /// True once the path sees no objects but shadow catchers.
    pub catchers_only: bool,
    /// Set where the current segment is between the true and the shading surface ([`crate::bsdf::SampleReach::Lights`]).
    pub lights_only: Option<LightsOnly>,
    /// True if lights along the current ray do not count: the sample says so ([`BsdfSample::unlit`]), or they were recorded
    /// already ([`PathState::darken`]).
    unlit: bool,
    /// End of the segment before, if that was left out of the record. Segments that continue its ray are left out, too.
    pub left_out: Option<End>,
    /// Smallest density of the path's directions so far (Filter Glossy).
    pub min_pdf: f32,
    bounces: u32,
    diffuse: u32,
    glossy: u32,
    transmission: u32,
    transparent: u32,
    portals: u32,
    volume: u32,
    /// True if the current segment left a transparent surface.
    through_transparent: bool,
    /// True if it continues the ray of the segment before it.
    continues: bool,
    /// See [`RayInfo::wavelength`].
    wavelength: Option<f32>,
    /// True if the throughput is that of this wavelength alone.
    is_dispersed: bool,
    /// The next surface only emits and lets through.
    last_surface: bool,
    /// The next surface only emits.
    ends_on_surface: bool,
    /// True if Fast GI cut the current ray.
    is_cut: bool,
}

/// End of a path that dips below the true surface: only lights along its last segment count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightsOnly {
    /// The vertex that the path left, from which lights are seen; what blocks them is seen from above it.
    pub vertex: Vec3,
    /// Instance and primitive of that vertex.
    pub primitive: (u32, u32),
}

impl LightsOnly {
    /// True if a hit is on the primitive of that vertex.
    pub fn is_at(&self, hit: &Hit) -> bool {
        (hit.instance, hit.primitive) == self.primitive
    }
}

impl PathState {
    /// A path that leaves the camera at `origin`, with a wavelength in nm where glass disperses light.
    pub fn new(origin: Vec3, wavelength: Option<f32>) -> Self {
        Self {
            throughput: Vec3::ONE,
            lobe: Lobe::Camera,
            is_diffuse: false,
            was_diffuse: false,
            is_singular: false,
            origin,
            light: LightClass::of(Lobe::Camera),
            first_lobe: Lobe::Camera,
            receiver: 0,
            sees_background: true,
            catchers_only: false,
            lights_only: None,
            unlit: false,
            left_out: None,
            min_pdf: f32::INFINITY,
            bounces: 0,
            diffuse: 0,
            glossy: 0,
            transmission: 0,
            transparent: 0,
            portals: 0,
            volume: 0,
            through_transparent: false,
            continues: false,
            wavelength,
            is_dispersed: false,
            last_surface: false,
            ends_on_surface: false,
            is_cut: false,
        }
    }

    /// The current segment, which ends at `end`.
    pub fn segment(&self, end: End) -> Segment {
        Segment {
            end,
            throughput: self.light_throughput(),
            lobe: self.light.lobe,
            receiver: self.receiver,
            continues: self.continues,
        }
    }

    /// Throughput of lights along the current segment, those of its class alone.
    pub fn light_throughput(&self) -> Vec3 {
        self.throughput * self.light.tint
    }

    /// The current ray, as shaders see it.
    pub fn ray_info(&self) -> RayInfo {
        let lobe = self.lobe;
        RayInfo {
            is_camera: lobe == Lobe::Camera,
            is_shadow: false,
            is_diffuse: self.is_diffuse,
            is_glossy: !self.is_diffuse && !matches!(lobe, Lobe::Camera | Lobe::Volume),
            is_singular: self.is_singular,
            is_reflection: matches!(lobe, Lobe::Diffuse | Lobe::Glossy),
            is_transmission: lobe == Lobe::Transmission,
            is_volume_scatter: lobe == Lobe::Volume,
            origin: self.origin,
            depth: self.bounces,
            diffuse_depth: self.diffuse,
            glossy_depth: self.glossy,
            transmission_depth: self.transmission,
            transparent_depth: self.transparent,
            portal_depth: self.portals,
            wavelength: self.wavelength,
        }
    }

    /// Takes the weight of the path's wavelength, where it first counts: behind glass that disperses light.
    pub fn disperse(&mut self, weight: Option<Vec3>) {
        if let Some(weight) = weight.filter(|_| !self.is_dispersed) {
            self.throughput *= weight;
            self.is_dispersed = true;
        }
    }

    /// A shadow ray from the event that made the current ray, as shaders see it: counted before that event, one bounce further.
    pub fn shadow_info(&self) -> RayInfo {
        let event = |lobe| u32::from(self.lobe == lobe);
        RayInfo {
            is_shadow: true,
            origin: self.origin,
            depth: self.bounces,
            diffuse_depth: self.diffuse - event(Lobe::Diffuse),
            glossy_depth: self.glossy - event(Lobe::Glossy),
            transmission_depth: self.transmission - event(Lobe::Transmission),
            transparent_depth: self.transparent,
            portal_depth: self.portals,
            ..RayInfo::default()
        }
    }

    /// Place from which the current ray's length counts: the last event, or the camera.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// True if the path is at the start of a ray along which lights count.
    pub fn starts_lit_ray(&self) -> bool {
        !self.continues && !self.unlit
    }

    /// True if lights along the current ray count.
    pub fn is_lit(&self) -> bool {
        !self.unlit
    }

    /// Bounces before the vertex that the current ray left; 0 for the camera's.
    pub fn bounces_before(&self) -> u32 {
        self.bounces.saturating_sub(1)
    }

    /// Starts the rest of the record at a position, where that of another ray ended elsewhere.
    pub fn return_to(&mut self, position: Vec3) {
        self.left_out = Some(End::Vertex(position));
    }

    /// Leaves lights along the rest of the current ray out: another ray recorded them, and the record is at its end.
    pub fn darken(&mut self, position: Vec3) {
        self.unlit = true;
        self.return_to(position);
    }

    /// True if the path is on the first surface after the camera.
    pub fn is_on_first_surface(&self) -> bool {
        self.bounces + self.transparent == 0
    }

    /// True if a bounce limit was reached: the surface that the path is on can emit and be transparent, no more.
    pub fn is_last_surface(&self) -> bool {
        self.last_surface
    }

    /// True if Fast GI cuts the current ray: it comes after more than so many bounces (`path_state_ao_bounce`). What it meets only
    /// emits and lets through.
    pub fn cut_after(&mut self, bounces: u32) -> bool {
        let uncounted = self.transmission + u32::from(self.glossy > 0);
        self.is_cut = self.bounces + 1 > bounces.saturating_add(uncounted);
        self.last_surface |= self.is_cut;
        self.is_cut
    }

    /// True if Fast GI cut the current ray.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Probability to go on from the surface that the path is on (`path_state_continuation_probability`).
    pub fn survival(&self, limits: &BounceLimits) -> f32 {
        if self.ends_on_surface {
            return 0.0;
        }
        // Cycles counts its minima one higher than the settings show.
        let is_early = if self.through_transparent {
            self.transparent <= limits.min_transparent + 1
        } else {
            self.bounces <= limits.min_total + 1
        };
        if is_early { 1.0 } else { self.throughput.abs().max_element().sqrt().min(1.0) }
    }

    /// Goes straight on with another weight, within a medium that dims channels differently.
    pub fn change(&mut self, weight: Vec3) {
        self.throughput *= weight;
        self.continues = true;
    }

    /// Scatters in a medium. What the collision leaves of the light was taken into account there; `weight` is of the direction.
    pub fn scatter_in_medium(&mut self, position: Vec3, weight: Vec3, pdf: f32, limits: &BounceLimits) {
        self.throughput *= weight;
        self.min_pdf = self.min_pdf.min(pdf);
        (self.lobe, self.light, self.origin) = (Lobe::Volume, LightClass::of(Lobe::Volume), position);
        self.count_bounce();
        (self.is_diffuse, self.is_singular, self.sees_background) = (false, false, false);
        (self.through_transparent, self.continues, self.unlit) = (false, false, false);
        self.volume += 1;
        self.last_surface |= self.volume > limits.volume || self.bounces > limits.total;
    }

    /// Counts a scattering event.
    fn count_bounce(&mut self) {
        if self.bounces == 0 {
            self.first_lobe = self.light.lobe;
        }
        self.bounces += 1;
    }

    /// Goes straight through a surface.
    pub fn pass_through(&mut self, weight: Vec3, limits: &BounceLimits) {
        self.throughput *= weight;
        self.transparent += 1;
        (self.through_transparent, self.continues) = (true, true);
        self.ends_on_surface |=
            self.transparent >= limits.transparent.saturating_add(limits.more_transparent);
    }

    /// Goes on at another position through a portal, as through a transparent surface.
    pub fn jump(&mut self, position: Vec3, weight: Vec3, limits: &BounceLimits) {
        self.pass_through(weight, limits);
        self.portals += 1;
        (self.origin, self.continues, self.unlit, self.left_out) = (position, false, false, None);
    }

    /// Number of transparent surfaces that light may pass on its way straight to the surface that the path is on.
    pub fn transparent_left(&self, limits: &BounceLimits) -> u32 {
        limits.transparent.saturating_sub(self.transparent)
    }

    /// True if lights along the current segment count: the sample that made it allows them. Where they are sampled from
    /// surfaces, no more transparent ones may lie before them than the limit says. `is_found` where only the path itself can hit them, as in mirrors.
    pub fn sees_lights(&self, limits: &BounceLimits, is_found: bool) -> bool {
        !self.unlit && (is_found || self.transparent <= limits.transparent)
    }

    /// Scatters at a surface, at `position` (`path_state_next`). Cycles' kernel limits are the settings plus one, so that a light is
    /// still met by the segment after the last bounce that the settings allow, as by Cycles' direct light there.
    pub fn scatter(&mut self, position: Vec3, sample: &BsdfSample, limits: &BounceLimits) {
        self.throughput *= sample.weight;
        self.min_pdf = self.min_pdf.min(sample.pdf);
        self.lobe = sample.lobe;
        self.is_diffuse = sample.diffuse;
        self.was_diffuse |= sample.diffuse;
        self.light = sample.light;
        self.unlit = sample.unlit;
        (self.is_singular, self.origin) = (sample.singular, position);
        (self.through_transparent, self.continues) = (false, false);
        self.count_bounce();
        let (count, limit) = match sample.lobe {
            Lobe::Diffuse => (&mut self.diffuse, limits.diffuse),
            Lobe::Transmission => (&mut self.transmission, limits.transmission),
            _ => (&mut self.glossy, limits.glossy),
        };
        *count += 1;
        self.last_surface |= *count > limit || self.bounces > limits.total;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounce(lobe: Lobe) -> BsdfSample {
        BsdfSample {
            wi: Vec3::Z,
            weight: Vec3::splat(0.25),
            pdf: 1.0,
            lobe,
            light: LightClass::of(lobe),
            diffuse: lobe == Lobe::Diffuse,
            singular: false,
            alpha_squared: 1.0,
            transparent: false,
            portal: None,
            lights_only: false,
            unlit: false,
        }
    }

    #[test]
    fn lights_do_not_count_where_a_sample_says_so() {
        let limits = BounceLimits::default();
        let mut path = PathState::new(Vec3::ZERO, None);
        path.scatter(Vec3::ZERO, &BsdfSample { unlit: true, ..bounce(Lobe::Glossy) }, &limits);
        path.pass_through(Vec3::ONE, &limits);
        assert!(!path.sees_lights(&limits, false) && !path.sees_lights(&limits, true));
        path.scatter(Vec3::ZERO, &bounce(Lobe::Diffuse), &limits);
        assert!(path.sees_lights(&limits, false));
    }

    #[test]
    fn direct_light_only_still_has_the_segment_after_the_first_surface() {
        let limits = BounceLimits { total: 0, ..BounceLimits::default() };
        let mut path = PathState::new(Vec3::ZERO, None);
        assert!(!path.is_last_surface());
        path.scatter(Vec3::ZERO, &bounce(Lobe::Diffuse), &limits);
        assert!(path.is_last_surface());
    }

    #[test]
    fn each_kind_has_its_own_limit() {
        let limits = BounceLimits { diffuse: 1, glossy: 2, transmission: 3, ..BounceLimits::default() };
        for (lobe, allowed) in [(Lobe::Diffuse, 2), (Lobe::Glossy, 3), (Lobe::Transmission, 4)] {
            let mut path = PathState::new(Vec3::ZERO, None);
            let bounces = (1..10).find(|_| {
                path.scatter(Vec3::ZERO, &bounce(lobe), &limits);
                path.is_last_surface()
            });
            assert_eq!(bounces, Some(allowed), "{lobe:?}");
        }
    }

    #[test]
    fn transparent_surfaces_keep_the_lobe_and_count_apart() {
        for more_transparent in [0, 1] {
            let limits =
                BounceLimits { total: 0, transparent: 2, more_transparent, ..BounceLimits::default() };
            let mut path = PathState::new(Vec3::ZERO, None);
            for _ in 0..2 + more_transparent {
                assert!(path.survival(&limits) > 0.0 && path.sees_lights(&limits, false));
                path.pass_through(Vec3::ONE, &limits);
                assert!(path.lobe == Lobe::Camera && !path.is_last_surface());
            }
            assert_eq!(path.survival(&limits), 0.0);
            assert_eq!(path.sees_lights(&limits, false), more_transparent == 0);
            assert!(path.sees_lights(&limits, true));
        }
    }

    #[test]
    fn roulette_starts_after_the_second_bounce_with_the_root_of_the_throughput() {
        let limits = BounceLimits::default();
        let mut path = PathState::new(Vec3::ZERO, None);
        path.scatter(Vec3::ZERO, &bounce(Lobe::Diffuse), &limits);
        assert_eq!(path.survival(&limits), 1.0);
        path.scatter(Vec3::ZERO, &bounce(Lobe::Diffuse), &limits);
        assert_eq!(path.survival(&limits), 0.25);
    }
}
