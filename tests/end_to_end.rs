//! From an OBJ file to a relit picture, and from a picture to the light that made it.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{contents, data, failure, result, run, trace_room};
use relume_session::image::{metrics, read_exr, read_picture};
use relume_session::trace::TraceSettings;
use relume_session::{LightSet, ObjView, obj_scene, write_scene};

#[test]
fn obj_becomes_relit_pictures_in_layers() {
    let folder = tempfile::tempdir().unwrap();
    let traced = trace_room(folder.path(), "--out bake --width 48 --height 40 --samples 64");
    assert_eq!(traced["paths"], 48 * 40 * 64);
    let lights = data("evening.json");
    result(
        folder.path(),
        &format!("gather bake --lights {} --no-denoise --float --out lit.exr", lights.display()),
    );

    let again = format!("gather bake --lights {} --no-denoise --float --out again.exr", lights.display());
    result(folder.path(), &format!("{again} --threads 1"));
    let bytes = |file: &str| std::fs::read(folder.path().join(file)).unwrap();
    assert!(bytes("lit.exr") == bytes("again.exr") && bytes("lit.png") == bytes("again.png"));

    let exr = read_exr(&folder.path().join("lit.exr")).unwrap();
    let layer = |name: &str| exr.get(name).unwrap_or_else(|| panic!("no layer {name}"));
    for name in ["albedo", "normal", "depth", "world"] {
        assert!(layer(name).data.iter().all(|v| v.is_finite()), "{name}");
    }
    // The picture is the sum of its lights; the room emits nothing and has no world.
    let (key, rim) = (layer("Combined_Key"), layer("Combined_Rim_001"));
    for (pixel, rgba) in layer("Combined").data.chunks_exact(4).enumerate() {
        for c in 0..3 {
            let sum = key.data[pixel * 3 + c] + rim.data[pixel * 3 + c];
            assert!((rgba[c] - sum).abs() <= 1e-5 * sum.max(1.0), "pixel {pixel}: {rgba:?} for {sum}");
        }
    }
    let mean =
        |image: &relume_session::image::Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
    assert!(mean(key) > 0.05 && mean(rim) > 0.05, "{} {}", mean(key), mean(rim));
    // Blue light on white walls is blue.
    let channel = |c: usize| rim.data.iter().skip(c).step_by(3).sum::<f32>();
    assert!(channel(2) > 1.3 * channel(0));
    assert_eq!(read_picture(&folder.path().join("lit.png")).unwrap().width, 48);
}

#[test]
fn scene_files_are_traced_as_they_say_unless_told_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let view = ObjView { width: 16, height: 12, ..ObjView::default() };
    let mut scene = obj_scene(&data("room.obj"), &view).unwrap();
    scene.lights = LightSet::read(&data("evening.json")).unwrap().lights;
    let settings = TraceSettings { samples: 3, seed: 7, ..TraceSettings::default() };
    write_scene(&path.join("room.scene"), &scene, &settings, None).unwrap();

    let own = result(path, "trace room.scene --out own");
    assert_eq!((&own["width"], &own["samples"]), (&16.into(), &3.into()));
    let seed = result(path, "info own")["manifest"]["seed"].clone();
    result(path, "trace room.scene --out more --samples 5 --seed 8 --bounces 1");
    let more = result(path, "info more")["manifest"].clone();
    assert_eq!((seed, &more["seed"]), (7.into(), &8.into()));
    assert_eq!(more["settings"]["bounces"]["diffuse"], 1);
    // A bake of the OBJ itself has the same content.
    let lights = data("evening.json");
    let same =
        format!("--width 16 --height 12 --samples 5 --seed 8 --bounces 1 --lights {}", lights.display());
    result(path, &format!("trace {} --out obj {same}", data("room.obj").display()));
    assert!(contents(&path.join("obj")) == contents(&path.join("more")));

    assert_eq!(result(path, "info room.scene")["lights"], serde_json::json!(["Key", "Rim.001"]));
    assert_eq!(result(path, "validate room.scene")["problems"], serde_json::json!([]));
    let message = failure(path, "trace room.scene --out other --fov 30");
    assert!(message.contains("room.scene has a camera"), "{message}");
}

#[test]
fn hidden_light_is_found_again_from_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    trace_room(path, "--out bake --width 40 --height 36 --samples 128");
    let sizes = "--size-min 0.15 --size-max 0.35";
    let trained = result(path, &format!("train bake --million-samples 2 --neurons 32 {sizes} --out proxies"));
    assert_eq!(trained["complete"], true);

    let hidden = r#"[{"name": "Hidden", "shape": {"type": "sphere", "center": [0.3, -0.1, 1.3], "radius": 0.25},
        "radiance": [9, 7, 4]}]"#;
    std::fs::write(path.join("hidden.json"), hidden).unwrap();
    result(path, "gather bake --lights hidden.json --no-denoise --float --out target.exr");
    // The proxies alone are enough.
    std::fs::rename(path.join("bake"), path.join("away")).unwrap();
    let found =
        result(path, "optimise proxies --target target.exr --starts 4 --iterations 300 --out found.json");
    assert!(found["solved"]["loss"].as_f64() < found["solved"]["start_loss"].as_f64());
    assert_eq!(found["solved"]["through"], "proxy");

    let light = &LightSet::read(&path.join("found.json")).unwrap().lights[0];
    let relume_session::scene::LightShape::Sphere { center, .. } = light.shape else { panic!("{light:?}") };
    let miss = center.distance([0.3, -0.1, 1.3].into());
    assert!(miss < 0.25, "found {light:?}, {miss} m away");

    result(path, "relight proxies --lights found.json --float --out found.exr");
    let (found, target) = (path.join("found.exr"), path.join("target.exr"));
    let psnr = metrics::psnr_reinhard(&read_picture(&found).unwrap(), &read_picture(&target).unwrap());
    assert!(psnr > 20.0, "{psnr} dB");
}

#[test]
fn another_world_is_gathered_as_if_it_had_been_baked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    trace_room(path, "--out dark --width 32 --height 28 --samples 64");
    trace_room(path, "--out bright --width 32 --height 28 --samples 64 --world 0.5,1,2");
    let dark = data("evening.json");
    let gather = format!("--lights {} --no-denoise --float", dark.display());
    result(path, &format!("gather dark {gather} --world 0.5,1,2 --out gathered.exr"));
    result(path, &format!("gather bright {gather} --out baked.exr"));
    // A grey environment map times the same colour is the same world.
    let grey = relume_session::image::Image {
        data: vec![1.0; 8 * 4 * 3],
        ..relume_session::image::Image::new(8, 4, 3)
    };
    let map = relume_session::image::LayeredImage {
        width: 8,
        height: 4,
        layers: vec![relume_session::image::Layer::color("Combined", grey)],
        ..Default::default()
    };
    let precision = relume_session::image::Precision::Float;
    relume_session::image::write_exr(&path.join("map.exr"), &map, precision).unwrap();
    result(path, &format!("gather dark {gather} --world 0.5,1,2 --environment map.exr --out mapped.exr"));

    let world = |file: &str| read_exr(&path.join(file)).unwrap().get("world").unwrap().clone();
    let (gathered, baked, mapped) = (world("gathered.exr"), world("baked.exr"), world("mapped.exr"));
    let mean =
        |image: &relume_session::image::Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
    assert!((mean(&gathered) / mean(&baked) - 1.0).abs() < 0.03, "{} for {}", mean(&gathered), mean(&baked));
    assert!((mean(&mapped) / mean(&gathered) - 1.0).abs() < 1e-4);
}

#[test]
fn info_and_validate_know_what_was_made() {
    let folder = tempfile::tempdir().unwrap();
    let lights = data("evening.json");
    let options = format!("--out bake --width 16 --height 16 --samples 4 --lights {}", lights.display());
    trace_room(folder.path(), &options);
    let info = result(folder.path(), "info bake");
    assert_eq!(info["type"], "bake");
    assert_eq!(info["lights"], serde_json::json!(["Key", "Rim.001"]));
    assert_eq!(result(folder.path(), "validate bake")["problems"], serde_json::json!([]));
    // The scene's own lights are what an unnamed light set means.
    let relit = result(folder.path(), "relight bake --no-denoise --out own.exr");
    assert_eq!(relit["lights"].as_array().unwrap().len(), 2);
}

#[test]
fn help_and_version_succeed() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in ["--help", "--version", "relight --help"] {
        assert!(run(folder.path(), arguments).status.success());
    }
}
