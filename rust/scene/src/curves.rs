use glam::{Vec3, Vec4};

use crate::{
    ColorAttribute, UvMap,
    motion::{is_sphere, shape_fault},
};

/// Most memory for a span, bytes, scene included: while its tree is built, measured with 100,000 strands.
const SPAN_BYTES: u64 = 700;
/// Memory from which on it is said before a bake, bytes.
const MUCH_BYTES: u64 = 4 << 30;

/// Hair curves in object space. Keys of one curve follow each other; a span lies between two keys of one curve and has
/// the number of its first key.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// Name of the Blender object or particle system, for messages.
    pub name: String,
    /// Shape of the strands.
    pub shape: StrandShape,
    /// Position of each key, metres.
    pub keys: Vec<Vec3>,
    /// Radius at each key, metres.
    pub radii: Vec<f32>,
    /// Position and radius of all keys at each key of its motion, one after the other, in the middle the same as above; empty
    /// if they keep their shape.
    pub motion: Vec<Vec4>,
    /// First key of each curve, and the number of keys last: one entry more than there are curves.
    pub first_keys: Vec<u32>,
    /// Number of the first curve, by which random numbers go: hair systems of one object are counted together.
    pub first_number: u32,
    /// UV maps, the active render one first: one coordinate a curve.
    pub uv_maps: Vec<UvMap>,
    /// Attributes with a value a key, scene-linear RGBA.
    pub key_attributes: Vec<ColorAttribute>,
    /// Attributes with a value a curve, scene-linear RGBA.
    pub curve_attributes: Vec<ColorAttribute>,
    /// Generated coordinates, one a curve: where the root of particle hair is in the emitter's texture space. Where
    /// there are none, they are object coordinates, as in Cycles.
    pub generated: Vec<Vec3>,
    /// Normal at each key, by which elliptical cross-sections turn; empty if there are none.
    pub normals: Vec<Vec3>,
}

/// Shape of the strands of [`Curves`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrandShape {
    /// Flat bands along Catmull-Rom splines that face each ray, of `2^subdivisions` straight pieces a span.
    Ribbon {
        /// Binary logarithm of the number of pieces.
        subdivisions: u8,
    },
    /// Circles swept along Catmull-Rom splines, open at both ends.
    #[default]
    Round,
    /// Cones with spheres at the keys.
    Linear,
}

impl StrandShape {
    /// Most subdivisions of a ribbon.
    pub const MOST_SUBDIVISIONS: u8 = 4;
}

impl Curves {
    /// Number of curves.
    pub fn curve_count(&self) -> usize {
        self.first_keys.len().saturating_sub(1)
    }

    /// Number of spans of all curves.
    pub fn span_count(&self) -> usize {
        self.keys.len().saturating_sub(self.curve_count())
    }

    /// Keys of a curve.
    pub fn keys_of(&self, curve: usize) -> std::ops::Range<usize> {
        self.first_keys[curve] as usize..self.first_keys[curve + 1] as usize
    }

    /// Curve that a key belongs to.
    pub fn curve_of(&self, key: usize) -> usize {
        let holds = |curve: usize| self.keys_of(curve).contains(&key);
        // Right at once where all curves have as many keys.
        let guess = key * self.curve_count() / self.keys.len().max(1);
        if guess < self.curve_count() && holds(guess) {
            return guess;
        }
        self.first_keys.partition_point(|first| *first as usize <= key).saturating_sub(1)
    }

    /// Position and radius at a time of the four keys about a span, the outer ones repeated at the ends of its curve.
    pub fn span_at(&self, key: usize, time: f32) -> [Vec4; 4] {
        let keys = self.keys_of(self.curve_of(key));
        let at = |key: usize| self.key_at(key, time);
        [
            at(key.saturating_sub(1).max(keys.start)),
            at(key),
            at((key + 1).min(keys.end - 1)),
            at((key + 2).min(keys.end - 1)),
        ]
    }

    /// Lengths along a curve, of which the span `key` is a part.
    pub fn lengths(&self, curve: usize, key: usize) -> StrandLengths {
        let keys = self.keys_of(curve);
        let (mut total, mut before, mut after) = (0.0, 0.0, 0.0);
        for index in keys.start + 1..keys.end {
            if index == key + 1 {
                before = total;
            }
            total += self.keys[index].distance(self.keys[index - 1]);
            if index == key + 1 {
                after = total;
            }
        }
        StrandLengths { total, before, after }
    }

    /// Words about the memory that they take to trace, if that is much.
    pub(crate) fn memory_warning(&self) -> Option<String> {
        let bytes = self.span_count() as u64 * SPAN_BYTES;
        let (strands, gib) = (self.curve_count(), bytes as f64 / f64::from(1 << 30));
        (bytes > MUCH_BYTES).then(|| {
            format!(
                "curves '{}': {strands} strands take about {gib:.1} GiB of memory when a bake starts; if it ends there, use \
                 fewer strands, or fewer keys a strand",
                self.name
            )
        })
    }

    /// Fault in words, if there is any.
    pub(crate) fn fault(&self) -> Option<String> {
        let (keys, curves) = (self.keys.len(), self.curve_count());
        let is_sorted = self.first_keys.windows(2).all(|pair| pair[0] < pair[1]);
        let lengths = [
            self.uv_maps.iter().all(|map| map.coords.len() == curves),
            self.key_attributes.iter().all(|attribute| attribute.colors.len() == keys),
            self.curve_attributes.iter().all(|attribute| attribute.colors.len() == curves),
            self.generated.is_empty() || self.generated.len() == curves,
            self.normals.is_empty() || self.normals.len() == keys,
            self.radii.len() == keys,
        ];
        let subdivisions = match self.shape {
            StrandShape::Ribbon { subdivisions } => subdivisions,
            StrandShape::Round | StrandShape::Linear => 0,
        };
        if let Some(key) = self.keys.iter().position(|key| !key.is_finite()) {
            Some(format!("key {key} is not a finite number; remove its strand or the modifier that made it"))
        } else if let Some(key) = self.radii.iter().position(|radius| !(*radius >= 0.0 && radius.is_finite()))
        {
            Some(format!("the radius of key {key} is not a positive number"))
        } else if subdivisions > StrandShape::MOST_SUBDIVISIONS {
            Some(format!("its ribbons are subdivided more than {} times", StrandShape::MOST_SUBDIVISIONS))
        } else if !is_sorted
            || self.first_keys.first().is_some_and(|first| *first != 0)
            || self.first_keys.last().map_or(0, |last| *last as usize) != keys
            || lengths.contains(&false)
        {
            Some("its arrays differ in length".to_owned())
        } else {
            shape_fault(&self.motion, keys, is_sphere).map(str::to_owned)
        }
    }
}

/// Lengths along a curve from its root, in object space, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandLengths {
    /// Whole curve.
    pub total: f32,
    /// From the root to the first key of a span.
    pub before: f32,
    /// From the root to the second key of the span.
    pub after: f32,
}

impl StrandLengths {
    /// Share of the curve's length before the place `u` of the span, 0 at the root and 1 at the tip.
    pub fn intercept(&self, u: f32) -> f32 {
        if self.total > 0.0 { (self.before + (self.after - self.before) * u) / self.total } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneBuilder;

    /// A strand of three keys and one of two.
    fn two() -> Curves {
        let keys = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 3.0, 0.0), Vec3::Z, Vec3::ONE];
        Curves { keys, radii: vec![0.1; 5], first_keys: vec![0, 3, 5], ..Curves::default() }
    }

    #[test]
    fn keys_belong_to_their_curve_and_spans_end_at_its_ends() {
        let curves = two();
        assert_eq!([0, 1, 2, 3, 4].map(|key| curves.curve_of(key)), [0, 0, 0, 1, 1]);
        assert_eq!(curves.span_count(), 3);
        let places = curves.span_at(1, 0.5).map(|key| key.truncate());
        assert_eq!(places, [curves.keys[0], curves.keys[1], curves.keys[2], curves.keys[2]]);
        let places = curves.span_at(3, 0.5).map(|key| key.truncate());
        assert_eq!(places, [curves.keys[3], curves.keys[3], curves.keys[4], curves.keys[4]]);
    }

    #[test]
    fn intercepts_go_by_length() {
        let lengths = two().lengths(0, 1);
        assert_eq!(lengths, StrandLengths { total: 4.0, before: 1.0, after: 4.0 });
        assert_eq!([0.0, 0.5, 1.0].map(|u| lengths.intercept(u)), [0.25, 0.625, 1.0]);
    }

    #[test]
    fn much_memory_is_told_by_name_and_little_is_not() {
        let warnings = |spans: u64| {
            let keys = spans as usize + 1;
            let curves = Curves {
                name: "Fur".into(),
                keys: vec![Vec3::ZERO; keys],
                radii: vec![0.0; keys],
                first_keys: vec![0, keys as u32],
                ..Curves::default()
            };
            let mut builder = SceneBuilder::default();
            builder.add_curves(curves).unwrap();
            builder.build_world().warnings
        };
        let limit = MUCH_BYTES / SPAN_BYTES;
        assert!(warnings(limit).is_empty());
        let found = warnings(limit + 1);
        assert!(found[0].starts_with("curves 'Fur': 1 strands take about 4.0 GiB"), "{found:?}");
    }

    #[test]
    fn faults_are_told_in_words() {
        type Change = fn(&mut Curves);
        let changes: [(Change, &str); 6] = [
            (|curves| curves.keys[1].y = f32::NAN, "key 1"),
            (|curves| curves.radii[2] = -1.0, "radius of key 2"),
            (|curves| curves.first_keys[1] = 9, "length"),
            (|curves| curves.first_keys = vec![], "length"),
            (|curves| curves.generated = vec![Vec3::ZERO], "length"),
            (|curves| curves.shape = StrandShape::Ribbon { subdivisions: 40 }, "subdivided"),
        ];
        assert_eq!(two().fault(), None);
        for (change, word) in changes {
            let mut curves = two();
            change(&mut curves);
            assert!(curves.fault().is_some_and(|fault| fault.contains(word)), "{word}");
        }
    }
}
