"""A model: features in, operations, numbers out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.base import ColumnFunction, Function, Operation, Operator
from st_codegen.ir.cells import Rank
from st_codegen.ir.decisions import ArgMax, Classes, Exceeds, OutputKind
from st_codegen.ir.operations import Activation, Clip, Combine, Scale, Select
from st_codegen.ir.scan import Scan
from st_codegen.ir.trees import TreeEnsemble


@dataclass(frozen=True)
class Feature:
    """One input of a model.

    `lower` and `upper` are the range to which the generated block limits the input, in `unit`; a lone model declares
    none, and where both are the same the model knows that one value. `flagged` is a range outside of which bInRange is
    FALSE and the input stays as it is. `seen` is a range whose ends are said to be in the training data, which may
    reach further: nothing is limited to it. `variable` is the name of the block's input where it is not made of `name`.
    """

    name: str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    variable: str = ""
    flagged: tuple[float, float] | None = None
    seen: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for low, high in filter(None, (self.flagged, self.seen)):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InputError(f"feature '{self.name}': the range {low} .. {high} is empty or not finite")
        for bound in (self.lower, self.upper):
            if bound is not None and not math.isfinite(bound):
                raise InputError(f"feature '{self.name}': the range {self.lower} .. {self.upper} is not finite")
        if (self.lower is None) != (self.upper is None):
            raise InputError(f"feature '{self.name}': give both ends of the range, or none")
        if self.lower is not None and self.upper is not None and not self.lower <= self.upper:
            raise InputError(f"feature '{self.name}': the range {self.lower} .. {self.upper} is empty")

    def is_below(self, magnitude: float) -> bool:
        """Whether the declared range keeps the input below a magnitude."""
        return self.lower is not None and self.upper is not None and max(-self.lower, self.upper) < magnitude

    @property
    def checked(self) -> tuple[float, float] | None:
        """The range outside of which bInRange is FALSE."""
        return self.flagged if self.lower is None or self.upper is None else (self.lower, self.upper)


@dataclass(frozen=True)
class Output:
    """One output of a model: the block's variable, its unit, and what is plausible (None: everything)."""

    variable: str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True)
class Source:
    """Where a model comes from, as printed in the header of the generated block.

    `digest` is that of what was read from the file (`ir.digest`). `file_sha256` is the file's own: files that hold the
    same model may differ, so that it is never printed. `data_files`: the path of each file beside it in which its
    numbers stand, and its SHA-256.
    """

    library: str
    version: str
    model_class: str
    file: str = ""
    digest: str = ""
    file_sha256: str = ""
    data_files: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class ModelIR:
    """One trained model: features in, numbers out.

    `outputs` names the columns of the last value. `accepts_nan`: NaN is a missing value to the library, but for the
    inputs numbered in `must_be_present`; otherwise it refuses the row. `magnitude_limits`: for each feature, the
    magnitude from which on the library refuses an input (infinity: it refuses infinities only; None: it takes
    everything). Empty: it takes everything. `accepted`: for each feature the closed interval of numbers for which there
    is an answer (None, or empty: no interval), once the feature is limited to its declared range. `ports`: the
    block's outputs that the user named, the first ones. `classes`: the labels of a classifier, whose first output is
    the number of one of them. `is_real`: its block computes in REAL, with REAL inputs
    (`passes.real`). `estimates`: what each output of a Gaussian process or a PCA is; `kinds` says it for all models.
    `open_zeros`: operations stand for one of the library's that give 0 where it may give -0.
    """

    name: str
    features: tuple[Feature, ...]
    ops: tuple[Operation, ...]
    outputs: tuple[str, ...]
    source: Source
    accepts_nan: bool = False
    must_be_present: tuple[int, ...] = ()
    magnitude_limits: tuple[float | None, ...] = ()
    accepted: tuple[tuple[float, float] | None, ...] = ()
    classes: Classes | None = None
    ports: tuple[Output, ...] = ()
    is_real: bool = False
    estimates: tuple[OutputKind, ...] = ()
    open_zeros: bool = False

    def __post_init__(self) -> None:
        self._check_ports()
        if not self.features:
            raise InputError(f"model '{self.name}' has no features")
        if not self.magnitude_limits:
            object.__setattr__(self, "magnitude_limits", (None,) * len(self.features))
        for limits in (self.magnitude_limits, self.accepted or self.features):
            if len(limits) != len(self.features):
                raise InputError(
                    f"model '{self.name}': {counted(len(limits), 'limit')}, {counted(len(self.features), 'feature')}"
                )
        if not self.ops:
            raise InputError(f"model '{self.name}' computes nothing")
        for number, op in enumerate(self.ops):
            if not op.inputs or any(not 0 <= value <= number for value in op.inputs):
                raise InputError(f"model '{self.name}', operation {number}: reads a value that is not yet computed")
            self._check_operands(number, op)
        if self.ops[-1].width != len(self.outputs):
            raise InputError(
                f"model '{self.name}': {counted(len(self.outputs), 'output')} named, {self.ops[-1].width} computed"
            )
        if self.kinds and len(self.kinds) != len(self.outputs):
            raise InputError(
                f"model '{self.name}': {counted(len(self.kinds), 'kind')} of {counted(len(self.outputs), 'output')}"
            )

    @property
    def refused_from(self) -> tuple[float | None, ...]:
        """For each feature the magnitude from which on its block refuses it: None where its declared range is below."""
        return tuple(
            None if limit is None or feature.is_below(limit) else limit
            for feature, limit in zip(self.features, self.magnitude_limits, strict=True)
        )

    def _check_ports(self) -> None:
        """Raises InputError where what is said of the block's outputs does not fit the model."""
        if not self.ports:
            return
        where, given, there = f"model '{self.name}'", len(self.ports), len(self.outputs)
        if given > there or (given < there and not self.kinds):
            kinds = f" ({', '.join(self.kinds)}); --outputs or gives adds others" if self.kinds else ""
            raise InputError(f"{where}: {counted(given, 'output')} described, it has {there}{kinds}")
        if self.classes is not None and any(port.lower is not None for port in self.ports):
            raise InputError(f"{where}: the outputs of a classifier have no min and max")
        for number, variable in enumerate(self.variables):
            letter = "f" if number or self.classes is None else "n"
            if not variable.startswith(letter):
                what = "the number of a class" if letter == "n" else "a number"
                raise InputError(f"{where}: output {variable} is {what}; its name begins with {letter}")
        if len({variable.lower() for variable in self.variables}) < there:
            raise InputError(f"{where}: two outputs have the same name; they are {', '.join(self.variables)}")

    def takes_nan(self, feature: int) -> bool:
        """Whether NaN in an input is a missing value."""
        return self.accepts_nan and feature not in self.must_be_present

    def _check_operands(self, number: int, op: Operation) -> None:
        where = f"model '{self.name}', operation {number} ({type(op).__name__})"
        widths = [self.value_width(value) for value in op.inputs]
        if op.operand_width is not None and any(width != op.operand_width for width in widths):
            raise InputError(
                f"{where}: expects {counted(op.operand_width, 'column')}, gets {' and '.join(map(str, widths))}"
            )
        try:
            op.check_operands(sum(widths))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    @property
    def accepted_numbers(self) -> tuple[tuple[float, float] | None, ...]:
        """For each feature the interval in which a number must lie, or None."""
        return self.accepted or (None,) * len(self.features)

    def value_width(self, value: int) -> int:
        """Number of columns of value `value` (0: the inputs)."""
        return len(self.features) if value == 0 else self.ops[value - 1].width

    @property
    def n_nodes(self) -> int:
        """Nodes of all its trees together."""
        return sum(op.n_nodes for op in self.ops if isinstance(op, TreeEnsemble))

    def reads_ranks(self, op: Operation) -> bool:
        """Whether the only operand of an operation is a list of ranks."""
        return len(op.inputs) == 1 and op.inputs[0] > 0 and isinstance(self.ops[op.inputs[0] - 1], Rank)

    def __repr__(self) -> str:
        """What it is in a line; the numbers of a model fill pages."""
        ops = ", ".join(dict.fromkeys(type(op).__name__ for op in self.ops))
        ends = counted(len(self.features), "feature"), counted(len(self.outputs), "output")
        return f"ModelIR({self.name!r}: {ends[0]} -> {ops} -> {ends[1]})"

    @property
    def variables(self) -> tuple[str, ...]:
        """The block's output for each output of the model: fOut1, .. where the user gave no name.

        A classifier has nClass in front of them. Names of whole numbers begin with n, all others with f.
        """
        first = 1 if self.classes is None else 0
        names = tuple(f"fOut{first + n}" if first + n else "nClass" for n in range(len(self.outputs)))
        return (*(port.variable for port in self.ports), *names[len(self.ports) :])

    @property
    def kinds(self) -> tuple[OutputKind, ...]:
        """What each output is, of a model that computes some of them on demand; empty for all others."""
        return self.estimates if self.classes is None else self.classes.kinds

    @property
    def exact(self) -> bool:
        """Whether every output equals the source library's: bit for bit where `signs_zeros`."""
        return all(op.exact for op in self.ops)

    @property
    def signs_zeros(self) -> bool:
        """Whether the sign of a zero is the library's too: which of 0 and -0 MAX and MIN give, compilers leave open.

        What only compares takes both for the same.
        """
        reached: set[int] = set()
        todo = [len(self.ops)]
        while todo:
            value = todo.pop()
            if value and value not in reached:
                reached.add(value)
                op = self.ops[value - 1]
                compares = isinstance(op, Rank | ArgMax | Exceeds) or (isinstance(op, TreeEnsemble) and not op.linear)
                todo += () if compares else op.inputs
        return not self.open_zeros and not any(_opens_zeros(self.ops[value - 1]) for value in reached)


def _opens_zeros(op: Operation) -> bool:
    """Whether an operation takes the larger or the smaller of what may be 0 and -0."""
    if isinstance(op, Scale | Combine):
        return op.operator in (Operator.MAXIMUM, Operator.MINIMUM)
    if isinstance(op, Scan):
        return any(map(_opens_zeros, op.body))
    if isinstance(op, Clip):
        return not (np.all(op.lower) and np.all(op.upper))
    return isinstance(op, Activation) and op.function is Function.RELU


#: For each column of a value the input that is missing where the column is; None where the column never is.
Origins = tuple[int | None, ...]


def origins_after(op: Operation, operands: Sequence[Origins]) -> Origins:
    """The origins of an operation's result.

    What mixes columns hands no missing value on: walkers refuse NaN in all that reaches it.
    """
    if isinstance(op, Select):
        joined = [column for operand in operands for column in operand]
        return tuple(joined[column] for column in op.columns)
    if isinstance(op, Rank | TreeEnsemble):
        return (None,) * op.width
    if isinstance(op, ColumnFunction):
        kept = op.keeps_missing
        return tuple(origin if kept is None or kept[column] else None for column, origin in enumerate(operands[0]))
    return operands[0] if op.width == len(operands[0]) else (None,) * op.width
