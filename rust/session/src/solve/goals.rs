use relume_image::{Image, read_picture};
use relume_optimise::{Criterion, Goal};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::request::{GoalKind, GoalRegion, GoalRequest};
use crate::error::SessionError;

/// Pictures that a request refers to: by name, or by a path relative to a folder.
#[derive(Clone, Debug, Default)]
pub struct Pictures {
    named: HashMap<String, Image>,
    folder: Option<PathBuf>,
}

/// Stops that a shadow is darker by, where the request does not say.
const SHADOW: f32 = 1.5;
const STOPS: f32 = 1.0;
const MIREDS: f32 = 60.0;
/// Weight of a place that is to stay as it is. It may change by a fiftieth, which is little in the measure of other
/// goals. It also has to outweigh that strokes tacitly ask for no other colour or brightness.
const KEPT: f32 = 10.0;

impl Pictures {
    /// Pictures in memory.
    pub fn named(named: HashMap<String, Image>) -> Self {
        Self { named, folder: None }
    }

    /// Pictures in files, relative to this folder.
    pub fn in_folder(folder: &Path) -> Self {
        Self { named: HashMap::new(), folder: Some(folder.to_path_buf()) }
    }

    fn get(&self, name: &str) -> Result<Image, SessionError> {
        match (self.named.get(name), &self.folder) {
            (Some(image), _) => Ok(image.clone()),
            (None, Some(folder)) => Ok(read_picture(&folder.join(name))?),
            (None, None) => {
                Err(SessionError::Settings(format!("there is no picture of the name '{name}'; hand it over")))
            }
        }
    }
}

/// The goals of one view of this size.
pub(super) fn goals(
    requests: &[GoalRequest],
    view: usize,
    size: (usize, usize),
    keep_rest: f32,
    pictures: &Pictures,
) -> Result<Vec<Goal>, SessionError> {
    let in_view = requests.iter().enumerate().filter(|(_, request)| request.view == view);
    let mut goals = Vec::new();
    for (i, request) in in_view {
        let fail = |error: SessionError| SessionError::Settings(format!("goal {}: {error}", i + 1));
        let pixels = request
            .region
            .as_ref()
            .map(|region| weights(region, size, pictures))
            .transpose()
            .map_err(fail)?;
        let criterion = criterion(request, size, pictures).map_err(fail)?;
        let weight = if request.goal == GoalKind::Keep { KEPT * request.weight } else { request.weight };
        goals.push(Goal { criterion, pixels, weight });
    }
    if keep_rest > 0.0 {
        goals.extend(rest(&goals, size, keep_rest));
    }
    Ok(goals)
}

fn criterion(
    request: &GoalRequest,
    size: (usize, usize),
    pictures: &Pictures,
) -> Result<Criterion, SessionError> {
    let stops = request.stops.unwrap_or(if request.goal == GoalKind::Shadow { SHADOW } else { STOPS });
    let mireds = request.mireds.unwrap_or(MIREDS);
    Ok(match request.goal {
        GoalKind::Target => Criterion::Target {
            image: fitted("the target", pictures.get(request.image.as_deref().unwrap_or_default())?, size)?,
            exposure_invariant: request.exposure_invariant,
        },
        GoalKind::Brighter => Criterion::Brightness { stops },
        GoalKind::Darker | GoalKind::Shadow => Criterion::Brightness { stops: -stops },
        GoalKind::Color => Criterion::Color { color: request.color.unwrap_or([1.0; 3]) },
        GoalKind::Warmer => Criterion::Temperature { mireds },
        GoalKind::Cooler => Criterion::Temperature { mireds: -mireds },
        GoalKind::Keep => Criterion::Keep,
    })
}

/// A picture of another resolution but the same aspect is scaled by the mean of what falls on a pixel.
fn fitted(what: &str, image: Image, (width, height): (usize, usize)) -> Result<Image, SessionError> {
    let image = if image.channels == 3 { image } else { rgb(&image) };
    if (image.width, image.height) == (width, height) {
        return Ok(image);
    }
    let (given, expected) = (image.width as f32 / image.height as f32, width as f32 / height as f32);
    // A pixel more or less along an edge is rounding.
    let rounding = 1.0 / image.height.min(height) as f32 + 1.0 / image.width.min(width) as f32;
    let is_alike = (given / expected - 1.0).abs() <= rounding;
    if !is_alike {
        return Err(SessionError::Settings(format!(
            "{what} is {} x {} pixels, the bake {width} x {height}; crop it to the same aspect",
            image.width, image.height
        )));
    }
    Ok(image.resized(width, height))
}

fn rgb(image: &Image) -> Image {
    let channel = |pixel: &[f32], c: usize| pixel[if image.channels > 2 { c } else { 0 }];
    let data =
        image.data.chunks_exact(image.channels).flat_map(|p| [channel(p, 0), channel(p, 1), channel(p, 2)]);
    Image { width: image.width, height: image.height, channels: 3, data: data.collect() }
}

fn weights(region: &GoalRegion, size: (usize, usize), pictures: &Pictures) -> Result<Vec<f32>, SessionError> {
    let mask = match &region.mask {
        Some(name) => {
            let mut mask = pictures.get(name)?;
            if !mask.data.iter().all(|value| value.is_finite()) {
                return Err(SessionError::Settings(format!(
                    "the mask '{name}' holds values that are infinite or no numbers; render or save it anew"
                )));
            }
            if let Some(value) = region.equals {
                // Before it is scaled: the mean of two indices is the index of something else.
                let is_part = |pixel: &mut f32| *pixel = f32::from((*pixel - value).abs() < 0.5);
                mask.data.iter_mut().for_each(is_part);
            }
            Some(
                fitted(&format!("the mask '{name}'"), mask, size)?
                    .data
                    .chunks_exact(3)
                    .map(|pixel| pixel[0])
                    .collect::<Vec<f32>>(),
            )
        }
        None => None,
    };
    Ok(region.drawn.weights(size, mask.as_deref()))
}

/// Goal to keep all that no goal speaks of; none if one speaks of all.
fn rest(goals: &[Goal], (width, height): (usize, usize), weight: f32) -> Option<Goal> {
    let mut free = vec![1.0; width * height];
    for goal in goals {
        let pixels = goal.pixels.as_ref()?;
        free.iter_mut().zip(pixels).for_each(|(free, taken)| *free = f32::min(*free, 1.0 - taken));
    }
    let any = free.iter().any(|weight| *weight > 0.0);
    any.then_some(Goal { criterion: Criterion::Keep, pixels: Some(free), weight })
}
