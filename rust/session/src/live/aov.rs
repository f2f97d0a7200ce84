use crate::relight::frame::with_alpha;
use relume_dump::Aovs;
use relume_image::Image;
use serde::Deserialize;

/// Feature that a picture shows in place of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// Colour of surfaces.
    Albedo,
    /// Direction that surfaces face in the world.
    Normal,
    /// Distance of surfaces, for the eye: black for the nearest, white for the farthest and the background.
    Depth,
}

impl Aov {
    /// RGBA, bottom row first.
    pub(super) fn image(self, aovs: &Aovs) -> Image {
        match self {
            Self::Albedo => with_alpha(&aovs.albedo, &aovs.alpha),
            Self::Normal => with_alpha(&aovs.normal, &aovs.alpha),
            Self::Depth => with_alpha(&distances(aovs), &aovs.alpha),
        }
    }
}

/// Grey, premultiplied.
fn distances(aovs: &Aovs) -> Image {
    let seen = aovs.depth.data.iter().copied().filter(|depth| *depth > 0.0 && depth.is_finite());
    let (nearest, farthest) =
        seen.fold((f32::INFINITY, 0.0), |(low, high): (f32, f32), d| (low.min(d), high.max(d)));
    let grey = |depth: f32| match depth > 0.0 && depth.is_finite() {
        true if farthest > nearest => (depth - nearest) / (farthest - nearest),
        true => 0.0,
        false => 1.0,
    };
    let pixels = aovs.depth.data.iter().zip(&aovs.alpha.data);
    let data = pixels.flat_map(|(depth, alpha)| [grey(*depth) * alpha; 3]).collect();
    Image { data, ..Image::new(aovs.depth.width, aovs.depth.height, 3) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_black_at_the_nearest_and_white_at_the_farthest_and_beyond() {
        let row = |channels: usize, data: &[f32]| Image { data: data.into(), ..Image::new(4, 1, channels) };
        let aovs = Aovs {
            albedo: row(3, &[0.5; 12]),
            normal: row(3, &[-1.0; 12]),
            depth: row(1, &[2.0, 4.0, 3.0, 0.0]),
            emission: row(3, &[0.0; 12]),
            world: row(3, &[0.0; 12]),
            alpha: row(1, &[1.0, 1.0, 0.5, 1.0]),
        };
        let depth = Aov::Depth.image(&aovs);
        let [grey, alpha] = [0, 3].map(|c| depth.data.iter().skip(c).step_by(4).copied().collect::<Vec<_>>());
        assert_eq!((grey, alpha), (vec![0.0, 1.0, 0.25, 1.0], vec![1.0, 1.0, 0.5, 1.0]));
        let flat = Aovs { depth: row(1, &[2.0; 4]), ..aovs };
        assert_eq!(Aov::Depth.image(&flat).data[0], 0.0);
        assert_eq!(Aov::Normal.image(&flat).data[..4], [-1.0, -1.0, -1.0, 1.0]);
        assert_eq!(Aov::Albedo.image(&flat).data[..4], [0.5, 0.5, 0.5, 1.0]);
    }
}
