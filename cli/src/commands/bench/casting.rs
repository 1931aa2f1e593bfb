//! Options that `esvo bench rays` and `esvo bench needs` share.

use std::path::PathBuf;

use clap::Args;

use crate::commands::bench::record::RecordArguments;

#[derive(Debug, Args)]
pub(crate) struct CastingArguments {
    /// Threads of the CPU caster
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    pub(crate) scenes_dir: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) record: RecordArguments,
}

impl CastingArguments {
    /// Threads of the CPU caster; `None`: one per core.
    pub(crate) fn threads(&self) -> Option<usize> {
        self.threads.map(Into::into)
    }
}
