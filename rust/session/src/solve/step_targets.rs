//! Goals in the form that a GPU compares pictures with.

use relume_gpu::compare::{GpuTerm, Residual, StepTargets};
use relume_optimise::{Criterion, TermTarget};

/// Targets of a step.
pub(super) fn step_targets(targets: &[TermTarget]) -> StepTargets {
    let mut step = StepTargets::default();
    for target in targets {
        step.terms.push(term(target, step.cells.len()));
        step.cells.extend(&target.cells);
        let cells = target.references.iter().zip(&target.shares);
        step.references.extend(cells.map(|([r, g, b], share)| [*r, *g, *b, *share]));
    }
    step
}

/// A goal whose cells start at this one.
fn term(target: &TermTarget, first: usize) -> GpuTerm {
    let (residual, amount) = match *target.criterion {
        Criterion::Target { .. } => (Residual::Tone, 0.0),
        Criterion::Brightness { stops } => (Residual::Brightness, stops),
        Criterion::Color { .. } => (Residual::Color, 0.0),
        Criterion::Temperature { mireds } => (Residual::Warmth, mireds),
        Criterion::Keep => (Residual::Stops, 0.0),
    };
    GpuTerm {
        mean_reference: target.reference_of_mean.unwrap_or_default(),
        residual,
        amount,
        exposure: target.exposure,
        weight: target.weight,
        luminance: target.luminance.unwrap_or_default(),
        first: first as u32,
        count: target.cells.len() as u32,
    }
}
