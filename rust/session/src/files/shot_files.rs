//! Files that the add-on writes beside a bake. It alone uses them; here they are only checked.

use crate::files::checksum;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

type Fingerprint = BTreeMap<String, String>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "read to be checked")]
struct ShotRecord {
    format: String,
    version: u32,
    camera: String,
    receivers: Vec<String>,
    prints: BTreeMap<String, Fingerprint>,
    #[serde(default)]
    maps: Fingerprint,
    #[serde(default)]
    checksum: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "read to be checked")]
struct BakeGoal {
    format: String,
    version: u32,
    samples: u32,
    train_seconds: f64,
    #[serde(default)]
    checksum: String,
}

/// Refuses a record of a scene that is not as the add-on wrote it.
pub(crate) fn check_shot(path: &Path) -> Result<(), String> {
    check(path, "relume-shot", |text| serde_json::from_str::<ShotRecord>(text).map(drop))
}

/// Refuses a note of what a bake shall become that is not as the add-on wrote it.
pub(crate) fn check_wanted(path: &Path) -> Result<(), String> {
    check(path, "relume-wanted", |text| serde_json::from_str::<BakeGoal>(text).map(drop))
}

fn check(
    path: &Path,
    format: &str,
    parse: impl Fn(&str) -> Result<(), serde_json::Error>,
) -> Result<(), String> {
    let text = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    parse(&text).map_err(|error| error.to_string())?;
    let value: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    if value["format"] != format || value["version"] != 1 {
        return Err(format!("it is no {format} of version 1"));
    }
    // Older bakes have no checksum.
    value["checksum"].as_str().map_or(Ok(()), |sum| checksum::check_own(&text, sum))
}
