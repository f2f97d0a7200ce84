//! Where the file's lights stand, for paths to look there more often.
//!
//! A share of the directions is drawn from cones around the lights instead of from the BSDF, and every direction is weighted by
//! the density of both ways together (one-sample model with the balance heuristic; Veach 1997, section 9.2.4). So paths stay
//! right for any light whatever, and those lights that stand near a cone are met far more often than by chance: a bulb of 5 cm
//! radius in 3 m distance fills 1/7200 of a hemisphere. Lights that chance meets often enough are left to it.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use relume_scene::{Light, LightShape};

use crate::bsdf::{Frame, Surface};
use crate::settings::MOST_GUIDING;

/// Most lights that are looked for: each costs some arithmetic at every vertex.
const MOST_LIGHTS: usize = 32;
/// Height of the cone from which on a light is left to chance: a solid angle of 0.6.
const LARGE: f32 = 0.1;
/// Narrowest cone, as the squared sine of its half angle: below, single precision would miss it.
const NARROWEST: f32 = 1e-6;
/// Least of a light's second cone, which is four times as wide as the light, for lights that are moved a little; 5 degrees.
const WIDE: f32 = 1.0 / 144.0;

/// The lights that are looked for.
#[derive(Clone, Debug)]
pub struct Guide {
    /// Most of the directions that are drawn from cones.
    share: f32,
    lights: Vec<Aim>,
}

/// What a light is taken for.
#[derive(Clone, Copy, Debug)]
struct Aim {
    place: Place,
    /// See [`brightness`].
    brightness: f32,
    beam: Beam,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    /// In a ball.
    Ball { center: Vec3, radius: f32 },
    /// In directions around one.
    Sky { direction: Vec3, sine_squared: f32 },
}

/// Where a light shines to.
#[derive(Clone, Copy, Debug)]
enum Beam {
    Everywhere,
    /// From the cosine to the axis on that it has at the rim of the cone.
    Cone {
        axis: Vec3,
        cos: f32,
    },
    /// By the cosine to the normal.
    Front {
        normal: Vec3,
    },
}

/// Share of the directions from a matt surface that faces a light which meet it if nothing is in between, with paths that look
/// for what `guide` says. Nothing where the light does not shine to.
pub fn chance_to_meet(guide: Option<&Guide>, point: Vec3, light: &Light) -> Option<f32> {
    let aim = Aim::at(light);
    let (axis, sine_squared) = aim.seen_from(point);
    let mut cones = Cones::default();
    if let Some(guide) = guide {
        guide.look_from(point, &mut cones);
    }
    let density = (1.0 - cones.share) / PI + cones.share * cones.density(axis);
    let shines = aim.beam.towards(-axis) > 0.0;
    shines.then(|| (TAU * height(sine_squared.min(1.0)) * density).min(1.0))
}

/// The lights as one point sees them. Reused from point to point: nothing is allocated.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cones {
    list: Vec<Pair>,
    /// Share of the directions that are drawn from them, below 1; 0 where chance does as well.
    pub share: f32,
}

/// Two cones around one axis, the first as narrow as a light. A cone is told by its height, 1 less the cosine of its half angle,
/// which stays precise where cosines are all 1.
#[derive(Clone, Copy, Debug)]
struct Pair {
    axis: Vec3,
    heights: [f32; 2],
    /// Probability that one of them is drawn from, where any is; both alike.
    probability: f32,
}

impl Guide {
    /// Looks for the strongest of these lights with a share of the directions, at most [`MOST_GUIDING`]; suns go first, since
    /// their power is told in another unit. Nothing if there are no lights or nothing is to be drawn from them.
    pub fn new(lights: &[Light], share: f32) -> Option<Self> {
        let is_sun = |light: &Light| matches!(light.shape, LightShape::Sun { .. });
        let power = |light: &Light| brightness(light) * light.shape.extent();
        let mut strongest: Vec<&Light> = lights.iter().collect();
        strongest.sort_by(|a, b| is_sun(b).cmp(&is_sun(a)).then(power(b).total_cmp(&power(a))));
        let lights: Vec<Aim> = strongest.into_iter().take(MOST_LIGHTS).map(Aim::at).collect();
        (share > 0.0 && !lights.is_empty()).then_some(Self { share: share.min(MOST_GUIDING), lights })
    }

    /// Makes `cones` those that are seen from a point.
    pub(crate) fn look_from(&self, point: Vec3, cones: &mut Cones) {
        cones.list.clear();
        let (mut all, mut wanted) = (0.0, 0.0);
        for aim in &self.lights {
            let (axis, sine_squared) = aim.seen_from(point);
            let height = height(sine_squared.clamp(NARROWEST, 1.0));
            // Irradiance is what a light matters by here; by its root, so that weak lights can be turned up later.
            let weight = (aim.brightness * aim.beam.towards(-axis) * height).sqrt();
            let want = weight * (1.0 - height / LARGE).max(0.0);
            all += weight;
            if want > 0.0 {
                wanted += want;
                let wide = self::height((16.0 * sine_squared).clamp(WIDE, 1.0));
                cones.list.push(Pair { axis, heights: [height, wide], probability: want });
            }
        }
        cones.list.iter_mut().for_each(|pair| pair.probability /= wanted);
        cones.share = if wanted > 0.0 { self.share * wanted / all } else { 0.0 };
    }
}

impl Cones {
    /// A direction from three numbers in 0..1. There has to be a cone.
    pub fn sample(&self, u: [f32; 3]) -> Vec3 {
        let mut rest = u[0];
        let mut chosen = &self.list[0];
        for pair in &self.list {
            chosen = pair;
            if rest < pair.probability {
                break;
            }
            rest -= pair.probability;
        }
        let height = chosen.heights[usize::from(rest < 0.5 * chosen.probability)];
        sample_cone(chosen.axis, height, [u[1], u[2]])
    }

    /// Density of a direction from a surface that draws the share of these cones from them, and the rest as [`Surface::sample`]
    /// does, whose density is `pdf`. Choices of mirrors stay choices of mirrors.
    pub fn pdf_with(&self, surface: &Surface, pdf: f32, wi: Vec3) -> f32 {
        (1.0 - self.share) * pdf + self.share * surface.dull_share() * self.density(wi)
    }

    /// Density of [`Cones::sample`] over solid angle.
    fn density(&self, direction: Vec3) -> f32 {
        let mut sum = 0.0;
        for pair in &self.list {
            // Of two unit vectors: 1 less their cosine.
            let apart = 0.5 * (direction - pair.axis).length_squared();
            // The second holds the first.
            if apart <= pair.heights[1] {
                let narrow = if apart <= pair.heights[0] { 1.0 / pair.heights[0] } else { 0.0 };
                sum += pair.probability * (narrow + 1.0 / pair.heights[1]);
            }
        }
        sum * 0.5 / TAU
    }
}

impl Aim {
    fn at(light: &Light) -> Self {
        let front = |u: Vec3, v: Vec3| Beam::Front { normal: u.cross(v).normalize_or(Vec3::Z) };
        let (place, beam) = match light.shape {
            LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
                (Place::Ball { center, radius }, Beam::Everywhere)
            }
            LightShape::Spot { center, radius, axis, half_angle, .. } => {
                (Place::Ball { center, radius }, Beam::Cone { axis, cos: half_angle.cos() })
            }
            LightShape::Quad { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * (edge_u.length_squared() + edge_v.length_squared()).sqrt();
                (Place::Ball { center, radius }, front(edge_u, edge_v))
            }
            LightShape::Ellipse { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * edge_u.length().max(edge_v.length());
                (Place::Ball { center, radius }, front(edge_u, edge_v))
            }
            LightShape::Sun { direction, half_angle } => (
                Place::Sky { direction, sine_squared: half_angle.min(0.5 * PI).sin().powi(2) },
                Beam::Everywhere,
            ),
        };
        Self { place, brightness: brightness(light), beam }
    }

    /// Direction and squared sine of the half angle; 1 or more from inside of it.
    fn seen_from(&self, point: Vec3) -> (Vec3, f32) {
        match self.place {
            Place::Sky { direction, sine_squared } => (direction, sine_squared),
            Place::Ball { center, radius } => {
                let to_center = center - point;
                let inverse = to_center.length_recip();
                (to_center * inverse, (radius * inverse).powi(2))
            }
        }
    }
}

impl Beam {
    /// How bright a light is in a direction away from it.
    fn towards(&self, direction: Vec3) -> f32 {
        match self {
            Self::Everywhere => 1.0,
            Self::Cone { axis, cos } => f32::from(axis.dot(direction) >= *cos),
            Self::Front { normal } => normal.dot(direction).max(0.0),
        }
    }
}

/// Of a light's radiance, mean of RGB; of lights that take light away (their power may be negative) as much.
fn brightness(light: &Light) -> f32 {
    Vec3::from(light.radiance).abs().element_sum() / 3.0
}

/// Height of the cone that holds a ball, by the squared sine of its half angle: 1 - sqrt(1 - s), to the second order.
fn height(sine_squared: f32) -> f32 {
    sine_squared * (0.5 + 0.125 * sine_squared)
}

fn sample_cone(axis: Vec3, height: f32, u: [f32; 2]) -> Vec3 {
    let height = u[0] * height;
    let sine = (height * (2.0 - height)).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
    let local = Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - height);
    Frame::from_normal(axis).world(local).normalize_or(axis)
}

#[cfg(test)]
mod tests {
    use relume_scene::LobeFactors;

    use super::*;

    fn light(shape: &LightShape) -> Light {
        Light {
            name: "light".into(),
            shape: *shape,
            radiance: [1.0; 3],
            lobes: LobeFactors::default(),
            receivers: None,
        }
    }

    fn guide(shapes: &[LightShape]) -> Guide {
        let lights: Vec<Light> = shapes.iter().map(light).collect();
        Guide::new(&lights, 0.5).expect("lights")
    }

    impl Guide {
        fn seen_from(&self, point: Vec3) -> Cones {
            let mut cones = Cones::default();
            self.look_from(point, &mut cones);
            cones
        }

        fn seen(&self) -> Cones {
            self.seen_from(Vec3::ZERO)
        }
    }

    fn number(i: usize, factor: f64) -> f32 {
        ((i as f64 + 0.5) * factor).fract() as f32
    }

    fn samples(cones: &Cones) -> impl Iterator<Item = Vec3> {
        // Irrational steps of Roberts's sequence.
        (0..200_000).map(move |i| {
            cones.sample([number(i, 0.819_172_51), number(i, 0.671_043_61), number(i, 0.549_700_48)])
        })
    }

    /// A direction out of all.
    fn on_sphere(u: [f32; 2]) -> Vec3 {
        let z = 1.0 - 2.0 * u[0];
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(radius * cos_phi, radius * sin_phi, z)
    }

    fn ball(center: Vec3, radius: f32) -> LightShape {
        LightShape::Sphere { center, radius }
    }

    #[test]
    fn densities_are_those_of_what_is_drawn() {
        let sun = LightShape::Sun { direction: Vec3::Y, half_angle: 0.005 };
        let near = ball(Vec3::new(0.0, 1.0, 0.3), 0.4);
        let far = ball(Vec3::new(4.0, 0.0, 2.0), 1e-4);
        for shapes in [vec![sun], vec![near], vec![far], vec![sun, near, far]] {
            let cones = guide(&shapes).seen();
            // The integral of 1 over a half-space and over the rest, where there is any density.
            let mut integrals = [0.0_f64; 2];
            let mut reached = 0;
            for direction in samples(&cones) {
                let density = cones.density(direction);
                assert!(direction.is_normalized());
                if density > 0.0 {
                    reached += 1;
                    integrals[usize::from(direction.x > 0.0)] += 1.0 / f64::from(density) / 200_000.0;
                }
            }
            // Rounding at the rims of cones.
            assert!(reached > 199_000, "{reached}");
            let mut expected = [0.0_f64; 2];
            for i in 0..2_000_000 {
                let direction =
                    on_sphere([number(i, 0.754_877_666_246_692_7), number(i, 0.569_840_290_998_053_2)]);
                if cones.density(direction) > 0.0 {
                    expected[usize::from(direction.x > 0.0)] += f64::from(2.0 * TAU) / 2e6;
                }
            }
            for (found, expected) in integrals.iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 0.02 * expected.max(0.01),
                    "{shapes:?}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    fn half_of_the_directions_meet_the_light() {
        for radius in [0.003, 0.05, 0.5] {
            let center = Vec3::new(1.0, -2.0, 0.5);
            let cones = guide(&[ball(center, radius)]).seen();
            let hits = samples(&cones)
                .filter(|direction| center.cross(*direction).length() <= radius * (1.0 + 1e-4))
                .count();
            assert!(hits > 100_000, "{hits} of 200000");
        }
    }

    #[test]
    fn lights_are_left_to_chance_where_it_meets_them_or_they_do_not_shine() {
        let all = Vec3::new(3.0, 0.0, 0.0);
        assert!(guide(&[ball(all, 2.0)]).seen().share == 0.0);
        assert!(guide(&[ball(all, 3.1)]).seen().share == 0.0);
        let spot = |axis: Vec3| LightShape::Spot {
            center: all,
            radius: 0.1,
            axis,
            half_angle: 0.5,
            blend: 0.0,
            soft_falloff: true,
        };
        assert!(guide(&[spot(Vec3::X)]).seen().share == 0.0);
        let to_us = guide(&[spot(-Vec3::X)]).seen();
        assert_eq!((to_us.list.len(), to_us.share > 0.49), (1, true));
        let quad = LightShape::Quad { center: all, edge_u: 0.1 * Vec3::Y, edge_v: 0.1 * Vec3::Z, spread: PI };
        assert!(guide(&[quad]).seen().share == 0.0);
        assert!(guide(&[quad]).seen_from(Vec3::new(6.0, 0.0, 0.0)).share > 0.0);
    }

    #[test]
    fn there_is_none_without_lights_or_share() {
        let light = light(&ball(Vec3::ZERO, 1.0));
        assert!(Guide::new(&[], 0.5).is_none() && Guide::new(&[light], 0.0).is_none());
    }

    #[test]
    fn of_too_many_lights_the_strongest_are_looked_for() {
        let at = |i: usize| light(&ball(Vec3::new(3.0, 0.3 * i as f32, 0.0), 0.01));
        let mut lights: Vec<Light> = (0..MOST_LIGHTS + 1).map(at).collect();
        lights[MOST_LIGHTS].radiance = [2.0; 3];
        let guide = Guide::new(&lights, 0.5).unwrap();
        assert_eq!(guide.lights.len(), MOST_LIGHTS);
        assert!((guide.lights[0].brightness - 2.0).abs() < 1e-6);
    }

    #[test]
    fn suns_are_looked_for_before_any_lamp() {
        let lamp = light(&ball(Vec3::X, 1.0));
        let sun = light(&LightShape::Sun { direction: Vec3::Z, half_angle: 0.005 });
        let lights: Vec<Light> = [vec![lamp; MOST_LIGHTS], vec![sun]].concat();
        let guide = Guide::new(&lights, 0.5).unwrap();
        assert!(matches!(guide.lights[0].place, Place::Sky { .. }));
    }

    #[test]
    fn lights_that_take_light_away_are_looked_for_like_others() {
        let shape = ball(Vec3::new(2.0, 1.0, 0.0), 0.05);
        let bright = light(&shape);
        let dark = Light { radiance: [-1.0; 3], ..bright.clone() };
        let chances = [&bright, &dark].map(|one| {
            let guide = Guide::new(&[one.clone(), light(&ball(Vec3::X, 0.01))], 0.5);
            chance_to_meet(guide.as_ref(), Vec3::ZERO, one).unwrap()
        });
        assert!(chances[0] > 0.1 && chances[0] == chances[1], "{chances:?}");
    }

    #[test]
    fn chance_to_meet_a_light_is_that_of_what_is_drawn() {
        let lamp = ball(Vec3::new(2.0, -1.0, 1.0), 0.05);
        let moved = ball(Vec3::new(2.0, 1.5, 1.0), 0.05);
        let guide = guide(&[lamp]);
        let cones = guide.seen();
        let at = |shape: &LightShape| chance_to_meet(Some(&guide), Vec3::ZERO, &light(shape)).unwrap();
        let by_chance = chance_to_meet(None, Vec3::ZERO, &light(&lamp)).unwrap();
        assert!((by_chance / (0.05 * 0.05 / 6.0) - 1.0).abs() < 0.01, "{by_chance}");
        let hit = |direction: &Vec3| Vec3::new(2.0, -1.0, 1.0).cross(*direction).length() <= 0.05;
        let drawn = samples(&cones).filter(hit).count() as f32 / 200_000.0;
        let expected = 0.5 * drawn + 0.5 * by_chance;
        assert!((at(&lamp) / expected - 1.0).abs() < 0.02, "{} for {expected}", at(&lamp));
        assert!(at(&moved) < by_chance && at(&moved) > 0.4 * by_chance, "{}", at(&moved));
        let away = LightShape::Spot {
            center: Vec3::new(2.0, -1.0, 1.0),
            radius: 0.05,
            axis: Vec3::X,
            half_angle: 0.5,
            blend: 0.0,
            soft_falloff: true,
        };
        assert!(chance_to_meet(None, Vec3::ZERO, &light(&away)).is_none());
    }
}
