//! The viewer of `.esvo` files for browsers: the files of its page, and a server on this machine that shows it.
//!
//! | what | where |
//! |---|---|
//! | the files of the page, for any server | [`page`] |
//! | the same in a folder | [`export`] |
//! | page and octree on loopback, with ranges | [`Server`] |
//!
//! The page is plain JavaScript modules in this crate's folders `viewer` and `reader`; `README.md` describes them. Its kernels are those of
//! `esvo_core`, which the GPU engines compile too.

mod server;

use std::path::{Path, PathBuf};

use esvo_core::filter::kernel::FILTER_WGSL;
use esvo_core::gpu::kernel::{CAST_WGSL, INSTANCES_WGSL};
use percent_encoding::{AsciiSet, CONTROLS, utf8_percent_encode};

pub use server::Server;

/// A file of the page.
#[derive(Clone, Copy, Debug)]
pub struct PageFile {
    /// Path below the page's folder, with slashes.
    pub path: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub bytes: &'static [u8],
}

/// The media type of a file by the end of its name.
const fn media_type(path: &str) -> &'static str {
    let path = path.as_bytes();
    match path[path.len() - 1] {
        b'l' if path[path.len() - 2] == b'm' => "text/html; charset=utf-8",
        b's' if path[path.len() - 2] == b'j' => "text/javascript; charset=utf-8",
        b's' => "text/css; charset=utf-8",
        b'n' => "application/json",
        _ => "text/plain; charset=utf-8",
    }
}

macro_rules! files {
    ($($path:literal),* $(,)?) => {
        [$(PageFile { path: $path, media_type: media_type($path), bytes: include_bytes!(concat!("../", $path)) }),*]
    };
}

static FILES: [PageFile; 45] = files![
    "index.html",
    "viewer/app.js",
    "viewer/camera.js",
    "viewer/controls.js",
    "viewer/filter.json",
    "viewer/gpu.js",
    "viewer/kernel.js",
    "viewer/link.js",
    "viewer/pages.js",
    "viewer/present.wgsl",
    "viewer/priority.js",
    "viewer/shade.wgsl",
    "viewer/streamer.js",
    "viewer/style.css",
    "viewer/vectors.js",
    "viewer/viewer.js",
    "viewer/worker.js",
    "reader/src/block.js",
    "reader/src/bytes.js",
    "reader/src/check.js",
    "reader/src/components.js",
    "reader/src/crc32.js",
    "reader/src/decode.js",
    "reader/src/errors.js",
    "reader/src/fields.js",
    "reader/src/header.js",
    "reader/src/index-pages.js",
    "reader/src/index.js",
    "reader/src/json.js",
    "reader/src/layout.js",
    "reader/src/octree.js",
    "reader/src/scene.js",
    "reader/src/served.js",
    "reader/src/source.js",
    "reader/src/subset.js",
    "reader/src/tables.js",
    "reader/src/values.js",
    "reader/src/voxels.js",
    "reader/src/walk-block.js",
    "reader/src/zstd.js",
    "reader/vendor/LICENSE-zstddec",
    "reader/vendor/zstddec.js",
    "reader/vendor/zstddec.d.ts",
    "LICENSE-MIT",
    "LICENSE-APACHE",
];

/// The files of the page. `index.html` is the first.
pub fn page() -> impl Iterator<Item = PageFile> {
    let kernel =
        |path, text: &'static str| PageFile { path, media_type: "text/plain; charset=utf-8", bytes: text.as_bytes() };
    FILES.into_iter().chain([
        kernel("kernels/cast.wgsl", CAST_WGSL),
        kernel("kernels/instances.wgsl", INSTANCES_WGSL),
        kernel("kernels/filter.wgsl", FILTER_WGSL),
    ])
}

/// What has another meaning in the query of an address.
const IN_QUERY: &AsciiSet =
    &CONTROLS.add(b' ').add(b'"').add(b'#').add(b'<').add(b'>').add(b'&').add(b'+').add(b'%').add(b'\'');
/// What has another meaning in a segment of its path.
const IN_PATH: &AsciiSet = &IN_QUERY.add(b'?').add(b'/').add(b'\\').add(b':');

/// An address as a value in a query.
fn in_query(address: &str) -> String {
    utf8_percent_encode(address, IN_QUERY).to_string()
}

/// A file's name as a segment of a path.
fn in_path(name: &str) -> String {
    utf8_percent_encode(name, IN_PATH).to_string()
}

/// Writes the page to a folder, which is made if it is not there, for any server. With `file`, the address of an octree as the page has to
/// write it, it opens that one unless its own address names another.
///
/// # Errors
/// The path that could not be written, and why.
pub fn export(folder: &Path, file: Option<&str>) -> Result<Vec<PathBuf>, String> {
    let mut written = Vec::new();
    for PageFile { path, bytes, .. } in page() {
        let to = folder.join(path);
        let told = |error: std::io::Error| format!("{}: {error}", to.display());
        if let Some(parent) = to.parent() {
            std::fs::create_dir_all(parent).map_err(told)?;
        }
        match file.filter(|_| path == "index.html") {
            Some(file) => std::fs::write(&to, with_file(bytes, file)).map_err(told)?,
            None => std::fs::write(&to, bytes).map_err(told)?,
        }
        written.push(to);
    }
    Ok(written)
}

/// The first page with the name of a file.
fn with_file(page: &[u8], file: &str) -> Vec<u8> {
    let attribute = file.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
    let text = String::from_utf8_lossy(page);
    text.replacen("<html lang=\"en\">", &format!("<html lang=\"en\" data-file=\"{attribute}\">"), 1).into_bytes()
}

/// The address of a file next to an exported page.
pub fn relative_address(name: &str) -> String {
    in_path(name)
}
