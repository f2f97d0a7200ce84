//! Data passes of a scene's picture: what each pixel shows, of whatever light.

use rayon::prelude::*;
use relume_dump::TileRect;
use relume_scene::Scene;
use relume_trace::bvh::SceneBvh;
use relume_trace::{DataPassSettings, DataPasses, DataTracer, TraceSettings, Tracer};

use crate::error::SessionError;
use crate::progress::{Monitor, Stage};

/// Data passes of the whole picture, row by row from the top, along the camera rays of a bake with these settings. The scenes of the
/// frames before and after tell how far things move. The scene's trees may be there already.
///
/// # Errors
/// If the scene has too many triangles; [`SessionError::Cancelled`].
pub fn data_passes(
    scene: &Scene,
    settings: &TraceSettings,
    wanted: &DataPassSettings,
    frames: Option<[&Scene; 2]>,
    trees: Option<SceneBvh>,
    monitor: &Monitor,
) -> Result<DataPasses, SessionError> {
    let tracer = match trees {
        Some(trees) => Tracer::with_bvh(scene, settings, trees),
        None => Tracer::new(scene, settings)?,
    };
    let tracer = DataTracer::new(&tracer, wanted);
    let tracer = match frames {
        Some([before, after]) => tracer.between(before, after),
        None => tracer,
    };
    let (width, height) = (scene.camera.width, scene.camera.height);
    let progress = monitor.stage(Stage::Trace, 0, height as u64);
    let row = |y| {
        let row = (!monitor.cancelled()).then(|| tracer.trace(TileRect { x: 0, y, width, height: 1 }));
        progress.advance(1, "");
        row.ok_or(SessionError::Cancelled)
    };
    let rows: Vec<DataPasses> = (0..height).into_par_iter().map(row).collect::<Result<_, _>>()?;
    let mut passes = DataPasses::default();
    rows.into_iter().for_each(|row| passes.append(row));
    Ok(passes)
}
