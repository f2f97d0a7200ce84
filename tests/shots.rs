//! `--shots`: every shot of a list relit, put on a sheet, and solved together.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{data, failure, result, run};
use relume_session::LightSet;
use relume_session::image::read_picture;
use serde_json::{Value, json};
use std::path::Path;

const EYES: [(&str, &str); 3] = [("Left", "-0.4,-4.2,1"), ("Middle", "0,-4.2,1"), ("Right", "0.4,-4.2,1")];

fn write(path: &Path, value: &Value) {
    std::fs::write(path, value.to_string()).unwrap();
}

/// Three bakes of the room, and the list of them.
fn three_shots(folder: &Path, options: &str) {
    std::fs::create_dir(folder.join("list")).unwrap();
    let scene = data("room.obj");
    for (name, eye) in EYES {
        let camera = format!("--up z --eye {eye} --target 0,0,1 --fov 36");
        result(folder, &format!("trace {} {camera} --out list/bake_{name} {options}", scene.display()));
    }
    write_list(&folder.join("list/shots.json"), EYES.map(|(name, _)| name).as_slice());
}

fn write_list(path: &Path, names: &[&str]) {
    let shot =
        |name: &&str| json!({"name": name, "bake": format!("bake_{name}"), "camera": "Camera", "frame": 1});
    let shots: Vec<Value> = names.iter().map(shot).collect();
    write(path, &json!({"format": "relume-shots", "version": 1, "shots": shots}));
}

/// 8-bit values of a PNG.
fn pixels(path: &Path) -> (usize, usize, Vec<u8>) {
    let image = read_picture(path).unwrap();
    let encode = |v: &f32| (relume_session::image::srgb_from_linear(*v) * 255.0).round() as u8;
    (image.width, image.height, image.data.iter().map(encode).collect())
}

/// True if a picture is somewhere on a sheet, byte by byte.
fn is_on(sheet: &(usize, usize, Vec<u8>), picture: &(usize, usize, Vec<u8>)) -> bool {
    let row = |image: &(usize, usize, Vec<u8>), x: usize, y: usize, length: usize| {
        let at = (y * image.0 + x) * 3;
        image.2[at..at + 3 * length].to_vec()
    };
    let rows: Vec<Vec<u8>> = (0..picture.1).map(|y| row(picture, 0, y, picture.0)).collect();
    let fits = |x: usize, y: usize| {
        rows.iter().enumerate().all(|(line, wanted)| row(sheet, x, y + line, picture.0) == *wanted)
    };
    (0..=sheet.1 - picture.1).any(|y| (0..=sheet.0 - picture.0).any(|x| fits(x, y)))
}

#[test]
fn all_shots_are_relit_as_each_alone_and_the_sheet_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    three_shots(path, "--width 48 --height 40 --samples 16");
    let lights = format!("--lights {}", data("evening.json").display());
    let written = result(
        path,
        &format!("relight --shots list/shots.json {lights} --sheet sheet.png --out {{shot}}.exr"),
    );
    assert_eq!(written["shots"].as_array().unwrap().len(), 3);
    let sheet = pixels(&path.join("sheet.png"));
    for (name, _) in EYES {
        result(path, &format!("relight list/bake_{name} {lights} --out alone_{name}.exr"));
        let bytes = |file: String| std::fs::read(path.join(file)).unwrap();
        assert!(bytes(format!("{name}.exr")) == bytes(format!("alone_{name}.exr")), "{name}");
        assert!(bytes(format!("{name}.png")) == bytes(format!("alone_{name}.png")), "{name}");
        assert!(is_on(&sheet, &pixels(&path.join(format!("{name}.png")))), "{name} is not on the sheet");
    }
    result(path, &format!("relight --shots list/shots.json {lights} --sheet alone.png"));
    assert!(std::fs::read(path.join("alone.png")).unwrap() == std::fs::read(path.join("sheet.png")).unwrap());
}

#[test]
fn one_shot_without_a_bake_is_named_and_the_others_have_their_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    three_shots(path, "--width 24 --height 20 --samples 4");
    std::fs::remove_dir_all(path.join("list/bake_Middle")).unwrap();
    let message = failure(path, "relight --shots list/shots.json --sheet sheet.png --out {shot}.exr");
    assert!(message.contains("1 of 3 shots failed: 'Middle':"), "{message}");
    assert!(
        path.join("Left.exr").exists()
            && path.join("Right.png").exists()
            && !path.join("Middle.exr").exists()
    );
    assert!(path.join("sheet.png").exists());

    let message = failure(path, "relight --shots list/shots.json --out all.exr");
    assert!(message.contains("{shot}"), "{message}");
    let message = failure(path, "relight --shots list/shots.json list/bake_Left --out {shot}.exr");
    assert!(message.contains("--shots"), "{message}");
    write_list(&path.join("list/twice.json"), &["Left", "Left"]);
    let message = failure(path, "relight --shots list/twice.json --sheet sheet.png");
    assert!(message.contains("two shots have the name 'Left'"), "{message}");
    assert!(!run(path, "relight --out a.exr").status.success(), "neither a bake nor a list");
    let alone = run(path, "relight list/bake_Left --out a.exr --sheet sheet.png");
    assert!(!alone.status.success(), "a sheet of no list");
}

#[test]
fn factors_of_a_request_multiply_what_they_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    common::trace_room(path, "--out bake --width 16 --height 12 --samples 8 --world 0.2,0.3,0.4");
    let sun = json!({"name": "Key", "shape": {"type": "sphere", "center": [0.3, -0.1, 1.3], "radius": 0.25}, "radiance": [9, 7, 4]});
    write(&path.join("set.json"), &json!([sun]));
    write(
        &path.join("request.json"),
        &json!({"lights": [sun], "gains": {"Key": [2, 2, 2]}, "world": [3, 3, 3]}),
    );
    result(path, "gather bake --lights set.json --no-denoise --float --out plain.exr");
    result(path, "gather bake --request request.json --no-denoise --float --out scaled.exr");
    let read = |file: &str| relume_session::image::read_exr(&path.join(file)).unwrap();
    let (plain, scaled) = (read("plain.exr"), read("scaled.exr"));
    for (layer, factor) in [("Combined_Key", 2.0), ("world", 3.0)] {
        let (before, after) = (plain.get(layer).unwrap(), scaled.get(layer).unwrap());
        assert!(before.data.iter().any(|v| *v > 0.0), "{layer} is black");
        let is_scaled = |(a, b): (&f32, &f32)| (a * factor - b).abs() <= 1e-5 * b.abs().max(1e-6);
        assert!(before.data.iter().zip(&after.data).all(is_scaled), "{layer}");
    }
}

#[test]
fn goals_name_their_shots_and_one_light_is_solved_for_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    three_shots(path, "--width 48 --height 36 --samples 128");
    let key = |strength: f32| {
        let shape = json!({"type": "sphere", "center": [0.3, -0.1, 1.3], "radius": 0.25});
        json!([{"name": "Key", "shape": shape, "radiance": [9.0 * strength, 7.0 * strength, 4.0 * strength]}])
    };
    write(&path.join("hidden.json"), &key(1.0));
    result(path, "gather --shots list/shots.json --lights hidden.json --float --out {shot}.exr");
    let goal = |shot: &str| json!({"goal": "target", "image": format!("{shot}.exr"), "shot": shot});
    let request = |goals: Value| {
        let free = json!({"Key": ["color", "strength"]});
        json!({"lights": key(0.2), "free": free, "goals": goals, "starts": 1, "steps": 100})
    };
    let solve = "optimise --shots list/shots.json --request wish.json --out found.json";
    write(&path.join("wish.json"), &request(json!([goal("Right"), goal("Left"), goal("Middle")])));
    let found = result(path, solve);
    let report = found["solved"]["report"].as_array().unwrap();
    assert!(report.len() == 3 && report.iter().all(|goal| goal["met"] == true), "{report:?}");
    let radiance = LightSet::read(&path.join("found.json")).unwrap().lights[0].radiance;
    assert!(
        radiance.iter().zip([9.0, 7.0, 4.0]).all(|(is, was)| (is / was - 1.0).abs() < 0.02),
        "{radiance:?}"
    );

    // Pictures of all shots by one pattern, and a damaged shot that no goal is about.
    write(&path.join("start.json"), &key(0.2));
    let short =
        "--target {shot}.exr --lights start.json --lock-center --lock-radius --starts 1 --iterations 100";
    let found = result(path, &format!("optimise --shots list/shots.json {short} --out short.json"));
    assert_eq!(found["solved"]["report"].as_array().unwrap().len(), 3);
    std::fs::remove_dir_all(path.join("list/bake_Middle")).unwrap();
    write(&path.join("wish.json"), &request(json!([goal("Right")])));
    result(path, solve);

    write(&path.join("wish.json"), &request(json!([goal("Rihgt")])));
    assert!(failure(path, solve).contains("shots.json has no shot 'Rihgt'"));
    let both = json!([{"goal": "brighter", "shot": "Left", "view": 0}]);
    write(&path.join("wish.json"), &request(both));
    assert!(failure(path, solve).contains("both a shot and a view"));
    let alone = "optimise list/bake_Left --request wish.json --out found.json";
    assert!(failure(path, alone).contains("--shots"));
}
