//! The esvo command line: build, inspect, validate, render and benchmark sparse voxel octrees.

mod args;
mod commands;
mod fail;
mod words;

use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};
use fail::{Failure, complain};

/// Keeps Mesa's device-select layer from asking a window system that is not there: it complains on standard error, in
/// words that read as if they were ours. Whoever uses the layer to choose a device keeps it.
fn quiet_device_selection() {
    let is_set = |name| std::env::var_os(name).is_some();
    if !is_set("XDG_RUNTIME_DIR") && !is_set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: nothing but `main` runs yet, so no other thread reads the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

fn main() -> ExitCode {
    quiet_device_selection();
    // Interrupted while writing: leave nothing half-written behind.
    let interrupted = ctrlc::set_handler(|| {
        esvo_format::remove_temporaries();
        esvo_bench::interrupted();
        std::process::exit(130);
    });
    if let Err(error) = interrupted {
        complain("warning", &format!("an interrupt will leave temporary files behind: {error}"));
    }
    let result = match Arguments::parse().command {
        Command::Build(arguments) => commands::build::run(&arguments),
        Command::Info(arguments) => commands::info::run(&arguments),
        Command::Dump(arguments) => commands::dump::run(&arguments),
        Command::Diff(arguments) => commands::diff::run(&arguments),
        Command::Validate(arguments) => commands::validate::run(&arguments),
        Command::Convert(arguments) => commands::convert::run(&arguments),
        Command::Ambient(arguments) => commands::ambient::run(&arguments),
        Command::Render(arguments) => commands::render::run(&arguments),
        Command::Bench(arguments) => commands::bench::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever read our output has seen enough.
        Err(Failure::Pipe) => ExitCode::SUCCESS,
        Err(Failure::Message(message)) => {
            complain("error", &message);
            ExitCode::FAILURE
        }
    }
}
