//! Ways through media: free flights, and the transmittance that light arrives with.

use glam::Vec3;

use super::{MediaScratch, MediaSpace, MediumSample, VolumeStack, majorant::GridRay, stack::DEEPEST};

/// Collisions, true or not, after which light is given up: one way through a cloud has some hundred.
const MOST_EVENTS: u32 = 100_000;
/// Share of light below which a shadow ray may end by chance.
const FAINT: f32 = 0.05;

/// A straight way through the media of a stack.
#[derive(Clone, Copy)]
pub(crate) struct Flight<'a> {
    pub space: MediaSpace<'a>,
    pub stack: &'a VolumeStack,
    pub origin: Vec3,
    /// Unit length.
    pub direction: Vec3,
    /// Length in metres, up to what is there besides media.
    pub length: f32,
}

/// End of a flight. Weights are those of the path behind it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Landing {
    /// Nothing was met.
    Through,
    /// A collision; its media are the sample of the scratch memory.
    Scattered { distance: f32, weight: Vec3 },
    /// A collision with nothing, behind which the path goes straight on with another weight: channels differ in extinction.
    Changed { distance: f32, weight: Vec3 },
    /// A collision where nothing is scattered.
    Lost { distance: f32 },
}

/// Numbers in 0..1 of one flight: the first two well spread from path to path, then as many as it takes.
#[derive(Clone, Debug)]
pub(crate) struct TrackingNumbers {
    spread: [f32; 2],
    used: usize,
    state: u64,
}

impl TrackingNumbers {
    /// Numbers that follow from four of the sampler.
    pub fn new(u: [f32; 4]) -> Self {
        let state = u64::from(u[2].to_bits()) << 32 | u64::from(u[3].to_bits());
        Self { spread: [u[0], u[1]], used: 0, state: state ^ 0x9e37_79b9_7f4a_7c15 }
    }

    /// Numbers that look independent of those which they follow from.
    pub fn seeded(u: [f32; 3]) -> Self {
        let [a, b, c] = u.map(|u| u64::from(u.to_bits()));
        Self { spread: [0.0; 2], used: 2, state: (a << 32 | b) ^ c.wrapping_mul(0x2545_f491_4f6c_dd1d) }
    }

    /// The next number.
    pub fn next(&mut self) -> f32 {
        if let Some(number) = self.spread.get(self.used) {
            self.used += 1;
            return *number;
        }
        // SplitMix64 (Steele, Lea and Flood 2014).
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 * (1.0 / (1 << 24) as f32)
    }

    /// Optical depth to the next collision.
    fn depth(&mut self) -> f32 {
        -(-self.next()).ln_1p()
    }
}

/// Finds possible collisions along a flight through media that vary (Woodcock et al. 1965).
struct Tracker<'a> {
    flight: Flight<'a>,
    rays: [GridRay; DEEPEST],
    /// Extinction of the media that do not vary, their largest channel.
    homogeneous: f32,
    distance: f32,
}

impl<'a> Tracker<'a> {
    /// `homogeneous` is a bound for the media that do not vary.
    fn new(flight: Flight<'a>, homogeneous: f32) -> Self {
        let mut rays = [GridRay::default(); DEEPEST];
        let media = flight.stack.media().iter().zip(&mut rays);
        for (medium, ray) in media {
            let medium = &flight.space.media.media[*medium as usize];
            if medium.homogeneous.is_none() {
                *ray = flight.space.majorant_ray(medium, flight.origin, flight.direction);
            }
        }
        Self { flight, rays, homogeneous, distance: 0.0 }
    }

    /// Bound of the extinction from here, and up to where it holds.
    fn span(&self) -> (f32, f32) {
        let Flight { space, stack, length, .. } = self.flight;
        let (mut majorant, mut exit) = (self.homogeneous, length);
        for (medium, ray) in stack.media().iter().zip(&self.rays) {
            let medium = &space.media.media[*medium as usize];
            if medium.homogeneous.is_none() {
                let (bound, end) = space.majorants(medium).span(ray, self.distance);
                majorant += bound;
                exit = exit.min(end);
            }
        }
        (majorant, exit)
    }

    /// Goes to the next possible collision and returns the bound there; nothing if there is none.
    fn advance(&mut self, numbers: &mut TrackingNumbers) -> Option<f32> {
        let mut depth = numbers.depth();
        for _ in 0..MOST_EVENTS {
            let (majorant, exit) = self.span();
            if (exit - self.distance) * majorant > depth {
                self.distance += depth / majorant;
                return Some(majorant);
            }
            if exit >= self.flight.length {
                return None;
            }
            if majorant > 0.0 {
                depth -= (exit - self.distance) * majorant;
            }
            self.distance = exit;
        }
        None
    }
}

impl Flight<'_> {
    /// Flies with a weight until something happens. `scatters` is false where a path may not be scattered any more. The second value
    /// is the light that the media themselves send back along the way, before the weight.
    pub fn run(
        &self,
        throughput: Vec3,
        scatters: bool,
        numbers: &mut TrackingNumbers,
        scratch: &mut MediaScratch,
    ) -> (Landing, Vec3) {
        if self.stack.media().is_empty() {
            return (Landing::Through, Vec3::ZERO);
        }
        let collide = |sample: &MediumSample, majorant: f32, distance: f32, numbers: &mut TrackingNumbers| {
            collision(sample, majorant, distance, throughput, scatters, numbers)
        };
        let landing = if self.is_homogeneous() {
            self.space.fill(
                self.stack,
                self.origin,
                self.direction,
                &mut scratch.values,
                &mut scratch.sample,
            );
            // Channels that carry nothing need no bound.
            let counts = throughput.cmpgt(Vec3::ZERO);
            let majorant = Vec3::select(counts, scratch.sample.extinction, Vec3::ZERO).max_element();
            let distance = if majorant > 0.0 { numbers.depth() / majorant } else { f32::INFINITY };
            if distance < self.length {
                collide(&scratch.sample, majorant, distance, numbers).unwrap_or(Landing::Through)
            } else {
                Landing::Through
            }
        } else {
            let mut tracker = Tracker::new(*self, self.homogeneous_extinction().max_element());
            let mut events = 0;
            loop {
                let Some(majorant) = tracker.advance(numbers) else { break Landing::Through };
                let position = self.origin + self.direction * tracker.distance;
                self.space.fill(
                    self.stack,
                    position,
                    self.direction,
                    &mut scratch.values,
                    &mut scratch.sample,
                );
                if let Some(landing) = collide(&scratch.sample, majorant, tracker.distance, numbers) {
                    break landing;
                }
                events += 1;
                if events == MOST_EVENTS {
                    break Landing::Lost { distance: tracker.distance };
                }
            }
        };
        let length = match landing {
            Landing::Through => self.length,
            Landing::Scattered { distance, .. }
            | Landing::Changed { distance, .. }
            | Landing::Lost { distance } => distance,
        };
        (landing, self.emission(length, numbers, scratch))
    }

    /// True if nothing varies along the way.
    fn is_homogeneous(&self) -> bool {
        self.stack.media().iter().all(|medium| self.space.media.media[*medium as usize].homogeneous.is_some())
    }

    /// Extinction of the media that do not vary.
    fn homogeneous_extinction(&self) -> Vec3 {
        let media = self.stack.media().iter().map(|medium| &self.space.media.media[*medium as usize]);
        media.filter_map(|medium| medium.homogeneous.as_ref()).map(|homogeneous| homogeneous.extinction).sum()
    }

    /// What glows along the first `length` metres, looked at in one place that stands for all. Of a glow without end that
    /// nothing dims there would be no sum.
    fn emission(&self, length: f32, numbers: &mut TrackingNumbers, scratch: &mut MediaScratch) -> Vec3 {
        let glows = |medium: &u32| self.space.media.media[*medium as usize].glows;
        if !self.stack.media().iter().any(glows) || !length.is_finite() {
            return Vec3::ZERO;
        }
        let place = if self.is_homogeneous() { 0.0 } else { length * numbers.next() };
        let position = self.origin + self.direction * place;
        self.space.fill(self.stack, position, self.direction, &mut scratch.values, &mut scratch.other);
        scratch.other.emission * length
    }

    /// Share of light that gets through, by ratio tracking where media vary (Novák et al. 2014).
    pub fn transmittance(&self, numbers: &mut TrackingNumbers, scratch: &mut MediaScratch) -> Vec3 {
        let homogeneous = self.homogeneous_extinction();
        let depth = Vec3::select(homogeneous.cmpgt(Vec3::ZERO), homogeneous * self.length, Vec3::ZERO);
        let mut through = (-depth).exp();
        if self.is_homogeneous() {
            return through;
        }
        let mut tracker = Tracker::new(*self, 0.0);
        for _ in 0..MOST_EVENTS {
            let Some(majorant) = tracker.advance(numbers) else { return through };
            let position = self.origin + self.direction * tracker.distance;
            scratch.other.clear();
            for medium in self.stack.media() {
                let medium = &self.space.media.media[*medium as usize];
                if medium.homogeneous.is_none() {
                    let (values, sample) = (&mut scratch.values, &mut scratch.other);
                    self.space.add_medium(medium, position, self.direction, values, sample);
                }
            }
            through *= (1.0 - scratch.other.extinction / majorant).max(Vec3::ZERO);
            let survival = through.max_element() / FAINT;
            if survival < 1.0 {
                if numbers.next() >= survival {
                    return Vec3::ZERO;
                }
                through /= survival;
            }
        }
        Vec3::ZERO
    }
}

/// Outcome of a possible collision in media of this sample, whose bound is `majorant`; nothing if it was none and changes nothing.
fn collision(
    sample: &MediumSample,
    majorant: f32,
    distance: f32,
    throughput: Vec3,
    scatters: bool,
    numbers: &mut TrackingNumbers,
) -> Option<Landing> {
    if let Some(extinction) = sample.grey_extinction() {
        if extinction < majorant && numbers.next() * majorant >= extinction {
            return None;
        }
        let weight = sample.albedo();
        let goes_on = scatters && (weight * throughput).max_element() > 0.0;
        return Some(if goes_on {
            Landing::Scattered { distance, weight }
        } else {
            Landing::Lost { distance }
        });
    }
    let nothing = (majorant - sample.extinction).max(Vec3::ZERO);
    let scattering = if scatters { sample.scattering } else { Vec3::ZERO };
    let [scattered, passed] = [scattering, nothing].map(|part| (part * throughput).element_sum());
    if scattered + passed <= 0.0 {
        return Some(Landing::Lost { distance });
    }
    let share = scattered / (scattered + passed);
    Some(if numbers.next() < share {
        Landing::Scattered { distance, weight: scattering / (majorant * share) }
    } else {
        Landing::Changed { distance, weight: nothing / (majorant * (1.0 - share)) }
    })
}
