"""The compiler from end to end: load, compile, plan, print, install."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any, TypedDict, Unpack

from st_codegen.emit import output
from st_codegen.emit.blocks import comparison
from st_codegen.emit.blocks.application import AS_SOLUTION, Packaging, ProjectForm
from st_codegen.emit.blocks.listing import Cuts
from st_codegen.emit.blocks.model import Extras, Limits, block_name
from st_codegen.emit.contents import Contents
from st_codegen.emit.render import print_plans
from st_codegen.emit.targets import TARGETS, FilePlan, Target, target_named
from st_codegen.errors import InputError, TargetError, counted
from st_codegen.files.html_text import html_table
from st_codegen.files.made_by import VERSION
from st_codegen.files.text import make_folder
from st_codegen.ir import AnyArray, FloatArray, KernelSum, ModelIR, Output, TreeEnsemble
from st_codegen.passes.choose import Choices, CostFunction, Layout, Options, simple_cost
from st_codegen.passes.pipeline import Compiled, compile_models, unchanged
from st_codegen.project.build_options import option_name
from st_codegen.project.bundle import Bundle, load
from st_codegen.project.purpose import Purpose
from st_codegen.proof.emitted import check_emitted, reader
from st_codegen.proof.isolated import isolated
from st_codegen.proof.probes import range_source, stated_range
from st_codegen.proof.prove.range_bound import largest_loss
from st_codegen.proof.vectors import check_row, reference_vectors

#: More elements, or bytes, than any table has.
_UNLIMITED = 2**31 - 1
#: Larger files are slow in a development environment, and no review reads them; nobody states a limit.
_LARGE_FILE = 2_000_000
#: Bytes of tables whose text takes a second to read.
_LARGE_TABLES = 5_000_000
#: What the manifest calls the places where arrays were cut, and the limit that they were cut at.
_CUTS, _CUT_AT = "cuts", "cut_at"
#: Blocks that an error names
_NAMED = 5
#: For each option that not every target has the attribute of those that do, and what is said of the others.
_ABILITIES = {
    "with_tests": ("has_tests", "has no test suites"),
    "with_configuration": ("has_configuration", "has its own tasks"),
    "with_comparison": ("has_comparison", "has no clock"),
    "project": ("has_project_forms", "has no forms of a project"),
    "self_check": ("compiles", "has the models' numbers in files, not in blocks"),
    "with_age": ("compiles", "has blocks that wait for the vendor's runtime"),
    "outputs_per_cycle": ("compiles", "asks for all models in each call"),
}


@dataclass(frozen=True, repr=False)
class Generated:
    """What one run wrote: the folder of the target, its files with their sizes in bytes, and why it looks as it does.

    `facts` is what the manifest says of models and blocks, `purpose` what the printed models are for. `changed` names
    the files of an earlier run that would have been removed, had nobody changed them, `removed` those that were.
    """

    target: str
    folder: Path
    files: dict[str, int]
    compiled: Compiled
    purpose: Purpose | None
    facts: dict[str, Any]
    changed: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Generated({self.folder}: {counted(len(self.files), 'file')}, {sum(self.files.values()):,} bytes)"

    def _repr_html_(self) -> str:
        return html_table(repr(self), ("model", "layout", "block", "bytes of tables"), self.models())

    def models(self) -> list[tuple[str, str, str, str]]:
        """For each model: its name, its layout, the block that computes it and the bytes of the block's tables."""
        rows = []
        for name, facts in self.facts["models"].items():
            size = self.facts["blocks"].get(facts["block"], {}).get("data_bytes", 0)
            block = facts["block"] + (" (shared)" if facts["shared"] else "")
            rows.append((name, facts["layout"], block, f"{size:,}"))
        return rows


class Wishes(TypedDict, total=False):
    """What `generate` and `differences` take beside models, target and folder; `generate` explains each."""

    max_array: int | None
    options: Options | None
    with_tests: bool
    with_configuration: bool
    with_comparison: bool
    packaging: Packaging | None
    self_check: bool
    with_age: bool
    cost: CostFunction
    relayout: bool


def wishes_of(given: Mapping[str, Any], targets: Sequence[Target]) -> dict[str, Wishes]:
    """What is wished for each of several targets, by its name, from options by their names on the command line.

    Options that are missing have their defaults. Raises InputError for what only libraries have.
    """
    known = Options()
    options = Options(
        Layout(given.get("layout", known.layout)),
        table_bytes=1024 * given["table_limit"] if "table_limit" in given else known.table_bytes,
        outputs_per_cycle=given.get("outputs_per_cycle"),
        data_bytes=given.get("max_bytes"),
    )
    packaging = _packaging(given)
    able = any(target.has_project_forms for target in targets)
    flags = ("with_tests", "with_configuration", "with_comparison", "self_check", "with_age", "relayout")
    return {
        target.name: Wishes(
            max_array=given.get("max_array"),
            options=options,
            packaging=packaging if target.has_project_forms or not able else None,
            **{flag: given.get(flag, False) for flag in flags},  # type: ignore[typeddict-item]
        )
        for target in targets
    }


def _packaging(given: Mapping[str, Any]) -> Packaging:
    """The form of the project. Raises InputError for what only libraries have."""
    form = ProjectForm(given.get("project", AS_SOLUTION.form))
    keys = ("library_version", "company", "namespace")
    version, company, namespace = (given.get(key) for key in keys)
    wrong = [option_name(key) for key in keys if given.get(key)]
    if wrong and form is not ProjectForm.LIBRARY:
        raise InputError(f"{', '.join(wrong)}: libraries have these; give --project library, or leave them out")
    return Packaging(form, version or Packaging.version, company or "", namespace or "")


def generate(
    models: Bundle | Path | str,
    target: Target | str,
    out: Path | str,
    *,
    force: bool = False,
    announce: Callable[[str], None] | None = None,
    **wishes: Unpack[Wishes],
) -> Generated:
    """Compile models for one target and write the files to `out/<target>`.

    `models` is a folder of model files, one such file, or what `load` made of it. Loading takes most of the time of a
    small bundle: load once where several targets are generated.

    `target` is a name (`st_codegen.emit.targets.TARGETS`) or a target of your own.

    `max_array` is the largest number of elements in one array, for controllers that hold less than the target allows.
    Longer tables are cut into several, each with code of its own; some layouts cannot be cut and are then not chosen,
    and what has no other layout is refused.

    `options` say which rewrites are allowed and how large tables may get (`passes.choose.Options`). A larger table
    answers in fewer steps and takes more of the controller's memory. No layout of trees changes a bit. RBF kernels on a
    grid may have other last bits, within the bound that `verify` states, where `max_array` or the cost of the target
    decides for another layout.

    `with_tests` adds TcUnit suites that assert the library's answers on the controller, and a task that runs them. They
    cost a library in the project and a prediction of some rows by each model's library here; only targets with a test
    library have them.

    `with_configuration` writes one file that a soft PLC runs as it is: all blocks, programs that call them, and the
    CONFIGURATION that calls the programs; only portable text has it.

    `with_comparison` adds what `compare` needs on the controller: a program that runs rows of inputs through the
    models' blocks and keeps outputs and times, in a task of its own that is less urgent than all others; for a bundle
    also what `record` needs, a program that keeps the samples of a measurement. They take memory for their arrays and a
    second instance of each model's block.

    `packaging` says in which form a development environment gets the project (`ProjectForm`): a solution that opens by
    itself, which is the default, a PLC project alone, or a library; only TwinCAT's targets have the choice.

    `self_check` makes each model's block look at a few of its constants in each call and compute a row with a known
    answer in its first one; after damage its `bValid` stays FALSE. `with_age` gives each of these blocks the output
    `nAge`: the calls since its outputs were valid. `prove` does not follow what the check keeps from call to call, and
    takes blocks with `nAge`.

    `cost` prices the layouts among which is chosen. The default estimates from the model alone, in no time;
    `proof.explain.Pricing` prints, reads and counts every candidate for a real controller, which takes many times as
    long as all the rest.

    `relayout` chooses layouts and shared tables afresh. Otherwise what the files in the folder have is kept unless
    another choice saves much (`passes.choose.SAVES_MUCH`) or it is no longer possible: a model that was trained again
    changes no more than its numbers. `Generated.compiled.decisions` says where a layout changed, and why.

    `force` overwrites generated files that were changed by hand; without it such a change is shown and nothing is
    written. What editors and version control leave in a file (`emit.traces`) is no change.

    `announce` is told, before anything is put into place, which files are larger than 2 MB, with advice.

    The text is read back and checked before it replaces anything: valid in the target's dialect, of the portable subset
    where the target says so, no loop of one round. That takes about as long as printing.

    Raises InputError or TargetError, with nothing written, for what cannot be loaded or what the target cannot express.
    Raises DefectError, with nothing written, where the text is wrong, which is a defect of st-codegen.
    Files in the folder that were not generated stay; generated files of an earlier run that are no longer needed are
    removed unless their content has changed since (`Generated.changed`).
    """
    target = target_named(target) if isinstance(target, str) else target
    folder = Path(out) / target.name
    output.check_place(folder)
    settings = CompileSettings.of(target, wishes)
    with _staged(models, target, Path(out), settings, folder) as staged:
        files = {name: (staged.stage / name).stat().st_size for name in staged.names if name != output.MANIFEST}
        large = {name: size for name, size in files.items() if size > _LARGE_FILE}
        if announce is not None and large:
            announce(_large_files(folder, large, target))
        before = output.generated_names(folder)
        changed = output.install(staged.stage, folder, force=force)
    removed = tuple(name for name in before if not (folder / name).exists())
    return Generated(target.name, folder, files, staged.compiled, staged.purpose, staged.facts, changed, removed)


def differences(
    models: Bundle | Path | str,
    target: Target | str,
    out: Path | str,
    *,
    provenance: bool = False,
    **wishes: Unpack[Wishes],
) -> Iterator[output.FileChange]:
    """The files on disk that are not as `generate` would write them, each beside what it would write.

    Takes what `generate` takes, and as long. Line ends, byte order marks and what TwinCAT's development environment
    leaves in a file do not count (`emit.traces`), nor do the hashes of the model files in the manifest, unless
    `provenance` asks for them: a file that was saved again may hold the same model. Nothing is written below `out`,
    which may be read-only or missing.
    """
    target = target_named(target) if isinstance(target, str) else target
    folder = Path(out) / target.name
    output.check_place(folder)
    settings = CompileSettings.of(target, wishes)
    with _staged(models, target, None, settings, folder) as staged:
        on_disk = {name for name in output.generated_names(folder) if (folder / name).exists()}
        for name in sorted({*staged.names, *on_disk}):
            found = output.FileChange.between(name, folder, staged.stage, provenance=provenance)
            if found.before != found.after:
                yield found


class Evaluator(StrEnum):
    """Who computes predictions."""

    ST = "st"  # the emitted text, run by the engine of `st`
    REFERENCE = "reference"  # the intermediate representation, in NumPy
    SOURCE = "source"  # the source library


def predict(
    bundle: Bundle, columns: dict[str, FloatArray], engine: Evaluator, *, table: str = "the table of inputs"
) -> dict[str, AnyArray]:
    """Predict every model for columns of inputs (see `proof.predict.predict`).

    `Evaluator.ST` generates the project for TwinCAT into a temporary folder first.
    """
    from st_codegen.proof import predict as predictions

    if engine is Evaluator.REFERENCE:
        return predictions.predict(bundle, columns, predictions.by_reference, table=table)
    if engine is Evaluator.SOURCE:
        with isolated(bundle.models) as models:
            return predictions.predict(
                dataclasses.replace(bundle, models=models), columns, predictions.by_library, table=table
            )
    target = target_named("twincat")
    # no controller has to hold this text: no table is too large
    wishes = Wishes(max_array=_UNLIMITED, options=Options(data_bytes=_UNLIMITED), relayout=True)
    with _staged(bundle, target, None, CompileSettings.of(target, wishes), Path(), is_read=False) as staged:
        code = check_emitted(staged.stage, target.dialect, portable=target.is_portable)
        return predictions.predict(bundle, columns, predictions.by_text(code), table=table)


@dataclass(frozen=True)
class CompileSettings:
    """How a bundle is compiled for one target."""

    limits: Limits
    options: Options
    with_tests: bool = False
    with_configuration: bool = False
    with_comparison: bool = False
    packaging: Packaging = AS_SOLUTION
    self_check: bool = False
    with_age: bool = False
    cost: CostFunction = simple_cost
    relayout: bool = False

    @classmethod
    def of(cls, target: Target, wishes: Wishes) -> CompileSettings:
        """The settings of `generate`. Raises TargetError for what the target does not have."""
        given: dict[str, Any] = {key: value for key, value in wishes.items() if value is not None}
        limits = limits_for(target, given.pop("max_array", None))
        options = given.pop("options", Options())
        data_bytes = limits.data_bytes if options.data_bytes is None else options.data_bytes
        options = dataclasses.replace(options, max_array=limits.max_array, data_bytes=data_bytes)
        settings = cls(limits, options, **given)
        settings._check(target)
        return settings

    def _check(self, target: Target) -> None:
        """Raise TargetError for what the target does not have."""
        formed, spread = self.packaging != AS_SOLUTION, self.options.outputs_per_cycle
        wished = {**vars(self), "project": formed, "outputs_per_cycle": spread}
        for option, (ability, lack) in _ABILITIES.items():
            if wished[option] and not getattr(target, ability):
                able = ", ".join(name for name, other in TARGETS.items() if getattr(other, ability))
                raise TargetError(f"the target {target.name} {lack}; {option_name(option)} goes with {able}")
        if (self.with_tests or self.with_comparison) and self.packaging.form is ProjectForm.LIBRARY:
            wrong = "--with-tests" if self.with_tests else "--with-comparison"
            raise TargetError(f"a library has no task that runs programs: leave out {wrong} or --project library")

    def remark(self, target: Target, layout: str | None) -> str:
        """By what a block was generated: version, layout, and the options that shape it where they are no defaults."""
        usual, own = Options(), self.options
        given = {
            "layout": own.layout if own.layout != usual.layout else None,
            "table_limit": own.table_bytes // 1024 if own.table_bytes != usual.table_bytes else None,
            "outputs_per_cycle": own.outputs_per_cycle,
            "max_array": own.max_array if own.max_array != target.limits.max_array else None,
        }
        words = [f"{option_name(option)} {value}" for option, value in given.items() if value is not None]
        words += [option_name(flag) for flag in ("self_check", "with_age") if getattr(self, flag)]
        options = f", options {' '.join(words)}" if words else ""
        return f"Generated by: st-codegen {VERSION}{f', layout {layout}' if layout else ''}{options}"


@dataclass(frozen=True)
class _Staged:
    """A finished project in a temporary folder, and how it was made."""

    stage: Path
    compiled: Compiled
    purpose: Purpose | None
    facts: dict[str, Any]

    @property
    def names(self) -> list[str]:
        """All files, by their path below the folder."""
        return sorted(path.relative_to(self.stage).as_posix() for path in self.stage.rglob("*") if path.is_file())


@contextmanager
def _staged(
    models: Bundle | Path | str,
    target: Target,
    out: Path | None,
    settings: CompileSettings,
    folder: Path,
    *,
    is_read: bool = True,
) -> Iterator[_Staged]:
    """Load, compile, plan and print below `out`, or in the system's temporary folder; `folder` has an earlier run's.

    What the caller does with the printed files is the last step; it reads them itself where they are not `is_read`.
    """
    bundle = models if isinstance(models, Bundle) else load(models)
    before = {} if settings.relayout else output.read_manifest(folder).facts[output.CHOICES]
    compiled, purpose = _compiled(bundle, target, settings, _earlier(before))
    cuts = _earlier_cuts(before, settings.limits.max_array)
    is_large = sum(decision.candidates[0].cost.table_bytes for decision in compiled.decisions) > _LARGE_TABLES
    with reader(is_large=is_read and is_large) as other:  # who gets ready while the text is planned
        plans = _planned(bundle, compiled, purpose, target, settings, cuts)
        # whose text is mostly code first: it takes longer to read than to print, tables do not
        files = print_plans(target, sorted(plans, key=lambda plan: sum(block.table_bytes for block in plan.blocks)))
        known = facts(bundle, compiled, purpose, plans, settings.limits.max_array)
        if out is not None:
            make_folder(out)
        with output.staged(out or Path(tempfile.gettempdir()), files, known, other.tell) as stage:
            if is_read and not other.finds_in_order(stage, target.dialect, portable=target.is_portable):
                check_emitted(stage, target.dialect, portable=target.is_portable)
            yield _Staged(stage, compiled, purpose, known)


def _earlier(found: Mapping[str, Any]) -> Choices:
    """What the run that left these facts in the manifest had chosen; nothing where there was none."""
    try:
        shared = {str(name): [[str(m) for m in group] for group in groups] for name, groups in found["shared"].items()}
        return Choices({str(name): str(layout) for name, layout in found["layouts"].items()}, shared)
    except (KeyError, TypeError, AttributeError):  # an older manifest, or a changed one
        return Choices()


def _earlier_cuts(found: Mapping[str, Any], max_array: int) -> dict[str, Cuts]:
    """Where the blocks of that run cut their arrays; nothing where the limit was another one."""
    try:
        if found[_CUT_AT] != max_array:
            return {}
        return {str(name): tuple(tuple(map(int, cut)) for cut in cuts) for name, cuts in found[_CUTS].items()}
    except (KeyError, TypeError, ValueError, AttributeError):  # an older manifest, or a changed one
        return {}


def _cuts(plans: Sequence[FilePlan], max_array: int) -> dict[str, Any]:
    """What a later run keeps of the arrays; nothing where none is cut."""
    found = {block.name: block.cuts for plan in plans for block in plan.blocks if any(block.cuts)}
    return {_CUT_AT: max_array, _CUTS: found} if found else {}


def _compiled(
    bundle: Bundle, target: Target, settings: CompileSettings, earlier: Choices
) -> tuple[Compiled, Purpose | None]:
    """The printed models and what they are for."""
    purpose = bundle.purpose
    if purpose is None and settings.options.outputs_per_cycle is not None:
        raise TargetError(
            "--outputs-per-cycle spreads the models of a bundle: leave it out, these are blocks of their own"
        )
    if any(ir.is_real for ir in bundle.irs):
        _check_real(bundle, target, settings)
    if not target.compiles:
        return unchanged(bundle.irs), purpose
    options = dataclasses.replace(settings.options, layouts=bundle.configuration.layouts())
    compiled = compile_models(bundle.irs, options, settings.cost, together=purpose is not None, earlier=earlier)
    return compiled, None if purpose is None else purpose.settled(compiled, settings.options)


def _check_real(bundle: Bundle, target: Target, settings: CompileSettings) -> None:
    """Raise TargetError where a controller has LREAL, or something is asked for that is not made for REAL."""
    if not target.may_lack_lreal:
        able = ", ".join(name for name, other in TARGETS.items() if other.may_lack_lreal)
        raise TargetError(
            f"controllers of the target {target.name} have LREAL{target.lreal_note}; --real goes with {able}"
        )
    chosen = dict.fromkeys([settings.options.layout, *bundle.configuration.layouts().values()])
    if layouts := [layout for layout in chosen if layout not in (Layout.AUTO, Layout.TREES)]:
        raise TargetError(f"--real prints models as they were trained: leave out the layout {', '.join(layouts)}")
    if settings.self_check or bundle.configuration.windows():
        what = "a window of samples" if bundle.configuration.windows() else "--self-check"
        raise TargetError(f"{what} is written in LREAL: leave it out, or --real")


def _planned(
    bundle: Bundle,
    compiled: Compiled,
    purpose: Purpose | None,
    target: Target,
    settings: CompileSettings,
    cuts: Mapping[str, Cuts],
) -> tuple[FilePlan, ...]:
    """The files of the project. Raises TargetError where its tables do not fit the controller."""
    contents = Contents(compiled.models, bundle.configuration.application(), windows=bundle.configuration.windows())
    if purpose is not None:
        around = purpose.application(recorded=settings.with_comparison)
        contents = Contents(compiled.models, around, purpose.uses())
    around = dataclasses.replace(
        contents.around, has_configuration=settings.with_configuration, packaging=settings.packaging
    )
    contents = dataclasses.replace(contents, around=around, extras=_extras(bundle, compiled, target, settings, cuts))
    called = () if purpose is None else purpose.called_blocks()
    vectors = reference_vectors(bundle, compiled, called) if settings.with_tests else ()
    plans = tuple(target.plan(contents, settings.limits, vectors))
    if settings.with_comparison:
        # the fingerprint stands in the text, and is that of all the rest
        models = {block_name(model.name) for model in compiled.models}
        fingerprint = _fingerprint(target, plans)
        extended = partial(comparison.with_comparison, models=models, fingerprint=fingerprint, around=called)
        plans = tuple(target.plan(dataclasses.replace(contents, extended=extended), settings.limits, vectors))
    if settings.options.data_bytes is not None:
        _check_size(target, plans, settings.options.data_bytes)
    return plans


def _extras(
    bundle: Bundle, compiled: Compiled, target: Target, settings: CompileSettings, cuts: Mapping[str, Cuts]
) -> dict[str, Extras]:
    """What the block of each printed model has beside the model."""
    layouts = {**compiled.choices.layouts, **dict.fromkeys(compiled.shared, "table")}
    found = {}
    for model in compiled.models:
        remarks = (settings.remark(target, layouts.get(model.name)), *bundle.configuration.remarks(model.source.file))
        row = check_row(bundle.irs, compiled, model) if settings.self_check else None
        own = cuts.get(block_name(model.name), ())
        lost = largest_loss(model) if model.is_real else ()
        found[model.name] = Extras(remarks, settings.self_check, row, settings.with_age, own, lost)
    return found


def _fingerprint(target: Target, plans: Sequence[FilePlan]) -> int:
    """64 bits of the SHA-256 of all texts with their paths."""
    found = hashlib.sha256()
    for file in print_plans(target, plans):
        found.update(f"{file.path}\n".encode())
        for piece in file.pieces:
            found.update(piece.encode())
    return int.from_bytes(found.digest()[:8], "big")


def limits_for(target: Target, max_array: int | None) -> Limits:
    """The target's limits, with the user's own bound on the length of an array."""
    return target.limits if max_array is None else dataclasses.replace(target.limits, max_array=max_array)


def _large_files(folder: Path, sizes: Mapping[str, int], target: Target) -> str:
    """What to know of large files, and what makes them smaller; sizes: bytes by their names in the folder."""
    advice = "fewer or smaller trees, fewer support vectors or neurons"
    if target.compiles:
        advice += "; --layout ranked or a smaller --table-limit where tables are large (--explain shows sizes)"
    largest = max(sizes, key=lambda name: sizes[name])
    others = f", the largest of {len(sizes)} files with more than {_LARGE_FILE / 1e6:g} MB" if len(sizes) > 1 else ""
    return (
        f"warning: {folder / largest} has {sizes[largest] / 1e6:.1f} MB of text{others}; development environments may "
        f"need minutes for so much. What makes it less: {advice}"
    )


def _check_size(target: Target, plans: Sequence[FilePlan], limit: int) -> None:
    """Raises TargetError that names the largest blocks where all tables together are larger than the limit."""
    blocks = {block.name: block.table_bytes for plan in plans for block in plan.blocks}
    total = sum(blocks.values())
    if total <= limit:
        return
    largest = [item for item in sorted(blocks.items(), key=lambda item: -item[1])[:_NAMED] if item[1]]
    names = ", ".join(f"{name} {size:,}" for name, size in largest)
    others = sum(size > 0 for size in blocks.values()) - len(largest)
    more = f" and {counted(others, 'smaller one')}" if others else ""
    raise TargetError(
        f"the tables take {total:,} bytes, the limit of the target {target.name} is {limit:,}; the largest: "
        f"{names}{more}. Train smaller models, or raise the limit with "
        "--max-bytes if your controller has the memory"
    )


def facts(
    bundle: Bundle, compiled: Compiled, purpose: Purpose | None, plans: Sequence[FilePlan], max_array: int
) -> dict[str, Any]:
    """What a reviewer asks first, for the manifest: models with their sizes and ranges, and what they are for."""
    return {
        "models": {model.name: _model_facts(model, compiled) for model in bundle.irs},
        "blocks": {block.name: {"data_bytes": block.table_bytes} for plan in plans for block in plan.blocks},
        output.PURPOSE: {} if purpose is None else purpose.facts(),
        **_comparison_facts(compiled, purpose, plans),
        output.CHOICES: {**dataclasses.asdict(compiled.choices), **_cuts(plans, max_array)},
        output.PROVENANCE: dict(
            pair
            for model in bundle.irs
            if model.source.file_sha256
            for pair in ((model.source.file, model.source.file_sha256), *model.source.data_files)
        ),
    }


def _comparison_facts(compiled: Compiled, purpose: Purpose | None, plans: Sequence[FilePlan]) -> dict[str, Any]:
    """Which blocks the program of the comparison can run; empty where there is none."""
    lists = [plan.values["list"] for plan in plans if "list" in plan.values]
    signals = next((signals for signals in lists if signals.name == comparison.LIST), None)
    if signals is None:
        return {}
    blocks = [block for plan in plans for block in plan.blocks]
    called = () if purpose is None else purpose.called_blocks()
    compared = comparison.compared_blocks(blocks, {block_name(model.name) for model in compiled.models}, called)
    return {output.COMPARISON: comparison.facts(compared, signals)}


def _model_facts(model: ModelIR, compiled: Compiled) -> dict[str, Any]:
    location = compiled.locations[model.name]
    trees = [op for op in model.ops if isinstance(op, TreeEnsemble)]
    kernels = [op for op in model.ops if isinstance(op, KernelSum)]
    lower, upper = stated_range(model)
    return {
        "block": block_name(location.model),
        "block_outputs": list(location.outputs),
        "shared": location.model != model.name,
        "layout": compiled.choices.layouts.get(model.name, "model"),
        "library": f"{model.source.library} {model.source.version}",
        "class": model.source.model_class,
        "digest": model.source.digest,
        "exact": model.exact,
        **({"real": [lost if math.isfinite(lost) else None for lost in largest_loss(model)]} if model.is_real else {}),
        "accepts_nan": model.accepts_nan,
        "features": [
            {
                "name": f.name,
                "unit": f.unit,
                "limited": f.lower is not None,
                "range": [float(low), float(high)],
                "range_from": range_source(f).value,
            }
            for f, low, high in zip(model.features, lower, upper, strict=True)
        ],
        "outputs": list(model.outputs),
        **({"ports": [_port_facts(port) for port in model.ports]} if model.ports else {}),
        **({} if model.classes is None else {"labels": list(model.classes.labels)}),
        **({"kinds": list(model.kinds)} if model.kinds else {}),
        "trees": sum(op.n_trees for op in trees),
        "nodes": sum(op.n_nodes for op in trees),
        "support_vectors": sum(len(op.support_vectors) for op in kernels),
    }


def _port_facts(port: Output) -> dict[str, Any]:
    """Unit and plausible range of an output that the user described."""
    return {"unit": port.unit, **({} if port.lower is None else {"range": [port.lower, port.upper]})}
