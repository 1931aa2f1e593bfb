export { EsvoError } from './errors.js';
export { Octree, openBytes } from './octree.js';
export { Served, openSource } from './served.js';
export { blobSource, bytesSource, httpSource } from './source.js';
export { subset, writeFile } from './subset.js';
export { attributesOf, decodeContour, decodeRawNormal } from './values.js';
export { voxels } from './voxels.js';
export { ready } from './zstd.js';
