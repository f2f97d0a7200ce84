//! Scene to render: camera, meshes, instances, materials, textures, world and lights, in physical units.
//!
//! World space is Blender's: right-handed, z up, metres. Colours are scene-linear in the working space of the
//! file that the scene came from ([`Scene::working_space`]). Nothing here traces a ray or reads a light's effect.

mod blender_camera;
mod blender_light;
mod blender_light_inverse;
mod builder;
mod camera;
mod curves;
mod damage;
mod dispersion;
mod displacement;
mod emission_map;
mod geometry;
mod grid;
mod hair;
mod hash;
mod ies;
mod light;
mod light_lanes;
mod material;
mod mesh;
mod motion;
mod node;
mod node_settings;
mod obj;
mod panorama;
mod phase;
mod picture_file;
mod points;
mod polygon;
mod procedural;
mod sockets;
mod subsurface;
mod texture;
mod texture_size;
mod thin_film;
mod validate;
mod vdb;
mod world;

pub use blender_camera::{BlenderCamera, BlenderDepthOfField, CameraError, SensorFit};
pub use blender_light::{
    AreaShape, BlenderLight, BlenderLightKind, LightError, MIN_SIZE, MIN_SUN_HALF_ANGLE,
};
pub use builder::{BuildError, SceneBuilder};
pub use camera::{Camera, DepthOfField, Projection};
pub use curves::{Curves, StrandLengths, StrandShape};
pub use damage::can_be_met;
pub use dispersion::Dispersion;
pub use displacement::{Displaceable, Displacement, Undisplaced};
pub use emission_map::{EmissionMap, Falloff, MapDomain, MapKey, PlacedMap};
pub use geometry::Geometry;
pub use glam;
pub use grid::{Advection, Bricks, DenseGrid, Grid, GridBounds, GridInterpolation, GridSet, Velocities};
pub use hair::{HairComponent, HairModel, HairPigment, PrincipledHair};
pub use ies::{IesBorder, IesError, IesProfile, IesSource};
pub use light::{EmitterLinks, Light, LightRules, LightShape, LobeFactors, ReceiverSet};
pub use light_lanes::{LANES, lane};
pub use material::{BumpShadowing, Input, Material, NodeId, Output};
pub use mesh::{ColorAttribute, Instance, Mesh, UvMap};
pub use motion::{Pose, STILL, Shutter, blend, place};
pub use node::Node;
pub use node_settings::{
    Alpha, BlendMode, ColorMode, Curve, Distribution, IntegerMathOp, MapRangeKind, MappingKind, MathOp,
    MetalFresnel, MixData, MultipleScattering, NormalSpace, RaycastOutput, SheenModel, SurfaceBase,
    TangentKind, TexCoord, ToonComponent, VectorMathOp,
};
pub use obj::{ObjError, UpAxis, load_obj};
pub use panorama::Panorama;
pub use phase::PhaseFunction;
pub use picture_file::{FileColors, PictureFile};
pub use points::Points;
pub use polygon::{PolygonError, PolygonMesh, PolygonNormals};
pub use procedural::{
    BrickTexture, Dimensions, GradientKind, Metric, NoiseKind, NoiseTexture, Procedural, VoronoiFeature,
    VoronoiHash, VoronoiTexture, WaveDirection, WaveKind, WaveProfile, WaveTexture,
};
pub use subsurface::{AlbedoInversion, Subsurface, SubsurfaceMethod, SubsurfaceModel};
pub use texture::{ColorEncoding, Extension, ImageProjection, Interpolation, Texels, Texture, Tile};
pub use texture_size::{TextureSize, associate};
pub use thin_film::{FilmModel, ThinFilm};
pub use validate::{MOST_RADIANCE, SceneFault};
pub use vdb::VdbFile;
pub use world::{World, WorldPart};

/// Everything that the tracer needs, and the lights that the file came with.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The one camera that is baked.
    pub camera: Camera,
    /// Each evaluated mesh once.
    pub meshes: Vec<Mesh>,
    /// Hair curves, those of each object or particle system once.
    pub curves: Vec<Curves>,
    /// Point clouds, each once.
    pub points: Vec<Points>,
    /// Instances of geometry.
    pub instances: Vec<Instance>,
    /// Shader graphs, referred to by [`Instance::materials`].
    pub materials: Vec<Material>,
    /// Images, referred to by [`Node::ImageTexture`] and [`World`].
    pub textures: Vec<Texture>,
    /// Grids that fill volumes, referred to by [`Instance::grids`].
    pub grids: Vec<GridSet>,
    /// World that rays see which leave the scene.
    pub world: World,
    /// The lights of the file. They are no part of what is traced; the tracer only looks more often to where they stand.
    pub lights: Vec<Light>,
    /// Name of the scene-linear space of all colours, e.g. `"Linear Rec.709"`.
    pub working_space: String,
    /// Part of the scene that could not be represented, in words for the user: object, material, node.
    pub warnings: Vec<String>,
}
