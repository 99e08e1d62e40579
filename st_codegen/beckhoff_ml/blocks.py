"""Function blocks that hand their inputs to TwinCAT's machine learning runtime (library Tc3_MLL).

They have the names, inputs and outputs of the blocks that compute a model themselves, so FB_TEPredict calls either.
"""

from __future__ import annotations

import dataclasses
import math

from st_codegen.beckhoff_ml.engines import Engine
from st_codegen.emit.blocks.application import GlobalList
from st_codegen.emit.blocks.listing import ArrayElement, Block, BlockVariable, Listing
from st_codegen.emit.blocks.model import (
    Limits,
    block_name,
    check_inputs,
    finished_block,
    input_variables,
    is_ranged,
    model_header,
    model_outputs,
)
from st_codegen.errors import errors_name
from st_codegen.ir import FLOAT32_OVERFLOW, Activation, Linear, ModelIR, Precision
from st_codegen.passes.domain import limit_inputs

#: The list of the model files, and where they are expected unless the user changes that.
FILES_LIST = "GVL_ModelFiles"
DEFAULT_FOLDER = "C:\\ML"

_EXACT = "Thresholds are chosen so that the engine decides as the library does."
_WITHIN = "Written to equal the library within the bound of verify, in the arithmetic of the file format."
_SINGLE = "The engine computes in REAL (float32): about 7 digits."
_NAN = "The format knows no missing values: for NaN in an input bValid is FALSE."


def engine_block(model: ModelIR, engines: tuple[Engine, ...], limits: Limits, remarks: tuple[str, ...]) -> Block:
    """The block that lets the runtime compute a model, with `remarks` in its header.

    Raises InputError for names that Structured Text cannot have.
    """
    with errors_name(f"model '{model.name}'"):
        return _block(model, engines, Listing(limits.max_array, limits.real_range), remarks)


def engine_limits(model: ModelIR, engine: Engine) -> tuple[float | None, ...]:
    """The magnitudes from which on a block refuses its inputs: what arithmetic would turn into infinity.

    Trees only compare, unless their inputs are scaled. An engine in float32 takes what overflows nowhere in float32.
    Raises InputError where that excludes a part of the declared range.
    """
    if engine.compares_only:
        return model.magnitude_limits
    if engine.precision is Precision.FLOAT64:
        # an engine computes with all columns, those that the model leaves out as well, and multiplies these by 0
        least = min((limit for limit in model.magnitude_limits if limit is not None), default=math.inf)
        return tuple(least if limit is None else limit for limit in model.magnitude_limits)
    ops = tuple(
        dataclasses.replace(op, precision=Precision.FLOAT32) if isinstance(op, Linear | Activation) else op
        for op in model.ops
    )
    single = limit_inputs(dataclasses.replace(model, ops=ops)).magnitude_limits
    return tuple(FLOAT32_OVERFLOW if limit is None else min(limit, FLOAT32_OVERFLOW) for limit in single)


def _block(model: ModelIR, engines: tuple[Engine, ...], listing: Listing, remarks: tuple[str, ...]) -> Block:
    engine = engines[0]
    single = engine.precision is Precision.FLOAT32
    limited = dataclasses.replace(model, accepts_nan=False, magnitude_limits=engine_limits(model, engine))
    inputs = input_variables(model.features)
    outputs = (
        *model_outputs(model),
        BlockVariable("bLoaded", "BOOL", comment="all model files have been read"),
        BlockVariable("nErrorCode", "DINT", comment="error of the runtime, 0: none"),
    )
    check_inputs(limited, inputs, listing)
    kind = "REAL" if single else "LREAL"
    data = listing.local("aEngineInput", kind, len(inputs)) if single else "aInput"
    result = listing.local("aEngineOutput", kind, engine.n_outputs)
    listing.loop("nOutput", len(model.outputs))
    listing.local("nLoaded", "DINT")
    listing.local("aResult", "LREAL", len(model.outputs))
    calls = []
    for number, name in enumerate(engine_names(model, engines)):
        instance = f"fbPrediction{number + 1}"
        listing.variables[instance] = BlockVariable(instance, "FB_MllPrediction", comment="engine of the runtime")
        calls.append({"instance": instance, "number": number, "file": f"{FILES_LIST}.s{name}"})
    values = {"single": single, "data": data, "result": result, "calls": calls, "inputs": len(inputs)}
    values["last_input"] = len(inputs) - 1
    values |= {"outputs": engine.n_outputs, "last_output": len(model.outputs) - 1}
    data_type = "E_MLLDT_FP32_REAL" if single else "E_MLLDT_FP64_LREAL"
    listing.section("model files are read once, one after another", "mll_load", calls=calls)
    listing.section("prediction by the runtime", "mll_predict", data_type=data_type, **values)
    listing.section(
        "outputs",
        "outputs",
        assignments=[
            {"output": variable, "value": ArrayElement("aResult", number), "cut": model.classes is not None}
            for number, variable in enumerate(model.variables)
        ],
        ranged=is_ranged(model),
        aged=False,
        plausible=[],
    )
    closing = [f"Engine: {engine.template}, files {', '.join(engine_names(model, engines))}", _WITHIN]
    closing += [_SINGLE] if single else []
    closing += [_EXACT] if engine.folder == "trees" else []
    closing += [_NAN] if model.accepts_nan else []
    return finished_block(model, inputs, outputs, listing, model_header(model, *closing, remarks=remarks))


def engine_names(model: ModelIR, engines: tuple[Engine, ...]) -> list[str]:
    """The name of each engine's file: that of the model, with the number of the output where there are several."""
    stem = block_name(model.name).removeprefix("FB_")
    return [stem] if len(engines) == 1 else [f"{stem}_{number + 1}" for number in range(len(engines))]


def files_list(paths: dict[str, str]) -> GlobalList:
    """Paths on the controller, by the name of the engine."""
    return GlobalList(
        FILES_LIST,
        (
            "The model files on the controller. Copy the folder Models of this project there, or",
            "change the paths. Files of one folder are of one kind and use.",
        ),
        tuple(
            BlockVariable(f"s{name}", "STRING(255)", initial=f"'{DEFAULT_FOLDER}\\{path}'")
            for name, path in paths.items()
        ),
    )
