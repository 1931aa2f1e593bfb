//! Octrees on web servers and in object stores, read by byte ranges.
//!
//! [`RemoteFile`] is a [`RangeRead`](esvo_format::RangeRead): an [`IndexReader`](esvo_format::IndexReader) or a
//! [`StreamReader`](esvo_format::StreamReader) reads only what it needs of it.
//!
//! ```no_run
//! use esvo_format::{IndexReader, Region};
//! use esvo_remote::{RemoteFile, RemoteOptions};
//!
//! let file = RemoteFile::open("https://example.org/sibenik.esvo", RemoteOptions::default())?;
//! let mut reader = IndexReader::open(&file)?;
//! let coarse = reader.octree(0, &Region::ALL, 5)?;
//! println!("{} levels in {} requests, {} bytes", coarse.objects()[0].levels, file.requests(), file.bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | to | see |
//! |---|---|
//! | open a file by its address | [`RemoteFile::open`]: `http`, `https`, `s3`, `gs`, `az` and others, see [`is_address`] |
//! | bound time, repeated requests and disk space | [`RemoteOptions`] |
//! | get the whole file | [`RemoteFile::download`] |
//! | know why it failed | [`RemoteError`] |
//! | serve files, for tests and measurements | [`server`] |
//!
//! # What a server may do
//!
//! Nothing that it sends is trusted. An answer must be the range that was asked for, with as many bytes; a file that is replaced
//! between two requests is noticed by its entity tag (`If-Range`) or its length; redirects, repeated requests, the time of each
//! request and the bytes of all are bounded (section 11.3 of the specification). What the bytes mean is checked by their checksums,
//! in `esvo-format`.
//!
//! A server that knows no ranges sends the whole file: it is read to a temporary file within
//! [`max_download`](RemoteOptions::max_download), and [`RemoteFile::is_whole`] says so.
//!
//! Requests are made on the thread that reads. In asynchronous code, read on a thread where blocking is allowed.

mod address;
mod answer;
mod download;
mod error;
mod file;
mod http;
mod options;
pub mod server;
mod store;
mod temporary;

pub use address::{is_address, shown};
pub use error::RemoteError;
pub use file::RemoteFile;
pub use options::{OnBytes, RemoteOptions};
pub use temporary::{Temporary, remove_temporaries};
