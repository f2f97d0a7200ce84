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
    glossy: Vec3,
    rough_glossy: Vec3,
    transmitted: Vec3,
}

impl Classes {
    /// Adds the value of a closure whose reflection is of class `reflected`, of which a share is transmitted.
    pub fn add(&mut self, value: Vec3, reflected: Lobe, transmitted: f32) {
        self.transmitted += value * transmitted;
        match reflected {
            Lobe::Glossy => self.glossy += value * (1.0 - transmitted),
            Lobe::RoughGlossy => self.rough_glossy += value * (1.0 - transmitted),
            _ => {}
        }
    }

    /// Class that lights are collected under where the sampled closure is of class `sampled`
    /// ([`super::BsdfSample::light_lobe`]), chosen by a number in 0..1, and what of the `value` of all closures it stands for: the
    /// colour of its own part, as bright as all parts together. So each class has its own colour, and on average all have the value.
    /// Where a surface scatters around, all classes may be in one direction.
    pub fn choose(&self, value: Vec3, scatters_around: bool, sampled: Lobe, u: f32) -> (Lobe, Vec3) {
        let sum = value.element_sum();
        let share = |part: Vec3| part.element_sum() / sum;
        let as_bright = |part: Vec3| {
            let scale = sum / part.element_sum();
            if scale.is_finite() && scale > 0.0 { part * scale } else { value }
        };
        let u = (u * 4096.0).fract();
        let is_reflected = matches!(sampled, Lobe::Diffuse | Lobe::Glossy);
        let u = match scatters_around {
            true if u < share(self.transmitted) => return (Lobe::Transmission, as_bright(self.transmitted)),
            true => u - share(self.transmitted),
            false if is_reflected => u,
            false => return (sampled, value),
        };
        match u - share(self.glossy) {
            rest if rest < 0.0 => (Lobe::Glossy, as_bright(self.glossy)),
            rest if rest < share(self.rough_glossy) => (Lobe::RoughGlossy, as_bright(self.rough_glossy)),
            _ => {
                let rest = value - self.glossy - self.rough_glossy - self.transmitted;
                (Lobe::Diffuse, as_bright(rest.max(Vec3::ZERO)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_class_has_its_own_colour_and_all_have_the_value_on_average() {
        let (diffuse, glossy, rough) = (Vec3::new(0.6, 0.3, 0.0), Vec3::splat(0.2), Vec3::new(0.0, 0.0, 0.5));
        let value = diffuse + glossy + rough;
        let mut classes = Classes::default();
        classes.add(diffuse, Lobe::Diffuse, 0.0);
        classes.add(glossy, Lobe::Glossy, 0.0);
        classes.add(rough, Lobe::RoughGlossy, 0.0);
        let count = 4096;
        let mut sums = [Vec3::ZERO; Lobe::ALL.len()];
        for number in 0..count {
            let u = (number as f32 + 0.5) / (count as f32 * 4096.0);
            let (lobe, part) = classes.choose(value, false, Lobe::Diffuse, u);
            assert!((part.element_sum() - value.element_sum()).abs() < 1e-5, "as bright as all");
            sums[lobe as usize] += part / count as f32;
        }
        for (lobe, part) in [(Lobe::Diffuse, diffuse), (Lobe::Glossy, glossy), (Lobe::RoughGlossy, rough)] {
            assert!(sums[lobe as usize].abs_diff_eq(part, 1e-3), "{lobe:?} {}", sums[lobe as usize]);
        }
    }

    #[test]
    fn a_single_class_keeps_the_value_to_the_bit() {
        let value = Vec3::new(0.123, 0.456, 0.789);
        for lobe in [Lobe::Diffuse, Lobe::Glossy, Lobe::RoughGlossy] {
            let mut classes = Classes::default();
            classes.add(value, lobe, 0.0);
            assert_eq!(classes.choose(value, false, Lobe::Glossy, 0.7), (lobe, value));
        }
    }
}
