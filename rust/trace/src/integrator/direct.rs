//! Light of the scene's own emitters, by light samples.

use super::{Features, Integrator, Route, SHADOW_GROUP};
use crate::{
    bsdf::Surface,
    guide::Cones,
    media::{HullCrossing, MediaScratch, ShadowMedia, TrackingNumbers},
    path::PathState,
    sampler::Draws,
    static_light::{ShadowTracer, StaticSample},
    vertex::Vertex,
};

impl Integrator<'_> {
    /// Adds light that comes straight from the scene's own emitters to a vertex.
    pub(super) fn add_static_light(
        &self,
        path: &PathState,
        route: Option<&Route>,
        vertex: Vertex<'_>,
        cones: Option<&Cones>,
        shadow: &mut Surface,
        scratch: &mut MediaScratch,
        features: &mut Features,
        draws: Draws,
    ) {
        let Some(lights) = &self.lights else { return };
        let media = match (&self.media, route) {
            (Some(media), Some(route)) => Some(ShadowMedia {
                space: self.space(media, vertex.time(), path.ray_info().shadow_from(vertex.position())),
                stack: route.stack,
                crossing: HullCrossing::default(),
                numbers: TrackingNumbers::new(draws.at(SHADOW_GROUP)),
                scratch,
            }),
            _ => None,
        };
        let receiver = match (vertex, &self.media, route) {
            (Vertex::Surface { point, .. }, ..) => self.scene.instances[point.instance as usize].receiver,
            (Vertex::Medium { .. }, Some(media), Some(route)) => media.receiver(&route.stack),
            _ => path.receiver,
        };
        let mut tracer = ShadowTracer {
            scene: self.scene,
            bvh: &self.bvh,
            materials: &self.materials,
            environment: &self.environment,
            ray: path.ray_info(),
            receiver,
            cones,
            transparent_left: path.transparent_left(&self.settings.bounces),
            media,
        };
        let on_film = path.throughput * self.settings.film_exposure;
        match lights.sample_direct(&mut tracer, vertex, shadow, on_film, draws.at(1)) {
            Some(StaticSample::Emission(light)) => features.sample.emission += path.throughput * light,
            Some(StaticSample::World(light)) => features.sample.world += path.throughput * light,
            None => {}
        }
    }
}
