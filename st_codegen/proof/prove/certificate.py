"""The certificate: what was proved, of which files, under which assumptions; the same bytes for the same files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.files.text import file_sha256
from st_codegen.ir import ModelIR
from st_codegen.project.bundle import Bundle
from st_codegen.project.configuration import CONFIGURATION_FILE
from st_codegen.proof.prove.prove import ProofResult, ProveReport
from st_codegen.proof.prove.texts import output_names
from st_codegen.proof.runner import target_folders

FORMAT = "st-codegen certificate 1"

STATEMENT = (
    "For every proved entry and every float64 input (both zeros, denormals, infinities and NaN included) one call of "
    "the block sets bValid to TRUE exactly where the model has an answer, and then the outputs have the bits that the "
    "model file demands for the inputs, after these are limited to the ranges in which bundle.toml or st-codegen.toml "
    "limits them; where bValid is FALSE the outputs keep their last values. Where the method is the model's "
    "expression, the outputs are the operations that the model demands, in their order, none of them fails for any "
    "input, and they lie within the bound, where there is one, of the library's answer on the declared ranges."
)
ASSUMPTIONS = (
    "LREAL and REAL are IEEE 754 binary64 and binary32, rounded to nearest, ties to even, with denormals",
    "the compiler keeps the order and the roundings of the text: no extended precision, no fused multiply-add",
    "integers, comparisons, arrays and conversions are those of IEC 61131-3",
    "variables start with the initial values of the text, and nothing but the block writes to its instance",
    "the rules of the library are those that docs/proof.md lists",
)
#: Files that hold Structured Text, whether small or capital letters end their names.
TEXTS = (".st", ".scl", ".tcpou", ".tcdut", ".tcgvl", ".xml")


def certificate(bundle: Bundle, models: Path, generated: Path, report: ProveReport) -> dict[str, Any]:
    """The content of a certificate for what `prove` found of a folder of models (or one file) and generated targets."""
    folder = models if models.is_dir() else models.parent
    files = {loaded.ir.name: loaded.ir.source.file for loaded in bundle.models}
    settings = [name for name in ("bundle.toml", CONFIGURATION_FILE) if (folder / name).is_file()]
    beside = [name for loaded in bundle.models for name, _ in loaded.ir.source.data_files]
    named = sorted({*files.values(), *beside, *settings})
    return {
        "format": FORMAT,
        "statement": STATEMENT,
        "assumptions": list(ASSUMPTIONS),
        "models": {name: file_sha256(folder / name) for name in named},
        "texts": {
            target.name: {
                path.relative_to(target).as_posix(): file_sha256(path)
                for path in sorted(target.rglob("*"))
                if path.suffix.lower() in TEXTS
            }
            for target in target_folders(generated)
        },
        "proofs": [
            _entry(result, next(loaded.ir for loaded in bundle.models if loaded.ir.name == result.model))
            for result in report.results
            if result.model in files
        ],
        "blocks": [
            {
                "block": result.block,
                "target": result.target,
                "verdict": result.verdict.value,
                **({"claims": list(result.claims)} if result.claims else {"reason": result.reason}),
            }
            for result in report.results
            if result.model not in files
        ],
    }


def _entry(result: ProofResult, model: ModelIR) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "model": result.model,
        "file": model.source.file,
        "target": result.target,
        "block": result.block,
        "outputs": output_names(model, result.outputs),
        "inputs": [feature.name for feature in model.features],
        "verdict": result.verdict.value,
    }
    if result.is_proved:
        entry |= {"method": result.method, "trees": result.trees}
        if result.bound and np.all(np.isfinite(result.bound)):
            entry["bound"] = list(result.bound)
    else:
        entry["reason"] = result.reason
    return entry
