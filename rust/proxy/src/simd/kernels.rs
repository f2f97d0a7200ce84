/// Writes the kernels of one instruction set. The module that calls it defines `WIDTH` (lanes of a vector), `WIDE`
/// (vectors in a tile's row), `load`, `store`, `splat`, `add`, `fma`, `relu`, `keep_positive` and `transpose_block` (8 x 8).
/// It hands in the type of its vectors and the attributes that its functions carry.
macro_rules! define_kernels {
    ($vector:ty, $(#[$attribute:meta])*) => {
        use super::{DenseJob, LANES, PAD, ROWS};

        /// See [`super::dense`].
        $(#[$attribute])*
        pub(super) unsafe fn dense(job: &DenseJob) {
            let mut row = 0;
            while row < job.outputs {
                // SAFETY: the job's pointers cover whole tiles and blocks, checked by the caller.
                unsafe {
                    match job.outputs - row {
                        1 => dense_rows::<1, WIDE>(job, row),
                        2 => dense_rows::<2, WIDE>(job, row),
                        3 => dense_rows::<3, WIDE>(job, row),
                        4 => dense_rows::<4, 2>(job, row),
                        5 => dense_rows::<5, 2>(job, row),
                        _ => dense_rows::<6, 2>(job, row),
                    }
                }
                row += ROWS;
            }
        }

        #[inline]
        $(#[$attribute])*
        unsafe fn dense_rows<const R: usize, const C: usize>(job: &DenseJob, row: usize) {
            let mut lane = 0;
            while lane < LANES {
                // SAFETY: as in `dense`.
                unsafe { dense_block::<R, C>(job, row, lane) };
                lane += C * WIDTH;
            }
        }

        #[inline]
        $(#[$attribute])*
        unsafe fn dense_block<const R: usize, const C: usize>(job: &DenseJob, row: usize, lane: usize) {
            // SAFETY: `row < outputs` and `lane + C * WIDTH <= LANES`, so that every address below lies in a tile or
            // in a packed block, which hold `outputs` rows and a multiple of `ROWS` outputs.
            unsafe {
                let mut sums = [[splat(0.0); C]; R];
                for r in 0..R {
                    for c in 0..C {
                        if job.from_output {
                            sums[r][c] = load(job.y.add((row + r) * LANES + lane + c * WIDTH));
                        } else if !job.bias.is_null() {
                            sums[r][c] = splat(*job.bias.add(row + r));
                        }
                    }
                }
                let mut w = job.weights.add(row * job.inputs);
                let mut x = job.x.add(lane);
                for _ in 0..job.inputs {
                    let mut values = [splat(0.0); C];
                    for c in 0..C {
                        values[c] = load(x.add(c * WIDTH));
                    }
                    for r in 0..R {
                        let weight = splat(*w.add(r));
                        for c in 0..C {
                            sums[r][c] = fma(weight, values[c], sums[r][c]);
                        }
                    }
                    w = w.add(ROWS);
                    // After the last row this may lie beyond the end, where `add` must not go.
                    x = x.wrapping_add(LANES);
                }
                for r in 0..R {
                    for c in 0..C {
                        let at = (row + r) * LANES + lane + c * WIDTH;
                        let mut value = sums[r][c];
                        if job.relu {
                            value = relu(value);
                        }
                        if !job.mask.is_null() {
                            value = keep_positive(value, load(job.mask.add(at)));
                        }
                        store(job.y.add(at), value);
                    }
                }
            }
        }

        /// See [`super::outer`].
        $(#[$attribute])*
        pub(super) unsafe fn outer(
            tiles: usize,
            rows: usize,
            stride: usize,
            a: *const f32,
            b: *const f32,
            out: *mut f32,
        ) {
            let mut column = 0;
            while column < stride {
                let mut row = 0;
                while row < rows {
                    // SAFETY: `column + PAD <= stride` and `row < rows`; the caller has checked the lengths.
                    unsafe {
                        let (a, b) = (a.add(row * LANES), b.add(column));
                        let out = out.add(row * stride + column);
                        match rows - row {
                            1 => outer_block::<1>(tiles, rows, stride, a, b, out),
                            2 => outer_block::<2>(tiles, rows, stride, a, b, out),
                            3 => outer_block::<3>(tiles, rows, stride, a, b, out),
                            4 => outer_block::<4>(tiles, rows, stride, a, b, out),
                            5 => outer_block::<5>(tiles, rows, stride, a, b, out),
                            _ => outer_block::<6>(tiles, rows, stride, a, b, out),
                        }
                    }
                    row += ROWS;
                }
                column += PAD;
            }
        }

        #[inline]
        $(#[$attribute])*
        unsafe fn outer_block<const R: usize>(
            tiles: usize,
            rows: usize,
            stride: usize,
            a: *const f32,
            b: *const f32,
            out: *mut f32,
        ) {
            const C: usize = PAD / WIDTH;
            // SAFETY: see `outer`; `a`, `b` and `out` point at the block's first value.
            unsafe {
                let mut sums = [[splat(0.0); C]; R];
                for r in 0..R {
                    for c in 0..C {
                        sums[r][c] = load(out.add(r * stride + c * WIDTH));
                    }
                }
                for tile in 0..tiles {
                    let a = a.add(tile * rows * LANES);
                    let b = b.add(tile * LANES * stride);
                    for s in 0..LANES {
                        let mut values = [splat(0.0); C];
                        for c in 0..C {
                            values[c] = load(b.add(s * stride + c * WIDTH));
                        }
                        for r in 0..R {
                            let weight = splat(*a.add(r * LANES + s));
                            for c in 0..C {
                                sums[r][c] = fma(weight, values[c], sums[r][c]);
                            }
                        }
                    }
                }
                for r in 0..R {
                    for c in 0..C {
                        store(out.add(r * stride + c * WIDTH), sums[r][c]);
                    }
                }
            }
        }

        /// See [`super::transpose`].
        $(#[$attribute])*
        pub(super) unsafe fn transpose(features: usize, stride: usize, x: *const f32, out: *mut f32) {
            let whole = features / 8 * 8;
            // SAFETY: blocks and single values lie in the tile and, as `features <= stride`, in the transposed tile.
            unsafe {
                for feature in (0..whole).step_by(8) {
                    for s in (0..LANES).step_by(8) {
                        transpose_block(x.add(feature * LANES + s), LANES, out.add(s * stride + feature), stride);
                    }
                }
                for s in 0..LANES {
                    for feature in whole..features {
                        *out.add(s * stride + feature) = *x.add(feature * LANES + s);
                    }
                    for feature in features..stride {
                        *out.add(s * stride + feature) = 0.0;
                    }
                }
            }
        }

        /// See [`super::row_sums`].
        $(#[$attribute])*
        pub(super) unsafe fn row_sums(x: &[f32], sums: &mut [f32]) {
            for (sum, row) in sums.iter_mut().zip(x.chunks_exact(LANES)) {
                let mut partial = splat(0.0);
                for s in (0..LANES).step_by(WIDTH) {
                    // SAFETY: `s + WIDTH <= LANES`, the length of `row`.
                    partial = add(partial, unsafe { load(row.as_ptr().add(s)) });
                }
                *sum += total(partial);
            }
        }

        /// See [`super::modulate`].
        $(#[$attribute])*
        pub(super) unsafe fn modulate(z: &[f32], gamma: &[f32], beta: &[f32], activate: bool, h: &mut [f32]) {
            let rows = z.chunks_exact(LANES).zip(h.chunks_exact_mut(LANES));
            for ((z, h), (gamma, beta)) in rows.zip(gamma.iter().zip(beta)) {
                let (gamma, beta) = (splat(*gamma), splat(*beta));
                for s in (0..LANES).step_by(WIDTH) {
                    // SAFETY: `s + WIDTH <= LANES`, the length of `z` and `h`.
                    unsafe {
                        let value = fma(load(z.as_ptr().add(s)), gamma, beta);
                        store(h.as_mut_ptr().add(s), if activate { relu(value) } else { value });
                    }
                }
            }
        }

        /// See [`super::modulate_backward`].
        $(#[$attribute])*
        pub(super) unsafe fn modulate_backward(
            z: &[f32],
            gamma: &[f32],
            d: &mut [f32],
            d_gamma: &mut [f32],
            d_beta: &mut [f32],
        ) {
            let rows = z.chunks_exact(LANES).zip(d.chunks_exact_mut(LANES));
            for (((z, d), gamma), (d_gamma, d_beta)) in rows.zip(gamma).zip(d_gamma.iter_mut().zip(d_beta)) {
                let gamma = splat(*gamma);
                let (mut by_gamma, mut by_beta) = (splat(0.0), splat(0.0));
                for s in (0..LANES).step_by(WIDTH) {
                    // SAFETY: `s + WIDTH <= LANES`, the length of `z` and `d`.
                    unsafe {
                        let value = load(d.as_ptr().add(s));
                        by_gamma = fma(value, load(z.as_ptr().add(s)), by_gamma);
                        by_beta = add(by_beta, value);
                        store(d.as_mut_ptr().add(s), fma(value, gamma, splat(0.0)));
                    }
                }
                *d_gamma += total(by_gamma);
                *d_beta += total(by_beta);
            }
        }

        /// Sum of all lanes.
        #[inline]
        $(#[$attribute])*
        fn total(x: $vector) -> f32 {
            let mut lanes = [0.0f32; WIDTH];
            // SAFETY: `lanes` holds one vector.
            unsafe { store(lanes.as_mut_ptr(), x) };
            let mut width = WIDTH / 2;
            while width > 0 {
                for lane in 0..width {
                    lanes[lane] += lanes[lane + width];
                }
                width /= 2;
            }
            lanes[0]
        }
    };
}

pub(super) use define_kernels;
