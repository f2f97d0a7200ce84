//! Shader graphs: Blender's nodes that decide how a surface or medium scatters, in topological order.
//!
//! The exporter flattens groups and reroutes, folds constants, bakes ramps and curves to tables, and names what it
//! could not translate in [`crate::Scene::warnings`]. A graph is evaluated front to back for each hit.

use crate::{Displacement, Node};

/// Index into [`Material::nodes`]; a node refers only to nodes before it.
pub type NodeId = u32;

/// A shader of surfaces and of what is inside of them.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Material {
    /// Blender material name.
    pub name: String,
    /// Pass index, which data passes show.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pass_index: u32,
    /// Nodes; links point backwards only.
    pub nodes: Vec<Node>,
    /// The closure node that is the surface; nothing is a black absorber, or seen through where there is a `volume`.
    pub surface: Option<NodeId>,
    /// The closure node of the medium that fills the inside of closed meshes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume: Option<NodeId>,
    /// Shading normal of its surface, where displacement bumps that of the mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bumped_normal: Option<Input>,
    /// Displacement of the vertices of meshes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<Displacement>,
    /// True if shadow rays meet its transparent parts as if they were opaque (Cycles' Transparent Shadows switched off).
    #[serde(default, skip_serializing_if = "is_false")]
    pub opaque_shadows: bool,
    /// True if only paths that hit it find its emission, no light samples (Cycles' Emission Sampling *None*). Light Path tells light
    /// samples nothing of a ray's kind.
    #[serde(default, skip_serializing_if = "is_false")]
    pub unsampled_emission: bool,
    /// Law by which normals that bumps and maps have bent dim diffuse reflection.
    #[serde(default, skip_serializing_if = "BumpShadowing::is_default")]
    pub bump_shadowing: BumpShadowing,
}

/// Dimming of diffuse reflection about bent normals, so that light does not end abruptly where it leaves the surface itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BumpShadowing {
    /// By the ratio of cosines: Chiang, Li and Burley, "Taming the Shadow Terminator" (2019). Cycles' before Blender 4.5.
    #[default]
    Cosines,
    /// Facets hide each other: Conty Estevez, Lecocq and Stein, "A Microfacet-Based Shadowing Function to Solve the Bump
    /// Terminator Problem" (2019). Cycles' from Blender 4.5 on.
    Facets,
    /// None, except that nothing comes from behind the surface (Cycles' Bump Map Correction switched off).
    Off,
}

impl BumpShadowing {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

fn is_zero(value: &u32) -> bool {
    *value == 0
}

fn is_false(value: &bool) -> bool {
    !*value
}

impl Material {
    /// True if rays go straight through its surface, of which only the inside counts.
    pub fn is_hull(&self) -> bool {
        self.surface.is_none() && self.volume.is_some()
    }

    /// True if its shaders ask for the kind, depth or length of rays.
    pub fn asks_light_path(&self) -> bool {
        self.nodes.iter().any(|node| matches!(node, Node::LightPath))
    }

    /// True if its glass disperses light.
    pub fn disperses(&self) -> bool {
        self.nodes.iter().any(|node| node.dispersion().is_some())
    }

    /// True if its nodes look around by rays of their own.
    pub fn looks_around(&self) -> bool {
        self.nodes.iter().any(|node| {
            matches!(node, Node::AmbientOcclusion { .. } | Node::Bevel { .. } | Node::Raycast { .. })
        })
    }

    /// True if rays have to find the object itself alone: from within, or for nodes that look around.
    pub fn meets_itself(&self) -> bool {
        let looks_at_itself = |node: &Node| match node {
            Node::AmbientOcclusion { only_local, .. } | Node::Raycast { only_local, .. } => *only_local,
            node => matches!(node, Node::Bevel { .. }),
        };
        self.has_subsurface() || self.nodes.iter().any(looks_at_itself)
    }

    /// True if light may enter in one place and leave in another.
    pub fn has_subsurface(&self) -> bool {
        self.nodes.iter().any(|node| match node {
            Node::Principled { subsurface, .. } => subsurface.is_some(),
            node => matches!(node, Node::SubsurfaceScattering { .. }),
        })
    }
}

/// An input socket: a value or a link. In JSON: `0.5`, `[r, g, b]` or `{"node": 3, "output": "color"}`.
/// Conversions are Blender's: colour to float by luminance, vector to float by average, float to three equal values.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(untagged)]
pub enum Input {
    /// A float.
    Float(f32),
    /// A colour or vector.
    Rgb([f32; 3]),
    /// Another node's output.
    Link {
        /// Number of the node.
        node: NodeId,
        /// Output of the node.
        output: Output,
    },
}

/// Output sockets of value nodes. Those of strands and points are Hair Info's and Point Info's; those of rays Light Path's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the socket names of Blender's nodes")]
pub enum Output {
    Color,
    Alpha,
    Value,
    Vector,
    Normal,
    Fresnel,
    Facing,
    Position,
    TrueNormal,
    Incoming,
    Backfacing,
    Parametric,
    Tangent,
    Location,
    ObjectIndex,
    Random,
    X,
    Y,
    Z,
    W,
    Factor,
    Distance,
    Radius,
    IsStrand,
    Intercept,
    Length,
    Thickness,
    TangentNormal,
    StrandRandom,
    PointPosition,
    PointRadius,
    PointRandom,
    IsCameraRay,
    IsShadowRay,
    IsDiffuseRay,
    IsGlossyRay,
    IsSingularRay,
    IsReflectionRay,
    IsTransmissionRay,
    IsVolumeScatterRay,
    RayLength,
    RayDepth,
    DiffuseDepth,
    GlossyDepth,
    TransparentDepth,
    PortalDepth,
    TransmissionDepth,
}
