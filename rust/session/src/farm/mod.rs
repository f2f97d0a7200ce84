//! Bakes on many machines: a job folder holds a plan and, beside it, the bake folder of each scene.
//!
//! ```text
//! job/plan.json     Plan: parts, and of each bake its folder, identity and settings
//! job/0001/         a bake folder without paths, made by plan(); one a scene file, of its name
//! job/0002/
//! ```
//!
//! A part is a run of tiles and passes of one bake, pass by pass: parts that are done first make a whole picture of few
//! samples. Parts are numbered from 1 over all bakes. Workers write shards and nothing else, so any number of them may
//! share the folder, and the bytes are those of one machine.

mod collect;
mod plan;
mod work;

pub use collect::{CollectedBake, collect};
pub use plan::{MOST_PARTS, Plan, PlannedBake, Shot, plan};
pub use work::{WorkReport, work};

/// File of the plan in its job folder.
pub const PLAN_FILE: &str = "plan.json";
