//! Light of the scene's own emitters and world along a path.

use glam::Vec3;
use relume_dump::Lobe;

use super::{Features, Integrator, SHADOW_GROUP, travel::Route};
use crate::{
    bsdf::Surface,
    guide::Cones,
    media::{HullCrossing, MediaScratch, ShadowMedia, TrackingNumbers},
    path::PathState,
    sampler::Draws,
    settings::FastGi,
    shading::SurfacePoint,
    static_light::{LastBounce, ShadowTracer, StaticSample},
    vertex::Vertex,
};

/// Added to a vertex's first group: numbers of the light that Fast GI adds.
const OPEN_GROUP: u32 = 5 << 29;

/// Vertex of a path where light of the scene's own emitters arrives.
#[derive(Clone, Copy)]
pub(super) struct LitVertex<'a> {
    pub path: &'a PathState,
    /// Place among the media of the scene, if it has any.
    pub route: Option<&'a Route>,
    pub vertex: Vertex<'a>,
    /// Cones towards lights, where paths are guided from there.
    pub cones: Option<&'a Cones>,
}

impl Integrator<'_> {
    /// Adds what a surface that the path met emits.
    pub(super) fn collect_emission(
        &self,
        path: &PathState,
        point: &SurfacePoint,
        last: Option<LastBounce>,
        surface: &Surface,
        features: &mut Features,
    ) {
        let emission = surface.emission();
        let links = self.scene.instances[point.instance as usize].links.as_deref();
        let is_unlit = links.is_some_and(|links| path.lobe != Lobe::Camera && !links.light(path.receiver));
        if emission != Vec3::ZERO && !is_unlit {
            let weight =
                self.lights.as_ref().map_or(1.0, |lights| lights.emission_weight(last, self.scene, point));
            features.sample.emission += path.throughput * emission * weight;
        }
    }

    /// Adds light that comes straight from the scene's own emitters to a vertex. `shadow` and `scratch` are memory for what shadow rays
    /// meet.
    pub(super) fn add_static_light(
        &self,
        at: LitVertex<'_>,
        (shadow, scratch): (&mut Surface, &mut MediaScratch),
        features: &mut Features,
        draws: Draws,
    ) {
        let Some(lights) = &self.lights else { return };
        let LitVertex { path, vertex, .. } = at;
        let mut tracer = self.shadow_tracer(at, scratch, draws.at(SHADOW_GROUP));
        let on_film = path.throughput * self.settings.film_exposure;
        match lights.sample_direct(&mut tracer, vertex, shadow, on_film, draws.at(1)) {
            Some(StaticSample::Emission(light)) => features.sample.emission += path.throughput * light,
            Some(StaticSample::World(light)) => features.sample.world += path.throughput * light,
            None => {}
        }
        if let Some(FastGi::Add { distance, factor }) = self.settings.fast_gi
            && !path.catchers_only
        {
            let [u, v, ..] = draws.at(OPEN_GROUP);
            let mut tracer = self.shadow_tracer(at, scratch, draws.at(OPEN_GROUP + 1));
            let light = lights.sample_open(&mut tracer, vertex, distance, shadow, [u, v]);
            features.sample.emission += path.throughput * light.unwrap_or(Vec3::ZERO) * factor;
        }
    }

    /// Scene access of a shadow ray from a vertex, with numbers for media on its way.
    fn shadow_tracer<'s>(
        &'s self,
        LitVertex { path, route, vertex, cones }: LitVertex<'s>,
        scratch: &'s mut MediaScratch,
        numbers: [f32; 4],
    ) -> ShadowTracer<'s> {
        let media = match (&self.media, route) {
            (Some(media), Some(route)) => Some(ShadowMedia {
                space: self.space(media, vertex.time(), path.ray_info().shadow_from(vertex.position())),
                stack: route.stack,
                crossing: HullCrossing::default(),
                numbers: TrackingNumbers::new(numbers),
                scratch,
            }),
            _ => None,
        };
        let receiver = match (vertex, &self.media, route) {
            (Vertex::Surface { point, .. }, ..) => self.scene.instances[point.instance as usize].receiver,
            (Vertex::Medium { .. }, Some(media), Some(route)) => media.receiver(&route.stack),
            _ => path.receiver,
        };
        ShadowTracer {
            scene: self.scene,
            bvh: &self.bvh,
            materials: &self.materials,
            environment: &self.environment,
            see_through: &self.see_through,
            ray: path.ray_info(),
            receiver,
            cones,
            transparent_left: path.transparent_left(&self.settings.bounces),
            catchers_only: path.catchers_only,
            media,
        }
    }
}
