//! An EXR or PNG file of any bytes is refused, or is a picture of the size that it says.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_image::{ViewTransform, read_exr, read_picture};
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = tempfile::tempdir().expect("a folder");
}

fuzz_target!(|bytes: &[u8]| FOLDER.with(|folder| {
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
