//! The statistic: how much slower a cell is, and how sure that is.
//!
//! On a machine that others use, times scatter by tens of percent, and not only because other programs take their turns: processor times
//! do, too, as caches and, on virtual machines, the other half of a core are shared. The calibration casts tell how fast the processor was
//! at the moment of a frame. A caster with vectors suffers more from its neighbours than the scalar kernel does, so that dividing one by
//! the other is not enough: how the logarithm of a frame's time grows with that of its calibration casts is fitted to the frames of both
//! records, and frames are compared at equal speed of the machine. README.md has the figures of this and of other statistics.

use serde::Serialize;

use crate::compare::measured::MeasuredCell;

/// Percent by which times have to differ if processor times do not: work that waits shows in these alone, and so do other programs.
const WAIT_THRESHOLD: f64 = 30.0;
/// How the logarithm of a time may grow with that of the calibration: 1 is proportional.
const SLOPES: [f64; 2] = [1.0, 3.0];
/// Two frames whose calibrations differ by less, in logarithms, say nothing about the slope.
const LEAST_STEP: f64 = 0.03;
/// Pairs of frames that a slope is fitted to, at least; else it is 1.
const LEAST_PAIRS: usize = 50;
/// Resamples of the rounds for an interval.
const RESAMPLES: usize = 200;
/// Part of the resamples that is outside of the interval, on either side.
const TAIL: f64 = 0.025;

/// What is said of a cell.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No difference above the threshold that the spread allows to tell.
    Same,
    /// Slower in the second record.
    Slower,
    /// Faster in the second record.
    Faster,
    /// Only in the first record.
    OnlyBefore,
    /// Only in the second record.
    OnlyAfter,
    /// Something else was measured: `reason` says what differs.
    Incomparable,
}

impl Verdict {
    /// In tables.
    pub fn title(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Slower => "SLOWER",
            Self::Faster => "faster",
            Self::OnlyBefore => "only before",
            Self::OnlyAfter => "only after",
            Self::Incomparable => "incomparable",
        }
    }
}

/// What was compared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Processor times, at equal speed of the machine by the calibration casts.
    ProcessorTime,
    /// Times, at equal speed of the machine by the calibration casts: the system tells no processor times.
    CalibratedTime,
    /// Times as they are.
    Time,
}

/// How the times of two cells compare.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct Ratio {
    /// What was compared.
    pub basis: Basis,
    /// After over before.
    pub ratio: f64,
    /// Lower end of the interval that holds 95 % of what resampled rounds give.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// Milliseconds before: the least time of each view over the rounds, mean over the views.
    pub before_ms: f64,
    /// Milliseconds after.
    pub after_ms: f64,
    /// How much longer the calibration casts next to the cell took, median over median; `None` without them.
    pub machine: Option<f64>,
    /// After over before of the times, with `basis` [`ProcessorTime`](Basis::ProcessorTime).
    pub time_ratio: Option<f64>,
    /// Lower end of its interval.
    pub time_low: Option<f64>,
}

impl Ratio {
    /// What this says at a threshold in percent: the ratio is beyond it, and the whole interval beyond half of it.
    pub fn verdict(&self, threshold: f64) -> Verdict {
        let factor = 1.0 + threshold / 100.0;
        let half = 1.0 + threshold / 200.0;
        let waits = 1.0 + threshold.max(WAIT_THRESHOLD) / 100.0;
        if self.ratio > factor && self.low > half || self.time_low.is_some_and(|low| low > waits) {
            Verdict::Slower
        } else if self.ratio < 1.0 / factor && self.high < 1.0 / half {
            Verdict::Faster
        } else {
            Verdict::Same
        }
    }
}

/// Compares two cells; `None` if one has no times.
pub fn ratio(before: &MeasuredCell, after: &MeasuredCell, calibrated: bool) -> Option<Ratio> {
    let least = |cell: &MeasuredCell| {
        let least = least_sum(&cell.seconds, None)?;
        Some(1e3 * least / cell.seconds[0].len() as f64)
    };
    let (before_ms, after_ms) = (least(before)?, least(after)?);
    let cells = [before, after];
    let times = calibrated.then(|| both(cells.map(frames_by_time))).flatten();
    let cpu = calibrated.then(|| both(cells.map(frames_by_cpu_time))).flatten();
    let machine = calibrated.then(|| Some(machine(after)? / machine(before)?)).flatten();
    let of = |basis, [ratio, low, high]: [f64; 3]| Ratio {
        basis,
        ratio,
        low,
        high,
        before_ms,
        after_ms,
        machine,
        time_ratio: None,
        time_low: None,
    };
    Some(match (cpu, times) {
        (Some(cpu), Some(times)) => {
            let [time_ratio, time_low, _] = at_equal_speed(&times);
            let found = of(Basis::ProcessorTime, at_equal_speed(&cpu));
            Ratio { time_ratio: Some(time_ratio), time_low: Some(time_low), ..found }
        }
        (_, Some(times)) => of(Basis::CalibratedTime, at_equal_speed(&times)),
        _ => {
            let one =
                |[a, b]: [Option<&[usize]>; 2]| Some(least_sum(&after.seconds, b)? / least_sum(&before.seconds, a)?);
            let ratio = one([None, None])?;
            let rounds = [before.seconds.len(), after.seconds.len()];
            let [low, high] = interval(rounds, |[a, b]| one([Some(a), Some(b)]).unwrap_or(ratio));
            of(Basis::Time, [ratio, low, high])
        }
    })
}

/// Logarithms of the calibration next to a frame and of the frame: `frames[round][view]`.
type Frames = Vec<Vec<[f64; 2]>>;

fn both<T>([a, b]: [Option<T>; 2]) -> Option<[T; 2]> {
    Some([a?, b?])
}

fn frames_by_time(cell: &MeasuredCell) -> Option<Frames> {
    frames(&cell.seconds, &cell.guard.calibration_seconds)
}

fn frames_by_cpu_time(cell: &MeasuredCell) -> Option<Frames> {
    frames(&cell.guard.cpu_seconds, &cell.guard.calibration_cpu_seconds)
}

/// `None` if there are no frames or no calibrations, if rounds differ in their views, or if something is no positive number.
fn frames(seconds: &[Vec<f64>], calibration: &[Vec<f64>]) -> Option<Frames> {
    let views = seconds.first()?.len();
    if views == 0 || seconds.len() != calibration.len() {
        return None;
    }
    let round = |(seconds, calibration): (&Vec<f64>, &Vec<f64>)| {
        if seconds.len() != views || calibration.is_empty() {
            return None;
        }
        let frame = |(view, seconds): (usize, &f64)| {
            // The casts before and after the frame, or before and after the round.
            let around = if calibration.len() == views + 1 { &calibration[view..view + 2] } else { &calibration[..] };
            let speed = around.iter().sum::<f64>() / around.len() as f64;
            let frame = [speed.ln(), seconds.ln()];
            frame.iter().all(|x| x.is_finite()).then_some(frame)
        };
        seconds.iter().enumerate().map(frame).collect()
    };
    seconds.iter().zip(calibration).map(round).collect()
}

/// Median of the calibration casts of a cell.
fn machine(cell: &MeasuredCell) -> Option<f64> {
    let mut times: Vec<f64> = cell.guard.calibration_seconds.iter().flatten().copied().collect();
    (!times.is_empty()).then(|| median(&mut times))
}

/// The ratio at equal speed of the machine, and its interval.
fn at_equal_speed(frames: &[Frames; 2]) -> [f64; 3] {
    let one = |rounds: [&[usize]; 2]| {
        let slope = slope(frames, rounds);
        let views = frames[0][0].len();
        let level = |which: usize, view: usize| {
            let mut rest: Vec<f64> = (rounds[which].iter())
                .map(|&round| {
                    let [speed, time] = frames[which][round][view];
                    time - slope * speed
                })
                .collect();
            median(&mut rest)
        };
        let differences = (0..views).map(|view| level(1, view) - level(0, view)).sum::<f64>();
        (differences / views as f64).exp()
    };
    let lengths = [frames[0].len(), frames[1].len()];
    let all = lengths.map(|length| (0..length).collect::<Vec<_>>());
    let [low, high] = interval(lengths, one);
    [one([&all[0], &all[1]]), low, high]
}

/// How the logarithm of a time grows with that of the calibration: median of the slopes of all pairs of frames of the same view and
/// record, weighted by the distance of their calibrations, within [`SLOPES`].
fn slope(frames: &[Frames; 2], rounds: [&[usize]; 2]) -> f64 {
    let mut slopes: Vec<[f64; 2]> = Vec::new();
    for (frames, rounds) in frames.iter().zip(rounds) {
        for view in 0..frames[0].len() {
            for (index, &a) in rounds.iter().enumerate() {
                for &b in &rounds[index + 1..] {
                    let ([x, y], [x2, y2]) = (frames[a][view], frames[b][view]);
                    let step = (x2 - x).abs();
                    if step > LEAST_STEP {
                        slopes.push([(y2 - y) / (x2 - x), step]);
                    }
                }
            }
        }
    }
    if slopes.len() < LEAST_PAIRS {
        return 1.0;
    }
    slopes.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut left = slopes.iter().map(|[_, weight]| weight).sum::<f64>() / 2.0;
    let middle = slopes.iter().find(|[_, weight]| {
        left -= weight;
        left <= 0.0
    });
    middle.map_or(1.0, |[slope, _]| slope.clamp(SLOPES[0], SLOPES[1]))
}

/// Sum over the views of their least times in these rounds; `None`: in all. `None` if there are none.
fn least_sum(seconds: &[Vec<f64>], rounds: Option<&[usize]>) -> Option<f64> {
    let views = seconds.first()?.len();
    let least = |view: usize| {
        let of = |round: &Vec<f64>| round.get(view).copied().unwrap_or(f64::INFINITY);
        match rounds {
            None => seconds.iter().map(of).fold(f64::INFINITY, f64::min),
            Some(rounds) => rounds.iter().map(|&round| of(&seconds[round])).fold(f64::INFINITY, f64::min),
        }
    };
    let sum: f64 = (0..views).map(least).sum();
    (views > 0 && sum.is_finite() && sum > 0.0).then_some(sum)
}

/// Interval of a statistic when the rounds of both records are drawn anew from themselves, always in the same way.
fn interval(rounds: [usize; 2], statistic: impl Fn([&[usize]; 2]) -> f64) -> [f64; 2] {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = move || {
        // The generator "xorshift64" of G. Marsaglia.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut found: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn = rounds.map(|count| (0..count).map(|_| (next() % count as u64) as usize).collect::<Vec<_>>());
            statistic([&drawn[0], &drawn[1]])
        })
        .collect();
    found.sort_by(f64::total_cmp);
    let tail = (RESAMPLES as f64 * TAIL) as usize;
    [found[tail], found[RESAMPLES - 1 - tail]]
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        length if length % 2 == 1 => values[middle],
        _ => (values[middle - 1] + values[middle]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::GuardSamples;

    /// A cell of two views and thirty rounds whose caster takes `work` milliseconds of processor time at full speed. The machine is slower
    /// by `slow` in a part `share` of the rounds, and then the caster is slower by the square of it. Other programs make times up to
    /// twice as long.
    fn cell(work: f64, slow: f64, share: f64, seed: u64) -> MeasuredCell {
        let mut state = seed;
        let mut random = move || {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut cell = MeasuredCell {
            name: [const { String::new() }; 3],
            same: Vec::new(),
            seconds: Vec::new(),
            guard: GuardSamples::default(),
        };
        for _ in 0..30 {
            let speed = if random() < share { slow } else { 1.0 };
            let mut jitter = || 1.0 + 0.01 * random();
            let cpu = [work, 1.5 * work].map(|ms| ms / 1e3 * speed * speed * jitter());
            let calibration = [(); 3].map(|()| 0.02 * speed * jitter());
            let wait = 1.0 + random();
            cell.seconds.push(cpu.map(|s| s / 2.0 * wait).to_vec());
            cell.guard.cpu_seconds.push(cpu.to_vec());
            cell.guard.calibration_seconds.push(calibration.map(|s| s / 2.0 * wait).to_vec());
            cell.guard.calibration_cpu_seconds.push(calibration.to_vec());
        }
        cell
    }

    #[test]
    fn cells_are_compared_at_equal_speed() {
        for (share, other) in [(0.0, 0.0), (0.1, 0.9), (0.9, 0.2), (0.5, 0.5)] {
            let before = cell(10.0, 1.2, share, 1);
            for (work, expected) in [(10.0, Verdict::Same), (11.0, Verdict::Slower), (9.0, Verdict::Faster)] {
                let found = ratio(&before, &cell(work, 1.2, other, 2), true).unwrap();
                assert_eq!(found.verdict(5.0), expected, "{share} {other} {work}: {found:?}");
                assert_eq!(found.basis, Basis::ProcessorTime);
                assert!((found.ratio / (work / 10.0) - 1.0).abs() < 0.03, "{found:?}");
                assert!(found.low <= found.ratio && found.ratio <= found.high);
            }
        }
        // The negative control: without calibration, a machine that is always slower looks like a slower caster.
        let (before, after) = (cell(10.0, 1.2, 0.0, 1), cell(10.0, 1.2, 1.0, 2));
        let raw = ratio(&before, &after, false).unwrap();
        assert_eq!((raw.basis, raw.verdict(5.0), raw.machine), (Basis::Time, Verdict::Slower, None));
    }

    #[test]
    fn a_caster_that_waits_is_slower_though_it_does_not_work_more() {
        let (before, mut after) = (cell(10.0, 1.2, 0.3, 1), cell(10.0, 1.2, 0.3, 2));
        after.seconds.iter_mut().flatten().for_each(|seconds| *seconds *= 2.0);
        let found = ratio(&before, &after, true).unwrap();
        assert_eq!(found.verdict(5.0), Verdict::Slower);
        assert!((found.ratio - 1.0).abs() < 0.05 && found.time_ratio.unwrap() > 1.5, "{found:?}");
    }

    #[test]
    fn without_processor_times_calibrated_times_are_compared() {
        let strip = |mut cell: MeasuredCell| {
            cell.guard.cpu_seconds.clear();
            cell.guard.calibration_cpu_seconds.clear();
            cell
        };
        let before = strip(cell(10.0, 1.0, 0.0, 1));
        let found = |work| ratio(&before, &strip(cell(work, 1.0, 0.0, 2)), true).unwrap();
        assert_eq!((found(10.0).basis, found(10.0).verdict(5.0)), (Basis::CalibratedTime, Verdict::Same));
        assert_eq!(found(11.0).verdict(5.0), Verdict::Slower);
    }

    #[test]
    fn what_cannot_be_compared_is_none() {
        let good = cell(10.0, 1.0, 0.0, 1);
        let mut empty = good.clone();
        empty.seconds.clear();
        assert_eq!(ratio(&good, &empty, true), None);
        assert_eq!(ratio(&empty, &good, false), None);
        // Guards that do not fit are not used.
        let mut odd = good.clone();
        odd.guard.cpu_seconds.pop();
        odd.guard.calibration_seconds[3].clear();
        assert_eq!(ratio(&good, &odd, true).unwrap().basis, Basis::Time);
    }
}
