//! Multi-layer EXR files: what is written is read, in Blender's names, from one part and from several.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

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

/// One part of RGBA, whose data window starts at `position`, in a display window of the size 7 x 5 that starts at (2, 3).
fn write_window(
    path: &std::path::Path,
    position: (i32, i32),
    size: (usize, usize),
    value: impl Fn(i32, i32) -> f32,
) {
    use exr::prelude::*;
    let places =
        (0..size.0 * size.1).map(|i| (position.0 + (i % size.0) as i32, position.1 + (i / size.0) as i32));
    let samples: Vec<f32> = places.map(|(x, y)| value(x, y)).collect();
    let list = ["R", "G", "B", "A"].map(|c| AnyChannel::new(c, FlatSamples::F32(samples.clone())));
    let attributes = LayerAttributes::default().with_position(Vec2(position.0, position.1));
    let channels = AnyChannels::sort(list.into_iter().collect());
    let layer = exr::image::Layer::new(size, attributes, Encoding::FAST_LOSSLESS, channels);
    let window = IntegerBounds::new((2, 3), (7, 5));
    let layers: Layers<_> = [layer].into_iter().collect();
    exr::image::Image::from_layers(ImageAttributes::new(window), layers).write().to_file(path).unwrap();
}

#[test]
fn data_lies_where_the_display_window_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("window.exr");
    let value = |x: i32, y: i32| (x * 100 + y) as f32;
    // Overscan on all sides, cropped to what is not black, beside the frame, and across a corner.
    for (position, size) in [((0, 0), (12, 14)), ((4, 4), (3, 2)), ((20, 3), (4, 4)), ((-5, 6), (10, 40))] {
        write_window(&path, position, size, value);
        let read = read_exr(&path).unwrap();
        assert_eq!((read.width, read.height), (7, 5));
        let image = read.get("Combined").unwrap();
        for (pixel, found) in image.data.chunks_exact(4).enumerate() {
            let (x, y) = (2 + pixel as i32 % 7, 3 + pixel as i32 / 7);
            let has = |at: i32, start: i32, size: usize| (start..start + size as i32).contains(&at);
            let expected = match has(x, position.0, size.0) && has(y, position.1, size.1) {
                true => value(x, y),
                false => 0.0,
            };
            assert_eq!(found, [expected; 4], "({x}, {y}) of data at {position:?}, {size:?}");
        }
    }
}

#[test]
fn a_black_picture_may_be_packed_further_than_deflate_can() {
    use exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("black.exr");
    let (width, height) = (2048, 1024);
    let list =
        ["R", "G", "B", "A"].map(|c| AnyChannel::new(c, FlatSamples::F16(vec![f16::ZERO; width * height])));
    let encoding = Encoding { compression: Compression::DWAB(None), ..Encoding::SMALL_LOSSLESS };
    let channels = AnyChannels::sort(list.into_iter().collect());
    let layer = exr::image::Layer::new((width, height), LayerAttributes::default(), encoding, channels);
    exr::image::Image::from_layer(layer).write().to_file(&path).unwrap();
    let bytes = std::fs::metadata(&path).unwrap().len() as usize;
    assert!(width * height * 8 > 1032 * bytes, "{bytes} bytes are no case");
    let read = read_exr(&path).unwrap();
    assert_eq!(read.get("Combined").unwrap(), &relume_image::Image::new(width, height, 4));
}

#[test]
fn a_header_that_promises_gigabytes_is_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.exr");
    write_window(&path, (2, 3), (7, 5), |_, _| 0.5);
    let honest = std::fs::read(&path).unwrap();
    // Two corners, inclusive, as little-endian numbers behind the attribute's name, type and length.
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let mut bytes = honest.clone();
        let start = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4;
        for corner in [start + 8, start + 12] {
            bytes[corner..corner + 4].copy_from_slice(&60_000i32.to_le_bytes());
        }
        std::fs::write(&path, &bytes).unwrap();
        let error = read_exr(&path).unwrap_err().to_string();
        assert!(error.contains("promises more pixels"), "{error}");
    }
}
