//! Pictures in files: the feature `png`.

use std::io;
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::Picture;

/// Writes a picture as a PNG file: whole, or not at all.
///
/// # Errors
/// Those of the file system; a picture whose number of bytes does not fit its size.
pub fn write_png(path: &Path, picture: &Picture) -> io::Result<()> {
    if picture.rgb8.len() as u64 != 3 * u64::from(picture.width) * u64::from(picture.height) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "a picture must have three bytes for every pixel"));
    }
    esvo_format::write_atomically(path, |out| {
        PngEncoder::new(out)
            .write_image(&picture.rgb8, picture.width, picture.height, ExtendedColorType::Rgb8)
            .map_err(io::Error::other)
    })
}

/// Reads a PNG, JPEG or TGA file as a picture of 8-bit sRGB colours; transparency is dropped.
///
/// # Errors
/// Those of the file system; a file that is not a picture.
pub fn read_picture(path: &Path) -> io::Result<Picture> {
    let image = image::open(path).map_err(|error| io::Error::other(format!("{}: {error}", path.display())))?;
    let image = image.into_rgb8();
    Ok(Picture { width: image.width(), height: image.height(), rgb8: image.into_raw() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = Picture::from_fn((13, 7), |x, y| [x as f32 / 13.0, y as f32 / 7.0, 0.5]);
        write_png(&path, &picture).unwrap();
        assert_eq!(read_picture(&path).unwrap(), picture);
        // A bad picture leaves the file as it was.
        assert!(write_png(&path, &Picture { width: 14, ..picture.clone() }).is_err());
        assert_eq!(read_picture(&path).unwrap(), picture);
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "no temporary file is left");
    }
}
