// The package as npm makes it: what is in it, that it works where it lies, and that the vendored decoder is the one of the lock file.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { pathToFileURL } from 'node:url';

const web = new URL('../../', import.meta.url);

test('the package is whole, and its example makes a mesh', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'esvo-pack-'));
  try {
    const packed = JSON.parse(execFileSync('npm', ['pack', '--json', '--pack-destination', folder], { cwd: new URL('reader/', web), encoding: 'utf8', stdio: ['ignore', 'pipe', 'ignore'] }));
    const { filename, files } = Array.isArray(packed) ? packed[0] : Object.values(packed)[0];
    const names = files.map((/** @type {{ path: string }} */ file) => file.path);
    for (const name of ['README.md', 'LICENSE-MIT', 'LICENSE-APACHE', 'vendor/LICENSE-zstddec', 'src/index.js', 'types/src/index.d.ts']) assert.ok(names.includes(name), name);
    assert.ok(!names.some((/** @type {string} */ name) => /test|node_modules/.test(name)));
    execFileSync('tar', ['xzf', join(folder, filename), '-C', folder]);
    const { voxels, bytesSource } = await import(String(pathToFileURL(join(folder, 'package/src/index.js'))));
    const { BoxGeometry, InstancedMesh, Matrix4, MeshNormalMaterial, Vector3 } = await import('three');
    const vector = new Uint8Array(readFileSync(new URL('../../spec/v1/vectors/valid/parts_levels.esvo', web)));
    const { count, positions, sizes, octreeToMesh } = await voxels(bytesSource(vector), { level: 3 });
    const mesh = new InstancedMesh(new BoxGeometry(), new MeshNormalMaterial(), count);
    for (let i = 0; i < count; i++) {
      const matrix = new Matrix4().makeScale(sizes[i], sizes[i], sizes[i]).setPosition(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
      mesh.setMatrixAt(i, matrix.premultiply(new Matrix4().fromArray(octreeToMesh)));
    }
    mesh.computeBoundingBox();
    const edge = mesh.boundingBox?.getSize(new Vector3()).x ?? 0;
    assert.ok(count > 4 && edge > 0 && edge <= octreeToMesh[0] * 1.0001, `${count} voxels, ${edge} wide`);
  } finally {
    rmSync(folder, { recursive: true });
  }
});

test('the vendored decoder is that of the lock file', () => {
  for (const [own, theirs] of [['zstddec.js', 'dist/zstddec.mjs'], ['zstddec.d.ts', 'dist/zstddec.d.mts'], ['LICENSE-zstddec', 'LICENSE']]) {
    assert.equal(readFileSync(new URL(`reader/vendor/${own}`, web), 'utf8'), readFileSync(new URL(`node_modules/zstddec/${theirs}`, web), 'utf8'), own);
  }
});
