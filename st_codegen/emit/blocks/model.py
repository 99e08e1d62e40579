"""A model's function block: inputs, checks, operations, outputs."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.emit.blocks import branched_tree, cells, scan, trees  # noqa: F401 - these register the code of their operations
from st_codegen.emit.blocks.classes import class_lines
from st_codegen.emit.blocks.listing import LINE_LENGTH, ArrayElement, Block, BlockVariable, Cuts, Listing
from st_codegen.emit.blocks.operations import Step, lay_out_all
from st_codegen.emit.blocks.real_types import in_real_types
from st_codegen.emit.blocks.self_check import CheckRow, add_self_check
from st_codegen.emit.foreign_names import is_foreign
from st_codegen.emit.literals import capitalised, check_text, harmless, identifier, real, unit_text
from st_codegen.errors import InputError, Problems, at_most, errors_name
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    Activation,
    CellTable,
    Combine,
    Feature,
    FillMissing,
    ModelIR,
    Operation,
    Output,
    Piecewise,
    Rank,
    Scale,
    Select,
    TreeEnsemble,
)
from st_codegen.ir.model import Origins, origins_after


@dataclass(frozen=True)
class Limits:
    """What a target holds.

    `max_array`: elements of an array; `real_range`: of scalar real literals (None: all); `data_bytes`: of all tables.
    """

    max_array: int = 65_536
    real_range: tuple[float, float] | None = None
    data_bytes: int = 32 * 1024 * 1024


def block_name(model: str) -> str:
    """The name of a model's function block."""
    return f"FB_{capitalised(identifier(model, 'model name', 'FB_'))}"


@dataclass(frozen=True)
class Extras:
    """What a model's block has beside the model, where it is asked for.

    `remarks` stand in its header. `self_check` makes it check its own constants, with a `row` whose answer is known
    where there is one; `aged` adds the output nAge. `cuts` are those of the block's arrays in an earlier run.
    `lost`: of a block in REAL, how far each output may lie from the library's at most, infinite where none is known.
    """

    remarks: tuple[str, ...] = ()
    self_check: bool = False
    row: CheckRow | None = None
    aged: bool = False
    cuts: Cuts = ()
    lost: tuple[float, ...] = ()


PLAIN = Extras()


def model_block(model: ModelIR, limits: Limits, extras: Extras = PLAIN) -> Block:
    """The function block of a model.

    Raises InputError for names that Structured Text cannot have, TargetError for tables that the target cannot hold.
    """
    with errors_name(f"model '{model.name}'"):
        return _block(model, Listing(limits.max_array, limits.real_range, extras.cuts), extras)


def _block(model: ModelIR, listing: Listing, extras: Extras) -> Block:
    inputs = input_variables(model.features)
    outputs = model_outputs(model)
    remarks = [*extras.remarks]
    if extras.aged:
        outputs = (*outputs, BlockVariable(AGE, "DINT", initial="2147483647", comment=_AGE))
    known = extras.row is not None and listing.table("CHECK_INPUT", "LREAL", extras.row.inputs)
    check_inputs(model, inputs, listing, known or None)
    results = _operations(model, listing, aged=extras.aged)
    if extras.self_check:
        remarks += [add_self_check(listing, results, extras.row)]
    closing = real_lines(model, extras.lost) if model.is_real else (_equality(model, is_proved=not extras.self_check),)
    block = finished_block(model, inputs, outputs, listing, model_header(model, *closing, remarks=remarks))
    return in_real_types(block) if model.is_real else block


#: The output that counts the calls since the outputs were valid.
AGE = "nAge"
_AGE = "calls since the outputs were valid, 0: they are; 2147483647: never, or so many"


def _output(model: ModelIR, number: int, name: str) -> BlockVariable:
    if model.classes is not None and number == 0:
        return BlockVariable(name, "DINT", comment="number of the class; its label stands above")
    unit = "".join(f", {port.unit}" for port in model.ports[number : number + 1] if port.unit)
    return BlockVariable(name, "LREAL", comment=f"prediction: {model.outputs[number]}{unit}")


def real_lines(model: ModelIR, lost: Sequence[float]) -> tuple[str, ...]:
    """What is lost where a block computes in REAL: `lost` by each output at most (see `Extras`)."""
    numbers = lost if model.classes is None else lost[1:]
    largest = max(numbers, default=0.0) if len(lost) else np.inf
    only_trees = all(isinstance(op, TreeEnsemble) for op in model.ops)
    lines = ["Inputs, outputs and all numbers between are REAL (--real), with about 7 digits."]
    if not largest and model.classes is None:
        equal = "bit for bit" if model.signs_zeros else "but perhaps for -0"
        lines.append(f"For inputs that are REAL numbers it is written to equal the library {equal}.")
    elif only_trees:
        lines.append(
            "For inputs that are REAL numbers every split decides as in the library, and the outputs lie within "
            f"{at_most(largest, 3)} of its own."
        )
    elif numbers and np.isfinite(largest):
        lines.append(
            "For inputs that are REAL numbers in the declared range the outputs lie within "
            f"{at_most(largest, 3)} of the library's."
        )
    elif numbers:
        lines.append("How far the outputs lie from the library's, verify bounds for each row that it tries.")
    if model.classes is not None:
        lines.append("Where rounding may turn the class, verify counts the row as open.")
    return tuple(lines)


def _equality(model: ModelIR, *, is_proved: bool = True) -> str:
    """How far the text is to equal the library: what writes it does not know whether it does.

    is_proved: `prove` asks such blocks, too.
    """
    if not model.exact:
        open_ = "" if model.classes is None else ", but for classes that it leaves open"
        return f"Written to equal the library within the bound that verify states{open_}."
    how = "bit for bit" if model.signs_zeros else "but perhaps for -0"
    comma = "" if model.signs_zeros else ","
    return (
        f"Written to equal the library{comma} {how}: {'verify and prove check' if is_proved else 'verify checks'} it."
    )


def model_outputs(model: ModelIR) -> tuple[BlockVariable, ...]:
    """The class of a classifier, the numbers, bValid, bInRange and bPlausible where inputs and outputs have ranges."""
    return (
        *(_output(model, number, name) for number, name in enumerate(model.variables)),
        BlockVariable("bValid", "BOOL", comment="the outputs belong to the inputs of this call"),
        *([BlockVariable("bInRange", "BOOL", comment=_in_range_text(model))] if is_ranged(model) else []),
        *(
            [BlockVariable("bPlausible", "BOOL", comment="the outputs are valid and lie in their plausible ranges")]
            if _plausible(model)
            else []
        ),
    )


def _in_range_text(model: ModelIR) -> str:
    if any(feature.flagged is not None for feature in model.features):
        return "where bValid: no input lies outside of its range"
    return "no input had to be limited to its declared range"


def _plausible(model: ModelIR) -> list[Output]:
    """The outputs of which a plausible range is known."""
    return [port for port in model.ports if port.lower is not None and port.upper is not None]


def finished_block(
    model: ModelIR,
    inputs: tuple[BlockVariable, ...],
    outputs: tuple[BlockVariable, ...],
    listing: Listing,
    header: tuple[str, ...],
) -> Block:
    """The block of what was laid out; inputs that have the name of one of its own variables are renamed.

    Raises InputError where such an input was given its name.
    """
    own = {name.lower() for name in listing.variables}
    for variable in outputs:
        if variable.name.lower() in own:
            raise InputError(f"the output {variable.name} has the name of a variable of the block: rename it")
    clash = own | {variable.name.lower() for variable in outputs}
    given = {feature.variable.lower() for feature in model.features if feature.variable}
    for variable in inputs:
        if variable.name.lower() in clash & given:
            raise InputError(f"the input {variable.name} has the name of another variable of the block: rename it")
    inputs = tuple(renamed(variable) if variable.name.lower() in clash else variable for variable in inputs)
    _check_different(inputs)
    return Block(
        name=block_name(model.name),
        header=header,
        inputs=inputs,
        outputs=outputs,
        variables=tuple(listing.variables.values()),
        constants=tuple(listing.constants),
        tables=tuple(listing.tables),
        sections=tuple(listing.sections),
        cuts=tuple(listing.cuts),
    )


def is_ranged(model: ModelIR) -> bool:
    """Whether any input has a range."""
    return any(feature.checked is not None for feature in model.features)


def input_variables(features: tuple[Feature, ...]) -> tuple[BlockVariable, ...]:
    """One LREAL input a feature, in order. Raises InputError for names that become equal."""
    variables: dict[str, BlockVariable] = {}
    problems = Problems()
    for feature in features:
        with problems.collect():
            try:
                name = feature.variable or f"f{capitalised(identifier(feature.name, 'feature name', 'f'))}"
            except InputError as error:
                way = "or name it in a folder's st-codegen.toml, which st-codegen init writes"
                raise InputError(f"{error}, {way}") from None
            if name.lower() in variables:
                raise InputError(
                    f"feature '{feature.name}': its input would be called {name}, as that of another feature: "
                    "rename one"
                )
            variable = BlockVariable(name, "LREAL", comment=feature_text(feature))
            variables[name.lower()] = renamed(variable) if is_foreign(name) else variable
    problems.raise_if_any()
    _check_different(variables.values())
    return tuple(variables.values())


def _check_different(inputs: Collection[BlockVariable]) -> None:
    """Raise InputError where an input that got another name has that of an input beside it."""
    names = Counter(variable.name.lower() for variable in inputs)
    for variable in inputs:
        if names[variable.name.lower()] > 1:
            raise InputError(f"two inputs would be called {variable.name}: rename their features, or give them names")


def renamed(variable: BlockVariable) -> BlockVariable:
    """The input by the name that it has where its own is taken, by a variable of its block or by a compiler."""
    return replace(variable, name=f"fInput_{variable.name[1:]}")


def feature_text(feature: Feature) -> str:
    """Name, unit and range of a feature, for comments."""
    text = harmless(feature.name) if feature.name.isascii() else feature.variable
    if feature.unit:
        text += f", {unit_text(feature.unit, f'unit of feature {feature.name}')}"
    if feature.lower is not None and feature.upper is not None:
        text += f", limited to {_range_text((feature.lower, feature.upper))}"
    if feature.flagged is not None:
        text += f", flagged outside {real(feature.flagged[0])} .. {real(feature.flagged[1])}"
    if feature.seen is not None and (
        feature.lower is None
        or feature.upper is None
        or feature.seen[0] > feature.lower
        or feature.seen[1] < feature.upper
    ):
        low, high = map(real, feature.seen)
        text += f", training data said to reach from {low} to {high} at least"
    return text


def _range_text(ends: tuple[float, float]) -> str:
    low, high = map(real, ends)
    return f"{low} only" if low == high else f"{low} .. {high}"


def limit_text(limit: float | None) -> str:
    """From which magnitude on a block refuses an input, for its header; empty where it takes all numbers."""
    if limit is None:
        return ""
    return f", magnitude below {real(limit)}" if math.isfinite(limit) else ", finite"


def accepted_text(accepted: tuple[float, float] | None) -> str:
    """Which numbers of an input have an answer, for the header; empty where no interval is said."""
    if accepted is None:
        return ""
    largest = float(np.finfo(np.float64).max)
    ends = (("from", accepted[0], -largest), ("to", accepted[1], largest))
    return ", accepted " + " ".join(f"{word} {real(end)}" for word, end, open_end in ends if end != open_end)


def model_header(model: ModelIR, *closing: str, remarks: Iterable[str] = ()) -> tuple[str, ...]:
    """Where a model comes from and what its inputs are; `closing` says what its numbers are worth.

    `remarks` are lines of their own, behind what is known of the model's file.
    """
    source = model.source
    lines = [f"{block_name(model.name)}: {source.model_class}", f"Source: {source.library} {source.version}".rstrip()]
    if source.file:
        lines.append(f"File: {source.file.encode('ascii', 'backslashreplace').decode()}")
    if source.digest:
        lines.append(f"Model digest: {source.digest}")
    lines.extend(remarks)
    lines.extend(f"Note: {harmless(note)}" for note in source.notes)
    lines.extend(
        f"Input {number}: {feature_text(feature)}{limit_text(limit)}{accepted_text(accepted)}"
        for number, (feature, limit, accepted) in enumerate(
            zip(model.features, model.refused_from, model.accepted_numbers, strict=True), 1
        )
    )
    if model.classes is not None:
        lines.extend(class_lines(model.classes))
    lines.extend(closing or (_equality(model),))
    if where := refused_where(model):
        lines.append(f"Where {where}, bValid is FALSE, even if the library goes on.")
    return header_lines(*lines)


def refused_where(model: ModelIR) -> str:
    """Where the block has no answer although its inputs are numbers, as a clause; empty where it has one everywhere."""
    said = []
    if any(op.refuses for op in model.ops if isinstance(op, Piecewise)):
        said.append(
            "a number lies where a piece of the model has no answer (outside its ends, a category unknown to it)"
        )
    elif any(ends is not None for ends in model.accepted_numbers):
        said.append("a number is not accepted")
    if any(getattr(op, "refuses", False) for op in model.ops if not isinstance(op, Piecewise)):
        said.append(
            "a number on the way does not exist or is too large (a root of a number below 0, a quotient by 0, ..)"
        )
    return ", or ".join(said)


def header_lines(*lines: str) -> tuple[str, ...]:
    """Lines of a header comment: harmless text, cut to the width of a line."""
    return tuple(
        part
        for line in lines
        for part in textwrap.wrap(check_text(line, "the header text"), LINE_LENGTH - 4, subsequent_indent="    ")
    )


def check_inputs(
    model: ModelIR, inputs: tuple[BlockVariable, ...], listing: Listing, known_row: str | None = None
) -> None:
    """Copying and checking the inputs: NaN by its bits, the declared range, the largest magnitude.

    `known_row` is a table that is read in their place where `nPass` is 0.
    """
    listing.local("aInput", "LREAL", len(inputs))
    listing.loop("nColumn", len(inputs))
    listing.locals("BOOL", "bUsable", *(["bInside"] if is_ranged(model) else []))
    if model.accepts_nan:
        # one more, which is never set, for columns in which missing values were replaced
        origins = _missing_inputs(model)
        readers = [op for op in model.ops if _reads_flags(op, origins)]
        replaced = any(None in origins[op.inputs[0]] for op in readers if not model.reads_ranks(op))
        listing.local("abMissing", "BOOL", len(inputs) + replaced)
    largest = float(np.finfo(np.float64).max)  # the range of a feature that declares none
    lower = upper = checked = None
    # that of a feature that is limited is its own: so both checks of it say the same, and prove can see that
    flagged = [feature.checked or (-largest, largest) for feature in model.features]
    if any(feature.flagged is not None for feature in model.features):
        checked = {
            "lower": listing.table("FLAG_LOWER", "LREAL", [low for low, _ in flagged]),
            "upper": listing.table("FLAG_UPPER", "LREAL", [high for _, high in flagged]),
        }
    if any(feature.lower is not None for feature in model.features):
        lower = listing.table(
            "RANGE_LOWER", "LREAL", [-largest if f.lower is None else f.lower for f in model.features]
        )
        upper = listing.table("RANGE_UPPER", "LREAL", [largest if f.upper is None else f.upper for f in model.features])
        if model.accepts_nan and checked is None:
            # what stands for a missing value is limited as well, and is not outside
            checked = {"lower": lower, "upper": upper}
    limits = _limits(model, listing)
    listing.section(
        "inputs, checked",
        "inputs",
        known_row=known_row,
        accepts_nan=model.accepts_nan,
        accepted=_accepted(model, listing),
        present=(
            listing.table("MUST_BE_PRESENT", "DINT", [int(not model.takes_nan(n)) for n in range(len(inputs))])
            if model.accepts_nan and model.must_be_present
            else None
        ),
        last=len(inputs) - 1,
        lower=lower,
        upper=upper,
        limits=limits,
        checked=checked,
    )


def _limits(model: ModelIR, listing: Listing) -> dict[str, dict[str, str | bool] | None]:
    """Tables of the largest magnitudes that are accepted: `first`, before inputs are limited, of those that are not,
    among which infinity would become the largest number, and `last`, of the ends of declared ranges.
    """
    found: dict[str, dict[str, str | bool] | None] = {"first": None, "last": None}
    for when, has_range in (("first", False), ("last", True)):
        limits = [
            0.0 if limit is None or (feature.lower is not None) != has_range else _largest_below(limit, model.is_real)
            for feature, limit in zip(model.features, model.refused_from, strict=True)
        ]
        if any(limits):
            name = "RANGE_LIMIT" if found["first"] else "INPUT_LIMIT"
            found[when] = {"table": listing.table(name, "LREAL", limits), "some": not all(limits)}
    return found


def _accepted(model: ModelIR, listing: Listing) -> dict[str, str | int]:
    """The tables of the inputs of which a number must lie in an interval; empty where there is none."""
    accepted = [(column, ends) for column, ends in enumerate(model.accepted_numbers) if ends is not None]
    if not accepted:
        return {}
    listing.loop("nColumn", len(accepted))
    return {
        "column": listing.table("ACCEPTED_INPUT", "DINT", [column for column, _ in accepted]),
        "lower": listing.table("ACCEPTED_LOWER", "LREAL", [ends[0] for _, ends in accepted]),
        "upper": listing.table("ACCEPTED_UPPER", "LREAL", [ends[1] for _, ends in accepted]),
        "last": len(accepted) - 1,
    }


def _largest_below(limit: float, is_real: bool) -> float:
    """The largest number of its type below a limit."""
    with np.errstate(over="ignore"):
        ends = (np.float32(limit), np.float32(0.0)) if is_real else (limit, 0.0)
        return float(np.nextafter(*ends))


def _operations(model: ModelIR, listing: Listing, *, aged: bool) -> list[ArrayElement]:
    """The code of all operations and of the outputs; where the outputs' numbers stand."""
    missing = _missing_inputs(model)
    *_, last = model.ops
    picked = isinstance(last, Select)  # the outputs are read where they are
    steps = []
    for number, op in enumerate(model.ops[:-1] if picked else model.ops, 1):
        # a table that has nothing but classes
        whole = model.classes is not None and isinstance(op, CellTable) and number == len(model.ops) and op.width == 1
        step = Step(
            number=number,
            widths=tuple(model.value_width(value) for value in op.inputs),
            result=f"{'anRank' if isinstance(op, Rank) else 'anClass' if whole else 'aStep'}{number}",
            ranks=model.reads_ranks(op),
            whole=whole,
            missing=(
                tuple(len(model.features) if origin is None else origin for origin in missing[op.inputs[0]])
                if model.accepts_nan and _reads_flags(op, missing)
                else None
            ),
            type="REAL" if model.is_real else "LREAL",
            fits_real=model.is_real
            or (op.inputs == (0,) and all((limit or np.inf) <= FLOAT32_OVERFLOW for limit in model.magnitude_limits)),
        )
        steps.append(step)
    lay_out_all("aInput", model.ops, steps, listing)
    names = ["aInput", *(step.result for step in steps)]
    results = [ArrayElement(names[-1], number) for number in range(len(model.outputs))]
    if isinstance(last, Select):
        sources = [last.source(number, model.value_width) for number in range(last.width)]
        results = [ArrayElement(names[value], column) for value, column in sources]
    _write_outputs(model, listing, results, aged=aged)
    return results


def _write_outputs(model: ModelIR, listing: Listing, results: list[ArrayElement], *, aged: bool) -> None:
    """The code that hands on the outputs, and asks whether they are plausible."""
    listing.section(
        "outputs",
        "outputs",
        assignments=[
            {
                "output": variable,
                "value": value,
                "cut": model.classes is not None and number == 0 and value.name.startswith("aStep"),
            }
            for number, (variable, value) in enumerate(zip(model.variables, results, strict=True))
        ],
        ranged=is_ranged(model),
        aged=aged,
        plausible=[
            {
                "output": port.variable,
                "lower": listing.constant(f"PLAUSIBLE_LOWER_{number}", float(port.lower or 0.0)),
                "upper": listing.constant(f"PLAUSIBLE_UPPER_{number}", float(port.upper or 0.0)),
            }
            for number, port in enumerate(_plausible(model), 1)
        ],
    )


def _reads_flags(op: Operation, origins: Sequence[Origins]) -> bool:
    """Whether the code of an operation asks which of its columns are missing."""
    if isinstance(op, Activation | Scale | Combine):  # 0.0, which stands for a missing value, may have no answer
        return op.refuses and any(origin is not None for origin in origins[op.inputs[0]])
    return isinstance(op, FillMissing | Piecewise | Rank | TreeEnsemble)


def _missing_inputs(model: ModelIR) -> list[Origins]:
    """For each value and column, the input that decides whether it is missing."""
    values: list[Origins] = [tuple(range(len(model.features)))]
    for op in model.ops:
        values.append(origins_after(op, [values[value] for value in op.inputs]))
    return values
