//! Light-free paths: sampled by the BSDFs and a [`Guide`], recorded segment by segment (paper, sections 3.1 and 4.1).

mod catcher;
mod collision;
mod connection;
mod emission;
mod fast_gi;
mod features;
mod probes;
mod shadow_path;
mod sink;
mod travel;

use glam::Vec3;
use relume_dump::{AovSample, End, Lobe, Segment};
use relume_scene::Scene;

pub use self::sink::PathSink;
pub(crate) use self::{
    catcher::{Plate, plate_count},
    shadow_path::ShadowDifferences,
};
use self::{
    emission::LitVertex,
    features::Features,
    travel::{Arrival, Route},
};
use crate::{
    bsdf::{BsdfSample, Caustics, Surface},
    bvh::{Ray, SceneBvh},
    camera::CameraSampler,
    environment::EnvironmentLight,
    guide::{Cones, Guide},
    light_classes::LightClasses,
    media::{Media, MediaScratch, TrackingNumbers},
    path::{LightsOnly, PathState},
    ray_offset::{offset_for_terminator, offset_origin},
    sampler::{Draws, PixelSampler},
    settings::PathSettings,
    shading::{PreparedMaterials, SurfacePoint},
    static_light::{LastBounce, SeeThrough, StaticLights},
    vertex::Vertex,
};

/// Memory that one thread reuses from path to path.
#[derive(Debug, Default)]
pub struct PathScratch {
    surface: Surface,
    shadow: Surface,
    cones: Cones,
    media: MediaScratch,
}

/// Everything that paths are traced in.
#[derive(Debug)]
pub(crate) struct Integrator<'a> {
    pub scene: &'a Scene,
    pub bvh: SceneBvh,
    pub materials: PreparedMaterials,
    pub camera: CameraSampler,
    pub environment: EnvironmentLight,
    pub lights: Option<StaticLights>,
    pub see_through: SeeThrough,
    pub media: Option<Media>,
    pub shadows: Option<ShadowDifferences>,
    pub classes: Option<LightClasses>,
    /// True if there are shadow catchers.
    pub catches: bool,
    pub settings: PathSettings,
}

/// Groups of the sampler: the camera takes the first, each vertex of a path two.
pub(crate) const CAMERA_GROUP: u32 = 0;
/// Numbers of the time, where anything moves, and of the wavelength, where glass disperses light.
pub(crate) const TIME_GROUP: u32 = 1 << 27;
const WAVELENGTH_GROUP: u32 = TIME_GROUP + 1;
const GROUPS_PER_VERTEX: u32 = 2;
/// Added to a vertex's first group: numbers of the guide, of the way there through media, of light's way from there, and of
/// the pieces of a shadow path.
const GUIDE_GROUP: u32 = 1 << 31;
const TRAVEL_GROUP: u32 = 1 << 30;
const SHADOW_GROUP: u32 = 3 << 30;
const SHADOW_PATH_GROUP: u32 = 1 << 29;

/// A path on its way.
#[derive(Clone)]
struct Walk {
    path: PathState,
    ray: Ray,
    /// Radius of the ray's footprint at its origin, and its growth per metre.
    footprint: f32,
    spread: f32,
    /// Last bounce, if lights are also sampled from there.
    last: Option<LastBounce>,
    /// Place among the media of the scene, if it has any.
    route: Option<Route>,
    /// Number of the set of blockers that alone stop it, if it is a shadow ray of lights with shadow linking.
    blockers: Option<usize>,
    /// Plate that it is traced for.
    plate: Plate,
    /// True once light counts on that plate.
    counts: bool,
}

impl Integrator<'_> {
    /// Traces path number `sample` of pixel `x`, `y` of a plate.
    pub fn trace(
        &self,
        (x, y): (usize, usize),
        plate: Plate,
        sampler: PixelSampler,
        sample: u32,
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let time = self.camera.time(y, || sampler.draw(sample, TIME_GROUP)[0]);
        let Some(camera) = self.camera.ray(x, y, time, sampler.draw(sample, CAMERA_GROUP)) else {
            let position = self.scene.camera.world_from_camera.translation.into();
            sink.begin_path((!self.camera.is_pinhole()).then_some(position));
            sink.end_path(AovSample { alpha: plate.alpha_without_light(), ..AovSample::default() });
            return;
        };
        let wavelength = self.materials.wavelength(|| sampler.draw(sample, WAVELENGTH_GROUP)[0]);
        sink.begin_path((!self.camera.is_pinhole()).then_some(camera.origin));
        let mut features =
            Features { sample: AovSample { alpha: 1.0, ..AovSample::default() }, tint: Some(Vec3::ONE) };
        let mut walk = Walk {
            path: PathState::new(camera.origin, wavelength),
            ray: Ray { t_max: camera.length, ..Ray::new(camera.origin, camera.direction).at(time) },
            footprint: camera.footprint,
            spread: camera.spread,
            last: None,
            route: self
                .media
                .as_ref()
                .map(|media| Route::new(self.stack_at(media, camera.origin, time), camera.origin)),
            blockers: None,
            plate,
            counts: plate.counts_at_once(),
        };
        for vertex_number in 0.. {
            let group = CAMERA_GROUP + 1 + GROUPS_PER_VERTEX * vertex_number;
            let draws = Draws::new(sampler, sample, group);
            self.record_linked(&mut walk, draws, scratch, sink);
            let is_of_its_own = |shadows: &ShadowDifferences| shadows.at_start(walk.ray.kind);
            if (walk.path.is_cut() || self.shadows.as_ref().is_some_and(is_of_its_own))
                && walk.last.is_some()
                && walk.path.starts_lit_ray()
            {
                self.record_shadow_path(&mut walk, None, draws, scratch, sink);
            }
            let numbers = || TrackingNumbers::new(draws.at(TRAVEL_GROUP));
            let goes_on = match self.arrive(&mut walk, &mut features, numbers, &mut scratch.media, sink) {
                Arrival::Lost => false,
                Arrival::Escape => {
                    self.escape(&mut walk, &mut features, sink);
                    false
                }
                Arrival::Collision(position) => {
                    self.scatter_in_medium(&mut walk, position, guide, scratch, &mut features, draws, sink)
                }
                Arrival::Surface(hit) => {
                    if let Some(lights_only) = walk.path.lights_only {
                        if !lights_only.is_at(&hit) {
                            let end = lights_only.vertex + walk.ray.direction * hit.distance;
                            self.record(&mut walk, End::Vertex(end), sink);
                        }
                        break;
                    }
                    walk.footprint += walk.spread * hit.distance;
                    let Ray { origin, direction, .. } = walk.ray;
                    let met =
                        self.materials.surface_point(self.scene, &hit, origin, direction, walk.footprint);
                    let point = SurfacePoint { ray: walk.path.ray_info(), ..met };
                    self.record(&mut walk, End::Vertex(point.position), sink);
                    if walk.path.is_on_first_surface() {
                        let travelled = walk.route.as_ref().map_or(0.0, |route| route.travelled);
                        features.sample.depth = Some(camera.start + (travelled + hit.distance));
                    }
                    if self.is_caught(&walk, &hit)
                        && !self.catch(&mut walk, &point, scratch, &mut features, sink)
                    {
                        break;
                    }
                    if let Some(shadows) = &self.shadows
                        && shadows.at(hit.instance)
                        && walk.last.is_some()
                        && walk.path.is_lit()
                    {
                        self.record_shadow_path(&mut walk, Some(&point), draws, scratch, sink);
                    }
                    self.meet(&mut walk, &point, guide, scratch, &mut features, draws, sink)
                }
            };
            if !goes_on || walk.is_lost_to_plate() {
                break;
            }
        }
        features.keep_plate(&walk);
        features.sample.emission *= self.settings.film_exposure;
        features.sample.world *= self.settings.film_exposure;
        sink.end_path(features.sample);
    }

    /// Takes a path to what it meets next. The numbers are for media.
    fn arrive(
        &self,
        walk: &mut Walk,
        features: &mut Features,
        numbers: impl FnOnce() -> TrackingNumbers,
        scratch: &mut MediaScratch,
        sink: &mut impl PathSink,
    ) -> Arrival {
        match &self.media {
            None => self.bvh.intersect(&walk.ray).map_or(Arrival::Escape, Arrival::Surface),
            Some(media) => self.travel(media, walk, features, numbers(), scratch, sink),
        }
    }

    /// Records the path's current segment, as the film sees it, if lights along it count.
    fn record(&self, walk: &mut Walk, end: End, sink: &mut impl PathSink) {
        let segment = walk.path.segment(end);
        if !walk.path.sees_lights(&self.settings.bounces, walk.last.is_none()) {
            walk.path.left_out = Some(end);
            return;
        }
        let left_out = walk.path.left_out.take();
        let weight = if walk.counts { self.settings.film_exposure } else { 0.0 };
        let segment = Segment {
            throughput: segment.throughput * weight,
            receiver: segment.receiver + self.class_offset(walk),
            ..segment
        };
        let bounds = self.media.as_ref().and_then(Media::recorded);
        if let (Some(bounds), Some(route)) = (bounds, &mut walk.route) {
            route.record_within(bounds, segment, sink);
            return;
        }
        if let Some(end) = left_out {
            // Where it is recorded again it starts at the end of what was left out.
            sink.push(Segment { end, throughput: Vec3::ZERO, ..segment });
        }
        sink.push(segment);
    }

    /// The path leaves the scene.
    fn escape(&self, walk: &mut Walk, features: &mut Features, sink: &mut impl PathSink) {
        let direction = walk.ray.direction;
        walk.counts |= walk.shows_background();
        let factor = self.record_escape(walk, sink);
        let path = &walk.path;
        if path.sees_background && self.settings.film_transparent {
            features.open_film(path.throughput);
            return;
        }
        if path.lights_only.is_some() {
            return;
        }
        let radiance = self.environment.radiance(self.scene, &self.materials, direction, path.light.lobe);
        if radiance != Vec3::ZERO {
            let weight = self
                .lights
                .as_ref()
                .map_or(1.0, |lights| lights.world_weight(walk.last, &self.environment, direction));
            features.sample.world += path.light_throughput() * radiance * (weight * factor);
        }
    }

    /// Shades a surface that the path came to, and sends it on, or says that it ends there.
    fn meet(
        &self,
        walk: &mut Walk,
        point: &SurfacePoint,
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        features: &mut Features,
        draws: Draws,
        sink: &mut impl PathSink,
    ) -> bool {
        scratch.surface.show(if walk.path.is_diffuse { self.settings.caustics() } else { Caustics::ALL });
        scratch.surface.set_after_diffuse(walk.path.was_diffuse);
        let probes = self.probes(&walk.path, point, draws);
        self.materials.evaluate_with(self.scene, point, probes.as_ref(), &mut scratch.surface);
        walk.path.disperse(scratch.surface.wavelength_weight());
        if walk.path.sees_background {
            let is_holdout = self.scene.instances[point.instance as usize].is_holdout;
            let held_out = scratch.surface.hold_out(is_holdout);
            if held_out != Vec3::ZERO {
                features.open_film(walk.path.throughput * held_out);
                if held_out == Vec3::ONE {
                    return false;
                }
            }
        }
        self.collect_emission(&walk.path, point, walk.last, &scratch.surface, features);
        let u = draws.at(0);
        let survival = walk.path.survival(&self.settings.bounces);
        if u[3] >= survival {
            features.record_surface(&scratch.surface);
            return false;
        }
        walk.path.throughput /= survival;
        self.scatter(walk, point, [u[0], u[1], u[2]], guide, scratch, features, draws, sink)
    }

    /// Sends the path on from a surface, or says that it ends there.
    fn scatter<S: PathSink>(
        &self,
        walk: &mut Walk,
        point: &SurfacePoint,
        u: [f32; 3],
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        features: &mut Features,
        draws: Draws,
        sink: &mut S,
    ) -> bool {
        let limits = &self.settings.bounces;
        let Walk { path, ray, last, route, counts, .. } = walk;
        let surface = &mut scratch.surface;
        if path.is_last_surface() {
            let through = surface.transparency();
            features.record_surface(surface);
            path.pass_through(through, limits);
            offset_origin(ray, point);
            ray.t_max = self.reach(path, point);
            self.leave(walk, point, true);
            return through.max_element() > 0.0;
        }
        self.filter_closures(path, surface);
        let vertex = Vertex::Surface { point, surface };
        let cones = guided(guide, &vertex, &mut scratch.cones);
        if S::WANTS_STATIC_LIGHT {
            let at = LitVertex { path, route: route.as_ref(), vertex, cones };
            self.add_static_light(at, (&mut scratch.shadow, &mut scratch.media), features, draws);
        }
        if *counts {
            sink.meet(|| self.surface_vertex(path, route.as_ref(), point, surface));
        }
        if let Some(entry) = surface.enters(u[2]) {
            features.record_surface(surface);
            let Some((exit, draws)) = self.cross_body(path, point, &entry, draws, surface) else {
                return false;
            };
            self.leave_body(walk, point, &exit, sink);
            let [u0, u1, u2, _] = draws.at(0);
            return self.scatter(walk, &exit, [u0, u1, u2], guide, scratch, features, draws, sink);
        }
        let Some((sample, pdf)) = direction(surface, cones, u, || draws.at(GUIDE_GROUP)) else {
            features.record_surface(surface);
            return false;
        };
        if let Some(position) = sample.portal {
            features.attenuate(sample.weight);
            self.jump(walk, point, &sample, position, sink);
            return true;
        }
        if sample.transparent {
            features.attenuate(sample.weight);
            path.pass_through(sample.weight, limits);
        } else {
            if surface.is_specular() {
                features.attenuate(sample.weight);
            } else {
                features.record_surface(surface);
            }
            path.scatter(point.position, &sample, limits);
            path.sees_background &= self.settings.shows_through(&sample);
            path.receiver = self.scene.instances[point.instance as usize].receiver;
            *last = (!sample.singular).then_some(LastBounce { position: point.position, pdf });
        }
        ray.direction = sample.wi;
        if sample.lights_only {
            offset_for_terminator(ray, &self.materials, self.scene, point);
            let primitive = (point.instance, point.primitive);
            path.lights_only = Some(LightsOnly { vertex: point.position, primitive });
        } else {
            offset_origin(ray, point);
        }
        ray.kind = path.lobe.into();
        ray.t_max = self.reach(path, point);
        let goes_through = point.geometric_normal.dot(sample.wi) < 0.0;
        self.leave(walk, point, sample.transparent || (goes_through && sample.lobe == Lobe::Transmission));
        true
    }

    /// Starts the next segment at a surface, behind it if the path goes through.
    fn leave(&self, walk: &mut Walk, point: &SurfacePoint, goes_through: bool) {
        if let (Some(media), Some(route)) = (&self.media, &mut walk.route)
            && goes_through
        {
            let triangle = (point.instance, point.primitive);
            media.cross_at(self.scene, triangle, point.backfacing, &mut route.stack);
        }
        walk.begin_segment(point.position);
    }

    /// Defensive sampling and Filter Glossy (Cycles' `surface_shader_prepare_closures`).
    fn filter_closures(&self, path: &PathState, surface: &mut Surface) {
        let filter_glossy = self.settings.filter_glossy;
        // Which closure a direction was drawn from decides what its ray sees where caustics are off.
        if path.is_on_first_surface() && self.settings.caustics() == Caustics::ALL {
            surface.sample_defensively();
        }
        if filter_glossy > 0.0 {
            let blur_pdf = path.min_pdf / filter_glossy;
            if blur_pdf < 1.0 {
                surface.blur((1.0 - blur_pdf).sqrt() * 0.5);
            }
        }
    }
}

/// Cones towards lights, if some directions from a vertex are drawn from them.
fn guided<'c>(guide: Option<&Guide>, vertex: &Vertex<'_>, cones: &'c mut Cones) -> Option<&'c Cones> {
    let guide = guide.filter(|_| vertex.is_guided())?;
    guide.fill_cones(vertex.position(), vertex.horizon(), cones);
    Some(&*cones).filter(|cones| cones.share > 0.0)
}

/// Direction in which a path goes on, weighted by the density of surface and cones together, which comes second; that
/// of the sample stays the surface's own, by which Filter Glossy goes.
fn direction(
    surface: &Surface,
    cones: Option<&Cones>,
    u: [f32; 3],
    cone_numbers: impl FnOnce() -> [f32; 4],
) -> Option<(BsdfSample, f32)> {
    let Some(cones) = cones.filter(|_| !surface.chooses_singular(u[2])) else {
        return surface.sample(u).map(|sample| (sample, sample.pdf));
    };
    let v = cone_numbers();
    let mut sample = if v[0] < cones.share {
        surface.sample_towards(cones.sample([v[1], v[2], v[3]]), v[0] / cones.share)?
    } else {
        surface.sample(u)?
    };
    let pdf = cones.pdf_with(surface.dull_share(), sample.pdf, sample.wi);
    sample.weight *= sample.pdf / pdf;
    Some((sample, pdf))
}
