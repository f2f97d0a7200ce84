use super::*;
use crate::Rng;

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut rng = Rng::stream(seed, 0, 0);
    (0..len).map(|_| rng.next_normal()).collect()
}

fn assert_close(found: &[f32], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!(
            (f64::from(*a) - b).abs() <= 2e-5 * (1.0 + b.abs()),
            "{what}: value {i} is {a} instead of {b}"
        );
    }
}

fn naive_dense(w: &[f32], x: &[f32], outputs: usize, inputs: usize) -> Vec<f64> {
    let at = |o: usize, s: usize| {
        (0..inputs).map(|i| f64::from(w[o * inputs + i]) * f64::from(x[i * LANES + s])).sum::<f64>()
    };
    (0..outputs * LANES).map(|i| at(i / LANES, i % LANES)).collect()
}

#[test]
fn dense_equals_the_naive_product_for_every_start_and_finish() {
    for isa in Isa::available() {
        for (outputs, inputs) in [(1, 1), (2, 3), (3, 64), (4, 5), (5, 7), (6, 16), (64, 64), (65, 33)] {
            let w = random(outputs * inputs, 1);
            let x = random(inputs * LANES, 2);
            let bias = random(outputs, 3);
            let mask = random(outputs * LANES, 4);
            let product = naive_dense(&w, &x, outputs, inputs);
            let mut packed = PackedMatrix::new(outputs, inputs);
            packed.pack(&w, inputs);
            let what = format!("{} {outputs} x {inputs}", isa.name());

            let mut y = vec![f32::NAN; outputs * LANES];
            dense(isa, &packed, Start::Zero, &x, &mut y, Finish::Linear);
            assert_close(&y, &product, &what);

            let biased: Vec<f64> =
                product.iter().enumerate().map(|(i, p)| (p + f64::from(bias[i / LANES])).max(0.0)).collect();
            dense(isa, &packed, Start::Bias(&bias), &x, &mut y, Finish::Relu);
            assert_close(&y, &biased, &what);

            let doubled: Vec<f64> =
                (0..y.len()).map(|i| if mask[i] > 0.0 { biased[i] + product[i] } else { 0.0 }).collect();
            dense(isa, &packed, Start::Output, &x, &mut y, Finish::Mask(&mask));
            assert_close(&y, &doubled, &what);
        }
    }
}

#[test]
fn packing_the_transpose_swaps_rows_and_columns() {
    let (rows, columns, stride) = (7, 10, 16);
    let w = random(rows * stride, 5);
    let x = random(rows * LANES, 6);
    let mut packed = PackedMatrix::new(columns, rows);
    packed.pack_transposed(&w, stride);
    let transposed: Vec<f32> = (0..columns * rows).map(|i| w[(i % rows) * stride + i / rows]).collect();
    let mut y = vec![f32::NAN; columns * LANES];
    dense(Isa::Portable, &packed, Start::Zero, &x, &mut y, Finish::Linear);
    assert_close(&y, &naive_dense(&transposed, &x, columns, rows), "transposed");
}

#[test]
fn outer_adds_the_products_of_all_samples() {
    for isa in Isa::available() {
        for (rows, features, tiles) in [(1, 1, 1), (3, 64, 4), (6, 16, 2), (64, 40, 3), (17, 70, 1)] {
            let stride = padded(features);
            let a = random(tiles * rows * LANES, 7);
            let x = random(tiles * features * LANES, 8);
            let mut b = vec![f32::NAN; tiles * LANES * stride];
            for (x, b) in x.chunks(features * LANES).zip(b.chunks_mut(LANES * stride)) {
                transpose(isa, x, stride, b);
            }
            let mut out = vec![1.0; rows * stride];
            outer(isa, &a, &b, rows, stride, &mut out);
            let expected: Vec<f64> = (0..rows * stride)
                .map(|i| {
                    let (row, column) = (i / stride, i % stride);
                    let product = |t: usize, s: usize| {
                        f64::from(a[(t * rows + row) * LANES + s])
                            * f64::from(x[(t * features + column) * LANES + s])
                    };
                    let sum = |t| (0..LANES).map(|s| product(t, s)).sum::<f64>();
                    1.0 + if column < features { (0..tiles).map(sum).sum() } else { 0.0 }
                })
                .collect();
            assert_close(&out, &expected, isa.name());
        }
    }
}

#[test]
fn modulation_and_its_gradient_agree_with_plain_sums() {
    let rows = 5;
    let (z, gamma, beta) = (random(rows * LANES, 9), random(rows, 10), random(rows, 11));
    for isa in Isa::available() {
        let mut h = vec![f32::NAN; rows * LANES];
        modulate(isa, &z, &gamma, &beta, true, &mut h);
        let expected: Vec<f64> = (0..h.len())
            .map(|i| (f64::from(z[i]) * f64::from(gamma[i / LANES]) + f64::from(beta[i / LANES])).max(0.0))
            .collect();
        assert_close(&h, &expected, isa.name());

        let mut d = random(rows * LANES, 12);
        let before = d.clone();
        let (mut d_gamma, mut d_beta) = (vec![1.0; rows], vec![2.0; rows]);
        modulate_backward(isa, &z, &gamma, &mut d, &mut d_gamma, &mut d_beta);
        let sum = |row: usize, f: &dyn Fn(usize) -> f64| (row * LANES..(row + 1) * LANES).map(f).sum::<f64>();
        let with_z = |i: usize| f64::from(before[i]) * f64::from(z[i]);
        let expected: Vec<f64> = (0..rows).map(|r| 1.0 + sum(r, &with_z)).collect();
        assert_close(&d_gamma, &expected, isa.name());
        let expected: Vec<f64> = (0..rows).map(|r| 2.0 + sum(r, &|i| f64::from(before[i]))).collect();
        assert_close(&d_beta, &expected, isa.name());
        let expected: Vec<f64> =
            (0..d.len()).map(|i| f64::from(before[i]) * f64::from(gamma[i / LANES])).collect();
        assert_close(&d, &expected, isa.name());
    }
}
