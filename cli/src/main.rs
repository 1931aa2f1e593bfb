//! The esvo command line: build, inspect, validate, render and benchmark sparse voxel octrees.

mod args;
mod commands;
mod fail;
mod files;
mod memory;
mod remote;
mod signals;
mod space;
mod stage;
mod values;
mod version;
mod view;
mod words;

use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use args::{Arguments, Command};
use fail::{Failure, complain};

/// Turns off Mesa's device-select layer if there is no window system: the layer would print errors of its own on standard
/// error. It stays on if MESA_VK_DEVICE_SELECT is set, as the user then chooses a device by it.
fn quiet_device_selection() {
    let is_set = |name| std::env::var_os(name).is_some();
    if !is_set("XDG_RUNTIME_DIR") && !is_set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: `main` has not started any thread yet, so no other thread reads the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// Starts the threads of parallel work, before anything else does. Work that starts them itself would panic if the system refuses
/// them.
fn start_threads() -> Result<(), Failure> {
    let started = rayon::ThreadPoolBuilder::new().build_global();
    started.map_err(|error| format!("the system starts no threads to work with: {error}; raise its limits").into())
}

fn main() -> ExitCode {
    quiet_device_selection();
    if let Err(error) = signals::end_tidily() {
        complain("warning", &format!("cannot handle interrupts, which may leave temporary files: {error}"));
    }
    let result = start_threads().and_then(|()| match Arguments::parse().command {
        Command::Build(arguments) => commands::build::run_build(&arguments),
        Command::Plan(arguments) => commands::plan::run_plan(&arguments),
        Command::Info(arguments) => commands::info::run_info(&arguments),
        Command::Kernel(arguments) => commands::kernel::run_kernel(&arguments),
        Command::Dump(arguments) => commands::dump::run_dump(&arguments),
        Command::Diff(arguments) => commands::diff::run_diff(&arguments),
        Command::Validate(arguments) => commands::validate::run_validate(&arguments),
        Command::Convert(arguments) => commands::convert::run_convert(&arguments),
        Command::Export(arguments) => commands::export::run_export(&arguments),
        Command::Join(arguments) => commands::join::run_join(&arguments),
        Command::Ambient(arguments) => commands::ambient::run_ambient(&arguments),
        Command::Render(arguments) => commands::render::run_render(&arguments),
        Command::View(arguments) => commands::view::run_view(&arguments),
        Command::Rays(arguments) => commands::rays::run_rays(&arguments),
        Command::Hits(arguments) => commands::hits::run_hits(&arguments),
        Command::Bench(arguments) => commands::bench::run_bench(&arguments),
        Command::Advise(arguments) => commands::advise::run_advise(&arguments),
        Command::Completions(arguments) => commands::completions::run_completions(&arguments, Arguments::command()),
        Command::Man(arguments) => commands::man::run_man(&arguments, Arguments::command()),
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // The reader of standard output has closed it, as `head` does.
        Err(Failure::Pipe) => ExitCode::SUCCESS,
        Err(Failure::Message(message)) => {
            complain("error", &message);
            ExitCode::FAILURE
        }
    }
}
