//! Cuts bakes into parts.

use crate::bake;
use crate::error::SessionError;
use crate::farm::PLAN_FILE;
use crate::files::checksum;
use crate::files::scene_file::SceneFile;
use crate::progress::Monitor;
use relume_dump::Manifest;
use relume_image::write_atomically;
use relume_trace::TraceSettings;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::io::Write;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

const FORMAT: &str = "relume-plan";
const VERSION: u32 = 1;
/// Version of Relume, which has to be the same on all machines of a job.
const RELUME: &str = env!("CARGO_PKG_VERSION");
/// Most parts of a job.
pub const MOST_PARTS: usize = 1 << 20;

/// Bakes of a job folder, cut into parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    format: String,
    version: u32,
    /// Version of Relume that made it.
    relume: String,
    /// Parts of each bake.
    parts_per_bake: usize,
    /// Bakes, in the order in which their parts are numbered.
    pub bakes: Vec<PlannedBake>,
    /// Checksum of this file.
    checksum: String,
}

/// A bake of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedBake {
    /// Name of its folder in the job folder.
    pub folder: String,
    /// Identity of its shards ([`Manifest::bake_id`]).
    pub bake_id: String,
    /// Settings that its paths are traced with.
    pub settings: TraceSettings,
}

/// A scene to be baked by a job.
pub struct Shot {
    /// Name of its bake folder.
    pub name: String,
    /// Scene, settings, view.
    pub file: SceneFile,
}

/// Makes a job folder: the bake folder of each shot with all but its paths, and the plan. Shots are asked for one by one,
/// so that one alone is in memory. Bakes of the same scenes that are there go on.
///
/// # Errors
/// If a scene cannot be traced, a folder holds another bake, or names are not of a folder each.
pub fn plan<E: From<SessionError>>(
    job: &Path,
    shots: impl Iterator<Item = Result<Shot, E>>,
    parts_per_bake: usize,
    monitor: &Monitor,
) -> Result<Plan, E> {
    let mut plan = Plan {
        format: FORMAT.into(),
        version: VERSION,
        relume: RELUME.into(),
        parts_per_bake,
        bakes: Vec::new(),
        checksum: String::new(),
    };
    for shot in shots {
        let Shot { name, file } = shot?;
        let settings = TraceSettings { threads: 0, ..file.settings.clone() };
        plan.bakes.push(PlannedBake { folder: name, bake_id: String::new(), settings });
        plan.check().map_err(SessionError::Settings)?;
        if monitor.cancel().requested() {
            return Err(SessionError::Cancelled.into());
        }
        if let Some(bake) = plan.bakes.last_mut() {
            let folder = job.join(&bake.folder);
            bake.bake_id = bake::prepare(&file.scene, &bake.settings, &folder, monitor)?.bake_id();
            file.write_view(&folder)?;
        }
    }
    plan.write(job)?;
    Ok(plan)
}

impl Plan {
    /// Number of parts of the whole job.
    pub fn parts(&self) -> usize {
        self.bakes.len().saturating_mul(self.parts_per_bake)
    }

    /// The part that a shard belongs to, of a bake with so many of them. Shards are numbered pass by pass.
    pub(super) fn part_of(&self, bake: usize, shard: usize, shards: usize) -> usize {
        bake * self.parts_per_bake + ((shard + 1) * self.parts_per_bake - 1) / shards + 1
    }

    /// The bake of a part.
    ///
    /// # Errors
    /// If there is no such part.
    pub(super) fn bake_of(&self, part: usize) -> Result<usize, SessionError> {
        if (1..=self.parts()).contains(&part) {
            return Ok((part - 1) / self.parts_per_bake);
        }
        Err(SessionError::Settings(format!("there is no part {part}: the plan has 1 to {}", self.parts())))
    }

    /// Shards of a part, of a bake with so many of them; there may be none.
    pub(super) fn shards_of_part(&self, part: usize, shards: usize) -> Range<usize> {
        let share = (part - 1) % self.parts_per_bake;
        share * shards / self.parts_per_bake..(share + 1) * shards / self.parts_per_bake
    }

    /// Reads the plan of a job folder, of which nobody vouches for anything; `path` may be the plan itself. Returns the
    /// folder too.
    ///
    /// # Errors
    /// If it is damaged, or was made by another version of Relume.
    pub fn read(path: &Path) -> Result<(Self, PathBuf), SessionError> {
        let path = if path.is_dir() { path.join(PLAN_FILE) } else { path.to_path_buf() };
        let text = std::fs::read_to_string(&path).map_err(SessionError::io("read the plan", &path))?;
        let plan = Self::parse(&text)
            .map_err(|reason| SessionError::Settings(format!("{}: {reason}", path.display())))?;
        let job = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok((plan, job.to_path_buf()))
    }

    fn parse(text: &str) -> Result<Self, String> {
        #[derive(Deserialize)]
        struct Maker {
            format: String,
            version: u32,
            relume: String,
        }
        let broken =
            |error: serde_json::Error| format!("it is no plan of Relume, or damaged ({error}); plan again");
        let maker: Maker = serde_json::from_str(text).map_err(broken)?;
        if maker.format != FORMAT {
            return Err(format!("it is no plan of Relume, but says {:?}", maker.format));
        }
        if (maker.version, maker.relume.as_str()) != (VERSION, RELUME) {
            return Err(format!(
                "the plan was made by Relume {}, and this machine has {RELUME}; install the same version on all \
                 machines, or plan again",
                maker.relume
            ));
        }
        let plan: Self = serde_json::from_str(text).map_err(broken)?;
        checksum::check_own(text, &plan.checksum).and_then(|()| plan.check())?;
        Ok(plan)
    }

    /// Refuses values that no plan can have. Folders are names: nothing is read or written outside of the job's.
    fn check(&self) -> Result<(), String> {
        if self.parts_per_bake == 0 || self.parts() > MOST_PARTS {
            return Err(format!("a job has 1 to {MOST_PARTS} parts"));
        }
        let mut names = HashSet::new();
        for PlannedBake { folder, .. } in &self.bakes {
            let mut parts = Path::new(folder).components();
            let is_name = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
            if !is_name || folder.contains(['/', '\\', ':']) || folder == PLAN_FILE {
                return Err(format!("{folder:?} is no name of a bake folder"));
            }
            if !names.insert(folder.to_lowercase()) {
                return Err(format!("two bakes have the folder {folder:?}; rename a scene file"));
            }
        }
        Ok(())
    }

    fn write(&self, job: &Path) -> Result<(), SessionError> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| SessionError::Settings(format!("the plan cannot be written: {error}")))?;
        let text = checksum::with_own(&text);
        Ok(write_atomically(&job.join(PLAN_FILE), |writer| writer.write_all(text.as_bytes()))?)
    }
}

impl PlannedBake {
    /// Reads the manifest of this bake in a job folder.
    ///
    /// # Errors
    /// If it cannot be read, or is of another bake or number of samples.
    pub(super) fn manifest(&self, job: &Path) -> Result<Manifest, SessionError> {
        let folder = job.join(&self.folder);
        let manifest = Manifest::read(&folder)?;
        let is_planned = manifest.bake_id() == self.bake_id && manifest.samples() == self.settings.samples;
        match is_planned {
            true => Ok(manifest),
            false => Err(SessionError::Settings(format!(
                "{} holds another bake than the one that was planned; plan again",
                folder.display()
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(folders: &[&str], parts_per_bake: usize) -> Plan {
        let bake = |folder: &&str| PlannedBake {
            folder: folder.to_string(),
            bake_id: String::new(),
            settings: TraceSettings::default(),
        };
        Plan {
            format: FORMAT.into(),
            version: VERSION,
            relume: RELUME.into(),
            parts_per_bake,
            bakes: folders.iter().map(bake).collect(),
            checksum: String::new(),
        }
    }

    #[test]
    fn each_shard_is_in_one_part_and_parts_are_of_a_size() {
        for (parts, shards) in [(1, 1), (3, 10), (8, 8), (5, 3), (7, 1000)] {
            let plan = example(&["a", "b"], parts);
            let ranges: Vec<_> = (1..=parts).map(|part| plan.shards_of_part(part, shards)).collect();
            assert_eq!(ranges.iter().cloned().flatten().collect::<Vec<_>>(), (0..shards).collect::<Vec<_>>());
            let sizes: Vec<usize> = ranges.iter().map(Range::len).collect();
            assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1, "{sizes:?}");
            for shard in 0..shards {
                let part = plan.part_of(1, shard, shards);
                assert_eq!(plan.bake_of(part).unwrap(), 1);
                assert!(plan.shards_of_part(part, shards).contains(&shard));
            }
        }
        assert!(example(&["a"], 3).bake_of(4).is_err() && example(&["a"], 3).bake_of(0).is_err());
    }

    #[test]
    fn a_plan_that_leads_out_of_its_folder_or_was_altered_is_refused() {
        for (folders, words) in [
            (&["../a"][..], "no name"),
            (&["/a"], "no name"),
            (&["c:a"], "no name"),
            (&[".."], "no name"),
            (&[""], "no name"),
            (&["plan.json"], "no name"),
            (&["shot", "Shot"], "two bakes"),
        ] {
            let text = checksum::with_own(&serde_json::to_string_pretty(&example(folders, 2)).unwrap());
            let reason = Plan::parse(&text).unwrap_err();
            assert!(reason.contains(words), "{folders:?}: {reason}");
        }
        let text = checksum::with_own(&serde_json::to_string_pretty(&example(&["0001"], 2)).unwrap());
        assert_eq!(Plan::parse(&text).unwrap().parts(), 2);
        let altered = text.replace("\"parts_per_bake\": 2", "\"parts_per_bake\": 3");
        assert!(Plan::parse(&altered).unwrap_err().contains("checksum"));
        let many = text.replace("\"parts_per_bake\": 2", "\"parts_per_bake\": 99999999999");
        assert!(Plan::parse(&many).is_err());
        let older = text.replace(RELUME, "0.0.9");
        let reason = Plan::parse(&older).unwrap_err();
        assert!(reason.contains("Relume 0.0.9") && reason.contains(RELUME), "{reason}");
    }
}
