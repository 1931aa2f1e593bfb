"""Every test vector: the valid ones to every value of their JSON, the invalid ones to the rule in their name."""

import json

import pytest
from common import INVALID, INVALID_FOLDER, STREAMING, VALID, VECTORS, difference, facts

import esvo_reader
from esvo_reader import field

PARTS = sorted((VECTORS / "streaming").glob("*.esvo"))


def test_there_are_vectors():
    assert len(VALID) >= 107
    assert len(INVALID) >= 190
    assert len(STREAMING) >= 18


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_valid(path):
    expected = json.loads(path.with_suffix(".json").read_text("utf-8"))
    expected.pop("about")
    assert expected.pop("file") == path.name
    assert difference(facts(esvo_reader.open(path)), expected, path.name) is None
    assert esvo_reader.validate(path) == []


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_descriptors_without_a_walk_are_those_of_a_walk(path):
    octree = esvo_reader.open(path)
    walked = [
        node
        for number in range(len(octree.objects))
        for part in octree.walk(number)
        for node in zip(part["slot"].tolist(), part["word"].tolist())
    ]
    found = octree.descriptors()
    assert list(zip(octree.descriptor_slots().tolist(), found["word"].tolist())) == sorted(walked)
    assert found["valid_mask"].tolist() == field(found, "valid_mask").tolist()
    assert found["leaf_mask"].tolist() == field(found, "leaf_mask").tolist()
    assert found["contour_mask"].tolist() == field(found, "contour_mask").tolist()


@pytest.mark.parametrize("entry", STREAMING, ids=lambda entry: entry["part"].split(".")[0])
def test_streaming(entry):
    data = bytearray((VECTORS / "valid" / entry["file"]).read_bytes())
    octree = esvo_reader.from_bytes(bytes(data))
    places = [(int(b["file_offset"]), int(b["stored_size"])) for b in octree.blocks]
    assert [list(places[index]) for index in entry["blocks"]] == entry["ranges"]
    # What is in other blocks must not matter.
    for index, (offset, size) in enumerate(places):
        if index not in entry["blocks"]:
            data[offset : offset + size] = b"\xa5" * size
    octree = esvo_reader.from_bytes(bytes(data))
    if "level" in entry:
        assert octree.blocks_for(entry["low"], entry["high"], entry["level"], entry["object"]) == entry["blocks"]
    part = octree.part(entry["blocks"])
    expected = esvo_reader.open(VECTORS / "streaming" / entry["part"])
    assert part.validate() == expected.validate() == []
    sections = [bytes(part.section(tag)) for tag in (b"OBJT", b"BLKT", b"BLKS")]
    assert sections == [bytes(expected.section(tag)) for tag in (b"OBJT", b"BLKT", b"BLKS")]


@pytest.mark.parametrize("path", PARTS, ids=lambda path: path.stem)
def test_parts(path):
    expected = json.loads(path.with_suffix(".json").read_text("utf-8"))
    assert (expected.pop("about"), expected.pop("file"))[1] == path.name
    assert difference(facts(esvo_reader.open(path)), expected, path.name) is None


@pytest.mark.parametrize("entry", INVALID, ids=lambda entry: entry["file"].split(".")[0])
def test_invalid(entry):
    findings = esvo_reader.validate(INVALID_FOLDER / entry["file"])
    severity = {"must": "error", "should": "warning"}[entry["level"]]
    assert {(f.rule, f.severity) for f in findings} == {(entry["rule"], severity)}


@pytest.mark.parametrize("entry", INVALID, ids=lambda entry: entry["file"].split(".")[0])
def test_findings_point_into_the_file(entry):
    path = INVALID_FOLDER / entry["file"]
    assert all(0 <= f.offset <= path.stat().st_size for f in esvo_reader.validate(path))
