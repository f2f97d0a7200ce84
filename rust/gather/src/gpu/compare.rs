use relume_gpu::{Buffer, CompareArguments, CompareKernel};
use relume_scene::{LANES, Light};

use super::GpuGather;
use super::arguments::PullArguments;
use super::kernels;
use super::soft::Outputs;
use crate::soft::OUTPUTS;
use crate::soft::light::SoftLight;
use crate::{GatherError, SoftGather};

/// Values of a light's gradient on the device: by its radiance, then by the lanes of its shape.
const GRADIENT: usize = 3 + LANES;
/// Bytes of values and derivatives that are there at a time.
const MOST_VALUES: usize = 64 << 20;

/// What a picture of lights is compared with, at some of its cells: scene-linear RGB.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// What is there without the lights, one per cell.
    pub base: &'a [[f32; 3]],
    /// What is to be there, one per cell.
    pub target: &'a [[f32; 3]],
    /// What each cell counts in the loss.
    pub shares: &'a [f32],
    /// What both are multiplied with before Reinhard's curve.
    pub exposure: f32,
}

/// A loss, and for each light its gradient by the lanes of the shape and by the radiance.
pub type SoftCompared = (f64, Vec<([f32; LANES], [f32; 3])>);

impl GpuGather {
    /// Sum over some cells, each times its share, of the squared difference of a base with these lights, smoothed and each times its radiance, to what is
    /// wanted there (paper, equation 6), and its gradient by each light. Neither pictures nor derivatives of cells come back.
    ///
    /// # Errors
    /// As [`GpuGather::linearise`].
    ///
    /// # Panics
    /// If base, target or shares are not of as many cells.
    pub fn compare(
        &self,
        soft: &SoftGather<'_>,
        lights: &[&Light],
        softness: f32,
        cells: &[u32],
        wanted: &Wanted<'_>,
    ) -> Result<SoftCompared, GatherError> {
        let most = MOST_VALUES / (size_of::<Outputs>() * lights.len().max(1));
        self.compare_in_parts(soft, (lights, softness), cells, wanted, most.max(1))
    }

    /// [`GpuGather::compare`] of at most so many cells at a time.
    fn compare_in_parts(
        &self,
        soft: &SoftGather<'_>,
        (lights, softness): (&[&Light], f32),
        cells: &[u32],
        wanted: &Wanted<'_>,
        most: usize,
    ) -> Result<SoftCompared, GatherError> {
        let counts = [wanted.base.len(), wanted.target.len(), wanted.shares.len()];
        assert_eq!(counts, [cells.len(); 3], "one of each per cell");
        let soften = |light: &&Light| soft.soften(light, softness, cells);
        let softened = lights.iter().map(soften).collect::<Result<Vec<_>, _>>()?;
        let quad = |light: &&Light| {
            let [r, g, b] = light.radiance;
            [r, g, b, 0.0]
        };
        let radiances: Vec<[f32; 4]> = lights.iter().map(quad).collect();
        let radiances = self.gpu.buffer_of("radiances", &radiances)?;
        let mut sums = vec![0.0; lights.len() * GRADIENT];
        let mut loss = 0.0;
        let pictures = wanted.base.chunks(most).zip(wanted.target.chunks(most));
        let parts = cells.chunks(most).zip(pictures).zip(wanted.shares.chunks(most));
        for ((part, (base, target)), shares) in parts {
            let wanted = Wanted { base, target, shares, ..*wanted };
            let values = self.compare_part(soft, (&softened, &radiances), part, &wanted)?;
            let (by_lights, losses) = values.split_at(sums.len());
            sums.iter_mut().zip(by_lights).for_each(|(sum, value)| *sum += value);
            loss += losses.iter().map(|loss| f64::from(*loss)).sum::<f64>();
        }
        let gradient = |values: &[f32; GRADIENT]| {
            (std::array::from_fn(|lane| values[3 + lane]), std::array::from_fn(|c| values[c]))
        };
        Ok((loss, sums.as_chunks::<GRADIENT>().0.iter().map(gradient).collect()))
    }

    /// The gradients of the lights, then losses to be added up, for some of the cells.
    fn compare_part(
        &self,
        soft: &SoftGather<'_>,
        (softened, radiances): (&[SoftLight], &Buffer<[f32; 4]>),
        cells: &[u32],
        wanted: &Wanted<'_>,
    ) -> Result<Vec<f32>, GatherError> {
        let (lights, count) = (softened.len(), cells.len());
        let places: Vec<u32> = (0..count as u32).collect();
        let places = self.gpu.buffer_of("places of cells", &places)?;
        let cells_on_device = self.gpu.buffer_of("cells", cells)?;
        let base = self.gpu.buffer_of("base at cells", wanted.base)?;
        let target = self.gpu.buffer_of("target at cells", wanted.target)?;
        let shares = self.gpu.buffer_of("shares of cells", wanted.shares)?;
        let d_picture = self.gpu.zeros::<[f32; 3]>("gradient by cells", count)?;
        let gradients = lights * GRADIENT;
        let len = gradients + CompareKernel::losses(count);
        let results = self.gpu.zeros::<f32>("loss and gradients", len)?;

        let values = self.slopes(soft, softened, (cells, &cells_on_device))?;
        let mut commands = self.gpu.commands("smoothed light step");
        let buffers = [
            radiances.whole(),
            places.whole(),
            values.whole(),
            base.whole(),
            target.whole(),
            shares.whole(),
            d_picture.whole(),
            results.whole(),
        ];
        let arguments = CompareArguments {
            count: count as u32,
            lights: lights as u32,
            exposure: wanted.exposure,
            losses: gradients as u32,
        };
        kernels::compare(&self.gpu)?.add(&mut commands, &buffers, &arguments)?;
        let pulled = [radiances.whole(), values.whole(), d_picture.whole(), results.whole()];
        let bound = kernels::pull(&self.gpu)?.bind(&pulled)?;
        let arguments = PullArguments { cells: count as u32, lights: lights as u32 };
        commands.run(&bound, (lights * OUTPUTS) as u32, bytemuck::bytes_of(&arguments));
        commands.submit()?;
        Ok(self.gpu.read(&results, 0..len)?)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use relume_gpu::{Gpu, GpuChoice};

    use super::*;
    use crate::tests::kernels::{random_dump_of, random_lights};
    use crate::{Gather, Linear};

    #[test]
    fn gradients_are_as_long_as_in_wgsl() {
        let constant = |name| relume_gpu::layout::constant("gather/pull", name).unwrap() as usize;
        assert_eq!((constant("OUTPUTS"), constant("GRADIENT")), (OUTPUTS, GRADIENT));
    }

    fn reinhard(x: f32) -> f32 {
        x / (1.0 + x)
    }

    /// Equation 6 and its gradient from the values and slopes of the CPU.
    fn expected(lights: &[&Light], linear: &[Linear], wanted: &Wanted) -> SoftCompared {
        let mut loss = 0.0;
        let mut by_light = vec![([0.0; LANES], [0.0; 3]); lights.len()];
        for (cell, (base, target)) in wanted.base.iter().zip(wanted.target).enumerate() {
            let share = wanted.shares[cell];
            for c in 0..3 {
                let of = |(light, linear): (&&Light, &Linear)| light.radiance[c] * linear.values[cell][c];
                let value = wanted.exposure * (base[c] + lights.iter().zip(linear).map(of).sum::<f32>());
                let difference = reinhard(value) - reinhard(wanted.exposure * target[c]);
                loss += f64::from(share * difference * difference);
                let d = share * 2.0 * difference * wanted.exposure / (1.0 + value).powi(2);
                for ((light, linear), (d_shape, d_radiance)) in lights.iter().zip(linear).zip(&mut by_light) {
                    d_radiance[c] += d * linear.values[cell][c];
                    for (sum, slope) in d_shape.iter_mut().zip(&linear.slopes[cell]) {
                        *sum += d * light.radiance[c] * slope[c];
                    }
                }
            }
        }
        (loss, by_light)
    }

    #[test]
    fn losses_and_gradients_are_those_of_the_cpu() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let gather = Gather::new(random_dump_of(10, &[1, 3, 20]));
        let soft = SoftGather::new(&gather, 3);
        let cells: Vec<u32> = (0..16).rev().chain([3, 3]).collect();
        let some = |first: f32| -> Vec<[f32; 3]> {
            (0..cells.len()).map(|i| [first, 0.1 * (i % 4) as f32, 1.0 - first]).collect()
        };
        let (base, target) = (some(0.2), some(0.6));
        let shares: Vec<f32> = (0..cells.len()).map(|i| 0.02 * (i % 5) as f32).collect();
        let wanted = Wanted { base: &base, target: &target, shares: &shares, exposure: 1.3 };
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
            for lights in all.chunks(5) {
                let lights: Vec<&Light> = lights.iter().collect();
                let linear: Vec<Linear> =
                    lights.iter().map(|light| soft.linearise(light, 0.1, &cells).unwrap()).collect();
                let (loss, by_light) = expected(&lights, &linear, &wanted);
                let found = on_gpu.compare(&soft, &lights, 0.1, &cells, &wanted).unwrap();
                assert!((found.0 - loss).abs() < 1e-5 * loss, "{} for {loss}", found.0);
                for (found, expected) in found.1.iter().zip(&by_light) {
                    let pairs = found.0.iter().chain(&found.1).zip(expected.0.iter().chain(&expected.1));
                    let (error, whole) = pairs.fold((0.0_f32, 0.0_f32), |(error, whole), (a, b)| {
                        (
                            error.max(if a.is_finite() { (a - b).abs() } else { f32::INFINITY }),
                            whole.max(b.abs()),
                        )
                    });
                    // As single slopes are.
                    assert!(error < 3e-4 * whole, "{error} of {whole}");
                }
            }
        }
    }

    #[test]
    fn many_cells_are_compared_in_parts() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let gather = Gather::new(random_dump_of(6, &[4]));
        let (soft, on_gpu) = (SoftGather::new(&gather, 3), GpuGather::new(gpu, &gather).unwrap());
        let lights = [&random_lights()[0]];
        let (cells, base, target) = ([0, 1, 2, 3, 2], [[0.1; 3]; 5], [[0.4; 3]; 5]);
        let shares = [0.1, 0.3, 0.2, 0.0, 0.4];
        let wanted = Wanted { base: &base, target: &target, shares: &shares, exposure: 1.0 };
        let (loss, by_light) = on_gpu.compare(&soft, &lights, 0.1, &cells, &wanted).unwrap();
        for most in [1, 2, 4] {
            let found = on_gpu.compare_in_parts(&soft, (&lights, 0.1), &cells, &wanted, most).unwrap();
            assert!((found.0 - loss).abs() < 1e-6 * loss, "{} for {loss}", found.0);
            for (a, b) in found.1[0].1.iter().zip(&by_light[0].1) {
                assert!((a - b).abs() < 1e-5 * b.abs(), "{a} for {b}");
            }
        }
    }
}
