use glam::Vec3;
use relume_dump::Lobe;

/// A surface's value in a direction by class.
#[derive(Clone, Copy, Debug, Default)]
pub struct Classes {
    diffuse: Vec3,
    glossy: Vec3,
    rough_glossy: Vec3,
    transmitted: Vec3,
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
            _ => &mut self.diffuse,
        };
        *own += value;
    }

    /// Value of all of them.
    pub fn sum(&self) -> Vec3 {
        self.diffuse + self.glossy + self.rough_glossy + self.transmitted
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
}
