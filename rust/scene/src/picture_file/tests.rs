use super::*;
use ::exr::prelude as exr;
use ::exr::prelude::WritableImage;
use ::tiff::encoder::{TiffEncoder, colortype};
use std::io::Cursor;

/// Gradients of 16 x 12 pixels: red to the right, green downwards in the file.
const JPEG: &[u8] = include_bytes!("../../tests/data/gradient.jpg");
const COLOR: [f32; 4] = [0.25, 0.5, 0.125, 0.5];

fn bytes_of(texels: &Texels) -> &[u8] {
    let Texels::Byte(bytes) = texels else { panic!("floats") };
    bytes
}

fn floats_of(texels: &Texels) -> &[f32] {
    let Texels::Float(floats) = texels else { panic!("bytes") };
    floats
}

/// 2 x 2 pixels.
fn png(color: ::png::ColorType, depth: ::png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

fn tiff_of<C: colortype::ColorType>(size: [u32; 2], values: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    TiffEncoder::new(&mut bytes).unwrap().write_image::<C>(size[0], size[1], values).unwrap();
    bytes.into_inner()
}

/// Two pixels, one above the other, black below; `display` as the rows that the file shows.
fn exr_of(names: &[&str], display: usize) -> Vec<u8> {
    let of = |name: &str| COLOR["RGBA".find(name).unwrap_or(0)];
    let channels = names
        .iter()
        .map(|&name| exr::AnyChannel::new(name, exr::FlatSamples::F32(vec![of(name), 0.0])))
        .collect();
    let layer = exr::Layer::new(
        (1, 2),
        exr::LayerAttributes::default(),
        exr::Encoding::SMALL_LOSSLESS,
        exr::AnyChannels::sort(channels),
    );
    let mut image = exr::Image::from_layer(layer);
    image.attributes.display_window.size = exr::Vec2(1, display);
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn radiance(size: [usize; 2], pixels: &[u8]) -> Vec<u8> {
    let head = format!("#?RADIANCE\nGAMMA=1\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", size[1], size[0]);
    [head.as_bytes(), pixels].concat()
}

#[test]
fn pngs_of_every_kind_become_rgba_from_the_bottom_row() {
    use ::png::{BitDepth, ColorType};
    let read = |color, depth, data: &[u8]| PictureFile::decode(&png(color, depth, data)).unwrap().texels;
    let gray = read(ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4]);
    assert_eq!(bytes_of(&gray), [3, 3, 3, 255, 4, 4, 4, 255, 1, 1, 1, 255, 2, 2, 2, 255]);
    let data: Vec<u8> = (0..16).collect();
    let rgba = read(ColorType::Rgba, BitDepth::Eight, &data);
    assert_eq!(bytes_of(&rgba), [8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7]);
    let deep = read(ColorType::Grayscale, BitDepth::Sixteen, &[1, 0, 2, 0, 0x80, 0, 0xff, 0xff]);
    assert_eq!(
        floats_of(&deep)[..8],
        [[[32768.0 * STEP; 3].as_slice(), &[1.0]].concat(), vec![1.0; 4]].concat()
    );
}

#[test]
fn a_jpeg_is_read_from_the_bottom_row() {
    let picture = PictureFile::decode(JPEG).unwrap();
    let texels = bytes_of(&picture.texels);
    assert_eq!((picture.width, picture.height, texels.len()), (16, 12, 16 * 12 * 4));
    let at = |x: usize, y: usize| &texels[4 * (y * 16 + x)..][..4];
    // What Blender 5.2 reads; decoders may round differently.
    let blender = [
        (0, 0, [14, 249, 130, 255]),
        (15, 0, [255, 253, 136, 255]),
        (0, 11, [0, 3, 120, 255]),
        (15, 11, [244, 6, 126, 255]),
        (7, 5, [119, 139, 130, 255]),
        (3, 2, [51, 208, 129, 255]),
    ];
    for (x, y, wanted) in blender {
        let near = at(x, y).iter().zip(wanted).all(|(&found, wanted): (_, u8)| found.abs_diff(wanted) <= 2);
        assert!(near, "{x} {y}: {:?}, not {wanted:?}", at(x, y));
    }
}

#[test]
fn tiffs_are_read_from_the_bottom_row() {
    let read = |file: Vec<u8>| PictureFile::decode(&file).unwrap().texels;
    let gray = read(tiff_of::<colortype::Gray8>([1, 2], &[7, 9]));
    assert_eq!(bytes_of(&gray), [9, 9, 9, 255, 7, 7, 7, 255]);
    let rgb = read(tiff_of::<colortype::RGB16>([1, 1], &[0, 0x8000, 0xffff]));
    assert_eq!(floats_of(&rgb), [0.0, 32768.0 * STEP, 1.0, 1.0]);
    let rgba = read(tiff_of::<colortype::RGBA32Float>([1, 1], &[-1.0, 2.0, 3.0, 0.5]));
    assert_eq!(floats_of(&rgba), [-1.0, 2.0, 3.0, 0.5]);
    assert!(PictureFile::decode(&tiff_of::<colortype::CMYK8>([1, 1], &[1; 4])).is_err());
}

#[test]
fn plain_exrs_are_read_from_the_bottom_row() {
    let read = |names: &[&str], rows| PictureFile::decode(&exr_of(names, rows));
    let rgba = read(&["R", "G", "B", "A"], 2).unwrap().texels;
    assert_eq!(floats_of(&rgba), [[0.0; 4], COLOR].concat());
    let rgb = read(&["R", "G", "B"], 2).unwrap().texels;
    assert_eq!(floats_of(&rgb), [0.0, 0.0, 0.0, 1.0, COLOR[0], COLOR[1], COLOR[2], 1.0]);
    let gray = read(&["Y"], 2).unwrap().texels;
    assert_eq!(floats_of(&gray)[4..], [COLOR[0], COLOR[0], COLOR[0], 1.0]);
    // What Blender has in layers, or in another place.
    assert!(read(&["View.Combined.R", "View.Combined.G", "View.Combined.B"], 2).is_err());
    assert!(read(&["R", "G", "B"], 3).is_err());
}

#[test]
fn radiance_pictures_are_read_flat_and_in_runs() {
    let flat = PictureFile::decode(&radiance([1, 2], &[128, 64, 0, 129, 1, 2, 3, 0])).unwrap().texels;
    assert_eq!(floats_of(&flat), [0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 1.0]);
    let runs = [2, 2, 0, 8, 128 + 8, 128, 8, 0, 0, 0, 0, 0, 0, 0, 64, 128 + 8, 0, 128 + 7, 129, 1, 130];
    let row = PictureFile::decode(&radiance([8, 1], &runs)).unwrap().texels;
    let (pixels, _) = floats_of(&row).as_chunks::<4>();
    assert_eq!((pixels[0], pixels[7]), ([1.0, 0.0, 0.0, 1.0], [2.0, 1.0, 0.0, 1.0]));
    for broken in [&runs[..20], &[2, 2, 0, 8, 128 + 9, 1], &[2, 2, 0, 8, 0], &[1, 1, 1, 3]] {
        assert!(PictureFile::decode(&radiance([8, 1], broken)).is_err());
    }
}

#[test]
fn alpha_and_curve_are_those_of_blender() {
    let texture = |texels, colors, alpha| {
        PictureFile { width: 1, height: 1, texels }.into_texture("test".into(), colors, alpha, None)
    };
    let bytes = |alpha| texture(Texels::Byte(vec![11, 20, 200, 100]), FileColors::Srgb, alpha).texels;
    assert_eq!(bytes_of(&bytes(Alpha::Straight)), [11, 20, 200, 100]);
    assert_eq!(bytes_of(&bytes(Alpha::Premultiplied)), [28, 51, 255, 100]);
    assert_eq!(bytes_of(&bytes(Alpha::None)), [11, 20, 200, 255]);
    let data = texture(Texels::Byte(vec![11, 20, 200, 100]), FileColors::Data, Alpha::None);
    assert_eq!(
        (bytes_of(&data.texels), data.encoding),
        ([11, 20, 200, 100].as_slice(), ColorEncoding::Linear)
    );

    let floats = |colors, alpha| texture(Texels::Float(COLOR.to_vec()), colors, alpha).texels;
    assert_eq!(floats_of(&floats(FileColors::Linear, Alpha::Straight)), [0.125, 0.25, 0.0625, 0.5]);
    assert_eq!(floats_of(&floats(FileColors::Linear, Alpha::Premultiplied)), COLOR);
    assert_eq!(floats_of(&floats(FileColors::Data, Alpha::Straight)), COLOR);
    let curve = |encoded: f32| ((encoded + 0.055) / 1.055).powf(2.4);
    let straight = floats(FileColors::Srgb, Alpha::Straight);
    assert!((floats_of(&straight)[1] - curve(0.5) * 0.5).abs() < 1e-7);
    let premultiplied = floats(FileColors::Srgb, Alpha::Premultiplied);
    assert!((floats_of(&premultiplied)[1] - curve(1.0) * 0.5).abs() < 1e-7);
    let packed = floats(FileColors::Srgb, Alpha::ChannelPacked);
    assert!((floats_of(&packed)[1] - curve(0.5)).abs() < 1e-7);
}

#[test]
fn colours_of_floats_alone_are_turned_into_the_scenes_space() {
    let turn = Mat3::from_cols(Vec3::new(0.5, 0.25, 0.0), Vec3::Y, Vec3::new(0.0, 0.0, 2.0));
    let texture = |texels, colors| {
        PictureFile { width: 1, height: 1, texels }.into_texture(
            "test".into(),
            colors,
            Alpha::Straight,
            Some(turn),
        )
    };
    let floats = |colors| texture(Texels::Float(vec![0.5, 0.25, 0.125, 0.5]), colors).texels;
    assert_eq!(floats_of(&floats(FileColors::Linear)), [0.125, 0.1875, 0.125, 0.5]);
    assert_eq!(floats_of(&floats(FileColors::Data)), [0.5, 0.25, 0.125, 0.5]);
    let bytes = texture(Texels::Byte(vec![11, 20, 200, 255]), FileColors::Srgb).texels;
    assert_eq!(bytes_of(&bytes), [11, 20, 200, 255]);
}

#[test]
fn damaged_files_are_refused_in_words() {
    let png = png(::png::ColorType::Rgb, ::png::BitDepth::Eight, &[0; 12]);
    let (tiff, exr) = (tiff_of::<colortype::Gray8>([8, 8], &[0; 64]), exr_of(&["Y"], 2));
    let radiance = radiance([8, 8], &[0; 8 * 8 * 4]);
    for file in [JPEG, &png, &tiff, &exr, &radiance, b"hello"] {
        for length in [0, 1, 2, 3, 9, file.len() / 3, file.len() / 2] {
            assert!(PictureFile::decode(&file[..length.min(file.len() - 1)]).is_err());
        }
    }
    assert!(PictureFile::read(Path::new("no such file")).is_err());
}

#[test]
fn headers_that_promise_too_much_are_refused_before_memory_is_taken() {
    let at = |file: &[u8], what: &[u8]| file.windows(what.len()).position(|found| found == what).unwrap();
    let mut jpeg = JPEG.to_vec();
    let frame = at(JPEG, &[0xff, 0xc0]);
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x7f, 0xff, 0x7f, 0xff]);
    // The width, tag 256, a number of 32 bits.
    let mut tiff = tiff_of::<colortype::Gray8>([8, 8], &[0; 64]);
    let entry = at(&tiff, &[256u16.to_le_bytes(), 4u16.to_le_bytes()].concat());
    tiff[entry + 8..entry + 12].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    let radiance = radiance([1 << 30, 1 << 30], &[0; 64]);
    let mut exr = exr_of(&["Y"], 2);
    for window in [b"dataWindow\0box2i\0".as_slice(), b"displayWindow\0box2i\0"] {
        let corner = at(&exr, window) + window.len() + 4 + 8;
        exr[corner..corner + 8].copy_from_slice(&[0xff, 0xff, 0x0f, 0, 0xff, 0xff, 0x0f, 0]);
    }
    for file in [jpeg, tiff, radiance, exr] {
        let error = PictureFile::decode(&file).unwrap_err();
        assert!(error.contains("more pixels"), "{error}");
    }
}
