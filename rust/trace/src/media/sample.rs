use glam::Vec3;
use relume_scene::MOST_RADIANCE;

use super::phase::Phase;

/// Densities of scattering that are smaller, per metre, count as none.
const SCATTERING_CUTOFF: f32 = 1e-9;

/// Optical properties of all media at one point, per metre, and how they scatter. Reused from point to point.
#[derive(Clone, Debug, Default)]
pub struct MediumSample {
    /// Scattering coefficient.
    pub scattering: Vec3,
    /// Scattering and absorption together.
    pub extinction: Vec3,
    /// Radiance emitted a metre.
    pub emission: Vec3,
    phases: Vec<PhaseTerm>,
}

/// Part of what is scattered.
#[derive(Clone, Copy, Debug)]
struct PhaseTerm {
    scattering: Vec3,
    phase: Phase,
}

/// A direction in which a medium scatters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PhaseSample {
    pub direction: Vec3,
    /// Phase function over density.
    pub weight: Vec3,
    /// Density over solid angle.
    pub pdf: f32,
}

impl MediumSample {
    /// Empties it.
    pub fn clear(&mut self) {
        (self.scattering, self.extinction, self.emission) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        self.phases.clear();
    }

    /// Adds what scatters and, with it, what that takes from a ray. What is negative or no number counts as none.
    pub fn add_scattering(&mut self, scattering: Vec3, phases: impl IntoIterator<Item = (f32, Phase)>) {
        let scattering = usable(scattering);
        if scattering.max_element() <= SCATTERING_CUTOFF {
            return;
        }
        self.scattering += scattering;
        self.extinction += scattering;
        for (share, phase) in phases {
            if share > 0.0 {
                self.add_term(PhaseTerm { scattering: scattering * share, phase });
            }
        }
    }

    /// Adds what absorbs.
    pub fn add_absorption(&mut self, absorption: Vec3) {
        self.extinction += usable(absorption);
    }

    /// Adds what glows. Black bodies that are cold have a little less than no blue.
    pub fn add_emission(&mut self, emission: Vec3) {
        if emission.is_finite() {
            let most = Vec3::splat(MOST_RADIANCE);
            self.emission = (self.emission + emission).clamp(-most, most);
        }
    }

    /// Adds another medium in the same place.
    pub fn add(&mut self, other: &Self) {
        self.scattering += other.scattering;
        self.extinction += other.extinction;
        self.emission += other.emission;
        other.phases.iter().for_each(|term| self.add_term(*term));
    }

    fn add_term(&mut self, new: PhaseTerm) {
        match self.phases.iter_mut().find(|term| term.phase == new.phase) {
            Some(term) => term.scattering += new.scattering,
            None => self.phases.push(new),
        }
    }

    /// The extinction of every channel, if it is one.
    pub fn grey_extinction(&self) -> Option<f32> {
        let [least, most] = [self.extinction.min_element(), self.extinction.max_element()];
        // Sums of channels differ by roundings.
        (most - least <= 4.0 * f32::EPSILON * most).then_some(most)
    }

    /// Share of light that a collision leaves.
    pub fn albedo(&self) -> Vec3 {
        let share = self.scattering / self.extinction;
        Vec3::select(self.extinction.cmpgt(Vec3::ZERO), share, Vec3::ZERO).min(Vec3::ONE)
    }

    /// Share of light that gets through a length of it, RGB.
    pub(crate) fn transmittance(&self, length: f32) -> Vec3 {
        Vec3::select(self.extinction.cmpgt(Vec3::ZERO), (-self.extinction * length).exp(), Vec3::ONE)
    }

    /// Share of light that is scattered within a length of it, RGB.
    pub(crate) fn scattered_within(&self, length: f32) -> Vec3 {
        let lost = Vec3::ONE - self.transmittance(length);
        Vec3::select(self.extinction.cmpgt(Vec3::ZERO), self.scattering / self.extinction * lost, Vec3::ZERO)
    }

    /// Density of a distance to a collision, per metre: mean of the channels.
    pub(crate) fn collision_density(&self, distance: f32) -> f32 {
        (self.extinction * self.transmittance(distance)).element_sum() / 3.0
    }

    /// Bytes of memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&self.phases[..])
    }

    /// Phase function of the mixture for a ray that goes from unit `direction` to unit `to`, and density of [`Self::sample`].
    pub fn eval(&self, direction: Vec3, to: Vec3) -> (Vec3, f32) {
        let cos = direction.dot(to).clamp(-1.0, 1.0);
        let (mut value, mut pdf, mut total) = (Vec3::ZERO, 0.0, 0.0);
        for term in &self.phases {
            let density = term.phase.eval(cos);
            let weight = term.scattering.element_sum();
            value += term.scattering * density;
            pdf += weight * density;
            total += weight;
        }
        let value = Vec3::select(self.scattering.cmpgt(Vec3::ZERO), value / self.scattering, Vec3::ZERO);
        if total > 0.0 { (value, pdf / total) } else { (Vec3::ZERO, 0.0) }
    }

    /// Samples a direction by three numbers in 0..1: a part by what it scatters, then its phase function.
    pub fn sample(&self, direction: Vec3, u: [f32; 3]) -> Option<PhaseSample> {
        let total: f32 = self.phases.iter().map(|term| term.scattering.element_sum()).sum();
        let mut rest = u[2] * total;
        let mut chosen = self.phases.first()?;
        for term in &self.phases {
            chosen = term;
            rest -= term.scattering.element_sum();
            if rest < 0.0 {
                break;
            }
        }
        let to = chosen.phase.sample(direction, [u[0], u[1]]);
        let (value, pdf) = self.eval(direction, to);
        let weight = if self.phases.len() == 1 { Vec3::ONE } else { value / pdf };
        (pdf > 0.0 && weight.is_finite()).then_some(PhaseSample { direction: to, weight, pdf })
    }
}

/// Coefficients as far as they can be summed.
fn usable(value: Vec3) -> Vec3 {
    if value.is_finite() { value.clamp(Vec3::ZERO, Vec3::splat(MOST_RADIANCE)) } else { Vec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_chosen_by_what_they_scatter_in_each_channel() {
        let mut sample = MediumSample::default();
        sample.add_scattering(Vec3::new(2.0, 0.0, 1.0), [(1.0, Phase::henyey_greenstein(0.6))]);
        sample.add_scattering(
            Vec3::new(0.0, 1.0, 1.0),
            [(0.5, Phase::Rayleigh), (0.5, Phase::henyey_greenstein(0.6))],
        );
        sample.add_absorption(Vec3::splat(0.5));
        assert_eq!(sample.extinction, Vec3::new(2.5, 1.5, 2.5));
        assert_eq!(sample.phases.len(), 2);
        let mut mean = Vec3::ZERO;
        let count = 4096;
        for i in 0..count {
            let step = i as f32;
            let u = [(step * 0.754_877_7).fract(), (step * 0.569_840_3).fract(), (step + 0.5) / count as f32];
            mean += sample.sample(Vec3::X, u).map_or(Vec3::ZERO, |found| found.weight) / count as f32;
        }
        assert!((mean - 1.0).abs().max_element() < 0.01, "{mean}");
    }

    #[test]
    fn numbers_that_are_none_count_as_nothing() {
        let mut sample = MediumSample::default();
        sample.add_scattering(Vec3::new(f32::NAN, 1.0, 1.0), [(1.0, Phase::Rayleigh)]);
        sample.add_absorption(Vec3::new(-1.0, 0.0, f32::INFINITY));
        sample.add_emission(Vec3::splat(f32::NAN));
        assert_eq!((sample.extinction, sample.emission), (Vec3::ZERO, Vec3::ZERO));
        assert_eq!(sample.grey_extinction(), Some(0.0));
    }
}
