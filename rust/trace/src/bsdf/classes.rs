use glam::Vec3;
use relume_dump::Lobe;

/// Value of one closure in a direction.
pub struct Part {
    /// `f |cos|` without the closure's weight.
    pub value: Vec3,
    /// Density of the direction.
    pub pdf: f32,
    /// Share of the value that is of class [`Lobe::Transmission`], told where a surface scatters around.
    pub transmitted: f32,
}

/// Parts of a surface's value in a direction by class; the rest is diffuse.
#[derive(Clone, Copy, Debug, Default)]
pub struct Classes {
    glossy: f32,
    rough_glossy: f32,
    transmitted: f32,
}

impl Classes {
    /// Adds the value of a closure whose reflection is of class `reflected`, of which a share is transmitted.
    pub fn add(&mut self, value: Vec3, reflected: Lobe, transmitted: f32) {
        let sum = value.element_sum();
        self.transmitted += sum * transmitted;
        match reflected {
            Lobe::Glossy => self.glossy += sum * (1.0 - transmitted),
            Lobe::RoughGlossy => self.rough_glossy += sum * (1.0 - transmitted),
            _ => {}
        }
    }

    /// Makes them shares of the value of all closures.
    pub fn share(&mut self, value: Vec3) {
        let sum = value.element_sum();
        self.glossy /= sum;
        self.rough_glossy /= sum;
        self.transmitted /= sum;
    }

    /// Class that lights are collected under where the sampled closure is of class `sampled`
    /// ([`super::BsdfSample::light_lobe`]), chosen by a number in 0..1. Where a surface scatters around, all classes may be in
    /// one direction.
    pub fn lobe(self, scatters_around: bool, sampled: Lobe, u: f32) -> Lobe {
        let u = (u * 4096.0).fract();
        let is_reflected = matches!(sampled, Lobe::Diffuse | Lobe::Glossy);
        let u = match scatters_around {
            true if u < self.transmitted => return Lobe::Transmission,
            true => u - self.transmitted,
            false if is_reflected => u,
            false => return sampled,
        };
        match u - self.glossy {
            rest if rest < 0.0 => Lobe::Glossy,
            rest if rest < self.rough_glossy => Lobe::RoughGlossy,
            _ => Lobe::Diffuse,
        }
    }
}
