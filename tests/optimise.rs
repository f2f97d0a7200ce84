//! `relume optimise --request`: pictures and masks in files, several views.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{data, failure, result, trace_room};
use relume_session::LightSet;
use relume_session::image::{Image, Layer, LayeredImage, Precision, read_picture, write_exr};
use serde_json::{Value, json};
use std::path::Path;

const SIZE: &str = "--width 48 --height 36 --samples 128";

fn key(strength: f32) -> Value {
    let shape = json!({"type": "sphere", "center": [0.3, -0.1, 1.3], "radius": 0.25});
    json!({"name": "Key", "shape": shape, "radiance": [9.0 * strength, 7.0 * strength, 4.0 * strength]})
}

fn write(path: &Path, value: &Value) {
    std::fs::write(path, value.to_string()).unwrap();
}

fn write_picture(path: &Path, image: Image) {
    let (width, height) = (image.width, image.height);
    let layers = vec![Layer::color("Combined", image)];
    let image = LayeredImage { width, height, layers, ..LayeredImage::default() };
    write_exr(path, &image, Precision::Float).unwrap();
}

/// The radiance of the only light of a set.
fn radiance(path: &Path) -> [f32; 3] {
    LightSet::read(path).unwrap().lights[0].radiance
}

#[test]
fn a_request_finds_a_light_in_two_views_by_pictures_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::create_dir(path.join("wish")).unwrap();
    write(&path.join("hidden.json"), &json!([key(1.0)]));
    for (view, eye) in [("left", "-0.4,-4.2,1"), ("right", "0.4,-4.2,1")] {
        let scene = data("room.obj");
        let camera = format!("--up z --eye {eye} --target 0,0,1 --fov 36");
        result(path, &format!("trace {} {camera} --out {view} {SIZE}", scene.display()));
        result(path, &format!("gather {view} --lights hidden.json --float --out wish/{view}.exr"));
    }
    let goal = |view: usize, image: &str| json!({"goal": "target", "image": image, "view": view});
    let goals = json!([goal(0, "left.exr"), goal(1, "right.exr")]);
    let free = json!({"Key": ["color", "strength"]});
    let request = json!({"lights": [key(0.2)], "free": free, "goals": goals, "starts": 1, "steps": 100});
    write(&path.join("wish/wish.json"), &request);
    let found = result(path, "optimise left right --request wish/wish.json --out found.json");
    let report = found["solved"]["report"].as_array().unwrap();
    assert_eq!(report.iter().map(|goal| goal["number"].as_u64()).collect::<Vec<_>>(), [Some(0), Some(1)]);
    assert!(report.iter().all(|goal| goal["met"] == true), "{report:?}");
    let found = radiance(&path.join("found.json"));
    assert!(found.iter().zip([9.0, 7.0, 4.0]).all(|(is, was)| (is / was - 1.0).abs() < 0.02), "{found:?}");
}

#[test]
fn a_mask_of_indices_is_a_place_and_a_broken_target_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    trace_room(path, &format!("--out bake {SIZE}"));
    write(&path.join("now.json"), &json!([key(1.0)]));
    result(path, "gather bake --lights now.json --float --out now.exr");
    let now = read_picture(&path.join("now.exr")).unwrap();
    // Left index 2, right index 7.
    let indices = (0..48 * 36).map(|i| if i % 48 < 24 { 2.0 } else { 7.0 }).collect();
    write_picture(&path.join("indices.exr"), Image { width: 48, height: 36, channels: 1, data: indices });
    let ask = |goal: Value| {
        let free = json!({"Key": ["strength"]});
        let request = json!({"lights": [key(1.0)], "free": free, "goals": [goal], "starts": 1, "steps": 50});
        write(&path.join("wish.json"), &request);
        "optimise bake --request wish.json --out found.json"
    };
    // A target that is four times as bright on the left and half as bright on the right counts where index 7 is.
    let mut target = Image::new(48, 36, 3);
    for (i, (value, now)) in
        target.data.iter_mut().zip(now.data.chunks(now.channels).flat_map(|p| &p[..3])).enumerate()
    {
        *value = if i / 3 % 48 < 24 { 4.0 } else { 0.5 } * now;
    }
    write_picture(&path.join("target.exr"), target.clone());
    let goal = |index: u32| json!({"goal": "target", "image": "target.exr", "where": {"mask": "indices.exr", "equals": index}});
    for (index, factor) in [(7, 0.5), (2, 4.0)] {
        result(path, ask(goal(index)));
        let found = radiance(&path.join("found.json"))[0] / 9.0;
        assert!((found / factor - 1.0).abs() < 0.02, "{found} for {factor}");
    }
    std::fs::remove_file(path.join("found.json")).unwrap();
    assert!(failure(path, ask(goal(3))).contains("goal 1 concerns no pixel"));
    target.data[100] = f32::NAN;
    write_picture(&path.join("target.exr"), target);
    let message = failure(path, ask(json!({"goal": "target", "image": "target.exr"})));
    assert!(message.contains("the target must be an RGB picture of finite values"), "{message}");
    assert!(!path.join("found.json").exists());
}
