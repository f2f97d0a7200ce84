//! Rules of lights of their own: which classes of a dump's segments a light counts along.

use std::borrow::Cow;

use relume_dump::{Manifest, RECEIVER_LIMIT, SegmentClasses, Sight};
use relume_scene::{Light, LobeFactors, ReceiverSet};

/// A light with its rules as the set of receivers that a dump with classes stores, those of light linking among them.
pub(crate) fn with_rules<'a>(light: &'a Light, manifest: &Manifest) -> Cow<'a, Light> {
    let Some(classes) = &manifest.classes else { return Cow::Borrowed(light) };
    let objects = manifest.receivers.len();
    let lit: Vec<usize> = match &light.receivers {
        Some(set) => set.receivers.iter().map(|receiver| usize::from(*receiver)).collect(),
        None => (0..objects).collect(),
    };
    let counted = (0..classes.count()).filter(|class| counts(light, classes, *class));
    let receivers = counted
        .flat_map(|class| {
            lit.iter().filter(|receiver| **receiver < objects).map(move |r| r + class * objects)
        })
        .filter_map(|receiver| u16::try_from(receiver).ok().filter(|receiver| *receiver < RECEIVER_LIMIT))
        .collect();
    let camera = if light.rules.is_sampled_only { 0.0 } else { light.lobes.camera };
    Cow::Owned(Light {
        lobes: LobeFactors { camera, ..light.lobes },
        receivers: Some(ReceiverSet { receivers }),
        ..light.clone()
    })
}

/// Number to add to the receivers of segments that stand for shadow rays, for those that a light's own blockers stop; 0 for lights
/// that everything blocks. Nothing if the dump has no class for these blockers.
pub(crate) fn shift(light: &Light, manifest: &Manifest) -> Option<u16> {
    if light.rules.blockers.is_none() {
        return Some(0);
    }
    let classes = manifest.classes.as_ref()?;
    let linked = Sight::Linked(set_of(light, classes)?);
    let classes_between = classes.class(linked, 0) - classes.class(Sight::Shadow, 0);
    u16::try_from(classes_between * manifest.receivers.len()).ok()
}

/// Number of the set of a light's blockers.
fn set_of(light: &Light, classes: &SegmentClasses) -> Option<usize> {
    let blockers = light.rules.blockers.as_ref()?;
    classes.blockers.iter().position(|known| *known == blockers.receivers)
}

/// True if a light counts along the segments of a class. Blockers that the dump has no class for are taken for everything.
fn counts(light: &Light, classes: &SegmentClasses, class: usize) -> bool {
    let rules = &light.rules;
    let set = set_of(light, classes);
    let (sight, most_bounces) = classes.rules(class);
    let is_near = rules.max_bounces.is_none_or(|limit| most_bounces.is_some_and(|most| most <= limit));
    match sight {
        Sight::Singular | Sight::SingularWithoutWorld => !rules.is_sampled_only,
        Sight::Shadow | Sight::ShadowWithoutWorld => set.is_none() && is_near,
        Sight::World => false,
        Sight::Linked(linked) => set == Some(linked) && is_near,
    }
}
