"""What the package promises apart from the vectors: laziness, bounds, levels of detail, command line, README."""

import doctest
import re
import subprocess
import sys
import time

import numpy as np
import pytest
import zstandard
from common import INVALID_FOLDER, PACKAGE, SPECIFICATION, VALID, open_vector
from test_mutations import with_checksums

import esvo_reader
from esvo_reader import EsvoError, field, kinds, records
from esvo_reader.blocks import decompress
from esvo_reader.octree import mark_far_pointers

GIB = 1 << 30


def change(data, dtype, at, **fields):
    """Sets fields of a record in a file."""
    record = np.frombuffer(data, dtype, 1, at)
    for name, value in fields.items():
        record[name] = value


@pytest.fixture
def big_file(tmp_path):
    """An octree of one voxel in a file of 1 GiB: its block is as large, and almost all of it a hole of the file."""
    data = bytearray((SPECIFICATION / "vectors" / "valid" / "single_voxel.esvo").read_bytes())
    octree = esvo_reader.from_bytes(bytes(data))
    start, blocks_at = int(octree.header["directory_offset"]), octree.block_entry_offset(0, "object")
    number = octree.sections["tag"].tolist().index(b"BLKS")
    at = int(octree.sections["offset"][number])
    change(data, records.SECTION_ENTRY, start + 32 * number, length=GIB - at)
    change(data, records.BLOCK_ENTRY, blocks_at, image_size=GIB - at, stored_size=GIB - at)
    change(data, records.HEADER, 0, file_length=GIB)
    path = tmp_path / "big.esvo"
    with path.open("wb") as file:
        file.write(with_checksums(data))
        file.truncate(GIB)
    return path


def test_a_file_of_a_gibibyte_opens_at_once(big_file):
    begin = time.perf_counter()
    octree = esvo_reader.open(big_file)
    block = octree.block(0)
    assert len(octree.leaves()) == 1
    assert len(octree.descriptors()) == 1
    assert time.perf_counter() - begin < 0.5
    assert len(block.image) > GIB - (1 << 20)
    assert np.shares_memory(block.slots, octree.data)


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_children_lead_where_a_walk_goes(path):
    octree = esvo_reader.open(path)
    for number in range(len(octree.objects)):
        found, stack = [], [int(octree.objects["root_slot"][number])]
        while stack:
            slot = stack.pop()
            d = octree.descriptor(slot)
            found.append((slot, *d))
            below = octree.children(slot)
            assert [s >= 0 for s in below.tolist()] == [bool(d.nonleaf_mask >> i & 1) for i in range(8)]
            stack += below[below >= 0].tolist()
        names = list(records.CHILD_DESCRIPTOR)
        walked = [
            tuple(row)
            for part in octree.walk(number)
            for row in np.stack([part["slot"], *(field(part, name) for name in names)], axis=1).tolist()
        ]
        assert sorted(found) == sorted(walked)


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_leaves_of_any_level_fill_what_the_deeper_ones_do(path):
    octree = esvo_reader.open(path)
    for number in range(len(octree.objects)):
        finest = octree.leaves(number=number)
        levels = int(octree.objects["levels"][number])
        assert len(finest) == octree.objects["leaf_voxels"][number]
        assert finest.leaf.all()
        for level in range(1, levels + 1):
            cut = octree.leaves(level, number)
            assert cut.level.max() <= level
            # Leaves and voxels of the level are the cubes that hold all leaves.
            shift = np.uint32(23) - np.minimum(finest.level, level).astype(np.uint32)
            above = np.unique(
                np.c_[np.minimum(finest.level, level), finest.position >> shift[:, None] << shift[:, None]], axis=0
            )
            assert np.array_equal(np.unique(np.c_[cut.level, cut.position], axis=0), above)


def test_a_level_reads_only_the_blocks_that_it_needs():
    octree = open_vector("levels_23_blocks")
    octree.leaves(1)
    assert list(octree._kept) == [0]
    octree.leaves()
    assert len(octree._kept) == len(octree.blocks) > 1


def test_places_and_sizes_are_in_octree_space():
    leaves = open_vector("single_voxel").leaves()
    assert leaves.size.tolist() == [0.5]
    assert (leaves.center - leaves.lower).tolist() == [[0.25, 0.25, 0.25]]


def test_corners_at_any_point():
    leaves = open_vector("corners").leaves()
    own = leaves.corners_of == 1
    assert own.any()
    for k in range(8):
        point = np.array([k & 1, k >> 1 & 1, k >> 2], float)
        color, alpha, _ = esvo_reader.interpolate_corners(leaves.corners, leaves.corners_of, leaves.child, point)
        stored = np.ascontiguousarray(leaves.corners[:, k, 0])[:, None].view(np.uint8) / 255
        # At a corner only that corner counts; where its alpha is 0, nothing does.
        there = own & (stored[:, 3] > 0)
        assert np.allclose(color[there], stored[there, :3], rtol=0, atol=1e-15)
        assert np.isnan(alpha[own & (stored[:, 3] == 0)]).all()


def test_arrays_of_a_file_are_read_only():
    octree = open_vector("colors")
    for array in (octree.objects, octree.blocks, octree.block(0).slots, octree.block(0).words(kinds.COLOR_BLOCKS)):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_the_image_has_all_blocks():
    octree = open_vector("two_objects_three_blocks")
    image = octree.image
    assert np.shares_memory(image, octree.data)
    assert np.array_equal(image, np.concatenate([octree.block(k).image for k in range(len(octree.blocks))]).view("<u8"))
    found = octree.descriptors()
    assert np.array_equal(image[octree.descriptor_slots()], found["word"])
    with pytest.raises(ValueError, match="compressed"):
        _ = open_vector("compressed").image


def test_voxels_of_level_23_must_not_be_split():
    data = bytearray(open_vector("levels_23").data.tobytes())
    octree = esvo_reader.from_bytes(bytes(data))
    deepest = [int(nodes["slot"][nodes["level"] == 22][0]) for nodes in octree.walk()]
    at = octree.block(0).at(8 * deepest[0])
    data[at] = 0
    findings = esvo_reader.from_bytes(bytes(with_checksums(data))).validate()
    assert [f.rule for f in findings] == ["C002"]


def test_far_pointers_that_look_like_descriptors():
    words = np.zeros(16, np.uint64)
    words[2] = 1 << 8 | 1 << 16 | 1 << 17  # a descriptor with a far pointer, one slot after it
    words[3] = 1 << 16 | 3 << 17  # the far pointer; as a descriptor it would have one at slot 6
    words[6] = 1 << 8 | 1
    far = np.zeros(16, bool)
    mark_far_pointers(words, 0, far)
    assert np.flatnonzero(far).tolist() == [3]


@pytest.mark.parametrize("name", ["K002_1", "K002_2", "A007_2", "A007_5"])
def test_reading_checks_what_it_follows(name):
    octree = esvo_reader.open(INVALID_FOLDER / f"{name}.esvo")
    with pytest.raises(EsvoError) as error:
        [octree.voxels(nodes) for nodes in octree.walk()]
    assert error.value.rule == name[:4]


def test_compressed_blocks_are_bounded():
    octree = esvo_reader.from_bytes(open_vector("compressed").data.tobytes(), max_block_bytes=4096)
    with pytest.raises(EsvoError) as error:
        octree.block(0)
    assert error.value.rule == "LIMIT"


@pytest.mark.parametrize("level", [1, 19])
def test_frames_must_be_whole_alone_and_of_the_size(level):
    content = np.random.default_rng(1).integers(0, 7, 40960, np.uint8).tobytes()
    for with_size in (False, True):
        frame = zstandard.ZstdCompressor(level=level, write_content_size=with_size).compress(content)
        assert decompress(frame, len(content)) == content
        skippable = b"\x50\x2a\x4d\x18\x04\0\0\0abcd"
        for bad in (frame[:-1], frame + b"\0", frame + frame, skippable + frame, frame + skippable, b"", frame[:5]):
            with pytest.raises((ValueError, zstandard.ZstdError)):
                decompress(bad, len(content))
        for size in (len(content) - 1, len(content) + 1, 1 << 40):
            with pytest.raises((ValueError, zstandard.ZstdError, MemoryError)):
                decompress(frame, size)


def test_wrong_arguments():
    octree = open_vector("single_voxel")
    for call in (
        lambda: octree.block(1),
        lambda: octree.descriptor(0),
        lambda: octree.descriptor(1 << 40),
        lambda: octree.children(-1),
        lambda: octree.leaves(number=1),
    ):
        with pytest.raises(IndexError):
            call()
    with pytest.raises(ValueError, match="expected 1 to 23"):
        octree.leaves(24)


def test_metadata():
    assert open_vector("single_voxel").metadata == {}
    assert open_vector("meta").metadata != {}


def test_scene():
    assert open_vector("single_voxel").instances is None
    octree = open_vector("instances")
    assert octree.instances["object"].tolist() == [0, 1, 1, 0]
    assert (octree.mesh_to_scene(0) == np.eye(4)).all()
    assert (octree.mesh_to_scene(1) @ [1, 2, 3, 1]).tolist() == [10, 7, 10, 1]
    with pytest.raises(IndexError):
        open_vector("single_voxel").mesh_to_scene(0)


def test_a_bit_outside_of_all_checksums_is_found_by_the_sha256():
    data = bytearray((SPECIFICATION / "vectors" / "valid" / "hash_without_id.esvo").read_bytes())
    at = data.index(b"\xff" * 33)
    data[at] ^= 1
    assert [f.rule for f in esvo_reader.from_bytes(bytes(data)).validate()] == ["F002"]


def run(*arguments):
    return subprocess.run([sys.executable, "-m", "esvo_reader", *map(str, arguments)], capture_output=True, text=True)


def test_command_line():
    vectors = SPECIFICATION / "vectors"
    sound, broken = vectors / "valid" / "colors.esvo", vectors / "invalid" / "K003_1.esvo"
    assert run("validate", sound).returncode == 0
    result = run("validate", sound, broken)
    assert result.returncode == 1
    assert "error K003 at byte" in result.stdout
    assert run("validate", vectors / "invalid" / "A006_1.esvo").returncode == 0
    result = run("info", sound)
    assert result.returncode == 0
    assert "section 'OBJT'" in result.stdout
    assert run("info", vectors / "invalid" / "H005_1.esvo").returncode == 1
    assert run("info", vectors / "no such file").returncode == 2
    assert run("info", *VALID).returncode == 0


def test_examples_of_the_readme(tmp_path, monkeypatch):
    text = (PACKAGE / "README.md").read_text("utf-8")
    examples = re.findall(r"```pycon\n(.*?)```", text, re.DOTALL)
    assert examples
    (tmp_path / "colors.esvo").write_bytes(open_vector("colors").data.tobytes())
    (tmp_path / "served.esvo").write_bytes(open_vector("parts_levels").data.tobytes())
    monkeypatch.chdir(tmp_path)
    test = doctest.DocTestParser().get_doctest("".join(examples), {}, "README.md", None, None)
    assert doctest.DocTestRunner().run(test).failed == 0
    assert test.examples
