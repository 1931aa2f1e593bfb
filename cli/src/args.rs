//! What can be typed: the list of commands. Each command has its options next to what it does, in [`crate::commands`].

use clap::{Parser, Subcommand};

use crate::commands::ambient::AmbientArguments;
use crate::commands::bench::BenchArguments;
use crate::commands::build::BuildArguments;
use crate::commands::completions::CompletionsArguments;
use crate::commands::convert::ConvertArguments;
use crate::commands::diff::DiffArguments;
use crate::commands::dump::DumpArguments;
use crate::commands::info::InfoArguments;
use crate::commands::man::ManArguments;
use crate::commands::render::RenderArguments;
use crate::commands::validate::ValidateArguments;
use crate::version::long_version;

/// Sparse voxel octrees: build, inspect, render and benchmark.
#[derive(Debug, Parser)]
#[command(
    name = "esvo",
    version,
    long_version = long_version(),
    propagate_version = true,
    after_help = "\
Examples:
  esvo bench                                          the paper's two tables on this machine, within three minutes
  esvo build sibenik.obj -o sibenik.esvo --levels 11  a mesh to an octree
  esvo render sibenik.esvo -o sibenik.png             a picture of it
  esvo help render                                    everything about one command"
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Build(BuildArguments),
    Info(InfoArguments),
    Dump(DumpArguments),
    Diff(DiffArguments),
    Validate(ValidateArguments),
    Convert(ConvertArguments),
    Ambient(AmbientArguments),
    Render(RenderArguments),
    Bench(Box<BenchArguments>),
    Completions(CompletionsArguments),
    Man(ManArguments),
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }
}
