//! Points on lights as seen from a point, for shadow rays.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::{Vec2, Vec3};
use relume_dump::{ByConnectedLobe, Lobe, Manifest};
use relume_scene::{Light, LightShape, ReceiverSet};

use crate::GatherError;
use crate::balance::Balance;
use crate::light::{Ball, FAR, Plane, PreparedLight, Profile, Spread};
use crate::lobes::factor_of;
use crate::rules::{shift, with_rules};

/// A light that is summed over vertices by points on it, but for the shares that count by crossings. Its size has no floor.
#[derive(Clone, Debug)]
pub struct Emitter {
    light: PreparedLight,
    /// Corners of the box outside of which nothing is recorded, metres; none if all is.
    recorded: Option<[Vec3; 2]>,
    /// The only objects that block it; none where all do.
    blockers: Option<ReceiverSet>,
    /// Number to add to those of receivers that all objects' shadows fall on.
    shift: u16,
}

/// A direction towards a light.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction.
    pub direction: Vec3,
    /// Metres to the light; infinite for a sun.
    pub distance: f32,
    /// Radiance from there for a light of radiance 1, over the density of the direction, RGB.
    pub radiance: Vec3,
}

impl Emitter {
    /// True if a light need not be summed over the crossings of a dump alone. Where its object is sheared it is, or where something
    /// else blocks it than was known for the dump.
    pub fn covers(light: &Light, manifest: &Manifest) -> bool {
        let is_sheared = matches!(light.shape, LightShape::Sheared { .. });
        let is_seen = Lobe::CONNECTED.iter().any(|lobe| factor_of(&light.lobes, *lobe) != 0.0);
        is_seen && !is_sheared && shift(light, manifest).is_some()
    }

    /// A light for the vertices of a dump's paths.
    ///
    /// # Errors
    /// See [`PreparedLight::new`].
    pub fn new(light: &Light, manifest: &Manifest, balance: Balance) -> Result<Self, GatherError> {
        Ok(Self {
            light: PreparedLight::new(&with_rules(light, manifest), 0.0)?.balanced(balance),
            recorded: manifest.recorded.map(|corners| corners.map(Vec3::from)),
            blockers: light.rules.blockers.clone(),
            shift: shift(light, manifest).unwrap_or_default(),
        })
    }

    /// Factors on its light on a receiver by [`Lobe::CONNECTED`]; 0 if that is not lit.
    pub fn factors(&self, receiver: u16) -> ByConnectedLobe<f32> {
        if !self.light.lights(receiver + self.shift) {
            return ByConnectedLobe::default();
        }
        Lobe::CONNECTED.map(|lobe| self.light.factors[lobe as usize])
    }

    /// The only objects that block it, by their receiver numbers; none where all do.
    pub fn blockers(&self) -> Option<&ReceiverSet> {
        self.blockers.as_ref()
    }

    /// Its middle, and about how far it reaches around that, metres; none of a sun.
    pub fn center(&self) -> Option<(Vec3, f32)> {
        match self.light.profile {
            Profile::Sphere(ball)
            | Profile::FacingDisk(ball)
            | Profile::Spot { ball, .. }
            | Profile::StretchedSpot { ball, .. } => Some((ball.center, ball.radius)),
            Profile::Area { plane, .. } => {
                Some((plane.center, 0.5 / plane.inverse_u.length().max(plane.inverse_v.length())))
            }
            Profile::Sun { .. } | Profile::Sheared(_) => None,
        }
    }

    /// Shares of its light in a direction from a place that do not count by crossings, by [`Lobe::CONNECTED`].
    pub fn shares(&self, place: Vec3, direction: Vec3) -> ByConnectedLobe<f32> {
        let recorded = self.recorded_start(place, direction);
        Lobe::CONNECTED.map(|lobe| 1.0 - self.light.crossed.at(lobe, &self.light.profile, recorded))
    }

    /// Start of the record of a ray: where it enters the box outside of which nothing is recorded, if it starts outside.
    fn recorded_start(&self, place: Vec3, direction: Vec3) -> Vec3 {
        let Some([min, max]) = self.recorded else { return place };
        let entries = (min - place) / direction;
        let others = (max - place) / direction;
        // Of a ray along a plane of the box the quotients are infinite, or not a number on the plane itself.
        let entry = entries.min(others).to_array().into_iter().filter(|entry| entry.is_finite());
        place + direction * entry.fold(0.0, f32::max)
    }

    /// A direction from a point to the light by two numbers in 0..1; nothing if none of its light comes that way. A surface there faces
    /// `normal`, of unit length; in a medium there is none.
    pub fn sample(&self, origin: Vec3, normal: Option<Vec3>, u: [f32; 2]) -> Option<LightSample> {
        if normal.is_some_and(|normal| is_behind(&self.light.profile, origin, normal)) {
            return None;
        }
        let (direction, density) = direction(&self.light.profile, origin, normal, u)?;
        let (edge, distance, escapes) = match self.light.profile {
            Profile::Sun { .. } => (direction * FAR, f32::INFINITY, true),
            _ => {
                let distance = self.light.profile.distance(origin, direction);
                (direction * (2.0 * distance), distance, false)
            }
        };
        let collected = self.light.profile.evaluate(origin, edge, escapes);
        if !(collected > 0.0 && density > 0.0) {
            return None;
        }
        let tint = self.light.map.as_ref().map_or(Vec3::ONE, |map| map.factor(origin, edge));
        Some(LightSample { direction, distance, radiance: tint * (collected / density) })
    }
}

/// True if all of a light is behind a surface at a place with a unit normal.
fn is_behind(profile: &Profile, place: Vec3, normal: Vec3) -> bool {
    match *profile {
        Profile::Sphere(ball)
        | Profile::FacingDisk(ball)
        | Profile::Spot { ball, .. }
        | Profile::StretchedSpot { ball, .. } => (ball.center - place).dot(normal) < -ball.radius,
        Profile::Area { plane, .. } => {
            let reach = |inverse: Vec3| 0.5 * (inverse / inverse.length_squared()).dot(normal).abs();
            (plane.center - place).dot(normal) < -(reach(plane.inverse_u) + reach(plane.inverse_v))
        }
        Profile::Sun { .. } | Profile::Sheared(_) => false,
    }
}

/// A direction to a light, and its density by solid angle.
fn direction(profile: &Profile, origin: Vec3, normal: Option<Vec3>, u: [f32; 2]) -> Option<(Vec3, f32)> {
    match *profile {
        Profile::Sphere(ball)
        | Profile::Spot { ball, soft_falloff: false, .. }
        | Profile::StretchedSpot { ball, soft_falloff: false, .. } => to_sphere(ball, origin, normal, u),
        Profile::FacingDisk(ball) | Profile::Spot { ball, .. } | Profile::StretchedSpot { ball, .. } => {
            let to_center = ball.center - origin;
            let tan2 = ball.radius * ball.radius / to_center.length_squared();
            let secant = (1.0 + tan2).sqrt();
            Some(in_cone(to_center.try_normalize()?, tan2 / (secant * (secant + 1.0)), u))
        }
        Profile::Area { plane, spread } => to_plane(&plane, spread, origin, u),
        Profile::Sun { direction, chord2 } => Some(in_cone(direction, 0.5 * chord2, u)),
        Profile::Sheared(_) => None,
    }
}

/// A direction into the cone that holds a sphere; from inside of it, one by its cosine to the normal, or any without one.
fn to_sphere(ball: Ball, origin: Vec3, normal: Option<Vec3>, u: [f32; 2]) -> Option<(Vec3, f32)> {
    let to_center = ball.center - origin;
    let sine2 = ball.radius * ball.radius / to_center.length_squared();
    if sine2 < 1.0 {
        return Some(in_cone(to_center.normalize(), sine2 / (1.0 + (1.0 - sine2).sqrt()), u));
    }
    let Some(normal) = normal else { return Some(in_cone(Vec3::Z, 2.0, u)) };
    let cos = (1.0 - u[0]).sqrt();
    Some((around(normal, cos, u[0].sqrt(), u[1]), cos * FRAC_1_PI))
}

/// A direction into a cone, uniform by solid angle; `height` is 1 less the cosine of its half angle.
fn in_cone(axis: Vec3, height: f32, u: [f32; 2]) -> (Vec3, f32) {
    let below = u[0] * height;
    let sine = (below * (2.0 - below)).max(0.0).sqrt();
    (around(axis, 1.0 - below, sine, u[1]), 1.0 / (TAU * height))
}

/// The direction of an angle to an axis, turned by a share of a full turn.
fn around(axis: Vec3, cos: f32, sine: f32, turn: f32) -> Vec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let (sin_turn, cos_turn) = (turn * TAU).sin_cos();
    axis * cos + (x * cos_turn + y * sin_turn) * sine
}

/// A direction to a point that is uniform on an area, or on the square of it that shines to there.
fn to_plane(plane: &Plane, spread: Option<Spread>, origin: Vec3, u: [f32; 2]) -> Option<(Vec3, f32)> {
    let [edge_u, edge_v] =
        [plane.inverse_u, plane.inverse_v].map(|inverse| inverse / inverse.length_squared());
    let (low, high) = match spread {
        Some(spread) => shining(plane, spread, origin)?,
        None => (Vec2::splat(-0.5), Vec2::splat(0.5)),
    };
    let rectangle = (high - low).element_product();
    let (place, share) = if plane.is_ellipse && rectangle > 0.25 * PI {
        let radius = 0.5 * u[0].sqrt();
        (Vec2::from_angle(u[1] * TAU) * radius, 0.25 * PI)
    } else {
        (low + Vec2::from(u) * (high - low), rectangle)
    };
    let towards = plane.center + edge_u * place.x + edge_v * place.y - origin;
    let direction = towards.try_normalize()?;
    let area = edge_u.length() * edge_v.length() * share;
    let cos = -direction.dot(plane.normal);
    (cos > 0.0).then(|| (direction, towards.length_squared() / (cos * area)))
}

/// Corners of the rectangle of an area, in lengths of its edges from its centre, that holds all points which shine to a place;
/// nothing if none does.
fn shining(plane: &Plane, spread: Spread, origin: Vec3) -> Option<(Vec2, Vec2)> {
    let from_center = origin - plane.center;
    let inverse = [plane.inverse_u, plane.inverse_v];
    let middle = Vec2::from(inverse.map(|inverse| from_center.dot(inverse)));
    let radius = from_center.dot(plane.normal) * spread.tan_half;
    let half = Vec2::from(inverse.map(|inverse| radius * inverse.length()));
    let [low, high] =
        [middle - half, middle + half].map(|corner| corner.clamp(Vec2::splat(-0.5), Vec2::splat(0.5)));
    low.cmplt(high).all().then_some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::kernels::{random_dump_of, random_lights};
    use relume_dump::SegmentClasses;
    use relume_scene::LobeFactors;

    /// Fractions of the golden ratio's two-dimensional kin: points that fill the square evenly.
    fn even(i: usize) -> [f32; 2] {
        [0.754_877_666, 0.569_840_291].map(|step: f64| (0.5 + step * i as f64).fract() as f32)
    }

    #[test]
    fn samples_of_all_lights_add_up_to_their_light() {
        const COUNT: usize = 1 << 17;
        let manifest = random_dump_of(2, &[1]).manifest().clone();
        let normal = Vec3::new(0.36, 0.48, 0.8);
        let origins = [Vec3::ZERO, Vec3::new(1.0, -0.5, 0.3), Vec3::new(-6.0, 4.0, 5.0)];
        let mut seen = 0;
        for light in random_lights().iter().filter(|light| Emitter::covers(light, &manifest)) {
            let emitter = Emitter::new(light, &manifest, Balance { connected: 1, crossed: 1 }).unwrap();
            for origin in origins {
                let above = |direction: Vec3| direction.dot(normal).max(0.0);
                let of_emitter = |i| {
                    let sample = emitter.sample(origin, Some(normal), even(i));
                    sample.map_or(0.0, |sample| f64::from(sample.radiance.x * above(sample.direction)))
                };
                let of_sphere = |i| {
                    let [u, v] = even(i);
                    let z = 2.0 * u - 1.0;
                    let direction = around(Vec3::Z, z, (1.0 - z * z).sqrt(), v);
                    let is_sun = matches!(light.shape, LightShape::Sun { .. });
                    let collected = emitter.light.profile.evaluate(origin, direction * FAR, is_sun);
                    f64::from(4.0 * PI * collected * above(direction))
                };
                let mean = |of: &dyn Fn(usize) -> f64| (0..COUNT).map(of).sum::<f64>() / COUNT as f64;
                let (found, expected) = (mean(&of_emitter), mean(&of_sphere));
                assert!(
                    (found - expected).abs() < 0.01 * expected + 1e-3,
                    "{found} for {expected}: {:?} from {origin}",
                    light.shape
                );
                seen += usize::from(expected > 0.01);
            }
        }
        assert!(seen > 60, "{seen} lights were seen");
    }

    #[test]
    fn an_area_of_narrow_spread_lights_what_is_below_it_as_a_lambertian_one_all_around() {
        let manifest = random_dump_of(2, &[1]).manifest().clone();
        let [edge_u, edge_v] = [Vec3::X, Vec3::NEG_Y];
        for spread in [0.3, 0.01] {
            for shape in [
                LightShape::Quad { center: Vec3::ZERO, edge_u, edge_v, spread },
                LightShape::Ellipse { center: Vec3::ZERO, edge_u, edge_v, spread },
            ] {
                let light = Light::unit(shape);
                let emitter = Emitter::new(&light, &manifest, Balance { connected: 1, crossed: 1 }).unwrap();
                let irradiance = |x: f32| {
                    let of = |i| {
                        let sample = emitter.sample(Vec3::new(x, 0.2, -1.0), Some(Vec3::Z), even(i));
                        sample.map_or(0.0, |sample| sample.radiance.x * sample.direction.z)
                    };
                    (0..4096).map(of).sum::<f32>() / 4096.0
                };
                // A spread is normalised so that the irradiance stays that of a Lambertian area all around, pi.
                assert!((irradiance(0.2) / PI - 1.0).abs() < 0.02, "{} of {spread}", irradiance(0.2));
                assert_eq!(irradiance(0.7), 0.0);
            }
        }
    }

    #[test]
    fn lights_with_blockers_that_the_dump_does_not_know_are_summed_over_crossings() {
        let mut manifest = random_dump_of(2, &[1]).manifest().clone();
        let mut light = random_lights()[0].clone();
        assert!(Emitter::covers(&light, &manifest));
        light.rules.blockers = Some(ReceiverSet { receivers: vec![1] });
        assert!(!Emitter::covers(&light, &manifest));
        let blockers = vec![vec![], vec![1]];
        manifest.classes = Some(SegmentClasses { blockers, ..SegmentClasses::default() });
        assert!(Emitter::covers(&light, &manifest));
        let emitter = Emitter::new(&light, &manifest, Balance { connected: 1, crossed: 1 }).unwrap();
        // Classes are shadow rays of all, rays that only mirrors send, and those of both sets.
        assert_eq!(usize::from(emitter.shift), 3 * manifest.receivers.len());
        light.lobes = LobeFactors { camera: 1.0, diffuse: 0.0, glossy: 0.0, transmission: 0.0, volume: 0.0 };
        assert!(!Emitter::covers(&light, &manifest));
    }
}
