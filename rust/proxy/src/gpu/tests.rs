use std::sync::Arc;

use glam::Vec3;
use relume_gpu::{Gpu, GpuChoice};

use super::*;
use crate::synthetic::SyntheticRoom;
use crate::{
    GridConfig, LightKind, LightParams, NetworkConfig, Proxy, ProxyError, Rng, SizeRange, TrainConfig,
    Trainer,
};

const SIZE: SizeRange = SizeRange { min: 0.1, max: 0.5 };
const KINDS: [LightKind; 3] = [LightKind::Sphere, LightKind::FacingDisk, LightKind::Quad];

/// The two sum up in different orders: a sum of n terms is off by about the square root of n times 2^-24, 1e-6 for 256, in each
/// of a few layers; and devices may be off by 2.5 units in the last place in a division (Vulkan's rules).
const TOLERANCE: f32 = 2e-5;

/// Any device will do, a software driver included; that there is none is a failure.
fn gpu() -> Arc<Gpu> {
    Gpu::shared(&GpuChoice::Best)
        .expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

fn grid() -> GridConfig {
    GridConfig { levels: 4, log2_hashmap_size: 8, ..GridConfig::default() }
}

/// Widths that fill blocks and that do not, narrower and wider than the input.
fn networks() -> Vec<NetworkConfig> {
    let fast = |width, layers| NetworkConfig::Fast { width, layers, grid: grid() };
    let reference = |width, layers| NetworkConfig::Reference { width, layers, grid: grid() };
    vec![
        fast(64, 2),
        fast(13, 1),
        fast(128, 3),
        reference(64, 4),
        reference(9, 1),
        reference(24, 2),
        reference(256, 3),
    ]
}

/// Random weights, 37 x 23 pixels: no multiple of anything.
fn proxy(network: NetworkConfig, kind: LightKind) -> Proxy {
    let features = SyntheticRoom::new(37, 23).features();
    let config = TrainConfig { network, ..TrainConfig::fast(SIZE) };
    Trainer::new(Arc::new(features), kind, config, 7).unwrap().proxy()
}

fn light(kind: LightKind, rng: &mut Rng) -> LightParams {
    let center = Vec3::new(rng.next_f32() - 0.5, rng.next_f32() - 0.5, 0.3 + rng.next_f32());
    crate::light::random_light_facing_down(kind, center, SIZE, rng)
}

/// Largest difference as a share of the largest value.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    assert!(largest > 0.0, "all zero");
    a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max(if a.is_finite() { (a - b).abs() } else { f32::INFINITY }))
        / largest
}

#[test]
fn unit_images_equal_those_of_the_cpu() {
    let mut rng = Rng::stream(1, 2, 3);
    for (index, network) in networks().into_iter().enumerate() {
        let kind = KINDS[index % 3];
        let proxy = proxy(network.clone(), kind);
        let device = GpuProxy::new(gpu(), &proxy).unwrap();
        for _ in 0..2 {
            let light = light(kind, &mut rng);
            let (found, expected) = (device.unit_image(&light).unwrap(), proxy.unit_image(&light).unwrap());
            let error = difference(&found.data, &expected.data);
            assert!(error < TOLERANCE, "{network:?}, {kind}: {error}");
        }
    }
}

#[test]
fn listed_pixels_equal_those_of_the_image() {
    let mut rng = Rng::stream(4, 5, 6);
    for network in [networks()[0].clone(), networks()[5].clone()] {
        let proxy = proxy(network, LightKind::Sphere);
        let device = GpuProxy::new(gpu(), &proxy).unwrap();
        let light = light(LightKind::Sphere, &mut rng);
        let image = device.unit_image(&light).unwrap();
        for count in [1, 150, 7] {
            let pixels: Vec<u32> = (0..count).map(|_| rng.below(37 * 23)).collect();
            let mut values = vec![[0.0; 3]; count];
            device.forward_pixels(&pixels, &light, &mut values).unwrap();
            for (pixel, value) in pixels.iter().zip(&values) {
                assert_eq!(value[..], image.data[3 * *pixel as usize..][..3], "pixel {pixel}");
            }
        }
    }
}

#[test]
fn what_does_not_fit_the_proxy_is_an_error() {
    let proxy = proxy(networks()[1].clone(), LightKind::Sphere);
    let device = GpuProxy::new(gpu(), &proxy).unwrap();
    let quad = LightParams::quad(Vec3::ZERO, Vec3::X, Vec3::Y);
    assert!(matches!(device.unit_image(&quad), Err(ProxyError::WrongKind { .. })));
    let sphere = LightParams::round(LightKind::Sphere, Vec3::Z, 0.2);
    let mut out = [[0.0; 3]];
    assert!(matches!(
        device.forward_pixels(&[37 * 23], &sphere, &mut out),
        Err(ProxyError::PixelOutside { .. })
    ));
    assert!(matches!(device.forward_pixels(&[1, 2], &sphere, &mut out), Err(ProxyError::Length { .. })));
}
