//! Timing samples and their statistics.

use std::time::{Duration, Instant};

use esvo_core::DeviceKind;
use serde::{Deserialize, Serialize};

use crate::calibration::GuardSamples;
use crate::text::short;

/// How long a GPU casts before something is timed.
const AWAKE: Duration = Duration::from_millis(20);

/// Lets a GPU cast before something is timed: while it waits for the processor's calibration casts, it lowers its clock, an H100 to a fourth.
/// Does nothing on devices of other kinds.
///
/// # Errors
/// The cast's.
pub(crate) fn wake<E>(kind: DeviceKind, mut cast: impl FnMut() -> Result<(), E>) -> Result<(), E> {
    let start = Instant::now();
    while kind == DeviceKind::Gpu && start.elapsed() < AWAKE {
        cast()?;
    }
    Ok(())
}

/// Raw times of one cell: `seconds[round][view]`.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Samples {
    /// Both passes of every frame, in seconds.
    pub seconds: Vec<Vec<f64>>,
    /// The coarse pass of every frame, in seconds; empty without beam optimization.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coarse_seconds: Vec<Vec<f64>>,
    /// Calibration casts and processor times; empty in records that have none.
    #[serde(default, skip_serializing_if = "GuardSamples::is_empty")]
    pub guard: GuardSamples,
}

impl Samples {
    /// Millions of rays per second in every round, over all its views, at `pixels` rays per frame.
    pub fn mrays(&self, pixels: u64) -> Vec<f64> {
        let rate = |frames: &Vec<f64>| pixels as f64 * frames.len() as f64 / frames.iter().sum::<f64>() / 1e6;
        self.seconds.iter().filter(|frames| !frames.is_empty()).map(rate).collect()
    }
}

/// Median and quartiles.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Spread {
    /// The middle value.
    pub median: f64,
    /// A quarter of the values are below this.
    pub lower_quartile: f64,
    /// A quarter of the values are above this.
    pub upper_quartile: f64,
}

impl Spread {
    /// Median and quartiles of these values. `None` if there are no values or one is NaN.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.is_empty() || values.iter().any(|v| v.is_nan()) {
            return None;
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Some(Self {
            median: quantile(&sorted, 0.5),
            lower_quartile: quantile(&sorted, 0.25),
            upper_quartile: quantile(&sorted, 0.75),
        })
    }

    /// Half the distance between the quartiles, in percent of the median.
    pub fn percent(&self) -> f64 {
        50.0 * (self.upper_quartile - self.lower_quartile) / self.median
    }

    /// `11.7 ±3%`, the median and [`percent`](Self::percent); the median alone of one value, which has no spread.
    pub fn to_text(&self) -> String {
        let median = short(self.median);
        if self.lower_quartile == self.upper_quartile { median } else { format!("{median} ±{:.0}%", self.percent()) }
    }
}

/// Quantile `q` (0 to 1) of ascending values, interpolated linearly.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

/// The least of values; infinity of none.
pub(crate) fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_gpus_are_woken() {
        for kind in DeviceKind::ALL {
            let (start, mut casts) = (Instant::now(), 0);
            let woken: Result<(), ()> = wake(kind, || {
                casts += 1;
                std::thread::sleep(Duration::from_millis(1));
                Ok(())
            });
            assert!(woken.is_ok());
            assert_eq!(casts > 0, kind == DeviceKind::Gpu);
            assert!(casts == 0 || start.elapsed() >= AWAKE);
        }
        assert_eq!(wake(DeviceKind::Gpu, || Err("lost")), Err("lost"));
    }

    #[test]
    fn quartiles() {
        let spread = Spread::of(&[4.0, 1.0, 3.0, 2.0, 5.0]).unwrap();
        assert_eq!((spread.lower_quartile, spread.median, spread.upper_quartile), (2.0, 3.0, 4.0));
        assert_eq!(spread.to_text(), "3.00 ±33%");
        assert_eq!(Spread::of(&[3.0]).unwrap().to_text(), "3.00");
        assert_eq!(Spread::of(&[1.0, 2.0]).unwrap().median, 1.5);
        assert_eq!(Spread::of(&[]), None);
        assert_eq!(Spread::of(&[f64::NAN]), None);
    }

    #[test]
    fn rays_per_second_are_those_of_all_views_of_a_round() {
        let samples = Samples { seconds: vec![vec![0.1, 0.3], vec![0.2, 0.2], vec![]], ..Samples::default() };
        let rates = samples.mrays(1_000_000);
        assert_eq!(rates.len(), 2);
        assert!(rates.iter().all(|r| (r - 5.0).abs() < 1e-12));
    }
}
