"""Writes an octree from numpy arrays: positions, colours, normals (sections 2 to 6, 8, 11.1)."""

from __future__ import annotations

import contextlib
import json
import operator
import os
from typing import Any, BinaryIO, Callable, Dict, Optional, Sequence, Tuple, Union

import numpy as np
import zstandard

from .container import Section, bytes_of, front, places
from .errors import EsvoError
from .images import Tree
from .opening import COMPRESSED, OWN_CHECKSUMS, REQUIRED, crc, parse_metadata, usable_transforms
from .records import BLOCK_ENTRY, MAX_LEVELS, NO_PARENT, OBJECT_ENTRY, PAGE_BYTES, Array
from .trees import path_order

Compressor = zstandard.ZstdCompressor
Target = Union[str, "os.PathLike[str]", BinaryIO]


def write_voxels(
    target: Target,
    positions: Any,
    colors: Any = None,
    normals: Any = None,
    *,
    origin: Optional[Sequence[int]] = None,
    levels: Optional[int] = None,
    matrix: Any = None,
    compression: Optional[int] = None,
    metadata: Optional[Dict[str, Any]] = None,
) -> None:
    """Writes the octree of some voxels, all of the same size.

    `target`: a path, which is replaced once the file is complete; or a file that is open for writing bytes.
    `positions`: integers (n, 3); the voxel at p fills the cube from p to p + 1. No position occurs twice.
    `colors`: (n, 3) or (n, 4), or (3,) or (4,) for all: red, green, blue, sRGB-encoded, and alpha; integers from 0 to
    255, or floating point from 0 to 1. A voxel that is split has the mean colour of the leaf voxels below it.
    `normals`: (n, 3) or (3,), in mesh space, of any length; (0, 0, 0) is taken as +z.
    `origin`: the position of the corner of the root cube; the least of the positions on each axis if left out.
    `levels`: 1 to 23: the root cube has an edge of 2^levels voxels; as few as hold all positions if left out.
    `matrix`: (4, 4), from the space of the positions to mesh space; the identity if left out.
    `compression`: a level of Zstandard, 1 to 19; blocks that take fewer pages so are compressed.
    `metadata`: the members of the section META; there is none if left out.

    The same arguments give the same bytes; with `compression`, by the same version of Zstandard. Raises `ValueError` or
    `TypeError` for arguments that make no file, before anything is written, and `OSError` where the target cannot be
    written.
    """
    cells, start, depth = _positions(positions, origin, levels)
    shades = _rows(_colors(colors), len(cells), "colors"), _rows(_normals(normals), len(cells), "normals")
    # Checked before the work begins.
    text = None if metadata is None else _metadata(metadata)
    frames = _compressor(compression)
    transform = _transform(matrix, start, depth)
    order = path_order(cells)
    cells = cells[order]
    same = np.flatnonzero((cells[1:] == cells[:-1]).all(axis=1))
    if same.size:
        raise ValueError(f"the position {(cells[same[0]] + start).tolist()} occurs more than once")
    tree = Tree(cells, depth, *(None if rows is None else rows[order] for rows in shades))
    if isinstance(target, (str, os.PathLike)):
        _replace(target, lambda file: _write(file, tree, transform, text, frames))
    else:
        _write(target, tree, transform, text, frames)


def write_grid(
    target: Target,
    colors: Any,
    normals: Any = None,
    *,
    occupied: Any = None,
    levels: Optional[int] = None,
    matrix: Any = None,
    compression: Optional[int] = None,
    metadata: Optional[Dict[str, Any]] = None,
) -> None:
    """Writes the octree of a dense array of cells: the voxel of cell [x, y, z] fills the cube from there to one more.

    `colors`: (nx, ny, nz, 3) or (nx, ny, nz, 4), or one colour for all, as in `write_voxels`; None for voxels without.
    `normals`: (nx, ny, nz, 3) or (3,).
    `occupied`: bool (nx, ny, nz), which cells are voxels; if left out, those whose alpha is not 0, or without alpha
    those that are not black. All else is as in `write_voxels`; the root cube has the corner (0, 0, 0) and holds the
    whole array.
    """
    grid = None if colors is None else np.asarray(colors)
    if occupied is not None:
        there = np.asarray(occupied)
        if there.dtype != bool or there.ndim != 3:
            raise ValueError(f"occupied of shape {there.shape} and type {there.dtype}: expected bool (nx, ny, nz)")
    elif grid is not None and grid.ndim == 4 and grid.shape[3] in (3, 4):
        there = grid[..., 3] != 0 if grid.shape[3] == 4 else (grid != 0).any(axis=3)
    else:
        raise ValueError("expected colors (nx, ny, nz, 3) or (nx, ny, nz, 4), or occupied: which cells are voxels")
    directions = None if normals is None else np.asarray(normals)
    for name, array in (("colors", grid), ("normals", directions)):
        if array is not None and array.ndim != 1 and array.shape[:-1] != there.shape:
            raise ValueError(f"{name} of shape {array.shape}: expected one of each cell of {there.shape}")
    if levels is None:
        levels = max(1, (max(there.shape) - 1).bit_length())
    cells = np.argwhere(there)
    write_voxels(
        target,
        cells,
        grid if grid is None or grid.ndim == 1 else grid[there],
        directions if directions is None or directions.ndim == 1 else directions[there],
        origin=(0, 0, 0),
        levels=levels,
        matrix=matrix,
        compression=compression,
        metadata=metadata,
    )


def _positions(positions: Any, origin: Optional[Sequence[int]], levels: Optional[int]) -> Tuple[Array, Array, int]:
    """Positions from the origin on, int64 (n, 3); the origin; the number of levels."""
    given = np.asarray(positions)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"positions of shape {given.shape}: expected (n, 3)")
    if given.dtype.kind not in "iu":
        raise TypeError(f"positions of type {given.dtype}: expected integers")
    if not len(given):
        raise ValueError("no voxels: an octree has at least one")
    if given.dtype == np.uint64 and (given >> np.uint64(63)).any():
        raise ValueError("positions beyond 2^63")
    low, high = [int(x) for x in given.min(axis=0)], [int(x) for x in given.max(axis=0)]
    start = low if origin is None else [operator.index(x) for x in origin]
    if len(start) != 3:
        raise ValueError(f"an origin of {len(start)} numbers: expected 3")
    if any(a < b for a, b in zip(low, start)):
        raise ValueError(f"positions from {low} on, before the origin {start}")
    needed = max(1, max(b - a for a, b in zip(start, high)).bit_length())
    depth = needed if levels is None else int(levels)
    if not 1 <= depth <= MAX_LEVELS:
        raise ValueError(f"{depth} levels: expected 1 to {MAX_LEVELS}")
    if needed > depth:
        raise ValueError(f"positions from {start} to {high} do not fit into {depth} levels")
    corner = np.array(start, np.int64)
    return given.astype(np.int64) - corner, corner, depth


def _colors(colors: Any) -> Optional[Array]:
    """uint8 (..., 4)."""
    if colors is None:
        return None
    given = np.asarray(colors)
    if given.ndim not in (1, 2) or given.shape[-1] not in (3, 4):
        raise ValueError(f"colors of shape {given.shape}: expected (n, 3), (n, 4), (3,) or (4,)")
    if given.dtype.kind == "f":
        if not ((given >= 0) & (given <= 1)).all():
            raise ValueError("colors of floating point that are not from 0 to 1")
        given = np.rint(given.astype(np.float64) * 255).astype(np.uint8)
    elif given.dtype.kind not in "iu":
        raise TypeError(f"colors of type {given.dtype}: expected integers or floating point")
    elif not ((given >= 0) & (given <= 255)).all():
        raise ValueError("colors of integers that are not from 0 to 255")
    alpha = np.full((*given.shape[:-1], 1), 255, np.uint8)
    result: Array = np.concatenate([given.astype(np.uint8), alpha], axis=-1)[..., :4]
    return result


def _normals(normals: Any) -> Optional[Array]:
    """float64 (..., 3)."""
    if normals is None:
        return None
    given = np.asarray(normals, np.float64)
    if given.ndim not in (1, 2) or given.shape[-1] != 3:
        raise ValueError(f"normals of shape {given.shape}: expected (n, 3) or (3,)")
    if not np.isfinite(given).all():
        raise ValueError("normals that are not finite")
    # So that no square is infinite or lost.
    most = np.abs(given).max(axis=-1, keepdims=True)
    result: Array = given / np.where(most > 0, most, 1)
    return result


def _rows(values: Optional[Array], count: int, name: str) -> Optional[Array]:
    """One row for each voxel."""
    if values is not None and values.ndim == 2 and len(values) != count:
        raise ValueError(f"{name} of {len(values)} voxels: there are {count} positions")
    return None if values is None else np.broadcast_to(values, (count, values.shape[-1]))


def _metadata(members: Dict[str, Any]) -> bytes:
    try:
        text = json.dumps(members, ensure_ascii=False, allow_nan=False).encode("utf-8")
        parse_metadata(text, 0)
    except (EsvoError, RecursionError) as error:
        raise ValueError(f"metadata: {error}") from error
    return text


def _compressor(level: Optional[int]) -> Optional[Compressor]:
    if level is None:
        return None
    if not 1 <= level <= 19:
        raise ValueError(f"compression {level}: expected 1 to 19")
    # Windows of these levels have at most 8 MiB.
    return Compressor(level=level, write_content_size=True, write_checksum=False)


def _transform(matrix: Any, origin: Array, levels: int) -> Array:
    """float64 (16,): the transform from octree space to mesh space, by columns."""
    given = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
    if given.shape != (4, 4):
        raise ValueError(f"a matrix of shape {given.shape}: expected (4, 4)")
    to_positions = np.diag([*[float(1 << levels)] * 3, 1.0])
    to_positions[:3, 3] = origin
    # Zeros are of one sign, so that equal transforms have equal bytes.
    columns: Array = (given @ to_positions).T.reshape(16) + 0.0
    if not usable_transforms(columns[None])[0]:
        raise ValueError("the matrix is not finite, affine and invertible")
    return columns


def _write(file: BinaryIO, tree: Tree, transform: Array, text: Optional[bytes], frames: Optional[Compressor]) -> None:
    """The sections in the order of section 2."""
    stored, codecs = [], []
    for image in tree.images:
        frame = None if frames is None else frames.compress(image.tobytes())
        # Only whole pages count: blocks are stored at multiples of them.
        smaller = frame is not None and -len(frame) // PAGE_BYTES > -len(image) // PAGE_BYTES
        stored.append(np.frombuffer(frame, np.uint8) if frame is not None and smaller else image)
        codecs.append(int(smaller))
    objects, blocks = _objects(tree, transform), _blocks(tree)
    sizes = np.array([len(body) for body in stored], np.int64)
    rooms = sizes + -sizes % PAGE_BYTES
    bodies = [(b"OBJT", objects), (b"BLKT", blocks)]
    if text is not None:
        bodies.append((b"META", np.frombuffer(text, np.uint8)))
    # The bytes after the last block are a part of its place, so BLKS has whole pages.
    lengths = [body.nbytes for _, body in bodies] + [int(rooms.sum())]
    offsets = places(lengths)
    blocks["codec"], blocks["stored_size"] = codecs, sizes
    blocks["file_offset"] = offsets[-1] + np.cumsum(rooms) - rooms
    blocks["crc"] = [crc(body) for body in stored]
    sections = [
        Section(tag, 0 if tag == b"META" else REQUIRED, body.nbytes, crc(bytes_of(body))) for tag, body in bodies
    ]
    sections.append(Section(b"BLKS", REQUIRED | OWN_CHECKSUMS, lengths[-1]))
    head = front(sections, COMPRESSED if any(codecs) else 0)
    at = file.write(head)
    for offset, (_, body) in zip(offsets, bodies):
        at += file.write(bytes(offset - at))
        at += file.write(body.tobytes())
    file.write(bytes(offsets[-1] - at))
    for body, room in zip(stored, rooms.tolist()):
        file.write(body.data)
        file.write(bytes(room - len(body)))


def _objects(tree: Tree, transform: Array) -> Array:
    table = np.zeros(1, OBJECT_ENTRY)
    table["octree_to_mesh"], table["levels"], table["root_slot"] = transform, tree.levels, 2
    table["descriptors"], table["leaf_voxels"] = tree.descriptors, tree.leaf_voxels
    table["far_pointers"] = len(tree.images) - 1
    return table


def _blocks(tree: Tree) -> Array:
    """The block table, without what depends on the file."""
    table = np.zeros(len(tree.images), BLOCK_ENTRY)
    table["parent"] = [NO_PARENT, *tree.parents[1:]]
    table["cube_position"], table["cube_scale"] = tree.cubes()
    sizes = np.array([len(image) for image in tree.images], np.int64)
    table["image_offset"], table["image_size"] = np.cumsum(sizes) - sizes, sizes
    return table


def _replace(path: Union[str, os.PathLike[str]], write: Callable[[BinaryIO], None]) -> None:
    """Writes a file next to the path and renames it, so that no reader meets half a file."""
    final = os.path.abspath(os.fspath(path))
    temporary = f"{final}.{os.getpid()}.part"
    try:
        with open(temporary, "xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, final)
    except BaseException:
        with contextlib.suppress(OSError):
            os.remove(temporary)
        raise
