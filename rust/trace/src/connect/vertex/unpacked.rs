//! A vertex as its connections to lights read it.

use glam::Vec3;
use relume_dump::{ByConnectedLobe, decode_direction, decode_rgb9e5};

use super::{PathVertex, SurfaceParts, VertexPlace};
use crate::{
    bsdf::{SampleReach, SideNormals, lambert},
    bvh::{Ray, RayKind},
};

/// A [`PathVertex`] whose values are unpacked, once for all lights that are connected to it.
#[derive(Clone, Debug)]
pub struct UnpackedVertex<'a> {
    /// The vertex.
    pub packed: &'a PathVertex,
    lobes: ByConnectedLobe<bool>,
    /// Weight on the film of what Lambert's closures reflect or a medium scatters.
    weight: Vec3,
    /// Normals of the surface, of no meaning in a medium.
    sides: SideNormals,
    /// Unit normal about which it reflects, of no meaning in a medium.
    normal: Vec3,
}

impl<'a> UnpackedVertex<'a> {
    /// Unpacks a vertex.
    pub fn new(packed: &'a PathVertex) -> Self {
        let geometric = decode_direction(packed.geometric);
        // Most surfaces are flat, or have no bumps.
        let known = |bits: u32, (known, normal): (u32, Vec3)| match bits == known {
            true => normal,
            false => decode_direction(bits),
        };
        let shading = known(packed.shading, (packed.geometric, geometric));
        let normal = known(packed.normal, (packed.shading, shading));
        Self {
            packed,
            lobes: packed.lobes(),
            weight: decode_rgb9e5(packed.weight),
            sides: SideNormals { geometric, shading },
            normal,
        }
    }

    /// True for each of [`relume_dump::Lobe::CONNECTED`] by which it scatters.
    pub fn lobes(&self) -> ByConnectedLobe<bool> {
        self.lobes
    }

    /// Unit normal of the only half space that it scatters light from; none where there is no such.
    pub fn normal(&self) -> Option<Vec3> {
        let is_open = |parts: &SurfaceParts| parts.transmits || !parts.has_one_normal;
        let has_none = self.packed.medium().is_some() || self.packed.surface().is_some_and(is_open);
        (!has_none).then_some(self.normal)
    }

    /// Contribution to the pixel at a place of it of light from the unit direction `wi`, of radiance `factors` per steradian for each of
    /// [`relume_dump::Lobe::CONNECTED`], if nothing is in between, and the ray that tells whether something is; nothing where none is scattered.
    pub(in crate::connect) fn scatter(
        &self,
        place: VertexPlace,
        wi: Vec3,
        factors: ByConnectedLobe<f32>,
    ) -> Option<(Vec3, Ray)> {
        let PathVertex { time, catchers_only, .. } = *self.packed;
        let (scattered, ray) = match self.packed.medium() {
            Some((medium, travel)) => {
                let (value, _) = medium.eval(travel, wi);
                (factors[2] * self.weight * place.factor * value, Ray::new(place.position, wi))
            }
            None => (self.scattered(wi, factors), self.ray_towards(wi)?),
        };
        let is_some = scattered.max_element() > 0.0 && scattered.is_finite();
        is_some.then(|| (scattered, Ray { kind: RayKind::Shadow, catchers_only, ..ray.at(time) }))
    }

    /// Light from the unit direction `wi` that a surface scatters, see [`Self::scatter`].
    fn scattered(&self, wi: Vec3, factors: ByConnectedLobe<f32>) -> Vec3 {
        let (sides, PathVertex { bumps, .. }) = (self.sides, self.packed);
        let mut scattered = Vec3::ZERO;
        if self.packed.weight != 0 && factors[0] != 0.0 && sides.reach(wi, false).is_some() {
            scattered = self.weight * (factors[0] * lambert(*bumps, sides.shading, self.normal, wi));
        }
        let Some(parts) = self.packed.surface() else { return scattered };
        for closure in &parts.closures {
            let factor = closure.light_lobe(wi).connected_number().map_or(0.0, |lobe| factors[lobe]);
            if factor != 0.0 && closure.is_lit(sides, wi) {
                let (value, _) = parts.viewpoint.eval(closure, sides.shading, wi);
                scattered += closure.weight * value * factor;
            }
        }
        scattered
    }

    /// A ray from the surface in the unit direction `wi`; nothing where none is scattered.
    fn ray_towards(&self, wi: Vec3) -> Option<Ray> {
        let (sides, vertex) = (self.sides, self.packed);
        let parts = vertex.surface();
        let (side, lifted) = match sides.reach(wi, false) {
            Some(SampleReach::Lights) => (-sides.geometric, parts.and_then(|parts| parts.between)),
            Some(_) => (sides.geometric, None),
            None if parts.is_some_and(|parts| parts.transmits) => (-sides.geometric, None),
            None => return None,
        };
        let origin = lifted.unwrap_or(vertex.position + side * vertex.offset);
        Some(Ray { from: lifted.is_none().then_some(vertex.primitive), ..Ray::new(origin, wi) })
    }

    /// The triangle that light from the unit direction `wi` comes through, if that is behind the surface, and whether the path came
    /// from there.
    pub(in crate::connect) fn comes_through(&self, wi: Vec3) -> Option<((u32, u32), bool)> {
        let parts = self.packed.surface()?;
        self.sides.reach(wi, false).is_none().then_some((self.packed.primitive, parts.backfacing))
    }
}
