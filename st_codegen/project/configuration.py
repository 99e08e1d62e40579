"""`st-codegen.toml` beside model files: what the generated project is called, and what the files do not know.

[project]
name = "Pumps"                       # of the PLC project; default: Models
prefix = "P1_"                       # of all blocks: FB_P1_Power
leave_out = ["notes.txt", "old_*"]   # files that are no models of this project
attributes = ["no_check"]            # pragmas of every block, in TwinCAT

[names]                              # of inputs and outputs that are given none below
input = "fIn{feature}"               # default: "f{feature}"
output = "fResult{number}"           # default: "fOut{number}"

[build]                              # defaults of the options of the same names
target = ["twincat", "iec"]
out = "generated"
layout = "auto"

[[input]]                            # of all models that have this feature, or of one: file = "power.txt"
feature = "Öltemperatur °C"          # as the model calls it
name = "fOil_degC"                   # the block's input
unit = "degC"
min = 3.0                            # the range in which the block is used ..
max = 60.0
outside = "clamp"                    # .. outside of which inputs are limited to it, or "flag": bInRange alone says so
trained = [3.5, 58.0]                # range of the training data, where it is known: nothing is limited to it

[[model]]
file = "kühlung.skops"
name = "Cooling"                     # FB_Cooling
layout = "table"                     # auto, trees, ranked, cut, ifs or table
gives = ["class", "probability"]     # what a classifier gives, in place of --outputs
outputs = [{name = "fPower_kW", unit = "kW", min = 0.0, max = 11.0}]   # bPlausible is FALSE outside; of a
                                     # classifier: {name = "nState"}, then names of what it gives beside the class
training_sha256 = "5f1c.."           # of the training data, for the header of the block
metrics = {"MAE, kW" = 0.21}         # for the header, too

[[model]]
file = "bearing.onnx"
window = 64                          # its features are the last 64 samples: FB_BearingWindow keeps them
samples = ["fVibration"]             # what one sample has; default: fSample
window_order = "sample"              # of several numbers: all of the oldest sample first; or "channel"
"""

from __future__ import annotations

import dataclasses
import fnmatch
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.window import Window
from st_codegen.emit.foreign_names import is_foreign
from st_codegen.emit.literals import MAX_IDENTIFIER, capitalised, check_text, identifier, is_keyword, unit_text
from st_codegen.errors import InputError, Problems
from st_codegen.files.folders import is_device
from st_codegen.files.toml_tables import TomlTable, nearest, read_toml, shown
from st_codegen.ir import Feature, ModelIR, Output, OutputKind
from st_codegen.passes.choose import Layout
from st_codegen.project.build_options import BUILD_OPTIONS

CONFIGURATION_FILE = "st-codegen.toml"

#: Options of the command line that [build] may give a default, and what each takes; a list is one of texts.
BUILD_KEYS: Mapping[str, type] = {
    **dict.fromkeys(("target", "entry"), list),
    **dict.fromkeys(("out", "outputs", "profile"), str),
    **dict.fromkeys(("rows", "features"), int),
    **{name: option.kind for name, option in BUILD_OPTIONS.items()},
    "cycle_us": float,
}


#: Outputs of `--with-age` and of windows.
_TAKEN = ("nage", "nsamples")


class Outside(StrEnum):
    """What a block does with an input outside of its range."""

    CLAMP = "clamp"  # computes with the nearest end of the range, bInRange is FALSE
    FLAG = "flag"  # computes with the input, bInRange is FALSE


class WindowOrder(StrEnum):
    """In which order the features of a window of samples with several numbers stand."""

    SAMPLE = "sample"  # all numbers of the oldest sample, then of the next
    CHANNEL = "channel"  # the first number of all samples, then the second


@dataclass(frozen=True)
class InputEntry:
    """What an [[input]] table says of a feature, of all models or of that of one file."""

    feature: str
    file: str
    name: str
    unit: str
    limits: tuple[float, float] | None
    outside: Outside
    trained: tuple[float, float] | None

    def applied(self, feature: Feature) -> Feature:
        """The feature as the project has it."""
        clamped = self.limits if self.outside is Outside.CLAMP else None
        return dataclasses.replace(
            feature,
            variable=self.name,
            unit=self.unit or feature.unit,
            lower=clamped and clamped[0],
            upper=clamped and clamped[1],
            flagged=self.limits if self.outside is Outside.FLAG else None,
            seen=_both(self.trained, feature.seen),
        )


def _both(given: tuple[float, float] | None, known: tuple[float, float] | None) -> tuple[float, float] | None:
    """The range with the ends of both: what the model's file knows of its training data no configuration takes back."""
    if given is None or known is None:
        return given or known
    return min(given[0], known[0]), max(given[1], known[1])


@dataclass(frozen=True)
class ModelEntry:
    """What a [[model]] table says of one file."""

    file: str
    name: str
    layout: Layout | None = None
    outputs: tuple[Output, ...] = ()
    training_sha256: str = ""
    metrics: tuple[tuple[str, float], ...] = ()
    window: Window | None = None
    gives: tuple[OutputKind, ...] | None = None


@dataclass(frozen=True)
class NamingRules:
    """How variables are called that are given no name; empty: as they are without a rule."""

    input: str = ""
    output: str = ""

    def applied(self, model: ModelIR, features: Sequence[Feature]) -> tuple[tuple[Feature, ...], tuple[Output, ...]]:
        """The features with their variables, and the outputs of a model that are given no name.

        Those of classifiers keep their names. Raises InputError for a feature that makes no name.
        """
        if self.input:
            words = (capitalised(identifier(f.name, "feature name", "f")) if not f.variable else "" for f in features)
            features = [
                dataclasses.replace(feature, variable=feature.variable or self.input.format(feature=word))
                for feature, word in zip(features, words, strict=True)
            ]
        if long := [feature.variable for feature in features if len(feature.variable) > MAX_IDENTIFIER]:
            raise InputError(
                f"{long[0]} is longer than {MAX_IDENTIFIER} characters: give the feature a name in [[input]]"
            )
        numbers = range(1, len(model.outputs) + 1) if self.output and model.classes is None else ()
        return tuple(features), tuple(Output(self.output.format(number=number)) for number in numbers)


@dataclass(frozen=True)
class Configuration:
    """The contents of a `st-codegen.toml`; an empty one changes nothing."""

    name: str = "Models"
    prefix: str = ""
    leave_out: tuple[str, ...] = ()
    attributes: tuple[str, ...] = ()
    inputs: tuple[InputEntry, ...] = ()
    models: tuple[ModelEntry, ...] = ()
    names: NamingRules = NamingRules()
    build: Mapping[str, Any] = field(default_factory=dict)

    @property
    def describes_models(self) -> bool:
        """Whether anything but the defaults of options is given."""
        return dataclasses.replace(self, build={}) != Configuration()

    def leaves_out(self, path: Path) -> bool:
        """Whether a file is no model of this project."""
        return any(fnmatch.fnmatchcase(path.name, pattern) for pattern in self.leave_out)

    def model_name(self, file: str) -> str:
        """The name of the model of a file: as the file has it given, else its stem; behind the prefix."""
        return self.prefix + (self._entry(file).name or Path(file).stem)

    def _entry(self, file: str) -> ModelEntry:
        """What is said of one file, which may be nothing."""
        return next((entry for entry in self.models if entry.file == file), ModelEntry(file, ""))

    def renamed(self, files: Sequence[str], prefix: str | None, block_name: str | None) -> Configuration:
        """The configuration with another prefix, and another name for the only one of these files.

        Raises InputError where there are several files, and for what is no beginning of a name.
        """
        if prefix and not re.fullmatch(r"[A-Za-z]\w*", prefix, re.ASCII):
            raise InputError(f"--prefix {shown(prefix)}: letters, digits and underscores, a letter first")
        changed = self if prefix is None else dataclasses.replace(self, prefix=prefix)
        if block_name is None:
            return changed
        if len(files) != 1:
            raise InputError(
                f"--block-name is for a single model, and there are {len(files)}: give a file, or names in "
                f"[[model]] tables of {CONFIGURATION_FILE}"
            )
        (file,) = files
        name = block_name.removeprefix("FB_")
        others = tuple(entry for entry in self.models if entry.file != file)
        return dataclasses.replace(changed, models=(*others, dataclasses.replace(self._entry(file), name=name)))

    def layouts(self) -> dict[str, Layout]:
        """The layouts that are asked for, by the names of models."""
        return {self.model_name(entry.file): entry.layout for entry in self.models if entry.layout is not None}

    def gives(self) -> dict[str, tuple[OutputKind, ...]]:
        """What single classifiers give, by the names of their models."""
        return {self.model_name(entry.file): entry.gives for entry in self.models if entry.gives is not None}

    def remarks(self, file: str) -> tuple[str, ...]:
        """What the header of the block of a file says of its training."""
        entry = self._entry(file)
        data = [f"Training data given: SHA-256 {entry.training_sha256}"] if entry.training_sha256 else []
        metrics = "; ".join(f"{name} {value:g}" for name, value in entry.metrics)
        return (*data, *([f"Metrics, as given: {metrics}"] if metrics else []))

    def windows(self) -> dict[str, Window]:
        """The windows of samples that are asked for, by the names of models."""
        return {self.model_name(entry.file): entry.window for entry in self.models if entry.window is not None}

    def application(self) -> Application:
        """The project around the blocks of lone models."""
        return Application(self.name, connected=False, attributes=self.attributes)

    def applied(self, model: ModelIR) -> ModelIR:
        """The model with the names, units and ranges that are given for it. Raises InputError for other outputs."""
        features = list(model.features)
        for entry in sorted(self.inputs, key=lambda entry: entry.file):  # that of all models first
            if entry.file in ("", model.source.file):
                features = [entry.applied(f) if f.name == entry.feature else f for f in features]
        named, ports = self.names.applied(model, features)
        return dataclasses.replace(model, features=named, ports=self._entry(model.source.file).outputs or ports)

    def check_used(self, models: Mapping[str, tuple[str, ...]], problems: Problems) -> None:
        """Note what is said of files and features that are not there; `models`: the features of each file."""
        for model in self.models:
            if model.window is not None:
                with problems.collect(f"[[model]] file = '{model.file}'"):
                    model.window.names(len(models.get(model.file, ())))
            if model.file not in models:
                problems.add(f"[[model]] file = '{model.file}': no such model; {nearest(model.file, models)}")
        for entry in self.inputs:
            where = f"[[input]] feature = '{entry.feature}'"
            if entry.file and entry.file not in models:
                problems.add(f"{where}, file = '{entry.file}': no such model; {nearest(entry.file, models)}")
                continue
            known = dict.fromkeys(name for file, names in models.items() if entry.file in ("", file) for name in names)
            if entry.feature not in known:
                problems.add(f"{where}: no model has it; {nearest(entry.feature, known)}")


def read_configuration(folder: Path) -> Configuration:
    """The configuration of a folder (or of the folder of one file); an empty one where there is none.

    Raises one InputError that lists every problem.
    """
    path = (folder if folder.is_dir() else folder.parent) / CONFIGURATION_FILE
    if not os.path.lexists(path):
        return Configuration()
    problems = Problems(str(path))
    with TomlTable(read_toml(path), "", problems) as file:
        configuration = _configuration(file)
    problems.raise_if_any()
    return configuration


def _configuration(file: TomlTable) -> Configuration:
    with file.table("project") as project:
        name = project.text("name", "Models")
        prefix = project.text("prefix", "")
        leave_out = _texts(project, "leave_out")
        attributes = _texts(project, "attributes")
        with project.collect():
            _check_project_name(name)
        with project.collect():
            for attribute in attributes:
                if not re.fullmatch(r"[A-Za-z_][\w.\-]*", attribute):
                    raise InputError(f"attributes: {attribute!r} is no name of a pragma")
        if prefix and not re.fullmatch(r"[A-Za-z]\w*", prefix, re.ASCII):
            project.note(f"prefix = {shown(prefix)}: letters, digits and underscores, a letter first")
        if "real" in project:
            project.declare("real")
            project.note("real stands in [build]: real = true for controllers that have no LREAL, as --real does")
    names = _rules(file)
    with file.table("build") as build:
        _check_build(build)
    inputs = tuple(filter(None, map(_input, file.tables("input"))))
    models = tuple(filter(None, map(_model, file.tables("model"))))
    names_of_inputs = [
        f"[[input]] feature = '{entry.feature}'" + (f", file = '{entry.file}'" if entry.file else "")
        for entry in inputs
    ]
    for described in ([f"[[model]] file = '{model.file}'" for model in models], names_of_inputs):
        for twice in sorted({text for text in described if described.count(text) > 1}):
            file.note(f"{twice} is there twice")
    return Configuration(name, prefix, leave_out, attributes, inputs, models, names, build.values)


def _check_project_name(name: str) -> None:
    """Raise InputError for what is no name of files on every system, or of a project."""
    identifier(name, "project name")
    plain = re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9 ._\-]{0,99}", name) and name[-1] not in " ."
    if not plain or is_device(name):
        raise InputError(
            f"name = {shown(name)}: files have this name: letters, digits, blanks, points, - and _, and nothing that "
            "Windows keeps for itself"
        )


def _check_build(build: TomlTable) -> None:
    """Note the values in [build] that their options do not take; what remains of a text or a number they judge."""
    build.declare(*BUILD_KEYS)
    for key, kind in BUILD_KEYS.items():
        if key not in build:
            continue
        found = build.values[key]
        if kind is list:
            _texts(build, key)
        elif kind is int:
            build.whole(key, low=1, high=2**63)
        elif kind is float:
            if build.number(key) <= 0.0:
                build.note(f"{key} = {shown(found)} is not above 0")
        elif not isinstance(found, kind):
            build.note(f"{key} = {shown(found)} is not {'true or false' if kind is bool else 'a text'}")
        elif isinstance(found, str) and not found.isprintable():
            build.note(f"{key} = {shown(found)} has characters that cannot be printed")


def _rules(file: TomlTable) -> NamingRules:
    """The table [names], which may be missing."""
    with file.table("names") as table:
        rules = NamingRules(table.text("input", ""), table.text("output", ""))
        for rule, word in ((rules.input, "feature"), (rules.output, "number")):
            if rule and not re.fullmatch(rf"f(?:[A-Z]\w*)?\{{{word}\}}\w*", rule, re.ASCII):
                table.note(f"{shown(rule)}: f, a capital letter and what follows it, with {{{word}}} in one place")
    return rules


def _texts(table: TomlTable, key: str) -> tuple[str, ...]:
    """A list of texts that may be missing."""

    def text(key: str, value: Any) -> str | None:
        if isinstance(value, str):
            return value
        table.note(f"{key}: {shown(value)} is not a text")
        return None

    table.declare(key)
    return table.list_of(key, text) if key in table else ()


def _input(table: TomlTable) -> InputEntry | None:
    with table:
        feature, file = table.text("feature"), table.text("file", "")
        name = _variable(table, table.text("name", ""))
        unit = table.text("unit", "")
        limits = _range(table)
        outside = table.choice("outside", Outside) if "outside" in table else Outside.CLAMP
        if "outside" in table and limits is None:
            table.note("outside says what is done beyond min and max: give both")
        table.declare("outside", "trained")
        seen = table.list_of("trained", table.number_of) if "trained" in table else None
        if seen is not None and (len(seen) != 2 or seen[0] > seen[1]):
            table.note("trained: the lowest and the highest value of the training data are wanted")
        if not feature.isascii() and not name:
            table.note(f"feature '{feature}' is not ASCII: give it a name")
        with table.collect():
            unit_text(unit, "unit")
    if not table.is_sound or outside is None:
        return None
    return InputEntry(feature, file, name, unit, limits, outside, (seen[0], seen[1]) if seen else None)


def _model(table: TomlTable) -> ModelEntry | None:
    with table:
        file, name = table.text("file"), table.text("name", "")
        layout = table.choice("layout", Layout) if "layout" in table else None
        outputs = tuple(_output(entry) for entry in table.tables("outputs"))
        window = _window(table)
        table.declare("layout")
        gives = table.list_of("gives", partial(table.choice_of, kind=OutputKind)) if "gives" in table else None
        table.declare("gives")
        digest, metrics = table.text("training_sha256", ""), table.table("metrics")
        if digest and not re.fullmatch("[0-9a-f]{64}", digest):
            table.note(f"training_sha256 = {shown(digest)}: 64 digits of 0-9 and a-f are wanted")
        numbers = tuple((key, metrics.number(key)) for key in metrics.values)
        names = [output.variable.lower() for output in outputs]
        if len(set(names)) < len(names):
            table.note("two outputs have the same name")
        with table.collect():
            check_text(name, "name")
            for key, _ in numbers:
                check_text(key, "metrics")
    return ModelEntry(file, name, layout, outputs, digest, numbers, window, gives) if table.is_sound else None


def _window(table: TomlTable) -> Window | None:
    """The keys window, samples and window_order, of which the first must be there for the others."""
    samples = _texts(table, "samples")
    order = table.choice("window_order", WindowOrder) if "window_order" in table else WindowOrder.SAMPLE
    table.declare("window", "window_order")
    if "window" not in table:
        if samples or "window_order" in table:
            table.note("samples and window_order are for a window: say how many samples it has")
        return None
    for name in samples:
        _variable(table, name)
    if len({name.lower() for name in samples}) < len(samples):
        table.note("two numbers of a sample have the same name")
    length = table.whole("window", low=2, high=2**16)
    return Window(length, samples, order is WindowOrder.SAMPLE)


def _output(table: TomlTable) -> Output:
    with table:
        name, unit = _variable(table, table.text("name"), "fn"), table.text("unit", "")
        if name.lower() in _TAKEN:
            table.note(f"name = {shown(name)} is an output that blocks may have for something else")
        limits = _range(table)
        with table.collect():
            unit = unit_text(unit, "unit")
    return Output(name, unit, *(limits or (None, None)))


def _range(table: TomlTable) -> tuple[float, float] | None:
    """The keys min and max, both or none."""
    table.declare("min", "max")
    if "min" not in table and "max" not in table:
        return None
    low, high = table.number("min"), table.number("max")
    if low >= high:
        table.note(f"min = {low:g} is not below max = {high:g}")
    return low, high


def _variable(table: TomlTable, name: str, letters: str = "f") -> str:
    """A name for a variable of a block, which begins with one of some letters; empty stays empty."""
    if not name:
        return name
    if not re.fullmatch(rf"[{letters}][A-Z0-9]\w*", name, re.ASCII) or name.endswith("_") or "__" in name:
        first = "f, for the number of a class n," if "n" in letters else "f"
        table.note(f"name = {shown(name)}: {first} and a capital letter, then letters, digits and single underscores")
    elif is_keyword(name) or is_foreign(name):
        table.note(f"name = {shown(name)} is a reserved word of a compiler")
    elif len(name) > MAX_IDENTIFIER:
        table.note(f"name = {shown(name)} is longer than {MAX_IDENTIFIER} characters")
    return name
