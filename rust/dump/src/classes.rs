use serde::{Deserialize, Serialize};

/// Division of a bake's segments by what lights with rules of their own go by: lights that not everything blocks, that light few
/// bounces, or that mirrors do not show. A segment of receiver r and class c carries the number r + c times the receivers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SegmentClasses {
    /// Limits of lights to the bounces before a vertex that they light, ascending.
    pub bounce_limits: Vec<u32>,
    /// Sets of receivers that alone block some lights, each ascending; an empty one belongs to lights without shadow.
    pub blockers: Vec<Vec<u16>>,
    /// True if segments behind glass that a transparent film shows through are told apart: no world is seen there.
    #[serde(default, skip_serializing_if = "is_false")]
    pub film_glass: bool,
    /// True if rays that Fast GI cuts meet the world and nothing else at their end: it has segments of its own, and lights theirs.
    #[serde(default, skip_serializing_if = "is_false")]
    pub fast_gi: bool,
}

fn is_false(value: &bool) -> bool {
    !*value
}

/// Ray that a segment stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// A shadow ray from a dull surface or a medium, which everything blocks.
    Shadow,
    /// A ray of the camera, a mirror or clear glass, which alone can find a light.
    Singular,
    /// A ray that Fast GI cut, along which the world counts and no light does.
    World,
    /// A shadow ray that only one of the sets of blockers stops.
    Linked(usize),
    /// [`Sight::Shadow`] where no world counts: behind glass that a transparent film shows through, or beside [`Sight::World`].
    ShadowWithoutWorld,
    /// [`Sight::Singular`] where no world counts.
    SingularWithoutWorld,
}

impl SegmentClasses {
    /// Number of classes.
    pub fn count(&self) -> usize {
        let without_world = if self.film_glass || self.fast_gi { 2 } else { 0 };
        (self.rows_with_world() + self.blockers.len() + without_world).saturating_mul(self.intervals())
    }

    /// First class of segments along which no world is seen.
    pub fn first_without_world(&self) -> usize {
        self.rows_with_world() * self.intervals()
    }

    /// Number of the class of segments from a vertex with so many bounces before it.
    pub fn class(&self, sight: Sight, bounces: u32) -> usize {
        let row = match sight {
            Sight::Shadow => 0,
            Sight::Singular => 1,
            Sight::World => 2,
            Sight::Linked(set) => self.rows_with_world() + set,
            Sight::ShadowWithoutWorld => self.rows_with_world() + self.blockers.len(),
            Sight::SingularWithoutWorld => self.rows_with_world() + self.blockers.len() + 1,
        };
        row * self.intervals() + self.bounce_limits.partition_point(|limit| *limit < bounces)
    }

    /// Ray that the segments of a class stand for, and the most bounces before them; none without limit.
    pub fn rules(&self, class: usize) -> (Sight, Option<u32>) {
        let (row, interval) = (class / self.intervals(), class % self.intervals());
        let sight = match (row, row.checked_sub(self.rows_with_world())) {
            (0, _) => Sight::Shadow,
            (1, _) => Sight::Singular,
            (_, None) => Sight::World,
            (_, Some(set)) if set < self.blockers.len() => Sight::Linked(set),
            (_, Some(rest)) if rest == self.blockers.len() => Sight::ShadowWithoutWorld,
            _ => Sight::SingularWithoutWorld,
        };
        (sight, self.bounce_limits.get(interval).copied())
    }

    fn rows_with_world(&self) -> usize {
        if self.fast_gi { 3 } else { 2 }
    }

    fn intervals(&self) -> usize {
        self.bounce_limits.len() + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_may_not_have_more_classes_than_numbers() {
        let classes = SegmentClasses { blockers: vec![Vec::new(); 2047], ..SegmentClasses::default() };
        assert_eq!(classes.count(), usize::from(crate::RECEIVER_LIMIT) + 1);
        let manifest = crate::Manifest {
            format_version: crate::FORMAT_VERSION,
            scene_hash: String::new(),
            width: 1,
            height: 1,
            tile_size: 1,
            passes: vec![crate::Pass { first_sample: 0, samples: 1 }],
            seed: 0,
            camera: serde_json::Value::Null,
            camera_position: None,
            receivers: Vec::new(),
            classes: None,
            settings: serde_json::Value::Null,
            working_space: String::new(),
            world_color: [0.0; 3],
            world_map: String::new(),
            recorded: None,
        };
        assert!(manifest.check().is_ok());
        assert!(crate::Manifest { classes: Some(classes), ..manifest }.check().is_err());
    }

    #[test]
    fn each_class_has_its_rules() {
        let blockers = vec![vec![], vec![2, 5]];
        let classes = SegmentClasses { bounce_limits: vec![0, 3], blockers, film_glass: true, fast_gi: true };
        assert_eq!(classes.count(), 21);
        for (sight, bounces, most) in [
            (Sight::Shadow, 0, Some(0)),
            (Sight::Shadow, 1, Some(3)),
            (Sight::Singular, 3, Some(3)),
            (Sight::Linked(0), 4, None),
            (Sight::Linked(1), 0, Some(0)),
            (Sight::World, 2, Some(3)),
            (Sight::ShadowWithoutWorld, 4, None),
            (Sight::SingularWithoutWorld, 2, Some(3)),
        ] {
            let class = classes.class(sight, bounces);
            assert!(class < classes.count());
            assert_eq!(classes.rules(class), (sight, most));
            let sees_world = matches!(sight, Sight::Shadow | Sight::Singular | Sight::World);
            assert_eq!(class < classes.first_without_world(), sees_world, "{sight:?}");
        }
    }
}
