//! The Principled BSDF, version 2 (Blender 4.0 and later): layers from sheen down to diffuse, each keeping from those
//! below what its albedo estimate says.

use glam::Vec3;
use relume_scene::{Distribution, MultipleScattering, Node};

use super::closures::{add_microfacet, diffuse, facets, isotropic, read_film, turned};
use super::evaluate::{Known, ShadingContext};
use super::subsurface::{self, BodyParameters, Boundary};
use super::values::NodeInputs;
use crate::bsdf::{
    Compensation, F82, Film, Fresnel, Interface, Microfacet, MicrofacetDistribution, Scatter, ShadingFrame,
    Sheen, SlopeDistribution, Surface, WEIGHT_CUTOFF, dielectric_mean, dispersed_ior, f0_from_ior,
    ior_from_f0, stretched, wavelength_weight,
};

/// The node's inputs but for its directions, clamped as Cycles clamps them.
#[derive(Clone, Debug)]
pub struct Parameters {
    base_color: Vec3,
    metallic: f32,
    roughness: f32,
    diffuse_roughness: f32,
    multiple_scattering: MultipleScattering,
    ior: f32,
    alpha: f32,
    subsurface_weight: f32,
    subsurface: Option<BodyParameters>,
    is_thin: bool,
    specular_ior_level: f32,
    specular_tint: Vec3,
    anisotropic: f32,
    anisotropic_rotation: f32,
    transmission_weight: f32,
    coat_weight: f32,
    coat_roughness: f32,
    coat_ior: f32,
    coat_tint: Vec3,
    sheen_weight: f32,
    sheen_roughness: f32,
    sheen_tint: Vec3,
    emission: Vec3,
    is_multi_ggx: bool,
    film: Option<Film>,
    film_on_metal: bool,
    anisotropic_glass: bool,
    inverse_abbe: f32,
}

/// The node's directions at a point.
struct Directions {
    normal: Vec3,
    coat_normal: Vec3,
    /// Tangent of the anisotropy, rotation included; 0 if there is none.
    tangent: Vec3,
}

impl Directions {
    fn read(node: &Node, p: &Parameters, known: &Known) -> Option<Self> {
        let Node::Principled { normal, coat_normal, tangent, .. } = node else { return None };
        let normal = known.normal(normal);
        let tangent = if p.anisotropic > 0.0 {
            turned(known.tangent(tangent), normal, p.anisotropic_rotation)
        } else {
            Vec3::ZERO
        };
        Some(Self { normal, coat_normal: known.normal(coat_normal), tangent })
    }
}

impl Parameters {
    /// Reads the inputs of `node`; nothing if it is another node.
    pub fn read(node: &Node, inputs: &impl NodeInputs) -> Option<Self> {
        let Node::Principled {
            base_color,
            metallic,
            roughness,
            diffuse_roughness,
            multiple_scattering,
            ior,
            alpha,
            normal: _,
            subsurface_weight,
            subsurface,
            thin_wall,
            specular_ior_level,
            specular_tint,
            anisotropic,
            anisotropic_rotation,
            tangent: _,
            transmission_weight,
            coat_weight,
            coat_roughness,
            coat_ior,
            coat_tint,
            coat_normal: _,
            sheen_weight,
            sheen_roughness,
            sheen_tint,
            emission_color,
            emission_strength,
            distribution,
            film,
            anisotropic_glass,
            dispersion,
        } = node
        else {
            return None;
        };
        let unit = |input| inputs.float(input).clamp(0.0, 1.0);
        let positive = |input| inputs.float(input).max(0.0);
        let color = |input| inputs.vector(input).max(Vec3::ZERO);
        Some(Self {
            base_color: color(base_color),
            metallic: unit(metallic),
            roughness: unit(roughness),
            diffuse_roughness: unit(diffuse_roughness),
            multiple_scattering: *multiple_scattering,
            ior: inputs.float(ior).max(1e-5),
            alpha: unit(alpha),
            subsurface_weight: unit(subsurface_weight),
            subsurface: subsurface.as_ref().map(|subsurface| BodyParameters::read(subsurface, inputs)),
            is_thin: thin_wall.as_ref().is_some_and(|thin_wall| inputs.float(thin_wall) != 0.0),
            specular_ior_level: positive(specular_ior_level),
            specular_tint: color(specular_tint),
            anisotropic: unit(anisotropic),
            anisotropic_rotation: inputs.float(anisotropic_rotation),
            transmission_weight: unit(transmission_weight),
            coat_weight: positive(coat_weight),
            coat_roughness: unit(coat_roughness),
            coat_ior: inputs.float(coat_ior).max(1.0),
            coat_tint: color(coat_tint),
            sheen_weight: positive(sheen_weight),
            sheen_roughness: unit(sheen_roughness),
            sheen_tint: color(sheen_tint),
            emission: inputs.vector(emission_color) * inputs.float(emission_strength),
            is_multi_ggx: *distribution == Distribution::MultiGgx,
            film: read_film(film, inputs),
            film_on_metal: film.as_ref().is_some_and(|film| film.on_metal),
            anisotropic_glass: *anisotropic_glass,
            inverse_abbe: dispersion.as_ref().map_or(0.0, |dispersion| {
                let abbe_number = inputs.float(&dispersion.abbe_number);
                if abbe_number > 0.0 { unit(&dispersion.scale) / abbe_number } else { 0.0 }
            }),
        })
    }

    /// Base colour within 0..1, for closures in which more would create energy.
    fn reflectance(&self) -> Vec3 {
        self.base_color.min(Vec3::ONE)
    }

    /// Tangents and the widths along them.
    fn facets(&self, normal: Vec3, tangent: Vec3) -> (ShadingFrame, MicrofacetDistribution) {
        facets(self.roughness, self.anisotropic, normal, tangent)
    }
}

/// Weight for the layers below one that reflects `albedo` out of `weight`.
fn below(albedo: Vec3, weight: Vec3) -> Vec3 {
    let share = Vec3::select(weight.cmpgt(Vec3::ZERO), albedo / weight, Vec3::ZERO);
    weight * (1.0 - share.max_element()).clamp(0.0, 1.0)
}

/// Adds the closures of `node`, whose parameters are known to be `p`, `weight` of them.
pub fn add(node: &Node, p: &Parameters, known: &Known, weight: f32, surface: &mut Surface) {
    let context = known.context;
    let Some(directions) = Directions::read(node, p, known) else { return };
    let mut weight = Vec3::splat(weight);
    if p.alpha < 1.0 {
        surface.add_transparent(weight * (1.0 - p.alpha));
        weight *= p.alpha;
    }
    if p.sheen_weight > WEIGHT_CUTOFF {
        weight = add_sheen(p, &directions, weight, surface);
    }
    if p.coat_weight > WEIGHT_CUTOFF {
        weight = add_coat(context, p, directions.coat_normal, weight, surface);
    }
    if p.emission != Vec3::ZERO {
        surface.add_emission(p.emission * weight);
    }
    let normal = context.specular_normal(directions.normal);
    if p.metallic > WEIGHT_CUTOFF {
        add_metal(p, weight * p.metallic, normal, directions.tangent, surface);
        weight *= 1.0 - p.metallic;
    }
    if p.transmission_weight > WEIGHT_CUTOFF {
        let own = weight * p.transmission_weight;
        if p.is_thin {
            add_pane(context, p, own, normal, surface);
        } else {
            let ior = glass_ior(node, p, context, surface);
            add_glass(context, p, own, (normal, directions.tangent), ior, surface);
        }
        weight *= 1.0 - p.transmission_weight;
    }
    if weight.max_element() <= 0.0 {
        return;
    }
    let (weight, ior) = add_specular(p, weight, normal, directions.tangent, surface);
    let mut color = p.base_color;
    if let Some(body) = &p.subsurface
        && p.subsurface_weight > WEIGHT_CUTOFF
    {
        let inside = p.reflectance() * weight * p.subsurface_weight;
        if p.is_thin {
            add_sheet(p, body, inside, directions.normal, context.point.wo, surface);
        } else {
            let boundary = Boundary { normal, alpha: p.roughness * p.roughness, ior: body.own_ior(ior) };
            subsurface::add(body, inside, p.reflectance(), &boundary, context.point, surface);
        }
        color *= 1.0 - p.subsurface_weight;
    }
    let scatter = diffuse(
        directions.normal,
        p.diffuse_roughness,
        p.base_color,
        p.multiple_scattering,
        context.point.wo,
    );
    surface.add(color * weight, Vec3::ONE, directions.normal, scatter);
}

/// Adds subsurface scattering of a sheet without an inside: anisotropy is what goes through (OpenPBR 1.1, thin walls).
fn add_sheet(
    p: &Parameters,
    body: &BodyParameters,
    weight: Vec3,
    normal: Vec3,
    wo: Vec3,
    surface: &mut Surface,
) {
    let reflected = (0.5 * (1.0 - body.anisotropy)).clamp(0.0, 1.0);
    let transmitted = (0.5 * (1.0 + body.anisotropy)).clamp(0.0, 1.0);
    let scatter = diffuse(normal, p.diffuse_roughness, p.reflectance(), p.multiple_scattering, wo);
    let through = match scatter {
        Scatter::OrenNayar(model) => Scatter::RoughTranslucent(model),
        _ => Scatter::Translucent,
    };
    surface.add(weight * reflected, Vec3::ONE, normal, scatter);
    surface.add(weight * transmitted, Vec3::ONE, normal, through);
}

fn add_sheen(p: &Parameters, directions: &Directions, weight: Vec3, surface: &mut Surface) -> Vec3 {
    let Directions { normal, coat_normal, .. } = *directions;
    let normal = normal.lerp(coat_normal, p.coat_weight.clamp(0.0, 1.0)).normalize_or(normal);
    let Some((sheen, albedo)) = Sheen::new(normal, p.sheen_roughness, surface.wo()) else { return weight };
    let own = weight * p.sheen_tint * (p.sheen_weight * albedo);
    if surface.add(own, Vec3::ONE, normal, Scatter::Sheen(sheen)) { below(own, weight) } else { weight }
}

fn add_coat(
    context: &ShadingContext,
    p: &Parameters,
    normal: Vec3,
    weight: Vec3,
    surface: &mut Surface,
) -> Vec3 {
    let normal = context.specular_normal(normal);
    let alpha = p.coat_roughness * p.coat_roughness;
    let model = Microfacet {
        distribution: MicrofacetDistribution {
            shape: SlopeDistribution::Ggx,
            alpha_x: alpha,
            alpha_y: alpha,
        },
        interface: Interface::Reflection,
        ior: p.coat_ior,
        fresnel: Fresnel::Dielectric,
        frame: ShadingFrame::from_normal(normal),
        energy_scale: 1.0,
    };
    let mean = Vec3::splat(dielectric_mean(p.coat_ior));
    let albedo = add_microfacet(surface, weight * p.coat_weight, normal, model, Some(mean));
    let weight = below(albedo, weight);
    if p.coat_tint == Vec3::ONE {
        return weight;
    }
    // Beer's law for a layer whose tint is given for the perpendicular path.
    let cos = context.point.wo.dot(normal);
    let cos_inside = (1.0 - (1.0 - cos * cos) / (p.coat_ior * p.coat_ior)).max(1e-6).sqrt();
    let absorbed = p.coat_tint.powf(1.0 / cos_inside);
    weight * Vec3::ONE.lerp(absorbed, p.coat_weight)
}

fn add_metal(p: &Parameters, weight: Vec3, normal: Vec3, tangent: Vec3, surface: &mut Surface) {
    let (frame, distribution) = p.facets(normal, tangent);
    let metal = F82::new(p.reflectance(), p.specular_tint.min(Vec3::ONE));
    let model = Microfacet {
        distribution,
        interface: Interface::Reflection,
        ior: 1.0,
        fresnel: Fresnel::Metal(metal, p.film.filter(|_| p.film_on_metal)),
        frame,
        energy_scale: 1.0,
    };
    add_microfacet(surface, weight, normal, model, p.is_multi_ggx.then(|| metal.mean()));
}

/// Index of refraction of glass for a path's wavelength, whose weight the surface takes.
fn glass_ior(node: &Node, p: &Parameters, context: &ShadingContext, surface: &mut Surface) -> f32 {
    match (node, context.point.ray.wavelength) {
        (Node::Principled { dispersion: Some(dispersion), .. }, Some(nm)) if p.inverse_abbe > 0.0 => {
            surface.take_wavelength(wavelength_weight(dispersion, nm));
            dispersed_ior(p.ior, p.inverse_abbe, nm)
        }
        _ => p.ior,
    }
}

fn add_glass(
    context: &ShadingContext,
    p: &Parameters,
    weight: Vec3,
    (normal, tangent): (Vec3, Vec3),
    ior: f32,
    surface: &mut Surface,
) {
    let anisotropic = if p.anisotropic_glass { p.anisotropic } else { 0.0 };
    let (frame, distribution) = facets(p.roughness, anisotropic, normal, tangent);
    let tint = p.reflectance().map(f32::sqrt);
    let f0 = (p.specular_tint * f0_from_ior(p.ior)).clamp(Vec3::ZERO, Vec3::ONE);
    let is_within = context.point.backfacing;
    let film = if is_within { p.film.map(|film| film.from_within(ior)) } else { p.film };
    let model = Microfacet {
        distribution,
        interface: Interface::Glass,
        ior: if is_within { 1.0 / ior } else { ior },
        fresnel: Fresnel::Tinted { f0, reflection: Vec3::ONE, transmission: tint, film },
        frame,
        energy_scale: 1.0,
    };
    add_microfacet(surface, weight, normal, model, p.is_multi_ggx.then_some(tint));
}

/// Adds a sheet of glass without an inside: reflection and transmission with all that goes to and fro in it (OpenPBR 1.1, thin
/// walls). Smooth sheets are transparent, to all rays but the camera's.
fn add_pane(context: &ShadingContext, p: &Parameters, weight: Vec3, normal: Vec3, surface: &mut Surface) {
    let f0 = p.specular_tint * f0_from_ior(p.ior);
    let reflect = |film: Option<Film>, cos, ior| match film {
        Some(film) => film.stretched(cos, ior, f0),
        None => stretched(cos, ior, f0),
    };
    let (front, cos_inside) = reflect(p.film, normal.dot(surface.wo()), p.ior);
    let back = match p.film {
        Some(film) => reflect(Some(film.from_within(p.ior)), cos_inside, 1.0 / p.ior).0,
        None => front,
    };
    let absorbed = if cos_inside > 0.0 { p.reflectance().powf(1.0 / cos_inside) } else { Vec3::ZERO };
    let within = (1.0 - (back * absorbed) * (back * absorbed)).max(Vec3::splat(f32::MIN_POSITIVE));
    let transmitted = absorbed * (1.0 - front) * (1.0 - back) / within;
    let reflected = front + transmitted * back * absorbed;
    let alpha = p.roughness * p.roughness;
    let lobe = |alpha| Microfacet {
        distribution: isotropic(Distribution::Ggx, alpha),
        interface: Interface::Reflection,
        ior: 1.0,
        fresnel: Fresnel::None,
        frame: ShadingFrame::from_normal(normal),
        energy_scale: 1.0,
    };
    let mean = p.specular_tint.clamp(Vec3::ZERO, Vec3::ONE);
    add_microfacet(surface, weight * reflected, normal, lobe(alpha), Some(mean));
    // Kulla and Conty, "Revisiting Physically Based Shading at Imageworks" (2017): two refractions as one reflection.
    let ior = p.ior;
    let widened = alpha * 3.4 * (ior - 1.0) * (ior - 0.5) * (ior - 0.5) / (ior * ior * ior);
    let mut through = lobe(widened.clamp(0.0, 1.0));
    if through.is_singular() && !context.point.ray.is_camera {
        surface.add_transparent(weight * transmitted);
        return;
    }
    through.energy_scale =
        Compensation::reflection(through.roughness(), normal.dot(surface.wo()), Vec3::ONE).scale;
    surface.add(weight * transmitted, Vec3::ONE, normal, Scatter::ThroughSheet(through));
}

/// Adds the reflection of the surface; returns the weight of what is below, and the index of refraction as adjusted by
/// its level.
fn add_specular(
    p: &Parameters,
    weight: Vec3,
    normal: Vec3,
    tangent: Vec3,
    surface: &mut Surface,
) -> (Vec3, f32) {
    let mut eta = p.ior;
    let mut f0 = f0_from_ior(eta);
    if p.specular_ior_level != 0.5 {
        f0 *= 2.0 * p.specular_ior_level;
        eta = ior_from_f0(f0);
        if p.ior < 1.0 {
            eta = 1.0 / eta;
        }
    }
    if eta == 1.0 && p.film.is_none() {
        return (weight, eta);
    }
    let f0 = (p.specular_tint * f0).clamp(Vec3::ZERO, Vec3::ONE);
    let (frame, distribution) = p.facets(normal, tangent);
    let model = Microfacet {
        distribution,
        interface: Interface::Reflection,
        ior: eta,
        fresnel: Fresnel::Tinted { f0, reflection: Vec3::ONE, transmission: Vec3::ZERO, film: p.film },
        frame,
        energy_scale: 1.0,
    };
    let real_f0 = f0_from_ior(eta);
    let rise = ((dielectric_mean(eta) - real_f0) / (1.0 - real_f0)).clamp(0.0, 1.0);
    let mean = f0 + (1.0 - f0) * rise;
    let reflected = add_microfacet(surface, weight, normal, model, p.is_multi_ggx.then_some(mean));
    (below(reflected, weight), eta)
}
