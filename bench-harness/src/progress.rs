//! Progress on the terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// One line on standard error that says what the program is doing. Shows nothing unless standard error is a terminal.
#[derive(Clone, Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// Progress on standard error, if that is a terminal.
    pub fn terminal() -> Self {
        let bar = ProgressBar::new(100).with_style(style("{spinner} [{elapsed}] {msg}"));
        // The thread that turns the spinner is needed on a terminal only, and indicatif panics if the system refuses it.
        if !bar.is_hidden() && std::thread::Builder::new().spawn(|| ()).is_ok() {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self { bar }
    }

    /// Progress that is not shown.
    pub fn hidden() -> Self {
        Self { bar: ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()) }
    }

    /// Shows from now on how many parts of a run are done, and how much time is left if the others take as long as these did.
    pub fn parts(&self, done: usize, all: usize, seconds: f64) {
        self.bar.set_prefix(match time_left(done, all, seconds) {
            Some(left) => format!("{done} of {all} done, about {left} left · "),
            None => format!("{done} of {all} done · "),
        });
    }

    /// Shows what is done now.
    pub fn say(&self, what: impl Into<String>) {
        self.bar.set_style(style("{spinner} [{elapsed}] {prefix}{msg}"));
        self.bar.set_message(what.into());
    }

    /// Shows how much of a task is done, 0 to 1. The note is added after the name of the task.
    pub fn fraction(&self, what: &str, done: f64, note: &str) {
        if self.bar.length() != Some(100) || self.bar.position() == 0 {
            self.bar.set_length(100);
            self.bar.set_style(style("{spinner} [{elapsed}] {prefix}{msg} {bar:24} {percent}%"));
        }
        self.bar.set_position((done.clamp(0.0, 1.0) * 100.0) as u64);
        self.bar.set_message(if note.is_empty() { what.to_string() } else { format!("{what}, {note}") });
    }

    /// Removes the line.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// The time that the parts that are not done take, at the pace of those that are; `None` if none is done or left.
fn time_left(done: usize, all: usize, seconds: f64) -> Option<String> {
    if done == 0 || done >= all {
        return None;
    }
    let left = seconds / done as f64 * (all - done) as f64;
    Some(if left < 90.0 { format!("{left:.0} s") } else { format!("{:.0} min", left / 60.0) })
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_the_pace() {
        assert_eq!(time_left(0, 4, 10.0), None);
        assert_eq!(time_left(4, 4, 10.0), None);
        assert_eq!(time_left(2, 4, 30.0).as_deref(), Some("30 s"));
        assert_eq!(time_left(1, 4, 100.0).as_deref(), Some("5 min"));
    }
}
