//! Conversion of closure nodes to closures, with Cycles' mixing and layering.

use std::f32::consts::TAU;

use glam::{Quat, Vec3, Vec4};
use relume_scene::{
    Distribution, MetalFresnel, MultipleScattering, Node, NodeId, SheenModel, ThinFilm, ToonComponent,
};

use super::evaluate::{Known, ShadingContext};
use super::graph::Aid;
use super::hair;
use super::principled::{self, Parameters};
use super::subsurface::{self, BodyParameters};
use super::values::NodeInputs;
use crate::bsdf::{
    AshikhminShirley, Compensation, Conductor, F82, Film, Fresnel, Interface, Microfacet,
    MicrofacetDistribution, OrenNayar, Portal, Scatter, ShadingFrame, Sheen, SlopeDistribution, Surface,
    Toon, Velvet, ensure_valid_reflection, f0_from_ior,
};

/// Adds the closures of `node` and of those below it, `weight` of them.
pub fn shade(
    context: &ShadingContext,
    node: NodeId,
    weight: f32,
    values: &mut [Vec4],
    scratch: &mut [Vec4],
    surface: &mut Surface,
) {
    context.run(&context.graph.needs[node as usize], values, scratch);
    let known = Known { context, values };
    match &context.graph.nodes[node as usize] {
        Node::MixShader { factor, a, b } => {
            let factor = known.float(factor).clamp(0.0, 1.0);
            if let Some(a) = a
                && factor < 1.0
            {
                shade(context, *a, weight * (1.0 - factor), values, scratch, surface);
            }
            if let Some(b) = b
                && factor > 0.0
            {
                shade(context, *b, weight * factor, values, scratch, surface);
            }
        }
        Node::AddShader { a, b } => {
            for child in [a, b].into_iter().flatten() {
                shade(context, *child, weight, values, scratch, surface);
            }
        }
        principled @ Node::Principled { .. } => match &context.graph.aids[node as usize] {
            Aid::Parameters(parameters) => principled::add(principled, parameters, &known, weight, surface),
            _ => {
                if let Some(parameters) = Parameters::read(principled, &known) {
                    principled::add(principled, &parameters, &known, weight, surface);
                }
            }
        },
        Node::PrincipledHair(hair) => hair::add_principled(hair, context, &known, weight, surface),
        lobe @ Node::HairBsdf { .. } => hair::add_lobe(lobe, context, &known, weight, surface),
        reflecting @ (Node::Glossy { .. }
        | Node::Metallic { .. }
        | Node::Glass { .. }
        | Node::Refraction { .. }) => {
            add_interface(context, reflecting, weight, &known, surface);
        }
        simple => add_simple(context, simple, weight, &known, surface),
    }
}

fn add_simple(context: &ShadingContext, node: &Node, weight: f32, known: &Known, surface: &mut Surface) {
    let point = context.point;
    match node {
        Node::Diffuse { color, roughness, multiple_scattering, normal } => {
            let (color, normal) = (known.vector(color), known.normal(normal));
            let scatter = diffuse(normal, known.float(roughness), color, *multiple_scattering, point.wo);
            surface.add(color * weight, Vec3::ONE, normal, scatter);
        }
        Node::SingleScatteringDiffuse { color, roughness, normal } => {
            let (color, normal) = (known.vector(color), known.normal(normal));
            // Of black, nothing is scattered twice.
            let scatter =
                diffuse(normal, known.float(roughness), Vec3::ZERO, MultipleScattering::Full, point.wo);
            surface.add(color * weight, Vec3::ONE, normal, scatter);
        }
        Node::Sheen { model, color, roughness, normal } => {
            let (normal, roughness) = (known.normal(normal), known.float(roughness));
            let (scatter, albedo) = match model {
                SheenModel::Ashikhmin => (Scatter::Velvet(Velvet::new(normal, roughness)), 1.0),
                SheenModel::Microfiber => {
                    let Some((sheen, albedo)) = Sheen::new(normal, roughness, point.wo) else { return };
                    (Scatter::Sheen(sheen), albedo)
                }
            };
            surface.add(known.vector(color) * (albedo * weight), Vec3::ONE, normal, scatter);
        }
        Node::Toon { component, color, size, smooth, normal } => {
            let (normal, [size, smooth]) =
                (known.normal(normal), [size, smooth].map(|input| known.float(input)));
            let toon = match component {
                ToonComponent::Diffuse => Toon::diffuse(normal, size, smooth),
                ToonComponent::Glossy => Toon::glossy(normal, size, smooth, point.wo),
            };
            if let Some(toon) = toon {
                surface.add(known.vector(color) * weight, Vec3::ONE, normal, Scatter::Toon(toon));
            }
        }
        Node::Translucent { color, normal } => {
            let normal = context.specular_normal(known.normal(normal));
            surface.add(known.vector(color) * weight, Vec3::ONE, normal, Scatter::Translucent);
        }
        Node::SubsurfaceScattering { color, roughness, normal, subsurface } => {
            let color = known.vector(color);
            let body = BodyParameters::read(subsurface, known);
            let boundary = subsurface::Boundary {
                normal: context.specular_normal(known.normal(normal)),
                alpha: known.float(roughness).clamp(0.0, 1.0),
                ior: body.ior,
            };
            subsurface::add(&body, color * weight, color, &boundary, point, surface);
        }
        Node::RayPortal { color, position, direction } => {
            let position = position.as_ref().map_or(point.position, |input| known.vector(input));
            let direction = known.vector(direction).normalize_or(-point.wo);
            let scatter = Scatter::Portal(Portal { position, direction });
            surface.add(known.vector(color) * weight, Vec3::ONE, point.shading_normal, scatter);
        }
        Node::Transparent { color } => surface.add_transparent(known.vector(color) * weight),
        Node::Holdout => surface.add_holdout(weight),
        Node::Emission { color, strength } => {
            surface.add_emission(known.vector(color) * (known.float(strength) * weight));
        }
        _ => {}
    }
}

/// Adds reflection and refraction by microfacets.
fn add_interface(context: &ShadingContext, node: &Node, weight: f32, known: &Known, surface: &mut Surface) {
    let point = context.point;
    match node {
        Node::Glossy { color, roughness, anisotropy, rotation, normal, tangent, distribution } => {
            let color = known.vector(color).max(Vec3::ZERO);
            let alpha = known.float(roughness).clamp(0.0, 1.0).powi(2);
            let normal = context.specular_normal(known.normal(normal));
            let (frame, alphas) = stretched(alpha, known.float(anisotropy), normal, || {
                turned(known.tangent(tangent), normal, known.float(rotation))
            });
            add_glossy(surface, color, weight, *distribution, normal, frame, alphas);
        }
        Node::Metallic {
            fresnel,
            base_color,
            edge_tint,
            ior,
            extinction,
            roughness,
            anisotropy,
            rotation,
            normal,
            tangent,
            distribution,
            film,
        } => {
            let film = read_film(film, known);
            let unit = |input| known.vector(input).clamp(Vec3::ZERO, Vec3::ONE);
            let (fresnel, mean) = match fresnel {
                MetalFresnel::F82 => {
                    let metal = F82::new(unit(base_color), unit(edge_tint));
                    (Fresnel::Metal(metal, film), metal.mean())
                }
                MetalFresnel::PhysicalConductor => {
                    let [ior, extinction] =
                        [ior, extinction].map(|input| known.vector(input).max(Vec3::ZERO));
                    let metal = Conductor { ior, extinction };
                    (Fresnel::Conductor(metal, film), metal.as_f82().mean())
                }
            };
            let normal = context.specular_normal(known.normal(normal));
            let anisotropy = known.float(anisotropy).clamp(0.0, 1.0);
            let tangent = if anisotropy > 0.0 {
                turned(known.tangent(tangent), normal, known.float(rotation))
            } else {
                Vec3::ZERO
            };
            let (frame, facets) = facets(known.float(roughness).clamp(0.0, 1.0), anisotropy, normal, tangent);
            let model = Microfacet {
                distribution: MicrofacetDistribution { shape: slopes(*distribution), ..facets },
                interface: Interface::Reflection,
                ior: 1.0,
                fresnel,
                frame,
                energy_scale: 1.0,
            };
            let mean = (*distribution == Distribution::MultiGgx).then_some(mean);
            add_microfacet(surface, Vec3::splat(weight), normal, model, mean);
        }
        Node::Glass { color, roughness, ior, normal, distribution, anisotropy, rotation, tangent, film } => {
            let color = known.vector(color).max(Vec3::ZERO);
            let ior = known.float(ior).max(1e-5);
            let alpha = known.float(roughness).clamp(0.0, 1.0).powi(2);
            let normal = context.specular_normal(known.normal(normal));
            let film = read_film(film, known);
            let fresnel = Fresnel::Tinted {
                f0: Vec3::splat(f0_from_ior(ior)),
                reflection: color,
                transmission: color,
                film: if point.backfacing { film.map(|film| film.from_within(ior)) } else { film },
            };
            let ior = if point.backfacing { 1.0 / ior } else { ior };
            let anisotropy = anisotropy.map_or(0.0, |input| known.float(&input));
            let rotation = rotation.map_or(0.0, |input| known.float(&input));
            let (frame, (alpha_x, alpha_y)) =
                stretched(alpha, anisotropy, normal, || turned(known.tangent(tangent), normal, rotation));
            let [alpha_x, alpha_y] = [alpha_x, alpha_y].map(|alpha| alpha.clamp(0.0, 1.0));
            let model = Microfacet {
                distribution: MicrofacetDistribution { alpha_x, alpha_y, ..isotropic(*distribution, alpha) },
                interface: Interface::Glass,
                ior,
                fresnel,
                frame,
                energy_scale: 1.0,
            };
            let mean = (*distribution == Distribution::MultiGgx).then_some(color);
            add_microfacet(surface, Vec3::splat(weight), normal, model, mean);
        }
        Node::Refraction { color, roughness, ior, normal, distribution } => {
            let ior = known.float(ior).max(1e-5);
            let normal = context.specular_normal(known.normal(normal));
            let model = Microfacet {
                distribution: isotropic(*distribution, known.float(roughness).powi(2).clamp(0.0, 1.0)),
                interface: Interface::Refraction,
                ior: if point.backfacing { 1.0 / ior } else { ior },
                fresnel: Fresnel::None,
                frame: ShadingFrame::from_normal(normal),
                energy_scale: 1.0,
            };
            add_microfacet(surface, known.vector(color) * weight, normal, model, None);
        }
        _ => {}
    }
}

/// Tangents and the widths along them of facets of mean width `alpha`, by the anisotropy of Glossy and Glass BSDF.
fn stretched(
    alpha: f32,
    anisotropy: f32,
    normal: Vec3,
    tangent: impl FnOnce() -> Vec3,
) -> (ShadingFrame, (f32, f32)) {
    let anisotropy = anisotropy.clamp(-0.99, 0.99);
    if anisotropy.abs() <= 1e-4 {
        return (ShadingFrame::from_normal(normal), (alpha, alpha));
    }
    let stretch = if anisotropy < 0.0 { 1.0 / (1.0 + anisotropy) } else { 1.0 - anisotropy };
    (ShadingFrame::from_tangent(normal, tangent()), (alpha * stretch, alpha / stretch))
}

/// The film of a node; nothing if it has none.
pub fn read_film(film: &Option<ThinFilm>, inputs: &impl NodeInputs) -> Option<Film> {
    let film = film.as_ref()?;
    Film::new(inputs.float(&film.thickness), inputs.float(&film.ior).max(1e-5), film.model)
}

fn add_glossy(
    surface: &mut Surface,
    color: Vec3,
    weight: f32,
    distribution: Distribution,
    normal: Vec3,
    frame: ShadingFrame,
    (alpha_x, alpha_y): (f32, f32),
) {
    if distribution == Distribution::AshikhminShirley {
        let model = AshikhminShirley::new(frame, alpha_x, alpha_y);
        surface.add(color * weight, Vec3::ONE, normal, Scatter::AshikhminShirley(model));
        return;
    }
    let (alpha_x, alpha_y) = (alpha_x.clamp(0.0, 1.0), alpha_y.clamp(0.0, 1.0));
    let model = Microfacet {
        distribution: MicrofacetDistribution { alpha_x, alpha_y, ..isotropic(distribution, 0.0) },
        interface: Interface::Reflection,
        ior: 1.0,
        fresnel: Fresnel::None,
        frame,
        energy_scale: 1.0,
    };
    let mean = (distribution == Distribution::MultiGgx).then_some(color);
    add_microfacet(surface, color * weight, normal, model, mean);
}

/// Adds a microfacet closure, with the energy of multiple scattering if `mean`, the mean colour of a bounce, is given;
/// returns its reflected albedo, weight included, or 0 if it was dropped.
pub fn add_microfacet(
    surface: &mut Surface,
    weight: Vec3,
    normal: Vec3,
    mut model: Microfacet,
    mean: Option<Vec3>,
) -> Vec3 {
    let mut weight = weight;
    let cos = normal.dot(surface.wo());
    if let Some(mean) = mean {
        let roughness = model.roughness();
        let mean = mean.clamp(Vec3::ZERO, Vec3::ONE);
        let compensation = match model.interface {
            Interface::Glass => Compensation::glass(roughness, cos, model.ior, mean),
            _ => Compensation::reflection(roughness, cos, mean),
        };
        model.energy_scale = compensation.scale;
        weight *= compensation.darkening;
    }
    let (reflected, transmitted) = model.albedo(cos);
    // Some facets still refract where all is reflected at the mean normal.
    let albedo = if model.interface == Interface::Refraction { Vec3::ONE } else { reflected + transmitted };
    if surface.add(weight, albedo, normal, Scatter::Microfacet(model)) {
        weight * reflected
    } else {
        Vec3::ZERO
    }
}

/// Diffuse reflection of the given roughness.
pub fn diffuse(normal: Vec3, roughness: f32, color: Vec3, multiple: MultipleScattering, wo: Vec3) -> Scatter {
    if roughness < 1e-5 {
        Scatter::Diffuse
    } else {
        Scatter::OrenNayar(OrenNayar::new(normal, roughness, color, multiple, wo))
    }
}

/// A distribution of the node's shape.
pub fn isotropic(distribution: Distribution, alpha: f32) -> MicrofacetDistribution {
    MicrofacetDistribution { shape: slopes(distribution), alpha_x: alpha, alpha_y: alpha }
}

fn slopes(distribution: Distribution) -> SlopeDistribution {
    match distribution {
        Distribution::Beckmann => SlopeDistribution::Beckmann,
        _ => SlopeDistribution::Ggx,
    }
}

/// Tangents and the widths along them of GGX facets, wider along the tangent by `anisotropy` 0..1.
pub fn facets(
    roughness: f32,
    anisotropy: f32,
    normal: Vec3,
    tangent: Vec3,
) -> (ShadingFrame, MicrofacetDistribution) {
    let alpha = roughness * roughness;
    if anisotropy <= 0.0 {
        return (ShadingFrame::from_normal(normal), isotropic(Distribution::Ggx, alpha));
    }
    let aspect = (1.0 - anisotropy * 0.9).sqrt();
    let (alpha_x, alpha_y) = ((alpha / aspect).min(1.0), alpha * aspect);
    (
        ShadingFrame::from_tangent(normal, tangent),
        MicrofacetDistribution { shape: SlopeDistribution::Ggx, alpha_x, alpha_y },
    )
}

/// A tangent turned about the normal by a number of full turns.
pub fn turned(tangent: Vec3, normal: Vec3, turns: f32) -> Vec3 {
    if turns == 0.0 { tangent } else { Quat::from_axis_angle(normal, turns * TAU) * tangent }
}

impl ShadingContext<'_> {
    /// A normal for closures that reflect: bent so that the mirror direction is above the surface.
    pub fn specular_normal(&self, normal: Vec3) -> Vec3 {
        let geometric = self.point.horizon_normal();
        if normal == geometric { normal } else { ensure_valid_reflection(geometric, self.point.wo, normal) }
    }
}
