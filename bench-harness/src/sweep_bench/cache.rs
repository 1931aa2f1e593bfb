//! Octrees and exact hits of former runs, kept by the hash of what they were made from.
//!
//! A key is the SHA-256 of the mesh in memory with its materials and textures, of the settings, and of the sources of the code that
//! makes them ([`MAKERS`]), so that nothing that is found is out of date. A file that is damaged is made anew. Nothing is removed:
//! the folder can be deleted at any time.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use esvo_builder::{BuildSettings, Mesh};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_format::{Octree, write_atomically};
use sha2::{Digest, Sha256};

use crate::BenchError;
use crate::content_hash::hex;

/// Hash of the sources of builder, format, exact caster and textures, made when this program was built.
const MAKERS: &str = env!("ESVO_MAKERS");

/// Bytes of an exact hit in a file: `t` and the triangle, little-endian.
const HIT_BYTES: usize = 12;
/// Bytes of the SHA-256 in front of the hits of a file.
const SUM_BYTES: usize = 32;

/// The folder, or none.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: Option<PathBuf>,
}

impl Cache {
    /// A cache in this folder, which is made when something is stored.
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()) }
    }

    /// A cache that keeps nothing.
    pub fn none() -> Self {
        Self { folder: None }
    }

    /// The folder without `--cache`: `esvo` in the user's folder of caches, else in the system's temporary folder.
    pub fn default_folder() -> PathBuf {
        let set = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
        let home = || set("HOME").map(|home| home.join(".cache"));
        let user = set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")).or_else(home);
        user.unwrap_or_else(std::env::temp_dir).join("esvo")
    }

    /// The octree that was stored under this key; `None` if there is none, or if it is damaged.
    pub(crate) fn octree(&self, key: &str) -> Option<Octree> {
        let octree = Octree::open(&self.path("octrees", key, "esvo")?).ok()?;
        let sound = octree.intact().is_ok() && octree.sound().is_ok();
        sound.then_some(octree)
    }

    /// Stores an octree.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn put_octree(&self, key: &str, octree: &Octree) -> Result<(), BenchError> {
        let Some(path) = self.path("octrees", key, "esvo") else { return Ok(()) };
        make_folder(&path)?;
        octree.write(&path).map_err(|e| BenchError::file(&path, e))
    }

    /// The exact hits that were stored under this key; `None` if there are none, if they are damaged, or if they are not `count`.
    pub(crate) fn hits(&self, key: &str, count: usize) -> Option<Vec<TriangleHit>> {
        let bytes = std::fs::read(self.path("exact", key, "hits")?).ok()?;
        let (sum, records) = bytes.split_at_checked(SUM_BYTES)?;
        if records.len() != count * HIT_BYTES || Sha256::digest(records)[..] != *sum {
            return None;
        }
        let hit = |record: &[u8; HIT_BYTES]| {
            let [a, b, c, d, e, f, g, h, i, j, k, l] = *record;
            TriangleHit { t: f64::from_le_bytes([a, b, c, d, e, f, g, h]), triangle: u32::from_le_bytes([i, j, k, l]) }
        };
        Some(records.as_chunks().0.iter().map(hit).collect())
    }

    /// Stores exact hits.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn put_hits(&self, key: &str, hits: &[TriangleHit]) -> Result<(), BenchError> {
        let Some(path) = self.path("exact", key, "hits") else { return Ok(()) };
        make_folder(&path)?;
        let mut records = Vec::with_capacity(hits.len() * HIT_BYTES);
        for hit in hits {
            records.extend(hit.t.to_le_bytes());
            records.extend(hit.triangle.to_le_bytes());
        }
        let sum = Sha256::digest(&records);
        let written = write_atomically(&path, |out| {
            out.write_all(&sum)?;
            out.write_all(&records)
        });
        written.map_err(|e| BenchError::io(&path, e))
    }

    fn path(&self, kind: &str, key: &str, extension: &str) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(kind).join(format!("{key}.{extension}")))
    }
}

fn make_folder(path: &Path) -> Result<(), BenchError> {
    let Some(folder) = path.parent() else { return Ok(()) };
    std::fs::create_dir_all(folder).map_err(|e| BenchError::io(folder, e))
}

/// Hash of a mesh with everything that octrees and exact answers depend on, and of the code that makes them.
pub(crate) fn mesh_key(mesh: &Mesh) -> String {
    hash_mesh(Hash::new("mesh"), mesh)
}

/// Hash of a mesh with everything that octrees and exact answers depend on, whatever code makes them.
pub(crate) fn mesh_sha256(mesh: &Mesh) -> String {
    hash_mesh(Hash(Sha256::new()), mesh)
}

fn hash_mesh(mut hash: Hash, mesh: &Mesh) -> String {
    let Mesh { positions, normals, uvs, colors, tangents, triangles, triangle_materials, materials, warnings: _ } =
        mesh;
    hash.numbers(positions.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(normals.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(uvs.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(colors.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(tangents.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(triangles.as_flattened().iter().map(|x| x.to_le_bytes()));
    hash.numbers(triangle_materials.iter().map(|x| x.to_le_bytes()));
    // The debug text has every field of a material and every texel; numbers are written so that they can be read back.
    let _ = write!(hash, "{materials:?}");
    hash.finish()
}

/// Key of an octree of a mesh.
pub(crate) fn octree_key(mesh_key: &str, settings: &BuildSettings) -> String {
    let mut hash = Hash::new("octree");
    let _ = write!(hash, "{mesh_key} {settings:?}");
    hash.finish()
}

/// Key of the exact hits of rays.
pub(crate) fn hits_key(mesh_key: &str, rays: &CameraRays) -> String {
    let mut hash = Hash::new("hits");
    let _ = write!(hash, "{mesh_key} {rays:?}");
    hash.finish()
}

/// A hash that text and numbers are written to.
struct Hash(Sha256);

impl Hash {
    fn new(kind: &str) -> Self {
        Self(Sha256::new_with_prefix(format!("{kind} {MAKERS}\n")))
    }

    /// The numbers of an array, after their count.
    fn numbers<const N: usize>(&mut self, numbers: impl ExactSizeIterator<Item = [u8; N]>) {
        self.0.update((numbers.len() as u64).to_le_bytes());
        let mut bytes = Vec::with_capacity(N << 12);
        for number in numbers {
            bytes.extend(number);
            if bytes.len() >= N << 12 {
                self.0.update(&bytes);
                bytes.clear();
            }
        }
        self.0.update(&bytes);
    }

    fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}

impl std::fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_builder::{Material, MipLevel, Texture, Wrap};

    use super::*;
    use crate::content_hash::image_key;

    fn mesh() -> Mesh {
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        Mesh::from_triangles(corners, vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn a_key_changes_with_everything_that_matters() {
        let mut keys = vec![mesh_key(&mesh())];
        let mut changed = |change: &dyn Fn(&mut Mesh)| {
            let mut mesh = mesh();
            change(&mut mesh);
            keys.push(mesh_key(&mesh));
        };
        changed(&|m| m.positions[2][2] = 0.5f64.next_up());
        changed(&|m| m.normals = vec![[0.0, 0.0, 1.0]; 3]);
        changed(&|m| m.tangents = vec![[0.0, 0.0, 1.0, 1.0]; 3]);
        changed(&|m| m.uvs = vec![[0.0, 1.0]; 3]);
        changed(&|m| m.colors = vec![[0.0, 0.0, 1.0]; 3]);
        changed(&|m| m.triangles[0] = [0, 2, 1]);
        changed(&|m| m.materials[0].base_color[1] = 0.25);
        let texture = |green: u8| Texture {
            mips: vec![MipLevel { width: 1, height: 1, texels: vec![[1, green, 3, 4]] }],
            wrap: [Wrap::Repeat; 2],
        };
        changed(&|m| m.materials[0] = Material { texture: Some(Arc::new(texture(2))), ..Material::default() });
        changed(&|m| m.materials[0] = Material { texture: Some(Arc::new(texture(3))), ..Material::default() });
        let settings = BuildSettings::default();
        keys.push(octree_key(&keys[0], &settings));
        keys.push(octree_key(&keys[1], &settings));
        keys.push(octree_key(&keys[0], &BuildSettings { contours: false, ..settings }));
        keys.push(octree_key(&keys[0], &BuildSettings { levels: 9, ..settings }));
        let all = keys.len();
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), all);
        // Warnings of the importer do not matter.
        assert_eq!(mesh_key(&Mesh { warnings: vec!["w".into()], ..mesh() }), mesh_key(&mesh()));
    }

    #[test]
    fn what_is_stored_is_found_and_damage_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::in_folder(&folder.path().join("not/there"));
        let hits = vec![TriangleHit { t: 0.1, triangle: 7 }, TriangleHit::MISS];
        assert_eq!(cache.hits("k", 2), None);
        cache.put_hits("k", &hits).unwrap();
        assert_eq!((cache.hits("k", 2), cache.hits("k", 3)), (Some(hits), None));
        let file = cache.path("exact", "k", "hits").unwrap();
        let mut bytes = std::fs::read(&file).unwrap();
        bytes[SUM_BYTES + 3] ^= 1;
        std::fs::write(&file, &bytes).unwrap();
        assert_eq!(cache.hits("k", 2), None);

        let built = esvo_builder::build(&mesh(), &BuildSettings { levels: 4, ..Default::default() }, &|_| ()).unwrap();
        cache.put_octree("o", &built.octree).unwrap();
        assert_eq!(image_key(&cache.octree("o").unwrap()), image_key(&built.octree));
        let file = cache.path("octrees", "o", "esvo").unwrap();
        let mut bytes = std::fs::read(&file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&file, &bytes).unwrap();
        assert!(cache.octree("o").is_none());

        let none = Cache::none();
        none.put_octree("o", &built.octree).unwrap();
        assert!(none.octree("o").is_none() && none.hits("k", 2).is_none());
    }
}
