//! Connected light in parts by lobes ([`LobePart`]).

use glam::Vec3;
use relume_dump::{ByConnectedLobe, Lobe};
use relume_gather::{Emitter, Gather, LobePart};
use relume_image::Image;
use relume_trace::{ConnectScratch, Tracer, UnpackedVertex};

use super::Connections;
use super::connection::Connection;

impl Connections {
    /// Parts of the connected light of a light, in the order of [`LobePart::ALL`], from so many levels as far as they are there;
    /// nothing if `stop` ended it. They add up to [`Self::images`].
    pub fn part_images(
        &self,
        gather: &Gather,
        light: &Emitter,
        levels: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<Image>> {
        let mut sums = vec![Image::new(self.manifest.width, self.manifest.height, 3); LobePart::ALL.len()];
        let levels = &self.levels[..self.ready().min(levels)];
        let paths: u32 = levels.iter().map(|level| level.pass.samples).sum();
        let tracer = self.tracer();
        for level in levels {
            let images = self.summed(
                gather,
                level,
                LobePart::ALL.len(),
                1,
                stop,
                |vertex, numbers, scratch, pixel| {
                    for (part, value) in connect_parts(tracer, vertex, light, numbers, scratch) {
                        pixel.add(part as usize, value);
                    }
                },
            )?;
            let share = level.pass.samples as f32 / paths as f32;
            sums.iter_mut().zip(&images).for_each(|(sum, image)| sum.add_scaled(image, &[share; 3]));
        }
        Some(sums)
    }
}

/// Light of one point on a light at a vertex for each of [`Lobe::CONNECTED`], and the part that it counts for.
fn connect_parts(
    tracer: &Tracer<'_>,
    vertex: &UnpackedVertex<'_>,
    light: &Emitter,
    numbers: [f32; 4],
    scratch: &mut ConnectScratch,
) -> ByConnectedLobe<(LobePart, Vec3)> {
    let is_direct = vertex.packed.first_lobe() == Lobe::Camera;
    let found = Connection::new(vertex, light, numbers);
    std::array::from_fn(|lobe| {
        let first = if is_direct { Lobe::CONNECTED[lobe] } else { vertex.packed.first_lobe() };
        let value = found.as_ref().map_or(Vec3::ZERO, |found| {
            let mut only = ByConnectedLobe::default();
            only[lobe] = found.weights[lobe];
            found.light(tracer, only, scratch)
        });
        (LobePart::of(first, is_direct), value)
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use relume_dump::MemoryWriter;
    use relume_gather::SampleSplit;
    use relume_trace::{Control, TraceSettings};

    use super::*;
    use crate::test_box::{bulbs, closed_box_of, glossy_grey};

    #[test]
    fn parts_by_either_estimator_have_the_same_means_and_add_up_to_the_light() {
        let scene = Arc::new(closed_box_of((16, 16), glossy_grey(0.6)).unwrap());
        let settings = TraceSettings { samples: 2048, ..TraceSettings::default() };
        let tracer = Tracer::new(&scene, &settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        let gather = Gather::new(writer.snapshot());
        let connections = Connections::new(scene.clone(), gather.dump().manifest(), None, 1).unwrap();
        while connections.prepare_next(&|| false) {}
        let light = &bulbs(3)[..1];
        let emitters = connections.emitters(light).unwrap();
        let connected = connections.part_images(&gather, &emitters[0].1, usize::MAX, &|| false).unwrap();
        let whole = connections.images(&gather, light, &emitters, usize::MAX, &|| false).unwrap();
        let total = |image: &Image| image.data.iter().map(|value| f64::from(*value)).sum::<f64>();
        assert_close(connected.iter().map(total).sum(), total(&whole[0].1.image), 1e-4);

        let crossed = gather.part_images(&gather.prepare(&light[0]).unwrap());
        let whole = &gather.unit_images(&[gather.prepare(&light[0]).unwrap()], SampleSplit::All)[0];
        assert_close(crossed.iter().map(total).sum(), total(whole), 1e-4);
        let rest = gather.part_images(&connections.crossed(&gather, light).unwrap()[0]);
        for (part, ((crossed, rest), connected)) in
            LobePart::ALL.into_iter().zip(crossed.iter().zip(&rest).zip(&connected))
        {
            let joined = total(rest) + total(connected);
            match part {
                LobePart::DiffuseDirect
                | LobePart::DiffuseIndirect
                | LobePart::GlossyDirect
                | LobePart::GlossyIndirect => {
                    assert!(joined > 0.02 * total(whole), "{part:?}");
                    // Crossings of a small bulb are few: their own noise is some percent.
                    assert_close(total(crossed), joined, 0.1);
                }
                LobePart::Emission => assert_close(total(crossed), joined, 1e-4),
                _ => assert_eq!(joined, 0.0, "{part:?}"),
            }
        }
    }

    fn assert_close(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() <= tolerance * b.abs(), "{a} {b}");
    }
}
