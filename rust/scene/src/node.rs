use crate::sockets::{Sockets, with_sockets};
use crate::{
    BlendMode, ColorMode, Curve, Dispersion, Distribution, Extension, HairComponent, IesProfile,
    ImageProjection, Input, IntegerMathOp, Interpolation, MapRangeKind, MappingKind, MathOp, MetalFresnel,
    MixData, MultipleScattering, NodeId, NormalSpace, PhaseFunction, PrincipledHair, Procedural,
    RaycastOutput, SheenModel, Subsurface, SurfaceBase, TangentKind, TexCoord, ThinFilm, Tile, ToonComponent,
    VectorMathOp,
};

with_sockets! {
    /// A shader node. Fields carry Blender's socket names and units. A `normal` of `None` is the shading normal.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(tag = "type", rename_all = "snake_case")]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's nodes of the same name")]
    #[expect(clippy::large_enum_variant, reason = "a scene has a few hundred nodes")]
    pub enum Node {
        // Closures.
        Principled {
            base_color: Input,
            metallic: Input,
            roughness: Input,
            diffuse_roughness: Input,
            #[serde(default, skip_serializing_if = "MultipleScattering::is_default")]
            multiple_scattering: MultipleScattering,
            ior: Input,
            alpha: Input,
            normal: Option<Input>,
            subsurface_weight: Input,
            /// Subsurface scattering of this weight; none is diffuse.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            subsurface: Option<Subsurface>,
            /// A sheet without an inside where it is not 0, of glass as of skin; none is 0.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            thin_wall: Option<Input>,
            specular_ior_level: Input,
            specular_tint: Input,
            anisotropic: Input,
            anisotropic_rotation: Input,
            tangent: Option<Input>,
            transmission_weight: Input,
            coat_weight: Input,
            coat_roughness: Input,
            coat_ior: Input,
            coat_tint: Input,
            coat_normal: Option<Input>,
            sheen_weight: Input,
            sheen_roughness: Input,
            sheen_tint: Input,
            emission_color: Input,
            emission_strength: Input,
            /// Film upon it; none is none.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            film: Option<ThinFilm>,
            /// Dispersion of its glass; none is none.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            dispersion: Option<Dispersion>,
            /// Glass is rough along the tangent, too.
            #[serde(default, skip_serializing_if = "std::ops::Not::not")]
            anisotropic_glass: bool,
            distribution: Distribution,
        },
        Diffuse {
            color: Input,
            roughness: Input,
            #[serde(default, skip_serializing_if = "MultipleScattering::is_default")]
            multiple_scattering: MultipleScattering,
            normal: Option<Input>,
        },
        /// The Diffuse BSDF of Blender 4.2, whose rough surfaces lose what is scattered more than once.
        SingleScatteringDiffuse {
            color: Input,
            roughness: Input,
            normal: Option<Input>,
        },
        Glossy {
            color: Input,
            roughness: Input,
            anisotropy: Input,
            rotation: Input,
            normal: Option<Input>,
            tangent: Option<Input>,
            distribution: Distribution,
        },
        Metallic {
            fresnel: MetalFresnel,
            base_color: Input,
            edge_tint: Input,
            ior: Input,
            extinction: Input,
            roughness: Input,
            anisotropy: Input,
            rotation: Input,
            normal: Option<Input>,
            tangent: Option<Input>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            film: Option<ThinFilm>,
            distribution: Distribution,
        },
        Sheen {
            model: SheenModel,
            color: Input,
            roughness: Input,
            normal: Option<Input>,
        },
        Toon {
            component: ToonComponent,
            color: Input,
            size: Input,
            smooth: Input,
            normal: Option<Input>,
        },
        Glass {
            color: Input,
            roughness: Input,
            ior: Input,
            normal: Option<Input>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            anisotropy: Option<Input>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            rotation: Option<Input>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            tangent: Option<Input>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            film: Option<ThinFilm>,
            distribution: Distribution,
        },
        Refraction {
            color: Input,
            roughness: Input,
            ior: Input,
            normal: Option<Input>,
            distribution: Distribution,
        },
        Translucent {
            color: Input,
            normal: Option<Input>,
        },
        SubsurfaceScattering {
            color: Input,
            roughness: Input,
            normal: Option<Input>,
            subsurface: Subsurface,
        },
        /// Principled Hair.
        PrincipledHair(PrincipledHair),
        /// Hair BSDF. A `tangent` of `None` is the strand's.
        HairBsdf {
            component: HairComponent,
            color: Input,
            offset: Input,
            roughness_u: Input,
            roughness_v: Input,
            tangent: Option<Input>,
        },
        Transparent {
            color: Input,
        },
        /// Rays go on at a position in world space, that of the hit if there is none, along a direction, their own if that is 0.
        RayPortal {
            color: Input,
            position: Option<Input>,
            direction: Input,
        },
        Emission {
            color: Input,
            strength: Input,
        },
        /// Cuts a hole into the film where the camera sees it; black to other rays.
        Holdout,
        MixShader {
            factor: Input,
            a: Option<NodeId>,
            b: Option<NodeId>,
        },
        AddShader {
            a: Option<NodeId>,
            b: Option<NodeId>,
        },
        // Closures of media, per metre; Emission, mixing and adding serve these, too.
        VolumeScatter {
            color: Input,
            density: Input,
            phase: PhaseFunction,
        },
        VolumeAbsorption {
            color: Input,
            density: Input,
        },
        VolumeCoefficients {
            absorption: Input,
            scatter: Input,
            emission: Input,
            phase: PhaseFunction,
        },
        /// Attributes are factors, 1 where an object lacks them or the name is empty. `blackbody` is the colour of black bodies by
        /// their temperature; nothing if they do not glow.
        PrincipledVolume {
            color: Input,
            color_attribute: String,
            density: Input,
            density_attribute: String,
            anisotropy: Input,
            absorption_color: Input,
            emission_strength: Input,
            emission_color: Input,
            blackbody_intensity: Input,
            blackbody_tint: Input,
            blackbody: Option<Curve>,
            temperature: Input,
            temperature_attribute: String,
        },
        // Textures and coordinates.
        /// An image, or tiles of one: then `texture` is shown outside of them.
        ImageTexture {
            texture: usize,
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            tiles: Vec<Tile>,
            vector: Option<Input>,
            interpolation: Interpolation,
            extension: Extension,
            #[serde(default, skip_serializing_if = "ImageProjection::is_flat")]
            projection: ImageProjection,
        },
        /// Procedural texture; in JSON `{"type": "procedural", "texture": "noise", ...}`.
        Procedural(Procedural),
        /// Strength of a photometric file; without a vector, along the way back in object space.
        Ies {
            profile: IesProfile,
            strength: Input,
            vector: Option<Input>,
        },
        TextureCoordinate {
            kind: TexCoord,
        },
        UvMap {
            name: String,
        },
        ColorAttribute {
            name: String,
        },
        /// A named attribute of any kind, or a UV map; black and opaque where a mesh lacks it.
        Attribute {
            name: String,
        },
        Mapping {
            kind: MappingKind,
            vector: Input,
            location: Input,
            rotation: Input,
            scale: Input,
        },
        NormalMap {
            space: NormalSpace,
            uv_map: String,
            strength: Input,
            color: Input,
            #[serde(default, skip_serializing_if = "SurfaceBase::is_default")]
            base: SurfaceBase,
        },
        /// `filter_width` is the step of the finite differences in pixels: a socket in recent versions, 1 in Blender 4.2.
        Bump {
            invert: bool,
            strength: Input,
            distance: Input,
            #[serde(default = "default_filter_width")]
            filter_width: Input,
            height: Input,
            normal: Option<Input>,
            #[serde(default, skip_serializing_if = "SurfaceBase::is_default")]
            base: SurfaceBase,
        },
        /// A displacement as a vector in world space, whose height is in object or world space.
        Displacement {
            world_space: bool,
            height: Input,
            midlevel: Input,
            scale: Input,
            normal: Option<Input>,
        },
        /// A displacement as a vector in world space; `space` is that of `vector`, tangent space by the active UV map with y along
        /// the normal.
        VectorDisplacement {
            space: NormalSpace,
            vector: Input,
            midlevel: Input,
            scale: Input,
        },
        // Colour and maths.
        Mix {
            data: MixData,
            blend: BlendMode,
            clamp_factor: bool,
            clamp_result: bool,
            factor: Input,
            a: Input,
            b: Input,
        },
        Math {
            operation: MathOp,
            clamp: bool,
            a: Input,
            b: Input,
            c: Input,
        },
        IntegerMath {
            operation: IntegerMathOp,
            a: Input,
            b: Input,
            c: Input,
        },
        VectorMath {
            operation: VectorMathOp,
            a: Input,
            b: Input,
            c: Input,
            scale: Input,
        },
        MapRange {
            interpolation: MapRangeKind,
            clamp: bool,
            /// A range of no width gives `to_min`, as from Blender 5.0 on, not 0.
            #[serde(default)]
            empty_gives_min: bool,
            value: Input,
            from_min: Input,
            from_max: Input,
            to_min: Input,
            to_max: Input,
            steps: Input,
        },
        Clamp {
            range: bool,
            value: Input,
            min: Input,
            max: Input,
        },
        ColorRamp {
            factor: Input,
            ramp: Curve,
        },
        RgbCurves {
            factor: Input,
            color: Input,
            curves: Curve,
        },
        HueSaturation {
            hue: Input,
            saturation: Input,
            value: Input,
            factor: Input,
            color: Input,
        },
        BrightContrast {
            color: Input,
            bright: Input,
            contrast: Input,
        },
        Gamma {
            color: Input,
            gamma: Input,
        },
        Invert {
            factor: Input,
            color: Input,
        },
        /// RGB, HSV or HSL to x, y, z.
        SeparateColor {
            mode: ColorMode,
            color: Input,
        },
        CombineColor {
            mode: ColorMode,
            a: Input,
            b: Input,
            c: Input,
        },
        SeparateXyz {
            vector: Input,
        },
        CombineXyz {
            x: Input,
            y: Input,
            z: Input,
        },
        // Geometry.
        /// Share of rays about the normal, or about its opposite `inside`, that meet nothing nearer than the distance.
        AmbientOcclusion {
            samples: usize,
            inside: bool,
            only_local: bool,
            color: Input,
            distance: Input,
            normal: Option<Input>,
        },
        /// Mean normal of the object's surface around the point.
        Bevel {
            samples: usize,
            radius: Input,
            normal: Option<Input>,
        },
        /// The first that a ray meets: its start is the point and its direction the normal where there is none.
        Raycast {
            asked: RaycastOutput,
            only_local: bool,
            position: Option<Input>,
            direction: Option<Input>,
            length: Input,
        },
        Tangent {
            kind: TangentKind,
            uv_map: String,
        },
        /// 1 near edges of triangles, else 0. `size` is the width of the lines in metres, or in pixels.
        Wireframe {
            in_pixels: bool,
            size: Input,
        },
        Fresnel {
            ior: Input,
            normal: Option<Input>,
        },
        LayerWeight {
            blend: Input,
            normal: Option<Input>,
        },
        Geometry,
        ObjectInfo,
        HairInfo,
        PointInfo,
        LightPath,
    }
}

fn default_filter_width() -> Input {
    Input::Float(1.0)
}

impl Node {
    /// Numbers of the images that it shows.
    pub(crate) fn textures(&self) -> impl Iterator<Item = usize> {
        let (own, tiles) = match self {
            Self::ImageTexture { texture, tiles, .. } => (Some(*texture), tiles.as_slice()),
            _ => (None, &[][..]),
        };
        own.into_iter().chain(tiles.iter().map(|tile| tile.texture))
    }

    /// Number of its image and of the layers in that, if it is looked up as a 3D image.
    pub(crate) fn layers(&self) -> Option<(usize, usize)> {
        match self {
            Self::ImageTexture { texture, projection: ImageProjection::Layers { count, .. }, .. } => {
                Some((*texture, *count))
            }
            _ => None,
        }
    }

    /// Dispersion of its glass.
    pub(crate) fn dispersion(&self) -> Option<&Dispersion> {
        match self {
            Self::Principled { dispersion, .. } => dispersion.as_ref(),
            _ => None,
        }
    }

    /// Calls `visit` for every input socket.
    pub fn for_each_input(&mut self, mut visit: impl FnMut(&mut Input)) {
        self.visit_sockets(&mut visit);
    }
}
