"""Every test vector: the valid ones to every value of their JSON, the invalid ones to the rule in their name."""

import json

import pytest
from common import INVALID, INVALID_FOLDER, VALID, difference, facts

import esvo_reader


def test_there_are_vectors():
    assert len(VALID) >= 89
    assert len(INVALID) >= 109


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
    assert list(zip(found["slot"].tolist(), found["word"].tolist())) == sorted(walked)


@pytest.mark.parametrize("entry", INVALID, ids=lambda entry: entry["file"].split(".")[0])
def test_invalid(entry):
    findings = esvo_reader.validate(INVALID_FOLDER / entry["file"])
    severity = {"must": "error", "should": "warning"}[entry["level"]]
    assert {(f.rule, f.severity) for f in findings} == {(entry["rule"], severity)}


@pytest.mark.parametrize("entry", INVALID, ids=lambda entry: entry["file"].split(".")[0])
def test_findings_point_into_the_file(entry):
    path = INVALID_FOLDER / entry["file"]
    assert all(0 <= f.offset <= path.stat().st_size for f in esvo_reader.validate(path))
