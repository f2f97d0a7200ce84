//! Settings of path tracing. Defaults are those of a new Blender file.

use relume_dump::{Lobe, Pass};
use relume_scene::Light;

use crate::bsdf::{BsdfSample, Caustics};
use crate::filter::PixelFilter;

/// Largest [`TraceSettings::guiding`]: above, lights that were moved would be too noisy.
pub const MOST_GUIDING: f32 = 0.9;

/// All settings of a bake.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TraceSettings {
    /// Paths per pixel.
    pub samples: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Edge of the square tiles, pixels.
    pub tile_size: usize,
    /// Division of the samples into passes over the image.
    pub passes: PassSchedule,
    /// Worker threads; 0 for those of the pool that traces, outside of any one a core. Does not change the result.
    pub threads: usize,
    /// Share of the directions that are guided to where the file's lights stand, 0 for none, at most [`MOST_GUIDING`]. Changes only
    /// the noise, never what is expected: less for lights near there, at each bounce up to `1 / (1 - guiding)` of the variance elsewhere.
    pub guiding: f32,
    /// Lights that paths are guided to besides those of the file.
    #[serde(rename = "towards")]
    pub guide_targets: Vec<Light>,
    /// The world's colour in place of the scene's, for what is to fit a bake that was begun under another one.
    pub world_color: Option<[f32; 3]>,
    /// Settings of the paths; everything that changes the dump but for the samples.
    pub paths: PathSettings,
}

impl Default for TraceSettings {
    fn default() -> Self {
        Self {
            samples: 1024,
            seed: 0,
            tile_size: 64,
            passes: PassSchedule::default(),
            threads: 0,
            guiding: 0.25,
            guide_targets: Vec::new(),
            world_color: None,
            paths: PathSettings::default(),
        }
    }
}

/// Settings of a single path.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PathSettings {
    /// Bounce limits.
    pub bounces: BounceLimits,
    /// Blender's Filter Glossy; 0 for none.
    pub filter_glossy: f32,
    /// True if glossy reflection is seen by diffuse rays, reflected or transmitted.
    pub caustics_reflective: bool,
    /// True if refraction is seen by diffuse rays, reflected or transmitted.
    pub caustics_refractive: bool,
    /// Pixel filter.
    pub filter: PixelFilter,
    /// Factor of all light that reaches the film (Cycles' Film > Exposure), at least 0.
    pub film_exposure: f32,
    /// True if alpha is 0 where nothing but the world is behind the film (Cycles' Film > Transparent). Only holdouts open it else.
    #[serde(skip_serializing_if = "is_false")]
    pub film_transparent: bool,
    /// Roughness up to which a transparent film shows through glass; none where glass covers it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film_glass: Option<f32>,
    /// Cycles' Fast GI Approximation; none where every bounce is traced.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fast_gi: Option<FastGi>,
    /// True if the scene's own emitters and the world are also sampled directly. Changes only the noise of the static
    /// layers, never a path.
    pub sample_static_lights: bool,
}

impl PathSettings {
    /// Closures that diffuse rays see of the surfaces they hit.
    pub(crate) fn caustics(&self) -> Caustics {
        Caustics { reflective: self.caustics_reflective, refractive: self.caustics_refractive }
    }

    /// True if Fast GI cuts rays of paths.
    pub(crate) fn cuts_rays(&self) -> bool {
        matches!(self.fast_gi, Some(FastGi::Replace { .. }))
    }

    /// True if Fast GI lights surfaces.
    pub(crate) fn adds_light(&self) -> bool {
        matches!(self.fast_gi, Some(FastGi::Add { .. }))
    }

    /// True if the film shows through some glass.
    pub(crate) fn shows_through_glass(&self) -> bool {
        self.film_transparent && self.film_glass.is_some()
    }

    /// True if what the film shows behind a sample is its background as long as nothing is met there.
    pub(crate) fn shows_through(&self, sample: &BsdfSample) -> bool {
        let limit = self.film_glass.filter(|_| self.film_transparent);
        limit.is_some_and(|roughness| {
            // In the order of Cycles' factors, so that glass of the very roughness counts.
            let limit = (roughness * roughness) * (roughness * roughness);
            sample.lobe == Lobe::Transmission && !sample.diffuse && sample.alpha_squared <= limit
        })
    }
}

impl Default for PathSettings {
    fn default() -> Self {
        Self {
            bounces: BounceLimits::default(),
            filter_glossy: 1.0,
            caustics_reflective: true,
            caustics_refractive: true,
            filter: PixelFilter::default(),
            film_exposure: 1.0,
            film_transparent: false,
            film_glass: None,
            fast_gi: None,
            sample_static_lights: true,
        }
    }
}

/// Cycles' Fast GI Approximation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "method", rename_all = "snake_case", deny_unknown_fields)]
pub enum FastGi {
    /// After some bounces rays are cut: what they meet only emits and lets through, and where they meet nothing there is the world.
    Replace {
        /// Bounces before, at least 1 (Cycles' Render Bounces). Transmission and the first glossy one do not count.
        bounces: u32,
        /// Reach of these rays, metres, where the object that they leave has none of its own.
        distance: f32,
        /// Factor of the world that they meet.
        factor: f32,
    },
    /// Diffuse surfaces are lit besides by white light from all sides, as far as nothing nearby blocks it.
    Add {
        /// Distance up to which objects block it, metres.
        distance: f32,
        /// Radiance of that light.
        factor: f32,
    },
}

/// Blender's Light Paths panel, with its meaning: 0 bounces is direct light only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BounceLimits {
    /// All kinds but transparent.
    pub total: u32,
    /// Diffuse reflection.
    pub diffuse: u32,
    /// Glossy reflection.
    pub glossy: u32,
    /// Transmission.
    pub transmission: u32,
    /// Scattering in media; 0 is once.
    #[serde(skip_serializing_if = "is_zero")]
    pub volume: u32,
    /// Transparent surfaces that a path goes straight through and still sees lights behind.
    pub transparent: u32,
    /// Number of further transparent surfaces that a path goes through to what the scene itself emits, and to what
    /// mirrors and the camera see.
    pub more_transparent: u32,
    /// Bounces before Russian roulette may end a path.
    pub min_total: u32,
    /// Transparent surfaces before Russian roulette may end a path.
    pub min_transparent: u32,
}

fn is_zero(value: &u32) -> bool {
    *value == 0
}

fn is_false(value: &bool) -> bool {
    !*value
}

impl Default for BounceLimits {
    fn default() -> Self {
        Self {
            total: 12,
            diffuse: 4,
            glossy: 4,
            transmission: 12,
            volume: 0,
            transparent: 8,
            more_transparent: 0,
            min_total: 0,
            min_transparent: 0,
        }
    }
}

/// Passes of growing size: a first picture at once, few files later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PassSchedule {
    /// Samples of the first pass; each later one has as many as all before it together.
    pub first: u32,
    /// Most samples of a pass; bounds the memory of an open tile.
    pub largest: u32,
}

impl Default for PassSchedule {
    fn default() -> Self {
        Self { first: 1, largest: 64 }
    }
}

impl PassSchedule {
    /// The passes that make up `samples`. Passes start at multiples of their size, so that each is stratified.
    pub fn passes(&self, samples: u32) -> Vec<Pass> {
        let largest = self.largest.max(1);
        let mut passes = Vec::new();
        let mut first_sample = 0;
        while first_sample < samples {
            let wanted = if first_sample == 0 { self.first.max(1) } else { first_sample };
            let count = wanted.min(largest).min(samples - first_sample);
            passes.push(Pass { first_sample, samples: count });
            first_sample += count;
        }
        passes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_double_up_to_the_largest_and_cover_all_samples() {
        let sizes = |samples, first, largest| -> Vec<u32> {
            PassSchedule { first, largest }.passes(samples).iter().map(|pass| pass.samples).collect()
        };
        assert_eq!(sizes(100, 1, 16), [1, 1, 2, 4, 8, 16, 16, 16, 16, 16, 4]);
        assert_eq!(sizes(5, 8, 16), [5]);
        assert_eq!(sizes(3, 0, 0), [1, 1, 1]);
        assert!(sizes(0, 1, 16).is_empty());
        let passes = PassSchedule::default().passes(1000);
        assert!(passes.windows(2).all(|pair| pair[0].first_sample + pair[0].samples == pair[1].first_sample));
    }

    #[test]
    fn unknown_settings_are_refused_and_missing_ones_are_blenders() {
        let settings: TraceSettings = serde_json::from_str(r#"{"samples": 7}"#).unwrap();
        assert_eq!(settings, TraceSettings { samples: 7, ..TraceSettings::default() });
        assert!(serde_json::from_str::<TraceSettings>(r#"{"sample": 7}"#).is_err());
    }
}
