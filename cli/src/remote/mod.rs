//! Files that are named by an address: on a web server, or in an object store.

#[cfg(not(feature = "remote"))]
#[path = "absent.rs"]
mod served;
#[cfg(feature = "remote")]
mod served;

use std::path::{Path, PathBuf};

use clap::Args;

use crate::fail::Failure;

pub(crate) use served::{Copy, Served, remove_copies};

/// Schemes of addresses.
const SCHEMES: [&str; 10] = ["http", "https", "s3", "s3a", "gs", "az", "azure", "adl", "abfs", "abfss"];

/// How files on servers are read.
#[derive(Debug, Args)]
pub(crate) struct RemoteArguments {
    /// Most bytes of a temporary copy of a file on a server, where all of it is needed: bytes, or with K, M, G (powers of ten)
    #[cfg(feature = "remote")]
    #[arg(long, value_name = "SIZE", default_value = "4G", value_parser = crate::values::parse_bytes)]
    pub(crate) max_download: u64,
}

/// Whether a file is named by an address.
pub(crate) fn is_address(path: &Path) -> bool {
    let scheme = path.to_str().and_then(|text| text.split_once("://")).map(|(scheme, _)| scheme.to_ascii_lowercase());
    scheme.is_some_and(|scheme| SCHEMES.contains(&&scheme[..]))
}

/// The name of a file for people: of an address, without user, password and what follows a `?`, which may be secret.
pub(crate) fn shown(path: &Path) -> String {
    let text = path.display().to_string();
    if !is_address(path) {
        return text;
    }
    let text = text.split(['?', '#']).next().unwrap_or_default();
    let (scheme, rest) = text.split_once("://").unwrap_or_default();
    let (host, path) = rest.split_once('/').map_or((rest, String::new()), |(host, path)| (host, format!("/{path}")));
    format!("{scheme}://{}{path}", host.rsplit('@').next().unwrap_or_default())
}

/// A file on this machine: the one that is named, or a copy of one on a server.
pub(crate) enum Local<'a> {
    Named(&'a Path),
    Copy(Copy),
}

impl<'a> Local<'a> {
    /// Gets the file here, if it is not.
    pub(crate) fn of(path: &'a Path, arguments: &RemoteArguments) -> Result<Self, Failure> {
        if is_address(path) { Ok(Self::Copy(Copy::of(path, arguments)?)) } else { Ok(Self::Named(path)) }
    }

    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Named(path) => path,
            Self::Copy(copy) => copy.path(),
        }
    }

    /// Puts the name of the file in the place of that of the copy.
    pub(crate) fn rename(&self, failure: Failure, name: &Path) -> Failure {
        match (self, failure) {
            (Self::Copy(copy), Failure::Message(text)) => {
                Failure::Message(text.replace(&copy.path().display().to_string(), &shown(name)))
            }
            (_, failure) => failure,
        }
    }
}

/// The name of a file on a server without what follows a `?`, so that it has an extension; other names as they are.
pub(crate) fn bare(path: &Path) -> PathBuf {
    if is_address(path) { shown(path).into() } else { path.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_and_their_names() {
        let shown = |text: &str| super::shown(Path::new(text));
        assert_eq!(shown("https://me:pass@word@a.org:80/b/c.esvo?key=secret"), "https://a.org:80/b/c.esvo");
        assert_eq!(shown("S3://bucket/c.esvo#x"), "S3://bucket/c.esvo");
        assert_eq!((shown("a?b.esvo"), shown("file://a?b")), ("a?b.esvo".into(), "file://a?b".into()));
        assert_eq!(bare(Path::new("http://a/c.esvo?x=y.z")).extension().unwrap(), "esvo");
        for (text, is) in [("http://a/b", true), ("az://a/b", true), ("http:/a", false), ("x/http.esvo", false)] {
            assert_eq!(is_address(Path::new(text)), is, "{text}");
        }
    }
}
