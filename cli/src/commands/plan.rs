//! `esvo plan`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_builder::{BuildPlan, BuildSettings, PlannedPart};
use serde::Serialize;

use crate::commands::build::Format;
use crate::commands::build::input::{Input, read_input};
use crate::fail::{Failure, complain, print};
use crate::words::count;

/// Say how a build is shared out to parts, and what each part is expected to cost.
#[derive(Debug, Args)]
#[command(after_help = "\
The cubes of level 4 with surface are dealt out in their order, so that parts cost about the same. What
a cube costs is estimated by the voxels that the deepest level would hold in it if all geometry were
divided; contours, colours and normals that fit earlier make a build cheaper than that. Which cubes a
part has follows from the mesh, the levels and the number of parts alone: no plan needs to be passed on.

Examples:
  esvo plan city.obj --levels 15 --parts 7
  for k in 1 2 3 4 5 6 7; do esvo build city.obj --levels 15 --part $k/7 -o $k.esvopart; done
  esvo join *.esvopart -o city.esvo")]
pub(crate) struct PlanArguments {
    /// The mesh; - reads it from standard input and needs --format
    pub(crate) mesh: PathBuf,
    /// The format of the mesh [default: by the extension]
    #[arg(long, value_name = "NAME")]
    pub(crate) format: Option<Format>,
    /// Deepest level, 1 to 23
    #[arg(short, long, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// Number of parts, 1 to 4096
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) parts: u32,
    /// Print the plan as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct PlanSummary<'a> {
    source: &'a str,
    levels: u32,
    parts: &'a [PlannedPart],
}

pub(crate) fn run_plan(arguments: &PlanArguments) -> Result<(), Failure> {
    let progress = Progress::terminal();
    let (input, source) = read_input(&arguments.mesh, arguments.format.map(Into::into), None, false, &progress)?;
    let Input::Mesh(mesh) = &input else {
        return Err(format!("{source}: voxel models are not built in parts; give a mesh").into());
    };
    let settings = BuildSettings { levels: arguments.levels, ..BuildSettings::default() };
    let plan = BuildPlan::new(mesh, &settings, arguments.parts).map_err(|e| format!("{source}: {e}"))?;
    progress.finish();
    input.warnings().iter().for_each(|warning| complain("warning", warning));
    let parts = plan.parts();
    if arguments.json {
        let summary = PlanSummary { source: &source, levels: arguments.levels, parts };
        return print(&format!("{}\n", serde_json::to_string_pretty(&summary)?));
    }
    let total: f64 = parts.iter().map(|part| part.voxels).sum();
    let cubes: u32 = parts.iter().map(|part| part.cubes).sum();
    let (levels, cubes) = (count(arguments.levels, "level"), count(cubes, "cube"));
    let mut text =
        format!("{source}: {levels}, {cubes} with surface, at most {total:.2e} voxels on the deepest level\n");
    text += "  part  cubes      pieces    voxels  share\n";
    for part in parts {
        let share = if total > 0.0 { 100.0 * part.voxels / total } else { 0.0 };
        text +=
            &format!("{:>6} {:>6} {:>11} {:>9.2e} {share:>5.1}%\n", part.part, part.cubes, part.pieces, part.voxels);
    }
    print(&text)
}
