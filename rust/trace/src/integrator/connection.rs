//! Vertices that lights can be connected to.

use relume_dump::Sight;

use super::Integrator;
use crate::{bsdf::Surface, connect::PathVertex, path::PathState, shading::SurfacePoint};

impl Integrator<'_> {
    /// The vertex of a path on a surface, if lights count there and can be connected to it.
    pub(super) fn path_vertex(
        &self,
        path: &PathState,
        point: &SurfacePoint,
        surface: &Surface,
    ) -> Option<PathVertex> {
        let (limits, ray) = (&self.settings.bounces, path.ray_info());
        if ray.transparent_depth > limits.transparent {
            return None;
        }
        let class = self.classes.as_ref().map_or(0, |classes| classes.offset(Sight::Shadow, ray.depth));
        let receiver = self.scene.instances[point.instance as usize].receiver + class;
        let weight = path.throughput * self.settings.film_exposure;
        let parts = (self.scene, &self.materials);
        PathVertex::new(parts, limits, path, (weight, receiver), (point, surface))
    }
}
