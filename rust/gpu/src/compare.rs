//! Pictures of lights compared with what is wanted of them, and the gradients of that: a step of a solver, of which no picture
//! comes back.
//!
//! ```text
//! let layers = Layers::new(&gpu, &[&base, &lamp_that_stays])?;               // once
//! let step = layers.begin(&mut commands, &[lamp_radiance], &targets, values)?;  // each step
//! step.add(&mut commands, &units, part)?;                                    // lights that move, made by others
//! step.compare(&mut commands)?;
//! step.pull(&mut commands, &units, part, first)?;                                // or others, from `d_picture`
//! commands.submit()?;
//! let compared = step.read()?;
//! ```

use std::ops::Range;
use std::sync::Arc;

use crate::{Binding, Buffer, Commands, Gpu, GpuError};

/// Cells of a workgroup of `shaders/common/add_units.wgsl`.
const GROUP: usize = 64;
/// Parts of a step are of so many cells, or a multiple: what is known of those before fills whole alignments of a buffer.
const PART: usize = 64;

/// Comparison of a cell with its reference: `shaders/common/residual.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::NoUninit)]
#[repr(u32)]
pub enum Residual {
    /// Values under Reinhard's curve.
    Tone,
    /// Stops of luminance, and colour beside them.
    Brightness,
    /// Colour, whatever the brightness.
    Color,
    /// The ratio of red to blue, and brightness beside it.
    Warmth,
    /// Stops of each channel.
    Stops,
}

/// A goal at its cells: `Term` of `shaders/common/compare.wgsl`, where the fields are described.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::NoUninit)]
#[repr(C)]
#[expect(missing_docs, reason = "described in the WGSL struct")]
pub struct GpuTerm {
    pub mean_reference: [f32; 3],
    pub residual: Residual,
    pub amount: f32,
    pub exposure: f32,
    pub weight: f32,
    pub luminance: f32,
    pub first: u32,
    pub count: u32,
}

/// The cells that a step looks at, term by term.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepTargets {
    /// Their places in the picture.
    pub cells: Vec<u32>,
    /// Reference of each cell, and its share in the loss.
    pub references: Vec<[f32; 4]>,
    /// The goals.
    pub terms: Vec<GpuTerm>,
}

impl StepTargets {
    /// One target, exposed and under Reinhard's curve already, of which each cell has a share in the loss.
    pub fn target(cells: Vec<u32>, references: Vec<[f32; 4]>, exposure: f32) -> Self {
        let term = GpuTerm {
            mean_reference: [0.0; 3],
            residual: Residual::Tone,
            amount: 0.0,
            exposure,
            weight: references.iter().map(|reference| reference[3]).sum(),
            luminance: 0.0,
            first: 0,
            count: cells.len() as u32,
        };
        Self { cells, references, terms: vec![term] }
    }
}

/// Pictures of all cells on a device that only their colours change: what is there anyway, then lights that stay.
#[derive(Debug)]
pub struct Layers {
    gpu: Arc<Gpu>,
    /// Cells of a picture.
    cells: usize,
    /// Pictures one after the other, as many as fit a buffer.
    pictures: Vec<Buffer<[f32; 3]>>,
}

/// Pictures of lights for radiance 1 at some cells of a step: `shaders/common/units.wgsl`.
#[derive(Clone, Copy, Debug)]
pub struct UnitBindings<'a> {
    /// Number of lights.
    pub lights: usize,
    /// Radiances, and the number of quads of each light, of which the last is its radiance.
    pub radiances: (Binding<'a>, usize),
    /// The first of the lights in `radiances`.
    pub first: usize,
    /// Light by light, then cell by cell so many outputs, RGB each, of which the value comes first, then derivatives.
    pub values: (Binding<'a>, usize),
    /// Cells of the picture if values are of all of them; else they are of the part that is worked on.
    pub all: Option<usize>,
}

/// Arguments of `units.wgsl`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct UnitsArguments {
    count: u32,
    stride: u32,
    lights: u32,
    first: u32,
    results: u32,
}

/// Arguments of `compare.wgsl`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct CompareArguments {
    terms: u32,
}

/// A picture that is put together and compared at the cells that a step looks at.
#[derive(Debug)]
pub struct CompareStep<'a> {
    layers: &'a Layers,
    cells: Buffer<u32>,
    references: Buffer<[f32; 4]>,
    terms: Buffer<GpuTerm>,
    radiances: Buffer<[f32; 4]>,
    picture: Buffer<[f32; 3]>,
    d_picture: Buffer<[f32; 3]>,
    /// The losses of the terms, the gradients of the layers, and those of other lights.
    results: Buffer<f32>,
}

/// Result of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Compared {
    /// The sum over all terms.
    pub loss: f64,
    /// Derivatives by the colours of the layers but the first.
    pub layers: Vec<[f32; 3]>,
    /// Gradients that other passes have left in the results.
    pub gradients: Vec<f32>,
}

impl Layers {
    /// Brings them to a device. There is at least one.
    ///
    /// # Errors
    /// See [`Gpu::zeros`].
    ///
    /// # Panics
    /// If they are not of one size.
    pub fn new(gpu: &Arc<Gpu>, pictures: &[&[[f32; 3]]]) -> Result<Self, GpuError> {
        Self::in_buffers(gpu, pictures, gpu.limits().buffer)
    }

    /// [`Layers::new`] in buffers of at most so many bytes, or of a single picture that has more.
    fn in_buffers(gpu: &Arc<Gpu>, pictures: &[&[[f32; 3]]], most: u64) -> Result<Self, GpuError> {
        let cells = pictures[0].len();
        let at_once = (most as usize / size_of_val(pictures[0]).max(1)).max(1);
        let on_device = |pictures: &[&[[f32; 3]]]| {
            let buffer = gpu.zeros("pictures of lights that stay", pictures.len() * cells)?;
            for (number, picture) in pictures.iter().enumerate() {
                assert_eq!(picture.len(), cells, "cells of each picture");
                gpu.write(&buffer, number * cells, picture);
            }
            Ok(buffer)
        };
        let pictures = pictures.chunks(at_once).map(on_device).collect::<Result<_, _>>()?;
        Ok(Self { gpu: Arc::clone(gpu), cells, pictures })
    }

    /// Device of the layers.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Begins a step with what adds up the layers: the first as it is, the others times these radiances. Others may leave so many values
    /// of gradients.
    ///
    /// # Errors
    /// See [`Gpu::zeros`].
    ///
    /// # Panics
    /// If there are no cells, one is outside of the pictures, or there is not one of each for every cell and layer.
    pub fn begin(
        &self,
        commands: &mut Commands<'_>,
        radiances: &[[f32; 3]],
        targets: &StepTargets,
        gradients: usize,
    ) -> Result<CompareStep<'_>, GpuError> {
        let (gpu, count) = (&self.gpu, targets.cells.len());
        let is_inside = |cell: &u32| (*cell as usize) < self.cells;
        assert!(count > 0 && targets.cells.iter().all(is_inside), "some of {} cells", self.cells);
        assert_eq!((count, self.count()), (targets.references.len(), radiances.len() + 1), "one of each");
        let quads = [[1.0; 3]].iter().chain(radiances).map(|[r, g, b]| [*r, *g, *b, 0.0]);
        let results = targets.terms.len() + 3 * self.count() + gradients;
        let step = CompareStep {
            layers: self,
            cells: gpu.buffer_of("cells", &targets.cells)?,
            references: gpu.buffer_of("references of cells", &targets.references)?,
            terms: gpu.buffer_of("goals", &targets.terms)?,
            radiances: gpu.buffer_of("radiances", &quads.collect::<Vec<_>>())?,
            picture: gpu.zeros("picture at cells", count)?,
            d_picture: gpu.zeros("gradient by cells", count)?,
            results: gpu.zeros("loss and gradients", results)?,
        };
        for layers in step.layers() {
            step.add(commands, &layers, 0..count)?;
        }
        Ok(step)
    }

    /// Pictures.
    fn count(&self) -> usize {
        self.pictures.iter().map(Buffer::len).sum::<usize>() / self.cells
    }
}

impl CompareStep<'_> {
    /// The cells in parts of about so many.
    pub fn parts(&self, most: usize) -> Vec<Range<usize>> {
        let (count, length) = (self.cells.len(), (most / PART).max(1) * PART);
        (0..count).step_by(length).map(|start| start..count.min(start + length)).collect()
    }

    /// Places of a part of the cells.
    pub fn cells(&self, part: Range<usize>) -> Binding<'_> {
        self.cells.part(part)
    }

    /// The gradient by a part of the cells, RGB, once that is known.
    pub fn d_picture(&self, part: Range<usize>) -> Binding<'_> {
        self.d_picture.part(part)
    }

    /// Buffer to which others add their gradients, which are 0 before, and the first value of theirs.
    pub fn gradients(&self) -> (&Buffer<f32>, usize) {
        (&self.results, self.terms.len() + 3 * self.layers.count())
    }

    /// The layers, buffer by buffer.
    fn layers(&self) -> impl Iterator<Item = UnitBindings<'_>> {
        let all = self.layers.cells;
        self.layers.pictures.iter().scan(0, move |next, pictures| {
            let (first, lights) = (*next, pictures.len() / all);
            *next += lights;
            let (radiances, values) = ((self.radiances.whole(), 1), (pictures.whole(), 1));
            Some(UnitBindings { lights, radiances, first, values, all: Some(all) })
        })
    }

    /// Appends what adds lights, each times its radiance, at a part of the cells.
    ///
    /// # Errors
    /// If the device was lost, or refuses what is bound.
    pub fn add(
        &self,
        commands: &mut Commands<'_>,
        units: &UnitBindings<'_>,
        part: Range<usize>,
    ) -> Result<(), GpuError> {
        let kernel = self.layers.gpu.kernel("common/add_units", "add_units", &units.constants())?;
        let (cells, picture) = (self.cells(part.clone()), self.picture.part(part.clone()));
        let bound = kernel.bind(&[units.radiances.0, cells, units.values.0, picture])?;
        let groups = part.len().div_ceil(GROUP) as u32;
        commands.run(&bound, groups, bytemuck::bytes_of(&units.arguments(part.len(), 0)));
        Ok(())
    }

    /// Appends the comparison, when all lights are there, and the gradients of the layers.
    ///
    /// # Errors
    /// See [`CompareStep::add`].
    pub fn compare(&self, commands: &mut Commands<'_>) -> Result<(), GpuError> {
        let kernel = self.layers.gpu.kernel("common/compare", "compare", &[])?;
        let buffers = [
            self.terms.whole(),
            self.references.whole(),
            self.picture.whole(),
            self.d_picture.whole(),
            self.results.whole(),
        ];
        let terms = self.terms.len() as u32;
        commands.run(&kernel.bind(&buffers)?, terms, bytemuck::bytes_of(&CompareArguments { terms }));
        for layers in self.layers() {
            let results = self.terms.len() + 3 * layers.first;
            self.pull(commands, &layers, 0..self.cells.len(), results)?;
        }
        Ok(())
    }

    /// Appends what adds the gradients of lights from a part of the cells to those that are there ([`CompareStep::gradients`]), from this value
    /// on: three by the radiance of a light, then one for each derivative.
    ///
    /// # Errors
    /// See [`CompareStep::add`].
    pub fn pull(
        &self,
        commands: &mut Commands<'_>,
        units: &UnitBindings<'_>,
        part: Range<usize>,
        first: usize,
    ) -> Result<(), GpuError> {
        let kernel = self.layers.gpu.kernel("common/pull_units", "pull_units", &units.constants())?;
        let (radiances, values) = (units.radiances.0, units.values.0);
        let (cells, d_picture) = (self.cells(part.clone()), self.d_picture(part.clone()));
        let bound = kernel.bind(&[radiances, cells, values, d_picture, self.results.whole()])?;
        let groups = (units.lights * units.values.1) as u32;
        commands.run(&bound, groups, bytemuck::bytes_of(&units.arguments(part.len(), first)));
        Ok(())
    }

    /// Waits for what was submitted and copies its numbers: no picture among them.
    ///
    /// # Errors
    /// See [`Gpu::read`].
    pub fn read(self) -> Result<Compared, GpuError> {
        let values = self.layers.gpu.read(&self.results, 0..self.results.len())?;
        let (losses, gradients) = values.split_at(self.terms.len());
        let (layers, gradients) = gradients.split_at(3 * self.layers.count());
        Ok(Compared {
            loss: losses.iter().map(|loss| f64::from(*loss)).sum(),
            layers: layers.as_chunks().0[1..].to_vec(),
            gradients: gradients.to_vec(),
        })
    }
}

impl UnitBindings<'_> {
    fn constants(&self) -> [(&'static str, u32); 3] {
        [
            ("LIGHT_QUADS", self.radiances.1 as u32),
            ("OUTPUTS", self.values.1 as u32),
            ("WHOLE", u32::from(self.all.is_some())),
        ]
    }

    fn arguments(&self, count: usize, results: usize) -> UnitsArguments {
        UnitsArguments {
            count: count as u32,
            stride: self.all.unwrap_or(count) as u32,
            lights: self.lights as u32,
            first: self.first as u32,
            results: results as u32,
        }
    }
}

#[cfg(test)]
mod tests;
