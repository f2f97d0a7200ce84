//! Vertices that lights can be connected to.

use std::sync::Arc;

use glam::Vec3;
use relume_dump::Sight;

use super::{Integrator, Walk, travel::Route};
use crate::{
    bsdf::Surface,
    bvh::Ray,
    connect::{HomogeneousFlight, PathAtVertex, PathVertex},
    media::{Media, MediumSample},
    path::PathState,
    shading::SurfacePoint,
};

impl Integrator<'_> {
    /// The vertex of a path on a surface, if lights count there and can be connected to it.
    pub(super) fn surface_vertex(
        &self,
        path: &PathState,
        route: Option<&Route>,
        point: &SurfacePoint,
        surface: &Surface,
    ) -> Option<PathVertex> {
        let receiver = self.scene.instances[point.instance as usize].receiver;
        let arrival = self.arrival_of(path, route, receiver)?;
        PathVertex::on_surface((self.scene, &self.materials), &arrival, (point, surface))
    }

    /// The vertex of a path at a collision in some media, if lights count there.
    pub(super) fn medium_vertex(
        &self,
        walk: &Walk,
        position: Vec3,
        medium: &MediumSample,
    ) -> Option<PathVertex> {
        let (media, route) = (self.media.as_ref()?, walk.route.as_ref()?);
        let arrival = self.arrival_of(&walk.path, Some(route), media.receiver(&route.stack))?;
        let Ray { origin, direction, time, .. } = walk.ray;
        let homogeneous = media.homogeneous(&route.stack);
        let flight = homogeneous
            .is_some()
            .then(|| HomogeneousFlight { distance: origin.distance(position), length: route.flight });
        let medium = homogeneous.unwrap_or_else(|| Arc::new(medium.clone()));
        Some(PathVertex::in_medium(&arrival, (position, time), (direction, medium, flight)))
    }

    /// The present flight of a path, if it may scatter there, and the media scatter and are homogeneous.
    pub(super) fn flight_vertex(&self, walk: &Walk, media: &Media) -> Option<PathVertex> {
        if walk.path.survival(&self.settings.bounces) == 0.0 {
            return None;
        }
        let route = walk.route.as_ref()?;
        let homogeneous =
            media.homogeneous(&route.stack).filter(|homogeneous| homogeneous.scattering != Vec3::ZERO)?;
        let arrival = self.arrival_of(&walk.path, Some(route), media.receiver(&route.stack))?;
        let Ray { origin, direction, time, .. } = walk.ray;
        Some(PathVertex::on_flight(&arrival, (origin, time), (direction, homogeneous, route.flight)))
    }

    /// State in which a path comes to a vertex; nothing if lights do not count there.
    fn arrival_of<'p>(
        &self,
        path: &'p PathState,
        route: Option<&'p Route>,
        receiver: u16,
    ) -> Option<PathAtVertex<'p>> {
        let (limits, ray) = (&self.settings.bounces, path.ray_info());
        if ray.transparent_depth > limits.transparent {
            return None;
        }
        let class = self.classes.as_ref().map_or(0, |classes| classes.offset(Sight::Shadow, ray.depth));
        let outside = self.media.as_ref().map(|media| media.outside());
        let around = route.map(|route| &route.stack).filter(|stack| outside.as_ref() != Some(stack));
        Some(PathAtVertex {
            path,
            weight: path.throughput * self.settings.film_exposure,
            receiver: receiver + class,
            transparent_left: path.transparent_left(limits),
            around,
        })
    }
}
