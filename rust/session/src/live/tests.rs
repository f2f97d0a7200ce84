mod catcher;
mod drag;
mod folders;
mod world;

use super::view::{BakeView, Delivered};
use super::*;
use crate::bake::bake;
use crate::device::compute::Compute;
use crate::device::gather::{DeviceGather, Haste};
use crate::files::light_set::LightSet;
use crate::files::names::SCENE_FILE;
use crate::files::obj_scene::{ObjView, obj_scene};
use crate::progress::Monitor;
use crate::relight::frame::with_alpha;
use crate::relight::options::RelightOptions;
use crate::relight::relighter::{OpenScenes, Relighter};
use crate::relight::source::{Method, UnitSource};
use crate::relight::units::UnitCache;
use crate::test_room;
use glam::Vec3;
use relume_dump::Dump;
use relume_gather::{Gather, SampleSplit};
use relume_image::{Image, metrics};
use relume_scene::{Light, LightShape};

/// The room of the tests, with a size in pixels.
fn room(width: usize, height: usize) -> Arc<Scene> {
    let view = ObjView {
        up: relume_scene::UpAxis::Z,
        eye: Some(Vec3::new(0.0, -4.2, 1.0)),
        target: Some(Vec3::Z),
        width,
        height,
        ..ObjView::default()
    };
    Arc::new(obj_scene(&test_room::room(), &view).unwrap())
}

fn settings(samples: u32) -> TraceSettings {
    TraceSettings { samples, tile_size: 16, threads: 2, ..TraceSettings::default() }
}

fn live(folder: &Path) -> Live {
    Live::new(folder, LiveOptions { device: Device::Cpu, threads: 2, ..LiveOptions::default() })
}

/// A bake that is open: pictures from now on are the best that there are of it, since no work goes on beside the render thread.
fn opened(folder: &Path, device: Device) -> Live {
    let live = Live::new(folder, LiveOptions { device, threads: 2, ..LiveOptions::default() });
    live.open(0.0).unwrap();
    state(&live, LiveState::Ready);
    live
}

fn lamp(x: f32) -> Light {
    let shape = LightShape::Sphere { center: Vec3::new(x, 0.0, 1.5), radius: 0.3 };
    Light { radiance: [3.0, 2.0, 1.0], name: "light".into(), ..Light::unit(shape) }
}

fn request(lights: &[Light]) -> LiveRequest {
    let set = LightSet { lights: lights.to_vec(), ..LightSet::default() };
    let json = serde_json::json!({ "lights": set }).to_string();
    LiveRequest::parse(&json).unwrap()
}

fn wait<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        match ask() {
            Some(answer) => return answer,
            None => assert!(start.elapsed() < Duration::from_secs(120), "{what} did not come"),
        }
        thread::sleep(Duration::from_millis(2));
    }
}

fn state(live: &Live, state: LiveState) -> LiveStatus {
    wait(&format!("{state:?}"), || Some(live.status()).filter(|status| status.state == state))
}

/// The final frame of a request.
fn settled(live: &Live, request: u64) -> Arc<Frame> {
    wait("the final frame", || {
        live.frame(0).filter(|frame| frame.shown.request == request && frame.shown.settled)
    })
}

/// The first frame of a drag that shows a light.
fn dragged(live: &Live, light: &Light) -> Arc<Frame> {
    let number = live.relight(LiveRequest {
        interactive: true,
        half: Some(false),
        ..request(std::slice::from_ref(light))
    });
    wait("a frame of the drag", || live.frame(0).filter(|frame| frame.shown.request == number))
}

#[test]
fn a_light_gathered_pass_by_pass_is_the_light_gathered_at_once() {
    let folder = tempfile::tempdir().unwrap();
    bake(&room(24, 16), &settings(13), folder.path(), false, &Monitor::default()).unwrap();
    let dump = Dump::open(folder.path()).unwrap();
    let lights = [lamp(0.3), lamp(-0.4)];
    let gather = Gather::new(dump.clone());
    let whole = gather.unit_images(&gather.prepare_all(&lights).unwrap(), SampleSplit::All);

    let shared = Shared::default();
    shared.change(|state| state.dump = Some(dump));
    let compute = Compute::default();
    let view = BakeView::new(Delivered::take(&mut shared.lock()), &compute, None).unwrap();
    let mut units = UnitCache::default();
    let mut rounds = 0;
    let gather = |pass: &DeviceGather, lights: &[Light]| {
        pass.unit_parts(lights, Haste::NONE, &compute, &Monitor::default())
    };
    while units.advance(&lights, &view.passes, gather).unwrap() {
        rounds += 1;
    }
    assert_eq!((rounds, view.samples()), (view.passes.len(), 13));
    for (light, whole) in lights.iter().zip(&whole) {
        let unit = units.get(light).unwrap();
        let brightest = whole.data.iter().fold(0.0_f32, |a, b| a.max(*b));
        assert!(brightest > 0.0 && unit.gathered.samples == 13);
        for (a, b) in unit.gathered.noisy().unwrap().data.iter().zip(&whole.data) {
            // Each of the five passes rounds the running mean once or twice.
            assert!((a - b).abs() <= 10.0 * f32::EPSILON * brightest, "{a} {b}");
        }
    }
}

/// Picture by [`Relighter`], as for F12.
fn relit(folder: &Path, scene: Arc<Scene>, lights: &[Light]) -> Image {
    let lights = request(lights).lights;
    let mut relighter = Relighter::open(folder).unwrap();
    relighter.connect(scene).unwrap();
    relighter.relight(&lights, &RelightOptions::default(), &Monitor::default()).unwrap().combined()
}

#[test]
fn a_picture_at_rest_is_the_one_that_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(folder.path());
    let lights = [lamp(0.3), Light { name: "other".into(), ..lamp(-0.4) }];
    live.relight(request(&lights));
    // Albedo and normals of the first pass are renewed at four and at sixteen samples, not at the last.
    live.bake(room(48, 32), settings(24), 1.0, false).unwrap();
    state(&live, LiveState::Ready);
    wait("the last picture", || live.status().shown.filter(|shown| shown.settled));
    let before = live.frame(0).unwrap();
    let less = settled(&live, live.relight(request(&lights[1..])));
    for (shown, lights) in [(before, &lights[..]), (less, &lights[1..])] {
        let rendered = relit(folder.path(), room(48, 32), lights);
        let brightest = rendered.data.iter().fold(0.0_f32, |a, b| a.max(*b));
        let rows = rendered.data.chunks_exact(48 * 3).rev().flatten();
        let colors = shown.image.data.as_chunks::<4>().0.iter().flat_map(|[rgb @ .., _]| rgb);
        for (shown, rendered) in colors.zip(rows) {
            assert!((shown - rendered).abs() <= 1e-3 * brightest, "{shown} {rendered} of {brightest}");
        }
    }
}

#[test]
fn noise_of_settled_frames_is_that_of_their_samples() {
    let folder = tempfile::tempdir().unwrap();
    let (few, many) = (folder.path().join("few"), folder.path().join("many"));
    bake(&room(32, 24), &settings(16), &few, false, &Monitor::default()).unwrap();
    let other_paths = TraceSettings { seed: 7, ..settings(2048) };
    bake(&room(32, 24), &other_paths, &many, false, &Monitor::default()).unwrap();
    let lights = [lamp(0.3), lamp(-0.4)];
    let [seen, reference] = [&few, &many].map(|folder| {
        let mut relighter = Relighter::open(folder).unwrap();
        relighter.connect_stored(&Monitor::default());
        let options = RelightOptions { denoise: false, ..RelightOptions::default() };
        let relit = relighter.relight(&lights, &options, &Monitor::default()).unwrap();
        let mut sum = relit.lights[0].image.clone();
        sum.add_scaled(&relit.lights[1].image, &[1.0; 3]);
        sum
    });
    let live = opened(&few, Device::Cpu);
    let frame = settled(&live, live.relight(request(&lights)));
    let noise = metrics::smape(&seen, &reference) as f32;
    let estimate = frame.shown.noise.expect("an estimate");
    assert!((0.5..2.0).contains(&(estimate / noise)), "estimated {estimate}, it is {noise}");
    let dark = settled(&live, live.relight(request(&[])));
    assert_eq!(dark.shown.noise, None, "nothing is summed");
    assert!(dark.shown.denoised, "what the scene itself emits");
}

#[test]
fn frames_grow_settle_and_answer_the_newest_request() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(folder.path());
    live.relight(request(&[lamp(0.0)]));
    live.bake(room(24, 16), settings(16), 0.0, false).unwrap();
    let first = wait("a first frame", || live.frame(0));
    assert!(first.shown.samples >= 1 && first.image.channels == 4);
    assert_eq!(state(&live, LiveState::Ready).samples, 16);

    for x in 0..20 {
        live.relight(LiveRequest { interactive: true, ..request(&[lamp(x as f32 / 40.0)]) });
    }
    let number = live.relight(request(&[lamp(0.5)]));
    let frame = settled(&live, number);
    assert_eq!((frame.shown.samples, frame.shown.scale), (16, 1));
    assert_eq!(frame.shown.sources["light"], UnitSource::GatherDenoised);
    assert!(live.frame(frame.shown.serial).is_none());

    // Twice the light on top of what the scene itself emits.
    let dark = settled(&live, live.relight(request(&[])));
    let twice = Light { radiance: [6.0, 4.0, 2.0], ..lamp(0.5) };
    let bright = settled(&live, live.relight(request(&[twice])));
    for ((dark, once), twice) in dark.image.data.iter().zip(&frame.image.data).zip(&bright.image.data) {
        assert!((2.0 * once - dark - twice).abs() <= 1e-5 * twice.abs().max(1.0), "{dark} {once} {twice}");
    }
}

#[test]
fn cancelled_bake_is_shown_and_goes_on_to_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, cut) = (folder.path().join("whole"), folder.path().join("cut"));
    let towards = TraceSettings { guide_targets: vec![lamp(0.0)], ..settings(64) };
    bake(&room(48, 32), &towards, &whole, false, &Monitor::default()).unwrap();

    let live = live(&cut);
    live.relight(request(&[lamp(0.0)]));
    live.bake(room(48, 32), settings(64), 0.0, false).unwrap();
    assert!(live.bake(room(48, 32), settings(64), 0.0, false).is_err(), "two bakes at once");
    wait("some samples", || (live.status().samples >= 2).then_some(()));
    live.cancel();
    let status = state(&live, LiveState::Cancelled);
    assert!(status.samples < 64 && status.error.is_none(), "it was done before it was stopped");
    settled(&live, live.relight(LiveRequest { world: [0.5; 3], ..request(&[lamp(0.0)]) }));

    live.bake(room(48, 32), settings(64), 0.0, false).unwrap();
    state(&live, LiveState::Ready);
    let bytes = |folder: &Path| {
        let mut files: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files.iter().map(|path| std::fs::read(path).unwrap()).collect::<Vec<_>>()
    };
    assert!(bytes(&cut) == bytes(&whole), "the bakes differ");
}

#[test]
fn paused_work_stands_still_while_relighting_goes_on_and_closing_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(folder.path());
    live.relight(request(&[lamp(0.0)]));
    live.bake(room(96, 64), settings(4096), 0.0, false).unwrap();
    wait("a first frame", || live.frame(0));
    live.pause(true);
    thread::sleep(Duration::from_millis(300));
    let before = live.status();
    settled(&live, live.relight(request(&[lamp(0.1)])));
    let after = live.status();
    assert!(after.paused && after.stage.unwrap().done == before.stage.unwrap().done);
    live.close(Duration::from_secs(20));
    assert_eq!(live.status().state, LiveState::Cancelled);
    assert!(live.open(0.0).is_err());
}

#[test]
fn training_gives_a_proxy_that_stands_in_while_dragging() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(folder.path());
    live.relight(request(&[lamp(0.0)]));
    live.bake(room(32, 32), settings(128), 1.0, false).unwrap();
    assert_eq!(state(&live, LiveState::Training).samples, 64, "the first training waited for all samples");
    let status = state(&live, LiveState::Ready);
    assert_eq!((status.samples, status.samples_total), (128, 128));
    assert!(status.proxies["sphere"].psnr > 0.0, "{status:?}");
    let mut moved = lamp(0.25);
    moved.lobes.camera = 1.0;
    std::fs::remove_file(folder.path().join(SCENE_FILE)).unwrap();
    let without_scene = opened(folder.path(), Device::Cpu);
    let frame = dragged(&without_scene, &moved);
    assert_eq!(frame.shown.sources["light"], UnitSource::Proxy);
    let summed = settled(&without_scene, without_scene.relight(request(&[moved])));
    let [dragged, still] =
        [&frame, &summed].map(|frame| frame.image.data.iter().copied().fold(0.0, f32::max));
    assert!(
        still > 2.5 && (dragged - still).abs() < 0.2 * still,
        "the lamp is seen itself: {dragged}, {still}"
    );

    let states = |seconds: f64| {
        live.bake(room(32, 32), settings(128), seconds, false).unwrap();
        let mut trained = false;
        wait("the end", || {
            let state = live.status().state;
            trained |= state == LiveState::Training;
            (state == LiveState::Ready).then_some(trained)
        })
    };
    assert!(!states(1.0), "a proxy that is there was trained again");
    assert!(states(2.0), "a longer training was not done");

    let sphere = |center: Vec3, radius: f32| LightShape::Sphere { center, radius };
    let direction = Vec3::NEG_Z;
    for (name, shape, reason) in [
        ("Sun", LightShape::Sun { direction, half_angle: 0.01 }, "no proxy has learned lights such as 'Sun'"),
        ("Huge", sphere(Vec3::Z, 3.0), "sizes of"),
        ("Far", sphere(Vec3::new(0.0, 0.0, 40.0), 0.3), "places of"),
    ] {
        let light = Light { name: name.into(), ..Light::unit(shape) };
        let frame = settled(&live, live.relight(request(&[light])));
        assert_eq!(frame.shown.sources[name], UnitSource::GatherDenoised);
        let warnings = live.status().warnings;
        let said = |warning: &String| warning.contains(&format!("'{name}'")) && warning.contains(reason);
        assert!(warnings.iter().any(said), "{warnings:?}");
        let number = live.relight(LiveRequest { method: Method::Proxy, ..request(&[lamp(0.0)]) });
        settled(&live, number);
        assert!(live.status().warnings.is_empty(), "what was said of another light stays");
    }
    let guess = LiveRequest { method: Method::Proxy, ..request(&[lamp(40.0)]) };
    settled(&live, live.relight(guess));
    let warnings = live.status().warnings;
    assert!(warnings.iter().any(|warning| warning.contains("is a guess")), "{warnings:?}");
}

#[test]
fn kinds_of_light_that_come_into_use_later_are_learned_too() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(folder.path());
    let of = |name: &str, shape: LightShape| Light { name: name.into(), ..Light::unit(shape) };
    let (edge_u, edge_v) = (4.0 * Vec3::X, Vec3::Y);
    let quad =
        of("Rim", LightShape::Quad { center: 1.5 * Vec3::Z, edge_u, edge_v, spread: std::f32::consts::PI });
    let (center, radius) = (1.5 * Vec3::Z, 0.2);
    let point = of("Bulb", LightShape::FacingDisk { center, radius });
    let spot = LightShape::Spot {
        center,
        radius,
        axis: Vec3::NEG_Z,
        half_angle: 0.5,
        blend: 0.2,
        soft_falloff: true,
    };
    let spot = of("Spot", spot);
    let kinds = |status: LiveStatus| status.proxies.into_keys().collect::<Vec<_>>();

    live.relight(request(&[lamp(0.0)]));
    live.bake(room(32, 32), settings(16), 1.0, false).unwrap();
    state(&live, LiveState::Training);
    live.relight(request(&[lamp(0.0), quad.clone()]));
    assert_eq!(kinds(state(&live, LiveState::Ready)), ["quad", "sphere"], "added while another was learned");
    let info = relume_proxy::read_info(&folder.path().join("proxy_quad.safetensors")).unwrap();
    assert_eq!(info.size.max, 6.0, "the light that is there is among what was learned");

    let lights = [lamp(0.0), quad, point, spot.clone()];
    live.relight(LiveRequest { interactive: true, ..request(&lights) });
    assert!(live.status().unlearned.is_empty(), "it is being dragged still");
    live.relight(request(&lights));
    assert_eq!(live.status().unlearned, ["facing-disk", "spot"]);
    live.learn(1.0).unwrap();
    assert_eq!(live.status().state, LiveState::Training);
    assert!(live.learn(1.0).is_err(), "twice at once");
    let status = state(&live, LiveState::Ready);
    assert!(status.unlearned.is_empty());
    assert_eq!(kinds(status), ["facing-disk", "quad", "sphere", "spot"]);
    let by_proxy = LiveRequest { method: Method::Proxy, ..request(&[spot]) };
    assert_eq!(settled(&live, live.relight(by_proxy)).shown.sources["Spot"], UnitSource::Proxy);
}

#[test]
fn aovs_are_shown_in_place_of_the_lights() {
    let folder = tempfile::tempdir().unwrap();
    bake(&room(24, 16), &settings(8), folder.path(), false, &Monitor::default()).unwrap();
    let live = opened(folder.path(), Device::Cpu);
    let lit = settled(&live, live.relight(request(&[lamp(0.0)])));
    let aovs = Dump::open(folder.path()).unwrap().aovs();
    for (aov, rgb) in [(Aov::Albedo, &aovs.albedo), (Aov::Normal, &aovs.normal)] {
        let asked = LiveRequest { aov: Some(aov), ..request(&[lamp(0.0)]) };
        let frame = settled(&live, live.relight(asked));
        assert_eq!(frame.image, with_alpha(rgb, &aovs.alpha));
        assert_eq!((frame.shown.scale, frame.shown.samples, frame.shown.sources.len()), (1, 8, 0));
        assert!(!frame.shown.denoised);
    }
    assert_eq!(settled(&live, live.relight(request(&[lamp(0.0)]))).image, lit.image);
}

#[test]
fn both_devices_show_the_same() {
    let folder = tempfile::tempdir().unwrap();
    bake(&room(24, 16), &settings(8), folder.path(), false, &Monitor::default()).unwrap();
    let picture = |device: Device| {
        let live = opened(folder.path(), device);
        let frame = settled(&live, live.relight(request(&[lamp(0.3)])));
        (frame.image.clone(), live.status())
    };
    let (cpu, on_cpu) = picture(Device::Cpu);
    let (gpu, on_gpu) = picture(Device::Gpu(relume_gpu::GpuChoice::Best));
    assert!(on_cpu.device.starts_with("CPU") && on_gpu.device != on_cpu.device, "{}", on_gpu.device);
    assert_eq!(on_gpu.warnings, on_cpu.warnings);
    // Sums differ by their order; the denoiser takes such differences as they are, up to its half floats.
    let brightest = cpu.data.iter().fold(0.0_f32, |a, b| a.max(*b));
    for (a, b) in cpu.data.iter().zip(&gpu.data) {
        assert!((a - b).abs() <= 1e-3 * brightest, "{a} {b} of {brightest}");
    }
}

#[test]
fn mistakes_are_told_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(&folder.path().join("nothing"));
    live.open(0.0).unwrap();
    let error = state(&live, LiveState::Failed).error.unwrap();
    assert!(error.contains("nothing") && !error.contains('\n'), "{error}");

    let lights = r#"[{"name": "Key", "shape": {"type": "sphere", "center": [0, 1, 2], "radius": -1}, "radiance": [5, 4, 3]}]"#;
    let bright = lights.replace("-1", "1").replace("[5, 4, 3]", "[5e29, 4, 3]");
    for (json, word) in [
        (format!(r#"{{"lights": {lights}}}"#), "Key"),
        (format!(r#"{{"lights": {bright}, "gains": {{"Key": [4, 1, 1]}}}}"#), "exposure or multiplier"),
        (r#"{"lights": [], "lamps": 1}"#.into(), "lamps"),
        (r#"{"lights": [], "world": [1, 1]}"#.into(), "length"),
        (r#"{"lights": [], "aov": "mist"}"#.into(), "mist"),
        ("{".into(), "EOF"),
    ] {
        let message = LiveRequest::parse(&json).unwrap_err();
        assert!(message.contains(word), "{message}");
    }
}
