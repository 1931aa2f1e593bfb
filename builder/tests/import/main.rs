//! The importer seen from outside: small files of every kind, good and bad, and the real scenes where they are at hand.

mod gltf;
mod obj;
mod ply;
mod robustness;
mod scenes;
mod stl;
mod support;
