//! The command line: the list of commands. The options of each command are next to its code, in [`crate::commands`].

use clap::{Parser, Subcommand};

use crate::commands::advise::AdviseArguments;
use crate::commands::ambient::AmbientArguments;
use crate::commands::bench::BenchArguments;
use crate::commands::build::BuildArguments;
use crate::commands::completions::CompletionsArguments;
use crate::commands::convert::ConvertArguments;
use crate::commands::diff::DiffArguments;
use crate::commands::dump::DumpArguments;
use crate::commands::export::ExportArguments;
use crate::commands::hits::HitsArguments;
use crate::commands::info::InfoArguments;
use crate::commands::join::JoinArguments;
use crate::commands::kernel::KernelArguments;
use crate::commands::man::ManArguments;
use crate::commands::plan::PlanArguments;
use crate::commands::rays::RaysArguments;
use crate::commands::render::RenderArguments;
use crate::commands::validate::ValidateArguments;
use crate::commands::view::ViewArguments;
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
  esvo build sibenik.obj -o sibenik.esvo --levels 11  build an octree from a mesh
  esvo render sibenik.esvo -o sibenik.png             render a picture of it
  esvo bench                                          measure the paper's two tables, in about five minutes
  esvo help render                                    all options of a command"
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Build(BuildArguments),
    Plan(PlanArguments),
    Info(InfoArguments),
    Dump(DumpArguments),
    Diff(DiffArguments),
    Validate(ValidateArguments),
    Convert(ConvertArguments),
    Export(ExportArguments),
    Join(JoinArguments),
    Ambient(AmbientArguments),
    Render(RenderArguments),
    View(ViewArguments),
    Rays(RaysArguments),
    Hits(HitsArguments),
    Kernel(KernelArguments),
    Bench(Box<BenchArguments>),
    Advise(Box<AdviseArguments>),
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
