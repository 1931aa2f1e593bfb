"""Files that the package writes: read back by its own reader, by the program of appendix D, and by the program esvo.

ESVO_PROGRAM is the path of the latter; without it, that test is left out.
"""

import io
import os
import subprocess

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

import esvo_reader
from esvo_reader import kinds, trees, write_grid, write_voxels

PROGRAM = os.environ.get("ESVO_PROGRAM")


def written(*arguments, **options):
    """The bytes of a file of `write_voxels`."""
    file = io.BytesIO()
    write_voxels(file, *arguments, **options)
    return file.getvalue()


def by_position(values, positions):
    return {tuple(p): value for p, value in zip(np.asarray(positions).tolist(), np.asarray(values).tolist())}


def cells(octree, voxels, level):
    """Positions of voxels in units of the edge of a level."""
    assert (voxels.level == level).all()
    return voxels.position >> (23 - level)


def check(data, positions, colors=None, normals=None, origin=None):
    """Asserts that a file is sound and has these voxels. Colours are uint8 (n, 4)."""
    octree = esvo_reader.from_bytes(data)
    assert octree.validate() == []
    levels = int(octree.objects["levels"][0])
    leaves = octree.leaves()
    assert len(leaves) == len(positions)
    corner = np.min(positions, axis=0) if origin is None else np.asarray(origin)
    found = cells(octree, leaves, levels) + corner
    assert set(map(tuple, found.tolist())) == set(map(tuple, np.asarray(positions).tolist()))
    matrix = octree.octree_to_mesh()
    assert np.array_equal(leaves.center @ matrix[:3, :3].T + matrix[:3, 3], found + 0.5)
    if colors is not None:
        alpha = np.ones(len(leaves)) if leaves.alpha is None else np.where(np.isnan(leaves.alpha), 1, leaves.alpha)
        assert by_position(np.rint(np.c_[leaves.color, alpha] * 255), found) == by_position(colors, positions)
    if normals is not None:
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        wanted = by_position(np.where(length > 0, normals / np.where(length > 0, length, 1), (0, 0, 1)), positions)
        cosine = [np.dot(n, wanted[p]) for p, n in by_position(leaves.normal, found).items()]
        # Half a step of 2^-13 along v, and what the largest v is short of 1.
        assert np.arccos(np.clip(cosine, -1, 1)).max() < 2e-4
    for level in range(1, levels + 1):
        check_level(octree, level, levels, positions - corner, colors, normals)
    return octree


def check_level(octree, level, levels, cell, colors, normals):
    """Asserts that the voxels of a level have the means of what is below them."""
    voxels = octree.leaves(level)
    above, member = np.unique(cell >> (levels - level), axis=0, return_inverse=True)
    member = member.reshape(-1)
    place = by_position(range(len(above)), above)
    rows = [place[tuple(p)] for p in cells(octree, voxels, level).tolist()]
    assert sorted(rows) == list(range(len(above)))
    if colors is not None:
        opacity = colors[:, 3] / 255
        weight = np.bincount(member, opacity)
        for channel in range(3):
            mean = np.bincount(member, opacity * colors[:, channel]) / np.where(weight > 0, weight, 1)
            some = weight[rows] > 0
            assert np.abs(voxels.color[some, channel] * 255 - mean[rows][some]).max(initial=0) <= 0.5 + 1e-9
    if normals is not None:
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        unit = np.where(length > 0, normals / np.where(length > 0, length, 1), (0, 0, 1))
        mean = np.stack([np.bincount(member, unit[:, axis]) for axis in range(3)], axis=1)[rows]
        size = np.linalg.norm(mean, axis=1)
        some = size > 1e-2
        cosine = (voxels.normal * mean).sum(axis=1)[some] / size[some]
        assert np.arccos(np.clip(cosine, -1, 1)).max(initial=0) < 1e-3


@st.composite
def voxel_sets(draw):
    """Arguments of `write_voxels`, and how many slots make a block."""
    levels = draw(st.integers(1, 5))
    rng = np.random.default_rng(draw(st.integers(0, 1 << 32)))
    count = draw(st.integers(1, min(300, 8**levels)))
    cell = rng.choice(8**levels, count, replace=False)
    origin = rng.integers(-1000, 1000, 3)
    positions = np.stack([cell >> levels * axis & (1 << levels) - 1 for axis in range(3)], axis=1) + origin
    palette = rng.integers(0, 256, (draw(st.sampled_from([1, 2, 300])), 4), np.uint8)
    if draw(st.booleans()):
        palette[:, 3] = 255
    colors = draw(st.sampled_from([None, palette[rng.integers(0, len(palette), count)]]))
    directions = rng.normal(size=(draw(st.sampled_from([1, 300])), 3))
    directions[rng.random(len(directions)) < 0.1] = draw(st.sampled_from([(0, 0, 0), (1, 1, 1), (-1, 0, 0), (0, 0, 1)]))
    normals = draw(st.sampled_from([None, directions[rng.integers(0, len(directions), count)]]))
    options = draw(st.sampled_from([{}, {"origin": origin.tolist(), "levels": draw(st.integers(levels, 23))}]))
    return positions, colors, normals, options, draw(st.sampled_from([1, 4, 40, trees.BLOCK_SLOTS]))


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(voxel_sets())
def test_any_voxels(program, case):
    positions, colors, normals, options, block_slots = case
    usual, trees.BLOCK_SLOTS = trees.BLOCK_SLOTS, block_slots
    try:
        data = written(positions, colors, normals, **options)
        order = np.random.default_rng(1).permutation(len(positions))
        shades = (None if rows is None else rows[order] for rows in (colors, normals))
        assert written(positions[order], *shades, **options) == data
        packed = written(positions, colors, normals, compression=3, **options)
    finally:
        trees.BLOCK_SLOTS = usual
    octree = check(data, positions, colors, normals, options.get("origin"))
    assert len(program(data)) == len(positions)
    again = esvo_reader.from_bytes(packed)
    assert again.validate() == []
    assert len(again.blocks) == len(octree.blocks)
    for index in range(len(octree.blocks)):
        assert np.array_equal(again.block(index).image, octree.block(index).image)


def shell(edge):
    """The voxels of a hollow sphere, with colours and normals."""
    axis = np.arange(edge) - (edge - 1) / 2
    radius = np.sqrt(sum(np.meshgrid(*[axis**2] * 3, indexing="ij", sparse=True)))
    positions = np.argwhere(np.abs(radius - 0.48 * edge) < 0.8)
    colors = np.c_[positions * 255 // edge, np.full(len(positions), 255)].astype(np.uint8)
    return positions, colors, positions - (edge - 1) / 2


def test_several_blocks(program, monkeypatch):
    monkeypatch.setattr(trees, "BLOCK_SLOTS", 500)
    positions, colors, normals = shell(64)
    octree = check(written(positions, colors, normals), positions, colors, normals)
    assert len(octree.blocks) > 8
    assert program(octree.data.tobytes())
    packed = esvo_reader.from_bytes(written(positions, colors, normals, compression=3))
    assert packed.validate() == []
    assert len(packed.data) < len(octree.data)
    frames = packed.blocks[packed.blocks["codec"] == 1]
    assert len(frames) > 4
    for entry in frames:
        frame = packed.data[int(entry["file_offset"]) :][: int(entry["stored_size"])].tobytes()
        parameters = zstandard.get_frame_parameters(frame)
        assert parameters.content_size == entry["image_size"]
        assert not parameters.has_checksum


@pytest.mark.parametrize("chance", [0.2, 1.0])
def test_child_pointers_reach_all_of_a_block(chance):
    there = np.random.default_rng(3).random((64, 64, 64)) < chance
    positions = np.argwhere(there)
    octree = esvo_reader.from_bytes(written(positions, origin=(0, 0, 0)))
    assert octree.validate() == []
    assert len(octree.leaves()) == len(positions)
    assert max(len(octree.block(k).slots) for k in range(len(octree.blocks))) <= 1 << 15
    assert octree.objects["far_pointers"][0] == len(octree.blocks) - 1 > 0


def test_deepest_level():
    positions = np.array([(0, 0, 0), (1, 0, 0), ((1 << 23) - 1,) * 3, (1 << 22, 5, 1 << 21)])
    octree = check(written(positions, (200, 100, 50)), positions)
    assert octree.objects["levels"][0] == 23
    # The order of paths above 21 levels.
    assert octree.leaves().position.tolist() == [positions[k].tolist() for k in (0, 1, 3, 2)]


def test_one_voxel():
    octree = check(written([(7, -8, 9)], (1, 2, 3)), np.array([(7, -8, 9)]), np.array([(1, 2, 3, 255)]))
    assert octree.objects["levels"][0] == 1
    assert list(octree.block(0).attachments) == [kinds.CONSTANT_COLOR]


def test_constant_colors_and_plain_ones_side_by_side(monkeypatch):
    monkeypatch.setattr(trees, "BLOCK_SLOTS", 500)
    positions, _, _ = shell(64)
    colors = np.where(positions[:, :1] < 34, (10, 20, 30), positions).astype(np.uint8)
    octree = check(written(positions, colors), positions, np.c_[colors, np.full(len(colors), 255)])
    found = {kind for k in range(len(octree.blocks)) for kind in octree.block(k).attachments}
    assert found == {kinds.CONSTANT_COLOR, kinds.PLAIN_COLORS}


def test_alpha_is_stored():
    octree = esvo_reader.from_bytes(written([(0, 0, 0), (1, 0, 0)], (0.2, 0.4, 0.6, 0.5)))
    assert octree.leaves().alpha.tolist() == [128 / 255] * 2


def test_values_that_voxels_share_are_stored_once():
    positions = np.argwhere(np.ones((2, 2, 2), bool))
    colors = np.array([(9, 9, 9)] * 5 + [(1, 1, 1), (2, 2, 2), (3, 3, 3)], np.uint8)
    block = esvo_reader.from_bytes(written(positions, colors)).block(0)
    assert len(block.words(kinds.PLAIN_COLORS)) - len(block.slots) == 4


def test_metadata_and_matrix():
    matrix = np.array([(0, -2, 0, 1), (2, 0, 0, 2), (0, 0, 2, 3), (0, 0, 0, 1)], float)
    octree = esvo_reader.from_bytes(written([(4, 5, 6)], matrix=matrix, metadata={"title": "é"}))
    assert octree.validate() == []
    assert octree.metadata == {"title": "é"}
    assert (octree.octree_to_mesh() @ (0.25, 0.25, 0.25, 1)).tolist() == (matrix @ (4.5, 5.5, 6.5, 1)).tolist()


def test_grid():
    rng = np.random.default_rng(5)
    colors = rng.integers(0, 256, (5, 3, 9, 4), np.uint8)
    colors[rng.random(colors.shape[:3]) < 0.5] = 0
    there = colors[..., 3] > 0
    file = io.BytesIO()
    write_grid(file, colors)
    octree = check(file.getvalue(), np.argwhere(there), colors[there], origin=(0, 0, 0))
    assert octree.objects["levels"][0] == 4
    file = io.BytesIO()
    write_grid(file, colors[..., :3], np.ones((*colors.shape[:3], 3)), occupied=there)
    opaque = np.c_[colors[there][:, :3], np.full(there.sum(), 255)]
    check(file.getvalue(), np.argwhere(there), opaque, np.ones((there.sum(), 3)), origin=(0, 0, 0))
    file = io.BytesIO()
    write_grid(file, np.where(there[..., None], np.float32(0.5), np.float32(0)) * np.ones(3, np.float32))
    check(file.getvalue(), np.argwhere(there), np.full((there.sum(), 4), (128, 128, 128, 255)), origin=(0, 0, 0))
    file = io.BytesIO()
    write_grid(file, None, (0, 1, 0), occupied=there)
    octree = check(file.getvalue(), np.argwhere(there), None, np.full((there.sum(), 3), (0, 1, 0)), origin=(0, 0, 0))
    assert octree.leaves().color is None


def test_the_comparison_finds_a_wrong_color():
    positions, colors, _ = shell(12)
    changed = colors.copy()
    changed[7, 1] ^= 1
    with pytest.raises(AssertionError):
        check(written(positions, changed), positions, colors)
    with pytest.raises(AssertionError):
        check(written(positions[1:], colors[1:]), positions, colors)


POINT = [(0, 0, 0)]


@pytest.mark.parametrize(
    ("arguments", "options", "error"),
    [
        ((np.zeros((0, 3), int),), {}, "at least one"),
        (([(0, 0)],), {}, "shape"),
        (([(0.0, 0.0, 0.0)],), {}, "integers"),
        (([(0, 0, 0), (1, 2, 3), (0, 0, 0)],), {}, r"\[0, 0, 0\] occurs"),
        (([(0, 0, 0), (1 << 23, 0, 0)],), {}, "24 levels"),
        (([(-(1 << 63), 0, 0), ((1 << 63) - 1, 0, 0)],), {}, "64 levels"),
        ((POINT,), {"origin": (1, 0, 0)}, "before the origin"),
        ((POINT,), {"origin": (-(1 << 80), 0, 0)}, "levels"),
        ((POINT,), {"origin": (0.5, 0, 0)}, "integer"),
        (([(0, 0, 0), (9, 0, 0)],), {"levels": 3}, "do not fit"),
        ((POINT,), {"levels": 24}, "24 levels"),
        ((POINT, [(1, 2, 3)] * 2), {}, "colors of 2"),
        ((POINT, [(1, 2)]), {}, "shape"),
        ((POINT, [(1, 2, 256)]), {}, "0 to 255"),
        ((POINT, [(0.5, 0.5, 1.1)]), {}, "0 to 1"),
        ((POINT, [(0.5, 0.5, np.nan)]), {}, "0 to 1"),
        ((POINT, [(True, True, True)]), {}, "bool"),
        ((POINT, None, [(0, np.inf, 0)]), {}, "finite"),
        ((POINT, None, [(0, 0)]), {}, "shape"),
        ((POINT,), {"matrix": np.zeros((4, 4))}, "invertible"),
        ((POINT,), {"matrix": np.eye(3)}, "shape"),
        ((POINT,), {"compression": 20}, "1 to 19"),
        ((POINT,), {"metadata": {"title": "\ud800"}}, "surrogate"),
        ((POINT,), {"metadata": {"x": float("nan")}}, "JSON"),
        ((POINT,), {"metadata": ["x"]}, "JSON object"),
    ],
)
def test_wrong_arguments(tmp_path, arguments, options, error):
    path = tmp_path / "kept.esvo"
    path.write_bytes(b"as it was")
    with pytest.raises((ValueError, TypeError), match=error):
        write_voxels(path, *arguments, **options)
    assert [p.name for p in tmp_path.iterdir()] == ["kept.esvo"]
    assert path.read_bytes() == b"as it was"


@pytest.mark.parametrize("arguments", [(None,), ((1, 2, 3),), (np.zeros((2, 2, 3)),), (np.zeros((2, 2, 2, 3)),)])
def test_wrong_grids(arguments):
    with pytest.raises(ValueError, match=r"expected colors|at least one"):
        write_grid(io.BytesIO(), *arguments)
    with pytest.raises(ValueError, match=r"occupied|expected"):
        write_grid(io.BytesIO(), *arguments, occupied=np.ones((3, 2, 2)))


def test_a_file_is_whole_or_not_there(tmp_path, monkeypatch):
    path = tmp_path / "a.esvo"
    write_voxels(path, POINT)
    whole = path.read_bytes()
    assert whole == written(POINT)

    def fail(_):
        raise OSError("no space")

    with monkeypatch.context() as patch, pytest.raises(OSError, match="no space"):
        patch.setattr(os, "fsync", fail)
        write_voxels(path, [(0, 0, 0), (1, 1, 1)])
    assert [p.name for p in tmp_path.iterdir()] == ["a.esvo"]
    assert path.read_bytes() == whole
    with pytest.raises(FileNotFoundError):
        write_voxels(tmp_path / "none" / "a.esvo", POINT)


@pytest.mark.skipif(not PROGRAM, reason="ESVO_PROGRAM does not name the program esvo")
def test_the_program_finds_no_broken_rule(tmp_path):
    positions, colors, normals = shell(120)
    path = tmp_path / "written.esvo"

    def validate():
        return subprocess.run([PROGRAM, "validate", str(path)], capture_output=True, text=True)

    cases = [
        ((POINT,), {}),
        ((positions, colors, normals), {"metadata": {"title": "shell", "generator": "test"}}),
        ((positions, colors, normals), {"compression": 9}),
        ((positions, (1, 2, 3)), {"origin": (-5, -5, -5), "levels": 20}),
        ((positions * 50000, colors), {"matrix": np.diag([2, 1, -1, 1])}),
    ]
    for arguments, options in cases:
        write_voxels(path, *arguments, **options)
        result = validate()
        assert result.returncode == 0, result
        assert "warning" not in result.stdout + result.stderr
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    assert validate().returncode != 0
