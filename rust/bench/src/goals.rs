use std::sync::OnceLock;

use serde::Deserialize;

use crate::FigureRecord;

/// Goals on an NVIDIA H200, beside the paper's figures. `scripts/bench/graphics.py` makes a table of the same file.
const GOALS: &str = include_str!("goals.json");

/// A goal, for figures whose names begin with one of `names`.
#[derive(Deserialize)]
struct FigureGoal {
    names: Vec<String>,
    goal: Option<f64>,
    paper: Option<f64>,
}

fn goals() -> &'static [FigureGoal] {
    static GOALS_READ: OnceLock<Vec<FigureGoal>> = OnceLock::new();
    // The tests read it.
    GOALS_READ.get_or_init(|| serde_json::from_str(GOALS).unwrap_or_default())
}

/// Puts the goal and the paper's figure beside a record, if there are such.
pub fn compare(record: &mut FigureRecord) {
    let is_its = |goal: &&FigureGoal| goal.names.iter().any(|name| record.name.starts_with(name));
    let Some(goal) = goals().iter().find(is_its) else { return };
    record.goal = goal.goal;
    if let Some(paper) = goal.paper {
        record.peer = Some("the paper, RTX 5090".into());
        record.peer_value = Some(paper);
        record.ratio = Some(record.value / paper);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Extent;
    use crate::device::solve_name;
    use crate::gather::on_gpu::paper_names;
    use crate::networks::{inference_names, training_names};

    /// Figures are found by their names: one that is called otherwise would lose its goal in silence.
    #[test]
    fn goals_are_those_of_figures_that_there_are() {
        let mut names: Vec<String> = paper_names().into();
        for network in ["fast 64x2", "reference 64/4", "reference 128/8", "reference 256/8"] {
            names.extend(inference_names(network));
        }
        names.extend(training_names("fast 64x2"));
        names.push(solve_name(Extent::CARD.picture, Extent::CARD.steps));
        let wanted = goals().iter().flat_map(|goal| &goal.names);
        // Those of trained proxies, which `scripts/bench/graphics.py` measures.
        let of_quality = |name: &&String| name.contains("s of training");
        let (trained, measured): (Vec<_>, Vec<_>) = wanted.partition(of_quality);
        assert_eq!(trained.len(), 4);
        let mut measured: Vec<_> = measured.into_iter().cloned().collect();
        names.sort();
        measured.sort();
        assert_eq!(measured, names);
    }

    #[test]
    fn a_record_is_put_beside_the_paper() {
        let mut record = FigureRecord {
            name: inference_names("reference 256/8")[0].clone(),
            value: 1.5,
            ..FigureRecord::default()
        };
        compare(&mut record);
        assert_eq!((record.goal, record.peer_value), (Some(3.0), Some(9.13)));
        let mut other = FigureRecord { name: "plain read".into(), ..FigureRecord::default() };
        compare(&mut other);
        assert_eq!((other.goal, other.peer), (None, None));
    }
}
