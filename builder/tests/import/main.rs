//! The importer through its public interface: small files of every kind, valid and invalid, and the real scenes if found.

mod cases;
mod components;
mod gltf;
mod gltf_cases;
mod gltf_colors;
mod gltf_document;
mod obj;
mod ply;
mod robustness;
mod scenes;
mod shared_cases;
mod stl;
mod support;
mod vox;
