//! Addresses of remote files.

use url::Url;

use crate::RemoteError;

/// Schemes of web servers.
const WEB: [&str; 2] = ["http", "https"];
/// Schemes of object stores: Amazon S3 and what speaks like it, Google Cloud Storage, Azure Blob Storage.
const STORES: [&str; 8] = ["s3", "s3a", "gs", "az", "azure", "adl", "abfs", "abfss"];

/// Whether a text is the address of a remote file: it starts with a scheme that this crate knows, and `://`.
pub fn is_address(text: &str) -> bool {
    let scheme = text.split_once("://").map(|(scheme, _)| scheme.to_ascii_lowercase());
    scheme.is_some_and(|scheme| WEB.contains(&&scheme[..]) || STORES.contains(&&scheme[..]))
}

/// An address as it is shown to people: without user, password and the part after `?`, which may be secret.
pub fn shown(address: &str) -> String {
    let Ok(mut url) = Url::parse(address) else { return address.to_owned() };
    // Fails for addresses without a host, which have neither.
    let _ = url.set_username("");
    let _ = url.set_password(None);
    url.set_fragment(None);
    if url.query().is_some() {
        url.set_query(Some("..."));
    }
    url.into()
}

pub(crate) fn parse(address: &str) -> Result<Url, RemoteError> {
    let bad = |what: String| RemoteError::Address(what);
    let url = Url::parse(address)
        .map_err(|error| bad(format!("is no address ({error}); expected e.g. https://example.org/file.esvo")))?;
    if !is_address(address) {
        let known = [&WEB[..], &STORES[..]].concat().join(", ");
        return Err(bad(format!("has the scheme {}; known are {known}", url.scheme())));
    }
    if url.host_str().is_none_or(str::is_empty) || url.path().trim_matches('/').is_empty() {
        return Err(bad("names no file; expected e.g. https://example.org/file.esvo or s3://bucket/file.esvo".into()));
    }
    Ok(url)
}

/// Whether the address is that of a web server.
pub(crate) fn is_web(url: &Url) -> bool {
    WEB.contains(&url.scheme())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses() {
        for good in ["http://a/b", "HTTPS://a.org/b.esvo?x=1", "s3://bucket/key", "gs://b/k", "az://c/k"] {
            assert!(is_address(good) && parse(good).is_ok(), "{good}");
        }
        for other in ["file.esvo", "/a/b.esvo", "C:\\a.esvo", "ftp://a/b", "file:///a", "http:/a", "://a"] {
            assert!(!is_address(other), "{other}");
        }
        for bad in ["http://", "http://a", "http://a/", "s3://bucket", "ftp://a/b", "http://a b/c"] {
            assert!(matches!(parse(bad), Err(RemoteError::Address(_))), "{bad}");
        }
    }

    #[test]
    fn secrets_are_not_shown() {
        assert_eq!(shown("https://me:secret@a.org/b.esvo?signature=secret#x"), "https://a.org/b.esvo?...");
        assert_eq!(shown("s3://bucket/a/b.esvo"), "s3://bucket/a/b.esvo");
    }
}
