"""What is remembered of a text is what reading it gives, under the path that is asked for."""

from pathlib import Path

import numpy as np
import pytest

from st_codegen.st import tree
from st_codegen.st.errors import StSyntaxError
from st_codegen.st.syntax import source
from tests.reading import Remembered

GOLDEN = Path(__file__).resolve().parents[1] / "golden"
#: The largest file of each kind below a size that takes long.
FILES = {
    suffix: max(
        (path for path in GOLDEN.rglob("*") if path.suffix.lower() == suffix and path.stat().st_size < 50_000),
        key=lambda path: (path.stat().st_size, path),
    )
    for suffix in (".st", ".scl", ".tcpou", ".tcgvl", ".tcdut", ".xml")
}


def all_of(thing):
    """All that a tree says, its positions as well."""
    if isinstance(thing, tuple | list):
        return [all_of(part) for part in thing]
    if isinstance(thing, np.ndarray):
        return thing.dtype, thing.tolist()
    return (type(thing), all_of(sorted(vars(thing).items()))) if isinstance(thing, tree.Node) else thing


@pytest.mark.parametrize("suffix", FILES)
def test_what_is_remembered_is_what_would_be_read(suffix):
    read, content = source._read_one.read, FILES[suffix].read_bytes()
    asked = []
    remembered = Remembered(lambda *file: asked.append(file) or read(*file))
    for folder in ("one", "another/two"):
        path = f"{folder}/{FILES[suffix].name}"
        declarations, scans = remembered(path, content)
        expected = read(path, content)
        assert all_of(declarations) == all_of(expected[0]) and scans == expected[1]
        assert all(item.position.file == path for item in declarations)
    assert len(asked) == 1


def test_other_bytes_another_name_and_errors_are_read_anew():
    text = b"FUNCTION_BLOCK A\nEND_FUNCTION_BLOCK"
    remembered = Remembered(source._read_one.read)
    first = remembered("a.st", text)[0][0]
    assert first.position.line == 1 and remembered("a.st", b"\n" + text)[0][0].position.line == 2
    assert remembered("GVL_A.st", b"VAR_GLOBAL\nx : INT;\nEND_VAR")[0][0].name == "GVL_A"
    assert remembered("GVL_B.st", b"VAR_GLOBAL\nx : INT;\nEND_VAR")[0][0].name == "GVL_B"
    for path in ("a.st", "b/a.st"):
        with pytest.raises(StSyntaxError, match=f"^{path}:1:1: "):
            remembered(path, b"x")
