//! The room of the tests, its pictures, and what is asked of the solver.

use glam::Vec3;
use relume_session::image::Image;
use relume_session::scene::{Light, LightShape, Scene, UpAxis};
use relume_session::trace::TraceSettings;
use relume_session::{
    Method, Monitor, ObjView, Pictures, RelightOptions, Relighter, SessionError, SolveRequest, Solved, bake,
    obj_scene, solve_lights,
};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

const ROOM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/room.obj");
pub const GATHER: RelightOptions = RelightOptions { method: Method::Gather, denoise: true, lobes: false };

/// A bake of the room, seen from a little to the left (-1) or right (1). All tests of a run share its files.
pub fn baked(side: f32) -> Relighter {
    let samples = TraceSettings { samples: 96, ..TraceSettings::default() };
    made_once(&format!("room-at-{side}"), &room(side, [0.0; 3]), &samples)
}

/// One of other paths, in a folder of its own.
pub fn traced(folder: &Path, side: f32, settings: &TraceSettings) {
    let scene = room(side, [0.0; 3]);
    bake(&scene, settings, folder, false, &Monitor::default()).unwrap();
}

/// The room under a world of this colour.
pub fn room(side: f32, world: [f32; 3]) -> Scene {
    let view = ObjView {
        world,
        up: UpAxis::Z,
        eye: Some(Vec3::new(0.05 * side, -4.2, 1.0)),
        target: Some(Vec3::Z),
        width: 96,
        height: 72,
        ..ObjView::default()
    };
    obj_scene(Path::new(ROOM), &view).unwrap()
}

/// Two bakes of the room from the same place: one to solve with, one of more and other paths for the targets. Their
/// noise differs.
pub struct Bakes {
    pub own: Relighter,
    pub other: Relighter,
}

impl Bakes {
    /// All tests of a run share their files.
    pub fn open() -> Self {
        let samples = TraceSettings { samples: 384, ..TraceSettings::default() };
        Self::of("room", &room(0.0, [0.0; 3]), &samples)
    }

    /// Room with twice as many pixels along each edge.
    pub fn large() -> Self {
        let mut scene = room(0.0, [0.0; 3]);
        (scene.camera.width, scene.camera.height) = (2 * scene.camera.width, 2 * scene.camera.height);
        let samples = TraceSettings { samples: 192, ..TraceSettings::default() };
        Self::of("large-room", &scene, &samples)
    }

    fn of(name: &str, scene: &Scene, own: &TraceSettings) -> Self {
        let other = TraceSettings { seed: 1, ..own.clone() };
        let [own, other] = [("own", own), ("other", &other)]
            .map(|(paths, settings)| made_once(&format!("{name}-{paths}"), scene, settings));
        Self { own, other }
    }
}

fn made_once(name: &str, scene: &Scene, settings: &TraceSettings) -> Relighter {
    static MADE: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("solve-{name}"));
    if !made.iter().any(|other| other == name) {
        std::fs::remove_dir_all(&folder).ok();
        bake(scene, settings, &folder, false, &Monitor::default()).unwrap();
        made.push(name.into());
    }
    connected(&folder)
}

/// A bake whose lights are connected in its scene.
pub fn connected(folder: &Path) -> Relighter {
    let mut relighter = Relighter::open(folder).unwrap();
    relighter.connect_stored(&Monitor::default());
    relighter
}

pub fn light(name: &str, shape: LightShape, radiance: [f32; 3]) -> Light {
    Light { name: name.into(), radiance, ..Light::unit(shape) }
}

pub fn picture(relighter: &Relighter, lights: &[Light]) -> Image {
    relighter.relight(lights, &GATHER, &Monitor::default()).unwrap().combined()
}

pub fn solve(
    relighters: &[&Relighter],
    request: &Value,
    images: &[(&str, &Image)],
) -> Result<Solved, SessionError> {
    let request = SolveRequest::parse(&request.to_string()).map_err(SessionError::Settings)?;
    let named: HashMap<_, _> =
        images.iter().map(|(name, image)| (name.to_string(), (*image).clone())).collect();
    solve_lights(relighters, &request, &Pictures::named(named), &Monitor::default(), &|_| ())
}

pub fn key() -> Light {
    light("Key", LightShape::Sphere { center: Vec3::new(0.3, -0.1, 1.3), radius: 0.2 }, [12.0, 9.0, 6.0])
}

/// Bounds in which the room's lights are.
pub fn inside() -> Value {
    json!({"min": [-0.9, -0.9, 0.2], "max": [0.9, 0.9, 1.9], "size": [0.05, 0.6]})
}

pub fn target_request(extra: Value) -> Value {
    let mut request = json!({
        "goals": [{"goal": "target", "image": "target"}], "bounds": inside(), "starts": 3, "steps": 64
    });
    request.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    request
}
