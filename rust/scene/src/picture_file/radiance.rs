use super::{PictureFile, checked_size};
use crate::Texels;

/// A run of 127 equal bytes is two bytes; a pixel is four.
const MOST_BYTES: usize = 64;
/// Rows of other widths are never compressed channel by channel.
const COMPRESSED: std::ops::RangeInclusive<usize> = 8..=0x7fff;

/// A Radiance picture (Greg Ward, "Real Pixels", Graphics Gems II; <https://radsite.lbl.gov/radiance/refer/filefmts.pdf>):
/// mantissas of red, green and blue with one exponent, first row on top. Exposure, gamma and primaries of the header are
/// not heeded, as by Blender.
pub fn decode(file: &[u8]) -> Result<PictureFile, String> {
    let mut rest = file;
    let mut is_rgbe = false;
    loop {
        match line(&mut rest)? {
            "" => break,
            line => is_rgbe |= line == "FORMAT=32-bit_rle_rgbe",
        }
    }
    let size = line(&mut rest)?;
    let numbers = size.strip_prefix("-Y ").and_then(|size| size.split_once(" +X "));
    let numbers = numbers.and_then(|(height, width)| Some((width.parse().ok()?, height.parse().ok()?)));
    let (width, height) = numbers.filter(|_| is_rgbe).ok_or("its header is not read")?;
    let size = checked_size(width, height, 4, rest.len(), MOST_BYTES)?;
    let mut values = Vec::with_capacity(4 * width * height);
    let mut row = vec![[0; 4]; width];
    for _ in 0..height {
        read_row(&mut rest, &mut row)?;
        values.extend(row.iter().flat_map(|&pixel| color(pixel)));
    }
    Ok(PictureFile::from_rows(size, &values, |pixel| pixel, Texels::Float))
}

fn line<'a>(rest: &mut &'a [u8]) -> Result<&'a str, String> {
    let end = rest.iter().position(|&byte| byte == b'\n').ok_or("its header has no end")?;
    let (line, after) = rest.split_at(end);
    *rest = &after[1..];
    str::from_utf8(line).map_err(|_| "its header is no text".into())
}

/// One row, uncompressed or channel by channel in runs.
fn read_row(rest: &mut &[u8], row: &mut [[u8; 4]]) -> Result<(), String> {
    let length = (row.len() as u16).to_be_bytes();
    let is_compressed = COMPRESSED.contains(&row.len()) && rest.starts_with(&[2, 2, length[0], length[1]]);
    if !is_compressed {
        for pixel in row {
            *pixel = take(rest)?;
            if pixel[..3] == [1, 1, 1] {
                return Err("repeated pixels of the old kind are not read".into());
            }
        }
        return Ok(());
    }
    take::<4>(rest)?;
    for channel in 0..4 {
        let mut x = 0;
        while x < row.len() {
            let [count] = take(rest)?;
            let is_run = count > 128;
            let count = usize::from(if is_run { count & 127 } else { count });
            let part = row.get_mut(x..x + count).filter(|_| count > 0).ok_or("a run leaves its row")?;
            if is_run {
                let [value] = take(rest)?;
                part.iter_mut().for_each(|pixel| pixel[channel] = value);
            } else {
                for pixel in part {
                    [pixel[channel]] = take(rest)?;
                }
            }
            x += count;
        }
    }
    Ok(())
}

fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], String> {
    let (taken, after) = rest.split_first_chunk().ok_or("it ends too soon")?;
    *rest = after;
    Ok(*taken)
}

fn color([red, green, blue, exponent]: [u8; 4]) -> [f32; 4] {
    let scale = if exponent == 0 { 0.0 } else { 2f32.powi(i32::from(exponent) - 128 - 8) };
    [f32::from(red) * scale, f32::from(green) * scale, f32::from(blue) * scale, 1.0]
}
