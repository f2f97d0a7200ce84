//! The strength of a light dragged in a live shot.

use crate::scenes::{bulbs, closed_box};
use anyhow::bail;
use relume_gpu::Gpu;
use relume_scene::Light;
use relume_session::live::{Live, LiveOptions, LiveRequest, LiveState};
use relume_session::{Device, Method};
use relume_trace::TraceSettings;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Lights of [`strength_edit`].
pub const LIGHTS: usize = 20;
/// Longest wait for a bake or a picture.
const PATIENCE: Duration = Duration::from_secs(600);

/// Seconds from a request that changes the strength of one of [`LIGHTS`] lights, while that is dragged, to its picture, and bytes
/// that are copied to the CPU meanwhile. `gpu` is the open device.
pub fn strength_edit(
    device: &Device,
    gpu: &Gpu,
    (width, height): (usize, usize),
) -> anyhow::Result<(f64, f64)> {
    const EDITS: usize = 20;
    let folder = tempfile::tempdir()?;
    let live = Live::new(folder.path(), LiveOptions { device: device.clone(), ..LiveOptions::default() });
    let settings = TraceSettings { samples: 4, ..TraceSettings::default() };
    live.bake(Arc::new(closed_box((width, height))?), settings, 0.0, false)?;
    wait_for_bake(&live)?;
    let mut lights = bulbs(LIGHTS);
    let mut shown = wait_for_picture(&live, live.relight(still(&lights)), 0)?;
    let before = gpu.bytes_read();
    let start = Instant::now();
    for edit in 0..EDITS {
        lights[0].radiance = [1.0 + edit as f32; 3];
        shown = wait_for_picture(&live, live.relight(dragged(&lights)), shown)?;
    }
    let seconds = start.elapsed().as_secs_f64();
    let bytes = gpu.bytes_read() - before;
    live.close(Duration::from_secs(10));
    Ok((seconds / EDITS as f64, bytes as f64 / EDITS as f64))
}

fn wait_for_bake(live: &Live) -> anyhow::Result<()> {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        let status = live.status();
        match status.state {
            LiveState::Ready => return Ok(()),
            LiveState::Failed => bail!(status.error.unwrap_or_default()),
            _ => thread::sleep(Duration::from_millis(2)),
        }
    }
    bail!("the paths of the live shot were not there after {} s", PATIENCE.as_secs())
}

/// Waits for the settled picture of a request, newer than another, and returns its serial number. Does not sleep: a picture may
/// take less than that.
fn wait_for_picture(live: &Live, request: u64, newer_than: u64) -> anyhow::Result<u64> {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        match live.frame(newer_than) {
            Some(frame) if frame.shown.request == request && frame.shown.settled => {
                return Ok(frame.shown.serial);
            }
            _ => thread::yield_now(),
        }
    }
    let error = live.status().error.unwrap_or_default();
    bail!("a picture of the live shot was not there after {} s. {error}", PATIENCE.as_secs())
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

#[cfg(test)]
mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    #[test]
    fn the_edit_that_is_timed_copies_one_picture() {
        let device = Device::Gpu(GpuChoice::Best);
        let gpu = device.open(None).unwrap().gpu.unwrap();
        let (seconds, bytes) = strength_edit(&device, &gpu, (24, 16)).unwrap();
        println!("{LIGHTS} lights: {:.2} ms", 1e3 * seconds);
        assert_eq!(bytes, f64::from(24 * 16 * 3 * 4));
    }
}
