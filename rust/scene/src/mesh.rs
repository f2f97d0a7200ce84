use glam::{Affine3A, BVec3, Vec2, Vec3};

use crate::{Displaceable, EmitterLinks, Geometry, Pose, Scene, Undisplaced};

/// A triangle mesh in object space. Corner `3 t + c` is corner `c` of triangle `t`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name of the Blender mesh or OBJ group, for messages.
    pub name: String,
    /// Vertex positions in metres.
    pub positions: Vec<Vec3>,
    /// Vertex indices, `[triangle][corner]`.
    pub triangles: Vec<[u32; 3]>,
    /// Positions of all vertices at each key of its motion, key after key, in the middle the same as `positions`; empty if
    /// it keeps its shape.
    pub motion: Vec<Vec3>,
    /// Shading normals, one a corner, unit length; empty if every face is flat.
    pub corner_normals: Vec<Vec3>,
    /// UV maps, the active render one first.
    pub uv_maps: Vec<UvMap>,
    /// Colour attributes, the active render one first.
    pub color_attributes: Vec<ColorAttribute>,
    /// Material slot of each triangle, an index into [`Instance::materials`]; empty if all are slot 0.
    pub material_slots: Vec<u16>,
    /// Centre and half size of the box of generated coordinates (Blender's texture space); that of the positions if
    /// there is none. Modifiers leave it as it was without them.
    pub texture_space: Option<[Vec3; 2]>,
    /// Nothing if no material is to displace it, or one has.
    pub displaceable: Option<Displaceable>,
    /// Its shape before it was displaced; nothing if it was not.
    pub undisplaced: Option<Undisplaced>,
}

impl Mesh {
    /// A box between its lowest and highest corner, whose faces look outwards.
    pub fn cuboid(name: impl Into<String>, [low, high]: [Vec3; 2]) -> Self {
        const FACES: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let corner = |number: u32| {
            let is_high = BVec3::new(number & 1 != 0, number & 2 != 0, number & 4 != 0);
            Vec3::select(is_high, high, low)
        };
        let triangles = FACES.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        Self {
            name: name.into(),
            positions: (0..8).map(corner).collect(),
            triangles: triangles.collect(),
            ..Self::default()
        }
    }
}

/// A named set of texture coordinates.
#[derive(Clone, Debug, Default)]
pub struct UvMap {
    /// Name of the UV layer.
    pub name: String,
    /// One a corner.
    pub coords: Vec<Vec2>,
}

/// A named set of scene-linear colours.
#[derive(Clone, Debug, Default)]
pub struct ColorAttribute {
    /// Name of the attribute.
    pub name: String,
    /// RGBA, one a corner.
    pub colors: Vec<[f32; 4]>,
}

/// Geometry placed in the world.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Instance {
    /// Object name, for messages.
    pub name: String,
    /// Geometry that is placed.
    #[serde(flatten)]
    pub geometry: Geometry,
    /// Object transform, may mirror and scale.
    pub world_from_object: Affine3A,
    /// Its transform at each key of its motion, in the middle that of `world_from_object`; empty if it stands still.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<Pose>,
    /// Material of each slot: indices into [`crate::Scene::materials`]; a missing slot uses the last one.
    pub materials: Vec<usize>,
    /// Number that the dump keeps with each segment for light linking, below [`Instance::RECEIVER_LIMIT`].
    pub receiver: u16,
    /// Object colour (Object Info).
    pub color: [f32; 4],
    /// Pass index (Object Info).
    pub pass_index: u32,
    /// Random number in 0..1 (Object Info).
    pub random: f32,
    /// Cosine below which rays that graze a smooth-shaded triangle start above it (Cycles' Shadow Terminator Geometry
    /// Offset); 0 for never.
    pub shadow_terminator_offset: f32,
    /// Offset of the end of reflection before the horizon, 0 for there, 1 for halfway (Cycles' Shadow Terminator
    /// Shading Offset).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub shadow_terminator_shading: f32,
    /// Grids of the volume that fills it, an index into [`crate::Scene::grids`]; none where shaders alone decide.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grids: Option<usize>,
    /// Values of attributes that materials ask the object itself for, where its geometry has none of that name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attributes: Vec<(String, [f32; 4])>,
    /// Seen by camera rays.
    pub visible_camera: bool,
    /// Seen by diffuse rays.
    pub visible_diffuse: bool,
    /// Seen by glossy rays.
    pub visible_glossy: bool,
    /// Seen by transmission rays.
    pub visible_transmission: bool,
    /// Seen by rays that a medium scattered, even where diffuse rays do not see it: those count as both, as in Cycles.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub visible_volume_scatter: bool,
    /// Seen by shadow rays. Where it is not, light passes it, and paths meet it all the same.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub visible_shadow: bool,
    /// Met by rays of the node Raycast, if any ray meets it.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub visible_raycast: bool,
    /// Cut out of the film where the camera sees it: nothing is there, and its alpha is 0. Other rays meet it all the same.
    #[serde(default, skip_serializing_if = "is_no")]
    pub is_holdout: bool,
    /// Shadow catcher: the camera sees only what other objects take from its light, or add to it. Holdouts are none.
    #[serde(default, skip_serializing_if = "is_no")]
    pub is_shadow_catcher: bool,
    /// Light linking of what shines on it; none where it shines on everything and everything blocks it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<Box<EmitterLinks>>,
    /// Reach of rays that Fast GI cuts where they leave it, metres; 0 for that of the render settings.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub occlusion_distance: f32,
    /// Factor on the density of the medium inside (Cycles' volume density of an object, in object or world space).
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub density_factor: f32,
}

fn is_zero(value: &f32) -> bool {
    *value == 0.0
}

fn yes() -> bool {
    true
}

fn is_yes(value: &bool) -> bool {
    *value
}

fn is_no(value: &bool) -> bool {
    !*value
}

fn one() -> f32 {
    1.0
}

fn is_one(value: &f32) -> bool {
    *value == 1.0
}

impl Instance {
    /// Receivers are stored in 11 bits of a segment.
    pub const RECEIVER_LIMIT: usize = 2048;

    /// Number of the material of a triangle of its mesh; the last one where the slot is missing, none where all are.
    /// Everything else has that of slot 0.
    pub fn material_of(&self, scene: &Scene, primitive: usize) -> Option<usize> {
        let slots = scene.mesh(self.geometry).map_or(&[][..], |mesh| &mesh.material_slots);
        let slot = slots.get(primitive).map_or(0, |slot| usize::from(*slot));
        self.materials.get(slot).or(self.materials.last()).copied()
    }

    /// True for a shadow catcher that is not held out.
    pub fn catches_shadows(&self) -> bool {
        self.is_shadow_catcher && !self.is_holdout
    }

    /// An instance with Blender's defaults.
    pub fn new(
        name: impl Into<String>,
        geometry: impl Into<Geometry>,
        world_from_object: Affine3A,
        materials: Vec<usize>,
    ) -> Self {
        Self {
            name: name.into(),
            geometry: geometry.into(),
            world_from_object,
            motion: Vec::new(),
            materials,
            receiver: 0,
            color: [1.0; 4],
            pass_index: 0,
            random: 0.0,
            shadow_terminator_offset: 0.1,
            shadow_terminator_shading: 0.0,
            grids: None,
            attributes: Vec::new(),
            visible_camera: true,
            visible_diffuse: true,
            visible_glossy: true,
            visible_transmission: true,
            visible_volume_scatter: true,
            visible_shadow: true,
            visible_raycast: true,
            is_holdout: false,
            is_shadow_catcher: false,
            links: None,
            occlusion_distance: 0.0,
            density_factor: 1.0,
        }
    }
}
