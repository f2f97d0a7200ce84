//! Lights that the paths of a bake are guided towards, and how often they meet others.

use crate::bake::features::seen_points;
use crate::error::SessionError;
use crate::files::contents;
use crate::files::light_set::LightSet;
use crate::files::names::GUIDED_FILE;
use glam::Vec3;
use relume_dump::{Aovs, Manifest};
use relume_scene::{Camera, Light, LightShape};
use relume_trace::{Guide, TraceSettings, hit_probability, reaches_beyond};
use serde::Serialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Lights that the paths of a bake are guided towards, by pass.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GuidingRecord {
    /// Share of the directions ([`relume_trace::TraceSettings::guiding`]).
    guiding: f32,
    /// Changes of the lights, in the order of the passes.
    since: Vec<Since>,
}

/// Lights that paths are guided towards, from one pass on.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Since {
    pass: usize,
    lights: LightSet,
}

impl GuidingRecord {
    /// Reads a bake's record; an empty one if the folder holds none.
    ///
    /// # Errors
    /// [`SessionError::Lights`] names the file and what is wrong in it.
    pub fn of_bake(folder: &Path) -> Result<Self, SessionError> {
        let path = folder.join(GUIDED_FILE);
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = std::fs::read_to_string(&path).map_err(SessionError::io("read", &path))?;
        Self::parse(&text).map_err(|reason| SessionError::Lights { path, reason })
    }

    fn parse(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let guiding = value["guiding"].as_f64().filter(|share| (0.0..1.0).contains(share));
        let guiding = guiding.ok_or("\"guiding\" must be a share from 0 to below 1")? as f32;
        let since = |entry: &Value| {
            let pass = entry["pass"].as_u64().ok_or("\"pass\" must be the number of a pass")?;
            Ok(Since { pass: pass as usize, lights: LightSet::from_json(entry["lights"].clone())? })
        };
        let entries = value["since"].as_array().ok_or("\"since\" must be a list")?;
        let since = entries.iter().map(since).collect::<Result<_, String>>()?;
        Ok(Self { guiding, since })
    }

    pub(crate) fn write(&self, folder: &Path) -> Result<(), SessionError> {
        let path = folder.join(GUIDED_FILE);
        relume_image::write_atomically(&path, |writer| {
            serde_json::to_writer(&mut *writer, self)?;
            writer.write_all(b"\n")
        })?;
        contents::note(&path)
    }

    /// Notes the lights that a pass is guided towards, with a share of its directions. False if they are those of the
    /// pass before.
    pub(crate) fn note(&mut self, pass: usize, lights: &[Light], guiding: f32) -> bool {
        let same = |last: &Since| last.pass <= pass && last.lights.lights == lights;
        if self.guiding == guiding && self.since.last().is_some_and(same) {
            return false;
        }
        self.guiding = guiding;
        self.since.retain(|entry| entry.pass < pass);
        let lights = LightSet { lights: lights.to_vec(), ..LightSet::default() };
        self.since.push(Since { pass, lights });
        true
    }

    fn lights(&self, pass: usize) -> &[Light] {
        let entry = self.since.iter().rev().find(|entry| entry.pass <= pass);
        entry.map_or(&[], |entry| &entry.lights.lights)
    }
}

/// Points that stand for all that is seen.
const POINTS: usize = 64;
/// Paths of a lit pixel that find a light, below which denoising leaves blotches (and darkens, at a tenth of this).
const LEAST_HITS: f32 = 0.1;
/// A bake of fewer paths is taken for one that goes on to these.
const FEWEST_SAMPLES: u32 = 64;
/// Times that a light is met by new paths for one of the present ones, from which on they are worth their time.
const WORTH_NEW_PATHS: f32 = 2.0;
/// Paths of a lit pixel that find a light, from which on its noise is not that of finding it.
const ENOUGH_HITS: f32 = 8.0;

/// Coverage of lights by the paths of a bake.
pub(crate) struct GuideCoverage {
    /// Number of paths in each group of passes, and their guide.
    guides: Vec<(u32, Option<Guide>)>,
    /// Lights that the latest passes are guided towards.
    lights: Vec<Light>,
    points: Vec<Vec3>,
    guiding: f32,
    /// [`Manifest::recorded`].
    recorded: Option<[[f32; 3]; 2]>,
    /// Answers about recent shapes, newest first.
    known: Mutex<VecDeque<(LightShape, Option<UnderSampled>)>>,
}

impl GuideCoverage {
    /// Builds it from the points that a camera sees.
    pub fn new(guiding_record: &GuidingRecord, manifest: &Manifest, aovs: &Aovs, camera: &Camera) -> Self {
        let mut guides = Vec::<(u32, Option<Guide>)>::new();
        let mut before: Option<&[Light]> = None;
        for (number, pass) in manifest.passes.iter().enumerate() {
            let lights = guiding_record.lights(number);
            match guides.last_mut().filter(|_| before == Some(lights)) {
                Some((samples, _)) => *samples += pass.samples,
                None => guides.push((pass.samples, Guide::new(lights, guiding_record.guiding))),
            }
            before = Some(lights);
        }
        let lights = before.unwrap_or_default().to_vec();
        Self {
            guides,
            lights,
            points: seen_points(aovs, camera, POINTS),
            guiding: guiding_record.guiding,
            recorded: manifest.recorded,
            known: Mutex::default(),
        }
    }

    fn samples(&self) -> u32 {
        self.guides.iter().map(|(samples, _)| samples).sum()
    }

    /// Paths of a pixel whose first bounce meets a light, in the median over visible points that it shines on. None if
    /// it shines on none.
    fn hits(&self, light: &Light) -> Option<f32> {
        self.median(light, |point| {
            let chance = |guide: &Option<Guide>| hit_probability(guide.as_ref(), point, light);
            self.guides.iter().map(|(samples, guide)| Some(*samples as f32 * chance(guide)?)).sum()
        })
    }

    /// [`Self::hits`] if all paths were guided towards these lights.
    fn hits_with(&self, lights: &[Light], light: &Light, guiding: f32) -> Option<f32> {
        let guide = Guide::new(lights, guiding);
        let samples = self.samples() as f32;
        self.median(light, |point| Some(samples * hit_probability(guide.as_ref(), point, light)?))
    }

    fn median(&self, light: &Light, hits: impl Fn(Vec3) -> Option<f32>) -> Option<f32> {
        if light.radiance == [0.0; 3] {
            return None;
        }
        let mut all: Vec<f32> = self.points.iter().filter_map(|point| hits(*point)).collect();
        let middle = all.len() / 2;
        let to_come = (FEWEST_SAMPLES as f32 / self.samples() as f32).max(1.0);
        (!all.is_empty()).then(|| to_come * *all.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// True if paths guided towards these lights, with this share of their directions, would have much less noise.
    pub fn would_gain(&self, lights: &[Light], guiding: f32) -> bool {
        lights.iter().any(|light| {
            if self.is_beyond_fog(light) {
                return true;
            }
            let hits = self.hits(light).filter(|hits| *hits < ENOUGH_HITS);
            let new = self.hits_with(lights, light, guiding);
            hits.zip(new).is_some_and(|(hits, new)| new > WORTH_NEW_PATHS * hits)
        })
    }

    /// Light that is met by too few paths for a picture; none if there are enough. Kept, since a drag asks again for each
    /// picture.
    pub fn under_sampled(&self, light: &Light) -> Option<UnderSampled> {
        const KEPT: usize = 256;
        if light.radiance == [0.0; 3] {
            return None;
        }
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, answer)) = known().iter().find(|(shape, _)| *shape == light.shape) {
            return *answer;
        }
        let answer = self.find_under_sampled(light);
        let mut known = known();
        known.push_front((light.shape, answer));
        known.truncate(KEPT);
        answer
    }

    /// True if part of a light is farther away than paths were recorded in fog that fills all space.
    fn is_beyond_fog(&self, light: &Light) -> bool {
        light.radiance != [0.0; 3]
            && self.recorded.is_some_and(|recorded| reaches_beyond(&light.shape, recorded))
    }

    fn find_under_sampled(&self, light: &Light) -> Option<UnderSampled> {
        let samples = self.samples().max(FEWEST_SAMPLES);
        if self.is_beyond_fog(light) {
            return Some(UnderSampled { hits: 0.0, is_beyond_fog: true, guiding_helps: true, samples });
        }
        let hits = self.hits(light).filter(|hits| *hits < LEAST_HITS)?;
        let guiding = if self.guiding > 0.0 { self.guiding } else { TraceSettings::default().guiding };
        // Other lights have their shares of the directions as well.
        let others = self.lights.iter().filter(|other| other.shape != light.shape).cloned();
        let lights: Vec<Light> = others.chain([light.clone()]).collect();
        let hits_of_new = self.hits_with(&lights, light, guiding);
        let guiding_helps = hits_of_new.is_some_and(|hits| hits >= LEAST_HITS);
        Some(UnderSampled { hits, is_beyond_fog: false, guiding_helps, samples })
    }
}

/// Light that hardly any path meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct UnderSampled {
    /// Paths of a lit pixel that meet it.
    hits: f32,
    /// True if it is farther away than fog was recorded.
    is_beyond_fog: bool,
    /// True if new paths would meet it when guided towards it.
    pub guiding_helps: bool,
    samples: u32,
}

impl UnderSampled {
    /// Warning for the user.
    pub fn warning(&self, light: &Light) -> String {
        if self.is_beyond_fog {
            let advice = "bake again (Rebake), and it is recorded as far as there";
            return format!(
                "light '{}' is farther away than the world's fog was baked and is missing; {advice}",
                light.name
            );
        }
        let advice = match light.shape {
            _ if self.guiding_helps => "bake again (Rebake), and paths look for it there".to_string(),
            LightShape::Sun { .. } => {
                let wide_enough = 2.0 * (LEAST_HITS / self.samples as f32).sqrt().to_degrees();
                format!("widen it to {wide_enough:.1} degrees, or bake more samples")
            }
            _ => "make it larger, or bake more samples".to_string(),
        };
        let pixels = (1.0 / self.hits).ceil();
        // As many as no picture has say nothing.
        let found = if pixels < 1e7 { format!("one path in {pixels:.0} pixels") } else { "no path".into() };
        format!("light '{}': its direct light is found by {found} and will be noise; {advice}", light.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Affine3A;
    use relume_dump::{FORMAT_VERSION, Pass};
    use relume_image::Image;

    fn lamp(x: f32, radius: f32) -> Light {
        Light {
            name: format!("lamp {x}"),
            ..Light::unit(LightShape::Sphere { center: Vec3::new(x, 0.0, -2.0), radius })
        }
    }

    #[test]
    fn lights_beyond_the_fog_that_was_recorded_are_named_however_large_they_are() {
        let fog = Some([[-3.0; 3], [3.0; 3]]);
        let coverage = GuideCoverage { recorded: fog, ..coverage(&GuidingRecord::default()) };
        let (near, far) = (lamp(0.0, 0.5), lamp(5.0, 1.0));
        assert!(coverage.under_sampled(&near).is_none() && !coverage.would_gain(&[near], 0.0));
        let beyond = coverage.under_sampled(&far).unwrap();
        let words =
            "light 'lamp 5' is farther away than the world's fog was baked and is missing; bake again";
        assert!(beyond.guiding_helps && beyond.warning(&far).starts_with(words), "{}", beyond.warning(&far));
        assert!(coverage.would_gain(std::slice::from_ref(&far), 0.0));
        assert!(coverage.under_sampled(&Light { radiance: [0.0; 3], ..far }).is_none());
    }

    /// A wall 4 m in front of a camera, in passes of 16 and 48 paths.
    fn coverage(guiding_record: &GuidingRecord) -> GuideCoverage {
        let camera = Camera {
            world_from_camera: Affine3A::IDENTITY,
            width: 16,
            height: 16,
            window_min: glam::Vec2::splat(-0.5),
            window_max: glam::Vec2::splat(0.5),
            ..Camera::default()
        };
        let image = |channels, value: f32| Image {
            data: vec![value; 256 * channels],
            ..Image::new(16, 16, channels)
        };
        let aovs = Aovs {
            albedo: image(3, 0.5),
            normal: image(3, 0.5),
            depth: image(1, 4.0),
            emission: image(3, 0.0),
            world: image(3, 0.0),
            alpha: image(1, 1.0),
        };
        let passes = vec![Pass { first_sample: 0, samples: 16 }, Pass { first_sample: 16, samples: 48 }];
        let manifest = Manifest {
            format_version: FORMAT_VERSION,
            scene_hash: String::new(),
            width: 16,
            height: 16,
            tile_size: 16,
            passes,
            seed: 0,
            camera: Value::Null,
            camera_position: None,
            receivers: Vec::new(),
            classes: None,
            settings: Value::Null,
            working_space: String::new(),
            world_color: [1.0; 3],
            world_map: String::new(),
            recorded: None,
        };
        GuideCoverage::new(guiding_record, &manifest, &aovs, &camera)
    }

    #[test]
    fn each_pass_counts_with_what_it_looks_for() {
        let light = lamp(0.5, 0.01);
        let hits = |passes: &[(usize, &[Light])]| {
            let mut guiding_record = GuidingRecord::default();
            passes.iter().for_each(|(pass, lights)| assert!(guiding_record.note(*pass, lights, 0.5)));
            coverage(&guiding_record).hits(&light).unwrap()
        };
        let all = hits(&[(0, std::slice::from_ref(&light))]);
        let none = hits(&[(0, &[])]);
        let late = hits(&[(0, &[]), (1, std::slice::from_ref(&light))]);
        assert!(all > 100.0 * none);
        assert!((late - (0.25 * none + 0.75 * all)).abs() < 0.02 * all, "{late} of {all}");
        assert!(coverage(&GuidingRecord::default()).hits(&light).unwrap() == none);
    }

    #[test]
    fn lights_that_nothing_looks_for_are_named_with_what_helps() {
        let mut guiding_record = GuidingRecord::default();
        guiding_record.note(0, &[lamp(0.5, 0.01)], 0.25);
        let coverage = coverage(&guiding_record);
        assert!(
            coverage.under_sampled(&lamp(0.5, 0.01)).is_none()
                && coverage.under_sampled(&lamp(-0.8, 0.5)).is_none()
        );
        let moved = lamp(-0.8, 0.01);
        let under_sampled = coverage.under_sampled(&moved).unwrap();
        let warning = under_sampled.warning(&moved);
        assert!(
            warning.starts_with("light 'lamp -0.8': its direct light is found by one path in"),
            "{warning}"
        );
        assert!(
            warning.ends_with("bake again (Rebake), and paths look for it there")
                && under_sampled.guiding_helps
        );
        let dust = lamp(-0.8, 1e-5);
        assert!(
            coverage
                .under_sampled(&dust)
                .unwrap()
                .warning(&dust)
                .ends_with("make it larger, or bake more samples")
        );
        let nothing = lamp(-0.8, 1e-12);
        assert!(coverage.under_sampled(&nothing).unwrap().warning(&nothing).contains("found by no path and"));
        assert!(coverage.under_sampled(&Light { radiance: [0.0; 3], ..moved.clone() }).is_none());
        assert!(coverage.would_gain(&[moved], 0.25) && !coverage.would_gain(&[lamp(0.5, 0.01)], 0.25));
        assert!(!coverage.would_gain(&[lamp(-0.8, 1.0)], 0.25));
    }

    #[test]
    fn new_paths_are_no_advice_where_others_outshine_a_light() {
        let dim = Light { radiance: [1e-10; 3], ..lamp(0.5, 0.01) };
        let under_sampled = |lights: &[Light]| {
            let mut guiding_record = GuidingRecord::default();
            guiding_record.note(0, lights, 0.25);
            coverage(&guiding_record).under_sampled(&dim)
        };
        assert!(under_sampled(std::slice::from_ref(&dim)).is_none());
        assert!(under_sampled(&[]).unwrap().guiding_helps);
        let outshone = under_sampled(&[dim.clone(), lamp(-0.8, 1.0)]).unwrap();
        assert!(
            !outshone.guiding_helps
                && outshone.warning(&dim).ends_with("make it larger, or bake more samples")
        );
    }

    #[test]
    fn records_are_kept_and_their_faults_are_named() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(GuidingRecord::of_bake(folder.path()).unwrap(), GuidingRecord::default());
        let mut guiding_record = GuidingRecord::default();
        assert!(guiding_record.note(0, &[lamp(0.0, 0.1)], 0.25));
        assert!(!guiding_record.note(1, &[lamp(0.0, 0.1)], 0.25));
        assert!(guiding_record.note(2, &[lamp(1.0, 0.1)], 0.25));
        assert_eq!(
            (guiding_record.lights(1), guiding_record.lights(7)),
            (&[lamp(0.0, 0.1)][..], &[lamp(1.0, 0.1)][..])
        );
        guiding_record.write(folder.path()).unwrap();
        assert_eq!(GuidingRecord::of_bake(folder.path()).unwrap(), guiding_record);
        for (text, fault) in [
            ("{", "EOF"),
            ("{\"guiding\": 7, \"since\": []}", "guiding"),
            ("{\"guiding\": 0.2, \"since\": [{\"pass\": -1, \"lights\": []}]}", "pass"),
            ("{\"guiding\": 0.2, \"since\": [{\"pass\": 0, \"lights\": 5}]}", ""),
        ] {
            std::fs::write(folder.path().join(GUIDED_FILE), text).unwrap();
            let error = GuidingRecord::of_bake(folder.path()).unwrap_err().to_string();
            assert!(error.contains(GUIDED_FILE) && error.contains(fault), "{error}");
        }
    }
}
