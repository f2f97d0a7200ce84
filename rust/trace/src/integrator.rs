//! Light-free paths: sampled by the BSDFs and a [`Guide`], recorded segment by segment (paper, sections 3.1 and 4.1).

use glam::Vec3;
use relume_dump::{AovSample, End, Lobe, Segment, TileSamples};
use relume_scene::Scene;

use crate::{
    bsdf::{BsdfSample, Caustics, Surface},
    bvh::{Ray, SceneBvh},
    camera::CameraSampler,
    environment::EnvironmentLight,
    guide::{Cones, Guide},
    path::{LightsOnly, PathState},
    ray_offset::{offset_for_terminator, offset_origin},
    sampler::{Draws, PixelSampler},
    settings::PathSettings,
    shading::{PreparedMaterials, SurfacePoint},
    static_light::{LastBounce, ShadowTracer, StaticLights, StaticSample},
};

/// Receives paths as they are traced: a shard in the making, or training that streams fresh paths.
pub trait PathSink {
    /// A path starts; at `camera_vertex`, or at the camera's position if that is the same for all paths.
    fn begin_path(&mut self, camera_vertex: Option<Vec3>);
    /// The path's next segment.
    fn push(&mut self, segment: Segment);
    /// The path has ended.
    fn end_path(&mut self, aovs: AovSample);
}

impl PathSink for TileSamples {
    fn begin_path(&mut self, camera_vertex: Option<Vec3>) {
        Self::begin_path(self, camera_vertex);
    }

    fn push(&mut self, segment: Segment) {
        Self::push(self, segment);
    }

    fn end_path(&mut self, aovs: AovSample) {
        self.add_aov(aovs);
    }
}

/// Memory that one thread reuses from path to path.
#[derive(Debug, Default)]
pub struct PathScratch {
    surface: Surface,
    shadow: Surface,
    cones: Cones,
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
    pub settings: PathSettings,
}

/// Groups of the sampler: the camera takes the first, each surface of a path two.
const CAMERA_GROUP: u32 = 0;
const GROUPS_PER_SURFACE: u32 = 2;
/// Added to a surface's first group: numbers of the guide.
const GUIDE_GROUP: u32 = 1 << 31;

/// The AOVs of one path while it is traced.
struct Features {
    sample: AovSample,
    /// Product of the mirrors and glass crossed so far; nothing once the denoiser's surface was found.
    tint: Option<Vec3>,
}

impl Integrator<'_> {
    /// Traces path number `sample` of pixel `x`, `y`.
    pub fn trace(
        &self,
        (x, y): (usize, usize),
        sampler: PixelSampler,
        sample: u32,
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let camera = self.camera.ray(x, y, sampler.draw(sample, CAMERA_GROUP));
        sink.begin_path((!self.camera.is_pinhole()).then_some(camera.origin));
        let mut path = PathState::new();
        let mut features =
            Features { sample: AovSample { alpha: 1.0, ..AovSample::default() }, tint: Some(Vec3::ONE) };
        let mut ray = Ray { t_max: camera.length, ..Ray::new(camera.origin, camera.direction) };
        let mut footprint = camera.footprint;
        let mut last = None;
        for surface_number in 0.. {
            let Some(hit) = self.bvh.intersect(&ray) else {
                self.escape(&mut path, ray.direction, last, &mut features, sink);
                break;
            };
            if let Some(lights_only) = path.lights_only {
                if (hit.instance, hit.primitive) != lights_only.primitive {
                    let end = End::Vertex(lights_only.vertex + ray.direction * hit.distance);
                    self.record(&mut path, last, end, sink);
                }
                break;
            }
            footprint += camera.spread * hit.distance;
            let point = self.materials.surface_point(self.scene, &hit, ray.origin, ray.direction, footprint);
            self.record(&mut path, last, End::Vertex(point.position), sink);
            scratch.surface.show(if path.is_diffuse { self.settings.caustics() } else { Caustics::ALL });
            scratch.surface.set_after_diffuse(path.was_diffuse);
            self.materials.evaluate(self.scene, &point, &mut scratch.surface);
            if surface_number == 0 {
                features.sample.depth = Some(camera.start + hit.distance);
            }
            self.collect_emission(&path, &point, last, &scratch.surface, &mut features);

            let group = CAMERA_GROUP + 1 + GROUPS_PER_SURFACE * surface_number;
            let u = sampler.draw(sample, group);
            let survival = path.survival(&self.settings.bounces);
            if u[3] >= survival {
                features.record_surface(&scratch.surface);
                break;
            }
            path.throughput /= survival;
            if !self.scatter(
                &mut path,
                &point,
                [u[0], u[1], u[2]],
                guide,
                &mut ray,
                scratch,
                &mut features,
                &mut last,
                Draws::new(sampler, sample, group),
                sink,
            ) {
                break;
            }
        }
        features.sample.emission *= self.settings.film_exposure;
        features.sample.world *= self.settings.film_exposure;
        sink.end_path(features.sample);
    }

    /// Records the path's current segment, as the film sees it, if lights along it count. `last` is there if lights are also sampled from its place.
    fn record(&self, path: &mut PathState, last: Option<LastBounce>, end: End, sink: &mut impl PathSink) {
        let segment = path.segment(end);
        if !path.sees_lights(&self.settings.bounces, last.is_none()) {
            path.left_out = Some(end);
            return;
        }
        if let Some(end) = path.left_out.take() {
            // Where it is recorded again it starts at the end of what was left out.
            sink.push(Segment { end, throughput: Vec3::ZERO, ..segment });
        }
        sink.push(Segment { throughput: segment.throughput * self.settings.film_exposure, ..segment });
    }

    /// The path leaves the scene.
    fn escape(
        &self,
        path: &mut PathState,
        direction: Vec3,
        last: Option<LastBounce>,
        features: &mut Features,
        sink: &mut impl PathSink,
    ) {
        self.record(path, last, End::Escape(direction), sink);
        let is_camera = path.lobe == Lobe::Camera;
        if is_camera {
            features.sample.alpha = 1.0 - path.throughput.element_sum() / 3.0;
        }
        if path.lights_only.is_some() {
            return;
        }
        let radiance = self.environment.radiance(self.scene, &self.materials, direction, is_camera);
        if radiance != Vec3::ZERO {
            let weight = self
                .lights
                .as_ref()
                .map_or(1.0, |lights| lights.world_weight(last, &self.environment, direction));
            features.sample.world += path.throughput * radiance * weight;
        }
    }

    fn collect_emission(
        &self,
        path: &PathState,
        point: &SurfacePoint,
        last: Option<LastBounce>,
        surface: &Surface,
        features: &mut Features,
    ) {
        let emission = surface.emission();
        if emission != Vec3::ZERO {
            let weight = self.lights.as_ref().map_or(1.0, |lights| lights.emission_weight(last, point));
            features.sample.emission += path.throughput * emission * weight;
        }
    }

    /// Sends the path on from a surface, or says that it ends there.
    fn scatter(
        &self,
        path: &mut PathState,
        point: &SurfacePoint,
        u: [f32; 3],
        guide: Option<&Guide>,
        ray: &mut Ray,
        scratch: &mut PathScratch,
        features: &mut Features,
        last: &mut Option<LastBounce>,
        draws: Draws,
        sink: &mut impl PathSink,
    ) -> bool {
        let limits = &self.settings.bounces;
        let surface = &mut scratch.surface;
        if path.is_last_surface() {
            let through = surface.transparency();
            features.record_surface(surface);
            path.pass_through(through, limits);
            offset_origin(ray, point);
            ray.t_max = f32::INFINITY;
            return through.max_element() > 0.0;
        }
        self.filter_closures(path, surface);
        let cones = match guide {
            Some(guide) if surface.is_guided() => {
                guide.fill_cones(point.position, surface.horizon(), &mut scratch.cones);
                Some(&scratch.cones).filter(|cones| cones.share > 0.0)
            }
            _ => None,
        };
        if let Some(lights) = &self.lights {
            let shadow_tracer = ShadowTracer {
                scene: self.scene,
                bvh: &self.bvh,
                materials: &self.materials,
                environment: &self.environment,
                cones,
                transparent_left: path.transparent_left(limits),
            };
            let on_film = path.throughput * self.settings.film_exposure;
            match lights.sample_direct(
                &shadow_tracer,
                point,
                surface,
                &mut scratch.shadow,
                on_film,
                draws.at(1),
            ) {
                Some(StaticSample::Emission(light)) => features.sample.emission += path.throughput * light,
                Some(StaticSample::World(light)) => features.sample.world += path.throughput * light,
                None => {}
            }
        }
        if let Some(entry) = surface.enters(u[2]) {
            features.record_surface(surface);
            let Some((exit, draws)) = self.cross_body(path, point, &entry, draws, surface) else {
                return false;
            };
            // Lights inside the body do not count: this only leads to where the next segment starts.
            let (end, throughput) = (End::Vertex(exit.position), Vec3::ZERO);
            let receiver = self.scene.instances[point.instance as usize].receiver;
            sink.push(Segment { end, throughput, lobe: Lobe::Diffuse, receiver, continues: false });
            let [u0, u1, u2, _] = draws.at(0);
            return self.scatter(path, &exit, [u0, u1, u2], guide, ray, scratch, features, last, draws, sink);
        }
        let Some((sample, pdf)) = direction(surface, cones, u, || draws.at(GUIDE_GROUP)) else {
            features.record_surface(surface);
            return false;
        };
        if sample.transparent {
            features.attenuate(sample.weight);
            path.pass_through(sample.weight, limits);
        } else {
            if surface.is_specular() {
                features.attenuate(sample.weight);
            } else {
                features.record_surface(surface);
            }
            path.scatter(&sample, limits);
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
        ray.lobe = path.lobe;
        ray.t_max = f32::INFINITY;
        true
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
    let pdf = cones.pdf_with(surface, sample.pdf, sample.wi);
    sample.weight *= sample.pdf / pdf;
    Some((sample, pdf))
}

impl Features {
    /// The path goes on behind a mirror, glass or a transparent surface.
    fn attenuate(&mut self, weight: Vec3) {
        if let Some(tint) = &mut self.tint {
            *tint *= weight;
        }
    }

    /// Takes albedo and normal from the first surface that is not specular.
    fn record_surface(&mut self, surface: &Surface) {
        if let Some(tint) = self.tint.take() {
            self.sample.albedo = (tint * surface.albedo()).clamp(Vec3::ZERO, Vec3::ONE);
            self.sample.normal = surface.normal();
        }
    }
}
