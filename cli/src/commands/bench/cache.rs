//! Where octrees and exact answers of former runs are kept.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::sweep_bench::Cache;

#[derive(Debug, Args)]
pub(crate) struct CacheArguments {
    /// Folder for octrees and exact answers, which are kept by content hash; it can be deleted at any time [default: esvo in the
    /// user's folder of caches]
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// Build and cast everything anew, and keep nothing
    #[arg(long, conflicts_with = "cache")]
    no_cache: bool,
}

impl CacheArguments {
    pub(crate) fn open(&self) -> Cache {
        match &self.cache {
            _ if self.no_cache => Cache::none(),
            Some(folder) => Cache::in_folder(folder),
            None => Cache::in_folder(&Cache::default_folder()),
        }
    }
}
