//! Goals as a GPU takes them, which compares pictures where it makes them.

use relume_gpu::compare::{Look, Residual, Term};
use relume_optimise::{Aim, Wanted};

/// What is wanted of some cells.
pub(super) fn look(wanted: &[Wanted]) -> Look {
    let mut look = Look::default();
    for wanted in wanted {
        look.terms.push(term(wanted, look.cells.len()));
        look.cells.extend(&wanted.cells);
        let cells = wanted.references.iter().zip(&wanted.shares);
        look.wanted.extend(cells.map(|([r, g, b], share)| [*r, *g, *b, *share]));
    }
    look
}

/// A goal whose cells start at this one.
fn term(wanted: &Wanted, first: usize) -> Term {
    let (residual, amount) = match *wanted.aim {
        Aim::Target { .. } => (Residual::Tone, 0.0),
        Aim::Brightness { stops } => (Residual::Brightness, stops),
        Aim::Color { .. } => (Residual::Color, 0.0),
        Aim::Temperature { mireds } => (Residual::Warmth, mireds),
        Aim::Keep => (Residual::Stops, 0.0),
    };
    Term {
        mean_reference: wanted.reference_of_mean.unwrap_or_default(),
        residual,
        amount,
        exposure: wanted.exposure,
        weight: wanted.weight,
        luminance: wanted.luminance.unwrap_or_default(),
        first: first as u32,
        count: wanted.cells.len() as u32,
    }
}
