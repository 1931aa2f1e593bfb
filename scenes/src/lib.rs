//! Scene manifests, camera sets and procedural meshes for the esvo benchmarks.
