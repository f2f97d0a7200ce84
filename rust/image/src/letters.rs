//! Letters of five by seven pixels, for the words under pictures.

use crate::Image;

/// Width and height of a letter, pixels, without the gap to the next.
const SIZE: (usize, usize) = (5, 7);
/// Pixels from one letter to the next.
pub(crate) const ADVANCE: usize = SIZE.0 + 1;
/// Height of a letter with what hangs below its line.
pub(crate) const HEIGHT: usize = SIZE.1 + 1;

/// Rows of a letter from the top, the leftmost pixel in bit 4. What has no shape here is a box.
fn rows(letter: char) -> [u8; HEIGHT] {
    let plain = plain(letter);
    LETTERS.iter().find(|(known, _)| *known == plain).map_or(BOX, |(_, rows)| *rows)
}

/// A letter of western Europe without its accent.
fn plain(letter: char) -> char {
    const ACCENTED: [(&str, char); 15] = [
        ("ÀÁÂÃÄÅ", 'A'),
        ("Ç", 'C'),
        ("ÈÉÊË", 'E'),
        ("ÌÍÎÏ", 'I'),
        ("Ñ", 'N'),
        ("ÒÓÔÕÖØ", 'O'),
        ("ÙÚÛÜ", 'U'),
        ("àáâãäå", 'a'),
        ("ç", 'c'),
        ("èéêë", 'e'),
        ("ìíîï", 'i'),
        ("ñ", 'n'),
        ("òóôõöø", 'o'),
        ("ùúûü", 'u'),
        ("ß", 'B'),
    ];
    ACCENTED.iter().find(|(accented, _)| accented.contains(letter)).map_or(letter, |(_, plain)| *plain)
}

/// Writes display colour over an RGB picture, each pixel of a letter a square of `scale` pixels; what does not fit is
/// left out.
pub(crate) fn write(image: &mut Image, text: &str, left: usize, top: usize, scale: usize, color: [f32; 3]) {
    for (number, letter) in text.chars().enumerate() {
        for (row, bits) in rows(letter).into_iter().enumerate() {
            let lit = (0..SIZE.0).filter(|column| (bits >> (SIZE.0 - 1 - column)) & 1 == 1);
            for column in lit {
                let (x, y) = (left + (number * ADVANCE + column) * scale, top + row * scale);
                fill(image, (x, y), (scale, scale), color);
            }
        }
    }
}

/// Fills a rectangle of an RGB picture, as far as it lies inside.
pub(crate) fn fill(
    image: &mut Image,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
    color: [f32; 3],
) {
    for y in top..(top + height).min(image.height) {
        for x in left..(left + width).min(image.width) {
            let at = (y * image.width + x) * 3;
            image.data[at..at + 3].copy_from_slice(&color);
        }
    }
}

const BOX: [u8; HEIGHT] = [31, 17, 17, 17, 17, 17, 31, 0];

#[rustfmt::skip]
const LETTERS: [(char, [u8; HEIGHT]); 91] = [
    (' ', [0; HEIGHT]),
    ('!', [4, 4, 4, 4, 4, 0, 4, 0]), ('"', [10, 10, 0, 0, 0, 0, 0, 0]), ('#', [10, 10, 31, 10, 31, 10, 10, 0]),
    ('%', [24, 25, 2, 4, 8, 19, 3, 0]), ('&', [8, 20, 20, 8, 21, 18, 13, 0]), ('\'', [4, 4, 0, 0, 0, 0, 0, 0]),
    ('(', [2, 4, 8, 8, 8, 4, 2, 0]), (')', [8, 4, 2, 2, 2, 4, 8, 0]), ('*', [0, 4, 21, 14, 21, 4, 0, 0]),
    ('+', [0, 4, 4, 31, 4, 4, 0, 0]), (',', [0, 0, 0, 0, 0, 4, 4, 8]), ('-', [0, 0, 0, 31, 0, 0, 0, 0]),
    ('.', [0, 0, 0, 0, 0, 4, 4, 0]), ('/', [1, 1, 2, 4, 8, 16, 16, 0]), (':', [0, 4, 4, 0, 4, 4, 0, 0]),
    (';', [0, 4, 4, 0, 0, 4, 4, 8]), ('<', [2, 4, 8, 16, 8, 4, 2, 0]), ('=', [0, 0, 31, 0, 31, 0, 0, 0]),
    ('>', [8, 4, 2, 1, 2, 4, 8, 0]), ('?', [14, 17, 1, 2, 4, 0, 4, 0]), ('@', [14, 17, 23, 21, 23, 16, 14, 0]),
    ('[', [14, 8, 8, 8, 8, 8, 14, 0]), ('\\', [16, 16, 8, 4, 2, 1, 1, 0]), (']', [14, 2, 2, 2, 2, 2, 14, 0]),
    ('_', [0, 0, 0, 0, 0, 0, 31, 0]), ('|', [4, 4, 4, 4, 4, 4, 4, 4]), ('~', [0, 0, 8, 21, 2, 0, 0, 0]),
    ('$', [4, 15, 20, 14, 5, 30, 4, 0]),
    ('0', [14, 17, 19, 21, 25, 17, 14, 0]), ('1', [4, 12, 4, 4, 4, 4, 14, 0]), ('2', [14, 17, 1, 6, 8, 16, 31, 0]),
    ('3', [14, 17, 1, 6, 1, 17, 14, 0]), ('4', [2, 6, 10, 18, 31, 2, 2, 0]), ('5', [31, 16, 30, 1, 1, 17, 14, 0]),
    ('6', [6, 8, 16, 30, 17, 17, 14, 0]), ('7', [31, 1, 2, 4, 8, 8, 8, 0]), ('8', [14, 17, 17, 14, 17, 17, 14, 0]),
    ('9', [14, 17, 17, 15, 1, 2, 12, 0]),
    ('A', [14, 17, 17, 31, 17, 17, 17, 0]), ('B', [30, 17, 17, 30, 17, 17, 30, 0]), ('C', [14, 17, 16, 16, 16, 17, 14, 0]),
    ('D', [30, 17, 17, 17, 17, 17, 30, 0]), ('E', [31, 16, 16, 30, 16, 16, 31, 0]), ('F', [31, 16, 16, 30, 16, 16, 16, 0]),
    ('G', [14, 17, 16, 23, 17, 17, 14, 0]), ('H', [17, 17, 17, 31, 17, 17, 17, 0]), ('I', [14, 4, 4, 4, 4, 4, 14, 0]),
    ('J', [7, 2, 2, 2, 2, 18, 12, 0]), ('K', [17, 18, 20, 24, 20, 18, 17, 0]), ('L', [16, 16, 16, 16, 16, 16, 31, 0]),
    ('M', [17, 27, 21, 21, 17, 17, 17, 0]), ('N', [17, 17, 25, 21, 19, 17, 17, 0]), ('O', [14, 17, 17, 17, 17, 17, 14, 0]),
    ('P', [30, 17, 17, 30, 16, 16, 16, 0]), ('Q', [14, 17, 17, 17, 21, 18, 13, 0]), ('R', [30, 17, 17, 30, 20, 18, 17, 0]),
    ('S', [15, 16, 16, 14, 1, 1, 30, 0]), ('T', [31, 4, 4, 4, 4, 4, 4, 0]), ('U', [17, 17, 17, 17, 17, 17, 14, 0]),
    ('V', [17, 17, 17, 17, 17, 10, 4, 0]), ('W', [17, 17, 17, 21, 21, 27, 17, 0]), ('X', [17, 17, 10, 4, 10, 17, 17, 0]),
    ('Y', [17, 17, 10, 4, 4, 4, 4, 0]), ('Z', [31, 1, 2, 4, 8, 16, 31, 0]),
    ('a', [0, 0, 14, 1, 15, 17, 15, 0]), ('b', [16, 16, 30, 17, 17, 17, 30, 0]), ('c', [0, 0, 14, 17, 16, 17, 14, 0]),
    ('d', [1, 1, 15, 17, 17, 17, 15, 0]), ('e', [0, 0, 14, 17, 31, 16, 14, 0]), ('f', [6, 9, 8, 28, 8, 8, 8, 0]),
    ('g', [0, 0, 15, 17, 17, 15, 1, 14]), ('h', [16, 16, 30, 17, 17, 17, 17, 0]), ('i', [4, 0, 12, 4, 4, 4, 14, 0]),
    ('j', [2, 0, 6, 2, 2, 2, 18, 12]), ('k', [16, 16, 18, 20, 24, 20, 18, 0]), ('l', [12, 4, 4, 4, 4, 4, 14, 0]),
    ('m', [0, 0, 26, 21, 21, 21, 21, 0]), ('n', [0, 0, 30, 17, 17, 17, 17, 0]), ('o', [0, 0, 14, 17, 17, 17, 14, 0]),
    ('p', [0, 0, 30, 17, 17, 30, 16, 16]), ('q', [0, 0, 15, 17, 17, 15, 1, 1]), ('r', [0, 0, 22, 25, 16, 16, 16, 0]),
    ('s', [0, 0, 15, 16, 14, 1, 30, 0]), ('t', [8, 8, 28, 8, 8, 9, 6, 0]), ('u', [0, 0, 17, 17, 17, 19, 13, 0]),
    ('v', [0, 0, 17, 17, 17, 10, 4, 0]), ('w', [0, 0, 17, 21, 21, 21, 10, 0]), ('x', [0, 0, 17, 10, 4, 10, 17, 0]),
    ('y', [0, 0, 17, 17, 17, 15, 1, 14]), ('z', [0, 0, 31, 2, 4, 8, 31, 0]),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_has_a_shape_of_its_own() {
        let printable: Vec<char> = (b'!'..=b'~').map(char::from).filter(|c| !"^`{}".contains(*c)).collect();
        let mut shapes: Vec<_> = printable.iter().map(|letter| rows(*letter)).chain([BOX]).collect();
        shapes.sort_unstable();
        shapes.dedup();
        assert_eq!(shapes.len(), printable.len() + 1);
        assert_eq!("Küche".chars().map(plain).collect::<String>(), "Kuche");
    }

    #[test]
    fn words_that_do_not_fit_are_cut_off() {
        let mut image = Image::new(12, 8, 3);
        write(&mut image, "IIII", 0, 0, 1, [1.0; 3]);
        let row: Vec<bool> = (0..12).map(|x| image.pixel(x, 0)[0] == 1.0).collect();
        assert_eq!(row, [0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0].map(|lit| lit == 1));
    }
}
