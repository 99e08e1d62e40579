"""TwinCAT machine learning (TF3800, TF3810): model files in the vendor's XML and the text that has them computed.

One file an engine. The runtime also reads files with several engines of one kind, but their text is not documented:
nothing is merged here, only put into one folder by kind and use, as the vendor's Model Manager wants it for merging.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from st_codegen.beckhoff_ml.blocks import engine_block, engine_names, files_list
from st_codegen.beckhoff_ml.engines import Affine, Engine, checked_engines
from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.emit.contents import Contents
from st_codegen.emit.targets import FilePlan, Target
from st_codegen.emit.targets.twincat import TwinCatTarget
from st_codegen.errors import Problems


class BeckhoffMlTarget(Target):
    """A TwinCAT project whose model blocks call FB_MllPrediction, and the files that it loads."""

    name = "beckhoff-ml"
    summary = "TwinCAT machine learning: XML model files for FB_MllPrediction, and a PLC project that calls it"
    dialect = "twincat"
    templates = "twincat"
    limits = Limits()
    compiles = False

    def plan(self, contents: Contents, limits: Limits, vectors: Sequence[ReferenceVectors] = ()) -> Iterable[FilePlan]:
        del vectors  # `has_tests` is False: model files are read over several cycles, suites would run before that
        problems = Problems("TwinCAT machine learning")
        engines: dict[str, tuple[Engine, ...]] = {}
        for model in contents.models:
            with problems.collect():
                engines[model.name] = checked_engines(model)
        problems.raise_if_any()
        application = contents.application(
            lambda model, extras: engine_block(model, engines[model.name], limits, extras.remarks)
        )
        files, paths, owners = [], {}, dict[str, str]()
        for model in contents.models:
            use = contents.uses.get(model.name)
            folder = "_".join([*([use] if use else []), engines[model.name][0].folder])
            for name, engine in zip(engine_names(model, engines[model.name]), engines[model.name], strict=True):
                if (other := owners.setdefault(name.casefold(), model.name)) != model.name:
                    problems.add(f"{other} and {model.name} would both have the file {name}.xml: rename one of them")
                files.append(_model_file(f"Models/{folder}/{name}.xml", engine))
                paths[name] = f"{folder}\\{name}.xml"
        problems.raise_if_any()
        application = dataclasses.replace(
            application,
            globals=(*application.globals, files_list(paths)),
            libraries=(*application.libraries, "Tc3_MLL"),
        )
        return [*files, *self.files(application)]

    def files(self, application: Application) -> Iterable[FilePlan]:
        return TwinCatTarget().files(application)


def _model_file(path: str, engine: Engine) -> FilePlan:
    values = {
        "engine": engine,
        "input": _transformation(engine.input),
        "output": _transformation(engine.output),
        "doubles": doubles,
        "singles": singles,
        "integers": integers,
        "prefix": prefix,
    }
    return FilePlan(path, f"beckhoff-ml/{engine.template}.xml.j2", values)


def _transformation(affine: Affine) -> Affine | None:
    return None if affine.changes_nothing else affine


def doubles(values: Iterable[float]) -> str:
    """float64 numbers with 17 digits, which read back as the same bits."""
    return ",".join(f"{value:.17g}" for value in np.asarray(values, np.float64).tolist())


def singles(values: Iterable[float]) -> str:
    """float32 numbers with 9 digits, which read back as the same bits."""
    return ",".join(f"{value:.9g}" for value in np.asarray(values, np.float32).tolist())


def integers(values: Iterable[int]) -> str:
    """Whole numbers as text."""
    return ",".join(str(value) for value in np.asarray(values, np.int64).tolist())


def prefix(kind: str, count: int) -> str:
    """The prefix of an attribute: a list of one is written as a scalar."""
    return kind if count == 1 else f"arr{kind}"
