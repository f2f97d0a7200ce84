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
    /// How texels become scene-linear.
    pub encoding: ColorEncoding,
    /// How alpha is read.
    pub alpha: crate::Alpha,
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

/// What lies outside 0..1.
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
