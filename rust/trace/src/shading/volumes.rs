//! Closure nodes of media as optical coefficients, by Cycles' formulas (`kernel/svm/closure.h`).

use glam::{Vec3, Vec4};
use relume_scene::{Node, NodeId, PhaseFunction};

use super::color::lookup;
use super::evaluate::{Known, ShadingContext};
use super::graph::Aid;
use super::values::NodeInputs;
use crate::media::{MediumSample, Phase};

/// Stefan and Boltzmann's constant over pi, in the scale of Cycles' blackbody emission.
const BLACKBODY: f32 = 5.670_373e-8 * 1e-6 / std::f32::consts::PI;

/// Adds the media of `node` and of those below it, `weight` of them, their density scaled by the object's factor.
pub fn shade_medium(
    context: &ShadingContext,
    node: NodeId,
    weight: f32,
    values: &mut [Vec4],
    scratch: &mut [Vec4],
    medium: &mut MediumSample,
) {
    context.run(&context.graph.needs[node as usize], values, scratch);
    let known = Known { context, values };
    match &context.graph.nodes[node as usize] {
        Node::MixShader { factor, a, b } => {
            let factor = known.float(factor).clamp(0.0, 1.0);
            for (child, share) in [(a, 1.0 - factor), (b, factor)] {
                if let Some(child) = child
                    && share > 0.0
                {
                    shade_medium(context, *child, weight * share, values, scratch, medium);
                }
            }
        }
        Node::AddShader { a, b } => {
            for child in [a, b].into_iter().flatten() {
                shade_medium(context, *child, weight, values, scratch, medium);
            }
        }
        Node::VolumeScatter { color, density, phase } => {
            let scattering = known.vector(color) * (known.float(density).max(0.0) * weight);
            add_scattering(medium, scattering, phase, &known);
        }
        Node::VolumeAbsorption { color, density } => {
            medium.add_absorption((1.0 - known.vector(color)) * (known.float(density).max(0.0) * weight));
        }
        Node::VolumeCoefficients { absorption, scatter, emission, phase } => {
            add_scattering(medium, known.vector(scatter) * weight, phase, &known);
            medium.add_absorption(known.vector(absorption) * weight);
            medium.add_emission(known.vector(emission) * weight);
        }
        Node::Emission { color, strength } => {
            medium.add_emission(known.vector(color) * (known.float(strength) * weight));
        }
        principled @ Node::PrincipledVolume { .. } => {
            add_principled(medium, principled, &context.graph.aids[node as usize], weight, &known);
        }
        _ => {}
    }
}

fn add_scattering(medium: &mut MediumSample, scattering: Vec3, phase: &PhaseFunction, known: &Known) {
    match phase {
        PhaseFunction::Mie { diameter } => {
            medium.add_scattering(scattering, Phase::mie(known.float(diameter)));
        }
        other => medium.add_scattering(scattering, [(1.0, single(other, known))]),
    }
}

/// A phase function of one part; droplets have two.
fn single(phase: &PhaseFunction, known: &Known) -> Phase {
    match phase {
        PhaseFunction::HenyeyGreenstein { anisotropy } => Phase::henyey_greenstein(known.float(anisotropy)),
        PhaseFunction::FournierForand { ior, backscatter } => {
            Phase::fournier_forand(known.float(ior), known.float(backscatter))
        }
        PhaseFunction::Draine { anisotropy, alpha } => {
            Phase::draine(known.float(anisotropy), known.float(alpha))
        }
        PhaseFunction::Rayleigh | PhaseFunction::Mie { .. } => Phase::Rayleigh,
    }
}

fn add_principled(medium: &mut MediumSample, node: &Node, aid: &Aid, weight: f32, known: &Known) {
    let Node::PrincipledVolume {
        color,
        color_attribute: _,
        density,
        density_attribute: _,
        anisotropy,
        absorption_color,
        emission_strength,
        emission_color,
        blackbody_intensity,
        blackbody_tint,
        blackbody,
        temperature,
        temperature_attribute: _,
    } = node
    else {
        return;
    };
    let factors = match aid {
        Aid::Fields(names) => {
            names.map(|name| name.and_then(|name| known.context.field(name)).unwrap_or(Vec4::ONE))
        }
        _ => [Vec4::ONE; 3],
    };
    let [color_factor, density_factor, temperature_factor] = factors;
    let density = (known.float(density) * mean(density_factor) * weight).max(0.0);
    if density > 0.0 {
        let color = (known.vector(color) * color_factor.truncate()).max(Vec3::ZERO);
        let tint = known.vector(absorption_color).max(Vec3::ZERO).map(f32::sqrt);
        let phase = Phase::henyey_greenstein(known.float(anisotropy));
        medium.add_scattering(color * density, [(1.0, phase)]);
        medium.add_absorption((1.0 - color).max(Vec3::ZERO) * (1.0 - tint).max(Vec3::ZERO) * density);
    }
    medium.add_emission(known.vector(emission_color) * (known.float(emission_strength) * weight));
    let intensity = known.float(blackbody_intensity);
    if let Some(colors) = blackbody
        && intensity > 0.0
    {
        let kelvin = known.float(temperature) * mean(temperature_factor).max(0.0);
        let radiance = BLACKBODY * (1.0 + intensity * (kelvin.powi(4) - 1.0));
        let color = lookup(colors, kelvin).truncate() * known.vector(blackbody_tint);
        medium.add_emission(color * (radiance * weight));
    }
}

/// One number of a field.
fn mean(field: Vec4) -> f32 {
    field.truncate().element_sum() / 3.0
}
