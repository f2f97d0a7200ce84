//! Pictures of drags, on machines that are as slow as a test says.

use super::super::render_thread::{DragPace, RenderThread};
use super::*;
use crate::device::connections::Connections;
use crate::files::proxies::Proxies;
use crate::train::settings::{Clock, TrainSettings};
use crate::train::train;
use relume_proxy::{LightKind, SizeRange, TrainConfig};

const FOREVER: Duration = Duration::from_secs(1_000_000);

/// A bake of the room, and its scene.
fn baked(folder: &Path) -> Arc<Scene> {
    let scene = room(160, 128);
    bake(&scene, &settings(16), folder, false, &Monitor::default()).unwrap();
    scene
}

/// Trains a proxy of lamps for a moment.
fn learn(folder: &Path) {
    let settings = TrainSettings {
        kind: LightKind::Sphere,
        config: TrainConfig::fast(SizeRange { min: 0.2, max: 0.4 }),
        seed: 0,
        seconds: Some(0.5),
        clock: Clock::Wall,
        half_for_measuring: false,
    };
    train(folder, folder, &settings, false, &Compute::default(), &Monitor::default()).unwrap();
}

/// A bake whose pictures are made on the thread of the caller.
struct Shot {
    shared: Arc<Shared>,
    render_thread: RenderThread,
}

impl Shot {
    fn open(folder: &Path, scene: &Arc<Scene>, pace: DragPace) -> Self {
        let dump = Dump::open(folder).unwrap();
        let manifest = dump.manifest();
        let connections = Connections::new(scene.clone(), manifest, None, 1).unwrap();
        while connections.prepare_next(&|| false) {}
        let (proxies, _) = Proxies::open_usable(folder, &manifest.scene_hash);
        let shared = Arc::new(Shared::default());
        shared.change(|state| {
            state.dump = Some(dump);
            state.connections = Some(Arc::new(connections));
            state.proxies = Some(proxies);
            state.deliveries = 1;
        });
        let options = LiveOptions { device: Device::Cpu, ..LiveOptions::default() };
        let seat = options.board.seat();
        let render_thread = RenderThread::new(shared.clone(), options, seat).with_pace(pace);
        Self { shared, render_thread }
    }

    /// The last picture of a request.
    fn picture(&mut self, request: LiveRequest) -> Arc<Frame> {
        self.shared.ask(request);
        self.render_thread.render_next();
        let state = self.shared.lock();
        assert_eq!(state.picture_error, None);
        state.frame.clone().unwrap()
    }

    fn drag(&mut self, lights: &[Light]) -> Arc<Frame> {
        self.picture(LiveRequest { interactive: true, half: Some(false), ..request(lights) })
    }

    fn still(&mut self, lights: &[Light]) -> Arc<Frame> {
        self.picture(LiveRequest { method: Method::Gather, ..request(lights) })
    }
}

/// The pace after so many pictures that were late.
fn slowed(budget: Duration, late: u32) -> DragPace {
    let mut pace = DragPace::new(budget);
    (0..late).for_each(|_| pace.connected(FOREVER, pace.block(4), 4));
    pace
}

fn error(frame: &Frame, truth: &Frame) -> f64 {
    let values = frame.image.data.iter().zip(&truth.image.data);
    values.map(|(found, expected)| f64::from(found - expected).powi(2)).sum()
}

#[test]
fn a_drag_is_the_nearer_to_the_truth_the_quicker_the_machine_and_never_worse_than_the_proxy() {
    let folder = tempfile::tempdir().unwrap();
    let scene = baked(folder.path());
    learn(folder.path());
    let moved = [lamp(0.25)];
    // Late once or twice, it connects in blocks of two or four by two or four pixels; where each try is late, not at all.
    let paces =
        [slowed(FOREVER, 0), slowed(FOREVER / 2, 1), slowed(FOREVER / 2, 2), DragPace::new(Duration::ZERO)];
    let mut errors = Vec::new();
    for (number, pace) in paces.into_iter().enumerate() {
        let mut shot = Shot::open(folder.path(), &scene, pace);
        shot.still(&[lamp(0.0)]);
        let frame = shot.drag(&moved);
        let is_connected = frame.shown.sources["light"] == UnitSource::GatherDenoised;
        assert_eq!((is_connected, frame.shown.scale), (number < 3, 1));
        errors.push(error(&frame, &shot.still(&moved)));
    }
    assert!(errors.is_sorted(), "{errors:?}");
}

#[test]
fn lights_that_no_proxy_knows_are_connected_however_slow_the_machine_is() {
    let folder = tempfile::tempdir().unwrap();
    let scene = baked(folder.path());
    let lamps = |shift: f32| -> Vec<Light> {
        let lamp = |i: u16| Light { name: format!("Lamp {i}"), ..lamp(shift + f32::from(i) * 1e-2) };
        (0..16).map(lamp).collect()
    };
    let mut shot = Shot::open(folder.path(), &scene, DragPace::new(Duration::ZERO));
    let [here, there] = [lamps(0.0), lamps(0.3)].map(|lights| shot.still(&lights));
    assert!(error(&shot.drag(&lamps(0.3)), &there) < 1e-9, "they are there");
    let moved = shot.drag(&lamps(0.29));
    assert!(moved.shown.sources.values().all(|source| *source == UnitSource::GatherDenoised));
    assert!(error(&moved, &there) < 0.2 * error(&here, &there), "all were moved");
}

#[test]
fn of_several_lights_the_one_that_moved_is_shown_by_its_proxy_where_connecting_is_late() {
    let folder = tempfile::tempdir().unwrap();
    let scene = baked(folder.path());
    learn(folder.path());
    let mut lights = [lamp(0.0), Light { name: "other".into(), ..lamp(0.4) }];
    let mut shot = Shot::open(folder.path(), &scene, DragPace::new(Duration::ZERO));
    shot.still(&lights);
    lights[0] = lamp(0.1);
    let sources = shot.drag(&lights).shown.sources.clone();
    assert_eq!([&sources["light"], &sources["other"]], [&UnitSource::Proxy, &UnitSource::GatherDenoised]);
}

#[test]
fn pictures_of_half_the_size_are_those_of_drags_alone() {
    let folder = tempfile::tempdir().unwrap();
    let scene = baked(folder.path());
    let mut pace = DragPace::default();
    pace.shown(FOREVER);
    let mut shot = Shot::open(folder.path(), &scene, pace);
    let dragged = |half| LiveRequest { interactive: true, half, ..request(&[lamp(0.1)]) };
    let size = |frame: &Frame| (frame.shown.scale, frame.image.width, frame.image.height);
    shot.still(&[lamp(0.0)]);
    assert_eq!(size(&shot.picture(dragged(None))), (2, 80, 64), "after a slow one");
    assert_eq!(size(&shot.picture(dragged(Some(false)))), (1, 160, 128), "asked for");
    assert_eq!(size(&shot.picture(dragged(Some(true)))), (2, 80, 64), "asked for");
    assert_eq!(size(&shot.still(&[lamp(0.1)])), (1, 160, 128), "still");
}
