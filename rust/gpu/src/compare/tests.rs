use super::*;
use crate::GpuChoice;

const RESIDUALS: [(Residual, f32); 7] = [
    (Residual::Tone, 0.0),
    (Residual::Brightness, 1.0),
    (Residual::Brightness, -0.5),
    (Residual::Color, 0.0),
    (Residual::Warmth, 60.0),
    (Residual::Warmth, -60.0),
    (Residual::Stops, 0.0),
];
/// Cells of a picture, and those that a step looks at: no multiples of anything, more than a workgroup has threads, some of them twice.
const CELLS: usize = 301;
const DRAWN: usize = 333;

fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
}

/// Numbers between 0 and 1 without pattern.
fn noise(i: usize, of: usize) -> f32 {
    let mixed = ((i * 131 + of * 7919 + 1) as u32).wrapping_mul(0x9e37_79b1);
    (mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca77) as f32 / u32::MAX as f32
}

fn picture(of: usize) -> Vec<[f32; 3]> {
    (0..CELLS).map(|i| [0, 1, 2].map(|c| 0.05 + noise(3 * i + c, of))).collect()
}

/// A base and two lights.
fn pictures() -> [Vec<[f32; 3]>; 3] {
    [picture(1), picture(2), picture(3)]
}

fn layers_in(gpu: &Arc<Gpu>, most: u64) -> Layers {
    Layers::in_buffers(gpu, &pictures().each_ref().map(|picture| &picture[..]), most).unwrap()
}

/// A term of every kind, one after the other, and a target whose exposure does not matter.
fn step_targets() -> StepTargets {
    let mut targets = StepTargets::default();
    let any_exposure = [(Residual::Tone, 0.0)];
    for (number, (residual, amount)) in RESIDUALS.into_iter().chain(any_exposure).enumerate() {
        let (first, count) = (targets.cells.len(), DRAWN - 17 * number);
        let weight = 0.5 + 0.1 * number as f32;
        let share = |i: usize| (i % 5) as f32;
        let total: f32 = (0..count).map(share).sum();
        targets.cells.extend((0..count).map(|i| (i * (number + 2) % CELLS) as u32));
        let reference = |i: usize| [0, 1, 2].map(|c| noise(3 * i + c, 10 + number) - 0.3);
        targets.references.extend((0..count).map(|i| {
            let [r, g, b] = reference(i);
            [r, g, b, weight * share(i) / total]
        }));
        targets.terms.push(GpuTerm {
            mean_reference: [0.3, -0.2, 0.1],
            residual,
            amount,
            exposure: 0.8,
            weight,
            luminance: if number == RESIDUALS.len() { 0.7 * weight } else { 0.0 },
            first: first as u32,
            count: count as u32,
        });
    }
    targets
}

/// Targets with one of its terms alone.
fn alone(targets: &StepTargets, number: usize) -> StepTargets {
    let term = targets.terms[number];
    let range = term.first as usize..(term.first + term.count) as usize;
    let (cells, wanted) = (targets.cells[range.clone()].to_vec(), targets.references[range].to_vec());
    StepTargets { cells, references: wanted, terms: vec![GpuTerm { first: 0, ..term }] }
}

fn compared(layers: &Layers, radiances: &[[f32; 3]], targets: &StepTargets) -> Compared {
    let mut commands = layers.gpu().commands("test");
    let step = layers.begin(&mut commands, radiances, targets, 0).unwrap();
    step.compare(&mut commands).unwrap();
    commands.submit().unwrap();
    step.read().unwrap()
}

#[test]
fn gradients_of_every_residual_are_differences_of_the_loss() {
    let (layers, targets) = (layers_in(&gpu(), u64::MAX), step_targets());
    let radiances = [[0.9, 0.6, 0.4], [0.3, 0.5, 1.1]];
    for number in 0..targets.terms.len() {
        let targets = alone(&targets, number);
        let found = compared(&layers, &radiances, &targets);
        let largest = found.layers.as_flattened().iter().fold(0.0_f32, |most, d| most.max(d.abs()));
        for (light, c) in (0..2).flat_map(|light| (0..3).map(move |c| (light, c))) {
            let at = |delta: f32| {
                let mut radiances = radiances;
                radiances[light][c] += delta;
                compared(&layers, &radiances, &targets).loss
            };
            let slope = ((at(4e-3) - at(-4e-3)) / 8e-3) as f32;
            // A loss in single precision is good to 1e-6 of it.
            let rounding = 1e-6 * found.loss as f32 / 4e-3;
            let error = (slope - found.layers[light][c]).abs();
            assert!(
                error < 2e-3 * largest + rounding,
                "{number} {light} {c}: {slope} for {:?}",
                found.layers
            );
        }
        assert!(largest > 1e-3 * found.loss as f32 && found.loss > 0.0, "{number}: {found:?}");
    }
}

#[test]
fn terms_add_up() {
    let (layers, targets) = (layers_in(&gpu(), u64::MAX), step_targets());
    let radiances = [[0.9, 0.6, 0.4], [0.3, 0.5, 1.1]];
    let whole = compared(&layers, &radiances, &targets);
    let each: Vec<Compared> = (0..targets.terms.len())
        .map(|number| compared(&layers, &radiances, &alone(&targets, number)))
        .collect();
    let loss: f64 = each.iter().map(|one| one.loss).sum();
    assert!((whole.loss - loss).abs() < 1e-6 * loss, "{} for {loss}", whole.loss);
    let gradient: f32 = each.iter().map(|one| one.layers[1][2]).sum();
    assert!((whole.layers[1][2] - gradient).abs() < 1e-4 * gradient.abs(), "{whole:?} for {gradient}");
}

#[test]
fn layers_that_need_several_buffers_give_the_same() {
    let (gpu, targets) = (gpu(), step_targets());
    let radiances = [[0.9, 0.6, 0.4], [0.3, 0.5, 1.1]];
    let expected = compared(&layers_in(&gpu, u64::MAX), &radiances, &targets);
    // Another kernel, whose products and sums a card's driver may put together in another way.
    let rounding = if gpu.summary().software { 0.0 } else { 1e-6 };
    for (most, buffers) in [(1, 3), (2 * 12 * CELLS as u64, 2)] {
        let layers = layers_in(&gpu, most);
        assert_eq!(layers.pictures.len(), buffers);
        let found = compared(&layers, &radiances, &targets);
        assert_eq!(found.loss, expected.loss);
        for (&a, &b) in found.layers.as_flattened().iter().zip(expected.layers.as_flattened()) {
            assert!((a - b).abs() <= rounding * b.abs(), "{found:?} for {expected:?}");
        }
    }
}

/// Lights as layers, and as units with two derivatives that are worked on in parts, give the same.
#[test]
fn lights_in_parts_are_those_of_layers() {
    let (gpu, targets) = (gpu(), step_targets());
    let [base, a, b] = pictures();
    let layers = Layers::new(&gpu, &[&base]).unwrap();
    let radiances = [[0.9, 0.6, 0.4], [0.3, 0.5, 1.1]];
    let expected = compared(&layers_in(&gpu, u64::MAX), &radiances, &targets);

    let mut commands = gpu.commands("test");
    let step = layers.begin(&mut commands, &[], &targets, 2 * 5).unwrap();
    let parts = step.parts(150);
    assert_eq!((parts.len() > 5, parts[1].start), (true, 128));
    // Two quads of each light, after one that is not meant.
    let quad = |[r, g, b]: [f32; 3]| [r, g, b, 9.0];
    let quads = [[9.0; 4], [9.0; 4], [9.0; 4], quad(radiances[0]), [9.0; 4], quad(radiances[1])];
    let quads = gpu.buffer_of("quads", &quads).unwrap();
    // The derivatives are half of the other light and twice the own.
    let outputs = |part: Range<usize>| {
        let of = |own: &[[f32; 3]], other: &[[f32; 3]]| {
            targets.cells[part.clone()]
                .iter()
                .flat_map(|cell| {
                    let (own, other) = (own[*cell as usize], other[*cell as usize]);
                    [own, other.map(|x| 0.5 * x), own.map(|x| 2.0 * x)]
                })
                .collect::<Vec<_>>()
        };
        gpu.buffer_of("units", &[of(&a, &b), of(&b, &a)].concat()).unwrap()
    };
    let values: Vec<Buffer<[f32; 3]>> = parts.iter().map(|part| outputs(part.clone())).collect();
    let units = |number: usize| UnitBindings {
        lights: 2,
        radiances: (quads.whole(), 2),
        first: 1,
        values: (values[number].whole(), 3),
        all: None,
    };
    for (number, part) in parts.iter().enumerate() {
        step.add(&mut commands, &units(number), part.clone()).unwrap();
    }
    step.compare(&mut commands).unwrap();
    let (results, first) = step.gradients();
    assert_eq!(results.len(), first + 10);
    for (number, part) in parts.iter().enumerate() {
        step.pull(&mut commands, &units(number), part.clone(), first).unwrap();
    }
    commands.submit().unwrap();
    let found = step.read().unwrap();

    let near = |a: f32, b: f32| (a - b).abs() < 1e-5 * b.abs() + 1e-6;
    assert!((found.loss - expected.loss).abs() < 1e-6 * expected.loss, "{found:?} for {expected:?}");
    for (light, found) in found.gradients.as_chunks::<5>().0.iter().enumerate() {
        let [own, other] = [expected.layers[light], expected.layers[1 - light]];
        assert!((0..3).all(|c| near(found[c], own[c])), "{found:?} for {own:?}");
        let by = |d: [f32; 3]| (0..3).map(|c| d[c] * radiances[light][c]).sum::<f32>();
        assert!(near(found[3], 0.5 * by(other)) && near(found[4], 2.0 * by(own)), "{found:?}");
    }
}

#[test]
fn a_step_reads_its_loss_and_gradients_alone() {
    let gpu = gpu();
    let (layers, targets) = (layers_in(&gpu, u64::MAX), step_targets());
    let before = gpu.bytes_read();
    compared(&layers, &[[1.0; 3]; 2], &targets);
    assert_eq!(gpu.bytes_read() - before, 4 * (targets.terms.len() + 3 * 3) as u64);
}

#[test]
fn a_black_picture_has_no_exposure_to_be_brought_to() {
    let gpu = gpu();
    let black = vec![[0.0; 3]; CELLS];
    let layers = Layers::new(&gpu, &[&black, &picture(2)]).unwrap();
    let found = compared(&layers, &[[0.0; 3]], &step_targets());
    assert!(found.loss.is_finite() && found.layers[0].iter().all(|d| d.is_finite()), "{found:?}");
}

crate::part_of_mirrors!(Residual as U32);

#[test]
fn structs_and_numbers_are_those_of_the_wgsl() {
    crate::assert_mirror!(GpuTerm as "common/compare", "Term", {
        mean_reference, residual, amount, exposure, weight, luminance, first, count,
    });
    crate::assert_mirror!(CompareArguments as "common/compare", "Arguments", { terms });
    crate::assert_mirror!(UnitsArguments as "common/units", "Arguments", {
        count, stride, lights, first, results,
    });
    let residuals = [
        ("TONE", Residual::Tone),
        ("BRIGHTNESS", Residual::Brightness),
        ("COLOR", Residual::Color),
        ("WARMTH", Residual::Warmth),
        ("STOPS", Residual::Stops),
    ];
    for (name, residual) in residuals {
        assert_eq!(crate::layout::constant("common/residual", name).unwrap(), residual as u32);
    }
}
