use std::ops::Range;

use relume_gpu::Buffer;
use relume_gpu::compare::{CompareStep, Compared, Layers, StepTargets, UnitBindings};
use relume_scene::{LANES, Light};

use super::GpuGather;
use super::soft::Outputs;
use crate::soft::OUTPUTS;
use crate::soft::light::SoftLight;
use crate::{GatherError, SoftGather};

/// Values of a light's gradient on the device: by its radiance, then by the lanes of its shape.
const GRADIENT: usize = 3 + LANES;
/// Bytes of values and derivatives that are there at a time.
const MOST_VALUES: usize = 64 << 20;

/// Targets that smoothed lights and those that stay are compared to.
#[derive(Clone, Copy, Debug)]
pub struct Goals<'a> {
    /// Picture without the lights that move.
    pub layers: &'a Layers,
    /// Radiances of the layers but the first.
    pub radiances: &'a [[f32; 3]],
    /// The cells that are looked at, and what is wanted of them.
    pub targets: &'a StepTargets,
}

/// Result of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct SoftCompared {
    /// The loss.
    pub loss: f64,
    /// For each light its gradient by the lanes of the shape and by the radiance.
    pub lights: Vec<([f32; LANES], [f32; 3])>,
    /// For each layer but the first its gradient by the radiance.
    pub layers: Vec<[f32; 3]>,
}

impl GpuGather {
    /// The loss of goals at some cells of a picture of layers and of these lights, smoothed and each times its radiance, and its gradient by
    /// each of them. Neither pictures nor derivatives of cells come back.
    ///
    /// # Errors
    /// See [`GpuGather::linearise`].
    ///
    /// # Panics
    /// See [`Layers::begin`].
    pub fn compare(
        &self,
        soft: &SoftGather<'_>,
        lights: &[&Light],
        softness: f32,
        goals: &Goals<'_>,
    ) -> Result<SoftCompared, GatherError> {
        let most = MOST_VALUES / (size_of::<Outputs>() * lights.len().max(1));
        self.compare_in_parts(soft, (lights, softness), goals, most)
    }

    /// [`GpuGather::compare`] of about so many cells at a time. Where that takes several parts, values are made once for the picture
    /// and once more for its gradient.
    fn compare_in_parts(
        &self,
        soft: &SoftGather<'_>,
        (lights, softness): (&[&Light], f32),
        Goals { layers, radiances, targets }: &Goals<'_>,
        most: usize,
    ) -> Result<SoftCompared, GatherError> {
        let smoothed = Smoothed::new(self, soft, (lights, softness), &targets.cells)?;
        let mut commands = self.gpu.commands("picture of smoothed lights");
        let step = layers.begin(&mut commands, radiances, targets, lights.len() * GRADIENT)?;
        commands.submit()?;
        let parts = step.parts(most);
        let mut last = None;
        for part in &parts {
            let values = smoothed.values(&step, part)?;
            let mut commands = self.gpu.commands("picture of smoothed lights");
            step.add(&mut commands, &smoothed.units(&values), part.clone())?;
            commands.submit()?;
            last = Some(values);
        }
        let mut commands = self.gpu.commands("comparison");
        step.compare(&mut commands)?;
        commands.submit()?;
        for part in &parts {
            let values = match last.take().filter(|_| parts.len() == 1) {
                Some(values) => values,
                None => smoothed.values(&step, part)?,
            };
            let mut commands = self.gpu.commands("gradient of smoothed lights");
            step.pull(&mut commands, &smoothed.units(&values), part.clone(), step.gradients().1)?;
            commands.submit()?;
        }
        Ok(compared(lights, step.read()?))
    }
}

/// Smoothed lights for the cells that a step looks at.
struct Smoothed<'a> {
    on_gpu: &'a GpuGather,
    soft: &'a SoftGather<'a>,
    lights: Vec<SoftLight>,
    radiances: Buffer<[f32; 4]>,
    cells: &'a [u32],
}

impl<'a> Smoothed<'a> {
    fn new(
        on_gpu: &'a GpuGather,
        soft: &'a SoftGather<'a>,
        (lights, softness): (&[&Light], f32),
        cells: &'a [u32],
    ) -> Result<Self, GatherError> {
        let quad = |light: &&Light| {
            let [r, g, b] = light.radiance;
            [r, g, b, 0.0]
        };
        let radiances: Vec<[f32; 4]> = lights.iter().map(quad).collect();
        let radiances = on_gpu.gpu.buffer_of("radiances", &radiances)?;
        let soften = |light: &&Light| soft.soften(light, softness, cells);
        let lights = lights.iter().map(soften).collect::<Result<_, _>>()?;
        Ok(Self { on_gpu, soft, lights, radiances, cells })
    }

    /// Values and derivatives at a part of the cells.
    fn values(&self, step: &CompareStep<'_>, part: &Range<usize>) -> Result<Buffer<Outputs>, GatherError> {
        let cells = (&self.cells[part.clone()], step.cells(part.clone()));
        self.on_gpu.slopes(self.soft, &self.lights, cells)
    }

    fn units<'b>(&'b self, values: &'b Buffer<Outputs>) -> UnitBindings<'b> {
        let (radiances, values) = ((self.radiances.whole(), 1), (values.whole(), OUTPUTS));
        UnitBindings { lights: self.lights.len(), radiances, first: 0, values, all: None }
    }
}

/// Result from values in the order of the device, of the lanes that the lights have.
fn compared(lights: &[&Light], Compared { loss, layers, gradients }: Compared) -> SoftCompared {
    let gradient = |(light, values): (&&Light, &[f32; GRADIENT])| {
        let slope = |lane| if light.shape.has_lane(lane) { values[3 + lane] } else { 0.0 };
        (std::array::from_fn(slope), std::array::from_fn(|c| values[c]))
    };
    SoftCompared { loss, lights: lights.iter().zip(gradients.as_chunks().0).map(gradient).collect(), layers }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use relume_gpu::{Gpu, GpuChoice};

    use super::*;
    use crate::tests::kernels::{random_dump_of, random_lights};
    use crate::{Gather, UnitValues};

    const EXPOSURE: f32 = 1.3;
    const STILL: [f32; 3] = [0.4, 0.3, 0.5];

    fn reinhard(x: f32) -> f32 {
        x / (1.0 + x)
    }

    /// A picture of so many cells.
    fn picture(cells: usize, first: f32) -> Vec<[f32; 3]> {
        (0..cells).map(|i| [first, 0.1 * (i % 4) as f32, 1.0 - first]).collect()
    }

    /// A target at some cells.
    fn targets_at(cells: &[u32]) -> StepTargets {
        let wanted = |(i, cell): (usize, &u32)| {
            let [r, g, b] = [0.6, 0.1 * (cell % 3) as f32, 0.4].map(|x| reinhard(EXPOSURE * x));
            [r, g, b, 0.02 * (i % 5) as f32]
        };
        StepTargets::target(cells.to_vec(), cells.iter().enumerate().map(wanted).collect(), EXPOSURE)
    }

    /// Equation 6 and its gradient from the values and slopes of the CPU.
    fn expected(
        lights: &[&Light],
        linear: &[UnitValues],
        [base, still]: [&[[f32; 3]]; 2],
        targets: &StepTargets,
    ) -> SoftCompared {
        let lights_of = vec![([0.0; LANES], [0.0; 3]); lights.len()];
        let mut sums = SoftCompared { loss: 0.0, lights: lights_of, layers: vec![[0.0; 3]] };
        for (at, (cell, wanted)) in targets.cells.iter().zip(&targets.references).enumerate() {
            let (share, [base, still]) = (wanted[3], [base, still].map(|picture| picture[*cell as usize]));
            for c in 0..3 {
                let of = |(light, linear): (&&Light, &UnitValues)| light.radiance[c] * linear.values[at][c];
                let lit = lights.iter().zip(linear).map(of).sum::<f32>();
                let value = EXPOSURE * (base[c] + STILL[c] * still[c] + lit);
                let difference = reinhard(value) - wanted[c];
                sums.loss += f64::from(share * difference * difference);
                let d = share * 2.0 * difference * EXPOSURE / (1.0 + value).powi(2);
                sums.layers[0][c] += d * still[c];
                for ((light, linear), (d_shape, d_radiance)) in
                    lights.iter().zip(linear).zip(&mut sums.lights)
                {
                    d_radiance[c] += d * linear.values[at][c];
                    for (sum, slope) in d_shape.iter_mut().zip(&linear.slopes[at]) {
                        *sum += d * light.radiance[c] * slope[c];
                    }
                }
            }
        }
        sums
    }

    /// The largest difference, and the largest number.
    fn apart<'a>(
        found: impl Iterator<Item = &'a f32>,
        expected: impl Iterator<Item = &'a f32>,
    ) -> (f32, f32) {
        found.zip(expected).fold((0.0_f32, 0.0_f32), |(error, whole), (a, b)| {
            (error.max(if a.is_finite() { (a - b).abs() } else { f32::INFINITY }), whole.max(b.abs()))
        })
    }

    #[test]
    fn losses_and_gradients_are_those_of_the_cpu() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let gather = Gather::new(random_dump_of(10, &[1, 3, 20]));
        let soft = SoftGather::new(&gather, 3);
        let cells: Vec<u32> = (0..16).rev().chain([3, 3]).collect();
        let (base, still, targets) = (picture(16, 0.2), picture(16, 0.7), targets_at(&cells));
        let all = random_lights();
        let little = Gpu::open(&GpuChoice::Best).unwrap();
        little.set_memory_budget(Some(80_000));
        let streamed = GpuGather::new(little, &gather).unwrap();
        assert!(!streamed.is_resident());
        for on_gpu in [
            GpuGather::new(Arc::clone(&gpu), &gather).unwrap(),
            GpuGather::in_chunks(Arc::clone(&gpu), &gather, 400).unwrap(),
            streamed,
        ] {
            let layers = Layers::new(on_gpu.gpu(), &[&base, &still]).unwrap();
            let goals = Goals { layers: &layers, radiances: &[STILL], targets: &targets };
            for lights in all.chunks(5) {
                let lights: Vec<&Light> = lights.iter().collect();
                let linear: Vec<UnitValues> =
                    lights.iter().map(|light| soft.linearise(light, 0.1, &cells).unwrap()).collect();
                let expected = expected(&lights, &linear, [&base, &still], &targets);
                let found = on_gpu.compare(&soft, &lights, 0.1, &goals).unwrap();
                let loss = expected.loss;
                assert!((found.loss - loss).abs() < 1e-5 * loss, "{} for {loss}", found.loss);
                let (error, whole) = apart(found.layers[0].iter(), expected.layers[0].iter());
                assert!(error < 1e-4 * whole, "{error} of {whole}");
                for (found, expected) in found.lights.iter().zip(&expected.lights) {
                    let (error, whole) =
                        apart(found.0.iter().chain(&found.1), expected.0.iter().chain(&expected.1));
                    // As single slopes are.
                    assert!(error < 3e-4 * whole, "{error} of {whole}");
                }
            }
        }
    }

    #[test]
    fn gradients_by_a_light_are_differences_of_the_loss() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let gather = Gather::new(random_dump_of(10, &[20]));
        let (soft, on_gpu) = (SoftGather::new(&gather, 3), GpuGather::new(gpu, &gather).unwrap());
        let cells: Vec<u32> = (0..16).collect();
        let targets = targets_at(&cells);
        let layers = Layers::new(on_gpu.gpu(), &[&picture(16, 0.2)]).unwrap();
        let goals = Goals { layers: &layers, radiances: &[], targets: &targets };
        for light in random_lights().iter().step_by(3) {
            let compared = |light: &Light| on_gpu.compare(&soft, &[light], 0.3, &goals).unwrap();
            let found = compared(light);
            let largest = found.lights[0].0.iter().fold(0.0_f32, |most, slope| most.max(slope.abs()));
            for lane in (0..LANES).filter(|lane| light.shape.has_lane(*lane)) {
                let at = |delta: f32| {
                    let mut step = [0.0; LANES];
                    step[lane] = delta;
                    compared(&Light { shape: light.shape.moved(&step), ..light.clone() }).loss
                };
                let slope = ((at(4e-3) - at(-4e-3)) / 8e-3) as f32;
                // Losses in single precision are good to 1e-6 of them.
                let rounding = 1e-6 * found.loss as f32 / 4e-3;
                let error = (slope - found.lights[0].0[lane]).abs();
                assert!(error < 1e-2 * largest + rounding, "{lane} of {light:?}: {slope} for {found:?}");
            }
        }
    }

    #[test]
    fn many_cells_are_compared_in_parts() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let gather = Gather::new(random_dump_of(10, &[4]));
        let (soft, on_gpu) = (SoftGather::new(&gather, 3), GpuGather::new(gpu, &gather).unwrap());
        let lights: Vec<Light> = random_lights().into_iter().take(2).collect();
        let lights: Vec<&Light> = lights.iter().collect();
        let cells: Vec<u32> = (0..200).map(|i| i % 16).collect();
        let (base, targets) = (picture(16, 0.2), targets_at(&cells));
        let layers = Layers::new(on_gpu.gpu(), &[&base]).unwrap();
        let goals = Goals { layers: &layers, radiances: &[], targets: &targets };
        let whole = on_gpu.compare(&soft, &lights, 0.1, &goals).unwrap();
        for most in [1, 128] {
            let found = on_gpu.compare_in_parts(&soft, (&lights, 0.1), &goals, most).unwrap();
            assert!((found.loss - whole.loss).abs() < 1e-6 * whole.loss, "{} for {}", found.loss, whole.loss);
            for (a, b) in found.lights[1].1.iter().zip(&whole.lights[1].1) {
                assert!((a - b).abs() < 1e-5 * b.abs(), "{a} for {b}");
            }
        }
    }
}
