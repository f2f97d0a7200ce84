use glam::{Mat3, Vec3};

use crate::PlacedMap;

/// One virtual light: rays cross it unchanged and collect its radiance (paper, section 3.1).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Light {
    /// Object name.
    pub name: String,
    /// Shape: place, and variation of the radiance over position and direction.
    pub shape: LightShape,
    /// Radiance where the shape's profile is 1, RGB, scene-linear, W / (sr m2) in Cycles' units. The image of the
    /// light is this times its unit image.
    pub radiance: [f32; 3],
    /// Factors by the lobe that made a segment.
    #[serde(default)]
    pub lobes: LobeFactors,
    /// Objects that receive it (light linking); all if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receivers: Option<ReceiverSet>,
    /// Factors on the radiance by direction; none where it is the same in all that the shape shines to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<PlacedMap>,
    /// Rules of its own.
    #[serde(default, skip_serializing_if = "LightRules::is_default")]
    pub rules: LightRules,
}

/// Rules of a light that not everything blocks, that lights few bounces, or that mirrors do not show. They count in bakes that were
/// begun with them.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct LightRules {
    /// Most bounces before a dull vertex that it lights (Cycles' *Max Bounces*); none without limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_bounces: Option<u32>,
    /// True if neither the camera, mirrors nor clear glass show it (Cycles' *Multiple Importance* switched off).
    pub is_sampled_only: bool,
    /// The only objects that block it (shadow linking), none for a light without shadow; absent if everything blocks it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blockers: Option<ReceiverSet>,
}

impl EmitterLinks {
    /// True if a receiver is lit.
    pub fn light(&self, receiver: u16) -> bool {
        self.receivers.as_ref().is_none_or(|lit| lit.contains(receiver))
    }

    /// True if an object lets all light pass.
    pub fn ignore(&self, receiver: u16) -> bool {
        self.blockers.as_ref().is_some_and(|blockers| !blockers.contains(receiver))
    }
}

impl LightRules {
    /// True for a light without rules of its own.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Light {
    /// Light of unit images: radiance 1, Blender's default ray visibility, all receivers. Without a name.
    pub fn unit(shape: LightShape) -> Self {
        Self {
            name: String::new(),
            shape,
            radiance: [1.0; 3],
            lobes: LobeFactors::default(),
            receivers: None,
            map: None,
            rules: LightRules::default(),
        }
    }

    /// The light in another shape of its kind, and of another radiance; its map turns with it.
    #[must_use]
    pub fn reshaped(&self, shape: LightShape, radiance: [f32; 3]) -> Self {
        let map = self.map.as_ref().map(|map| map.turned(&self.shape, &shape));
        Self { shape, radiance, map, ..self.clone() }
    }
}

/// Geometry and emission profile of a light, for radiance 1. Lengths in metres, angles in radians, directions
/// unit length, all in world space.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum LightShape {
    /// Point light without soft falloff: a sphere that radiates 1 in all directions.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
    /// Point light with soft falloff (Blender's default): a disk that always faces the origin of the segment.
    FacingDisk {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
    /// Spot light: a sphere or facing disk with a cone.
    Spot {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
        /// Axis of the cone, away from the light.
        axis: Vec3,
        /// Half of the spot size.
        half_angle: f32,
        /// Blend, 0..1.
        blend: f32,
        /// Facing disk instead of sphere.
        soft_falloff: bool,
    },
    /// Area light, square or rectangle: emits on the side of `cross(axis_u, axis_v)`.
    Quad {
        /// Centre.
        center: Vec3,
        /// Full edge: direction times width.
        edge_u: Vec3,
        /// Full edge: direction times height, perpendicular to `edge_u`.
        edge_v: Vec3,
        /// Spread; pi is a Lambertian emitter.
        spread: f32,
    },
    /// Area light, disk or ellipse: inscribed in the quad of the same edges.
    Ellipse {
        /// Centre.
        center: Vec3,
        /// Full diameter along u.
        edge_u: Vec3,
        /// Full diameter along v.
        edge_v: Vec3,
        /// Spread; pi is a Lambertian emitter.
        spread: f32,
    },
    /// Area light whose object is sheared, as Cycles samples it: the light comes from the parallelogram of its edges (from the
    /// ellipse inscribed in it), but how its front faces is what the object's z axis says.
    Sheared {
        /// Centre.
        center: Vec3,
        /// Full edge; of an ellipse, the diameter along it.
        edge_u: Vec3,
        /// Full edge in another direction.
        edge_v: Vec3,
        /// Unit direction that it emits to.
        facing: Vec3,
        /// Spread; pi is a Lambertian emitter.
        spread: f32,
        /// Ellipse instead of parallelogram.
        is_ellipse: bool,
    },
    /// Spot light whose object is stretched or sheared: its cone is one in the object's own space.
    StretchedSpot {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
        /// Directions in the object's space, where the cone is round about -z.
        local_from_world: Mat3,
        /// Half of the spot size, in the object's space.
        half_angle: f32,
        /// Blend, 0..1.
        blend: f32,
        /// Facing disk instead of sphere.
        soft_falloff: bool,
    },
    /// Sun: a disk at infinity.
    Sun {
        /// Towards the sun.
        direction: Vec3,
        /// Half of its angular diameter, above 0.
        half_angle: f32,
    },
}

/// Factors on a light by the lobe that made the segment that crosses it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct LobeFactors {
    /// Camera rays, also through transparent surfaces. Blender's lights are invisible to them by default.
    pub camera: f32,
    /// Diffuse reflection.
    pub diffuse: f32,
    /// Glossy reflection.
    pub glossy: f32,
    /// Any transmission.
    pub transmission: f32,
    /// Volume scattering.
    pub volume: f32,
}

impl Default for LobeFactors {
    fn default() -> Self {
        Self { camera: 0.0, diffuse: 1.0, glossy: 1.0, transmission: 1.0, volume: 1.0 }
    }
}

/// A set of receiver numbers ([`crate::Instance::receiver`]).
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ReceiverSet {
    /// Sorted receiver numbers that are lit.
    pub receivers: Vec<u16>,
}

impl ReceiverSet {
    /// True if the set has a receiver.
    pub fn contains(&self, receiver: u16) -> bool {
        self.receivers.binary_search(&receiver).is_ok()
    }
}

/// Light linking and shadow linking of an object that shines by its material.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EmitterLinks {
    /// The only objects that it lights; all where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receivers: Option<ReceiverSet>,
    /// The only objects that block its light; all where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blockers: Option<ReceiverSet>,
}
