use half::f16;
use relume_gpu::{Buffer, Gpu, Kernel, Matrices};

use super::DeviceNetwork;
use super::proxy::GpuProxy;
use crate::{LightParams, ProxyError};

const MODULE: &str = "proxy/matrices";
const ENTRY: &str = "infer_by_matrices";
/// Matrices that a subgroup of `matrices.wgsl` makes of a layer: rows of them, and of pixels, which are a tile.
const ROWS: usize = 2;
const COLUMNS: usize = 4;
/// Most error of an image, as a share of its root mean square, that rounding to 16 bits may make: sums of 256 products in steps
/// of 16 are off by some thousandths in each of up to nine layers. Proxies are several times further from what they learned.
pub(super) const TOLERANCE: f64 = 0.02;

/// Inference by matrices of 16-bit floats.
#[derive(Debug)]
pub(super) struct ByMatrices {
    pub kernel: Kernel,
    pub weights: Buffer<u16>,
    /// Pixels of a tile.
    pub tile: usize,
}

impl ByMatrices {
    /// Matrix kernels that were tested; nothing where the device has no such matrices, the network does not fit them,
    /// or they do not give what the plain kernel gives.
    ///
    /// # Errors
    /// If the plain kernel fails.
    pub fn tested(proxy: &GpuProxy) -> Result<Option<Self>, ProxyError> {
        let there = proxy.gpu().matrices().filter(|there| fits(*there, proxy.gpu(), proxy.network()));
        // A driver that refuses them is no reason to do without it.
        let Some(Ok(matrices)) = there.map(|there| Self::new(proxy, there)) else { return Ok(None) };
        let light = test_light(proxy);
        let expected = proxy.whole_image(&light, None)?;
        let Ok(found) = proxy.whole_image(&light, Some(&matrices)) else { return Ok(None) };
        Ok((error(&found, &expected) < TOLERANCE).then_some(matrices))
    }

    fn new(proxy: &GpuProxy, matrices: Matrices) -> Result<Self, ProxyError> {
        let kernel = proxy.gpu().kernel(MODULE, ENTRY, &constants(proxy, matrices))?;
        Self::with_kernel(proxy, matrices, kernel)
    }

    fn with_kernel(proxy: &GpuProxy, matrices: Matrices, kernel: Kernel) -> Result<Self, ProxyError> {
        let weights = half_weights(proxy.network(), matrices.side as usize);
        let weights = proxy.gpu().buffer_of("16-bit weights of a proxy", &weights)?;
        Ok(Self { kernel, weights, tile: COLUMNS * matrices.side as usize })
    }
}

fn constants(proxy: &GpuProxy, matrices: Matrices) -> Vec<(&'static str, u32)> {
    let plain = proxy.constants().into_iter().filter(|(name, _)| !["ROWS", "PIXELS"].contains(name));
    let own = [
        ("PIXELS", COLUMNS as u32 * matrices.side),
        ("SUBGROUPS", proxy.network().width as u32 / (ROWS as u32 * matrices.side)),
    ];
    plain.chain(own).chain(matrices.constants()).collect()
}

/// Root mean square of the error, as a share of that of what is expected.
pub(super) fn error(found: &[f32], expected: &[f32]) -> f64 {
    let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>();
    let error = squares(&mut found.iter().zip(expected).map(|(a, b)| a - b));
    (error / squares(&mut expected.iter().copied())).sqrt()
}

fn fits(matrices: Matrices, gpu: &Gpu, network: &DeviceNetwork) -> bool {
    let (side, limits) = (matrices.side as usize, gpu.limits());
    let rows = network.width.max(network.first_inputs().next_multiple_of(side));
    let (tile, invocations) = (COLUMNS * side, network.width / (ROWS * side) * matrices.subgroup as usize);
    // Activations, eight more than pixels in a row; and four floats for each share of an output.
    let memory = 2 * rows * (tile + 8) + 16 * invocations.max(tile);
    network.width == network.true_width
        && network.width.is_multiple_of(ROWS * side)
        && invocations <= limits.invocations as usize
        && memory <= limits.workgroup_memory as usize
}

/// The weights for the way forward, the first matrix filled up to whole matrices.
fn half_weights(network: &DeviceNetwork, side: usize) -> Vec<u16> {
    let rounded = |values: &[f32]| values.iter().map(|v| f16::from_f32(*v).to_bits()).collect::<Vec<_>>();
    let (width, inputs) = (network.width, network.first_inputs());
    let (first, rest) = network.weights.split_at(inputs * width);
    let mut half = rounded(first);
    half.resize(inputs.next_multiple_of(side) * width, 0);
    half.extend(rounded(&rest[..network.hidden * width * width + 4 * (width + 1)]));
    half
}

/// One of middling size in the middle of the scene.
fn test_light(proxy: &GpuProxy) -> LightParams {
    let info = proxy.proxy().info();
    let center = glam::Vec3::from(info.normalisation.center);
    let size = (info.size.min * info.size.max).sqrt();
    LightParams::facing_down(info.kind, center, size)
}

#[cfg(test)]
mod tests {
    use relume_gpu::modules;

    use super::*;
    use crate::gpu::tests::{grid, lit_on_device, on_device};
    use crate::{LightKind, NetworkConfig};

    /// Emulation of matrices: each invocation holds of weights and sums the row of its number, of inputs where they
    /// are. The compiler must not know that there are 16 of everything, or it takes half a minute to unroll all loops.
    const EMULATED: &str = "
        var<private> lane: u32;
        var<private> side: u32;
        struct Row { values: array<f32, 16> }
        struct Place { at: u32, stride: u32 }
        fn load_weights(at: u32, stride: u32) -> Row {
            var row: Row;
            for (var k = 0u; k < side; k++) { row.values[k] = f32(weights[at + k * stride + lane]); }
            return row;
        }
        fn load_x(at: u32, stride: u32) -> Place { return Place(at, stride); }
        fn multiply_add(a: Row, b: Place, c: Row) -> Row {
            var sums: Row;
            for (var n = 0u; n < side; n++) {
                var sum = c.values[n];
                for (var k = 0u; k < side; k++) { sum += a.values[k] * f32(x[b.at + k * b.stride + n]); }
                sums.values[n] = f32(f16(sum));
            }
            return sums;
        }
        fn store_x(c: Row, at: u32, stride: u32) {
            for (var n = 0u; n < side; n++) { x[at + lane * stride + n] = f16(c.values[n]); }
        }
    ";

    /// Those that are emulated: a card's.
    const CARD: Matrices = Matrices { side: 16, subgroup: 32 };

    /// The module for devices without matrices and with subgroups of any size.
    fn emulated(proxy: &GpuProxy) -> String {
        let count = "let count = arguments.count;\n";
        let replacements = [
            ("enable wgpu_cooperative_matrix;", String::new()),
            ("@builtin(subgroup_id) subgroup: u32,", String::new()),
            (
                count,
                format!(
                    "let subgroup = thread / 32u; lane = thread % 16u; side = 16u * arguments.lights; {count}"
                ),
            ),
            ("alias Left = coop_mat16x16<f16, A>;", String::new()),
            ("alias Right = coop_mat16x16<f16, B>;", String::new()),
            ("alias HalfSum = coop_mat16x16<f16, C>;", "alias HalfSum = Row;".into()),
            ("alias WideSum = coop_mat16x16<f32, C>;", String::new()),
            ("coopLoad<Left>(&weights[", "load_weights(".into()),
            ("coopLoadT<Right>(&x[", "load_x(".into()),
            ("coopMultiplyAdd(", "multiply_add(".into()),
            ("_at], ", "_at, ".into()),
            ("coopStoreT(", "store_x(".into()),
            (", &x[c", ", c".into()),
        ];
        let text = modules::compose(MODULE, &constants(proxy, CARD)).unwrap();
        let text = replacements.iter().fold(text, |text, (from, to)| {
            assert!(text.contains(from), "{from} is not in the module any more");
            text.replace(from, to)
        });
        text + EMULATED
    }

    /// Matrices in software; nothing where even that cannot be.
    fn by_emulated_matrices(proxy: &GpuProxy) -> Option<ByMatrices> {
        if !proxy.gpu().limits().f16 {
            let name = &proxy.gpu().summary().name;
            assert!(std::env::var_os("CI").is_none(), "{name} has no 16-bit floats");
            println!("skipped: {name} has no 16-bit floats");
            return None;
        }
        let kernel = proxy.gpu().kernel_of_text("emulated", &emulated(proxy), ENTRY).unwrap();
        Some(ByMatrices::with_kernel(proxy, CARD, kernel).unwrap())
    }

    #[test]
    fn images_by_matrices_are_those_of_the_plain_kernel() {
        // Two subgroups and a layer in between; outputs that two invocations share. All in software, so few pixels.
        let fast = NetworkConfig::Fast { width: 64, layers: 1, grid: grid() };
        let reference = NetworkConfig::Reference { width: 128, layers: 1, grid: grid() };
        for network in [fast, reference] {
            let proxy = on_device(network.clone(), LightKind::Sphere, [11, 7]);
            let Some(matrices) = by_emulated_matrices(&proxy) else { return };
            let light = test_light(&proxy);
            let expected = proxy.whole_image(&light, None).unwrap();
            let error = error(&proxy.whole_image(&light, Some(&matrices)).unwrap(), &expected);
            assert!(error > 1e-6 && error < TOLERANCE, "{network:?}: {error}");
        }
    }

    /// Networks with the widths of the paper's table 1, for a tile and some pixels more. Not as deep: Mesa's software
    /// driver ends all loops of a kernel after 65,535 turns in all, which these come close to. On a card with matrices
    /// `unit_images_equal_sums_of_64_bits` and the benchmarks take the whole networks.
    #[test]
    fn images_by_matrices_equal_sums_of_64_bits_and_are_written_whole() {
        for (width, layers) in [(64, 4), (128, 4), (256, 2)] {
            let network = NetworkConfig::Reference { width, layers, grid: grid() };
            let proxy = lit_on_device(network, LightKind::Sphere, [9, 8]);
            let Some(matrices) = by_emulated_matrices(&proxy) else { return };
            let error = proxy.error_of(&test_light(&proxy), Some(&matrices)).unwrap();
            println!("{width}/{layers}: {error}");
            assert!(error > 1e-6 && error < TOLERANCE, "{width}/{layers}: {error}");
        }
    }

    #[test]
    fn half_weights_fill_up_the_first_matrix() {
        let (width, hidden) = (32, 1);
        let len = 12 * width + hidden * width * width + 4 * (width + 1);
        let weights: Vec<f32> = (0..len + 100).map(|i| (i % 1000) as f32).collect();
        let network = DeviceNetwork { fast: true, width, true_width: width, hidden, pixel_rows: 44, weights };
        let half = half_weights(&network, 16);
        assert_eq!(half.len(), len + 4 * width);
        assert!(half[12 * width..16 * width].iter().all(|w| *w == 0));
        assert_eq!(f16::from_bits(half[16 * width]).to_f32(), network.weights[12 * width]);
        assert_eq!(f16::from_bits(half[half.len() - 1]).to_f32(), network.weights[len - 1]);
    }
}
