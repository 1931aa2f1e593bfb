//! The esvo command line: build, inspect, validate, render and benchmark sparse voxel octrees.

mod args;
mod bench;
mod build;
mod convert;
mod diff;
mod dump;
mod fail;
mod info;
mod render;
mod validate;

use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};
use fail::{Failure, complain};

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Build(arguments) => build::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Dump(arguments) => dump::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Validate(arguments) => validate::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
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
