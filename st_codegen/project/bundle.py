"""A folder of model files as named, typed, checked models, with their purpose where a file beside them states one."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from st_codegen.emit.literals import identifier
from st_codegen.entries import Entries
from st_codegen.errors import InputError, Problems, with_subject
from st_codegen.ir import ModelIR, OutputKind
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.inexact import without_inexact_steps
from st_codegen.passes.outputs import with_outputs
from st_codegen.project.purpose import Purpose
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.files import known_formats, load_model, suffixes

#: Called with (number of files done, number of files, name of the next one).
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Bundle:
    """Models ready for compilation, in the order of their names, and what they are for (None: each stands alone)."""

    models: tuple[LoadedModel, ...]
    purpose: Purpose | None = None

    @property
    def irs(self) -> tuple[ModelIR, ...]:
        """The models as the compiler sees them."""
        return tuple(model.ir for model in self.models)


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
    folder: Path | str,
    *,
    trust_pickle: bool = False,
    outputs: Outputs = (OutputKind.CLASS,),
    progress: Progress | None = None,
) -> Bundle:
    """Load a folder of models (or one model file).

    `outputs` says what classifiers give beside the number of the class; each costs what it takes to compute it, and
    models that are no classifiers have none of these. A `bundle.toml` with nothing but a table `[outputs]` says so for
    single models, by their names.

    `trust_pickle` allows `.joblib` and `.pkl` files, which can run any code when they are opened. `progress` is told of
    each file. Raises one InputError that lists everything that is wrong: files, models, names, and the description of
    what the models are for.
    """
    folder, reading = Path(folder), Reading(trust_pickle, progress)
    if not folder.exists():
        raise InputError(f"{folder}: no such folder")
    own: dict[str, tuple[OutputKind, ...]] = {}
    for name, read in READERS.items():
        if folder.is_dir() and os.path.lexists(folder / name):
            found = _outputs_in(folder / name)
            if found is None:
                return read(folder / name, reading)
            own = found
    known = suffixes()
    files = [folder] if folder.is_file() else sorted(p for p in folder.iterdir() if p.suffix.lower() in known)
    if not files:
        raise InputError(f"{folder}: no model files; supported are {known_formats()}")
    problems = Problems(str(folder))
    check_names([path.stem for path in files], problems)
    models = reading.models({path.stem: path for path in files}, problems)
    for name in own:
        if name not in (path.stem for path in files):
            problems.add(f"[outputs] names '{name}', but there is no such model")
    wanted = outputs if isinstance(outputs, Mapping) else {name: own.get(name, outputs) for name in models}
    finished = tuple(_finished(model, wanted, problems) for model in models.values())
    problems.raise_if_any()
    return Bundle(finished)


def check_names(names: Sequence[str], problems: Problems) -> None:
    """Names must differ as Structured Text sees them: without case, punctuation as underscores."""
    taken: dict[str, str] = {}
    for name in names:
        with problems.collect():
            key = identifier(name, "model name").lower()
            if key in taken:
                raise InputError(
                    f"two models would be called FB_{identifier(name, 'model name')}: {taken[key]} and {name}; "
                    "rename one of the files"
                )
            taken[key] = name


def _outputs_in(path: Path) -> dict[str, tuple[OutputKind, ...]] | None:
    """The outputs of classifiers in a file that says nothing else; None for a file that says what models are for."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):  # its reader says what is wrong
        return None
    if list(content) != ["outputs"] or not isinstance(content["outputs"], dict):
        return None
    found = {}
    for name, words in content["outputs"].items():
        if not isinstance(words, list) or not all(word in list(OutputKind) for word in words):
            raise InputError(f"{path}: outputs.{name}: expected a list of {', '.join(OutputKind)}")
        found[name] = tuple(OutputKind(word) for word in words)
    return found


def _finished(model: LoadedModel, outputs: Mapping[str, Collection[OutputKind]], problems: Problems) -> LoadedModel:
    """The model with the outputs that are wanted, the limits of its inputs, and its trees on the inputs themselves."""
    with problems.collect():
        ir, columns = with_outputs(model.ir, outputs.get(model.ir.name, ()))
        return LoadedModel(without_inexact_steps(limit_inputs(ir)), lambda x: model.predict(x)[:, columns])
    return model
