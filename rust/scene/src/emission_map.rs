//! Emission of a lamp whose nodes make it shine differently by direction, place or distance, as a table.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use crate::LightShape;

/// Most texels of a table.
const MOST_TEXELS: usize = 1 << 19;

/// Factors on the radiance of a light by direction in its object's space or by place, RGB, scene-linear. Looked up
/// bilinearly, texels in the middle of their squares.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "StoredMap", into = "StoredMap")]
pub struct EmissionMap {
    /// Directions or places that the table is about.
    pub domain: MapDomain,
    /// Texels in a row.
    pub width: usize,
    /// Texels, row by row, each of the format that OpenGL calls RGB9E5.
    pub texels: Vec<u32>,
    /// Factor by distance.
    pub falloff: Falloff,
}

/// Factor on the radiance of a light by the distance `t` from where the ray began to where it crosses the light:
/// `t^power * t^2 / (smooth + t^2)`, as by Cycles' Light Falloff node (`kernel/svm/light_path.h`). Nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Falloff {
    /// Power of the distance: 0 for *Quadratic*, 1 for *Linear*, 2 for *Constant*.
    pub power: f32,
    /// *Smooth*, square metres.
    pub smooth: f32,
}

impl Falloff {
    /// True if all distances are alike.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Factor at a distance in metres.
    pub fn factor(&self, distance: f32) -> f32 {
        let squared = distance * distance;
        let smoothing = if self.smooth > 0.0 { squared / (self.smooth + squared) } else { 1.0 };
        distance.powf(self.power) * smoothing
    }
}

/// Quantity by which a table is looked up where a ray crosses its light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapKey {
    /// Way back to where the ray began.
    #[default]
    WayBack,
    /// Surface normal of a sphere.
    Normal,
    /// Place on an area light: columns go along the x axis of its object, rows along the y axis.
    Place,
}

/// Directions or places of a table.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub struct MapDomain {
    /// Quantity that is looked up; of places, there is no direction.
    #[serde(default)]
    pub key: MapKey,
    /// Tangent of half of the angle of a square cone about -z, which is what rows and columns go over. None for all
    /// directions: columns go over the angle about z, from that of -x through -y on, rows from +z to -z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cone: Option<f32>,
}

impl MapDomain {
    /// True if the last column lies beside the first.
    pub fn closes(&self) -> bool {
        self.cone.is_none() && self.key != MapKey::Place
    }

    /// Direction in the middle of a texel, of any length.
    pub fn direction(&self, u: f32, v: f32) -> Vec3 {
        use std::f32::consts::{PI, TAU};
        match self.cone {
            Some(tangent) => Vec3::new((2.0 * u - 1.0) * tangent, (2.0 * v - 1.0) * tangent, -1.0),
            None => {
                let ((sin, cos), (sin_v, cos_v)) = ((u * TAU - PI).sin_cos(), (v * PI).sin_cos());
                Vec3::new(cos * sin_v, sin * sin_v, cos_v)
            }
        }
    }

    /// Place of a direction of any length, 0..1 in the table; the inverse of [`Self::direction`].
    pub fn place(&self, direction: Vec3) -> [f32; 2] {
        use std::f32::consts::{PI, TAU};
        match self.cone {
            Some(tangent) => {
                let scale = 0.5 / (tangent * (-direction.z).max(1e-6 * direction.length()));
                [direction.x * scale + 0.5, direction.y * scale + 0.5]
            }
            None => {
                let from_top = direction.truncate().length().atan2(direction.z);
                [direction.y.atan2(direction.x) / TAU + 0.5, from_top / PI]
            }
        }
    }
}

/// JSON form of a table: texels are hexadecimal, eight digits each.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredMap {
    domain: MapDomain,
    width: usize,
    texels: String,
    #[serde(default, skip_serializing_if = "Falloff::is_none")]
    falloff: Falloff,
}

impl From<EmissionMap> for StoredMap {
    fn from(map: EmissionMap) -> Self {
        const DIGITS: &[u8; 16] = b"0123456789abcdef";
        let digit = |texel: u32, place: u32| char::from(DIGITS[(texel >> (28 - 4 * place) & 15) as usize]);
        let texels =
            map.texels.iter().flat_map(|&texel| (0..8).map(move |place| digit(texel, place))).collect();
        Self { domain: map.domain, width: map.width, texels, falloff: map.falloff }
    }
}

impl TryFrom<StoredMap> for EmissionMap {
    type Error = &'static str;

    fn try_from(stored: StoredMap) -> Result<Self, Self::Error> {
        let texel = |digits: &[u8; 8]| {
            let digit = |sum: Option<u32>, &digit: &u8| Some(sum? << 4 | char::from(digit).to_digit(16)?);
            digits.iter().fold(Some(0), digit)
        };
        let (words, rest) = stored.texels.as_bytes().as_chunks::<8>();
        let texels = words.iter().map(texel).collect::<Option<Vec<_>>>();
        let texels =
            texels.filter(|_| rest.is_empty()).ok_or("texels of an emission map are eight digits each")?;
        let is_whole = stored.width > 0 && texels.len().is_multiple_of(stored.width);
        if texels.is_empty() || texels.len() > MOST_TEXELS || !is_whole {
            return Err("an emission map is empty, too large or has a row that is not whole");
        }
        if stored.domain.cone.is_some_and(|tangent| !(tangent > 0.0 && tangent.is_finite())) {
            return Err("the cone of an emission map is not above 0");
        }
        let Falloff { power, smooth } = stored.falloff;
        if !((0.0..=2.0).contains(&power) && smooth >= 0.0 && smooth.is_finite()) {
            return Err("the falloff of an emission map has a power beyond 0 to 2 or a smoothing below 0");
        }
        Ok(Self { domain: stored.domain, width: stored.width, texels, falloff: stored.falloff })
    }
}

impl EmissionMap {
    /// Rows of texels.
    pub fn height(&self) -> usize {
        self.texels.len() / self.width.max(1)
    }
}

/// A table as it lies about a light.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct PlacedMap {
    /// The table, which copies of the light share.
    #[serde(with = "shared")]
    pub map: Arc<EmissionMap>,
    /// Directions in the space of the table.
    pub local_from_world: Mat3,
}

impl PartialEq for PlacedMap {
    fn eq(&self, other: &Self) -> bool {
        self.local_from_world == other.local_from_world
            && (Arc::ptr_eq(&self.map, &other.map) || self.map == other.map)
    }
}

impl PlacedMap {
    /// The table after its light has turned from one shape to another: as the edges of an area do, else on the shortest way.
    #[must_use]
    pub fn turned(&self, from: &LightShape, to: &LightShape) -> Self {
        let turn_back = match (frame(from), frame(to)) {
            (Some(from), Some(to)) => Some(from * to.transpose()),
            _ => from
                .axis()
                .zip(to.axis())
                .filter(|(from, to)| from != to)
                .map(|(from, to)| Mat3::from_quat(glam::Quat::from_rotation_arc(to, from))),
        };
        let local_from_world = turn_back.map_or(self.local_from_world, |turn| self.local_from_world * turn);
        Self { map: Arc::clone(&self.map), local_from_world }
    }
}

/// Rotation of an area light: its edges and the way that it faces.
fn frame(shape: &LightShape) -> Option<Mat3> {
    match *shape {
        LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
            let (u, v) = (edge_u.try_normalize()?, edge_v.try_normalize()?);
            Some(Mat3::from_cols(u, v, u.cross(v)))
        }
        _ => None,
    }
}

/// JSON form of a table that is shared.
pub(crate) mod shared {
    use super::{Arc, EmissionMap};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(map: &Arc<EmissionMap>, serializer: S) -> Result<S::Ok, S::Error> {
        EmissionMap::serialize(map, serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<EmissionMap>, D::Error> {
        EmissionMap::deserialize(deserializer).map(Arc::new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_their_directions() {
        for cone in [None, Some(0.7)] {
            let domain = MapDomain { key: MapKey::WayBack, cone };
            for (u, v) in [(0.1, 0.3), (0.5, 0.5), (0.9, 0.8), (0.3, 0.01)] {
                let [x, y] = domain.place(domain.direction(u, v) * 3.0);
                assert!((x - u).abs() < 1e-5 && (y - v).abs() < 1e-5, "{cone:?}: {u} {v} {x} {y}");
            }
        }
    }

    #[test]
    fn tables_are_read_as_they_were_written_and_checked() {
        let domain = MapDomain { key: MapKey::Normal, cone: Some(0.5) };
        let falloff = Falloff { power: 1.0, smooth: 0.25 };
        let map = EmissionMap { domain, width: 2, texels: vec![0, 1, 0xdead_beef, u32::MAX], falloff };
        let text = serde_json::to_string(&map).unwrap();
        assert_eq!(serde_json::from_str::<EmissionMap>(&text).unwrap(), map);
        let broken = [
            ("deadbeef", "deadbee"),
            ("\"width\":2", "\"width\":3"),
            ("\"width\":2", "\"width\":0"),
            ("0.5", "0.0"),
            ("\"power\":1.0", "\"power\":3.0"),
            ("0.25", "-0.25"),
        ];
        for (from, to) in broken {
            assert!(serde_json::from_str::<EmissionMap>(&text.replace(from, to)).is_err(), "{to}");
        }
    }
}
