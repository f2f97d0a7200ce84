/// An image with its sampling-independent properties.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Blender image name or file, for messages.
    pub name: String,
    /// Pixels per row.
    pub width: usize,
    /// Rows; row 0 is the *bottom* row (v = 0), as in Blender.
    pub height: usize,
    /// RGBA texels.
    pub texels: Texels,
    /// Encoding of texels, which become scene-linear.
    pub encoding: ColorEncoding,
    /// Reading of alpha.
    pub alpha: crate::Alpha,
}

impl Texture {
    /// Makes texels black that are not finite, all channels, so that none changes its hue: as Cycles does with images. An HDRI's
    /// sun may be too bright for half floats. What is to be said of it, if there were any.
    pub fn blacken_infinite(&mut self) -> Option<String> {
        let Texels::Float(texels) = &mut self.texels else { return None };
        let unsound = texels.chunks_exact_mut(4).filter(|texel| !texel.iter().all(|value| value.is_finite()));
        let count = unsound.map(|texel| texel.fill(0.0)).count();
        let name = &self.name;
        (count > 0)
            .then(|| format!("image '{name}': {count} of its pixels are not finite numbers; taken for black"))
    }
}

/// RGBA, `width * height * 4` values.
#[derive(Clone, Debug)]
pub enum Texels {
    /// 8 bits a channel, 0..255 for 0..1.
    Byte(Vec<u8>),
    /// Floats, already scene-linear or data.
    Float(Vec<f32>),
}

/// Transfer function of byte texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorEncoding {
    /// sRGB curve with Rec.709 primaries.
    Srgb,
    /// Values are used as they are: scene-linear colour or Non-Color data.
    Linear,
}

/// Texel filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Bilinear.
    #[default]
    Linear,
    /// Nearest texel.
    Closest,
    /// Bicubic B-spline (also for Blender's Smart).
    Cubic,
}

/// Extension of a texture outside 0..1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Extension {
    /// Tile.
    #[default]
    Repeat,
    /// Clamp to the edge.
    Extend,
    /// Transparent black.
    Clip,
    /// Tile, every second one mirrored.
    Mirror,
}

/// Projection of an image: how a point on it is found from texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageProjection {
    /// X and y are the point.
    #[default]
    Flat,
    /// Onto the sides of a box, chosen by the normal in object space.
    Box {
        /// Width of the blending of sides, 0..1.
        blend: f32,
    },
    /// From the middle of the unit cube onto a sphere around it.
    Sphere,
    /// From the z axis through the middle of the unit cube onto a cylinder.
    Tube,
    /// All directions by longitude and latitude.
    Equirectangular,
    /// All directions as a mirroring ball shows them from the front, along y.
    MirrorBall,
    /// The unit cube, as layers across z: the image has them one above another, the lowest z at the bottom.
    Layers {
        /// Number of layers.
        count: usize,
        /// True if places of the world are looked up, and the cube is the bounding box of the object's mesh.
        of_object: bool,
    },
}

impl ImageProjection {
    pub(crate) fn is_flat(&self) -> bool {
        *self == Self::Flat
    }
}

/// Tile of an image that covers more than 0..1 (UDIM).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Tile {
    /// 1001 for the first; one more to the right, up to ten in a row, ten more upwards.
    pub number: u32,
    /// Image of the tile, an index into [`crate::Scene::textures`].
    pub texture: usize,
}
