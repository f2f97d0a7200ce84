//! Classes of segments for lights with rules of their own ([`relume_scene::LightRules`]).

use relume_dump::{RECEIVER_LIMIT, SegmentClasses, Sight};
use relume_scene::{LightRules, Scene};

use crate::settings::PathSettings;

/// Classes of the segments of a scene, and what they go by.
#[derive(Debug)]
pub(crate) struct LightClasses {
    classes: SegmentClasses,
    /// Receivers of one class.
    receivers: u16,
    /// For each set of blockers, for each instance: it is one of them.
    blockers: Vec<Vec<bool>>,
}

/// Classes that the lights and the film of a scene need; nothing if they have no rules, glass is none of the film's, and Fast GI
/// cuts no rays, and of an empty scene.
///
/// # Errors
/// A warning if there are more classes than a segment's number can tell.
pub(crate) fn segment_classes(
    scene: &Scene,
    settings: &PathSettings,
) -> Result<Option<SegmentClasses>, String> {
    let rules = || scene.lights.iter().map(|light| &light.rules);
    let (film_glass, fast_gi) = (settings.shows_through_glass(), settings.cuts_rays());
    let is_plain = rules().all(LightRules::is_default) && !film_glass && !fast_gi;
    if is_plain || scene.instances.is_empty() {
        return Ok(None);
    }
    let mut classes = SegmentClasses {
        bounce_limits: rules().filter_map(|rules| rules.max_bounces).collect(),
        blockers: rules().filter_map(|rules| Some(rules.blockers.as_ref()?.receivers.clone())).collect(),
        film_glass,
        fast_gi,
    };
    classes.bounce_limits.sort_unstable();
    classes.bounce_limits.dedup();
    classes.blockers.sort_unstable();
    classes.blockers.dedup();
    let receivers = scene.receiver_names().len();
    if receivers * classes.count() > usize::from(RECEIVER_LIMIT) {
        return Err(format!(
            "{receivers} objects are too many for rules of lights (shadow, bounces, Multiple Importance), transparent glass and Fast \
             GI: with these {} may be there; all lights are taken as ordinary, glass shows other worlds than the baked one, and \
             Fast GI replaces no bounce",
            usize::from(RECEIVER_LIMIT) / classes.count(),
        ));
    }
    Ok(Some(classes))
}

impl LightClasses {
    /// Classes of a scene.
    pub fn new(scene: &Scene, classes: SegmentClasses) -> Self {
        let is_in = |set: &Vec<u16>| {
            scene.instances.iter().map(|instance| set.binary_search(&instance.receiver).is_ok()).collect()
        };
        let blockers = classes.blockers.iter().map(is_in).collect();
        Self { receivers: scene.receiver_names().len() as u16, blockers, classes }
    }

    /// Number to add to the receiver of a segment from a vertex with so many bounces before it.
    pub fn offset(&self, sight: Sight, bounces: u32) -> u16 {
        self.classes.class(sight, bounces) as u16 * self.receivers
    }

    /// True if segments behind glass that the film shows through are told apart.
    pub fn tell_glass(&self) -> bool {
        self.classes.film_glass
    }

    /// Number of sets of blockers.
    pub fn sets(&self) -> usize {
        self.blockers.len()
    }

    /// True if no object is in a set.
    pub fn is_empty(&self, set: usize) -> bool {
        self.classes.blockers[set].is_empty()
    }

    /// True if an instance is in a set.
    pub fn blocks(&self, set: usize, instance: u32) -> bool {
        self.blockers[set][instance as usize]
    }
}
