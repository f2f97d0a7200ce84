use crate::light::{Mapping, PARAMS};
use crate::{Bounds, Locks, OptimiseError, SphereLight};
use glam::Vec3;
use relume_image::{Image, metrics};

/// Whatever a relighter reports.
pub type RelightError = Box<dyn std::error::Error + Send + Sync>;

/// Something that makes unit images of sphere lights and their gradients, such as a proxy.
pub trait Relight: Sync {
    /// Width and height of its pictures.
    fn size(&self) -> (usize, usize);

    /// Unit image (radiance 1, linear RGB) of one light at some pixels (row-major numbers), into `out`.
    fn forward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        out: &mut [[f32; 3]],
    ) -> Result<(), RelightError>;

    /// Derivative of a loss by centre (3) and radius from its derivative by those pixels' values.
    fn backward(
        &self,
        center: Vec3,
        radius: f32,
        pixels: &[u32],
        d_out: &[[f32; 3]],
    ) -> Result<[f32; 4], RelightError>;

    /// Takes over the comparison of pictures, if that is better done where they are made: on a device, from which they then
    /// need not come back. `base` and `target` are of [`Relight::size`], and what is compared is multiplied with `exposure`
    /// before Reinhard's curve.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn comparison<'a>(
        &'a self,
        _base: &Image,
        _target: &Image,
        _exposure: f32,
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        Ok(None)
    }
}

/// Compares a base with lights over it to a target.
pub trait Compare {
    /// The paper's equation 6 at some pixels, and its derivative by each light's centre (3), radius and radiance (3).
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn gradient(&self, lights: &[SphereLight], pixels: &[u32]) -> Result<(f64, Vec<[f32; 7]>), RelightError>;
}

/// What is to be solved: lights whose sum over `base` looks like `target`.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The relighter.
    pub relight: &'a dyn Relight,
    /// What the picture should be, scene-linear RGB.
    pub target: &'a Image,
    /// What is there without the solved lights: static layer, world, other lights.
    pub base: &'a Image,
    /// Where lights may go.
    pub bounds: Bounds,
    /// Locks of each light to be solved; its length is the number of lights.
    pub locks: Vec<Locks>,
}

impl Problem<'_> {
    /// Checks sizes, values and bounds.
    pub(crate) fn validate(&self) -> Result<(), OptimiseError> {
        let expected = self.relight.size();
        for (what, image) in [("target", self.target), ("base", self.base)] {
            let found = (image.width, image.height);
            if found != expected {
                return Err(OptimiseError::Size { what, found, expected });
            }
            if image.channels != 3 || image.data.is_empty() || !image.data.iter().all(|v| v.is_finite()) {
                return Err(OptimiseError::Picture(what));
            }
        }
        let b = &self.bounds;
        if !(b.center_min.cmplt(b.center_max).all() && b.center_min.is_finite() && b.center_max.is_finite()) {
            return Err(OptimiseError::Bounds("the centre"));
        }
        if !(0.0 < b.radius_min && b.radius_min < b.radius_max && b.radius_max.is_finite()) {
            return Err(OptimiseError::Bounds("the radius"));
        }
        Ok(())
    }

    pub(crate) fn pixel_count(&self) -> usize {
        self.target.pixel_count()
    }

    /// At most `count` pixels, evenly spread.
    pub(crate) fn spread_pixels(&self, count: usize) -> Vec<u32> {
        let total = self.pixel_count();
        let count = count.min(total);
        (0..count).map(|i| (i * total / count) as u32).collect()
    }

    /// Radiance with which this light alone would make up for the mean of what the target has over the base.
    pub(crate) fn matching_radiance(&self, light: &SphereLight) -> Result<f32, OptimiseError> {
        let pixels = self.spread_pixels(4096);
        let mut unit = vec![[0.0; 3]; pixels.len()];
        self.relight.forward(light.center, light.radius, &pixels, &mut unit)?;
        let unit_mean = unit.as_flattened().iter().map(|v| *v as f64).sum::<f64>();
        let missing =
            |image: &Image| -> f64 { pixels.iter().flat_map(|p| pixel(image, *p)).map(|v| v as f64).sum() };
        let (target, base) = (missing(self.target), missing(self.base));
        // A base as bright as the target still needs a unit: a hundredth of the target.
        let needed = (target - base).max(0.01 * target);
        let radiance = (needed / unit_mean) as f32;
        Ok(if radiance.is_finite() && radiance > 0.0 { radiance } else { 1.0 })
    }
}

/// Loss and gradient of one run, which fixes exposure and mappings.
pub(crate) struct Objective<'a> {
    problem: &'a Problem<'a>,
    mappings: Vec<Mapping>,
    exposure: f32,
    comparison: Option<Box<dyn Compare + 'a>>,
}

impl<'a> Objective<'a> {
    pub(crate) fn new(problem: &'a Problem<'a>, start: &[SphereLight]) -> Result<Self, OptimiseError> {
        let mapping = |(light, locks): (&SphereLight, &Locks)| {
            let radiance_unit = problem.matching_radiance(light)? / start.len() as f32;
            Ok(Mapping { bounds: problem.bounds, locks: *locks, radiance_unit })
        };
        let mappings = start.iter().zip(&problem.locks).map(mapping).collect::<Result<_, OptimiseError>>()?;
        // The paper's curve I / (1 + I) presumes pictures of moderate brightness; ours may be in any unit.
        let exposure = metrics::exposure(problem.target);
        let comparison = problem.relight.comparison(problem.base, problem.target, exposure)?;
        Ok(Self { problem, mappings, exposure, comparison })
    }

    pub(crate) fn unconstrained(&self, lights: &[SphereLight]) -> Vec<f32> {
        self.mappings.iter().zip(lights).flat_map(|(map, light)| map.unconstrained(light)).collect()
    }

    pub(crate) fn lights(&self, u: &[f32]) -> Vec<SphereLight> {
        self.mappings.iter().zip(u.chunks_exact(PARAMS)).map(|(map, u)| map.light(u)).collect()
    }

    /// Mean squared tonemapped difference at some pixels (paper, equation 6).
    pub(crate) fn loss(&self, u: &[f32], pixels: &[u32]) -> Result<f64, OptimiseError> {
        let lights = self.lights(u);
        Ok(self.compare(&lights, &self.unit_images(&lights, pixels)?, pixels).0)
    }

    /// Loss and its gradient by the unconstrained values.
    pub(crate) fn gradient(&self, u: &[f32], pixels: &[u32]) -> Result<(f64, Vec<f32>), OptimiseError> {
        let lights = self.lights(u);
        let (loss, d_lights) = match &self.comparison {
            Some(comparison) => comparison.gradient(&lights, pixels)?,
            None => self.gradient_by_lights(&lights, pixels)?,
        };
        let by_light = self.mappings.iter().zip(u.chunks_exact(PARAMS)).zip(d_lights);
        Ok((loss, by_light.flat_map(|((mapping, u), d_light)| mapping.pull_back(u, d_light)).collect()))
    }

    fn gradient_by_lights(
        &self,
        lights: &[SphereLight],
        pixels: &[u32],
    ) -> Result<(f64, Vec<[f32; PARAMS]>), OptimiseError> {
        let units = self.unit_images(lights, pixels)?;
        let (loss, d_image) = self.compare(lights, &units, pixels);
        let mut d_lights = Vec::with_capacity(lights.len());
        for (i, light) in lights.iter().enumerate() {
            let mut d_light = [0.0; PARAMS];
            if !(self.mappings[i].locks.center && self.mappings[i].locks.radius) {
                let scale = |d: &[f32; 3]| std::array::from_fn(|c| d[c] * light.radiance[c]);
                let d_unit: Vec<[f32; 3]> = d_image.iter().map(scale).collect();
                let d_shape = self.problem.relight.backward(light.center, light.radius, pixels, &d_unit)?;
                d_light[..4].copy_from_slice(&d_shape);
            }
            for c in 0..3 {
                d_light[4 + c] = d_image.iter().zip(&units[i]).map(|(d, unit)| d[c] * unit[c]).sum();
            }
            d_lights.push(d_light);
        }
        Ok((loss, d_lights))
    }

    fn unit_images(
        &self,
        lights: &[SphereLight],
        pixels: &[u32],
    ) -> Result<Vec<Vec<[f32; 3]>>, OptimiseError> {
        let unit = |light: &SphereLight| {
            let mut out = vec![[0.0; 3]; pixels.len()];
            self.problem.relight.forward(light.center, light.radius, pixels, &mut out)?;
            Ok(out)
        };
        lights.iter().map(unit).collect()
    }

    /// The loss and its derivative by each value of the picture.
    fn compare(
        &self,
        lights: &[SphereLight],
        units: &[Vec<[f32; 3]>],
        pixels: &[u32],
    ) -> (f64, Vec<[f32; 3]>) {
        let mut loss = 0.0;
        let share = 1.0 / pixels.len() as f32;
        let at = |(i, p): (usize, &u32)| {
            let (base, target) = (pixel(self.problem.base, *p), pixel(self.problem.target, *p));
            std::array::from_fn(|c| {
                let sum: f32 =
                    lights.iter().zip(units).map(|(light, unit)| light.radiance[c] * unit[i][c]).sum();
                let (tone, slope) = reinhard(self.exposure * (base[c] + sum));
                let difference = tone - reinhard(self.exposure * target[c]).0;
                loss += (difference * difference * share) as f64;
                2.0 * difference * slope * self.exposure * share
            })
        };
        let d_image = pixels.iter().enumerate().map(at).collect();
        (loss, d_image)
    }
}

/// `x / (1 + x)` and its slope, continued as an odd function so that a negative prediction keeps a gradient.
pub(crate) fn reinhard(x: f32) -> (f32, f32) {
    let scale = 1.0 / (1.0 + x.abs());
    (x * scale, scale * scale)
}

fn pixel(image: &Image, number: u32) -> [f32; 3] {
    let at = number as usize * 3;
    [image.data[at], image.data[at + 1], image.data[at + 2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth in all parameters, with a different slope for each pixel.
    struct Waves;

    impl Waves {
        fn phase(pixel: u32) -> f32 {
            pixel as f32 * 0.37
        }
    }

    impl Relight for Waves {
        fn size(&self) -> (usize, usize) {
            (8, 4)
        }
        fn forward(&self, p: Vec3, r: f32, pixels: &[u32], out: &mut [[f32; 3]]) -> Result<(), RelightError> {
            for (out, pixel) in out.iter_mut().zip(pixels) {
                let t = Self::phase(*pixel);
                let value = r * r * (2.0 + (p.x + t).sin() + (0.7 * p.y - t).cos() + 0.1 * p.z * t);
                *out = [value, 0.5 * value, 0.2 * value * value];
            }
            Ok(())
        }
        fn backward(
            &self,
            p: Vec3,
            r: f32,
            pixels: &[u32],
            d: &[[f32; 3]],
        ) -> Result<[f32; 4], RelightError> {
            let mut sum = [0.0; 4];
            for (d, pixel) in d.iter().zip(pixels) {
                let t = Self::phase(*pixel);
                let shape = 2.0 + (p.x + t).sin() + (0.7 * p.y - t).cos() + 0.1 * p.z * t;
                let d_value = d[0] + 0.5 * d[1] + 0.4 * r * r * shape * d[2];
                let slopes = [(p.x + t).cos(), -0.7 * (0.7 * p.y - t).sin(), 0.1 * t].map(|s| s * r * r);
                (0..3).for_each(|i| sum[i] += d_value * slopes[i]);
                sum[3] += d_value * 2.0 * r * shape;
            }
            Ok(sum)
        }
    }

    #[test]
    fn gradient_equals_finite_differences_in_every_lane() {
        let target =
            Image { data: (0..96).map(|i| 0.1 + (i % 7) as f32 * 0.2).collect(), ..Image::new(8, 4, 3) };
        let base = Image { data: vec![0.05; 96], ..Image::new(8, 4, 3) };
        let bounds = Bounds {
            center_min: Vec3::splat(-2.0),
            center_max: Vec3::splat(2.0),
            radius_min: 0.1,
            radius_max: 1.0,
        };
        let lights = [
            SphereLight { center: Vec3::new(0.3, -0.8, 1.1), radius: 0.4, radiance: [1.0, 0.4, 2.0] },
            SphereLight { center: Vec3::new(-1.3, 0.2, -0.5), radius: 0.7, radiance: [0.2, 0.9, 0.1] },
        ];
        let locks = vec![Locks::default(), Locks { radius: true, ..Locks::default() }];
        let problem = Problem { relight: &Waves, target: &target, base: &base, bounds, locks };
        let objective = Objective::new(&problem, &lights).unwrap();
        let u = objective.unconstrained(&lights);
        let pixels: Vec<u32> = (0..32).collect();
        let (_, gradient) = objective.gradient(&u, &pixels).unwrap();
        assert_eq!(gradient[PARAMS + 3], 0.0, "a locked radius has no gradient");
        for i in (0..u.len()).filter(|i| *i != PARAMS + 3) {
            let step = 2e-2;
            let at = |delta: f32| {
                let mut u = u.clone();
                u[i] += delta;
                objective.loss(&u, &pixels).unwrap()
            };
            let slope = (at(step) - at(-step)) / (2.0 * step as f64);
            let error = (slope - gradient[i] as f64).abs();
            assert!(error < 2e-3 * slope.abs() + 2e-6, "lane {i}: {slope} for {}", gradient[i]);
        }
    }
}
