"""A folder of model files as named, typed, checked models, with their purpose where a file beside them states one."""

from __future__ import annotations

import copy
import dataclasses
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.emit.literals import capitalised, identifier
from st_codegen.entries import Entries
from st_codegen.errors import InputError, Problems, counted, with_subject
from st_codegen.files.html_text import html_table
from st_codegen.ir import FloatArray, ModelIR, OutputKind, digest
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.inexact import without_inexact_steps
from st_codegen.passes.outputs import OF_CLASSES, with_outputs
from st_codegen.passes.real import in_real
from st_codegen.processes import Progress
from st_codegen.project.configuration import CONFIGURATION_FILE, Configuration, read_configuration
from st_codegen.project.purpose import Purpose
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.files import PICKLES, known_formats, load_model, not_read, suffixes
from st_codegen.walkers.objects import from_estimator


@dataclass(frozen=True, repr=False)
class Bundle:
    """Models ready for compilation, in the order of their names, and what they are for (None: each stands alone)."""

    models: tuple[LoadedModel, ...]
    purpose: Purpose | None = None
    configuration: Configuration = field(default_factory=Configuration)

    @property
    def irs(self) -> tuple[ModelIR, ...]:
        """The models as the compiler sees them."""
        return tuple(model.ir for model in self.models)

    def __repr__(self) -> str:
        return f"Bundle({', '.join(model.name for model in self.irs)})"

    def _repr_html_(self) -> str:
        rows = [
            (m.name, m.source.model_class, ", ".join(f.name for f in m.features), str(len(m.outputs)), m.source.file)
            for m in self.irs
        ]
        return html_table(counted(len(rows), "model"), ("model", "class", "features", "outputs", "file"), rows)


@dataclass(frozen=True)
class Reading:
    """How model files are read: whether pickles are trusted, and who is told how far it is."""

    trust_pickle: bool = False
    progress: Progress | None = None

    def models(self, files: Mapping[str, Path], problems: Problems) -> dict[str, LoadedModel]:
        """The models of some files, by name; whatever is wrong is noted in `problems`."""
        models = {}
        for number, (name, path) in enumerate(files.items()):
            self._tell(number, len(files), path.name)
            with problems.collect():
                try:
                    models[name] = load_model(path, name, trust_pickle=self.trust_pickle)
                except InputError as error:
                    if path.name in str(error):
                        raise
                    raise with_subject(error, path.name) from error
        self._tell(len(files), len(files), "")
        return models

    def _tell(self, done: int, total: int, following: str) -> None:
        if self.progress is not None:
            self.progress(done, total, following)


#: Readers of bundles, by the name of the file that says what the models are for; each is given that file.
READERS: Entries[Callable[[Path, Reading], Bundle]] = Entries()


#: Which outputs classifiers have beside their class: the same for all, or by the name of each model.
Outputs = Collection[OutputKind] | Mapping[str, Collection[OutputKind]]


def load(
    models: Any,
    *,
    trust_pickle: bool = False,
    outputs: Outputs = (OutputKind.CLASS,),
    progress: Progress | None = None,
    prefix: str | None = None,
    block_name: str | None = None,
    real: bool = False,
) -> Bundle:
    """Load a folder of models (or one model file), as the `st-codegen.toml` beside them says where there is one.

    `models` may also be a fitted estimator, which is then called `model`, or a dictionary of estimators by their names.

    `outputs` says what classifiers give beside the number of the class; each costs what it takes to compute it, and
    models that are no classifiers have none of these. `gives` in a `[[model]]` of the configuration says so for a
    single model.

    `trust_pickle` allows `.joblib` and `.pkl` files, which can run any code when they are opened. `progress` is told of
    each file.

    `prefix` stands in front of the names of all models, in place of the one in `st-codegen.toml`; `block_name` is the
    name of a single model, in place of its file's. Blocks that a `bundle.toml` asks for have names of their own.

    `real` makes models for controllers without LREAL: everything is a REAL (`passes.real`). Models that cannot
    be are refused with the reason.

    Raises one InputError that lists everything that is wrong: files, models, names, and the description of
    what the models are for.
    """
    bundle = _loaded(models, trust_pickle, outputs, progress, prefix=prefix, block_name=block_name)
    if not real:
        return bundle
    if bundle.purpose is not None:
        raise InputError(
            "--real: the compensation takes angles of many revolutions; after 1,000 of them REAL numbers lie 0.028 deg "
            "apart, about as much as the error that it corrects"
        )
    problems = Problems(str(models))
    found = []
    for model in bundle.models:
        with problems.collect():
            found.append(_in_real(model))
    problems.raise_if_any()
    return dataclasses.replace(bundle, models=tuple(found))


def _in_real(model: LoadedModel) -> LoadedModel:
    """The model in REAL, and its library, which gets the inputs rounded to REAL as the block does."""

    def predict(x: FloatArray) -> FloatArray:
        with np.errstate(over="ignore"):
            return model.predict(x.astype(np.float32).astype(np.float64))

    return LoadedModel(in_real(model.ir), predict)


def _loaded(
    models: Any,
    trust_pickle: bool,
    outputs: Outputs,
    progress: Progress | None,
    *,
    prefix: str | None,
    block_name: str | None,
) -> Bundle:
    """The models as their files and the configuration beside them have them."""
    if not isinstance(models, str | os.PathLike):
        if prefix or block_name:
            raise InputError("models from memory have the names that they are given with: leave out prefix, block_name")
        return _from_memory(models if isinstance(models, Mapping) else {"model": models}, outputs)
    folder, reading = Path(models), Reading(trust_pickle, progress)
    if not folder.exists():
        raise InputError(f"{folder}: no such file or folder")
    configuration = read_configuration(folder)
    described = (name for name in READERS if folder.is_dir() and os.path.lexists(folder / name))
    if (name := next(described, None)) is None:
        files = _model_files(folder, configuration)
        configuration = configuration.renamed([path.name for path in files], prefix, block_name)
        return _from_files(folder, files, configuration, reading, outputs)
    if configuration.describes_models:
        raise InputError(
            f"{folder / CONFIGURATION_FILE}: {name} describes these models; only [build] has a use beside it"
        )
    if prefix or block_name:
        raise InputError(f"{folder / name} names its blocks itself: leave out --prefix and --block-name")
    return dataclasses.replace(READERS[name](folder / name, reading), configuration=configuration)


def _model_files(folder: Path, configuration: Configuration) -> list[Path]:
    """The model files of a folder that its configuration does not leave out, or the one file that was given."""
    known = suffixes()
    given = [folder] if folder.is_file() else sorted(p for p in folder.iterdir() if p.suffix.lower() in known)
    if not given:
        others = "".join(
            f"\n  - {path.name} is not read; if it is a model: {advice}" for path, advice in not_read(folder).items()
        )
        raise InputError(f"{folder}: no model files; supported are {known_formats()}{others}")
    files = [path for path in given if not configuration.leaves_out(path)]
    if not files:
        raise InputError(f"{folder}: left out by leave_out in {CONFIGURATION_FILE}")
    return files


def _from_files(
    folder: Path, files: list[Path], configuration: Configuration, reading: Reading, outputs: Outputs
) -> Bundle:
    """The models of files, each for itself, with the names and the outputs that the configuration gives them."""
    problems = Problems(str(folder))
    named = {path.name: configuration.model_name(path.name) for path in files}
    check_names(named, problems)
    models = reading.models({named[path.name]: path for path in files}, problems)
    own = configuration.gives()
    _check_gives(own, models, problems)
    of_each, others = (outputs, ()) if isinstance(outputs, Mapping) else ({}, outputs)
    wanted = {name: own.get(name, others) for name in models} | dict(of_each)
    finished = tuple(_finished(model, configuration, wanted, problems) for model in models.values())
    if folder.is_dir() and not problems.errors:
        features = {m.ir.source.file: tuple(f.name for f in m.ir.features) for m in models.values()}
        configuration.check_used(features, problems)
    problems.raise_if_any()
    return Bundle(finished, configuration=configuration)


def others_of(folder: Path, bundle: Bundle) -> list[str]:
    """The models beside those of a folder whose formats are not read, each with what to do."""
    found = {} if bundle.purpose is not None else not_read(folder)
    return [
        f"{path.name} is not read; if it is a model: {text}"
        for path, text in found.items()
        if not bundle.configuration.leaves_out(path)
    ]


def pickles_left_out(folder: Path, bundle: Bundle) -> list[str]:
    """The pickles in a folder that its configuration leaves out: those are not read, whoever trusts them."""
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    return [one.name for one in files if one.suffix.lower() in PICKLES and bundle.configuration.leaves_out(one)]


def _check_gives(
    own: Mapping[str, Collection[OutputKind]], models: Mapping[str, LoadedModel], problems: Problems
) -> None:
    """Note the models that are to give what only classifiers give, and are none."""
    for name, kinds in own.items():
        if name in models and models[name].ir.classes is None and OF_CLASSES.intersection(kinds):
            problems.add(f"[[model]] gives = {[str(kind) for kind in kinds]}: {name} is no classifier")


def _from_memory(estimators: Mapping[str, Any], outputs: Outputs) -> Bundle:
    """Fitted estimators, by name, as a bundle."""
    problems = Problems("models")
    check_names({name: name for name in estimators}, problems)
    found = []
    for name, estimator in estimators.items():
        with problems.collect(name):
            # a copy: it predicts with one job, and stays as it is where the user's own is fitted again
            loaded = from_estimator(copy.deepcopy(estimator), name)
            source = dataclasses.replace(loaded.ir.source, digest=digest(loaded.ir))
            model = LoadedModel(dataclasses.replace(loaded.ir, source=source), loaded.predict)
            found.append(_finished(model, Configuration(), outputs, problems))
    problems.raise_if_any()
    return Bundle(tuple(sorted(found, key=lambda model: model.ir.name)))


def check_names(names: Mapping[str, str], problems: Problems) -> None:
    """Names must differ as Structured Text sees them: without case, punctuation as underscores.

    `names` has the name of the model in each file.
    """
    taken: dict[str, str] = {}
    for file, name in names.items():
        with problems.collect():
            try:
                text = identifier(name, "model name", "FB_")
            except InputError as error:
                raise InputError(f"{file}: {error}, or give it a name in {CONFIGURATION_FILE}") from None
            other = taken.setdefault(text.lower(), file)
            if other != file:
                raise InputError(
                    f"two models would be called FB_{capitalised(text)}: {other} and {file}; rename one of the files, "
                    f"or give it a name in {CONFIGURATION_FILE}"
                )


def _finished(model: LoadedModel, configuration: Configuration, outputs: Outputs, problems: Problems) -> LoadedModel:
    """The model as it is configured, with the outputs that are wanted and the limits of its inputs."""
    with problems.collect():
        wanted = outputs.get(model.ir.name, ()) if isinstance(outputs, Mapping) else outputs
        ir, columns = with_outputs(model.ir, wanted)
        ir = limit_inputs(configuration.applied(ir))
        return LoadedModel(without_inexact_steps(ir), lambda x: model.predict(x)[:, columns])
    return model
