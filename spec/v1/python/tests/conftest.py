"""What several tests use."""

import pytest
from common import SPECIFICATION


@pytest.fixture(scope="module")
def program():
    """The program of appendix D: the leaf voxels of a file's bytes."""
    text = (SPECIFICATION / "README.md").read_text("utf-8")
    source = text.split("```python walk.py\n")[1].split("```")[0]
    names = {"__name__": "walk"}
    exec(compile(source, "walk.py", "exec"), names)
    return lambda data: list(names["walk"](*names["open_file"](data)))
