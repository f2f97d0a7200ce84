use glam::Vec3;

/// A sphere light as the optimiser sees it (paper, section 5.3).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SphereLight {
    /// Centre in world space, metres.
    pub center: Vec3,
    /// Radius, metres.
    pub radius: f32,
    /// Radiance, scene-linear RGB.
    pub radiance: [f32; 3],
}

/// Where lights may go.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// Lower corner of the box of centres, metres.
    pub center_min: Vec3,
    /// Upper corner.
    pub center_max: Vec3,
    /// Smallest radius, above 0, metres.
    pub radius_min: f32,
    /// Largest radius.
    pub radius_max: f32,
}

/// Which parameters of a light stay as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Locks {
    /// The centre.
    pub center: bool,
    /// The radius.
    pub radius: bool,
    /// The radiance.
    pub radiance: bool,
}

/// Unconstrained values of a light: centre, radius, radiance.
pub(crate) const PARAMS: usize = 7;

impl Locks {
    /// Whether parameter `i` of [`PARAMS`] may move.
    pub(crate) fn free(&self, i: usize) -> bool {
        !match i {
            0..3 => self.center,
            3 => self.radius,
            _ => self.radiance,
        }
    }
}

/// The map between a light and unconstrained values: logistic within bounds, softplus for radiance in units of
/// `radiance_unit`. Locked parameters pass unchanged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mapping {
    pub(crate) bounds: Bounds,
    pub(crate) locks: Locks,
    /// Radiance that brings this light to the target's brightness. Steps of Adam have one size, whatever the scene's
    /// unit of light; this makes them meaningful.
    pub(crate) radiance_unit: f32,
}

impl Mapping {
    pub(crate) fn unconstrained(&self, light: &SphereLight) -> [f32; PARAMS] {
        std::array::from_fn(|i| {
            let value = get(light, i);
            match self.range(i) {
                _ if !self.locks.free(i) => value,
                Some((low, high)) => logit((value - low) / (high - low)),
                None => inverse_softplus(value / self.radiance_unit),
            }
        })
    }

    pub(crate) fn light(&self, u: &[f32]) -> SphereLight {
        let value: [f32; PARAMS] = std::array::from_fn(|i| match self.range(i) {
            _ if !self.locks.free(i) => u[i],
            Some((low, high)) => low + (high - low) * logistic(u[i]),
            None => self.radiance_unit * softplus(u[i]),
        });
        SphereLight {
            center: Vec3::from_slice(&value),
            radius: value[3],
            radiance: [value[4], value[5], value[6]],
        }
    }

    /// Gradient by the unconstrained values from the gradient by the light's parameters; 0 where locked.
    pub(crate) fn pull_back(&self, u: &[f32], d_light: [f32; PARAMS]) -> [f32; PARAMS] {
        std::array::from_fn(|i| match self.range(i) {
            _ if !self.locks.free(i) => 0.0,
            Some((low, high)) => {
                let s = logistic(u[i]);
                d_light[i] * (high - low) * s * (1.0 - s)
            }
            None => d_light[i] * self.radiance_unit * logistic(u[i]),
        })
    }

    fn range(&self, i: usize) -> Option<(f32, f32)> {
        match i {
            0..3 => Some((self.bounds.center_min[i], self.bounds.center_max[i])),
            3 => Some((self.bounds.radius_min, self.bounds.radius_max)),
            _ => None,
        }
    }
}

fn get(light: &SphereLight, i: usize) -> f32 {
    match i {
        0..3 => light.center[i],
        3 => light.radius,
        _ => light.radiance[i - 4],
    }
}

fn logistic(u: f32) -> f32 {
    1.0 / (1.0 + (-u).exp())
}

/// Values at or beyond the bounds start just inside them, where the logistic function still has a slope.
fn logit(x: f32) -> f32 {
    let x = x.clamp(1e-3, 1.0 - 1e-3);
    (x / (1.0 - x)).ln()
}

fn softplus(u: f32) -> f32 {
    u.max(0.0) + (-u.abs()).exp().ln_1p()
}

/// Black starts as very dark, where softplus still has a slope.
fn inverse_softplus(x: f32) -> f32 {
    let x = x.max(1e-4);
    x + (-(-x).exp()).ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mapping(locks: Locks) -> Mapping {
        let bounds = Bounds {
            center_min: Vec3::new(-1.0, 0.0, 2.0),
            center_max: Vec3::new(3.0, 5.0, 9.0),
            radius_min: 0.05,
            radius_max: 0.8,
        };
        Mapping { bounds, locks, radiance_unit: 30.0 }
    }

    const LIGHT: SphereLight =
        SphereLight { center: Vec3::new(0.5, 4.0, 3.0), radius: 0.2, radiance: [100.0, 3.0, 0.5] };

    #[test]
    fn lights_survive_the_way_there_and_back() {
        let map = mapping(Locks::default());
        let back = map.light(&map.unconstrained(&LIGHT));
        for i in 0..PARAMS {
            let (a, b) = (get(&back, i), get(&LIGHT, i));
            assert!((a - b).abs() < 1e-4 * b.abs().max(1.0), "parameter {i}: {a} for {b}");
        }
    }

    #[test]
    fn wild_values_stay_in_bounds() {
        let map = mapping(Locks::default());
        for u in [-1e6, -3.0, 0.0, 50.0, 1e6] {
            let light = map.light(&[u; PARAMS]);
            assert!(light.center.cmpge(map.bounds.center_min).all() && light.radius >= 0.05);
            assert!(light.center.cmple(map.bounds.center_max).all() && light.radius <= 0.8);
            assert!(light.radiance.iter().all(|r| *r >= 0.0));
        }
    }

    #[test]
    fn locked_parameters_are_exact_even_out_of_bounds() {
        let map = mapping(Locks { center: true, radius: true, radiance: true });
        let light = SphereLight { center: Vec3::splat(-77.7), radius: 9.9, radiance: [0.0, 1e9, 0.123] };
        let u = map.unconstrained(&light);
        assert_eq!(map.light(&u), light);
        assert_eq!(map.pull_back(&u, [1.0; PARAMS]), [0.0; PARAMS]);
    }

    #[test]
    fn pull_back_is_the_slope_of_the_map() {
        let map = mapping(Locks::default());
        let u = map.unconstrained(&LIGHT);
        let slopes = map.pull_back(&u, [1.0; PARAMS]);
        for i in 0..PARAMS {
            let step = 1e-2;
            let (mut low, mut high) = (u, u);
            low[i] -= step;
            high[i] += step;
            let slope = (get(&map.light(&high), i) - get(&map.light(&low), i)) / (2.0 * step);
            assert!((slope - slopes[i]).abs() < 1e-2 * slopes[i].abs(), "{i}: {slope} for {}", slopes[i]);
        }
    }
}
