//! Multi-layer EXR files: what is written is read, in Blender's names, from one part and from several.

use relume_image::{Image, Layer, LayeredImage, Precision, read_exr, read_picture, write_exr};

fn gradient(channels: usize, scale: f32) -> Image {
    let (width, height) = (7, 5);
    let data = (0..width * height * channels).map(|i| i as f32 * scale).collect();
    Image { width, height, channels, data }
}

fn layered() -> LayeredImage {
    let layers = vec![
        Layer::color("Combined", gradient(4, 0.25)),
        Layer::color("Combined_Key.001", gradient(3, 0.5)),
        Layer::vector("normal", gradient(3, 0.125)),
        Layer::depth("depth", gradient(1, 1.0 / 3.0)),
    ];
    let attributes = [("relume/scene".to_string(), "abc".to_string())].into();
    LayeredImage { width: 7, height: 5, layers, attributes }
}

#[test]
fn layers_channels_and_attributes_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    for precision in [Precision::Half, Precision::Float] {
        write_exr(&path, &layered(), precision).unwrap();
        let read = read_exr(&path).unwrap();
        // Quarters are exact in half floats; thirds (depth) are not, and come back because depth stays float.
        assert_eq!(read.get("Combined"), layered().get("Combined"));
        assert_eq!(read.get("normal"), layered().get("normal"));
        assert_eq!(read.get("depth"), layered().get("depth"));
        assert_eq!(read.attributes["relume/scene"], "abc");
        assert_eq!(read.layers[0].channels, ["R", "G", "B", "A"]);
        assert_eq!(read.layers[0].view_layer, "ViewLayer");
    }
}

#[test]
fn dots_of_a_light_name_become_underscores_as_in_blender() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write_exr(&path, &layered(), Precision::Float).unwrap();
    let read = read_exr(&path).unwrap();
    assert_eq!(read.get("Combined_Key_001"), layered().get("Combined_Key.001"));
}

#[test]
fn half_files_hold_no_infinities() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    let mut image = layered();
    image.layers[0].image.data[0] = 1e9;
    write_exr(&path, &image, Precision::Half).unwrap();
    assert_eq!(read_exr(&path).unwrap().get("Combined").unwrap().data[0], 65504.0);
}

#[test]
fn parts_named_by_pass_are_read_like_one_part() {
    use exr::prelude::*;
    let part = |name: &str, channels: &[&str]| {
        let list = channels.iter().map(|c| AnyChannel::new(*c, FlatSamples::F32(vec![0.5; 35]))).collect();
        let attributes = LayerAttributes::named(name);
        exr::image::Layer::new((7, 5), attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(list))
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parts.exr");
    // Both ways of naming: the whole name in the channel, or its front in the part.
    let parts: Layers<_> = [
        part("ViewLayer.Combined", &["A", "B", "G", "R"]),
        part("ViewLayer.Depth", &["ViewLayer.Depth.Z"]),
        part("ViewLayer.Combined_Key", &["B", "G", "R"]),
    ]
    .into_iter()
    .collect();
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((7, 5)));
    exr::image::Image::from_layers(attributes, parts).write().to_file(&path).unwrap();

    let read = read_exr(&path).unwrap();
    let names: Vec<_> = read.layers.iter().map(|l| (l.view_layer.as_str(), l.name.as_str())).collect();
    assert_eq!(names, [("ViewLayer", "Combined"), ("ViewLayer", "Combined_Key"), ("ViewLayer", "Depth")]);
    assert_eq!(read_picture(&path).unwrap().channels, 3);
}

#[test]
fn damaged_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write_exr(&path, &layered(), Precision::Half).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for keep in [0, 3, 40, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..keep]).unwrap();
        let message = read_exr(&path).unwrap_err().to_string();
        assert!(message.contains("out.exr"), "{keep} bytes: {message}");
    }
}

#[test]
fn layers_of_different_sizes_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    let mut image = layered();
    image.layers[1].image = Image::new(3, 3, 3);
    assert!(write_exr(&path, &image, Precision::Half).unwrap_err().to_string().contains("Combined_Key.001"));
    let mut image = layered();
    image.layers.push(image.layers[0].clone());
    assert!(write_exr(&path, &image, Precision::Half).unwrap_err().to_string().contains("same name"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn flipped_bits_are_errors_or_other_pixels_but_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write_exr(&path, &layered(), Precision::Half).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    // All of the header, and some of the pixels.
    for at in (0..bytes.len()).filter(|at| *at < 800 || at % 5 == 0) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        std::fs::write(&path, &damaged).unwrap();
        if let Ok(read) = read_exr(&path) {
            assert!(
                read.layers.iter().all(|l| l.image.data.len() == l.image.pixel_count() * l.channels.len())
            );
        }
    }
}
