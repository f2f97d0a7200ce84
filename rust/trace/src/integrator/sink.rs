use glam::Vec3;
use relume_dump::{AovSample, Segment, TileSamples};

use crate::connect::PathVertex;

/// Receives paths as they are traced: a shard in the making, or training that streams fresh paths.
pub trait PathSink {
    /// True if the AOVs hold light that the scene itself emits.
    const WANTS_STATIC_LIGHT: bool = true;

    /// A path starts; at `camera_vertex`, or at the camera's position if that is the same for all paths.
    fn begin_path(&mut self, camera_vertex: Option<Vec3>);
    /// The path's next segment.
    fn push(&mut self, segment: Segment);
    /// The path has ended.
    fn end_path(&mut self, aovs: AovSample);
    /// The path met a surface or collided in a medium: a vertex that lights can be connected to, if anything there scatters by
    /// [`relume_dump::Lobe::CONNECTED`].
    fn meet(&mut self, _vertex: impl FnOnce() -> Option<PathVertex>) {}
}

impl PathSink for TileSamples {
    fn begin_path(&mut self, camera_vertex: Option<Vec3>) {
        Self::begin_path(self, camera_vertex);
    }

    fn push(&mut self, segment: Segment) {
        Self::push(self, segment);
    }

    fn end_path(&mut self, aovs: AovSample) {
        self.add_aov(aovs);
    }
}
