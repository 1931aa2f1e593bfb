//! CPU casters of esvo: octrees on all cores, triangles through a BVH.
