//! Image files and embedded images as textures.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{ImageFormat, ImageReader, Limits, RgbaImage};

use super::{ImportError, MAX_TEXTURE_SIDE, MAX_TEXTURE_TEXELS, one_line, read_file};
use crate::mesh::Texture;

/// Textures read so far, shared by all materials that use the same file, and how many texels may still come.
#[derive(Debug)]
pub(super) struct TextureStore {
    by_path: HashMap<PathBuf, Arc<Texture>>,
    texels_left: u64,
}

impl Default for TextureStore {
    fn default() -> Self {
        Self { by_path: HashMap::new(), texels_left: MAX_TEXTURE_TEXELS }
    }
}

impl TextureStore {
    /// The texture in the file `image`, or `None` if there is no such file.
    pub(super) fn load(&mut self, mesh: &Path, image: &Path) -> Result<Option<Arc<Texture>>, ImportError> {
        // Two spellings of one path share the texture.
        let Ok(key) = image.canonicalize() else { return Ok(None) };
        if let Some(texture) = self.by_path.get(&key) {
            return Ok(Some(texture.clone()));
        }
        let pixels = self.load_pixels(mesh, image)?;
        let texture = texture_of(mesh, &image.display().to_string(), &pixels)?;
        self.by_path.insert(key, texture.clone());
        Ok(Some(texture))
    }

    /// The pixels of the file `image`.
    pub(super) fn load_pixels(&mut self, mesh: &Path, image: &Path) -> Result<RgbaImage, ImportError> {
        let bytes = read_file(image)?;
        self.decode(mesh, &image.display().to_string(), &bytes, image.extension().and_then(|e| e.to_str()))
    }

    /// Decodes an image file in memory. The content decides the format; `extension` only helps with TGA, which has no
    /// identifier of its own.
    pub(super) fn decode(
        &mut self,
        mesh: &Path,
        name: &str,
        bytes: &[u8],
        extension: Option<&str>,
    ) -> Result<RgbaImage, ImportError> {
        let fail = |what: String| ImportError::Image { path: mesh.into(), image: name.into(), what };
        let format = match image::guess_format(bytes) {
            Ok(format) => format,
            Err(_) if extension.is_some_and(|e| e.eq_ignore_ascii_case("tga")) => ImageFormat::Tga,
            Err(_) if bytes.is_empty() => return Err(fail("it is empty".into())),
            Err(_) => return Err(fail("it is neither PNG, JPEG nor TGA".into())),
        };
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_TEXTURE_SIDE);
        limits.max_image_height = Some(MAX_TEXTURE_SIDE);
        // Eight bytes per texel: 16-bit images are decoded before they are reduced.
        limits.max_alloc = Some(self.texels_left.saturating_mul(8).min(8 * u64::from(MAX_TEXTURE_SIDE).pow(2)));
        let reader = || {
            let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
            reader.limits(limits.clone());
            reader
        };
        let (width, height) = reader().into_dimensions().map_err(|e| fail(one_line(e)))?;
        let texels = u64::from(width) * u64::from(height);
        if texels > self.texels_left {
            return Err(ImportError::TooLarge {
                path: mesh.into(),
                what: format!("the textures up to {name} have more than {MAX_TEXTURE_TEXELS} texels in all"),
                limit: MAX_TEXTURE_TEXELS,
            });
        }
        let decoded = reader().decode().map_err(|e| fail(one_line(e)))?;
        self.texels_left -= texels;
        Ok(decoded.into_rgba8())
    }
}

/// The texture made from decoded pixels.
pub(super) fn texture_of(mesh: &Path, name: &str, pixels: &RgbaImage) -> Result<Arc<Texture>, ImportError> {
    Texture::from_rgba8(pixels.width(), pixels.height(), pixels.as_raw())
        .map(Arc::new)
        .map_err(|e| ImportError::Image { path: mesh.into(), image: name.into(), what: e.to_string() })
}
