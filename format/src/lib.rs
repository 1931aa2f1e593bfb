//! Reader, writer, validator and codecs of the esvo sparse voxel octree format.
