//! Textures of glTF: the first image of each that can be read, wrapped as its sampler says.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use image::DynamicImage;

use super::error::ImportError;
use super::gltf_data::{Resource, Source, reason};
use super::image::{TextureStore, normals_of, texture_of};
use crate::mesh::maps::LinearTexture;
use crate::mesh::{Texture, Wrap};

/// What has been read of each image, wrapped as a sampler says, or why it cannot be read.
pub(super) type Known<T> = HashMap<(usize, [Wrap; 2]), Result<Arc<T>, String>>;

/// What is made of an image.
pub(super) trait OfImage: Clone {
    /// From the file `image`; `None` if there is no such file.
    fn load(
        store: &mut TextureStore,
        mesh: &Path,
        image: &Path,
        wrap: [Wrap; 2],
    ) -> Result<Option<Arc<Self>>, ImportError>;

    /// From the pixels of an image that has no file.
    fn of_pixels(mesh: &Path, name: &str, pixels: DynamicImage) -> Result<Arc<Self>, ImportError>;

    fn wrapped(self, wrap: [Wrap; 2]) -> Self;
}

impl OfImage for Texture {
    fn load(
        store: &mut TextureStore,
        mesh: &Path,
        image: &Path,
        wrap: [Wrap; 2],
    ) -> Result<Option<Arc<Self>>, ImportError> {
        store.load_wrapped(mesh, image, wrap)
    }

    fn of_pixels(mesh: &Path, name: &str, pixels: DynamicImage) -> Result<Arc<Self>, ImportError> {
        texture_of(mesh, name, &pixels.into_rgba8())
    }

    fn wrapped(self, wrap: [Wrap; 2]) -> Self {
        self.with_wrap(wrap)
    }
}

impl OfImage for LinearTexture<3> {
    fn load(
        store: &mut TextureStore,
        mesh: &Path,
        image: &Path,
        wrap: [Wrap; 2],
    ) -> Result<Option<Arc<Self>>, ImportError> {
        store.load_normals(mesh, image, wrap)
    }

    fn of_pixels(mesh: &Path, name: &str, pixels: DynamicImage) -> Result<Arc<Self>, ImportError> {
        normals_of(mesh, name, pixels)
    }

    fn wrapped(self, wrap: [Wrap; 2]) -> Self {
        self.with_wrap(wrap)
    }
}

/// Reads a texture, or takes it from those `known`.
pub(super) fn read<T: OfImage>(
    source: &Source<'_>,
    texture: usize,
    store: &mut TextureStore,
    known: &mut Known<T>,
) -> Result<Result<Arc<T>, String>, ImportError> {
    let wrap = wrap_of(source, texture)?;
    first_readable(source, texture, |image| {
        if let Some(known) = known.get(&(image, wrap)) {
            return Ok(known.clone());
        }
        let made = match picture(source, image, store) {
            Ok(Picture::File(file)) => T::load(store, source.path, &file, wrap).and_then(|found| {
                found.ok_or_else(|| source.malformed(format!("the texture {} is missing", file.display())))
            }),
            Ok(Picture::Embedded(pixels)) => T::of_pixels(source.path, &embedded_name(image), pixels)
                .map(|made| Arc::new(Arc::unwrap_or_clone(made).wrapped(wrap))),
            Err(e) => Err(e),
        };
        let made = or_reason(made)?;
        known.insert((image, wrap), made.clone());
        Ok(made)
    })
}

/// Where the image of a texture is.
enum Picture {
    /// In an existing file.
    File(PathBuf),
    /// Embedded: its decoded pixels.
    Embedded(DynamicImage),
}

/// An image that cannot be read is no error of the whole file. Too many texels are.
fn or_reason<T>(result: Result<T, ImportError>) -> Result<Result<T, String>, ImportError> {
    match result {
        Ok(made) => Ok(Ok(made)),
        Err(e @ ImportError::TooLarge { .. }) => Err(e),
        Err(e) => Ok(Err(reason(e))),
    }
}

fn embedded_name(image: usize) -> String {
    format!("{image} (embedded)")
}

/// How a texture is read at coordinates outside 0..=1, by its sampler. Without one, or with modes that glTF does not have, it
/// repeats.
pub(super) fn wrap_of(source: &Source<'_>, texture: usize) -> Result<[Wrap; 2], ImportError> {
    let textures = &source.root.textures;
    let entry = textures.get(texture).ok_or_else(|| source.out_of_range("texture", texture, textures.len()))?;
    let sampler = entry.sampler.and_then(|s| source.root.samplers.get(s.value()));
    let wrap = |mode: &Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    };
    Ok(sampler.map_or([Wrap::Repeat; 2], |s| [wrap(&s.wrap_s), wrap(&s.wrap_t)]))
}

/// Extensions that give a texture an image that can be read, in the order of preference: those before the image of the
/// texture itself, and those after it.
const BETTER: [&str; 1] = ["EXT_texture_webp"];
const WORSE: [&str; 1] = ["MSFT_texture_dds"];
/// Extensions with images that cannot be read.
const UNREADABLE: [&str; 2] = ["KHR_texture_basisu", "EXT_texture_avif"];

/// What `read` makes of the first image of a texture that it can read, or why there is none.
fn first_readable<T>(
    source: &Source<'_>,
    texture: usize,
    mut read: impl FnMut(usize) -> Result<Result<T, String>, ImportError>,
) -> Result<Result<T, String>, ImportError> {
    let textures = &source.root.textures;
    let entry = textures.get(texture).ok_or_else(|| source.out_of_range("texture", texture, textures.len()))?;
    let others = entry.extensions.as_ref().map(|e| &e.others);
    let of_extension = |name: &&str| {
        let index = others?.get(*name)?.get("source")?.as_u64()?;
        Some(usize::try_from(index).unwrap_or(usize::MAX))
    };
    // The JSON parser's value for a texture without `source`.
    let plain = Some(entry.source.value()).filter(|&index| index != u32::MAX as usize);
    let mut why = None;
    let images = &source.root.images;
    for index in BETTER.iter().filter_map(of_extension).chain(plain).chain(WORSE.iter().filter_map(of_extension)) {
        if index >= images.len() {
            return Err(source.out_of_range("image", index, images.len()));
        }
        match read(index)? {
            Ok(found) => return Ok(Ok(found)),
            Err(reason) => why = why.or(Some(reason)),
        }
    }
    let unreadable = UNREADABLE.iter().find(|name| of_extension(name).is_some());
    Ok(Err(match (why, unreadable) {
        (Some(why), _) => why,
        (None, Some(name)) => {
            format!("texture {texture} has only an image of the glTF extension {name}, which is not supported")
        }
        (None, None) => format!("texture {texture} has no image"),
    }))
}

/// Where an image is. Embedded images are decoded.
fn picture(source: &Source<'_>, index: usize, store: &mut TextureStore) -> Result<Picture, ImportError> {
    let images = &source.root.images;
    let image = images.get(index).ok_or_else(|| source.out_of_range("image", index, images.len()))?;
    let decoded = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => match source.resolve(uri, &format!("image {index}"))? {
            Resource::File(file) if file.exists() => return Ok(Picture::File(file)),
            Resource::File(file) => return Err(source.malformed(format!("the texture {} is missing", file.display()))),
            Resource::Embedded { bytes } => store.decode(source.path, &embedded_name(index), &bytes, None)?,
        },
        (None, Some(view)) => {
            let (bytes, _) = source.view(view.value())?;
            store.decode(source.path, &embedded_name(index), bytes, None)?
        }
        (None, None) => return Err(source.malformed(format!("image {index} has neither uri nor bufferView"))),
    };
    Ok(Picture::Embedded(decoded))
}
