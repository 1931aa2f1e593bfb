"""The program in appendix D of the specification does what the text says."""

import json

import pytest
from common import INVALID, INVALID_FOLDER, VALID


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_leaf_voxels(program, path):
    expected = json.loads(path.with_suffix(".json").read_text("utf-8"))
    if expected["required_features"]:
        with pytest.raises(SystemExit, match="H003"):
            program(path.read_bytes())
        return
    leaves = [
        (number, node["level"] + 1, node["path"] + str(voxel["slot"]))
        for number, o in enumerate(expected["objects"])
        for node in o["nodes"]
        for voxel in node["voxels"]
        if voxel["leaf"]
    ]
    found = program(path.read_bytes())
    assert sorted((number, level, path) for number, level, _, path in found) == sorted(leaves)
    for _, level, position, path in found:
        bits = [[int(digit) >> axis & 1 for digit in path] for axis in range(3)]
        assert list(position) == [sum(b << 22 - k for k, b in enumerate(axis)) for axis in bits]
        assert level == len(path)


@pytest.mark.parametrize("entry", INVALID, ids=lambda entry: entry["file"].split(".")[0])
def test_refusals(program, entry):
    """It names the rule, or does not check it; nothing else happens."""
    data = (INVALID_FOLDER / entry["file"]).read_bytes()
    try:
        program(data)
    except SystemExit as refusal:
        assert str(refusal).split()[-1] in {entry["rule"], "H003"}
    else:
        assert entry["rule"][0] not in "HC"
