//! Denoising; without OIDN the tests say so and pass.

use relume_dump::Aovs;
use relume_image::Image;

use super::Random;
use crate::{DenoiseDevice, DenoiseError, DenoiseQuality, Denoiser};

fn denoiser() -> Option<Denoiser> {
    match Denoiser::new(&DenoiseDevice::Cpu(Some(1))) {
        Ok(denoiser) => Some(denoiser),
        Err(error @ DenoiseError::NotBuilt) => {
            println!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Left half dark, right half bright.
fn target(width: usize, height: usize) -> Image {
    let value = |i: usize| if i / 3 % width < width / 2 { 0.1 } else { 4.0 };
    Image { width, height, channels: 3, data: (0..width * height * 3).map(value).collect() }
}

fn aovs(width: usize, height: usize) -> Aovs {
    let constant = |channels: usize, value: f32| {
        let mut image = Image::new(width, height, channels);
        image.data.fill(value);
        image
    };
    Aovs {
        albedo: constant(3, 0.5),
        normal: constant(3, 0.577),
        depth: constant(1, 1.0),
        emission: constant(3, 0.0),
        world: constant(3, 0.0),
        alpha: constant(1, 1.0),
    }
}

fn mean_square(a: &Image, b: &Image) -> f32 {
    a.data.iter().zip(&b.data).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / a.data.len() as f32
}

#[test]
fn denoising_brings_a_noisy_image_closer_to_the_clean_one() {
    let Some(denoiser) = denoiser() else { return };
    assert!(denoiser.version().starts_with("2."), "{}", denoiser.version());
    let (clean, features) = (target(64, 48), denoiser.features(&aovs(64, 48), DenoiseQuality::High).unwrap());
    let mut random = Random(2);
    let mut noisy = clean.clone();
    // An unbiased estimate: 4 times the value in one of four samples.
    noisy.data.iter_mut().for_each(|value| *value = if random.next() < 0.25 { *value * 4.0 } else { 0.0 });
    let before = mean_square(&noisy, &clean);
    for quality in [DenoiseQuality::Fast, DenoiseQuality::Balanced, DenoiseQuality::High] {
        let mut images = [noisy.clone(), clean.clone()];
        denoiser.denoise(&mut images, &features, quality, None).unwrap();
        let after = mean_square(&images[0], &clean);
        assert!(after < before / 10.0, "{quality:?}: {before} to {after}");
        assert!(mean_square(&images[1], &clean) < 0.05, "{quality:?}: a clean image stays");
    }
}

#[test]
fn values_that_are_no_radiance_do_not_spread() {
    let Some(denoiser) = denoiser() else { return };
    let mut image = target(32, 32);
    image.data[1500] = f32::NAN;
    image.data[1000] = f32::INFINITY;
    image.data[500] = -5.0;
    let mut images = [image];
    let features = denoiser.features(&aovs(32, 32), DenoiseQuality::High).unwrap();
    denoiser.denoise(&mut images, &features, DenoiseQuality::Fast, None).unwrap();
    assert!(images[0].data.iter().all(|value| value.is_finite() && *value >= 0.0));
}

#[test]
fn sizes_that_differ_are_one_error() {
    let Some(denoiser) = denoiser() else { return };
    let features = denoiser.features(&aovs(32, 32), DenoiseQuality::High).unwrap();
    let error = denoiser.denoise(&mut [target(32, 16)], &features, DenoiseQuality::Fast, None).unwrap_err();
    assert!(error.to_string().contains("32 x 16, 3 channels"), "{error}");
}

#[test]
fn a_gpu_that_the_library_does_not_know_is_an_error() {
    if denoiser().is_none() {
        return;
    }
    for address in ["ffff:ff:1f.7", "", "no address"] {
        let refused = Denoiser::new(&DenoiseDevice::Gpu(address.into()));
        assert!(matches!(refused, Err(DenoiseError::Library(_))), "{address}");
    }
}
