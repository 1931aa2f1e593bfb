//! The esvo command line: build, inspect, validate, render and benchmark sparse voxel octrees.

mod args;
mod commands;
mod fail;
mod files;
mod values;
mod version;
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
        Command::Build(arguments) => commands::build::run_build(&arguments),
        Command::Info(arguments) => commands::info::run_info(&arguments),
        Command::Dump(arguments) => commands::dump::run_dump(&arguments),
        Command::Diff(arguments) => commands::diff::run_diff(&arguments),
        Command::Validate(arguments) => commands::validate::run_validate(&arguments),
        Command::Convert(arguments) => commands::convert::run_convert(&arguments),
        Command::Ambient(arguments) => commands::ambient::run_ambient(&arguments),
        Command::Render(arguments) => commands::render::run_render(&arguments),
        Command::Bench(arguments) => commands::bench::run_bench(&arguments),
        Command::Completions(arguments) => commands::completions::run_completions(&arguments),
        Command::Man(arguments) => commands::man::run_man(&arguments),
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
