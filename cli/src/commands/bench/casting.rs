//! Options that `esvo bench rays` and `esvo bench needs` share.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::output::check_writable;

use crate::commands::bench::record::RecordArguments;
use crate::commands::bench::selection::check_scenes_dir;
use crate::fail::Failure;

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
    /// Rejects folders that cannot be used.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        check_scenes_dir(self.scenes_dir.as_deref())?;
        Ok(check_writable(&self.record.out)?)
    }

    /// Threads of the CPU caster; `None`: one per core.
    pub(crate) fn threads(&self) -> Option<usize> {
        self.threads.map(Into::into)
    }
}
