"""Model files by their suffix."""

from __future__ import annotations

import codecs
import dataclasses
import importlib
from dataclasses import dataclass
from pathlib import Path

from st_codegen.entries import Entries
from st_codegen.errors import InputError, UnsupportedModelError, errors_name
from st_codegen.files.text import file_sha256
from st_codegen.ir import digest
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.limits import check_size
from st_codegen.walkers.objects import load_pickle, load_skops


@dataclass(frozen=True)
class FileFormat:
    """A kind of model file: its suffixes, the title for it in messages, and its reader.

    `module` has a function `load_file(path, name)` and is imported when the first such file is read.
    """

    suffixes: tuple[str, ...]
    title: str
    module: str


#: Kinds of model files that hold one model and nothing that runs when it is read.
FORMATS: Entries[FileFormat] = Entries(
    {
        "onnx": FileFormat((".onnx",), ".onnx", "st_codegen.walkers.onnx.load"),
        "lightgbm": FileFormat((".txt",), ".txt (LightGBM)", "st_codegen.walkers.lightgbm.model"),
        "xgboost": FileFormat(
            (".json", ".ubj"), ".json and .ubj (XGBoost), .json (CatBoost)", "st_codegen.walkers.xgboost.model"
        ),
    }
)
#: What to do with a format of a library that is not read.
_XGBOOST = "XGBoost's own formats are .json and .ubj: load it with XGBoost 1.0 to 2.1 and save_model('model.json')"
_ADVICE = {
    ".bin": _XGBOOST,
    ".model": _XGBOOST,
    ".cbm": "CatBoost's save_model(path, format='json') writes what is read",
    ".pt": "export it as .onnx (torch.onnx.export)",
    ".pth": "export it as .onnx (torch.onnx.export)",
    ".h5": "export it as .onnx (tf2onnx)",
    ".keras": "export it as .onnx (tf2onnx)",
    ".tflite": "export it as .onnx (tf2onnx)",
    ".pmml": "save the model itself, as .skops or .onnx",
}
_SKOPS = ".skops"
PICKLES = (".joblib", ".pkl", ".pickle")


def suffixes() -> tuple[str, ...]:
    """The suffixes of all files that are read as models."""
    return (*(suffix for known in FORMATS.values() for suffix in known.suffixes), _SKOPS, *PICKLES)


def known_formats() -> str:
    """What a folder of models may contain, for messages."""
    *pickles, last = PICKLES
    plain = ", ".join([*(known.title for known in FORMATS.values()), _SKOPS])
    return f"{plain}, and {', '.join(pickles)} or {last} with --trust-pickle"


def not_read(folder: Path) -> dict[Path, str]:
    """The files in a folder that may be models of formats that are not read, and what to do with each that is one."""
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    return {one: _ADVICE[one.suffix.lower()] for one in files if one.suffix.lower() in _ADVICE}


def load_model(path: Path, name: str, *, trust_pickle: bool = False) -> LoadedModel:
    """Load a model file and fill in where it comes from.

    Raises InputError (naming the file) for files that cannot be read or used, UntrustedFileError for pickles that are
    not trusted, MissingExtraError where the library to read the format is not installed.
    """
    if not path.exists():
        raise InputError(f"{path.name}: no such file in {path.parent}")
    if not path.is_file():
        raise InputError(f"{path.name}: {'a folder' if path.is_dir() else 'no ordinary file'}; a model file is wanted")
    with errors_name(path.name):
        check_size(path.stat().st_size)
    loaded = _loaded(path, name, trust_pickle=trust_pickle)
    source = dataclasses.replace(
        loaded.ir.source, file=path.name, digest=digest(loaded.ir), file_sha256=file_sha256(path)
    )
    return LoadedModel(dataclasses.replace(loaded.ir, source=source), loaded.predict)


def _check_beginning(path: Path) -> None:
    """Raise InputError for a file that is empty, or was written by an editor or a shell in place of its library."""
    with path.open("rb") as stream:
        begins = stream.read(3)
    what = "" if begins else "the file is empty: save or copy the model again"
    marks = (codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    if begins.startswith(marks) and path.suffix.lower() != ".xml":  # where such a mark is allowed
        what = "the file begins with a byte order mark, which libraries do not read: save the model again"
    if what:
        raise InputError(f"{what}; if it is no model, name it in leave_out of st-codegen.toml")


def _loaded(path: Path, name: str, *, trust_pickle: bool) -> LoadedModel:
    suffix = path.suffix.lower()
    if suffix in PICKLES:
        return load_pickle(path, name, trusted=trust_pickle)
    if suffix in suffixes():
        with errors_name(path.name):
            _check_beginning(path)
    if suffix == _SKOPS:
        return load_skops(path, name)
    for known in FORMATS.values():
        if suffix in known.suffixes:
            loaded: LoadedModel = importlib.import_module(known.module).load_file(path, name)
            return loaded
    advice = f"; {_ADVICE[suffix]}" if suffix in _ADVICE else ""
    raise UnsupportedModelError(f"{path.name}: not a known model format{advice}; supported are {known_formats()}")
