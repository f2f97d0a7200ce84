use super::{PictureFile, checked_size};
use crate::Texels;
use ::exr::prelude as exr;
use ::exr::prelude::{ReadChannels, ReadLayers};
use std::io::Cursor;

/// Deflate makes at most 1032 bytes of one.
const MOST_BYTES: usize = 1032;
/// Names of channels, sorted, and the place of red, green, blue and alpha among them; none stands for 1.
const CHANNELS: [(&[&str], [Option<usize>; 4]); 3] = [
    (&["A", "B", "G", "R"], [Some(3), Some(2), Some(1), Some(0)]),
    (&["B", "G", "R"], [Some(2), Some(1), Some(0), None]),
    (&["Y"], [Some(0), Some(0), Some(0), None]),
];

/// An OpenEXR file of one part with one colour, and the same data as display window: Blender has other files in layers, or
/// moves them.
pub fn decode(file: &[u8]) -> Result<PictureFile, String> {
    let meta =
        exr::MetaData::read_from_buffered(Cursor::new(file), false).map_err(|error| error.to_string())?;
    let [header] = meta.headers.as_slice() else {
        return Err("it has several parts".into());
    };
    let window = header.shared_attributes.display_window;
    if window.size != header.layer_size || window.position != header.own_attributes.layer_position {
        return Err("its pixels are not all of what it shows, or more".into());
    }
    let list = &header.channels.list;
    let names: Vec<_> = list.iter().map(|channel| channel.name.to_string()).collect();
    let places = CHANNELS.iter().find(|(known, _)| names == *known).map(|(_, places)| places);
    let places = places.ok_or_else(|| format!("channels {names:?} are not read"))?;
    let is_plain = |channel: &exr::ChannelDescription| {
        channel.sampling == exr::Vec2(1, 1) && channel.sample_type != exr::SampleType::U32
    };
    if !list.iter().all(is_plain) {
        return Err("its channels are subsampled or whole numbers".into());
    }
    let exr::Vec2(width, height) = header.layer_size;
    let size = checked_size(width, height, header.channels.bytes_per_pixel, file.len(), MOST_BYTES)?;
    let reading = exr::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image =
        reading.all_attributes().from_buffered(Cursor::new(file)).map_err(|error| error.to_string())?;
    let channels = image.layer_data.channel_data.list;
    if image.layer_data.size != header.layer_size || channels.len() != names.len() {
        return Err("its pixels are not those of its header".into());
    }
    let channels: Vec<Vec<f32>> =
        channels.iter().map(|channel| channel.sample_data.values_as_f32().collect()).collect();
    let mut values = Vec::with_capacity(4 * width * height);
    values.extend(
        (0..width * height)
            .flat_map(|pixel| places.map(|place| place.map_or(1.0, |place| channels[place][pixel]))),
    );
    Ok(PictureFile::from_rows(size, &values, |pixel| pixel, Texels::Float))
}
