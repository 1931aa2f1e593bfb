//! `esvo view`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use clap::Args;
use esvo_web::Server;

use crate::fail::{Failure, print};
use crate::files::name_file;

/// Show an octree in the browser, streamed as the camera moves
#[derive(Debug, Args)]
#[command(after_help = "\
The page casts with WebGPU: Chrome and Edge have it, Safari from 26, Firefox on Windows and macOS. It is served to this machine
alone, at 127.0.0.1, until the program is interrupted. Files in parts by level stream best: see `esvo convert --parts`.

--export writes the page for any server that answers range requests; ?file=ADDRESS behind its address names the octree.

Examples:
  esvo view sibenik.esvo                              open the browser
  esvo view https://example.org/sibenik.esvo          a file on a server that lets other sites read it (CORS)
  esvo view sibenik.esvo --no-open --port 8080        print the address only
  esvo view --export www sibenik.esvo                 page and file in a folder, to put on a server")]
pub(crate) struct ViewArguments {
    /// The octree, or its address (http://, https://); without it, the page asks
    pub(crate) file: Option<String>,
    /// Write the page to this folder instead of serving it; FILE is copied next to it and opened by it
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["port", "no_open"])]
    pub(crate) export: Option<PathBuf>,
    /// Port of this machine [default: any that is free]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) port: Option<u16>,
    /// Do not open the browser
    #[arg(long)]
    pub(crate) no_open: bool,
}

pub(crate) fn run_view(arguments: &ViewArguments) -> Result<(), Failure> {
    if let Some(folder) = &arguments.export {
        return export(folder, arguments.file.as_deref());
    }
    let server = Arc::new(Server::new(arguments.file.as_deref(), arguments.port.unwrap_or(0))?);
    let address = server.address();
    print(&format!("{address}\nCtrl-C ends\n"))?;
    if !arguments.no_open && !open_browser(&address) {
        print("no browser could be started: open the address yourself\n")?;
    }
    server.run();
    Ok(())
}

/// Writes the page, and a copy of the octree.
fn export(folder: &Path, file: Option<&str>) -> Result<(), Failure> {
    let address = match file {
        None => None,
        Some(address) if address.contains("://") => Some(address.to_owned()),
        Some(path) => {
            let path = Path::new(path);
            // The page is not written if the octree cannot be read.
            std::fs::File::open(path).map_err(|error| name_file(path, error))?;
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Some(esvo_web::relative_address(&name))
        }
    };
    let written = esvo_web::export(folder, address.as_deref())?;
    if let Some(path) = file.filter(|file| !file.contains("://")).map(Path::new) {
        let to = folder.join(path.file_name().unwrap_or_default());
        let copied = esvo_format::write_atomically(&to, |out| {
            std::io::copy(&mut std::fs::File::open(path)?, out)?;
            Ok(())
        });
        copied.map_err(|error| name_file(&to, error))?;
    }
    let page = folder.join("index.html");
    print(&format!(
        "{}: the page, {} files; put the folder on any server that answers range requests\n",
        page.display(),
        written.len()
    ))
}

/// Asks the system to open an address. Whether a window appears is not known.
fn open_browser(address: &str) -> bool {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let quiet =
        Command::new(program).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    match quiet {
        Ok(mut child) => {
            // The child is waited for, so that none is left behind.
            std::thread::spawn(move || child.wait());
            true
        }
        Err(_) => false,
    }
}
