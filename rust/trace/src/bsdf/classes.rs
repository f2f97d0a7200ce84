use glam::Vec3;
use relume_dump::Lobe;

/// A surface's value in a direction by class.
#[derive(Clone, Copy, Debug, Default)]
pub struct Classes {
    diffuse: Vec3,
    glossy: Vec3,
    rough_glossy: Vec3,
    transmitted: Vec3,
    rough_transmitted: Vec3,
}

/// Class that lights are collected under ([`super::BsdfSample::light`]).
#[derive(Clone, Copy, Debug)]
pub struct LightClass {
    /// The class.
    pub lobe: Lobe,
    /// Value of the class over that of all of them and the probability of its choice: 1 on average, and where there is no other.
    pub tint: Vec3,
}

impl LightClass {
    /// The only class there is.
    pub fn of(lobe: Lobe) -> Self {
        Self { lobe, tint: Vec3::ONE }
    }
}

impl Classes {
    /// Adds the value of a closure of a class ([`super::Closure::light_lobe`]).
    pub fn add(&mut self, value: Vec3, lobe: Lobe) {
        let own = match lobe {
            Lobe::Glossy => &mut self.glossy,
            Lobe::RoughGlossy => &mut self.rough_glossy,
            Lobe::Transmission => &mut self.transmitted,
            Lobe::RoughTransmission => &mut self.rough_transmitted,
            _ => &mut self.diffuse,
        };
        *own += value;
    }

    /// Value of all of them.
    pub fn sum(&self) -> Vec3 {
        self.diffuse + self.glossy + self.rough_glossy + self.transmitted + self.rough_transmitted
    }

    /// One of the classes, by a number in 0..1: each as often as it is of the value.
    pub fn choose(self, u: f32) -> LightClass {
        let sum = self.sum();
        let mut rest = (u * 4096.0).fract() * sum.element_sum();
        let is_chosen = |(_, value): &(Lobe, Vec3)| {
            rest -= value.element_sum();
            rest < 0.0
        };
        let classes = [
            (Lobe::Transmission, self.transmitted),
            (Lobe::RoughTransmission, self.rough_transmitted),
            (Lobe::Glossy, self.glossy),
            (Lobe::RoughGlossy, self.rough_glossy),
        ];
        let (lobe, value) = classes.into_iter().find(is_chosen).unwrap_or((Lobe::Diffuse, self.diffuse));
        let tint = value / sum * (sum.element_sum() / value.element_sum());
        // Channels without light, and values so small that they are rounded to none, have no quotient.
        LightClass { lobe, tint: Vec3::select(tint.is_finite_mask(), tint, Vec3::ONE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::tests::{Random, facing, microfacet};
    use crate::bsdf::{Fresnel, Interface, SlopeDistribution};

    #[test]
    fn classes_have_the_mean_of_their_values_however_small() {
        let red = Vec3::new(0.9, 0.3, 0.0);
        for scale in [1.0, 1e-30, 1e-44] {
            let mut classes = Classes::default();
            classes.add(red * scale, Lobe::Diffuse);
            classes.add(Vec3::splat(0.2 * scale), Lobe::RoughGlossy);
            let count = 1 << 12;
            let mut means = [Vec3::ZERO; 2];
            for i in 0..count {
                let LightClass { lobe, tint } = classes.choose((i as f32 + 0.5) / (count * 4096) as f32);
                assert!(tint.is_finite() && tint.max_element() <= 10.0, "{tint}");
                means[usize::from(lobe == Lobe::RoughGlossy)] += tint / count as f32;
            }
            if scale > 1e-40 {
                let expected = red / (red + 0.2);
                assert!((means[0] - expected).abs().max_element() < 1e-3, "{} for {expected}", means[0]);
                assert!((means[0] + means[1] - 1.0).abs().max_element() < 1e-3, "{means:?}");
            }
        }
    }

    #[test]
    fn each_side_of_glass_has_a_class_of_its_own_by_roughness() {
        let (glossy, transmitted) = (Lobe::Glossy as usize, Lobe::Transmission as usize);
        let (rough_glossy, rough_transmitted) =
            (Lobe::RoughGlossy as usize, Lobe::RoughTransmission as usize);
        let wo = Vec3::new(0.3, -0.4, 0.8).normalize();
        for (alpha, expected) in [(0.3, [rough_glossy, rough_transmitted]), (0.05, [glossy, transmitted])] {
            let glass = microfacet(
                SlopeDistribution::Ggx,
                Interface::Glass,
                (alpha, alpha),
                1.5,
                Fresnel::Dielectric,
            );
            let mut surface = facing(wo);
            surface.add(Vec3::ONE, Vec3::ONE, Vec3::Z, glass);
            let mut random = Random(5);
            let mut counts = [0; 8];
            for _ in 0..2000 {
                let Some(sample) = surface.sample(random.next3()) else { continue };
                assert_eq!(sample.lobe == Lobe::Transmission, sample.wi.z < 0.0);
                assert_eq!(sample.light.lobe.ray_kind(), sample.lobe);
                assert_eq!(sample.light.tint, Vec3::ONE);
                counts[sample.light.lobe as usize] += 1;
            }
            let seen: Vec<usize> = (0..counts.len()).filter(|lobe| counts[*lobe] > 0).collect();
            assert!(expected.iter().all(|lobe| seen.contains(lobe)) && seen.len() == 2, "{counts:?}");
        }
    }
}
