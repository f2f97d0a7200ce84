//! Outcome of the goals, measured on pictures before and after.

use crate::goal::{Criterion, Goal, RATIO_PER_MIRED};
use crate::variable::luminance;
use relume_image::{Image, metrics};
use serde::Serialize;

/// Outcome of a goal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name: target, brightness, color, temperature, keep.
    pub goal: &'static str,
    /// Requested value, in `unit`; none for a target.
    pub asked: Option<f64>,
    /// Value in the picture before.
    pub before: f64,
    /// Value in the picture after.
    pub reached: f64,
    /// `dB` (Reinhard PSNR), `stops`, `chroma` (distance of colour ratios), `mireds` or `fraction`.
    pub unit: &'static str,
    /// True if the goal is met.
    pub met: bool,
    /// Place where most of a target remains to be done, or where a part to be kept changed most.
    pub worst: Option<Worst>,
}

/// A tile of the picture and how far it is from the goal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Worst {
    /// Middle, as a fraction of the width.
    pub x: f32,
    /// Middle, as a fraction of the height from the top.
    pub y: f32,
    /// Stops that are missing (below 0: too bright).
    pub off: f32,
    /// Mireds of warmth that are missing (below 0: too warm).
    pub mireds: f32,
    /// Stops of green that are missing beside red and blue (below 0: too green).
    pub green: f32,
}

/// PSNR from which a target counts as reached.
const TARGET_MET: f64 = 30.0;
/// Stops, mireds, colour ratios and shares by which a goal may be missed.
pub(crate) const STOPS_MET: f64 = 0.05;
pub(crate) const MIREDS_MET: f64 = 5.0;
const CHROMA_MET: f64 = 0.1;
pub(crate) const KEEP_MET: f64 = 0.02;
/// Tiles along the width of a picture.
const TILES: usize = 16;

/// Measures a goal; all pictures are of the view's size, scene-linear RGB.
pub fn report(goal: &Goal, before: &Image, after: &Image) -> Report {
    let mean = |image: &Image| weighted_mean(image, goal.pixels.as_deref());
    let (was, is) = (mean(before), mean(after));
    let light = |value: [f64; 3]| f64::from(luminance(value.map(|v| v as f32))).max(1e-12);
    match &goal.criterion {
        Criterion::Target { image, exposure_invariant } => {
            target_report(goal, image, *exposure_invariant, before, after)
        }
        Criterion::Brightness { stops } => {
            let asked = f64::from(*stops);
            let reached = (light(is) / light(was)).log2();
            let met = (asked - reached) * asked.signum() <= STOPS_MET;
            Report { asked: Some(asked), reached, met, ..Report::new("brightness", "stops") }
        }
        Criterion::Color { color } => {
            let ratio = |value: [f64; 3]| value.map(|v| v / light(value));
            let wanted = ratio(color.map(f64::from));
            let distance = |value: [f64; 3]| {
                let ratio = ratio(value);
                (0..3).map(|c| (ratio[c] - wanted[c]).powi(2)).sum::<f64>().sqrt()
            };
            let met = distance(is) <= CHROMA_MET;
            Report {
                asked: Some(0.0),
                before: distance(was),
                reached: distance(is),
                met,
                ..Report::new("color", "chroma")
            }
        }
        Criterion::Temperature { mireds } => {
            let asked = f64::from(*mireds);
            let warmth = |value: [f64; 3]| (value[0].max(1e-12) / value[2].max(1e-12)).ln();
            let reached = (warmth(is) - warmth(was)) / f64::from(RATIO_PER_MIRED);
            let met = (asked - reached) * asked.signum() <= MIREDS_MET;
            Report { asked: Some(asked), reached, met, ..Report::new("temperature", "mireds") }
        }
        Criterion::Keep => {
            let change = (0..3).map(|c| (is[c] - was[c]).abs()).sum::<f64>();
            let reached = change / was.iter().sum::<f64>().max(1e-12);
            // Where one half became brighter and the other darker the mean says nothing.
            let after = masked(after.clone(), before, goal.pixels.as_deref());
            let worst = worst_tile(before, &after, metrics::exposure(before));
            let met = reached <= KEEP_MET;
            Report { asked: Some(0.0), reached, met, worst, ..Report::new("keep", "fraction") }
        }
    }
}

impl Report {
    /// Combines with another report on the same goal by noisy pictures, if those show less of what was asked for by
    /// amount or more change of what is to be kept. Noise hides how near colours and targets are, and where most
    /// changed.
    #[must_use]
    pub fn or_worse(self, noisy: Self) -> Self {
        let is_worse = match (self.unit, self.asked) {
            ("stops" | "mireds", Some(asked)) => (self.reached - noisy.reached) * asked > 0.0,
            ("fraction", _) => noisy.reached > self.reached,
            _ => false,
        };
        if is_worse { Self { worst: self.worst, ..noisy } } else { self }
    }

    fn new(goal: &'static str, unit: &'static str) -> Self {
        Self { goal, asked: None, before: 0.0, reached: 0.0, unit, met: false, worst: None }
    }
}

fn target_report(goal: &Goal, target: &Image, any_exposure: bool, before: &Image, after: &Image) -> Report {
    let weights = goal.pixels.as_deref();
    let fitted = |image: &Image| {
        let sum = |image: &Image| weighted_mean(image, weights).iter().sum::<f64>();
        let gain = if any_exposure { (sum(target) / sum(image).max(1e-12)) as f32 } else { 1.0 };
        masked(
            Image { data: image.data.iter().map(|v| v * gain).collect(), ..image.clone() },
            target,
            weights,
        )
    };
    let after = fitted(after);
    // What a target shows outside of its place counts neither as reached nor for its exposure.
    let wanted = goal.within(target);
    let psnr = |image: &Image| metrics::psnr_reinhard(&goal.within(image), &wanted).min(99.0);
    let (was, reached) = (psnr(&fitted(before)), psnr(&after));
    let worst = worst_tile(target, &after, metrics::exposure(&wanted));
    Report { before: was, reached, met: reached >= TARGET_MET, worst, ..Report::new("target", "dB") }
}

/// An image in which what a mask leaves out is that of the target, altogether or in part.
fn masked(mut image: Image, target: &Image, weights: Option<&[f32]>) -> Image {
    for (i, weight) in weights.unwrap_or(&[]).iter().enumerate() {
        (3 * i..3 * i + 3)
            .for_each(|k| image.data[k] = target.data[k] + weight * (image.data[k] - target.data[k]));
    }
    image
}

/// The tile of which a channel's mean differs most, tonemapped after this exposure.
fn worst_tile(target: &Image, after: &Image, exposure: f32) -> Option<Worst> {
    let edge = target.width.div_ceil(TILES).max(1);
    let (wide, high) = (target.width.div_ceil(edge), target.height.div_ceil(edge));
    let mut means = vec![[[0.0_f32; 3]; 2]; wide * high];
    for (side, image) in [target, after].into_iter().enumerate() {
        for (i, pixel) in image.data.as_chunks::<3>().0.iter().enumerate() {
            let tile = i / image.width / edge * wide + i % image.width / edge;
            (0..3).for_each(|c| means[tile][side][c] += exposure * pixel[c].max(0.0) / (edge * edge) as f32);
        }
    }
    let tone = |x: f32| x / (1.0 + x);
    let difference = |[target, after]: &[[f32; 3]; 2]| {
        (0..3).map(|c| (tone(target[c]) - tone(after[c])).abs()).fold(0.0, f32::max)
    };
    let (number, [target_mean, after_mean]) =
        means.iter().enumerate().max_by(|a, b| difference(a.1).total_cmp(&difference(b.1)))?;
    // What is nearly black has no colour to speak of.
    let missing = |target: f32, after: f32| ((target + 0.01) / (after + 0.01)).log2();
    let [red, green, blue] = std::array::from_fn(|c| missing(target_mean[c], after_mean[c]));
    Some(Worst {
        x: ((number % wide * edge) as f32 + 0.5 * edge as f32) / target.width as f32,
        y: ((number / wide * edge) as f32 + 0.5 * edge as f32) / target.height as f32,
        off: missing(luminance(*target_mean), luminance(*after_mean)),
        mireds: (red - blue) * std::f32::consts::LN_2 / RATIO_PER_MIRED,
        green: green - 0.5 * (red + blue),
    })
}

fn weighted_mean(image: &Image, weights: Option<&[f32]>) -> [f64; 3] {
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for (i, pixel) in image.data.as_chunks::<3>().0.iter().enumerate() {
        let weight = f64::from(weights.map_or(1.0, |weights| weights[i]));
        (0..3).for_each(|c| sum[c] += weight * f64::from(pixel[c]));
        total += weight;
    }
    sum.map(|sum| sum / f64::max(total, 1e-12))
}

/// Pairs of goals that ask for opposite things in the same place of a picture, by their numbers.
pub fn conflicts(goals: &[Goal], before: &Image) -> Vec<(usize, usize)> {
    let pairs = (0..goals.len()).flat_map(|i| (i + 1..goals.len()).map(move |j| (i, j)));
    let is_conflict =
        |(i, j): &(usize, usize)| overlap(&goals[*i], &goals[*j]) && oppose(&goals[*i], &goals[*j], before);
    pairs.filter(is_conflict).collect()
}

fn oppose(a: &Goal, b: &Goal, before: &Image) -> bool {
    match (&a.criterion, &b.criterion) {
        (Criterion::Brightness { stops: a }, Criterion::Brightness { stops: b }) => a * b < 0.0,
        (Criterion::Temperature { mireds: a }, Criterion::Temperature { mireds: b }) => a * b < 0.0,
        (Criterion::Color { color: a }, Criterion::Color { color: b }) => {
            let [a, b] = [a, b].map(|color| color.map(|c| c / luminance(*color).max(1e-9)));
            (0..3).any(|c| (a[c] - b[c]).abs() > 0.3)
        }
        (Criterion::Target { .. }, Criterion::Target { .. }) | (Criterion::Keep, Criterion::Keep) => false,
        (Criterion::Target { image, exposure_invariant }, _) => {
            let there = Goal { pixels: shared(a, b), ..b.clone() };
            is_denied(&there, image, *exposure_invariant, before)
        }
        (_, Criterion::Target { .. }) => oppose(b, a, before),
        (Criterion::Keep, _) | (_, Criterion::Keep) => true,
        _ => false,
    }
}

/// True if less than half of a goal would be done where the picture is a target. A target of any exposure says nothing
/// of brightness.
fn is_denied(goal: &Goal, target: &Image, any_exposure: bool, before: &Image) -> bool {
    let there = report(goal, before, target);
    let asked = there.asked.unwrap_or_default();
    let is_left = there.reached * asked.signum() < 0.5 * asked.abs();
    match goal.criterion {
        Criterion::Brightness { .. } => is_left && !any_exposure,
        Criterion::Temperature { .. } => is_left,
        Criterion::Color { .. } => !there.met && there.reached > 0.5 * there.before,
        Criterion::Keep => !there.met && !any_exposure,
        Criterion::Target { .. } => false,
    }
}

/// True if the goals share a third of the smaller one.
fn overlap(a: &Goal, b: &Goal) -> bool {
    let (Some(a), Some(b)) = (&a.pixels, &b.pixels) else { return true };
    let shared: f32 = a.iter().zip(b).map(|(a, b)| a.min(*b)).sum();
    shared > 0.33 * a.iter().sum::<f32>().min(b.iter().sum())
}

/// Weights of the place that both goals concern.
fn shared(a: &Goal, b: &Goal) -> Option<Vec<f32>> {
    match (&a.pixels, &b.pixels) {
        (Some(a), Some(b)) => Some(a.iter().zip(b).map(|(a, b)| a.min(*b)).collect()),
        (one, other) => one.as_ref().or(other.as_ref()).cloned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: [f32; 3]) -> Image {
        Image { width: 4, height: 2, channels: 3, data: value.repeat(8) }
    }

    fn goal(criterion: Criterion, pixels: Option<Vec<f32>>) -> Goal {
        Goal { criterion, pixels, weight: 1.0 }
    }

    #[test]
    fn stops_and_mireds_are_those_of_the_region() {
        let before = flat([0.2, 0.2, 0.2]);
        let mut after = before.clone();
        after.data[..3].copy_from_slice(&[0.8, 0.4, 0.2]);
        let first = Some(vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let brighter = report(&goal(Criterion::Brightness { stops: 1.0 }, first.clone()), &before, &after);
        let expected = (luminance([4.0, 2.0, 1.0]) as f64).log2();
        assert!((brighter.reached - expected).abs() < 1e-5 && brighter.met, "{brighter:?}");
        assert!(!report(&goal(Criterion::Brightness { stops: 3.0 }, first.clone()), &before, &after).met);
        let warmer = report(&goal(Criterion::Temperature { mireds: 100.0 }, first.clone()), &before, &after);
        assert!((warmer.reached - 4f64.ln() / 0.00769).abs() < 0.1 && warmer.met, "{warmer:?}");
        assert!(!report(&goal(Criterion::Keep, first), &before, &after).met);
        let rest = Some(vec![0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert!(report(&goal(Criterion::Keep, rest), &before, &after).met);
    }

    #[test]
    fn of_two_reports_that_with_less_done_or_more_changed_counts() {
        let before = flat([0.5; 3]);
        let of = |criterion: &Criterion, value: f32| {
            report(&goal(criterion.clone(), None), &before, &flat([value; 3]))
        };
        let told = |criterion: Criterion, clean: f32, noisy: f32| {
            of(&criterion, clean).or_worse(of(&criterion, noisy)).reached
        };
        let by = |stops: f64, criterion: &Criterion, clean: f32, noisy: f32| {
            assert!(
                (told(criterion.clone(), clean, noisy) - stops).abs() < 1e-5,
                "{criterion:?} {clean} {noisy}"
            );
        };
        let (up, down) = (Criterion::Brightness { stops: 1.0 }, Criterion::Brightness { stops: -1.0 });
        by(1.0, &up, 1.0, 2.0);
        by(1.0, &up, 2.0, 1.0);
        by(-1.0, &down, 0.25, 0.25);
        by(-1.0, &down, 0.125, 0.25);
        by(-1.0, &down, 0.25, 0.125);
        assert!(
            (told(Criterion::Keep, 0.5, 0.55) - 0.1).abs() < 1e-5 && told(Criterion::Keep, 0.45, 0.5) > 0.09
        );
        let target = Criterion::Target { image: before.clone(), exposure_invariant: false };
        assert_eq!(told(target, 0.5, 0.25), 99.0, "noise is no fault of the lights");
    }

    #[test]
    fn what_is_kept_on_average_only_says_where_it_changed() {
        let before = flat([0.5; 3]);
        let mut after = before.clone();
        // One pixel darker, the one below as much brighter.
        after.data[..3].fill(0.25);
        after.data[12..15].fill(0.75);
        let kept = report(&goal(Criterion::Keep, None), &before, &after);
        let worst = kept.worst.unwrap();
        assert!(kept.met && kept.reached < 1e-6, "{kept:?}");
        assert!((worst.x, worst.y) == (0.125, 0.25) && worst.off > 0.9, "{worst:?}");
        let rest = Some(vec![0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0]);
        let untouched = report(&goal(Criterion::Keep, rest), &before, &after);
        assert!(untouched.worst.unwrap().off.abs() < 1e-6, "{untouched:?}");
    }

    #[test]
    fn a_target_says_where_it_is_missed() {
        let target = flat([0.5; 3]);
        let mut after = target.clone();
        after.data[3 * 7..].fill(0.05);
        let criterion = Criterion::Target { image: target.clone(), exposure_invariant: false };
        let missed = report(&goal(criterion.clone(), None), &flat([0.1; 3]), &after);
        let worst = missed.worst.unwrap();
        assert!(!missed.met && missed.reached > missed.before, "{missed:?}");
        assert_eq!((worst.x, worst.y), (0.875, 0.75));
        assert!(worst.off > 2.0);
        let doubled = Image { data: target.data.iter().map(|v| 2.0 * v).collect(), ..target.clone() };
        assert!(!report(&goal(criterion, None), &target, &doubled).met);
        let invariant = Criterion::Target { image: target.clone(), exposure_invariant: true };
        assert!(report(&goal(invariant, None), &target, &doubled).met);
    }

    #[test]
    fn a_target_that_is_missed_in_its_colour_alone_says_which() {
        // Of one luminance: 0.2126 R + 0.7152 G + 0.0722 B.
        let target = flat([0.5; 3]);
        let worst = |pixel: [f32; 3]| {
            let mut after = target.clone();
            after.data[3 * 7..].copy_from_slice(&pixel);
            let criterion = Criterion::Target { image: target.clone(), exposure_invariant: false };
            let worst = report(&goal(criterion, None), &target, &after).worst.unwrap();
            assert_eq!((worst.x, worst.y), (0.875, 0.75), "{worst:?}");
            assert!(worst.off.abs() < 0.01, "{worst:?}");
            worst
        };
        let [warm, cool] = [worst([0.6, 0.5, 0.2056]), worst([0.4, 0.5, 0.7944])];
        assert!((warm.mireds + (0.61_f32 / 0.2156).ln() / RATIO_PER_MIRED).abs() < 1.0, "{warm:?}");
        assert!(cool.mireds > 80.0 && cool.green.abs() < 0.2, "{cool:?}");
        let green = worst([0.3, 0.577, 0.3264]);
        assert!(green.green < -0.7 && green.mireds.abs() < 12.0, "{green:?}");
    }

    #[test]
    fn a_target_with_a_place_is_judged_in_it_alone() {
        let mut target = flat([0.5; 3]);
        // Outside anything may stand.
        target.data[..3].fill(1e4);
        let after = flat([0.25; 3]);
        let half = Some([0.0, 0.0, 1.0, 1.0].repeat(2));
        let criterion = |image: &Image| Criterion::Target { image: image.clone(), exposure_invariant: false };
        let in_place = report(&goal(criterion(&target), half), &after, &after);
        let whole = report(&goal(criterion(&flat([0.5; 3])), None), &after, &after);
        assert!((in_place.reached - whole.reached).abs() < 1e-4 && !in_place.met, "{in_place:?} {whole:?}");
        assert!(in_place.worst.unwrap().x > 0.5 && in_place.worst.unwrap().off > 0.9, "{in_place:?}");
    }

    #[test]
    fn opposite_wishes_in_one_place_conflict() {
        let all = Some(vec![1.0; 8]);
        let left = Some([1.0, 1.0, 0.0, 0.0].repeat(2));
        let right = Some([0.0, 0.0, 1.0, 1.0].repeat(2));
        let goals = [
            goal(Criterion::Brightness { stops: 1.0 }, left.clone()),
            goal(Criterion::Brightness { stops: -1.0 }, right),
            goal(Criterion::Brightness { stops: -1.0 }, left.clone()),
            goal(Criterion::Temperature { mireds: 30.0 }, all),
            goal(Criterion::Keep, left),
        ];
        assert_eq!(conflicts(&goals, &flat([0.5; 3])), [(0, 2), (0, 4), (2, 4), (3, 4)]);
    }

    #[test]
    fn a_target_conflicts_with_what_it_does_not_show() {
        let before = flat([0.2; 3]);
        let left = || Some([1.0, 1.0, 0.0, 0.0].repeat(2));
        let right = Some([0.0, 0.0, 1.0, 1.0].repeat(2));
        // As it is, but for the left half.
        let with_left = |pixel: [f32; 3]| {
            let row = [pixel, pixel, [0.2; 3], [0.2; 3]].concat();
            Image { data: row.repeat(2), ..before.clone() }
        };
        let is_conflict = |target: Image, exposure_invariant: bool, other: Goal| {
            let goals = [goal(Criterion::Target { image: target, exposure_invariant }, None), other];
            let [found, turned] =
                [&goals, &[goals[1].clone(), goals[0].clone()]].map(|goals| conflicts(goals, &before));
            assert_eq!(found, turned);
            found == [(0, 1)]
        };
        let brighter = || goal(Criterion::Brightness { stops: 2.0 }, left());
        assert!(is_conflict(before.clone(), false, brighter()));
        assert!(is_conflict(with_left([0.3; 3]), false, brighter()), "0.6 of 2 stops");
        assert!(!is_conflict(with_left([0.6; 3]), false, brighter()), "1.6 of 2 stops");
        assert!(!is_conflict(before.clone(), true, brighter()), "an exposure can be any");
        let warmer = |place| goal(Criterion::Temperature { mireds: 60.0 }, place);
        let warm = with_left([0.25, 0.2, 0.15]);
        assert!(!is_conflict(warm.clone(), false, warmer(left())));
        assert!(is_conflict(warm.clone(), true, warmer(right)));
        assert!(!is_conflict(warm.clone(), false, goal(Criterion::Color { color: [5.0, 4.0, 3.0] }, left())));
        assert!(is_conflict(warm.clone(), false, goal(Criterion::Color { color: [1.0, 4.0, 9.0] }, left())));
        assert!(!is_conflict(before.clone(), false, goal(Criterion::Keep, left())));
        assert!(is_conflict(warm, false, goal(Criterion::Keep, left())));
    }
}
