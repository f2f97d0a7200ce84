use crate::cells::{Cells, spread};
use crate::goal::{Criterion, Goal};
use crate::variable::{Variable, luminance};
use crate::{OptimiseError, Relight};
use relume_image::Image;
use relume_scene::Light;

/// A camera from which the lights are seen.
#[derive(Clone)]
pub struct View<'a> {
    /// Relighter for the lights whose shapes may change.
    pub relight: &'a dyn Relight,
    /// Picture without the solved lights: static layer, world, other lights. Scene-linear RGB.
    pub base: &'a Image,
    /// For each variable whose shape stays its picture for radiance 1.
    pub still: Vec<Option<&'a Image>>,
    /// Goals for the picture.
    pub goals: &'a [Goal],
}

/// Problem to solve: lights that serve the goals of all views.
#[derive(Clone)]
pub struct Problem<'a> {
    /// Views of the scene.
    pub views: Vec<View<'a>>,
    /// The lights.
    pub variables: Vec<Variable>,
}

/// Cells from which the brightness of a light is judged.
const JUDGED: usize = 192;

impl Problem<'_> {
    /// Checks sizes, values and bounds.
    pub(crate) fn validate(&self) -> Result<(), OptimiseError> {
        if self.views.is_empty() || self.views.iter().all(|view| view.goals.is_empty()) {
            return Err(OptimiseError::NoGoal);
        }
        if self.variables.iter().all(|variable| variable.locks.hold_all(&variable.light.shape)) {
            return Err(OptimiseError::NothingFree);
        }
        for variable in &self.variables {
            if let Some(what) = variable.bounds.fault() {
                return Err(OptimiseError::Bounds { light: variable.light.name.clone(), what });
            }
        }
        self.views.iter().try_for_each(|view| view.validate(&self.variables))
    }

    /// Radiance with which a light alone would make up for what the picture lacks on average.
    pub(crate) fn matching_radiance(
        &self,
        number: usize,
        light: &Light,
        softness: f32,
    ) -> Result<f32, OptimiseError> {
        let (mut needed, mut unit) = (0.0, 0.0);
        for view in &self.views {
            let cells = Cells::new(view.relight.size(), view.relight.cell());
            let judged = spread(cells.count(), JUDGED);
            let values = match view.still.get(number).copied().flatten() {
                Some(image) => {
                    let means = cells.means(image);
                    judged.iter().map(|cell| means[*cell as usize]).collect()
                }
                None => view.relight.values(light, softness, &judged)?,
            };
            unit += mean_luminance(&values);
            needed += view.lacks();
        }
        let radiance = needed / unit;
        Ok(if radiance.is_finite() && radiance > 0.0 { radiance } else { 1.0 })
    }
}

impl View<'_> {
    fn validate(&self, variables: &[Variable]) -> Result<(), OptimiseError> {
        let expected = self.relight.size();
        let check = |what: &'static str, image: &Image| {
            let found = (image.width, image.height);
            if found != expected {
                return Err(OptimiseError::Size { what, found, expected });
            }
            if image.channels != 3 || image.data.is_empty() || !image.data.iter().all(|v| v.is_finite()) {
                return Err(OptimiseError::Picture(what));
            }
            Ok(())
        };
        check("base", self.base)?;
        self.still.iter().flatten().try_for_each(|image| check("picture of a light", image))?;
        for (variable, still) in variables.iter().zip(&self.still) {
            if still.is_some() != variable.locks.hold_shape(&variable.light.shape) {
                return Err(OptimiseError::Still(variable.light.name.clone()));
            }
        }
        if self.still.len() != variables.len() {
            return Err(OptimiseError::Lights { found: self.still.len(), expected: variables.len() });
        }
        for (number, goal) in self.goals.iter().enumerate() {
            if let Criterion::Target { image, .. } = &goal.criterion {
                check("target", image)?;
                if image.data.iter().all(|value| *value <= 0.0) {
                    return Err(OptimiseError::BlackTarget);
                }
            }
            if matches!(goal.criterion, Criterion::Color { color } if luminance(color) <= 0.0) {
                return Err(OptimiseError::BlackColor(number + 1));
            }
            let pixels = self.base.pixel_count();
            let covers = |weights: &Vec<f32>| weights.len() == pixels && weights.iter().any(|w| *w > 0.0);
            if !goal.pixels.as_ref().is_none_or(covers) {
                return Err(OptimiseError::EmptyGoal(number + 1));
            }
        }
        Ok(())
    }

    /// Mean luminance that lights have to add: what a target has over the base, or half of the base without one. Never less
    /// than a hundredth of either, so that there always is a unit.
    fn lacks(&self) -> f32 {
        let mean = |image: &Image| mean_luminance(image.data.as_chunks::<3>().0);
        let base = mean(self.base);
        let targets = self.goals.iter().filter_map(|goal| match &goal.criterion {
            Criterion::Target { image, exposure_invariant: false } => Some(mean(image)),
            _ => None,
        });
        targets.map(|target| (target - base).max(0.01 * target)).reduce(f32::max).unwrap_or(0.5 * base)
    }
}

pub(crate) fn mean_luminance(values: &[[f32; 3]]) -> f32 {
    let sum: f64 = values.iter().map(|value| f64::from(luminance(*value))).sum();
    (sum / values.len().max(1) as f64) as f32
}
