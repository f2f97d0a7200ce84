use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::figure::Figure;

/// One measured figure. Peers are other programs measured in the same run, or the paper; limits are what the machine could do at
/// best.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FigureRecord {
    /// Name of the measurement.
    pub name: String,
    /// The figure.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// Name of the peer.
    pub peer: Option<String>,
    /// The peer's figure.
    pub peer_value: Option<f64>,
    /// `value / peer_value`.
    pub ratio: Option<f64>,
    /// The limit, in the same unit.
    pub limit: Option<f64>,
    /// Resource that takes all of the time at the limit: `bytes`, `operations` or `copies`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_by: Option<String>,
    /// `value / limit`; of a time, `limit / value`.
    pub share_of_limit: Option<f64>,
    /// Goal on an NVIDIA H200, in the same unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<f64>,
    /// Name of the GPU; none for the CPU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    /// Day of the measurement in universal time, `2026-11-22`.
    #[serde(default)]
    pub date: String,
}

impl From<Figure> for FigureRecord {
    fn from(figure: Figure) -> Self {
        Self {
            share_of_limit: figure.share_of_limit(),
            limit: figure.limit.map(|limit| limit.value),
            limit_by: figure.limit.map(|limit| limit.by.to_string()),
            name: figure.name,
            value: figure.value,
            unit: figure.unit.into(),
            ..Self::default()
        }
    }
}

/// The day in universal time, `2026-11-22`.
pub fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    date_of(seconds / 86_400)
}

/// The date so many days after 1970-01-01, by Hinnant's `civil_from_days` (howardhinnant.github.io/date_algorithms.html): years start
/// in March, so that leap days come last.
fn date_of(days: u64) -> String {
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) = (era * 400 + year + u64::from(month >= 10), (month + 2) % 12 + 1);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (days, date) in
            [(0, "1970-01-01"), (11_016, "2000-02-29"), (11_017, "2000-03-01"), (20_779, "2026-11-22")]
        {
            assert_eq!(date_of(days), date);
        }
    }
}
