//! Measured figures, and what machines could do at best.

use std::fmt;

/// One measured figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of the measurement.
    pub name: String,
    /// The figure.
    pub value: f64,
    /// Unit; `s` and `ms` are times, of which less is better.
    pub unit: &'static str,
    /// Best value that the machine could reach, if known.
    pub limit: Option<Limit>,
}

/// Best value of a figure, in its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// The figure.
    pub value: f64,
    /// Resource that takes all of the time then.
    pub by: LimitedBy,
}

/// Resource that limits a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitedBy {
    /// Reads of its own memory.
    Bytes,
    /// Arithmetic.
    Operations,
    /// Copies from the CPU or to it.
    Copies,
}

impl fmt::Display for LimitedBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bytes => "bytes",
            Self::Operations => "operations",
            Self::Copies => "copies",
        })
    }
}

impl Limit {
    /// Limit by the bytes that a device reads of its memory.
    pub fn bytes(value: f64) -> Self {
        Self { value, by: LimitedBy::Bytes }
    }

    /// Limit by its arithmetic.
    pub fn operations(value: f64) -> Self {
        Self { value, by: LimitedBy::Operations }
    }

    /// Limit by what is copied from the CPU or to it.
    pub fn copies(value: f64) -> Self {
        Self { value, by: LimitedBy::Copies }
    }
}

impl Figure {
    /// One whose limit is not known.
    pub fn new(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, limit: None }
    }

    /// Sets the limit to the tightest of some.
    pub fn within(mut self, limits: &[Limit]) -> Self {
        self.limit = limits.iter().copied().max_by(|a, b| self.share(a).total_cmp(&self.share(b)));
        self
    }

    fn share(&self, limit: &Limit) -> f64 {
        let is_time = ["s", "ms"].contains(&self.unit);
        if is_time { limit.value / self.value } else { self.value / limit.value }
    }

    /// `value / limit`; of a time, `limit / value`.
    pub fn share_of_limit(&self) -> Option<f64> {
        self.limit.map(|limit| self.share(&limit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tightest_limit_counts() {
        let limits = [Limit::bytes(2.0), Limit::operations(4.0)];
        let time = Figure::new("time", 8.0, "ms").within(&limits);
        assert_eq!((time.limit, time.share_of_limit()), (Some(limits[1]), Some(0.5)));
        let rate = Figure::new("rate", 1.0, "GB/s").within(&limits);
        assert_eq!((rate.limit, rate.share_of_limit()), (Some(limits[0]), Some(0.5)));
        assert_eq!(Figure::new("size", 1.0, "B").within(&[]).share_of_limit(), None);
        let copies = Figure::new("rate", 1.0, "GB/s").within(&[Limit::copies(4.0)]);
        assert_eq!(copies.limit.map(|limit| limit.by.to_string()).as_deref(), Some("copies"));
    }
}
