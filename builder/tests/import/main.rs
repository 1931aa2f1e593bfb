//! The importer through its public interface: small files of every kind, valid and invalid, and the real scenes if found.

mod gltf;
mod obj;
mod ply;
mod robustness;
mod scenes;
mod stl;
mod support;
