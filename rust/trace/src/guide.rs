//! Where the file's lights stand, for paths to look there more often.
//!
//! A share of the directions is drawn towards the lights (points of area lights, cones around others) instead of from the BSDF,
//! and every direction is weighted by the density of both ways together (one-sample model with the balance heuristic; Veach
//! 1997, section 9.2.4). So paths stay right for any light whatever, and those lights that stand near these are met far more
//! often than by chance: a bulb of 5 cm radius in 3 m distance fills 1/7200 of a hemisphere. Lights that chance meets often
//! enough are left to it.

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
/// Points are drawn on area lights that are larger by this in each direction, so that rounding at their rims is not at theirs.
const RIM: f32 = 1.01;
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
    /// On one side of a plane, in a ball.
    Flat { center: Vec3, radius: f32, plate: Plate },
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
    /// To one side.
    Front {
        normal: Vec3,
    },
}

/// A rectangle or an ellipse around a centre, larger by [`RIM`] than the light.
#[derive(Clone, Copy, Debug)]
struct Plate {
    /// Full edges, perpendicular.
    edges: [Vec3; 2],
    /// Edges over their squared length: they give a place on the plate, -1/2 to 1/2.
    across: [Vec3; 2],
    /// Unit, to the side that shines.
    normal: Vec3,
    area: f32,
    is_ellipse: bool,
}

/// What directions to a light are drawn from.
#[derive(Clone, Copy, Debug)]
enum Narrow {
    /// A cone of this height around the axis.
    Cone(f32),
    /// Points of a plate that is there from here, all alike.
    Plate { to_center: Vec3, plate: Plate },
}

/// Share of the directions from a matt surface that faces a light which meet it if nothing is in between, with paths that look
/// for what `guide` says. Nothing where the light does not shine to.
pub fn chance_to_meet(guide: Option<&Guide>, point: Vec3, light: &Light) -> Option<f32> {
    let aim = Aim::at(light);
    let seen = aim.seen_from(point);
    let mut cones = Cones::default();
    if let Some(guide) = guide {
        guide.look_from(point, Horizon::default(), &mut cones);
    }
    let density = (1.0 - cones.share) / PI + cones.share * cones.density(seen.axis);
    let shines = aim.beam.reaches(-seen.axis);
    shines.then(|| (TAU * seen.height * density).min(1.0))
}

/// The lights as one point sees them. Reused from point to point: nothing is allocated.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cones {
    list: Vec<Pair>,
    /// Share of the directions that are drawn from them, below 1; 0 where chance does as well.
    pub share: f32,
}

/// Directions to a light, and a cone that holds them. A cone is told by its height, 1 less the cosine of its half angle, which
/// stays precise where cosines are all 1.
#[derive(Clone, Copy, Debug)]
struct Pair {
    axis: Vec3,
    narrow: Narrow,
    /// Height of the cone.
    wide: f32,
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

    /// Makes `cones` those that are seen from a point above its horizon.
    pub(crate) fn look_from(&self, point: Vec3, horizon: Horizon, cones: &mut Cones) {
        cones.list.clear();
        let (mut all, mut wanted) = (0.0, 0.0);
        for aim in &self.lights {
            let seen = aim.seen_from(point);
            if !aim.beam.reaches(-seen.axis) || horizon.hides(seen.axis, seen.sine_squared) {
                continue;
            }
            // Irradiance is what a light matters by here; by its root, so that weak lights can be turned up later.
            let weight = (aim.brightness * seen.height).sqrt();
            let want = weight * (1.0 - seen.height / LARGE).max(0.0);
            all += weight;
            if want > 0.0 {
                wanted += want;
                let wide = height((32.0 * seen.height).max(seen.sine_squared).clamp(WIDE, 1.0));
                cones.list.push(Pair { axis: seen.axis, narrow: seen.narrow, wide, probability: want });
            }
        }
        cones.list.iter_mut().for_each(|pair| pair.probability /= wanted);
        cones.share = if wanted > 0.0 { self.share * wanted / all } else { 0.0 };
    }
}

/// Where a surface gets no light from: nothing comes in from below both of its normals. By default, everything counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Horizon(pub Option<[Vec3; 2]>);

impl Horizon {
    /// Whether a cone of less than a half-space is all below.
    fn hides(self, axis: Vec3, sine_squared: f32) -> bool {
        self.0.is_some_and(|normals| {
            let is_below = |normal: Vec3| {
                let cos = normal.dot(axis);
                cos < 0.0 && cos * cos > sine_squared
            };
            normals.into_iter().all(is_below)
        })
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
        let u = [u[1], u[2]];
        if rest >= 0.5 * chosen.probability {
            return sample_cone(chosen.axis, chosen.wide, u);
        }
        match chosen.narrow {
            Narrow::Cone(height) => sample_cone(chosen.axis, height, u),
            Narrow::Plate { to_center, plate } => (to_center + plate.sample(u)).normalize_or(chosen.axis),
        }
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
            let narrow = match &pair.narrow {
                Narrow::Cone(height) if apart <= *height => 1.0 / (TAU * height),
                Narrow::Cone(_) => 0.0,
                Narrow::Plate { to_center, plate } => plate.density(*to_center, direction),
            };
            let wide = if apart <= pair.wide { 1.0 / (TAU * pair.wide) } else { 0.0 };
            sum += pair.probability * 0.5 * (narrow + wide);
        }
        sum
    }
}

impl Plate {
    fn new(edge_u: Vec3, edge_v: Vec3, is_ellipse: bool) -> Self {
        let edges = [edge_u * RIM, edge_v * RIM];
        let cross = edges[0].cross(edges[1]);
        let share = if is_ellipse { 0.25 * PI } else { 1.0 };
        Self {
            edges,
            across: edges.map(|edge| edge / edge.length_squared()),
            normal: cross.normalize_or(Vec3::Z),
            area: cross.length() * share,
            is_ellipse,
        }
    }

    /// Solid angle from afar, over that of a hemisphere; 0 from behind.
    fn height(&self, to_center: Vec3) -> f32 {
        let cos = -self.normal.dot(to_center) / to_center.length();
        self.area * cos.max(0.0) / (to_center.length_squared() * TAU)
    }

    /// A point, from the centre.
    fn sample(&self, u: [f32; 2]) -> Vec3 {
        let [x, y] = if self.is_ellipse {
            let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
            let radius = 0.5 * u[0].sqrt();
            [radius * cos_phi, radius * sin_phi]
        } else {
            u.map(|u| u - 0.5)
        };
        self.edges[0] * x + self.edges[1] * y
    }

    /// Density over solid angle of directions to [`Plate::sample`]: squared distance over area and cosine.
    fn density(&self, to_center: Vec3, direction: Vec3) -> f32 {
        let cos = -self.normal.dot(direction);
        let distance = -self.normal.dot(to_center) / cos;
        if !(cos > 0.0 && distance > 0.0) {
            return 0.0;
        }
        let from_center = direction * distance - to_center;
        let [x, y] = self.across.map(|across| across.dot(from_center));
        let is_inside = if self.is_ellipse { x * x + y * y <= 0.25 } else { x.abs().max(y.abs()) <= 0.5 };
        if is_inside { distance * distance / (self.area * cos) } else { 0.0 }
    }
}

/// A light as a point sees it.
struct Seen {
    /// Direction to its middle.
    axis: Vec3,
    /// Of the half angle of the cone around it; 1 or more from inside of the ball that holds the light.
    sine_squared: f32,
    /// Solid angle over that of a hemisphere.
    height: f32,
    narrow: Narrow,
}

impl Aim {
    fn at(light: &Light) -> Self {
        let flat = |center: Vec3, radius: f32, plate: Plate| {
            (Place::Flat { center, radius, plate }, Beam::Front { normal: plate.normal })
        };
        let (place, beam) = match light.shape {
            LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
                (Place::Ball { center, radius }, Beam::Everywhere)
            }
            LightShape::Spot { center, radius, axis, half_angle, .. } => {
                (Place::Ball { center, radius }, Beam::Cone { axis, cos: half_angle.cos() })
            }
            LightShape::Quad { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * (edge_u.length_squared() + edge_v.length_squared()).sqrt();
                flat(center, radius, Plate::new(edge_u, edge_v, false))
            }
            LightShape::Ellipse { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * edge_u.length().max(edge_v.length());
                flat(center, radius, Plate::new(edge_u, edge_v, true))
            }
            LightShape::Sun { direction, half_angle } => (
                Place::Sky { direction, sine_squared: half_angle.min(0.5 * PI).sin().powi(2) },
                Beam::Everywhere,
            ),
        };
        Self { place, brightness: brightness(light), beam }
    }

    fn seen_from(&self, point: Vec3) -> Seen {
        let (to_center, radius, plate) = match self.place {
            Place::Sky { direction, sine_squared } => return Seen::in_cone(direction, sine_squared),
            Place::Ball { center, radius } => (center - point, radius, None),
            Place::Flat { center, radius, plate } => (center - point, radius, Some(plate)),
        };
        let inverse = to_center.length_recip();
        let ball = Seen::in_cone(to_center * inverse, (radius * inverse).powi(2));
        let Some(plate) = plate else { return ball };
        let height = plate.height(to_center).min(ball.height);
        // Single precision would miss plates that look smaller.
        let is_large = 2.0 * height > NARROWEST;
        Seen {
            height,
            narrow: if is_large { Narrow::Plate { to_center, plate } } else { ball.narrow },
            ..ball
        }
    }
}

impl Seen {
    fn in_cone(axis: Vec3, sine_squared: f32) -> Self {
        let narrow = Narrow::Cone(height(sine_squared.clamp(NARROWEST, 1.0)));
        Self { axis, sine_squared, height: height(sine_squared.min(1.0)), narrow }
    }
}

impl Beam {
    /// Whether a light shines in a direction away from it.
    fn reaches(&self, direction: Vec3) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Cone { axis, cos } => axis.dot(direction) >= *cos,
            Self::Front { normal } => normal.dot(direction) > 0.0,
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
            self.look_from(point, Horizon::default(), &mut cones);
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
        let u = Vec3::new(0.6, 0.0, 0.8);
        let strip =
            LightShape::Quad { center: 2.0 * Vec3::X, edge_u: 1.2 * u, edge_v: 0.04 * Vec3::Y, spread: PI };
        let oval = LightShape::Ellipse {
            center: 2.0 * Vec3::X,
            edge_u: 0.2 * u,
            edge_v: 0.9 * Vec3::Y,
            spread: 1.0,
        };
        let grazing = LightShape::Quad {
            center: Vec3::new(1.0, 0.3, 0.0),
            edge_u: Vec3::X,
            edge_v: 0.4 * Vec3::Z + 0.1 * Vec3::Y,
            spread: PI,
        };
        let all = vec![sun, near, far, strip, oval];
        for shapes in [vec![sun], vec![near], vec![far], vec![strip], vec![oval], vec![grazing], all] {
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
    fn lights_below_both_normals_are_not_looked_for() {
        let guide = guide(&[LightShape::Sun { direction: Vec3::Z, half_angle: 0.005 }]);
        let share = |normals| {
            let mut cones = Cones::default();
            guide.look_from(Vec3::ZERO, Horizon(normals), &mut cones);
            cones.share
        };
        let (down, level) = (Vec3::new(0.6, 0.0, -0.8), Vec3::new(1.0, 0.0, -0.001));
        assert_eq!(share(Some([down, -Vec3::Z])), 0.0);
        assert!(share(Some([down, level])) > 0.0 && share(Some([Vec3::Z, down])) > 0.0 && share(None) > 0.0);
    }

    #[test]
    fn chance_to_meet_a_strip_is_that_of_its_solid_angle() {
        let center = Vec3::new(0.0, 0.0, 3.0);
        let strip = LightShape::Quad { center, edge_u: 1.2 * Vec3::X, edge_v: -0.03 * Vec3::Y, spread: PI };
        let chance = chance_to_meet(None, Vec3::ZERO, &light(&strip)).unwrap();
        assert!((chance / (1.2 * 0.03 / (9.0 * PI)) - 1.0).abs() < 0.03, "{chance}");
        let far = Vec3::new(0.0, 0.0, -3000.0);
        let chance_from_far = chance_to_meet(None, far, &light(&strip)).unwrap();
        assert!((chance_from_far / chance * 1001.0_f32.powi(2) - 1.0).abs() < 1e-3, "{chance_from_far}");
        let guide = guide(&[strip]);
        let guided = chance_to_meet(Some(&guide), Vec3::ZERO, &light(&strip)).unwrap();
        let meets = |direction: Vec3| {
            let place = direction * (3.0 / direction.z);
            direction.z > 0.0 && place.x.abs() <= 0.6 && place.y.abs() <= 0.015
        };
        let drawn = samples(&guide.seen()).filter(|direction| meets(*direction)).count() as f32 / 200_000.0;
        assert!((guided / (0.5 * drawn + 0.5 * chance) - 1.0).abs() < 0.03, "{guided}, {drawn} drawn");
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
