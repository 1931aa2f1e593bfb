//! What `esvo --version` prints.

use std::sync::LazyLock;

use esvo_engines::EngineId;

/// Version, commit and engines.
pub(crate) fn long_version() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let (version, commit) = (env!("CARGO_PKG_VERSION"), env!("ESVO_COMMIT"));
        format!("{version}\ncommit:  {commit}\nengines: {}", engines().join(", "))
    });
    &TEXT
}

/// Names of the engines that this program was built with.
fn engines() -> Vec<&'static str> {
    EngineId::ALL.iter().filter(|id| id.engine().is_built_in()).map(|id| id.name()).collect()
}
