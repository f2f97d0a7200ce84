//! Units that stay on the GPU give the pictures of those on the CPU, and little is copied from there.

use super::LiveOptions;
use super::LiveRequest;
use super::render_thread::RenderThread;
use super::shared::Shared;
use crate::device::compute::Compute;
use crate::error::SessionError;
use crate::relight::source::{Method, UnitSource};
use crate::test_box::{boxed, bulbs};
use relume_dump::Dump;
use relume_gpu::{Gpu, GpuChoice};
use relume_image::Image;
use relume_scene::Light;
use std::sync::Arc;

const SIZE: (usize, usize) = (24, 16);
/// Bytes of a picture.
const PICTURE: u64 = 24 * 16 * 3 * 4;

fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
}

/// Three passes.
fn dump(size: (usize, usize)) -> Dump {
    let dump = boxed(size, 4).unwrap();
    assert_eq!(dump.manifest().passes.len(), 3);
    dump
}

fn on(gpu: &Arc<Gpu>, dump: &Dump) -> Shot {
    Shot::new(dump.clone(), Compute::with(Arc::clone(gpu), false))
}

/// Render thread that renders on the thread of the caller.
struct Shot {
    shared: Arc<Shared>,
    render_thread: RenderThread,
}

impl Shot {
    fn new(dump: Dump, compute: Compute) -> Self {
        let shared = Arc::new(Shared::default());
        shared.change(|state| {
            state.dump = Some(dump);
            state.deliveries = 1;
        });
        let options = LiveOptions::default();
        let seat = options.board.seat();
        let render_thread = RenderThread::new(shared.clone(), options, seat).on(compute);
        Self { shared, render_thread }
    }

    /// Makes the pictures of a request.
    fn render(&mut self, request: LiveRequest) -> Result<(), SessionError> {
        self.shared.ask(request);
        self.render_thread.render_next();
        self.shared.lock().picture_error.clone().map_or(Ok(()), |error| Err(SessionError::Settings(error)))
    }

    fn picture(&mut self, request: LiveRequest) -> Image {
        self.render(request).unwrap();
        self.shared.lock().frame.as_ref().unwrap().image.clone()
    }

    fn noise(&self) -> Option<f32> {
        self.shared.lock().frame.as_ref().unwrap().shown.noise
    }

    /// Denoised pictures of a light; none where the library is missing.
    fn denoised(&self) -> u64 {
        u64::from(
            self.shared.lock().frame.as_ref().unwrap().shown.sources["Bulb 0"] == UnitSource::GatherDenoised,
        )
    }

    /// But for that of a denoiser: builds for bare machines have none.
    fn warnings(&self) -> Vec<String> {
        let all = self.shared.status().warnings;
        all.into_iter().filter(|text| !text.contains("has no denoiser")).collect()
    }
}

/// The picture of some lights as good as it gets.
fn still(lights: &[Light]) -> LiveRequest {
    LiveRequest {
        lights: lights.to_vec(),
        world: [1.0; 3],
        static_light: [1.0; 3],
        interactive: false,
        half: None,
        method: Method::Gather,
        aov: None,
        notes: Vec::new(),
    }
}

/// One of a drag, of the full size.
fn dragged(lights: &[Light]) -> LiveRequest {
    LiveRequest { interactive: true, half: Some(false), ..still(lights) }
}

/// Sums differ by their order; denoisers take such differences as they are, up to their half floats.
fn assert_same(found: &Image, expected: &Image) {
    assert!(found.same_shape(expected));
    let brightest = expected.data.iter().fold(0.0_f32, |a, b| a.max(*b));
    for (a, b) in found.data.iter().zip(&expected.data) {
        assert!((a - b).abs() <= 1e-3 * brightest, "{a} {b} of {brightest}");
    }
}

fn brighter(lights: &[Light], factor: f32) -> Vec<Light> {
    let brighter = |light: &Light| Light { radiance: light.radiance.map(|r| r * factor), ..light.clone() };
    lights.iter().map(brighter).collect()
}

#[test]
fn an_edit_copies_one_picture_however_many_lights_there_are() {
    let (gpu, dump) = (gpu(), dump(SIZE));
    let (mut shot, mut cpu) = (on(&gpu, &dump), Shot::new(dump, Compute::default()));
    // Bytes that are copied for a request, and whether it is said how noisy its picture is.
    let mut pictures = |request: LiveRequest| {
        let before = gpu.bytes_read();
        let picture = shot.picture(request.clone());
        let copied = gpu.bytes_read() - before;
        assert_same(&picture, &cpu.picture(request));
        let (found, expected) = (shot.noise(), cpu.noise());
        assert!(found.zip(expected).map_or(found == expected, |(a, b)| (a / b - 1.0).abs() < 1e-3));
        (copied, found.is_some())
    };
    let mut lights = bulbs(12);
    let (copied, noise) = pictures(still(&lights));
    assert!(copied > PICTURE && noise);
    // Strengths are edited: a picture of what was denoised before, and once the mouse button is up one of the noise.
    assert_eq!(pictures(dragged(&brighter(&lights, 2.0))), (PICTURE, false));
    assert_eq!(pictures(still(&brighter(&lights, 3.0))), (2 * PICTURE, true));
    // One is deleted, one comes back.
    assert_eq!(pictures(dragged(&lights[1..])), (PICTURE, false));
    assert_eq!(pictures(dragged(&lights)), (PICTURE, false));
    // One is turned on that was not seen before, and has to be denoised: a picture of it, and one of all others.
    lights.push(bulbs(5).remove(1));
    let before = gpu.bytes_read();
    shot.render(dragged(&lights)).unwrap();
    assert_eq!(gpu.bytes_read() - before, (1 + shot.denoised()) * PICTURE);
    assert!(shot.warnings().is_empty());
}

#[test]
fn half_of_the_size_is_summed_there_too() {
    let (gpu, dump) = (gpu(), dump((130, 129)));
    let (mut shot, mut cpu) = (on(&gpu, &dump), Shot::new(dump, Compute::default()));
    let lights = bulbs(3);
    assert_same(&shot.picture(still(&lights)), &cpu.picture(still(&lights)));
    let half = LiveRequest { half: Some(true), ..dragged(&brighter(&lights, 2.0)) };
    let before = gpu.bytes_read();
    let found = shot.picture(half.clone());
    assert_eq!((found.width, found.height), (65, 64));
    assert_eq!(gpu.bytes_read() - before, 65 * 64 * 3 * 4);
    assert_same(&found, &cpu.picture(half));
}

#[test]
fn what_has_no_room_on_the_gpu_is_kept_by_the_cpu() {
    let (gpu, dump) = (gpu(), dump(SIZE));
    let lights = bulbs(6);
    let pictures = |shot: &mut Shot| {
        [still(&lights), dragged(&brighter(&lights, 2.0))].map(|request| shot.picture(request))
    };
    let expected = pictures(&mut Shot::new(dump.clone(), Compute::default()));
    let roomy = gpu.free_memory();
    let mut full = on(&gpu, &dump);

    // Room for gathering, but for no picture beside it.
    gpu.set_memory_budget(Some(32 * PICTURE));
    let mut narrow = on(&gpu, &dump);
    let found = pictures(&mut narrow);
    found.iter().zip(&expected).for_each(|(found, expected)| assert_same(found, expected));
    let before = gpu.bytes_read();
    narrow.render(dragged(&lights)).unwrap();
    assert_eq!(gpu.bytes_read(), before);

    // Memory that is gone when all is there.
    gpu.set_memory_budget(Some(roomy));
    assert_same(&full.picture(still(&lights)), &expected[0]);
    gpu.set_memory_budget(Some(0));
    let before = gpu.bytes_read();
    assert_same(&full.picture(dragged(&brighter(&lights, 2.0))), &expected[1]);
    // Means, errors, and what was denoised.
    assert_eq!(gpu.bytes_read() - before, (2 + full.denoised()) * 6 * PICTURE);
    gpu.set_memory_budget(Some(roomy));
    assert_same(&full.picture(still(&lights)), &expected[0]);
    assert!(narrow.warnings().is_empty() && full.warnings().is_empty());
}

#[test]
fn units_on_a_gpu_that_was_lost_are_made_anew_by_the_cpu_or_it_is_said() {
    let dump = dump(SIZE);
    let lights = bulbs(4);
    let bright = still(&brighter(&lights, 2.0));
    let expected = Shot::new(dump.clone(), Compute::default()).picture(bright.clone());
    for may_fall_back in [true, false] {
        let gpu = gpu();
        let mut shot = Shot::new(dump.clone(), Compute::with(gpu.clone(), may_fall_back));
        shot.render(still(&lights)).unwrap();
        gpu.lose();
        if may_fall_back {
            assert_same(&shot.picture(bright.clone()), &expected);
            let warnings = shot.warnings();
            assert!(warnings.len() == 1 && warnings[0].contains("The CPU goes on"), "{warnings:?}");
        } else {
            let error = shot.render(bright.clone()).unwrap_err().to_string();
            assert!(error.contains("the GPU was lost"), "{error}");
        }
    }
}
