//! Multi-layer EXR with Blender's channel names, `<view layer>.<pass>.<channel>`.
//!
//! Written as a single part, which every reader understands. Read from a single part (Blender up to 4.x) and from
//! one part a pass (Blender 5.x), where the part may carry the front of the name.

use crate::{Image, ImageError, write_atomically};
use exr::prelude as exr;
use std::collections::BTreeMap;
use std::io::{self, Seek};
use std::path::Path;

/// One pass of a multi-layer image.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Blender view layer; empty for plain images.
    pub view_layer: String,
    /// Pass name, e.g. `Combined` or `Combined_Key`; dots become underscores in a file. Empty for the picture of a plain image.
    pub name: String,
    /// Channel names, one for each channel of the image, e.g. `R`, `G`, `B`.
    pub channels: Vec<String>,
    /// The pixels.
    pub image: Image,
}

impl Layer {
    /// A colour pass: 1 channel is `V`, 3 are `R G B`, 4 are `R G B A`.
    pub fn color(name: impl Into<String>, image: Image) -> Self {
        let names: &[&str] = match image.channels {
            1 => &["V"],
            3 => &["R", "G", "B"],
            _ => &["R", "G", "B", "A"],
        };
        Self::named(name, names, image)
    }

    /// A vector pass, `X Y Z`.
    pub fn vector(name: impl Into<String>, image: Image) -> Self {
        Self::named(name, &["X", "Y", "Z"], image)
    }

    /// A depth pass, `Z`; always written as 32-bit floats.
    pub fn depth(name: impl Into<String>, image: Image) -> Self {
        Self::named(name, &["Z"], image)
    }

    fn named(name: impl Into<String>, channels: &[&str], image: Image) -> Self {
        let channels = channels.iter().map(|c| c.to_string()).collect();
        Self { view_layer: "ViewLayer".into(), name: name.into(), channels, image }
    }

    fn is_depth(&self) -> bool {
        self.channels == ["Z"]
    }
}

/// All passes of one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayeredImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The passes; in a file they are sorted by name.
    pub layers: Vec<Layer>,
    /// Text attributes of the file, by name.
    pub attributes: BTreeMap<String, String>,
}

impl LayeredImage {
    /// The pixels of the first pass of this name.
    pub fn get(&self, name: &str) -> Option<&Image> {
        self.layers.iter().find(|layer| layer.name == name).map(|layer| &layer.image)
    }
}

/// Numbers in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 16 bits; values beyond 65504 are clamped, depth stays at 32 bits.
    #[default]
    Half,
    /// 32 bits.
    Float,
}

/// Writes a single-part, ZIP-compressed multi-layer EXR, atomically.
pub fn write_exr(path: &Path, image: &LayeredImage, precision: Precision) -> Result<(), ImageError> {
    let channels = channels(image, precision)
        .map_err(|reason| ImageError::Format { path: path.to_path_buf(), reason })?;
    let text = |(name, value): (&String, &String)| {
        Some((exr::Text::new_or_none(name)?, exr::AttributeValue::Text(exr::Text::new_or_none(value)?)))
    };
    let attributes = exr::LayerAttributes {
        software_name: exr::Text::new_or_none("Relume"),
        other: image.attributes.iter().filter_map(text).collect(),
        ..Default::default()
    };
    let encoding = exr::Encoding {
        compression: exr::Compression::ZIP16,
        blocks: exr::Blocks::ScanLines,
        line_order: exr::LineOrder::Increasing,
    };
    let layer = exr::Layer::new((image.width, image.height), attributes, encoding, channels);
    write_atomically(path, |writer| {
        use exr::WritableImage;
        exr::Image::from_layer(layer).write().to_buffered(writer).map_err(io_error)
    })
}

/// All channels of all layers, or why they do not make a picture.
fn channels(
    image: &LayeredImage,
    precision: Precision,
) -> Result<exr::AnyChannels<exr::FlatSamples>, String> {
    if image.width == 0 || image.height == 0 || image.layers.is_empty() {
        return Err("it has no pixels or no layers".into());
    }
    let mut list = Vec::new();
    for layer in &image.layers {
        let pixels = &layer.image;
        if (pixels.width, pixels.height, pixels.channels) != (image.width, image.height, layer.channels.len())
        {
            return Err(format!("layer {} differs in size or channels", layer.name));
        }
        for (c, channel) in layer.channels.iter().enumerate() {
            let name = channel_name(layer, channel);
            let name = exr::Text::new_or_none(&name)
                .ok_or_else(|| format!("layer name {name:?} has characters that EXR does not allow"))?;
            let full = precision == Precision::Float || layer.is_depth();
            list.push(exr::AnyChannel::new(name, samples(pixels, c, full)));
        }
    }
    let names: std::collections::HashSet<_> = list.iter().map(|channel| &channel.name).collect();
    if names.len() < list.len() {
        return Err("two layers have the same name".into());
    }
    Ok(exr::AnyChannels::sort(list.into_iter().collect()))
}

/// Blender replaces dots in the names of passes too, because they separate the parts of the name.
fn channel_name(layer: &Layer, channel: &str) -> String {
    let pass = layer.name.replace('.', "_");
    let parts = [&*layer.view_layer, &*pass, channel];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(".")
}

fn samples(image: &Image, channel: usize, full: bool) -> exr::FlatSamples {
    let values = image.data.iter().skip(channel).step_by(image.channels);
    if full {
        exr::FlatSamples::F32(values.copied().collect())
    } else {
        let max = exr::f16::MAX.to_f32();
        exr::FlatSamples::F16(values.map(|v| exr::f16::from_f32(v.clamp(-max, max))).collect())
    }
}

fn io_error(error: exr::Error) -> io::Error {
    match error {
        exr::Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

/// Reads all passes of an EXR file, of one part or several: what lies in its display window, black where there is no data.
pub fn read_exr(path: &Path) -> Result<LayeredImage, ImageError> {
    use exr::{ReadChannels, ReadLayers};
    let read_error = |source| ImageError::Read { path: path.into(), source };
    let format = |reason| ImageError::Format { path: path.to_path_buf(), reason };
    let mut file = io::BufReader::new(std::fs::File::open(path).map_err(read_error)?);
    let bytes = file.get_ref().metadata().map_err(read_error)?.len();
    check_size(&mut file, bytes).map_err(format)?;
    file.rewind().map_err(read_error)?;
    exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(file)
        .map_err(|error| error.to_string())
        .and_then(|image| passes(image.layer_data, image.attributes.display_window))
        .map_err(format)
}

/// Refuses headers that promise more pixels than a file of this length can hold, before memory is taken for them.
fn check_size(file: &mut impl io::Read, bytes: u64) -> Result<(), String> {
    /// Deflate makes at most 1032 bytes of one.
    const MOST_EXPANSION: u64 = 1032;
    /// Bytes of a picture that a file of any length may hold, 7680 x 4320 pixels of four 32-bit floats and a little more: DWA
    /// packs black up to sixty times further than deflate, and a small data window may lie in a large display window.
    const ALWAYS_READ: u64 = 512 << 20;
    let meta = exr::MetaData::read_from_buffered(file, false).map_err(|error| error.to_string())?;
    let area = |size: exr::Vec2<usize>| (size.0 as u64).saturating_mul(size.1 as u64);
    let promised = meta.headers.iter().map(|header| {
        let data = area(header.layer_size).saturating_mul(header.channels.bytes_per_pixel as u64);
        let shown = area(header.shared_attributes.display_window.size)
            .saturating_mul((header.channels.list.len() * size_of::<f32>()) as u64);
        data.max(shown)
    });
    if promised.fold(0, u64::saturating_add) > bytes.saturating_mul(MOST_EXPANSION).max(ALWAYS_READ) {
        return Err("its header promises more pixels than the file can hold".into());
    }
    Ok(())
}

/// Gathers the channels of all parts into passes of the display window.
fn passes(
    parts: exr::Layers<exr::AnyChannels<exr::FlatSamples>>,
    display: exr::IntegerBounds,
) -> Result<LayeredImage, String> {
    let mut passes = BTreeMap::<_, Vec<_>>::new();
    let mut attributes = BTreeMap::new();
    for part in parts {
        let data = exr::IntegerBounds { position: part.attributes.layer_position, size: part.size };
        let part_name = part.attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        for (name, value) in &part.attributes.other {
            if let exr::AttributeValue::Text(value) = value {
                attributes.insert(name.to_string(), value.to_string());
            }
        }
        for channel in part.channel_data.list {
            if channel.sampling != exr::Vec2(1, 1) {
                return Err(format!("channel {} is subsampled", channel.name));
            }
            let (view_layer, pass, name) = split_name(&part_name, &channel.name.to_string());
            let values = channel.sample_data.values_as_f32().collect();
            let values = in_window(values, &data, &display);
            passes.entry((view_layer, pass)).or_default().push((name, values));
        }
    }
    let size = display.size;
    let layers = passes.into_iter().map(|(names, channels)| interleave(names, channels, size)).collect();
    Ok(LayeredImage { width: size.0, height: size.1, layers, attributes })
}

/// Part of the values of the window `from` that lies in the window `to`, which is 0 elsewhere.
fn in_window(values: Vec<f32>, from: &exr::IntegerBounds, to: &exr::IntegerBounds) -> Vec<f32> {
    if from == to {
        return values;
    }
    // The columns or rows that both have, by number in `to`, and the first of them in `from`.
    let common = |from_start: i32, from_size: usize, to_start: i32, to_size: usize| {
        let shift = i64::from(from_start) - i64::from(to_start);
        let clamp = |place: i64| place.clamp(0, to_size as i64);
        let shared = clamp(shift)..clamp(shift + from_size as i64);
        (shared.start as usize..shared.end as usize, (shared.start - shift) as usize)
    };
    let (columns, left) = common(from.position.0, from.size.0, to.position.0, to.size.0);
    let (rows, top) = common(from.position.1, from.size.1, to.position.1, to.size.1);
    let mut out = vec![0.0; to.size.0 * to.size.1];
    if columns.is_empty() {
        return out;
    }
    for (number, row) in rows.enumerate() {
        let source = (top + number) * from.size.0 + left;
        let target = row * to.size.0;
        out[target + columns.start..target + columns.end]
            .copy_from_slice(&values[source..source + columns.len()]);
    }
    out
}

/// View layer, pass and channel from the names of a part and of its channel. Plain `R G B A` is `Combined`.
fn split_name(part: &str, channel: &str) -> (String, String, String) {
    let full = match part.is_empty() || channel.matches('.').count() >= 2 || channel.starts_with(part) {
        true => channel.to_string(),
        false => format!("{part}.{channel}"),
    };
    let (front, name) = full.rsplit_once('.').unwrap_or(("", &full));
    let (view_layer, pass) = front.rsplit_once('.').unwrap_or(("", front));
    let pass = if pass.is_empty() { "Combined" } else { pass };
    (view_layer.to_string(), pass.to_string(), name.to_string())
}

fn interleave(
    (view_layer, name): (String, String),
    mut channels: Vec<(String, Vec<f32>)>,
    size: exr::Vec2<usize>,
) -> Layer {
    // Files sort by name; pictures are R G B A and X Y Z.
    let rank = |name: &str| "RGBXYZVA".find(name).unwrap_or(usize::MAX);
    channels.sort_by(|a, b| (rank(&a.0), &a.0).cmp(&(rank(&b.0), &b.0)));
    let count = channels.len();
    let mut image = Image::new(size.0, size.1, count);
    for (c, (_, values)) in channels.iter().enumerate() {
        for (out, value) in image.data.iter_mut().skip(c).step_by(count).zip(values) {
            *out = *value;
        }
    }
    Layer { view_layer, name, channels: channels.into_iter().map(|(name, _)| name).collect(), image }
}
