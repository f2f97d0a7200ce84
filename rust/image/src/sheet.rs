//! A contact sheet: pictures side by side, each with its name below.

use crate::Image;
use crate::letters::{ADVANCE, HEIGHT, fill, write};

/// A picture of a sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Display colour, RGB; none where there is no picture, and `words` say why.
    pub picture: Option<Image>,
    /// Name, the first line below.
    pub name: String,
    /// Second line below: what the picture is, or what went wrong.
    pub words: String,
}

/// Widest and highest sheet, pixels; larger ones are shrunk.
const MOST: (usize, usize) = (3840, 2160);
/// Pixels between and around pictures.
const GAP: usize = 8;
/// Smallest cell, pixels, so that there is room for a name.
const LEAST: (usize, usize) = (160, 40);
const BACKGROUND: [f32; 3] = [0.12; 3];
const EMPTY: [f32; 3] = [0.2; 3];
const NAME: [f32; 3] = [0.9; 3];
const WORDS: [f32; 3] = [0.6; 3];
const FAULT: [f32; 3] = [1.0, 0.45, 0.4];

/// A sheet in display colour, RGB, whose columns follow from the shape of the pictures. All pictures are shrunk alike
/// if they would not fit into a 4K screen; none is enlarged.
pub fn sheet(cells: &[Cell]) -> Image {
    let largest = cells.iter().filter_map(|cell| cell.picture.as_ref());
    let (width, height) =
        largest.fold(LEAST, |size, image| (size.0.max(image.width), size.1.max(image.height)));
    let (columns, share) = layout(cells.len().max(1), (width, height));
    let cell_size = (scaled(width, share), scaled(height, share));
    let scale = letter_scale(cell_size.0);
    let step = (cell_size.0 + GAP, cell_size.1 + label_height(scale) + GAP);
    let rows = cells.len().max(1).div_ceil(columns);
    let mut sheet = Image::new(GAP + columns * step.0, GAP + rows * step.1, 3);
    fill(&mut sheet, (0, 0), (usize::MAX / 2, usize::MAX / 2), BACKGROUND);
    for (number, cell) in cells.iter().enumerate() {
        let corner = (GAP + number % columns * step.0, GAP + number / columns * step.1);
        draw(&mut sheet, cell, corner, cell_size, share, scale);
    }
    sheet
}

/// Columns with which the pictures are largest on a 4K screen, and the share of their size that is left there.
fn layout(count: usize, (width, height): (usize, usize)) -> (usize, f64) {
    let share = |columns: usize| {
        let rows = count.div_ceil(columns);
        let label = label_height(letter_scale(width)) + GAP;
        let wide = (MOST.0 - GAP - columns * GAP) as f64 / (columns * width) as f64;
        let high = (MOST.1 - GAP).saturating_sub(rows * label) as f64 / (rows * height) as f64;
        wide.min(high)
    };
    let columns = (1..=count.min(MOST.0 / (4 * GAP))).max_by(|a, b| share(*a).total_cmp(&share(*b)));
    let columns = columns.unwrap_or(1);
    (columns, share(columns).clamp(0.02, 1.0))
}

fn scaled(edge: usize, share: f64) -> usize {
    ((edge as f64 * share) as usize).max(1)
}

fn letter_scale(width: usize) -> usize {
    (width / 240).clamp(1, 4)
}

/// Two lines, with room around.
fn label_height(scale: usize) -> usize {
    (2 * (HEIGHT + 2) + 2) * scale
}

fn draw(
    sheet: &mut Image,
    cell: &Cell,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
    share: f64,
    scale: usize,
) {
    match &cell.picture {
        Some(image) if share < 1.0 => {
            let small = image.resized(scaled(image.width, share), scaled(image.height, share));
            paste(sheet, &small, left, top, (width, height));
        }
        Some(image) => paste(sheet, image, left, top, (width, height)),
        None => fill(sheet, (left, top), (width, height), EMPTY),
    }
    let line = (HEIGHT + 2) * scale;
    let top = top + height + 2 * scale;
    let color = if cell.picture.is_some() { WORDS } else { FAULT };
    write(sheet, &cut(&cell.name, width, scale), left, top, scale, NAME);
    write(sheet, &cut(&cell.words, width, scale), left, top + line, scale, color);
}

/// Copies an RGB picture into the middle of a cell.
fn paste(sheet: &mut Image, image: &Image, left: usize, top: usize, (width, height): (usize, usize)) {
    let left = left + width.saturating_sub(image.width) / 2;
    let top = top + height.saturating_sub(image.height) / 2;
    for (y, row) in image.data.chunks_exact(image.width.max(1) * 3).enumerate() {
        let at = ((top + y) * sheet.width + left) * 3;
        sheet.data[at..at + row.len()].copy_from_slice(row);
    }
}

/// The part of a line that fits below a picture; dots where there is more.
fn cut(text: &str, width: usize, scale: usize) -> String {
    let most = width / (ADVANCE * scale);
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most.saturating_sub(2)).chain("..".chars()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(width: usize, height: usize, value: f32) -> Cell {
        let picture = Image { data: vec![value; width * height * 3], ..Image::new(width, height, 3) };
        Cell { picture: Some(picture), name: "Name".into(), words: "Camera, frame 1".into() }
    }

    /// Counts pixels of a colour.
    fn count(image: &Image, value: f32) -> usize {
        image.data.chunks_exact(3).filter(|pixel| pixel.iter().all(|v| (v - value).abs() < 1e-4)).count()
    }

    #[test]
    fn pictures_that_fit_are_on_the_sheet_as_they_are() {
        let cells = [cell(200, 120, 0.31), cell(200, 120, 0.47), cell(64, 48, 0.55)];
        let sheet = sheet(&cells);
        assert_eq!(count(&sheet, 0.31), 200 * 120);
        assert_eq!(count(&sheet, 0.47), 200 * 120);
        assert_eq!(count(&sheet, 0.55), 64 * 48, "smaller ones are not enlarged");
    }

    #[test]
    fn wide_pictures_lie_below_each_other_and_tall_ones_side_by_side() {
        assert_eq!(layout(4, (1920, 400)).0, 1);
        assert_eq!(layout(4, (300, 1600)).0, 4);
        assert_eq!(layout(4, (1920, 1080)).0, 2);
        assert_eq!(layout(9, (1920, 1080)).0, 3);
    }

    #[test]
    fn many_large_pictures_fit_a_screen_and_keep_their_shape() {
        let cells: Vec<_> = (0..12).map(|_| cell(2000, 1000, 0.5)).collect();
        let sheet = sheet(&cells);
        assert!(
            sheet.width <= MOST.0 + GAP && sheet.height <= MOST.1 + GAP,
            "{} x {}",
            sheet.width,
            sheet.height
        );
        let row = (0..sheet.width).filter(|x| sheet.pixel(*x, 20)[0] > 0.45).count();
        let column = (0..sheet.height).filter(|y| (sheet.pixel(20, *y)[0] - 0.5).abs() < 1e-3).count();
        let (columns, _) = layout(12, (2000, 1000));
        let shape = (row / columns) as f64 / (column / 12_usize.div_ceil(columns)) as f64;
        assert!((shape - 2.0).abs() < 0.05, "{shape}");
    }

    #[test]
    fn a_shot_without_a_picture_says_why_in_its_place() {
        let empty = Cell { picture: None, name: "B".into(), words: "no bake".into() };
        let both = sheet(&[cell(200, 120, 0.31), empty]);
        assert_eq!(count(&both, EMPTY[0]), 200 * 120);
        let red = both.data.chunks_exact(3).filter(|pixel| *pixel == FAULT.as_slice()).count();
        assert!(red > 40, "{red} pixels of words");
        assert!(sheet(&[]).width > 0, "an empty list has an empty sheet");
    }
}
