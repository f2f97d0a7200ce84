//! Images at less than their size, as Cycles keeps them where a scene limits its textures.

use crate::{Alpha, ColorEncoding, Texels, Texture};

/// Limit of the size of a scene's images. Cycles halves their sides until both hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSize {
    /// Most pixels along a side.
    pub largest: Option<usize>,
    /// Largest share of the pixels along a side, above 0.
    pub share: f32,
}

impl TextureSize {
    /// Number of times that the sides of an image of this size are halved.
    fn halvings(self, width: usize, height: usize) -> u32 {
        let longest = width.max(height) as f32;
        let share = self.largest.map_or(self.share, |largest| self.share.min(largest as f32 / longest));
        let halvings = -share.log2().floor();
        // Beyond that nothing is left to halve, and a share that is no number keeps all.
        if halvings > 0.0 { (halvings as u32).min(usize::BITS - 1) } else { 0 }
    }
}

impl Texture {
    /// Shrinks the image to a size: each texel becomes the mean of a square, as it is stored. Colours of bytes with alpha
    /// are multiplied by it meanwhile. At the right and top, texels that fill no square are left out.
    pub fn shrink(&mut self, size: TextureSize) {
        let halvings = size.halvings(self.width, self.height);
        if halvings == 0 {
            return;
        }
        let has_alpha = matches!(self.alpha, Alpha::Straight | Alpha::Premultiplied);
        let is_associated = self.encoding == ColorEncoding::Srgb && has_alpha;
        let squares = Squares { width: self.width, height: self.height, halvings };
        self.texels = match &self.texels {
            Texels::Byte(texels) if is_associated => {
                let texels: Vec<u8> = texels.chunks_exact(4).flat_map(associate).collect();
                Texels::Byte(squares.bytes(&texels).chunks_exact(4).flat_map(divide_by_alpha).collect())
            }
            Texels::Byte(texels) => Texels::Byte(squares.bytes(texels)),
            Texels::Float(texels) => Texels::Float(squares.means(|index| texels[index]).collect()),
        };
        [self.width, self.height] = squares.size();
    }
}

/// Colours of bytes multiplied by their alpha, as Cycles stores them.
pub fn associate(texel: &[u8]) -> [u8; 4] {
    let by_alpha = |c: u8| ((u32::from(c) * u32::from(texel[3])) / 255) as u8;
    [by_alpha(texel[0]), by_alpha(texel[1]), by_alpha(texel[2]), texel[3]]
}

/// The smallest colours that [`associate`] makes these of.
fn divide_by_alpha(texel: &[u8]) -> [u8; 4] {
    let alpha = u32::from(texel[3]).max(1);
    let divided = |c: u8| (u32::from(c) * 255).div_ceil(alpha).min(255) as u8;
    [divided(texel[0]), divided(texel[1]), divided(texel[2]), texel[3]]
}

/// Squares of texels that become one each.
#[derive(Clone, Copy)]
struct Squares {
    width: usize,
    height: usize,
    halvings: u32,
}

impl Squares {
    /// Columns and rows of squares.
    fn size(self) -> [usize; 2] {
        [self.width, self.height].map(|side| (side >> self.halvings).max(1))
    }

    /// Mean of each square, channel by channel.
    fn means(self, texel: impl Fn(usize) -> f32) -> impl Iterator<Item = f32> {
        let [columns, rows] = self.size();
        let side = 1_usize << self.halvings;
        let cells = (0..rows).flat_map(move |row| (0..columns).map(move |column| [row, column]));
        cells.flat_map(move |[row, column]| {
            let mut sum = [0.0; 4];
            let mut count = 0.0_f32;
            for y in (row * side..(row + 1) * side).take_while(|&y| y < self.height) {
                for x in (column * side..(column + 1) * side).take_while(|&x| x < self.width) {
                    for (channel, sum) in sum.iter_mut().enumerate() {
                        *sum += texel(4 * (y * self.width + x) + channel);
                    }
                    count += 1.0;
                }
            }
            sum.map(|sum| sum / count)
        })
    }

    /// Means of bytes, rounded.
    fn bytes(self, texels: &[u8]) -> Vec<u8> {
        self.means(|index| texels[index].into()).map(|mean| (mean + 0.5) as u8).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: usize, height: usize, texels: Texels, alpha: Alpha) -> Texture {
        Texture { name: "test".into(), width, height, texels, encoding: ColorEncoding::Srgb, alpha }
    }

    fn up_to(largest: usize) -> TextureSize {
        TextureSize { largest: Some(largest), share: 1.0 }
    }

    #[test]
    fn sides_are_halved_until_all_limits_hold() {
        assert_eq!(up_to(128).halvings(128, 128), 0);
        assert_eq!(up_to(128).halvings(129, 4), 1);
        assert_eq!(up_to(128).halvings(4, 1024), 3);
        let half = |largest| TextureSize { largest, share: 0.5 }.halvings(1024, 16);
        assert_eq!([half(None), half(Some(512)), half(Some(100))], [1, 1, 4]);
        assert_eq!(TextureSize { largest: None, share: 0.4 }.halvings(64, 64), 2);
        assert_eq!(TextureSize { largest: None, share: f32::NAN }.halvings(64, 64), 0);
    }

    #[test]
    fn squares_become_their_mean_and_the_rest_is_left_out() {
        let row = |start: f32| (0..5).flat_map(move |x| [start + x as f32, 0.0, 1.0, 1.0]);
        let mut image = texture(5, 2, Texels::Float(row(0.0).chain(row(10.0)).collect()), Alpha::Straight);
        image.shrink(up_to(3));
        let Texels::Float(texels) = &image.texels else { panic!("floats stay floats") };
        assert_eq!(
            ([image.width, image.height], &texels[..]),
            ([2, 1], &[5.5, 0.0, 1.0, 1.0, 7.5, 0.0, 1.0, 1.0][..])
        );
    }

    #[test]
    fn an_image_never_vanishes() {
        let mut image = texture(2, 1, Texels::Byte(vec![10, 0, 0, 255, 21, 0, 0, 255]), Alpha::None);
        image.shrink(TextureSize { largest: None, share: 1e-5 });
        let Texels::Byte(texels) = &image.texels else { panic!("bytes stay bytes") };
        assert_eq!(([image.width, image.height], &texels[..]), ([1, 1], &[16, 0, 0, 255][..]));
    }

    #[test]
    fn transparent_texels_lend_no_colour() {
        let texels = vec![200, 100, 50, 255, 0, 255, 0, 0];
        for (alpha, colors) in [(Alpha::Straight, [200, 100, 50]), (Alpha::ChannelPacked, [100, 178, 25])] {
            let mut image = texture(2, 1, Texels::Byte(texels.clone()), alpha);
            image.shrink(up_to(1));
            let Texels::Byte(shrunk) = &image.texels else { panic!("bytes stay bytes") };
            assert_eq!((&shrunk[..3], shrunk[3]), (&colors[..], 128), "{alpha:?}");
        }
    }

    #[test]
    fn divided_colours_are_associated_to_what_they_were() {
        for alpha in 1..=255 {
            for color in 0..=alpha {
                let texel = [color, color, color, alpha];
                assert_eq!(associate(&divide_by_alpha(&texel)), texel);
            }
        }
    }
}
