//! The measures of error by which settings are compared.

use serde::{Deserialize, Serialize};

use super::record::CellError;
use crate::text::short;

/// A measure of error: one number for a setting, the smaller the better.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorMeasure {
    /// Depth error in pixels: half of the rays that hit are at most so far off.
    Median,
    /// Depth error in pixels: 90 % of the rays that hit are at most so far off.
    P90,
    /// Depth error in pixels: 99 % of the rays that hit are at most so far off.
    P99,
    /// Largest depth error in pixels.
    Max,
    /// Mean FLIP of the picture.
    Flip,
}

impl ErrorMeasure {
    /// The two measures of the tables, plots and answers.
    pub const SHOWN: [Self; 2] = [Self::P90, Self::Flip];

    /// The value of a setting.
    pub fn of(self, error: &CellError) -> f64 {
        match self {
            Self::Median => error.pixels.median,
            Self::P90 => error.pixels.p90,
            Self::P99 => error.pixels.p99,
            Self::Max => error.pixels.max,
            Self::Flip => error.flip,
        }
    }

    /// Its name in tables and on axes.
    pub fn title(self) -> &'static str {
        match self {
            Self::Median => "depth error, median",
            Self::P90 => "depth error, 90th percentile",
            Self::P99 => "depth error, 99th percentile",
            Self::Max => "depth error, maximum",
            Self::Flip => "FLIP",
        }
    }

    /// A value with its unit: `0.47 px`, `0.123`.
    pub fn show(self, value: f64) -> String {
        match self {
            Self::Flip => format!("{value:.3}"),
            _ => format!("{} px", pixels(value)),
        }
    }

    /// Errors at which settings are compared.
    pub(crate) fn targets(self) -> &'static [f64] {
        match self {
            Self::Flip => &[0.01, 0.02, 0.05, 0.1, 0.2, 0.5],
            _ => &[0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0],
        }
    }
}

/// Pixels with about three digits, also small ones.
pub(crate) fn pixels(value: f64) -> String {
    if value > 0.0 && value < 0.1 { format!("{value:.4}") } else { short(value) }
}
