//! Lights that are connected in the scene of the bake, and those that its paths hardly meet.

use std::sync::{Arc, Mutex};

use relume_scene::{Light, Scene};
use relume_trace::bvh::SceneBvh;

use super::Relighter;
use crate::device::connections::Connections;
use crate::error::SessionError;
use crate::progress::Monitor;
use crate::relight::options::RelightOptions;
use crate::relight::source::UnitSource;

/// Scenes that live shots have in memory, with their trees and the vertices of paths in them.
#[derive(Clone, Default)]
pub struct OpenScenes(pub(crate) Vec<Arc<Connections>>);

impl Relighter {
    /// True if a scene is the one that was baked.
    pub fn is_of(&self, scene: &Scene) -> bool {
        self.scene_hash == scene.hash()
    }

    /// Connects lights in the scene of the bake from now on, where that can be: they have much less noise then.
    ///
    /// # Errors
    /// If the scene is not that of the bake ([`Self::is_of`]), or has too many triangles.
    pub fn connect(&mut self, scene: Arc<Scene>) -> Result<(), SessionError> {
        let Some(gather) = &self.gather else { return Ok(()) };
        let connections = Connections::new(scene, gather.gather().dump().manifest(), None, 1)?;
        self.connect_by(&Arc::new(connections));
        Ok(())
    }

    /// [`Self::connect`] in that of some open scenes that was baked; false if there is none.
    pub fn connect_open(&mut self, scenes: &OpenScenes) -> bool {
        let Some(gather) = &self.gather else { return false };
        let manifest = gather.gather().dump().manifest();
        let open = scenes.0.iter().find(|open| open.is_of(manifest));
        if let Some(open) = open {
            self.connect_by(open);
        }
        open.is_some()
    }

    /// Trees of a scene, if lights are connected in that.
    pub fn trees_of(&self, scene: &Scene) -> Option<SceneBvh> {
        let connections = self.gather.as_ref()?.connections().filter(|_| self.is_of(scene))?;
        Some(connections.tracer().bvh().clone())
    }

    /// [`Self::connect`] in the scene that the bake folder holds, if it does; a warning tells what is wrong with that.
    pub fn connect_stored(&mut self, monitor: &Monitor) {
        let Some(gather) = &self.gather else { return };
        match Connections::stored(&self.folder, gather.gather().dump().manifest(), 1) {
            Ok(Some(connections)) => self.connect_by(&Arc::new(connections)),
            Ok(None) => {}
            Err(warning) => monitor.warn(&warning),
        }
    }

    fn connect_by(&mut self, connections: &Arc<Connections>) {
        let Some(gather) = &mut self.gather else { return };
        let levels = gather.gather().dump().manifest().passes.len();
        gather.connect(connections, levels);
        self.units = Mutex::default();
    }

    /// Connections in the scene of the bake, where that is at hand.
    pub(crate) fn connections(&self) -> Option<&Connections> {
        self.gather.as_ref()?.connections().map(|connections| &**connections)
    }

    /// True if hardly any path meets a light, but paths guided towards it would
    /// ([`relume_trace::TraceSettings::guide_targets`]). Its gathered picture is noise.
    pub fn is_under_sampled(&self, light: &Light) -> bool {
        if self.connects(light) {
            return false;
        }
        let under_sampled = self.coverage.as_ref().and_then(|coverage| coverage.under_sampled(light));
        under_sampled.is_some_and(|under_sampled| under_sampled.guiding_helps)
    }

    /// Lights whose pictures are noise in the dump, while guided paths would meet them ([`Self::is_under_sampled`]).
    pub fn under_sampled<'a>(&self, lights: &'a [Light]) -> Vec<&'a Light> {
        let source = |light: &Light| self.source(light, &RelightOptions::default());
        let is_gathered = |light: &Light| matches!(source(light), Ok(UnitSource::GatherDenoised));
        lights.iter().filter(|light| is_gathered(light) && self.is_under_sampled(light)).collect()
    }

    /// True if a light is connected.
    pub(crate) fn connects(&self, light: &Light) -> bool {
        self.gather.as_ref().is_some_and(|gather| gather.connects(light))
    }
}
