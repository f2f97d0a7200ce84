//! Whatever is wrong with the input: one line that names it, an exit code, and nothing half-written.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{contents, data, failure, one_error, program, result, room, run, trace_room};
use std::path::Path;
use std::process::Command;

fn small_bake(folder: &Path) {
    trace_room(folder, "--out bake --width 16 --height 16 --samples 8");
}

#[test]
fn unknown_options_and_missing_arguments_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, word) in [
        ("relight bake --out a.exr --fast", "--fast"),
        ("trace", "<SCENE>"),
        ("brighten bake", "brighten"),
        ("trace a.obj --out b --eye 1,2", "--eye"),
        ("train bake --type torus", "torus"),
        ("trace a.obj --out b --samples -3", "-3"),
    ] {
        let message = failure(folder.path(), arguments);
        assert!(message.contains(word), "{message}");
        assert_eq!(run(folder.path(), arguments).status.code(), Some(2));

        let output = run(folder.path(), &format!("{arguments} --json"));
        let event: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
        assert_eq!((&event["event"], output.stderr.as_slice()), (&"error".into(), &[][..]));
        assert!(event["message"].as_str().is_some_and(|text| text.contains(word)), "{event}");
    }
}

#[test]
fn scenes_that_cannot_be_traced_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("empty.obj", "# nothing\n");
    write("nan.obj", "o wall\nv 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    write("broken.obj", "v 0 0 0\nv one 0 0\n");
    write("text.scene", "not a scene");
    for (scene, word) in [
        ("empty.obj", "nothing to render"),
        ("nan.obj", "wall"),
        ("broken.obj", "position"),
        ("gone.obj", "gone.obj"),
        ("text.scene", "text.scene: damaged or no scene file"),
        ("gone.scene", "gone.scene"),
    ] {
        let message = failure(folder.path(), &format!("trace {scene} --out bake"));
        assert!(message.contains(word), "{message}");
        assert!(!folder.path().join("bake").exists());
    }
    for (options, word) in [
        ("--samples 0", "samples"),
        ("--tile 0", "tile"),
        ("--width 0", "width"),
        ("--fov 200", "field of view"),
        ("--eye 0,0,1 --target 0,0,1", "camera"),
        ("--lights none.json", "none.json"),
    ] {
        let scene = data("room.obj");
        let message = failure(folder.path(), &format!("trace {} --out bake {options}", scene.display()));
        assert!(message.contains(word), "{message}");
        assert!(!folder.path().join("bake").exists(), "{options}");
    }
}

#[test]
fn zero_area_triangles_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 1 2\nf 1 2 2\n";
    std::fs::write(folder.path().join("flat.obj"), obj).unwrap();
    result(folder.path(), "trace flat.obj --up z --out bake --width 16 --height 16 --samples 4");
    assert_eq!(result(folder.path(), "validate bake")["problems"], serde_json::json!([]));
}

#[test]
fn folders_that_cannot_be_written_are_named() {
    let folder = tempfile::tempdir().unwrap();
    small_bake(folder.path());
    std::fs::write(folder.path().join("file"), "in the way").unwrap();
    // Even root cannot make a folder below a file.
    let message = failure(folder.path(), &room("--out file/bake --samples 1"));
    assert!(message.contains("file/bake"), "{message}");
    let light = data("evening.json");
    for out in ["file/a.exr", "gone/a.exr"] {
        let arguments = format!("gather bake --no-denoise --lights {} --out {out}", light.display());
        let message = failure(folder.path(), &arguments);
        assert_eq!(message.matches(out).count(), 1, "{message}");
    }
    assert_eq!(std::fs::read_to_string(folder.path().join("file")).unwrap(), "in the way");
}

#[test]
fn a_second_bake_does_not_touch_the_first() {
    let folder = tempfile::tempdir().unwrap();
    small_bake(folder.path());
    let before = contents(&folder.path().join("bake"));
    let message = failure(folder.path(), &room("--out bake --width 16 --height 16 --samples 8"));
    assert!(message.contains("resume"), "{message}");
    let message = failure(folder.path(), &room("--out bake --width 32 --height 16 --samples 8 --resume"));
    assert!(message.contains("another dump"), "{message}");
    assert!(contents(&folder.path().join("bake")) == before);
}

#[test]
fn damaged_dumps_are_found_and_refused() {
    let folder = tempfile::tempdir().unwrap();
    small_bake(folder.path());
    let bake = folder.path().join("bake");
    let shard = bake.join("tile_0000_pass_0002.safetensors");
    let good = std::fs::read(&shard).unwrap();
    let light = data("evening.json");
    let gather = format!("gather bake --no-denoise --lights {} --out a.exr", light.display());

    std::fs::write(&shard, &good[..good.len() / 2]).unwrap();
    for arguments in [gather.as_str(), "train bake --million-samples 0.01"] {
        let message = failure(folder.path(), arguments);
        assert!(message.contains("tile_0000_pass_0002"), "{message}");
    }
    let mut flipped = good.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x10;
    std::fs::write(&shard, &flipped).unwrap();
    assert!(failure(folder.path(), "validate bake").contains("1 problem"));

    std::fs::remove_file(&shard).unwrap();
    assert!(failure(folder.path(), "validate bake").contains("1 problem"));
    assert!(failure(folder.path(), "train bake --million-samples 0.01").contains("resume"));
    let relit = run(folder.path(), &gather);
    assert!(relit.status.success() && String::from_utf8_lossy(&relit.stderr).contains("unfinished"));
    std::fs::remove_file(bake.join("guided.json")).unwrap();
    let relit = run(folder.path(), &gather);
    let words = String::from_utf8_lossy(&relit.stderr).into_owned();
    assert!(relit.status.success() && words.contains("guided.json is missing"), "{words}");
    // Resuming bakes what is missing, and nothing else.
    trace_room(folder.path(), "--out bake --width 16 --height 16 --samples 8 --resume");
    assert!(std::fs::read(&shard).unwrap() == good);

    std::fs::write(bake.join("manifest.json"), "{}").unwrap();
    assert!(failure(folder.path(), &gather).contains("manifest.json"));
}

#[test]
fn damaged_proxies_are_named_and_damaged_light_sets_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    small_bake(path);
    result(path, "train bake --million-samples 0.01 --neurons 16 --size-min 0.1 --size-max 0.3");
    let proxy = path.join("bake/proxy_sphere.safetensors");
    let good = std::fs::read(&proxy).unwrap();
    let light = data("evening.json");
    for bytes in [&good[..good.len() - 7], &good[..100], &[]] {
        std::fs::write(&proxy, bytes).unwrap();
        // The paths are at hand, from which the light is summed.
        let arguments = format!("relight bake --no-denoise --lights {} --out a.exr", light.display());
        let relit = run(path, &arguments);
        let message = String::from_utf8_lossy(&relit.stderr).into_owned();
        assert!(relit.status.success() && message.contains("proxy_sphere"), "{message}");
        assert!(failure(path, "validate bake/proxy_sphere.safetensors").contains("1 problem"));
    }
    std::fs::remove_file(path.join("a.exr")).unwrap();
    // Training again is the way out.
    result(path, "train bake --million-samples 0.01 --neurons 16");
    std::fs::write(path.join("typo.json"), r#"[{"name": "Key", "shape": {"type": "cube"}}]"#).unwrap();
    let message = failure(path, "relight bake --lights typo.json --out a.exr");
    assert!(message.contains("typo.json") && message.contains("'Key'"), "{message}");
    assert!(!path.join("a.exr").exists());
}

#[test]
fn files_that_are_gone_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    small_bake(path);
    let training = "train bake --million-samples 0.01 --neurons 16 --size-min 0.1 --size-max 0.3";
    result(path, &format!("{training} --all-paths"));
    assert_eq!(result(path, "info bake")["lost"], serde_json::json!([]), "that is not measured");
    result(path, training);
    assert_eq!(result(path, "info bake")["lost"], serde_json::json!([]));
    for name in
        ["guided.json", "proxy_sphere.safetensors", "proxy_sphere.json", "training_sphere.safetensors"]
    {
        std::fs::remove_file(path.join("bake").join(name)).unwrap();
    }
    let lost = result(path, "info bake")["lost"].to_string();
    assert!(lost.contains("guided.json is missing in bake, ") && lost.contains("Rebake"), "{lost}");
    assert!(lost.contains("proxy_sphere.safetensors and proxy_sphere.json are missing in bake, "), "{lost}");
    assert!(lost.contains("relume train --type sphere") && lost.contains("restore them"), "{lost}");
    assert!(failure(path, "validate bake").contains("2 problems"));
    result(path, training);
    assert!(!result(path, "info bake")["lost"].to_string().contains("proxy_sphere"));
}

#[test]
fn pictures_of_another_size_are_no_targets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    small_bake(path);
    result(path, "train bake --million-samples 0.01 --neurons 16 --size-min 0.1 --size-max 0.3");
    trace_room(path, "--out other --width 8 --height 4 --samples 1");
    result(path, "gather other --no-denoise --out other.exr");
    let message = failure(path, "optimise bake --target other.exr --out found.json");
    assert!(message.contains("goal 1: the target is 8 x 4 pixels, the bake"), "{message}");
    assert!(failure(path, "optimise bake --target gone.png --out found.json").contains("gone.png"));
    let cannot = |request: &str| {
        std::fs::write(path.join("request.json"), request).unwrap();
        failure(path, "optimise bake --request request.json --out found.json")
    };
    assert!(cannot("{").contains("request.json"));
    assert!(cannot(r#"{"lights": []}"#).contains("nothing is asked for"));
    let keep = r#""goals": [{"goal": "keep"}]"#;
    assert!(cannot(&format!(r#"{{"lights": [], {keep}}}"#)).contains("nothing may change"));
    assert!(cannot(&format!(r#"{{"free": {{"Nobody": []}}, {keep}}}"#)).contains("'Nobody'"));
    assert!(failure(path, "optimise bake --out found.json").contains("--request"));
    assert!(!path.join("found.json").exists());
}

#[test]
fn files_that_cannot_be_written_in_the_end_are_refused_first() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("lit")).unwrap();
    for (arguments, word) in [
        ("gather bake --out lit.jpg", "cannot write lit.jpg: pictures are written as a multi-layer EXR"),
        ("relight bake --out lit.png", "let the name end in .exr"),
        ("relight bake --out shot", "let the name end in .exr"),
        ("relight bake --out lit", "lit is a folder; name a file in it, such as lit/shot.exr"),
        ("relight bake --out gone/lit.exr", "its folder does not exist; make it first"),
        ("relight bake --out LIT.EXR", "there is no folder bake"),
        (
            "optimise bake --target a.exr --out found.exr",
            "lights are written as JSON; let the name end in .json",
        ),
    ] {
        let message = failure(folder.path(), arguments);
        assert!(message.contains(word), "{arguments}: {message}");
    }
}

/// Of two that bake into a folder, the second is told of the first, and what to do.
#[test]
fn a_folder_is_baked_into_by_one_process_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let options = "--out bake --width 64 --height 64 --samples 100000 --threads 1";
    let mut first = common::relume(folder.path(), &room(options)).spawn().expect("the program starts");
    let manifest = folder.path().join("bake/manifest.json");
    while !manifest.exists() {
        assert!(first.try_wait().unwrap().is_none(), "it ended");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let message = failure(folder.path(), &room(&format!("{options} --resume")));
    first.kill().unwrap();
    first.wait().unwrap();
    let who = format!("another process ({}) is baking into bake; wait for its end, stop it, or", first.id());
    assert!(message.contains(&who), "{message}");
    // Its lock ends with it.
    trace_room(folder.path(), "--out bake --width 64 --height 64 --samples 8 --resume");
    assert!(!folder.path().join("bake/baking.lock").exists());
}

/// A file-size limit fails a write half-way, like a full disk.
#[cfg(unix)]
#[test]
fn full_disk_leaves_no_half_written_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    small_bake(path);
    let limited = |blocks: u32, arguments: &str| {
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec {} {arguments} --quiet", program());
        one_error(&Command::new("sh").current_dir(path).args(["-c", &script]).output().unwrap())
    };
    let message = limited(16, &room("--out full --width 64 --height 64 --samples 64"));
    assert!(message.contains("too large") && message.contains("full"), "{message}");
    let light = data("evening.json");
    let arguments = format!("gather bake --no-denoise --float --lights {} --out lit.exr", light.display());
    let message = limited(1, &arguments);
    assert!(message.contains("lit.exr"), "{message}");
    assert!(!path.join("lit.exr").exists());
    let train = "train bake --out proxies --million-samples 0.01 --neurons 16 --size-min 0.1 --size-max 0.3";
    limited(2, train);

    for folder in ["full", "proxies", "."] {
        let left: Vec<_> =
            std::fs::read_dir(path.join(folder)).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
    }
    assert!(!path.join("proxies/proxy_sphere.safetensors").exists());
    // Files from before the disk was full are whole, and the bake goes on once there is room.
    trace_room(path, "--out full --width 64 --height 64 --samples 64 --resume");
    assert_eq!(result(path, "validate full")["problems"], serde_json::json!([]));
}
