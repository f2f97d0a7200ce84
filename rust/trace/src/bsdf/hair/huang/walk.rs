use std::f32::consts::PI;

use glam::Vec3;

use super::Huang;
use crate::bsdf::{MicrofacetDistribution, ShadingFrame, SlopeDistribution, energy, fresnel};

/// Random numbers of one walk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Randoms(u32);

impl Randoms {
    /// Numbers that depend on three others.
    pub fn new(seeds: [f32; 3]) -> Self {
        let mixed = seeds.into_iter().fold(0x9e37_79b9, |state: u32, seed| {
            (state ^ seed.to_bits()).wrapping_mul(0x85eb_ca6b).rotate_left(13).wrapping_mul(0xc2b2_ae35)
        });
        Self(mixed)
    }

    /// A number in 0..1 (PCG-RXS-M-XS: O'Neill 2014, as a hash by Jarzynski and Olano 2020).
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        (((word >> 22) ^ word) >> 8) as f32 / 16_777_216.0
    }

    fn pair(&mut self) -> [f32; 2] {
        [self.next(), self.next()]
    }
}

/// Direction in which light leaves, and its value over its density.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Exit {
    pub direction: Vec3,
    pub weight: Vec3,
}

/// Rough interface where light comes to it, seen from the side that it comes from.
#[derive(Clone, Copy, Debug)]
struct Interface {
    /// Angle of its place on the outline, of the normal on that side.
    gamma: f32,
    /// Normal of the outline.
    outline: Vec3,
    /// Mean normal of the facets.
    mean: Vec3,
    /// Direction to where light comes from.
    from: Vec3,
    /// Cosine of that to the mean normal.
    cos: f32,
    /// Index of the other side over this one's.
    ior: f32,
    facets: MicrofacetDistribution,
    /// Factor for the energy that single scattering loses, as of glass.
    scale: f32,
}

/// Facet of an [`Interface`] drawn at random.
#[derive(Clone, Copy, Debug)]
struct Facet {
    /// Reflectance.
    reflectance: f32,
    /// Direction that is reflected, away from the facet, and what masking leaves of it.
    reflected: (Vec3, f32),
    /// Direction that is refracted, likewise; no masking leaves anything where all is reflected.
    refracted: (Vec3, f32),
}

impl Interface {
    /// Interface at `gamma` with scales tilted by `tilt`; nothing if it is turned away.
    fn new(hair: &Huang, gamma: f32, tilt: f32, from: Vec3, ior: f32) -> Option<Self> {
        let (outline, mean) = (hair.ellipse.normal(gamma, 0.0), hair.ellipse.normal(gamma, tilt));
        let cos = mean.dot(from);
        if cos <= 0.0 || outline.dot(from) <= 0.0 {
            return None;
        }
        let facets = MicrofacetDistribution {
            shape: SlopeDistribution::Ggx,
            alpha_x: hair.roughness,
            alpha_y: hair.roughness,
        };
        let scale = 1.0 / energy::single_scattering_of_glass(hair.roughness.sqrt(), cos, ior).max(1e-4);
        Some(Self { gamma, outline, mean, from, cos, ior, facets, scale })
    }

    /// Smith's masking of a direction at `cos` to the mean normal.
    fn lambda(&self, cos: f32) -> f32 {
        let cos = cos.abs().clamp(1e-4, 1.0);
        self.facets.lambda(Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos))
    }

    /// Share of facets seen from the one side that are also seen by `direction`, on either side.
    fn unmasked(&self, direction: Vec3) -> f32 {
        let own = 1.0 + self.lambda(self.cos);
        own / (own + self.lambda(self.mean.dot(direction)))
    }

    /// Draws a facet that is seen; nothing if it is turned away from the outline's side.
    fn facet(&self, u: [f32; 2]) -> Option<Facet> {
        let frame = ShadingFrame::from_normal(self.mean);
        let normal = frame.world(self.facets.sample_visible(frame.local(self.from), u));
        let cos = normal.dot(self.from);
        if cos <= 0.0 {
            return None;
        }
        let (reflectance, cos_t) = fresnel::dielectric(cos, self.ior);
        let reflected = normal * (2.0 * cos) - self.from;
        let is_outside = self.mean.dot(reflected) > 0.0 && self.outline.dot(reflected) > 0.0;
        let refracted = normal * (cos / self.ior - cos_t) - self.from / self.ior;
        let is_inside =
            reflectance < 1.0 && self.mean.dot(refracted) < 0.0 && self.outline.dot(refracted) < 0.0;
        let masked = |is_there: bool, direction: Vec3| if is_there { self.unmasked(direction) } else { 0.0 };
        Some(Facet {
            reflectance,
            reflected: (reflected, masked(is_outside, reflected)),
            refracted: (refracted, masked(is_inside, refracted)),
        })
    }

    /// Light from `wi` that the facets reflect, for an area of outline that the ray sees head on.
    fn reflection(&self, wi: Vec3) -> f32 {
        let half = (self.from + wi).normalize_or(self.mean);
        let cos_half = half.dot(self.from);
        // The outline hides directions here, whatever the scales' tilt is.
        if cos_half <= 0.0 || self.outline.dot(wi) <= 0.0 {
            return 0.0;
        }
        let (reflectance, _) = fresnel::dielectric(cos_half, self.ior);
        0.25 * reflectance * self.scale * self.density(half) * self.masking(wi)
    }

    /// Light from `wi` on the other side that the facets refract, for an area of outline that the ray sees head on.
    fn refraction(&self, wi: Vec3) -> f32 {
        let half = self.from + wi * self.ior;
        let length_squared = half.length_squared();
        let half = half / length_squared.sqrt();
        let (cos_from, cos_to) = (half.dot(self.from), -half.dot(wi));
        if !self.refracts(wi) || half.dot(self.mean) < 0.0 {
            return 0.0;
        }
        let (reflectance, _) = fresnel::dielectric(cos_from.max(0.0), self.ior);
        let jacobian = self.ior * self.ior * cos_from * cos_to / length_squared;
        (1.0 - reflectance) * self.scale * self.density(half) * self.masking(wi) * jacobian
    }

    /// True if some facet refracts light from `wi`, on the other side, which is the thinner one.
    fn refracts(&self, wi: Vec3) -> bool {
        -wi.dot(self.from) >= self.ior - 1e-5
    }

    /// True if neither the outline nor the scales' mean hides `wi`, on the other side, from the facet that refracts it.
    fn is_visible(&self, wi: Vec3) -> bool {
        let half = self.from + wi * self.ior;
        let sees = |normal: Vec3| self.from.dot(normal) > 0.0 && wi.dot(normal) < 0.0;
        sees(self.mean) && sees(self.outline) && half.dot(self.mean) >= 0.0
    }

    fn density(&self, facet: Vec3) -> f32 {
        let cos = facet.dot(self.mean);
        self.facets.density(Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos))
    }

    fn masking(&self, wi: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(self.cos) + self.lambda(self.mean.dot(wi)))
    }

    /// Area that the ray sees of the scales over what `inside` sees of them.
    fn foreshortening(&self, inside: Vec3) -> f32 {
        self.cos / self.mean.dot(inside).abs()
    }
}

/// Way of light through the fibre from where the ray meets it, seen backwards.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    entry: Interface,
}

/// Piece of the way within the fibre.
#[derive(Clone, Copy, Debug)]
struct Inside {
    direction: Vec3,
    /// Interface that it comes to.
    interface: Interface,
    /// Transmittance of it.
    transmittance: Vec3,
}

impl Inside {
    /// From `gamma`, of the outward normal, along `direction`.
    fn new(hair: &Huang, gamma: f32, direction: Vec3) -> Option<Self> {
        let end = hair.ellipse.opposite(gamma, direction);
        let length = hair.ellipse.chord(gamma, end + PI);
        let steepness = direction.x.hypot(direction.z).max(1e-4);
        let interface = Interface::new(hair, end, -hair.tilt, -direction, 1.0 / hair.ior)?;
        let transmittance = (hair.absorption * (-length / steepness)).map(f32::exp);
        Some(Self { direction, interface, transmittance })
    }

    /// Angle of the outward normal where it ends.
    fn outward(&self) -> f32 {
        self.interface.gamma + PI
    }
}

/// Light that is refracted into the fibre.
#[derive(Clone, Copy, Debug)]
struct Through {
    /// Share that the first facet lets in.
    entered: f32,
    /// Weight where it comes to the second interface.
    weight: Vec3,
    second: Inside,
}

/// Light that comes from one direction to a place of the outline, for an area that the ray sees head on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lit {
    /// Transmitted and internally reflected light.
    pub direct: Vec3,
    /// Weight of the rest, whose direction is not known.
    pub rest: Vec3,
}

impl Walk {
    /// Way from the place `gamma` of the outline; nothing if that is turned away.
    pub fn new(hair: &Huang, gamma: f32) -> Option<Self> {
        Some(Self { entry: Interface::new(hair, gamma, hair.tilt, hair.wo, hair.ior)? })
    }

    fn through(&self, hair: &Huang, facet: &Facet) -> Option<Through> {
        let (direction, unmasked) = facet.refracted;
        if unmasked == 0.0 {
            return None;
        }
        let second = Inside::new(hair, self.entry.gamma, direction)?;
        let entered = 1.0 - facet.reflectance;
        let weight = second.transmittance * (entered * self.entry.scale * unmasked);
        Some(Through { entered, weight, second })
    }

    /// Reflection, transmission, internal reflection, and the rest, whose direction is not known.
    pub fn exits(&self, hair: &Huang, random: &mut Randoms) -> [Exit; 4] {
        let mut exits = [Exit::default(); 4];
        let Some(first) = self.entry.facet(random.pair()) else { return exits };
        let [reflection, transmission, internal] = hair.factors;
        let reflected = reflection * first.reflectance * self.entry.scale * first.reflected.1;
        exits[0] = Exit { direction: first.reflected.0, weight: Vec3::splat(reflected) };
        let Some(through) = self.through(hair, &first) else { return exits };
        let second = &through.second.interface;
        let Some(facet) = second.facet(random.pair()) else { return exits };
        let transmitted = (1.0 - facet.reflectance) * second.scale * facet.refracted.1;
        exits[1] =
            Exit { direction: facet.refracted.0, weight: through.weight * (transmission * transmitted) };
        let Some((weight, third)) = through.reflected(hair, &facet) else { return exits };
        let Some(last) = third.interface.facet(random.pair()) else { return exits };
        exits[2] = Exit {
            direction: last.refracted.0,
            weight: weight * (internal * (1.0 - last.reflectance) * third.interface.scale * last.refracted.1),
        };
        exits[3].weight = rest_of_walk(&through, &facet, weight, &third, &last);
        exits
    }

    /// Light from `wi` that is reflected, for an area of outline that the ray sees head on.
    pub fn reflection(&self, wi: Vec3) -> f32 {
        self.entry.reflection(wi)
    }

    /// Light from `wi` that goes through the fibre.
    pub fn towards(&self, hair: &Huang, wi: Vec3, random: &mut Randoms) -> Lit {
        let mut lit = Lit::default();
        let [_, transmission, internal] = hair.factors;
        let Some(first) = self.entry.facet(random.pair()) else { return lit };
        let Some(through) = self.through(hair, &first) else { return lit };
        let second = &through.second;
        let weight = through.weight * self.entry.foreshortening(second.direction);
        let seen = hair.ellipse.arc(second.interface.gamma) * second.interface.refraction(wi);
        lit.direct = weight * (transmission * seen);
        if internal <= 0.0 {
            return lit;
        }
        let Some(facet) = second.interface.facet(random.pair()) else { return lit };
        let direction = facet.reflected.0;
        if wi.dot(direction) < 1.0 / hair.ior - 1e-5 {
            lit.rest = through.rest(facet.reflectance);
            return lit;
        }
        let Some((reflected, third)) = through.reflected(hair, &facet) else { return lit };
        lit.rest = through.rest(facet.reflectance);
        if third.interface.is_visible(wi) {
            let area =
                self.entry.foreshortening(second.direction) * second.interface.foreshortening(direction);
            let seen = hair.ellipse.arc(third.interface.gamma) * third.interface.refraction(wi);
            lit.direct += reflected * (internal * area * seen);
        }
        lit
    }
}

impl Through {
    /// Weight where it comes to the third interface, and the way there.
    fn reflected(&self, hair: &Huang, facet: &Facet) -> Option<(Vec3, Inside)> {
        let (direction, unmasked) = facet.reflected;
        if unmasked == 0.0 {
            return None;
        }
        let third = Inside::new(hair, self.second.outward(), direction)?;
        let reflected = facet.reflectance * self.second.interface.scale * unmasked;
        Some((self.weight * third.transmittance * reflected, third))
    }

    /// Weight of light from lamps that is reflected twice and more within, as Cycles has it. It is a geometric series of what
    /// the first chord absorbs and the second facet reflects.
    fn rest(&self, reflectance: f32) -> Vec3 {
        let absorbed = self.second.transmittance;
        let leaves = (1.0 - reflectance).max(1e-5);
        let twice = absorbed * absorbed * absorbed * (reflectance * reflectance);
        twice * (self.entered * leaves) / (1.0 - absorbed * (1.0 - leaves))
    }
}

/// Weight of bounced light that is reflected twice and more within, as Cycles has it. It is a geometric series of what the
/// light met before (Chiang et al. 2016).
fn rest_of_walk(through: &Through, facet: &Facet, weight: Vec3, third: &Inside, last: &Facet) -> Vec3 {
    let absorbed = (through.second.transmittance * third.transmittance).map(f32::sqrt);
    let leaves = (1.0 - 0.5 * (facet.reflectance + last.reflectance)).max(1e-5);
    let reflected = last.reflectance * third.interface.scale * last.reflected.1;
    weight * reflected * absorbed * leaves / (1.0 - absorbed * (1.0 - leaves))
}
