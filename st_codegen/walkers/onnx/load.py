"""ONNX files: feed-forward graphs and tree ensembles as onnxruntime evaluates them, one row at a time."""

from __future__ import annotations

from pathlib import Path

from st_codegen.errors import extra_package
from st_codegen.walkers.base import LoadedModel


def load_file(path: Path, name: str) -> LoadedModel:
    """Load an `.onnx` file as the model `name`.

    Inputs become features in the order of the graph: a single input of k columns gives f0 .. f(k-1), several inputs
    lend their names. All outputs of the graph laid end to end are the outputs of the model. `predict` is onnxruntime on
    the CPU with one thread and without graph optimizations, row by row: a PLC evaluates one row, and with more
    onnxruntime may add in another order.

    Raises InputError for a file that is not an ONNX model or is damaged, UnsupportedModelError that lists all
    operators, versions and types that cannot be compiled, MissingExtraError without the packages onnx and onnxruntime.
    """
    for package in ("onnx", "onnxruntime"):
        extra_package(package, "onnx", f"{path.name}: loading ONNX files")
    from st_codegen.walkers.onnx.model import load

    return load(path, name)
