"""Model files by their suffix."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
from pathlib import Path

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import load_pickle, load_skops

#: Suffix -> module with a function `load_file(path, name)`.
_MODULES = {
    ".onnx": "st_codegen.walkers.onnx.load",
    ".txt": "st_codegen.walkers.lightgbm.model",
    ".json": "st_codegen.walkers.xgboost.model",
    ".ubj": "st_codegen.walkers.xgboost.model",
    ".xml": "st_codegen.beckhoff_ml.model",
}
_PICKLES = (".joblib", ".pkl", ".pickle")

#: What a folder of models may contain, with the suffixes of each kind.
SUFFIXES = (*_MODULES, ".skops", *_PICKLES)
KNOWN_FORMATS = (
    ".onnx, .txt (LightGBM), .json and .ubj (XGBoost), .xml (TwinCAT machine learning), .skops, and .joblib or .pkl "
    "with --trust-pickle"
)


def load_model(path: Path, name: str, *, trust_pickle: bool = False) -> LoadedModel:
    """Load a model file and fill in where it comes from.

    Raises InputError (naming the file) for files that cannot be read or used, UntrustedFileError for pickles that are
    not trusted, MissingExtraError where the library to read the format is not installed.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path.name}: no such file in {path.parent}")
    if suffix in _PICKLES:
        loaded = load_pickle(path, name, trusted=trust_pickle)
    elif suffix == ".skops":
        loaded = load_skops(path, name)
    elif suffix in _MODULES:
        loaded = importlib.import_module(_MODULES[suffix]).load_file(path, name)
    else:
        raise UnsupportedModelError(f"{path.name}: not a known model format; supported are {KNOWN_FORMATS}")
    source = dataclasses.replace(loaded.ir.source, file=path.name, sha256=_sha256(path))
    return LoadedModel(dataclasses.replace(loaded.ir, source=source), loaded.predict)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
