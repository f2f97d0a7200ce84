//! Nodes of hair: their closures, and what they read of a strand.

use glam::Vec3;
use relume_scene::{HairComponent, HairModel, HairPigment, Node, PrincipledHair};

use super::coordinates::footprint_axes;
use super::evaluate::{Known, ShadingContext};
use super::strands;
use super::values::NodeInputs;
use crate::bsdf::{
    Chiang, ChiangParameters, Fibre, Hair, HairLobe, HairSide, Huang, HuangParameters, Scatter, Surface,
    absorption_of_color, absorption_of_melanin,
};

/// Adds the closure of a Principled Hair node.
pub fn add_principled(
    node: &PrincipledHair,
    context: &ShadingContext,
    known: &Known,
    weight: f32,
    surface: &mut Surface,
) {
    let (wo, weight) = (context.point.wo, Vec3::splat(weight));
    let fibre = context.fibre();
    let Pigmented { roughness, radial_roughness, absorption } = Pigmented::read(node, known);
    let (ior, tilt) = (known.float(&node.ior), known.float(&node.offset));
    match node.model {
        HairModel::Chiang => {
            let coat = known.float(&node.coat);
            let parameters = ChiangParameters { roughness, radial_roughness, coat, ior, tilt, absorption };
            push(surface, context, weight, Hair::Chiang(Chiang::new(fibre, &parameters, wo)));
        }
        HairModel::Huang => {
            let factors = [&node.reflection, &node.transmission, &node.secondary_reflection];
            let parameters = HuangParameters {
                roughness,
                aspect_ratio: known.float(&node.aspect_ratio),
                major: context.major_axis(),
                ior,
                tilt,
                absorption,
                factors: factors.map(|factor| known.float(factor)),
                coverage: context.coverage(),
            };
            match Huang::new(fibre, &parameters, wo) {
                Some(hair) => push(surface, context, weight, Hair::Huang(hair)),
                // The ray passes beside the ellipse.
                None => surface.add_transparent(weight),
            }
        }
    }
}

/// Adds the closure of a Hair BSDF node.
pub fn add_lobe(node: &Node, context: &ShadingContext, known: &Known, weight: f32, surface: &mut Surface) {
    let Node::HairBsdf { component, color, offset, roughness_u, roughness_v, tangent } = node else { return };
    let point = context.point;
    let side = match component {
        HairComponent::Reflection => HairSide::Reflection,
        HairComponent::Transmission => HairSide::Transmission,
    };
    let (tangent, offset) = match (tangent, &point.strand) {
        (Some(tangent), _) => (known.vector(tangent), known.float(offset)),
        (None, Some(strand)) => (strand.tangent, known.float(offset)),
        // On meshes, Cycles takes the triangle's other edge, and no offset.
        (None, None) => (context.edges()[1], 0.0),
    };
    let fibre = Fibre::new(tangent, point.shading_normal, point.wo);
    let roughness = (known.float(roughness_u), known.float(roughness_v));
    let lobe = HairLobe::new(fibre, point.shading_normal, side, offset, roughness, point.wo);
    push(surface, context, known.vector(color) * weight, Hair::Lobe(lobe));
}

fn push(surface: &mut Surface, context: &ShadingContext, weight: Vec3, hair: Hair) {
    surface.add(weight, hair.albedo(), context.point.shading_normal, Scatter::Hair(hair));
}

/// Settings that a strand's random number changes.
struct Pigmented {
    roughness: f32,
    radial_roughness: f32,
    absorption: Vec3,
}

impl Pigmented {
    fn read(node: &PrincipledHair, known: &Known) -> Self {
        let (point, scene) = (known.context.point, known.context.scene);
        let own = || point.strand_random(scene).unwrap_or(0.0);
        let random = node.random.as_ref().map_or_else(own, |random| known.float(random));
        let varied = |by: f32| 1.0 + 2.0 * (random - 0.5) * by;
        let roughness_factor = varied(known.float(&node.random_roughness));
        let roughness = known.float(&node.roughness) * roughness_factor;
        let radial_roughness = match node.model {
            HairModel::Chiang => known.float(&node.radial_roughness) * roughness_factor,
            HairModel::Huang => roughness,
        };
        let absorption = match node.pigment {
            HairPigment::Absorption => known.vector(&node.absorption_coefficient),
            HairPigment::Color => absorption_of_color(known.vector(&node.color), radial_roughness),
            HairPigment::Melanin => {
                let amount =
                    known.float(&node.melanin) * varied(known.float(&node.random_color).clamp(0.0, 1.0));
                absorption_of_melanin(amount, known.float(&node.melanin_redness))
                    + absorption_of_color(known.vector(&node.tint), radial_roughness)
            }
        };
        Self { roughness, radial_roughness, absorption }
    }
}

impl ShadingContext<'_> {
    /// Fibre that the point is on. On meshes, Cycles takes a triangle's edge for the tangent.
    fn fibre(&self) -> Fibre {
        let point = self.point;
        match &point.strand {
            Some(strand) => Fibre::new(strand.tangent, point.shading_normal, point.wo),
            None => Fibre::new(self.edges()[0], point.geometric_normal, point.wo),
        }
    }

    /// Direction in which elliptical hair is wide: the curve's normal, or any that does not turn along the curve. As in
    /// Cycles, an object's rotation does not turn the normals. Nothing on meshes, where it is across the ray.
    fn major_axis(&self) -> Vec3 {
        let Some(strand) = &self.point.strand else { return Vec3::ZERO };
        strands::normal(self).unwrap_or_else(|| footprint_axes(strand.tangent.normalize_or_zero()).1)
    }

    /// Half of what a pixel covers of the strand, in units of its radius; all of it for rays that do not come from the camera,
    /// as in Cycles.
    fn coverage(&self) -> f32 {
        match &self.point.strand {
            Some(strand) if self.point.ray.is_camera => 0.5 * self.point.footprint / strand.radius,
            _ => 1.0,
        }
    }

    /// Unit direction to the ray's origin, as far as it is across the strand; nothing on other geometry.
    pub fn tangent_normal(&self) -> Vec3 {
        let Some(strand) = &self.point.strand else { return Vec3::ZERO };
        let along = strand.tangent.normalize_or_zero();
        (self.point.wo - along * along.dot(self.point.wo)).normalize_or_zero()
    }

    /// Edges from the triangle's first corner, in world space, turned over where its back is seen.
    fn edges(&self) -> [Vec3; 2] {
        let Some(mesh) = self.mesh() else { return [Vec3::X; 2] };
        let [a, b, c] = mesh.corners_at(self.point.primitive as usize, self.point.time);
        let side = if self.point.backfacing { -1.0 } else { 1.0 };
        [b - a, c - a].map(|edge| self.world_from_object().transform_vector3(edge) * side)
    }
}
