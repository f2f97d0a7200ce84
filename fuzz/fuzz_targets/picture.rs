//! An EXR, PNG, JPEG, TIFF or Radiance file of any bytes is refused, or is a picture of the size that it says.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_image::{ViewTransform, read_exr, read_picture};
use relume_scene::{Alpha, FileColors, PictureFile, Texels};
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = tempfile::tempdir().expect("a folder");
}

/// Decodes bytes of a picture as a texture.
fn decode(bytes: &[u8]) {
    let Ok(picture) = PictureFile::decode(bytes) else { return };
    let texture = picture.into_texture("fuzzed".into(), FileColors::Srgb, Alpha::Premultiplied, None);
    let values = match &texture.texels {
        Texels::Byte(texels) => texels.len(),
        Texels::Float(texels) => texels.len(),
    };
    assert_eq!(values, texture.width * texture.height * 4);
}

fuzz_target!(|bytes: &[u8]| FOLDER.with(|folder| {
    decode(bytes);
    let png = bytes.starts_with(b"\x89PNG");
    let path = folder.path().join(if png { "picture.png" } else { "picture.exr" });
    std::fs::write(&path, bytes).expect("written");
    if let Ok(image) = read_picture(&path) {
        assert_eq!((image.channels, image.data.len()), (3, image.width * image.height * 3));
    }
    if png {
        if let Ok(view) = ViewTransform::read_lut(&path) {
            view.apply([0.5, f32::NAN, f32::INFINITY]);
        }
    } else if let Ok(file) = read_exr(&path) {
        let size = |image: &relume_image::Image| (image.width, image.height);
        assert!(file.layers.iter().all(|layer| size(&layer.image) == (file.width, file.height)));
    }
}));
