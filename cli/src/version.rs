//! What `esvo --version` prints.

use std::sync::LazyLock;

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
    let mut names = vec!["reference", "cpu"];
    if cfg!(feature = "wgpu") {
        names.push("wgpu");
    }
    if cfg!(feature = "ash") {
        names.push("ash");
    }
    names
}
