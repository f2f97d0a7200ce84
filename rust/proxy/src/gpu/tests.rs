use std::sync::Arc;

use glam::Vec3;
use relume_gpu::compare::{Layers, StepTargets};
use relume_gpu::{Gpu, GpuChoice};

use super::proxy::MAX_COLLECTED;
use super::*;
use crate::encoding::OutputScale;
use crate::gradient::tests::{difference_quotient, moved, params_away_from_kinks};
use crate::synthetic::SyntheticRoom;
use crate::{
    GridConfig, LightKind, LightParams, NetworkConfig, Proxy, ProxyError, Rng, SizeRange, TrainConfig,
    Trainer,
};

const SIZE: SizeRange = SizeRange { min: 0.1, max: 0.5 };

/// The two sum up in different orders: a sum of n terms is off by about the square root of n times 2^-24, 1e-6 for 256, in each
/// of a few layers; and devices may be off by 2.5 units in the last place in a division (Vulkan's rules).
const TOLERANCE: f32 = 2e-5;

/// Any device will do, a software driver included; that there is none is a failure.
fn gpu() -> Arc<Gpu> {
    Gpu::shared(&GpuChoice::Best)
        .expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

pub(super) fn grid() -> GridConfig {
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
    proxy_of_size(network, kind, [37, 23])
}

fn proxy_of_size(network: NetworkConfig, kind: LightKind, size: [usize; 2]) -> Proxy {
    trainer_of_size(network, kind, size).proxy().unwrap()
}

fn trainer_of_size(network: NetworkConfig, kind: LightKind, [width, height]: [usize; 2]) -> Trainer {
    let features = SyntheticRoom::new(width, height).features();
    let config = TrainConfig { network, ..TrainConfig::fast(SIZE) };
    Trainer::new(Arc::new(features), kind, config, 7).unwrap()
}

/// Untrained proxy on the device.
pub(super) fn on_device(network: NetworkConfig, kind: LightKind, size: [usize; 2]) -> GpuProxy {
    GpuProxy::new(gpu(), &proxy_of_size(network, kind, size)).unwrap()
}

/// Untrained proxy with outputs above zero, on the device.
pub(super) fn lit_on_device(network: NetworkConfig, kind: LightKind, size: [usize; 2]) -> GpuProxy {
    let mut trainer = trainer_of_size(network, kind, size);
    trainer.set_output_bias(2.0);
    GpuProxy::new(gpu(), &trainer.proxy().unwrap()).unwrap()
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
        let kind = LightKind::ALL[index % LightKind::ALL.len()];
        let proxy = proxy(network.clone(), kind);
        let device = GpuProxy::new(gpu(), &proxy).unwrap();
        for _ in 0..2 {
            let light = light(kind, &mut rng);
            let expected = proxy.unit_image(&light).unwrap();
            let error = difference(&device.whole_image(&light, None).unwrap(), &expected.data);
            assert!(error < TOLERANCE, "{network:?}, {kind}: {error}");
            // On a device with matrices, that is by those.
            let image = device.unit_image(&light).unwrap();
            let error = matrices::error(&image.data, &expected.data);
            assert!(error < matrices::TOLERANCE, "{network:?}, {kind}, {}: {error}", device.by_matrices());
            assert_eq!(device.gpu_image(&light).unwrap().read().unwrap(), image.data);
        }
    }
}

/// The networks of the paper's table 1, and the usual one.
#[test]
fn unit_images_equal_sums_of_64_bits_and_are_written_whole() {
    let reference = |width, layers| NetworkConfig::Reference { width, layers, grid: grid() };
    let fast = NetworkConfig::Fast { width: 64, layers: 2, grid: grid() };
    for network in [reference(64, 4), reference(128, 8), reference(256, 8), fast] {
        for kind in [LightKind::Sphere, LightKind::Quad] {
            let device = lit_on_device(network.clone(), kind, [11, 7]);
            let light = light(kind, &mut Rng::stream(3, 2, 1));
            let [plain, by_matrices] = [false, true].map(|by| device.error(&light, by).unwrap());
            println!("{network:?}, {kind}: {plain:?}, by matrices {by_matrices:?}");
            let plain = plain.expect("a plain kernel");
            assert!(plain > 0.0 && plain < f64::from(TOLERANCE), "{network:?}, {kind}: {plain}");
            assert!(by_matrices.is_none_or(|error| error < matrices::TOLERANCE), "{by_matrices:?}");
        }
    }
}

#[test]
fn an_image_that_is_not_written_whole_has_an_infinite_error() {
    let mut device = on_device(networks()[3].clone(), LightKind::Sphere, [37, 23]);
    device.parts.pop();
    let light = LightParams::round(LightKind::Sphere, Vec3::Z, 0.2);
    assert_eq!(device.error(&light, false).unwrap(), Some(f64::INFINITY));
}

#[test]
fn listed_pixels_equal_those_of_the_image() {
    let mut rng = Rng::stream(4, 5, 6);
    for network in [networks()[0].clone(), networks()[5].clone()] {
        let proxy = proxy(network, LightKind::Sphere);
        let mut device = GpuProxy::new(gpu(), &proxy).unwrap();
        let light = light(LightKind::Sphere, &mut rng);
        let image = device.whole_image(&light, None).unwrap();
        // Together, then in batches of as few as there are.
        for (count, max_collected) in [(1, MAX_COLLECTED), (150, MAX_COLLECTED), (7, MAX_COLLECTED), (150, 0)]
        {
            device.max_collected = max_collected;
            let pixels: Vec<u32> = (0..count).map(|_| rng.below(37 * 23)).collect();
            let mut values = vec![[0.0; 3]; count];
            device.forward_pixels(&pixels, &light, &mut values).unwrap();
            for (pixel, value) in pixels.iter().zip(&values) {
                assert_eq!(value[..], image[3 * *pixel as usize..][..3], "pixel {pixel}");
            }
        }
    }
}

#[test]
fn an_image_above_the_largest_buffer_is_made_in_parts() {
    let mut rng = Rng::stream(8, 8, 8);
    for network in [networks()[0].clone(), networks()[3].clone()] {
        let proxy = proxy(network.clone(), LightKind::Sphere);
        let whole = GpuProxy::new(gpu(), &proxy).unwrap();
        // As few pixels in each as go together.
        let cut = GpuProxy::in_parts(gpu(), &proxy, 0).unwrap();
        assert_eq!((whole.parts.len(), cut.parts.len()), (1, 4));
        let light = light(LightKind::Sphere, &mut rng);
        let pixels: Vec<u32> = (0..150).map(|_| rng.below(37 * 23)).collect();
        let [found, expected] = [&cut, &whole].map(|device| {
            let mut listed = vec![[0.0; 3]; pixels.len()];
            device.forward_pixels(&pixels, &light, &mut listed).unwrap();
            let gradient = device.backward(&pixels, &light, &listed).unwrap();
            (device.whole_image(&light, None).unwrap(), listed, gradient)
        });
        assert_eq!(found, expected, "{network:?}");
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

/// Their sums have both signs, so that they are held to the largest of them, at ten times the tolerance of images.
#[test]
fn gradients_equal_those_of_the_cpu() {
    let mut rng = Rng::stream(7, 8, 9);
    for (index, kind) in [
        (0, LightKind::Quad),
        (1, LightKind::FacingDisk),
        (0, LightKind::Spot),
        (1, LightKind::Ellipse),
        (4, LightKind::Sphere),
        (5, LightKind::SphereSpot),
    ] {
        let network = networks()[index].clone();
        let proxy = proxy(network.clone(), kind);
        let mut device = GpuProxy::new(gpu(), &proxy).unwrap();
        let light = light(kind, &mut rng);
        let pixels: Vec<u32> = (0..400).map(|_| rng.below(37 * 23)).collect();
        let d: Vec<[f32; 3]> = pixels.iter().map(|_| [0; 3].map(|_| rng.next_f32() - 0.2)).collect();
        let expected = proxy.backward(&pixels, &light, &d).unwrap();
        // Room for a workgroup a tile, then for one in all, which runs tile after tile; and many batches of pixels.
        for (max_kept, max_collected) in [(1 << 24, MAX_COLLECTED), (0, MAX_COLLECTED), (1 << 24, 0)] {
            (device.max_kept, device.max_collected) = (max_kept, max_collected);
            let found = device.backward(&pixels, &light, &d).unwrap();
            let error = difference(&found, &expected);
            assert!(error < 10.0 * TOLERANCE, "{network:?}, {kind}: {found:?} instead of {expected:?}");
        }
        assert_eq!(device.backward(&[], &light, &[]).unwrap(), vec![0.0; kind.param_count()]);
    }
}

#[test]
fn light_gradients_equal_difference_quotients_of_the_device() {
    for (kind, width) in LightKind::ALL.into_iter().zip([20, 24, 13, 16, 20, 24]) {
        let fast = NetworkConfig::Fast { width, layers: 2, grid: grid() };
        let reference = NetworkConfig::Reference { width, layers: 2, grid: grid() };
        for (network, area) in
            [(&fast, None), (&fast, Some(0.2)), (&reference, None), (&reference, Some(0.2))]
        {
            let mut trainer = trainer_of_size(network.clone(), kind, [40, 24]);
            trainer.state.params = params_away_from_kinks(trainer.layout(), width);
            trainer.state.output_scale = Some(OutputScale { factor: 0.3, area });
            let device = GpuProxy::new(gpu(), &trainer.proxy().unwrap()).unwrap();
            check_light_gradient(&device, kind, &format!("{network:?}, {kind}, {area:?}"));
        }
    }
}

/// The gradient by the light of `sum c_i y_i`, for fixed random `c`, against difference quotients of what the device infers. Where
/// that is cut off at zero the gradient passes it over: c is zero there.
fn check_light_gradient(device: &GpuProxy, kind: LightKind, what: &str) {
    let mut rng = Rng::stream(5, 5, 5);
    // On the floor, well in front of lights that face it.
    let pixels: Vec<u32> = (800..832).collect();
    let light = light(kind, &mut rng);
    let infer = |light: &LightParams| {
        let mut y = vec![[0.0; 3]; pixels.len()];
        device.forward_pixels(&pixels, light, &mut y).unwrap();
        y
    };
    let base = infer(&light);
    let largest = base.as_flattened().iter().fold(0.0f32, |m, y| m.max(*y));
    let random = |y: f32, rng: &mut Rng| if y > 0.02 * largest { rng.next_normal() } else { 0.0 };
    let c: Vec<[f32; 3]> = base.iter().map(|pixel| pixel.map(|y| random(y, &mut rng))).collect();
    let sum = |y: &[[f32; 3]]| {
        let terms = y.as_flattened().iter().zip(c.as_flattened());
        terms.map(|(y, c)| f64::from(*y) * f64::from(*c)).sum::<f64>()
    };
    let terms = base.as_flattened().iter().zip(c.as_flattened());
    let magnitude: f64 = terms.map(|(y, c)| f64::from((y * c).abs())).sum();
    let gradient = device.backward(&pixels, &light, &c).unwrap();
    let largest = gradient.iter().fold(0.0, |m, g| f64::from(g.abs()).max(m));
    let step = 8e-3;
    let rounding = 2e-7 * magnitude / f64::from(step);
    assert!(largest > 5.0 * rounding, "{what}: {largest} drowns in rounding {rounding}");
    for (lane, expected) in gradient.iter().enumerate() {
        let found = difference_quotient(|by| sum(&infer(&moved(&light, lane, by))), step);
        assert!(
            (found - f64::from(*expected)).abs() < 0.01 * largest + rounding,
            "{what}, parameter {lane}: difference quotient {found}, gradient {gradient:?}"
        );
    }
}

/// A target at some pixels of a picture.
fn targets_at(pixels: Vec<u32>, target: &[[f32; 3]], exposure: f32) -> StepTargets {
    let wanted = |(i, pixel): (usize, &u32)| {
        let [r, g, b] = target[*pixel as usize].map(|x| curve(exposure * x));
        [r, g, b, 1e-3 * (i % 7) as f32]
    };
    let wanted = pixels.iter().enumerate().map(wanted).collect();
    StepTargets::target(pixels, wanted, exposure)
}

fn curve(x: f32) -> f32 {
    x / (1.0 + x)
}

/// Random pictures of 37 x 23 pixels up to some brightness.
fn pictures<const N: usize>(most: [f32; N], rng: &mut Rng) -> [Vec<[f32; 3]>; N] {
    most.map(|most| (0..37 * 23).map(|_| [0; 3].map(|_| most * rng.next_f32())).collect())
}

/// Loss and gradients of lights of two kinds at once, and of one that stays, equal those put together from pictures on the CPU.
#[test]
fn a_comparison_equals_one_by_pictures() {
    let mut rng = Rng::stream(2, 2, 2);
    let ([base, still, target], exposure) = (pictures([0.3, 0.5, 2.0], &mut rng), 0.7);
    let proxies =
        [proxy(networks()[0].clone(), LightKind::Sphere), proxy(networks()[5].clone(), LightKind::Quad)];
    // Others read from the shared one.
    let gpu = Gpu::open(&GpuChoice::Best).unwrap();
    let mut devices = proxies.each_ref().map(|proxy| GpuProxy::new(Arc::clone(&gpu), proxy).unwrap());
    let layers = Layers::new(&gpu, &[&base, &still]).unwrap();
    let radiance_of_still = [0.4, 0.9, 0.2];
    let lights = [(LightKind::Sphere, 2.0), (LightKind::Quad, 0.5), (LightKind::Sphere, 0.3)]
        .map(|(kind, r)| (light(kind, &mut rng), [r, 0.6, 1.5 * r]));
    let proxy_of = |light: &LightParams| &proxies[usize::from(light.kind() == LightKind::Quad)];
    let pixels: Vec<u32> = (0..333).map(|_| rng.below(37 * 23)).collect();
    let targets = targets_at(pixels.clone(), &target, exposure);
    let units = lights.each_ref().map(|(light, _)| {
        let mut unit = vec![[0.0; 3]; pixels.len()];
        proxy_of(light).forward_pixels(&pixels, light, &mut unit).unwrap();
        unit
    });
    let (mut loss, mut d_picture) = (0.0, vec![[0.0; 3]; pixels.len()]);
    for (i, (pixel, wanted)) in pixels.iter().zip(&targets.references).enumerate() {
        for c in 0..3 {
            let lit: f32 =
                lights.iter().zip(&units).map(|((_, radiance), unit)| radiance[c] * unit[i][c]).sum();
            let stays = base[*pixel as usize][c] + radiance_of_still[c] * still[*pixel as usize][c];
            let value = exposure * (stays + lit);
            let difference = curve(value) - wanted[c];
            loss += f64::from(difference * difference * wanted[3]);
            d_picture[i][c] = 2.0 * difference * exposure * wanted[3] / (1.0 + value).powi(2);
        }
    }
    let by_radiance = |unit: &[[f32; 3]]| {
        [0, 1, 2].map(|c| d_picture.iter().zip(unit).map(|(d, unit)| d[c] * unit[c]).sum::<f32>())
    };
    let of_still: Vec<[f32; 3]> = pixels.iter().map(|pixel| still[*pixel as usize]).collect();
    // Together, then in batches of as few as there are.
    for max_collected in [MAX_COLLECTED, 0] {
        devices.iter_mut().for_each(|device| device.max_collected = max_collected);
        let before = gpu.bytes_read();
        let all = devices.each_ref();
        let found = compare(&all, &layers, &[radiance_of_still], &lights, &targets).unwrap();
        let values = 1 + 3 * 2 + 2 * all[0].gradient_len() + all[1].gradient_len();
        assert_eq!(gpu.bytes_read() - before, 4 * values as u64, "loss and gradients alone");
        let error = found.loss / loss - 1.0;
        assert!(error.abs() < f64::from(TOLERANCE), "loss {} instead of {loss}", found.loss);
        assert!(difference(&found.layers[0], &by_radiance(&of_still)) < 10.0 * TOLERANCE, "{found:?}");
        for (((light, radiance), unit), found) in lights.iter().zip(&units).zip(&found.lights) {
            let times = |d: &[f32; 3]| std::array::from_fn(|c| d[c] * radiance[c]);
            let d_unit: Vec<[f32; 3]> = d_picture.iter().map(times).collect();
            let params = proxy_of(light).backward(&pixels, light, &d_unit).unwrap();
            let error = difference(&found.params, &params);
            assert!(error < 10.0 * TOLERANCE, "{found:?} instead of {params:?}");
            assert!(difference(&found.radiance, &by_radiance(unit)) < 10.0 * TOLERANCE, "{found:?}");
        }
    }
    let error = compare(&[&devices[0]], &layers, &[radiance_of_still], &lights, &targets).unwrap_err();
    assert!(matches!(error, ProxyError::WrongKind { asked: LightKind::Quad, .. }), "{error}");
}
