"""Weights that stand in files beside an ONNX file, as torch.onnx.export writes them: read, and put into the model.

A file names its data by a path. Only paths that stay inside the folder of the model are followed, links included, and
no more bytes are read than a model file may have (`--max-model-bytes`), however often the same ones are named.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath, PureWindowsPath

import onnx

from st_codegen.errors import InputError, errors_name
from st_codegen.files.text import file_sha256
from st_codegen.walkers.limits import check_size
from st_codegen.walkers.onnx.file import printable

_ADVICE = "keep the file with the weights beside the model, as it was exported"


def embed(model: onnx.ModelProto, path: Path, size: int) -> tuple[tuple[str, str], ...]:
    """Read the initializers of a model file of `size` bytes that stand in other files into the model.

    Returns the path of each of these files, relative to the folder of the model, and its SHA-256. Raises InputError
    for a path that leaves the folder, and for data that is missing, cut, or more than a model may have.
    """
    found: dict[str, Path] = {}
    for tensor in model.graph.initializer:
        if tensor.data_location != onnx.TensorProto.EXTERNAL:
            continue
        with errors_name(f"{path.name}: initializer '{printable(tensor.name)}'"):
            said = {entry.key: entry.value for entry in tensor.external_data}
            file = _inside(path.parent, said.get("location", ""))
            there = file.stat().st_size
            check_size(there)
            offset = _whole("offset", said.get("offset", "0"))
            length = _whole("length", said.get("length", str(max(there - offset, 0))))
            if offset + length > there:
                raise InputError(f"bytes {offset} to {offset + length} of {file.name}, which has {there}; {_ADVICE}")
            size += length
            check_size(size, "with the weights in other files")
            with file.open("rb") as stream:
                stream.seek(offset)
                tensor.raw_data = stream.read(length)
            tensor.ClearField("external_data")
            tensor.ClearField("data_location")
            found[PurePosixPath(said["location"]).as_posix()] = file
    return tuple((name, file_sha256(file)) for name, file in sorted(found.items()))


def _inside(folder: Path, location: str) -> Path:
    """The file at a relative path that does not leave a folder, links included."""
    shown = printable(location)
    plain = not any(kind(location).anchor or ".." in kind(location).parts for kind in (PurePosixPath, PureWindowsPath))
    if not location or "\0" in location or not plain:
        raise InputError(f"its numbers are in '{shown}', which is no path inside the folder of the model; {_ADVICE}")
    file = (folder / location).resolve()
    if not file.is_relative_to(folder.resolve()):
        raise InputError(f"its numbers are in '{shown}', a link that leaves the folder of the model; {_ADVICE}")
    if not file.is_file():
        raise InputError(f"its numbers are in '{shown}', which is not there; {_ADVICE}")
    return file


def _whole(name: str, text: str) -> int:
    if not re.fullmatch("[0-9]{1,18}", text):
        raise InputError(f"the {name} of its numbers is '{printable(text)}'; the model file is damaged")
    return int(text)
