use crate::SessionError;
use relume_image::read_picture;
use relume_scene::{Alpha, ColorEncoding, Texels, Texture};
use std::path::Path;

/// Reads an equirectangular picture (EXR scene-linear, PNG by the sRGB curve) as a texture for a world.
///
/// # Errors
/// If the file cannot be read.
pub fn environment_texture(path: &Path) -> Result<Texture, SessionError> {
    let image = read_picture(path)?;
    // Textures begin with the bottom row.
    let rows = image.data.chunks_exact(image.width * 3).rev();
    let texels =
        rows.flat_map(|row| row.chunks_exact(3).flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 1.0])).collect();
    Ok(Texture {
        name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        width: image.width,
        height: image.height,
        texels: Texels::Float(texels),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    })
}
