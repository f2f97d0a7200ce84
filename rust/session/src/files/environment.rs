use crate::error::SessionError;
use relume_image::read_picture;
use relume_scene::{Alpha, ColorEncoding, Texels, Texture};
use std::path::Path;

/// Reads an equirectangular picture as a texture for a world: EXR is scene-linear, PNG by the sRGB curve. The text is a
/// warning about pixels that are not finite, which become black.
///
/// # Errors
/// If the file cannot be read.
pub fn environment_texture(path: &Path) -> Result<(Texture, Option<String>), SessionError> {
    let image = read_picture(path)?;
    // Textures begin with the bottom row.
    let rows = image.data.chunks_exact(image.width * 3).rev();
    let texels =
        rows.flat_map(|row| row.chunks_exact(3).flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 1.0])).collect();
    let mut texture = Texture {
        name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        width: image.width,
        height: image.height,
        texels: Texels::Float(texels),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    };
    let warning = texture.blacken_infinite();
    Ok((texture, warning))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_image::{Image, Layer, LayeredImage, Precision, write_exr};
    use std::collections::BTreeMap;

    #[test]
    fn pixels_that_are_not_finite_are_black_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.exr");
        let pixels = vec![0.5, f32::INFINITY, 0.5, 1.0, 2.0, 3.0];
        let layers = vec![Layer::color("Combined", Image { data: pixels, ..Image::new(2, 1, 3) })];
        let file = LayeredImage { width: 2, height: 1, layers, attributes: BTreeMap::new() };
        write_exr(&path, &file, Precision::Float).unwrap();
        let (texture, warning) = environment_texture(&path).unwrap();
        let Texels::Float(texels) = texture.texels else { panic!("bytes") };
        assert_eq!(texels, [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 1.0]);
        assert!(warning.unwrap().starts_with("image 'sky.exr': 1 of"));
    }
}
