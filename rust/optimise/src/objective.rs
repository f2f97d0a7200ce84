use crate::cells::Cells;
use crate::goal::{Criterion, Goal};
use crate::preference;
use crate::problem::{Problem, View, mean_luminance};
use crate::relight::{Compare, Linear, LossGradient, PictureCells};
use crate::term::{Baseline, GoalComparison, Term, TermTarget, Uncertainty};
use crate::variable::{Mapping, PARAMS};
use crate::{OptimiseError, RelightError};
use rayon::prelude::*;
use relume_image::metrics;
use relume_scene::{LANES, Light};

/// Loss and gradient of lights at one softness.
pub(crate) struct Objective<'a> {
    pub(crate) problem: &'a Problem<'a>,
    pub(crate) views: Vec<ViewObjective<'a>>,
    softness: f32,
}

/// The goals of one view, with all pictures as cells.
pub(crate) struct ViewObjective<'a> {
    view: &'a View<'a>,
    base: Vec<[f32; 3]>,
    /// Pictures of the lights whose shapes stay.
    still: Vec<Option<Vec<[f32; 3]>>>,
    pub(crate) terms: Vec<Term<'a>>,
    /// Comparison by the relighter, where it compares its pictures itself.
    comparison: Option<Box<dyn Compare + 'a>>,
}

/// Cells at which each term of each view is evaluated, as numbers of the term's own list.
pub(crate) type Draw = Vec<Vec<Vec<u32>>>;

impl<'a> Objective<'a> {
    pub(crate) fn new(problem: &'a Problem<'a>, softness: f32) -> Result<Self, OptimiseError> {
        let views = problem.views.iter().map(|view| ViewObjective::new(view, problem, softness));
        Ok(Self { problem, views: views.collect::<Result<_, _>>()?, softness })
    }

    /// Draw of at most so many cells of each term, evenly spread.
    pub(crate) fn spread(&self, count: usize) -> Draw {
        let terms = |view: &ViewObjective| {
            view.terms.iter().map(|term| crate::cells::spread(term.len(), count)).collect()
        };
        self.views.iter().map(terms).collect()
    }

    /// Weighted mean of squared residuals (for a target the paper's equation 6), and what the lights' moves cost.
    pub(crate) fn loss(
        &self,
        mappings: &[Mapping],
        lights: &[Light],
        draw: &Draw,
    ) -> Result<f64, OptimiseError> {
        let mut loss = self.preference_loss(mappings, lights);
        for (view, draw) in self.views.iter().zip(draw) {
            loss += view.loss(lights, self.softness, draw)?;
        }
        Ok(loss)
    }

    /// Pictures of each light for radiance 1 in each view, at the drawn cells.
    pub(crate) fn units(
        &self,
        lights: &[Light],
        draw: &Draw,
    ) -> Result<Vec<Vec<UnitPicture>>, OptimiseError> {
        let units = |(view, draw): (&ViewObjective, &Vec<Vec<u32>>)| {
            Ok(view.units(lights, self.softness, &view.cells_of(draw))?)
        };
        self.views.iter().zip(draw).map(units).collect()
    }

    /// Pictures of one light for radiance 1, by view.
    pub(crate) fn units_of(
        &self,
        number: usize,
        light: &Light,
        draw: &Draw,
    ) -> Result<Vec<UnitPicture>, OptimiseError> {
        let unit = |(view, draw): (&ViewObjective, &Vec<Vec<u32>>)| {
            Ok(view.unit(number, light, self.softness, &view.cells_of(draw))?)
        };
        self.views.iter().zip(draw).map(unit).collect()
    }

    /// Loss without the cost of moves, from pictures that are there already.
    pub(crate) fn loss_of_goals(&self, lights: &[Light], units: &[Vec<UnitPicture>], draw: &Draw) -> f64 {
        let of_view = |((view, units), draw): ((&ViewObjective, &Vec<UnitPicture>), &Vec<Vec<u32>>)| {
            view.loss_of_units(lights, units, draw)
        };
        self.views.iter().zip(units).zip(draw).map(of_view).sum()
    }

    /// Loss without the cost of moves, from two exact estimates of each picture, which tell how noisy they are.
    pub(crate) fn loss_of_halves(&self, lights: &[Light], units: &[Vec<Halves>], draw: &Draw) -> f64 {
        let views = self.views.iter().zip(units).zip(draw);
        views.map(|((view, units), draw)| view.loss_of_halves(lights, units, draw)).sum()
    }

    /// Loss and its gradient by the unconstrained values of each light, without what leads through an active bound.
    pub(crate) fn gradient(
        &self,
        mappings: &[Mapping],
        lights: &[Light],
        draw: &Draw,
    ) -> Result<(f64, Vec<[f32; PARAMS]>), OptimiseError> {
        let mut loss = self.preference_loss(mappings, lights);
        let mut gradient = vec![[0.0; PARAMS]; lights.len()];
        for (view, draw) in self.views.iter().zip(draw) {
            let (view_loss, by_light) = view.gradient(lights, self.softness, draw)?;
            loss += view_loss;
            for (i, (d_shape, d_radiance)) in by_light.iter().enumerate() {
                let pulled = mappings[i].pull_back(&lights[i], d_shape, *d_radiance);
                (0..PARAMS).for_each(|lane| gradient[i][lane] += pulled[lane]);
            }
        }
        for (i, gradient) in gradient.iter_mut().enumerate() {
            for (value, row) in self.preferences(i, &mappings[i], &lights[i]) {
                (0..PARAMS).for_each(|lane| gradient[lane] += 2.0 * value * row[lane]);
            }
            mappings[i].active_bounds(&lights[i]).for_each(|bound| bound.project(gradient));
        }
        Ok((loss, gradient))
    }

    /// Cost of a light's moves.
    pub(crate) fn preferences(
        &self,
        number: usize,
        mapping: &Mapping,
        light: &Light,
    ) -> Vec<(f32, [f32; PARAMS])> {
        preference::residuals(&self.problem.variables[number], mapping, light)
    }

    pub(crate) fn preference_loss(&self, mappings: &[Mapping], lights: &[Light]) -> f64 {
        let of = |(i, light)| self.preferences(i, &mappings[i], light);
        lights.iter().enumerate().flat_map(of).map(|(value, _)| f64::from(value * value)).sum()
    }
}

/// Exposure that brings a picture of some mean luminance to moderate brightness. A black one goes by a target beside
/// it.
fn exposure_of_baseline(view: &View<'_>, luminance: f32) -> Result<f32, OptimiseError> {
    let target = view.goals.iter().find_map(|goal| match &goal.criterion {
        Criterion::Target { image, .. } => Some(metrics::exposure(image)),
        _ => None,
    });
    if luminance > 0.0 { Ok(0.5 / luminance) } else { target.ok_or(OptimiseError::BlackBefore) }
}

/// A light's picture for radiance 1 at some cells.
pub(crate) type UnitPicture = Vec<[f32; 3]>;

/// Cells by two estimates with independent noise.
pub(crate) type Halves = [Vec<[f32; 3]>; 2];

/// Derivatives by the lanes of a shape and by the radiance.
type LightGradient = ([f32; LANES], [f32; 3]);

impl<'a> ViewObjective<'a> {
    fn new(view: &'a View<'a>, problem: &Problem, softness: f32) -> Result<Self, OptimiseError> {
        let cells = Cells::new(view.relight.size(), view.relight.cell());
        let still = view.still.iter().map(|image| image.map(|image| cells.means(image))).collect();
        let mut new = Self { view, base: cells.means(view.base), still, terms: Vec::new(), comparison: None };
        let lights = || problem.variables.iter().map(|v| v.light.clone()).collect::<Vec<_>>();
        let is_target = |goal: &Goal| matches!(goal.criterion, Criterion::Target { .. });
        let baseline = if view.goals.iter().all(is_target) {
            Baseline { cells: new.base.clone(), halves: None }
        } else {
            new.baseline(&lights(), softness)?
        };
        let baseline_exposure = exposure_of_baseline(view, mean_luminance(&baseline.cells))?;
        new.terms =
            view.goals.iter().map(|goal| Term::new(goal, cells, &baseline, baseline_exposure)).collect();
        let still: Vec<&[[f32; 3]]> = new.still.iter().flatten().map(Vec::as_slice).collect();
        // Where nothing moves, all pictures are here.
        let moves = still.len() < new.still.len() && !new.terms.is_empty();
        new.comparison = if moves { view.relight.comparison(&new.base, &still)? } else { None };
        Ok(new)
    }

    /// All cells.
    pub(crate) fn whole_picture(&self, lights: &[Light]) -> Result<PictureCells, RelightError> {
        let mut rest = self.base.clone();
        let mut moving = Vec::new();
        for (light, still) in lights.iter().zip(&self.still) {
            match still {
                Some(values) => add(&mut rest, values, light.radiance),
                None => moving.push(light),
            }
        }
        if moving.is_empty() {
            let exact = [rest.clone(), rest];
            return Ok(PictureCells { clean: exact.clone(), exact });
        }
        let mut picture = self.view.relight.picture(&moving)?;
        let halves = picture.exact.iter_mut().chain(&mut picture.clean);
        halves.for_each(|half| add(half, &rest, [1.0; 3]));
        Ok(picture)
    }

    /// Some lights in the place of one of the problem, for radiance 1 at some cells: two estimates.
    pub(crate) fn half_values(
        &self,
        number: usize,
        lights: &[&Light],
        cells: &[u32],
    ) -> Result<Vec<Halves>, RelightError> {
        let Some(values) = &self.still[number] else { return self.view.relight.half_values(lights, cells) };
        let values: Vec<[f32; 3]> = cells.iter().map(|cell| values[*cell as usize]).collect();
        Ok(lights.iter().map(|_| [values.clone(), values.clone()]).collect())
    }

    /// The picture of the lights as they were, clean at softness 0.
    fn baseline(&self, lights: &[Light], softness: f32) -> Result<Baseline, RelightError> {
        if softness == 0.0 {
            let PictureCells { exact, clean } = self.whole_picture(lights)?;
            return Ok(Baseline { cells: mean(&clean), halves: Some(exact) });
        }
        let cells: Vec<u32> = (0..self.base.len() as u32).collect();
        let units = self.units(lights, softness, &cells)?;
        let cells = (0..cells.len()).map(|k| self.sum(lights, &units, k, k)).collect();
        Ok(Baseline { cells, halves: None })
    }

    /// Numbers of the drawn cells of all terms, one after the other.
    pub(crate) fn cells_of(&self, draw: &[Vec<u32>]) -> Vec<u32> {
        let of_term = |(term, draw): (&Term, &Vec<u32>)| {
            draw.iter().map(|number| term.cells[*number as usize]).collect::<Vec<_>>()
        };
        self.terms.iter().zip(draw).flat_map(of_term).collect()
    }

    fn units(
        &self,
        lights: &[Light],
        softness: f32,
        cells: &[u32],
    ) -> Result<Vec<UnitPicture>, RelightError> {
        let unit = |(i, light): (usize, &Light)| self.unit(i, light, softness, cells);
        lights.par_iter().enumerate().map(unit).collect()
    }

    /// One light's picture for radiance 1.
    fn unit(
        &self,
        number: usize,
        light: &Light,
        softness: f32,
        cells: &[u32],
    ) -> Result<UnitPicture, RelightError> {
        match &self.still[number] {
            Some(image) => Ok(cells.iter().map(|cell| image[*cell as usize]).collect()),
            None => self.view.relight.values(light, softness, cells),
        }
    }

    /// Unit pictures with derivatives from a relighter that has them at hand; else see [`Self::units`].
    fn linear_units(
        &self,
        lights: &[Light],
        softness: f32,
        cells: &[u32],
    ) -> Result<Vec<Linear>, RelightError> {
        let unit = |(i, light): (usize, &Light)| {
            if self.still[i].is_none()
                && let Some(linear) = self.view.relight.linearise(light, softness, cells)?
            {
                return Ok(linear);
            }
            Ok(Linear { values: self.unit(i, light, softness, cells)?, slopes: Vec::new() })
        };
        lights.par_iter().enumerate().map(unit).collect()
    }

    /// Base and lights at the `k`th of the cells that the units are of.
    fn sum(&self, lights: &[Light], units: &[impl AsRef<[[f32; 3]]>], cell: usize, k: usize) -> [f32; 3] {
        let mut sum = self.base[cell];
        for (light, unit) in lights.iter().zip(units) {
            (0..3).for_each(|c| sum[c] += light.radiance[c] * unit.as_ref()[k][c]);
        }
        sum
    }

    /// Each term at its drawn cells of a clean whole picture.
    pub(crate) fn compare_picture(
        &self,
        picture: &PictureCells,
        uncertainties: &[Uncertainty],
        draw: &[Vec<u32>],
    ) -> Vec<GoalComparison<'_>> {
        let clean = mean(&picture.clean);
        let compare = |((term, uncertainty), draw): ((&Term<'a>, &Uncertainty), &Vec<u32>)| {
            GoalComparison::new(term.target_with(uncertainty, draw), term.drawn(&clean, draw))
        };
        self.terms.iter().zip(uncertainties).zip(draw).map(compare).collect()
    }

    /// Uncertainty of the mean of each term in a clean whole picture.
    pub(crate) fn uncertainties(&self, picture: &PictureCells, draw: &[Vec<u32>]) -> Vec<Uncertainty> {
        let clean = mean(&picture.clean);
        let uncertainty = |(term, draw): (&Term<'a>, &Vec<u32>)| {
            let exact = picture.exact.each_ref().map(|half| term.drawn(half, draw));
            term.uncertainty_of_clean(&term.drawn(&clean, draw), &exact, draw)
        };
        self.terms.iter().zip(draw).map(uncertainty).collect()
    }

    /// Weighted residuals of a picture that differs from the one compared by noise and little else.
    pub(crate) fn residuals_beside(
        &self,
        comparisons: &[GoalComparison],
        picture: &[[f32; 3]],
        draw: &[Vec<u32>],
    ) -> Vec<f32> {
        let of_term = |((comparison, term), draw): ((&GoalComparison, &Term), &Vec<u32>)| {
            comparison.weighted_residuals(&term.drawn(picture, draw)).collect::<Vec<_>>()
        };
        comparisons.iter().zip(&self.terms).zip(draw).flat_map(of_term).collect()
    }

    /// Each term at its drawn cells.
    pub(crate) fn compare(
        &self,
        lights: &[Light],
        units: &[impl AsRef<[[f32; 3]]>],
        draw: &[Vec<u32>],
    ) -> Vec<GoalComparison<'_>> {
        let pictures = self.drawn_sums(lights, units, draw);
        let compare = |((term, draw), picture): ((&Term<'a>, &Vec<u32>), Vec<[f32; 3]>)| {
            GoalComparison::new(term.target(draw), picture)
        };
        self.terms.iter().zip(draw).zip(pictures).map(compare).collect()
    }

    /// Base and lights at the drawn cells of each term.
    fn drawn_sums(
        &self,
        lights: &[Light],
        units: &[impl AsRef<[[f32; 3]]>],
        draw: &[Vec<u32>],
    ) -> Vec<Vec<[f32; 3]>> {
        let mut first = 0;
        let of_term = |(term, draw): (&Term, &Vec<u32>)| {
            let at = |(k, number): (usize, &u32)| {
                self.sum(lights, units, term.cells[*number as usize] as usize, first + k)
            };
            let picture = draw.iter().enumerate().map(at).collect();
            first += draw.len();
            picture
        };
        self.terms.iter().zip(draw).map(of_term).collect()
    }

    fn loss(&self, lights: &[Light], softness: f32, draw: &[Vec<u32>]) -> Result<f64, OptimiseError> {
        if let Some(compared) = self.compare_itself(lights, softness, draw)? {
            return Ok(compared.loss);
        }
        let units = self.units(lights, softness, &self.cells_of(draw))?;
        Ok(self.loss_of_units(lights, &units, draw))
    }

    fn loss_of_units(&self, lights: &[Light], units: &[UnitPicture], draw: &[Vec<u32>]) -> f64 {
        self.compare(lights, units, draw).iter().map(GoalComparison::loss).sum()
    }

    fn loss_of_halves(&self, lights: &[Light], units: &[Halves], draw: &[Vec<u32>]) -> f64 {
        let [first, second] = [0, 1].map(|half| {
            let of_half: Vec<&UnitPicture> = units.iter().map(|unit| &unit[half]).collect();
            self.drawn_sums(lights, &of_half, draw)
        });
        let halves = first.into_iter().zip(second).map(|(a, b)| [a, b]);
        let loss = |((term, draw), halves): ((&Term<'a>, &Vec<u32>), Halves)| {
            GoalComparison::new(term.target_with(&term.uncertainty(&halves, draw), draw), mean(&halves))
                .loss()
        };
        self.terms.iter().zip(draw).zip(halves).map(loss).sum()
    }

    /// Loss and gradient by the relighter, if it compares its pictures itself.
    fn compare_itself(
        &self,
        lights: &[Light],
        softness: f32,
        draw: &[Vec<u32>],
    ) -> Result<Option<LossGradient>, RelightError> {
        let Some(comparison) = &self.comparison else { return Ok(None) };
        let lights = || lights.iter().zip(&self.still);
        let moving: Vec<&Light> =
            lights().filter_map(|(light, still)| still.is_none().then_some(light)).collect();
        let still: Vec<[f32; 3]> =
            lights().filter_map(|(light, still)| still.as_ref().map(|_| light.radiance)).collect();
        let targets: Vec<TermTarget> =
            self.terms.iter().zip(draw).map(|(term, draw)| term.target(draw)).collect();
        comparison.gradient(&moving, &still, softness, &targets)
    }

    /// The gradients of all lights in their order.
    fn by_light(&self, compared: LossGradient) -> Vec<LightGradient> {
        let (mut moving, mut still) = (compared.lights.into_iter(), compared.still.into_iter());
        let of_light = |picture: &Option<_>| match picture {
            Some(_) => still.next().map(|by_radiance| ([0.0; LANES], by_radiance)),
            None => moving.next(),
        };
        self.still.iter().filter_map(of_light).collect()
    }

    fn gradient(
        &self,
        lights: &[Light],
        softness: f32,
        draw: &[Vec<u32>],
    ) -> Result<(f64, Vec<LightGradient>), OptimiseError> {
        if let Some(compared) = self.compare_itself(lights, softness, draw)? {
            return Ok((compared.loss, self.by_light(compared)));
        }
        let cells = self.cells_of(draw);
        let units = self.linear_units(lights, softness, &cells)?;
        let comparisons = self.compare(lights, &units, draw);
        let d_picture: Vec<[f32; 3]> = comparisons.iter().flat_map(GoalComparison::pull_back).collect();
        let of_light = |(i, light): (usize, &Light)| {
            let unit = &units[i];
            let mut d_radiance = [0.0; 3];
            for (d, value) in d_picture.iter().zip(&unit.values) {
                (0..3).for_each(|c| d_radiance[c] += d[c] * value[c]);
            }
            let d_shape = self.shape_gradient(i, light, softness, &cells, unit, &d_picture)?;
            Ok((d_shape, d_radiance))
        };
        let by_light = lights.par_iter().enumerate().map(of_light).collect::<Result<_, OptimiseError>>()?;
        Ok((comparisons.iter().map(GoalComparison::loss).sum(), by_light))
    }

    fn shape_gradient(
        &self,
        number: usize,
        light: &Light,
        softness: f32,
        cells: &[u32],
        unit: &Linear,
        d_picture: &[[f32; 3]],
    ) -> Result<[f32; LANES], OptimiseError> {
        let scaled = |d: &[f32; 3]| std::array::from_fn(|c| d[c] * light.radiance[c]);
        if self.still[number].is_some() {
            return Ok([0.0; LANES]);
        }
        if unit.slopes.is_empty() {
            let d_unit: Vec<[f32; 3]> = d_picture.iter().map(scaled).collect();
            return Ok(self.view.relight.pull_back(light, softness, cells, &d_unit)?);
        }
        let mut sums = [0.0_f64; LANES];
        for (d, slopes) in d_picture.iter().zip(&unit.slopes) {
            let d = scaled(d);
            for (sum, slope) in sums.iter_mut().zip(slopes) {
                *sum += f64::from(d[0] * slope[0] + d[1] * slope[1] + d[2] * slope[2]);
            }
        }
        Ok(sums.map(|sum| sum as f32))
    }
}

/// Adds a picture times a radiance.
pub(crate) fn add(sum: &mut [[f32; 3]], picture: &[[f32; 3]], radiance: [f32; 3]) {
    for (sum, value) in sum.iter_mut().zip(picture) {
        (0..3).for_each(|c| sum[c] += radiance[c] * value[c]);
    }
}

/// The mean of two estimates of a picture.
pub(crate) fn mean([a, b]: &Halves) -> Vec<[f32; 3]> {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect()
}
