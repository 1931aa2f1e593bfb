//! Sources of a [`StreamReader`](crate::StreamReader): anything with bytes at offsets.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes that can be read at any offset: a file, memory, an object in a store.
pub trait RangeRead {
    /// Fills `buf` with the bytes from `offset` on.
    ///
    /// # Errors
    /// [`ErrorKind::UnexpectedEof`] if there are fewer bytes; other errors of the source.
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()>;

    /// Fills each buffer with the bytes from its offset on. By default one after the other; a source that answers slowly but
    /// many at once should override it.
    ///
    /// # Errors
    /// The offset of a buffer that was not filled, and why, as by [`read_at`](Self::read_at). The others may be filled or not.
    fn read_many(&self, reads: &mut [(u64, Vec<u8>)]) -> std::result::Result<(), (u64, Error)> {
        reads.iter_mut().try_for_each(|(offset, buf)| self.read_at(*offset, buf).map_err(|error| (*offset, error)))
    }

    /// Length in bytes, if known. If it is known, a file whose length differs from that in its header is refused (rule
    /// H004).
    ///
    /// # Errors
    /// Those of the source.
    fn length(&self) -> Result<Option<u64>> {
        Ok(None)
    }
}

impl RangeRead for File {
    #[cfg(unix)]
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(self, buf, offset)
    }

    #[cfg(windows)]
    fn read_at(&self, mut offset: u64, mut buf: &mut [u8]) -> Result<()> {
        while !buf.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(self, buf, offset) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(n) => {
                    buf = &mut buf[n..];
                    offset += n as u64;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn length(&self) -> Result<Option<u64>> {
        let metadata = self.metadata()?;
        Ok(metadata.is_file().then_some(metadata.len()))
    }
}

impl RangeRead for [u8] {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        let start = usize::try_from(offset).ok();
        let range = start.and_then(|start| Some(start..start.checked_add(buf.len())?));
        let bytes = range.and_then(|range| self.get(range)).ok_or(Error::from(ErrorKind::UnexpectedEof))?;
        buf.copy_from_slice(bytes);
        Ok(())
    }

    fn length(&self) -> Result<Option<u64>> {
        Ok(Some(self.len() as u64))
    }
}

impl RangeRead for Vec<u8> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        self.as_slice().read_at(offset, buf)
    }

    fn length(&self) -> Result<Option<u64>> {
        self.as_slice().length()
    }
}

macro_rules! forward {
    ($($pointer:ty),*) => {$(
        impl<T: RangeRead + ?Sized> RangeRead for $pointer {
            fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
                (**self).read_at(offset, buf)
            }

            fn read_many(&self, reads: &mut [(u64, Vec<u8>)]) -> std::result::Result<(), (u64, Error)> {
                (**self).read_many(reads)
            }

            fn length(&self) -> Result<Option<u64>> {
                (**self).length()
            }
        }
    )*};
}

forward!(&T, Box<T>, Arc<T>);

/// Adapts any [`Read`] and [`Seek`] to [`RangeRead`]. Concurrent reads wait for each other.
#[derive(Debug)]
pub struct SeekSource<R>(Mutex<R>);

impl<R: Read + Seek> SeekSource<R> {
    /// Offsets count from the start of `reader`, not from its current position.
    pub fn new(reader: R) -> Self {
        Self(Mutex::new(reader))
    }

    /// The reader.
    pub fn into_inner(self) -> R {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<R: Read + Seek> RangeRead for SeekSource<R> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        // Every read seeks first, so the position left by a read that panicked does not matter.
        let mut reader = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        reader.seek(SeekFrom::Start(offset))?;
        reader.read_exact(buf)
    }

    fn length(&self) -> Result<Option<u64>> {
        let mut reader = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        reader.seek(SeekFrom::End(0)).map(Some)
    }
}
