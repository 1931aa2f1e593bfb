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

    /// Shows what is done now.
    pub fn say(&self, what: impl Into<String>) {
        self.bar.set_style(style("{spinner} [{elapsed}] {msg}"));
        self.bar.set_message(what.into());
    }

    /// Shows how much of a task is done, 0 to 1. The note is added after the name of the task.
    pub fn fraction(&self, what: &str, done: f64, note: &str) {
        if self.bar.length() != Some(100) || self.bar.position() == 0 {
            self.bar.set_length(100);
            self.bar.set_style(style("{spinner} [{elapsed}] {msg} {bar:24} {percent}%"));
        }
        self.bar.set_position((done.clamp(0.0, 1.0) * 100.0) as u64);
        self.bar.set_message(if note.is_empty() { what.to_string() } else { format!("{what}, {note}") });
    }

    /// Removes the line.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}
