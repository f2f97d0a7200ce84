//! Inversion of cumulative distributions that have no closed inverse.

/// Steps after which halving has used up the precision of what is asked for.
const MOST_STEPS: usize = 64;

/// Cosine below which a share `u` lies, by the share below a cosine and its derivative.
pub(super) fn invert(below: impl Fn(f64) -> (f64, f64), u: f64) -> f64 {
    invert_between(-1.0, 1.0, below, u)
}

/// Place between two others below which a share `u` lies: Newton's method, kept within a shrinking bracket (Press et al., "Numerical
/// Recipes", `rtsafe`).
pub(super) fn invert_between(start: f64, end: f64, below: impl Fn(f64) -> (f64, f64), u: f64) -> f64 {
    let (mut low, mut high) = (start, end);
    let mut x = low + (high - low) * u.clamp(0.0, 1.0);
    for _ in 0..MOST_STEPS {
        let (share, slope) = below(x);
        let error = share - u;
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - error / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-9 * (end - start) {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_share_is_inverted() {
        for u in [0.0, 0.001, 0.3, 0.999, 1.0] {
            let found = invert_between(0.0, 2.0, |x| ((x / 2.0).powi(3), 3.0 * x * x / 8.0), u);
            assert!((found - 2.0 * u.cbrt()).abs() < 1e-6, "{u} {found}");
        }
    }
}
