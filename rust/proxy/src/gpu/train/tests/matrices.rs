//! Products by matrices: in software, since most software drivers have none, and by the device's own where it has them.

use relume_gpu::{Kernel, Matrices, modules};

use super::super::matrices::{TOLERANCE, constants, error};
use super::*;

/// Emulation of matrices: each invocation holds of left factors the row of its number, of right ones where they are, of
/// sums half of its row. The compiler must not know how much that is, or it takes half a minute to unroll all loops.
const EMULATED: &str = "
    struct Row { values: array<f32, 16> }
    struct Half { values: array<f32, 8> }
    struct Place { at: u32, stride: u32 }
    fn load_left(at: u32, stride: u32, local: u32, half: u32) -> Row {
        var row: Row;
        for (var k = 0u; k < 2u * half; k++) { row.values[k] = f32(left[at + k * stride + local % 16u]); }
        return row;
    }
    fn load_right(at: u32, stride: u32, local: u32, half: u32) -> Place {
        return Place(at + local / 16u % 2u * half, stride);
    }
    fn multiply_add(a: Row, b: Place, c: Half, half: u32) -> Half {
        var sums: Half;
        for (var n = 0u; n < half; n++) {
            var sum = c.values[n];
            for (var k = 0u; k < 2u * half; k++) { sum += a.values[k] * f32(right[b.at + k * b.stride + n]); }
            sums.values[n] = sum;
        }
        return sums;
    }
    fn store_sums(c: Half, at: u32, stride: u32, local: u32, half: u32) {
        let start = at + local % 16u * stride + local / 16u % 2u * half;
        for (var n = 0u; n < half; n++) { sums_of_tile[start + n] = c.values[n]; }
    }
";

/// A kernel for devices without matrices and with subgroups of any size.
fn emulated(gpu: &Gpu, name: &str, entry: &str) -> Result<Kernel, GpuError> {
    gpu.kernel_of_text(name, &emulated_text(name)?, entry)
}

fn emulated_text(name: &str) -> Result<String, GpuError> {
    let half = "let half = min(8u, arrayLength(&layers) * 8u);";
    let replacements = [
        ("enable wgpu_cooperative_matrix;", String::new()),
        ("alias Left = coop_mat16x16<f16, A>;", String::new()),
        ("alias Right = coop_mat16x16<f16, B>;", String::new()),
        ("alias HalfSum = coop_mat16x16<f16, C>;", String::new()),
        ("alias WideSum = coop_mat16x16<f32, C>;", "alias WideSum = Half;".into()),
        ("let pitch = PITCH;", format!("let pitch = PITCH; {half}")),
        ("let pitch = SUM_PITCH;", format!("let pitch = SUM_PITCH; {half}")),
        ("coopLoad<Left>(&left[a_at], pitch)", "load_left(a_at, pitch, local, half)".into()),
        ("coopLoadT<Right>(&right[", "load_right(".into()),
        ("near_at], pitch);", "near_at, pitch, local, half);".into()),
        ("far_at], pitch);", "far_at, pitch, local, half);".into()),
        ("coopMultiplyAdd(a, b_near, near)", "multiply_add(a, b_near, near, half)".into()),
        ("coopMultiplyAdd(a, b_far, far)", "multiply_add(a, b_far, far, half)".into()),
        ("coopStoreT(", "store_sums(".into()),
        (", &sums_of_tile[", ", ".into()),
    ];
    let text = modules::compose(name, &[("MATRICES", 1)])?;
    let text = replacements.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from} is not in the module any more");
        text.replace(from, to)
    });
    Ok(text + EMULATED)
}

/// Matrices that a training multiplies by.
#[derive(Clone, Copy, Debug)]
enum By {
    /// Those of a card, in software.
    Software,
    /// A device's own.
    Device(Matrices),
}

/// All that a device can. Where a kernel takes subgroups for larger than they are, those of one number do the same; so each has
/// several pairs, as it has where small matrices meet large subgroups.
fn ways(gpu: &Gpu) -> Vec<By> {
    assert!(gpu.limits().f16, "{} has no 16-bit floats", gpu.summary().name);
    let own = gpu.matrices().into_iter();
    let own = own.flat_map(|own| [own, Matrices { subgroup: 4 * own.subgroup, ..own }]).map(By::Device);
    std::iter::once(By::Software).chain(own).collect()
}

/// Makes a training multiply by matrices.
fn multiply_by(training: &mut GpuTraining, way: By) {
    let gpu = Arc::clone(&training.gpu);
    let products = training.products(true, |name, entry| match way {
        By::Software => emulated(&gpu, name, entry),
        By::Device(matrices) => gpu.kernel(name, entry, &constants(matrices)),
    });
    training.kernels.products = products.expect("compiled");
}

fn check<N: Network>(network: &N, setup: &Setup, config: &TrainConfig, what: &str) {
    let batch = samples(setup, 1, config.lights_per_pixel);
    let params = network.layout().start_values(5);
    let mut training = on_device(network, setup, config, &params, &batch);
    let (expected_loss, expected) = loss_and_gradient(&training, 1);
    for way in ways(&training.gpu) {
        multiply_by(&mut training, way);
        let (loss, gradient) = loss_and_gradient(&training, 1);
        let error = error(network.layout(), &gradient, &expected);
        println!("{what}, {way:?}: loss {loss} and {expected_loss}, error {error:.1e}");
        // 16 bits must show, or nothing was tested.
        assert!(error > 1e-5 && error < TOLERANCE, "{what}, {way:?}: error {error}");
        let off = (loss - expected_loss).abs();
        assert!(off < 1e-2 * expected_loss, "{what}, {way:?}: loss {loss}, not {expected_loss}");
    }
}

#[test]
fn gradients_by_matrices_are_those_of_the_plain_kernels() {
    let (setup, grid) = (setup(LightKind::Sphere), tiny_grid());
    // Two tiles of rows, in chains.
    let fast = FastNetwork::new(72, 1, &grid, setup.size, setup.encoding);
    check(&fast, &setup, &config(NetworkConfig::Fast { width: 72, layers: 1, grid }, 1, 32), "fast 72x1");
    // Single layers.
    let reference = ReferenceNetwork::new(132, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Reference { width: 132, layers: 1, grid }, 1, 8);
    check(&reference, &setup, &config, "reference 132/1");
}

#[test]
fn matrices_that_give_something_else_are_left_alone() {
    let (setup, grid) = (setup(LightKind::Sphere), tiny_grid());
    let network = ReferenceNetwork::new(16, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Reference { width: 16, layers: 1, grid }, 1, 8);
    let demand = Demand { config: &config, scene: &setup.scene, chunks: 1, draws: 8, matrices: true };
    let mut training = GpuTraining::new(gpu(), &network, &demand).expect("room on the device");
    let has_matrices = training.gpu.matrices().is_some();
    assert!(has_matrices || !training.by_matrices(), "no device has what its driver does not offer");
    let gpu = Arc::clone(&training.gpu);
    training.kernels.products =
        training.products(false, |name, entry| gpu.kernel(name, entry, &[])).expect("compiled");
    let right = training.products(true, |name, entry| emulated(&gpu, name, entry)).expect("compiled");
    let wrong = training
        .products(true, |name, entry| {
            // The second sixteen columns are those of the first.
            let text = emulated_text(name)?.replace("load_right(far_at", "load_right(near_at");
            gpu.kernel_of_text(name, &text, entry)
        })
        .expect("compiled");
    training.adopt(wrong, &network, SIZE).expect("compared");
    assert!(!training.by_matrices());
    training.adopt(right, &network, SIZE).expect("compared");
    assert!(training.by_matrices());
    let weights = training.download().expect("read back");
    assert!(weights.iter().flatten().all(|weight| *weight == 0.0), "the comparison leaves nothing behind");
    assert_eq!(training.progress().expect("read back").diverged, 0);
}

#[test]
fn training_by_matrices_reaches_the_error_of_32_bits() {
    let network = NetworkConfig::Fast { width: 32, layers: 1, grid: tiny_grid() };
    let config = TrainConfig { network, batch_start: 1024, batch_end: 1024, ..short(32_000) };
    let score = |mut trainer: Trainer| {
        run(&mut trainer);
        trainer.validate(&room()).expect("scores").psnr
    };
    let wide: Vec<f32> = (1..=4).map(|seed| score(trainer(&config, seed))).collect();
    let mut by_matrices = trainer(&config, 1).on_gpu(gpu()).expect("room");
    let training = &mut by_matrices.device.as_mut().expect("on the device").training;
    let own = training.gpu.matrices().map_or(By::Software, By::Device);
    multiply_by(training, own);
    let found = score(by_matrices);
    println!("32 bits {wide:?}, by matrices {found}");
    let mean = wide.iter().sum::<f32>() / wide.len() as f32;
    let spread = (wide.iter().map(|score| (score - mean).powi(2)).sum::<f32>() / 3.0).sqrt();
    assert!((found - wide[0]).abs() < 0.5 * spread, "{found} dB, in 32 bits {wide:?}, spread {spread}");
}
