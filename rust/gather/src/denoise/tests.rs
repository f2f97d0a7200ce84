use super::*;
use std::sync::atomic::{AtomicUsize, Ordering};

fn noise(seed: usize, channels: usize) -> Image {
    let value = |i: usize| ((i + seed) * 2_654_435_761 % 1000) as f32 / 1000.0;
    Image { data: (0..64 * 48 * channels).map(value).collect(), ..Image::new(64, 48, channels) }
}

fn features(denoiser: &Denoiser, seed: usize) -> DenoiseFeatures {
    let aovs = Aovs {
        albedo: noise(seed, 3),
        normal: noise(seed + 1, 3),
        depth: noise(0, 1),
        emission: noise(0, 3),
        world: noise(0, 3),
        alpha: noise(0, 1),
    };
    denoiser.features(&aovs, DenoiseQuality::High).expect("features")
}

#[test]
fn what_is_stopped_stays_noisy_and_the_next_is_denoised() {
    let denoiser = Denoiser::new(&DenoiseDevice::Cpu(Some(1))).unwrap();
    let view = features(&denoiser, 7);
    let (noisy, asked) = (noise(3, 3), AtomicUsize::new(0));
    let stop = || asked.fetch_add(1, Ordering::Relaxed) > 0;
    let mut images = [noisy.clone(), noisy.clone()];
    assert!(!denoiser.denoise(&mut images, &view, DenoiseQuality::High, Some(&stop)).unwrap());
    assert_eq!(asked.into_inner(), 2, "asked once more after it had said to go on, and then no more");
    assert_eq!(images, [noisy.clone(), noisy]);
    assert!(denoiser.denoise(&mut images, &view, DenoiseQuality::High, None).unwrap());
    let mut expected = [noise(3, 3)];
    denoiser.denoise(&mut expected, &view, DenoiseQuality::High, None).unwrap();
    assert_eq!(images[1], expected[0]);
}

#[test]
fn a_filter_is_made_once_for_its_features_and_quality() {
    let new = || Denoiser::new(&DenoiseDevice::Cpu(Some(1))).unwrap();
    let denoiser = new();
    let views = [features(&denoiser, 7), features(&denoiser, 70)];
    let (fast, balanced) = (DenoiseQuality::Fast, DenoiseQuality::Balanced);
    // Which view, in which quality, and how many filters there are then.
    for (seed, (view, quality, kept)) in
        [(0, fast, 1), (0, balanced, 2), (0, fast, 2), (1, fast, 1), (0, fast, 1)].into_iter().enumerate()
    {
        let [mut found, mut expected] = [0; 2].map(|_| [noise(100 * seed, 3)]);
        denoiser.denoise(&mut found, &views[view], quality, None).unwrap();
        new().denoise(&mut expected, &views[view], quality, None).unwrap();
        assert_eq!(found, expected, "picture {seed}");
        assert_eq!(denoiser.kept.borrow().filters.len(), kept, "picture {seed}");
    }
}
