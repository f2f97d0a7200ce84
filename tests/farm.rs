//! Bakes cut into parts for many machines: the bytes of one machine, whatever happens to the workers.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{contents, data, failure, one_error, program, relume, result, room, run, trace_room};
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Settings that cut a bake of the room of `tests/data` into many shards.
const MANY: &str = "--width 40 --height 32 --tile 8 --samples 64";

/// Plans the room into `job`; its bake is `job/room`.
fn plan(folder: &Path, options: &str) -> Value {
    result(folder, &room_for_farm(options))
}

fn room_for_farm(options: &str) -> String {
    room(&format!("{MANY} --out job {options}")).replacen("trace", "plan", 1)
}

fn shards(folder: &Path) -> Vec<String> {
    let names = contents(&folder.join("job/room")).into_iter().map(|(name, _)| name);
    names.filter(|name| name.starts_with("tile_")).collect()
}

#[test]
fn a_bake_in_eight_parts_is_that_of_one_machine_though_workers_are_killed_and_work_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let planned = plan(path, "--parts 8");
    assert_eq!(planned["parts"], 8);
    assert_eq!(shards(path), [""; 0], "a plan traces nothing");

    let mut killed = relume(path, "work job --part 8 --threads 1").spawn().unwrap();
    let start = Instant::now();
    while shards(path).is_empty() && start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    std::fs::write(path.join("job/room/.relume-killed.tmp"), "half").unwrap();

    let twice =
        ["work job --part 3 --threads 1", "work job/plan.json --part 3"].map(|words| relume(path, words));
    let both = twice.map(|mut command| command.spawn().unwrap());
    assert!(both.into_iter().all(|mut child| child.wait().unwrap().success()));
    result(path, "work job --part 6-7,1 --threads 1");
    let report = result(path, "work job --part 3");
    assert_eq!(report["traced"], 0, "what is done is not done again");
    assert!(report["shards"].as_u64() > Some(0));

    let words = failure(path, "collect job");
    assert!(words.contains("parts 2,4-5,8 ") && words.contains("relume work job --part 2,4-5,8"), "{words}");
    assert!(path.join("job/room/.relume-killed.tmp").exists(), "others may be writing still");
    result(path, "work job --part 2,4-5,8");
    let collected = result(path, "collect job");
    assert_eq!(collected["bakes"][0]["samples"], 64);
    assert_eq!(result(path, "collect job"), collected);
    trace_room(path, &format!("{MANY} --out whole"));
    assert!(contents(&path.join("job/room")) == contents(&path.join("whole")), "the bakes differ");
    result(path, "relight job/room --out relit.exr");
}

#[test]
fn damaged_and_missing_parts_are_named_and_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    plan(path, "--parts 4");
    result(path, "work job --part 1-4");
    let sound = contents(&path.join("job/room"));
    let names = shards(path);
    // Of the first and the last pass.
    let [first, last] = [&names[0], &names[names.len() - 1]].map(|name| path.join("job/room").join(name));
    let mut bytes = std::fs::read(&first).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&first, bytes).unwrap();
    std::fs::remove_file(&last).unwrap();

    let output = run(path, "collect job");
    let words = one_error(&output);
    let named = String::from_utf8_lossy(&output.stderr);
    assert!(named.contains(&first.file_name().unwrap().to_string_lossy().into_owned()), "{named}");
    let parts = words.split("--part ").nth(1).unwrap().trim().to_owned();
    assert_eq!(parts.split(',').count(), 2, "{words}");
    assert_eq!(result(path, &format!("work job --part {parts}"))["traced"], 2);
    result(path, "collect job");
    assert!(contents(&path.join("job/room")) == sound);

    std::fs::write(path.join("job/room/lights.json"), "{}").unwrap();
    assert!(failure(path, "collect job").contains("has damaged files"));
}

#[test]
fn a_worker_of_another_version_does_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    plan(path, "--parts 2");
    let file = path.join("job/plan.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let own = env!("CARGO_PKG_VERSION");
    std::fs::write(&file, text.replace(&format!("\"relume\": \"{own}\""), "\"relume\": \"99.1\"")).unwrap();
    for command in ["work job --part 1", "collect job"] {
        let output = run(path, command);
        let words = one_error(&output);
        assert!(words.contains("Relume 99.1") && words.contains(own), "{words}");
        assert_eq!(output.status.code(), Some(1), "another try is of no use");
    }
    assert_eq!(shards(path), [""; 0]);
}

#[test]
#[cfg(unix)]
fn a_worker_without_room_for_its_files_leaves_nothing_half_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    plan(path, "--parts 2");
    let planned = contents(&path.join("job/room"));
    let limited = format!("trap '' XFSZ; ulimit -f 8; exec '{}' work job --part 1 --quiet", program());
    let output = Command::new("sh").args(["-c", &limited]).current_dir(path).output().unwrap();
    assert!(one_error(&output).contains("cannot write"), "{output:?}");
    assert_eq!(output.status.code(), Some(75), "EX_TEMPFAIL: another try may succeed");
    assert!(contents(&path.join("job/room")) == planned, "files are left");
    result(path, "work job --part 1-2");
    result(path, "collect job");
}

#[test]
fn frames_are_baked_each_in_its_folder_under_one_numbering() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for frame in ["0001.obj", "0002.obj"] {
        std::fs::copy(data("room.obj"), path.join(frame)).unwrap();
    }
    std::fs::copy(data("room.mtl"), path.join("room.mtl")).unwrap();
    let options = "--up z --width 8 --height 8 --tile 4 --samples 2 --out seq --parts 3";
    let planned = result(path, &format!("plan 0001.obj 0002.obj {options} --emit make"));
    assert_eq!(planned["parts"], 6);
    result(path, "work seq --part 1-3");
    let words = failure(path, "collect seq");
    assert!(words.contains("--part 4-6"), "{words}");
    let mut make = Command::new("make");
    let output =
        make.args(["-k", "-j2", "-C", "seq"]).env("RELUME", program()).current_dir(path).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(contents(&path.join("seq/0001")).iter().any(|(name, _)| name.starts_with("tile_")));
    assert_eq!(result(path, "collect seq")["bakes"].as_array().unwrap().len(), 2);
    assert!(
        failure(path, &format!("plan 0001.obj ./0001.obj {options}")).contains("two bakes have the folder")
    );
}

#[test]
fn bad_plans_and_parts_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    plan(path, "--parts 2");
    assert!(failure(path, "work job --part 3").contains("there is no part 3: the plan has 1 to 2"));
    assert!(failure(path, "work nowhere --part 1").contains("cannot read the plan"));
    for (parts, words) in [("0", "names no parts"), ("1-", "names no parts")] {
        assert!(failure(path, &format!("work job --part {parts}")).contains(words));
    }
    assert!(failure(path, &room_for_farm("--parts 0")).contains("1 to 1048576 parts"));
    assert!(failure(path, &room_for_farm("--seed 7")).contains("holds another dump (seed differs)"));
    // A bake that was put in the place of the planned one.
    std::fs::remove_dir_all(path.join("job/room")).unwrap();
    trace_room(path, "--out job/room --width 8 --height 8 --samples 1");
    for command in ["work job --part 1", "collect job"] {
        assert!(failure(path, command).contains("another bake than the one that was planned"));
    }
}

#[test]
fn templates_of_open_job_description_name_all_parts_and_nothing_outside_of_the_job() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for (farm, kind) in [("openjd", "INT"), ("openjd-chunks", "CHUNK[INT]")] {
        let planned = plan(path, &format!("--parts 5 --emit {farm},slurm,flamenco"));
        assert_eq!(planned["emitted"].as_array().unwrap().len(), 3);
        let text = std::fs::read_to_string(path.join("job/template.json")).unwrap();
        let template: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
        assert_eq!(template.get("extensions").is_some(), kind == "CHUNK[INT]");
        let part = &template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0];
        assert_eq!((&part["type"], &part["range"]), (&kind.into(), &"1-5".into()));
        assert_eq!(template["steps"][1]["dependencies"][0]["dependsOn"], template["steps"][0]["name"]);
        for name in ["template.json", "slurm.sh", "plan.json"] {
            let text = std::fs::read_to_string(path.join("job").join(name)).unwrap();
            assert!(!text.contains(&path.display().to_string()), "{name} names a folder of this machine");
        }
    }
}
