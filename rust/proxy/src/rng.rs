/// A small random stream. Streams are made from a seed and two counters, so that the numbers of a training step
/// depend on the step alone: resuming needs no state beyond the step, and threads need no order.
///
/// The generator is PCG-XSH-RR 64/32 (O'Neill, "PCG: A Family of Simple Fast Space-Efficient Statistically Good
/// Algorithms for Random Number Generation", 2014), its state scrambled by the finaliser of SplitMix64.
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
    increment: u64,
}

impl Rng {
    /// The stream of `(seed, a, b)`.
    pub fn stream(seed: u64, a: u64, b: u64) -> Self {
        let key = scramble(scramble(scramble(seed) ^ a) ^ b.rotate_left(32));
        let mut rng = Self { state: key, increment: scramble(key) | 1 };
        rng.next_u32();
        rng
    }

    /// 32 random bits.
    pub fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.increment);
        let xorshifted = (((old >> 18) ^ old) >> 27) as u32;
        xorshifted.rotate_right((old >> 59) as u32)
    }

    /// Uniform in `[0, 1)`.
    pub fn next_f32(&mut self) -> f32 {
        (self.next_u32() >> 8) as f32 * (1.0 / (1 << 24) as f32)
    }

    /// Uniform in `0..n`, `n` above 0, by the high half of a product; its bias is below `n / 2^32`.
    pub fn below(&mut self, n: u32) -> u32 {
        ((u64::from(self.next_u32()) * u64::from(n)) >> 32) as u32
    }

    /// A standard normal deviate (Box and Muller 1958).
    pub fn next_normal(&mut self) -> f32 {
        let u = 1.0 - self.next_f32();
        let v = self.next_f32();
        (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    }
}

fn scramble(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_and_are_uniform() {
        let mut sum = 0.0;
        let mut square = 0.0;
        for stream in 0..2000u64 {
            let x = f64::from(Rng::stream(7, stream, 3).next_f32());
            sum += x;
            square += x * x;
        }
        assert!((sum / 2000.0 - 0.5).abs() < 0.025, "mean of first numbers {}", sum / 2000.0);
        assert!((square / 2000.0 - 1.0 / 3.0).abs() < 0.025);
        assert_ne!(Rng::stream(1, 2, 3).next_u32(), Rng::stream(1, 3, 2).next_u32());
    }

    #[test]
    fn normal_deviates_have_unit_variance() {
        let mut rng = Rng::stream(1, 0, 0);
        let variance = (0..4000).map(|_| rng.next_normal().powi(2)).sum::<f32>() / 4000.0;
        assert!((variance - 1.0).abs() < 0.08, "variance {variance}");
    }
}
