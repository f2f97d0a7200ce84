//! Interrupted work goes on where it stopped and ends as if it had never been interrupted.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{contents, program, relume, result, room, trace_room};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The code of a run that was asked to stop.
const STOPPED: i32 = 130;

fn terminate(mut child: Child) -> i32 {
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    child.wait().unwrap().code().expect("an exit code, not a signal")
}

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until a run that reports in JSON has done a part of a stage.
fn wait_for_part_of(child: &mut Child, stage: &str) {
    let begun = |line: std::io::Result<String>| {
        let report: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        report["stage"] == stage && report["done"].as_u64() > Some(0)
    };
    let reports = BufReader::new(child.stdout.as_mut().unwrap());
    assert!(reports.lines().any(begun), "it ended without a report of {stage}");
}

fn shards(folder: &Path) -> usize {
    std::fs::read_dir(folder).map_or(0, |dir| {
        dir.filter(|entry| entry.as_ref().is_ok_and(|e| e.file_name().to_string_lossy().starts_with("tile_")))
            .count()
    })
}

#[test]
fn terminated_bake_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let options = "--width 64 --height 64 --tile 32 --samples 256";
    trace_room(folder.path(), &format!("{options} --out whole --threads 2"));

    let child = relume(folder.path(), &room(&format!("{options} --out cut"))).spawn().unwrap();
    let cut = folder.path().join("cut");
    wait_for("the first shards", || shards(&cut) >= 3);
    assert_eq!(terminate(child), STOPPED);
    assert!(shards(&cut) < shards(&folder.path().join("whole")), "it was done before it was stopped");
    assert!(contents(&cut).iter().all(|(name, _)| !name.starts_with('.')), "temporary files are left");

    trace_room(folder.path(), &format!("{options} --out cut --resume --threads 1"));
    assert!(contents(&cut) == contents(&folder.path().join("whole")), "the dumps differ");
}

#[test]
fn terminated_training_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    trace_room(path, "--out bake --width 24 --height 24 --samples 16");
    let training = "train bake --million-samples 2 --neurons 16 --size-min 0.1 --size-max 0.3";
    result(path, &format!("{training} --out whole"));

    let mut begins = Command::new(program());
    begins.current_dir(path).args(format!("{training} --out cut --json").split_whitespace());
    let mut child = begins.stdout(Stdio::piped()).spawn().unwrap();
    wait_for_part_of(&mut child, "train");
    assert_eq!(terminate(child), STOPPED);
    let info = result(path, "info cut/proxy_sphere.safetensors");
    let done = info["info"]["samples"].as_u64().unwrap();
    assert!(done < 2_000_000, "it was done before it was stopped");

    result(path, &format!("{training} --out cut --resume"));
    for file in ["proxy_sphere.safetensors", "proxy_sphere.json"] {
        let bytes = |folder: &str| std::fs::read(path.join(folder).join(file)).unwrap();
        assert!(bytes("cut") == bytes("whole"), "{file} differs after {done} samples");
    }
}

#[test]
fn more_samples_extend_a_finished_bake() {
    let folder = tempfile::tempdir().unwrap();
    let options = "--width 16 --height 16";
    trace_room(folder.path(), &format!("{options} --out grown --samples 8"));
    trace_room(folder.path(), &format!("{options} --out grown --samples 32 --resume"));
    trace_room(folder.path(), &format!("{options} --out whole --samples 32"));
    assert!(contents(&folder.path().join("grown")) == contents(&folder.path().join("whole")));
}
