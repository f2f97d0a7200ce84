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
    transmitted: f32,
}

impl Classes {
    /// Adds the value of a closure, of which a share is transmitted.
    pub fn add(&mut self, value: Vec3, is_glossy: bool, transmitted: f32) {
        let sum = value.element_sum();
        self.transmitted += sum * transmitted;
        if is_glossy {
            self.glossy += sum * (1.0 - transmitted);
        }
    }

    /// Makes them shares of the value of all closures.
    pub fn share(&mut self, value: Vec3) {
        let sum = value.element_sum();
        self.glossy /= sum;
        self.transmitted /= sum;
    }

    /// Class that lights are collected under where the sampled closure is of class `sampled`
    /// ([`super::BsdfSample::light_lobe`]), chosen by a number in 0..1. Where a surface scatters around, all classes may be in
    /// one direction.
    pub fn lobe(self, scatters_around: bool, sampled: Lobe, u: f32) -> Lobe {
        let u = (u * 4096.0).fract();
        if scatters_around {
            return match u - self.transmitted {
                rest if rest < 0.0 => Lobe::Transmission,
                rest if rest < self.glossy => Lobe::Glossy,
                _ => Lobe::Diffuse,
            };
        }
        match sampled {
            Lobe::Diffuse | Lobe::Glossy if u < self.glossy => Lobe::Glossy,
            Lobe::Diffuse | Lobe::Glossy => Lobe::Diffuse,
            lobe => lobe,
        }
    }
}
