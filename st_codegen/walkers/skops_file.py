"""`.skops` files: what is checked before skops opens them.

A `.skops` file is a zip archive with a tree of nodes in `schema.json` and arrays beside it. Nothing of the file reaches
skops before its sizes and its nodes are checked, and nothing of it reaches a parser of a library that is not Python:
boosters of LightGBM and XGBoost hold their model as one text, and are replaced by classes of ours that read that text
first (`STORED`); search trees of neighbours are replaced by their rows, and built anew. skops is given an archive of
ours in which each node stands alone, so that its work is linear.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UntrustedFileError, errors_name
from st_codegen.walkers.limits import Things, check_count, check_json, check_size

_SCHEMA = "schema.json"

#: Objects inside objects in the schema; a pipeline of forests needs about 30.
MAX_DEPTH = 200

_SEARCH_TREE = ("st_codegen.walkers.sklearn.neighbours", "StoredSearchTree")
#: Classes whose state native code would read, and the class of ours that takes the place of each in the file;
#: `*` stands for every class of a module.
STORED = {
    ("lightgbm.basic", "Booster"): ("st_codegen.walkers.lightgbm.model", "LightgbmBooster"),
    ("xgboost.core", "Booster"): ("st_codegen.walkers.xgboost.model", "XgboostBooster"),
    ("sklearn.neighbors._kd_tree", "KDTree"): _SEARCH_TREE,
    ("sklearn.neighbors._ball_tree", "BallTree"): _SEARCH_TREE,
    ("sklearn.metrics._dist_metrics", "*"): _SEARCH_TREE,
}

_NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def checked_archive(path: Path) -> bytes:
    """The archive that skops may open in place of the file.

    Raises InputError for a file that is damaged or larger than allowed, UntrustedFileError for one in which a booster
    is made by anything but its state.
    """
    # the list of members becomes objects when the archive is opened; each starts with these bytes
    check_count(path.read_bytes().count(b"PK\x01\x02"), Things.MEMBERS)
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: info for info in archive.infolist()}
        if len(members) != len(archive.infolist()):
            raise InputError("two members of the archive have one name")
        check_size(sum(info.file_size for info in members.values()), "unpacked")
        if _SCHEMA not in members:
            raise InputError(f"no {_SCHEMA} in the archive")
        schema = _read_schema(_unpacked(archive, members[_SCHEMA]))
        total = 0
        contents: dict[str, bytes] = {}
        for node in _nodes(schema):
            _prepare(node)
            name = node.get("file")
            if name is None:
                continue
            if not isinstance(name, str) or name not in members:
                raise InputError(f"the node of a {node['__class__']} names a member that is not in the archive")
            if name not in contents:
                contents[name] = _unpacked(archive, members[name])
                _check_member(contents[name], str(node["__loader__"]))
            # skops unpacks a member again for each node that names it
            total += len(contents[name])
            check_size(total, "unpacked")
    result = io.BytesIO()
    with zipfile.ZipFile(result, "w") as archive:
        for name, data in contents.items():
            archive.writestr(zipfile.ZipInfo(name), data)
        archive.writestr(zipfile.ZipInfo(_SCHEMA), json.dumps(schema))
    return result.getvalue()


def classes_in(archive: bytes) -> Iterator[tuple[str, str]]:
    """Package and name of the class of each object in an archive of `checked_archive`, the outer ones first."""
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        schema = json.loads(opened.read(_SCHEMA))
    for node in _nodes(schema):
        yield node["__module__"].partition(".")[0], node["__class__"]


def _unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """A member; no more than its declared size is unpacked, whatever it holds."""
    with archive.open(info) as stream:
        data = stream.read(info.file_size + 1)
    if len(data) != info.file_size:
        raise InputError(f"{info.filename}: the archive declares {info.file_size} bytes, but holds {len(data)}")
    return data


def _read_schema(data: bytes) -> dict[str, Any]:
    """The tree of nodes, after its objects and list entries were counted."""
    with errors_name(_SCHEMA):
        check_json(data)
    try:
        schema = json.loads(data)
    except RecursionError:
        raise InputError(f"{_SCHEMA}: nested too deep") from None
    except ValueError as error:
        raise InputError(f"{_SCHEMA}: not a JSON document: {error}") from None
    if not isinstance(schema, dict):
        raise InputError(f"{_SCHEMA}: not an object")
    return schema


def _nodes(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All nodes of the tree, each after its identity was taken away: objects shared in the file become copies.

    Identities let a small file describe a tree of any size, as each mention of a node is visited by skops.
    """
    waiting: list[tuple[Any, int]] = [(schema, 0)]
    while waiting:
        value, depth = waiting.pop()
        if depth > MAX_DEPTH:
            raise InputError(f"{_SCHEMA}: nested more than {MAX_DEPTH} deep")
        if isinstance(value, dict):
            # a key of a dictionary in the model may have any name, so a node is what has all three
            if {"__class__", "__module__", "__loader__"} <= value.keys():
                value.pop("__id__", None)
                yield value
            waiting += [(entry, depth + 1) for entry in value.values()]
        elif isinstance(value, list):
            waiting += [(entry, depth + 1) for entry in value]


def _prepare(node: dict[str, Any]) -> None:
    """Check the words of a node, and put a class of ours in place of one that native code reads."""
    kind, module, loader = node["__class__"], node["__module__"], node["__loader__"]
    if not all(isinstance(word, str) for word in (kind, module, loader)):
        raise InputError(f"{_SCHEMA}: a node whose class, module or loader is no text")
    stored = STORED.get((module, kind)) or STORED.get((module, "*"))
    if stored is None:
        return
    if loader != "ObjectNode":
        raise UntrustedFileError(f"the file makes a {module}.{kind} with {loader}, which could run code")
    node["__module__"], node["__class__"] = stored


def _check_member(data: bytes, loader: str) -> None:
    """Sizes that a member declares inside: arrays, and the archives in which scipy keeps sparse matrices."""
    if loader == "NdArrayNode":
        stream = io.BytesIO(data)
        version = np.lib.format.read_magic(stream)
        if version not in _NPY_HEADERS:
            raise InputError(f"an array of NumPy's format {version}")
        shape, _, dtype = _NPY_HEADERS[version](stream)
        size = dtype.itemsize
        for length in shape:
            size *= length
        if dtype.hasobject or size != len(data) - stream.tell():
            raise InputError(f"an array of shape {shape} and type {dtype} that does not fill its member")
    elif loader == "SparseMatrixNode":
        with zipfile.ZipFile(io.BytesIO(data)) as inner:
            check_size(sum(info.file_size for info in inner.infolist()), "unpacked")
