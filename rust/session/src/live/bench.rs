//! What an edit costs.

use super::render_thread::RenderThread;
use super::shared::Shared;
use super::{LiveOptions, LiveRequest};
use crate::bench::closed_box;
use crate::device::compute::Compute;
use crate::error::SessionError;
use crate::relight::source::Method;
use glam::Vec3;
use relume_dump::{Dump, MemoryWriter};
use relume_gpu::Gpu;
use relume_scene::{Light, LightShape};
use relume_trace::{Control, TraceSettings, Tracer};
use std::sync::Arc;
use std::time::Instant;

/// Lights of [`strength_edit`].
pub const LIGHTS: usize = 20;

/// Seconds from a request that changes the strength of one of [`LIGHTS`] lights, while that is dragged, to its picture, and bytes
/// that are copied to the CPU meanwhile.
pub fn strength_edit(gpu: &Arc<Gpu>, size: (usize, usize)) -> Result<(f64, f64), SessionError> {
    const EDITS: usize = 20;
    let mut shot = Shot::new(boxed(size, 4)?, Compute::with(Arc::clone(gpu), false));
    let mut lights = bulbs(LIGHTS);
    shot.render(still(&lights))?;
    let before = gpu.bytes_read();
    let start = Instant::now();
    for edit in 0..EDITS {
        lights[0].radiance = [1.0 + edit as f32; 3];
        shot.render(dragged(&lights))?;
    }
    let bytes = gpu.bytes_read() - before;
    Ok((start.elapsed().as_secs_f64() / EDITS as f64, bytes as f64 / EDITS as f64))
}

/// Render thread without threads: whoever asks paints.
pub(super) struct Shot {
    pub shared: Arc<Shared>,
    render_thread: RenderThread,
}

impl Shot {
    pub fn new(dump: Dump, compute: Compute) -> Self {
        let shared = Arc::new(Shared::default());
        shared.change(|state| {
            state.dump = Some(dump);
            state.deliveries = 1;
        });
        let render_thread = RenderThread::new(shared.clone(), LiveOptions::default()).on(compute);
        Self { shared, render_thread }
    }

    /// Makes the pictures of a request.
    pub fn render(&mut self, request: LiveRequest) -> Result<(), SessionError> {
        self.shared.ask(request);
        self.render_thread.render_next();
        self.shared.lock().picture_error.clone().map_or(Ok(()), |error| Err(SessionError::Settings(error)))
    }
}

/// Paths in a closed grey box.
pub fn boxed(size: (usize, usize), samples: u32) -> Result<Dump, SessionError> {
    let settings = TraceSettings { samples, ..TraceSettings::default() };
    let scene = closed_box(size)?;
    let tracer = Tracer::new(&scene, &settings)?;
    let writer = MemoryWriter::new(tracer.manifest())?;
    tracer.trace(&writer, &Control::default())?;
    Ok(writer.snapshot())
}

/// Lights in that box.
pub fn bulbs(count: usize) -> Vec<Light> {
    let bulb = |i: usize| {
        let around = i as f32 / count as f32 * std::f32::consts::TAU;
        let center = Vec3::new(0.6 * around.cos(), 0.6 * around.sin(), -0.5);
        Light { name: format!("Bulb {i}"), ..Light::unit(LightShape::Sphere { center, radius: 0.15 }) }
    };
    (0..count).map(bulb).collect()
}

/// The picture of some lights as good as it gets.
pub(super) fn still(lights: &[Light]) -> LiveRequest {
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
pub(super) fn dragged(lights: &[Light]) -> LiveRequest {
    LiveRequest { interactive: true, half: Some(false), ..still(lights) }
}
