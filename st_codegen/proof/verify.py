"""The proof: source library = reference = emitted text, on rows chosen to make them differ.

For each model three answers are computed: by the source library alone, by the reference evaluation of the intermediate
representation, and by the emitted text, which the engine of `st` runs. An exact model must agree in every bit; another
one within the bound that `bounds` derives for the very row. Rows that the library refuses must be flagged by the block.
The library answers in a process of its own (`isolated`); where it has no answer for a row that it should take, or for
any, the report says so with the library's reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from st_codegen.cost.profile import Profile
from st_codegen.cost.report import ProjectCost, project_cost
from st_codegen.emit.blocks.comparison import PROGRAM
from st_codegen.emit.blocks.self_test import SELF_TEST
from st_codegen.emit.blocks.tests import TEST_TASK
from st_codegen.emit.output import block_of, is_real
from st_codegen.errors import GeneratedCodeError
from st_codegen.ir import ModelIR, TreeEnsemble
from st_codegen.processes import Progress, shared_out
from st_codegen.project.bundle import Bundle
from st_codegen.project.purpose import BlockCheck
from st_codegen.proof.agreement import block_report, model_report
from st_codegen.proof.arithmetic import arithmetic_of
from st_codegen.proof.isolated import isolated
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.prove.prove import is_followed, prove_model
from st_codegen.proof.prove.range_bound import real_remarks
from st_codegen.proof.runner import GeneratedCode, target_folders
from st_codegen.proof.verify_report import ModelReport, VerifyReport, merged
from st_codegen.proof.windows import window_checks
from st_codegen.st.check.flow import all_reached
from st_codegen.st.tree import PouKind
from st_codegen.walkers.base import LoadedModel

#: What trying a row on a tree takes about.
_SECONDS_A_ROW = 5e-7
#: What proving takes for a tree, and for a node of it: `python benchmarks/prove.py 300 31` took 2.1 s of the processor,
#: `python benchmarks/prove.py 50 1001` (2,001 nodes a tree) took 1.4 s.
_SECONDS_A_TREE, _SECONDS_A_NODE = 6.5e-3, 1.1e-5
#: What is no part of an application: it runs once, for `compare`, or for tests.
_ASIDE = (SELF_TEST, PROGRAM, *TEST_TASK.programs)


@dataclass(frozen=True)
class Budget:
    """The time of one cycle on one machine, in us (None: no limit), and the blocks that it runs.

    Without `entries`: the programs that its tasks call.
    """

    profile: Profile
    cycle_us: float | None = None
    entries: tuple[str, ...] = ()


def verify(
    bundle: Bundle,
    generated: Path | str,
    *,
    rows: int = 10_000,
    seed: int = 0,
    budget: Budget | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> VerifyReport:
    """Compare the library, the reference and every generated target below `generated`, row by row.

    `bundle` must be what the targets were generated from: a model that has changed since is an error or a difference.

    `generated` is the folder that `generate` wrote to, or that of one target. Every target in it is parsed, checked and
    run; each costs as much as the first.

    `rows` is how many rows are tried for each model. Special values and all thresholds with their neighbours come
    first, even where they are more than that; the rest are drawn at random from the declared range, one in ten up to
    half its width outside. The result says something of these rows. More rows cost time in proportion; batches bound
    the memory.

    `seed` chooses the random rows. The same seed tries the same rows on every machine; another one tries others.

    `budget` asks for the worst case of one cycle as well, from the emitted text, on the controller of a profile
    (`Budget`). It costs a walk over all paths of the text, seconds for a bundle; what does not fit fails the report.

    `progress` is told of models, and of the blocks around them by their target, as they are tried.

    `jobs` is how many models are tried at the same time (None: one a processor), in copies of this process or, where
    there are none, in threads. The report does not depend on it; each model that is tried takes memory for its rows.

    Raises GeneratedCodeError where there is nothing to verify, or the text cannot be read or would stop a controller.
    """
    if is_real(Path(generated)) != any(ir.is_real for ir in bundle.irs):
        raise GeneratedCodeError(
            f"{generated}: generated with --real, or the models were loaded with it: load(.., real=True) and "
            "generate --real go together"
        )
    targets = {folder.name: GeneratedCode(folder) for folder in target_folders(Path(generated))}
    # Predictors silence their warnings one by one, which is not safe in threads; here all are silent together
    with isolated(bundle.models) as models, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tried = [_Task(model.ir.name, partial(_verify_model, model, targets, rows, seed)) for model in models]
        around = list(_block_tasks(bundle, targets, seed))
        timed = [] if budget is None else [_cost_task(name, code, budget) for name, code in targets.items()]
        made = _done([*around, *timed, *tried], progress, jobs)  # what takes longest begins first
    reports = [report for task in (*tried, *around) for report in made[task]]
    costs = {
        name: ProjectCost(budget.profile, blocks, entries)
        for task in timed
        for name, blocks, entries in made[task]
        if budget is not None
    }
    around_models = [report.name for task in around for report in made[task]]
    notes = {}
    for name, code in targets.items():
        run = [*around_models, *(block_of(code.folder, ir)[0] for ir in bundle.irs)]
        if note := "; ".join(filter(None, (arithmetic_of(name).note, _not_run(code, run)))):
            notes[name] = note
    notes |= real_remarks(bundle.irs)
    followed = any(is_followed(ir, code) for code in targets.values() for ir in bundle.irs)
    return VerifyReport(tuple(merged(reports)), notes, costs, None if budget is None else budget.cycle_us, followed)


def cycle_cost(code: GeneratedCode, profile: Profile, entries: tuple[str, ...] = ()) -> ProjectCost:
    """The worst case of a cycle of generated text: of `entries`, else of what its tasks call (see `project_cost`).

    FB_SelfTest, which runs once, is part of no cycle unless it is named or a program calls it; nor are the programs of
    `compare` and of test suites, which do not run in operation. Programs of several tasks are added up, for they share
    a processor. Raises GeneratedCodeError for an unknown entry.
    """
    names = {name.upper() for name in code.project.pous}
    missing = [name for name in entries if name.upper() not in names]
    if missing:
        raise GeneratedCodeError(f"{code.folder}: no block {', '.join(missing)}")
    tasks = tuple(name for name in code.task_programs if name.upper() in names and name not in _ASIDE)
    return project_cost(code.project, profile, entries or tasks or None, _ASIDE)


def _not_run(code: GeneratedCode, run: Iterable[str]) -> str:
    """The blocks and programs of an application of which nothing was run; empty where all was."""
    project, kinds = code.project, (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)
    aside = {name.upper() for name in (*_ASIDE, *run)}
    seen = set().union(*(all_reached(project, name.upper()) for name in run))
    names = [
        pou.name
        for key, pou in project.pous.items()
        if pou.kind in kinds and pou.body and key not in seen | aside
        if not any(base.is_native for base in project.lineage(key))
    ]
    return f"nothing was run of {', '.join(names)}" if names else ""


@dataclass(frozen=True, eq=False)
class _Task:
    """A part of the verification that needs no other one, and what it is called while it goes on."""

    name: str
    results: Callable[[], list[Any]]


def _done(tasks: Sequence[_Task], progress: Progress | None, jobs: int | None) -> dict[_Task, list[Any]]:
    """The results of each task."""

    def begun(number: int, task: _Task) -> None:
        if progress is not None:
            progress(number, len(tasks), task.name)

    made = shared_out(lambda task: task.results(), tasks, is_large=True, at_once=jobs, can_travel=False, begun=begun)
    if progress is not None:
        progress(len(tasks), len(tasks), "")
    return dict(zip(tasks, made, strict=True))


def _cost_task(target: str, code: GeneratedCode, budget: Budget) -> _Task:
    """The costs of a target, but for the profile, which does not travel."""

    def results() -> list[Any]:
        cost = cycle_cost(code, budget.profile, budget.entries)
        return [(target, cost.blocks, cost.entries)]

    return _Task(target, results)


def _block_tasks(bundle: Bundle, targets: dict[str, GeneratedCode], seed: int) -> Iterable[_Task]:
    """What checks the blocks around the models, target by target."""
    if (purpose := bundle.purpose) is not None:
        for name, code in targets.items():
            bound = arithmetic_of(name).bound
            yield _Task(name, partial(_block_reports, partial(purpose.checks, bundle.irs, code, seed, bound), name))
    if windows := bundle.configuration.windows():
        for name, code in targets.items():
            yield _Task(name, partial(_block_reports, partial(window_checks, bundle.irs, windows, code, seed), name))


def _block_reports(checks: Callable[[], Iterable[BlockCheck]], target: str) -> list[ModelReport]:
    return [block_report(check, target) for check in checks()]


def _is_worth_a_proof(model: ModelIR, count: int, rows: int) -> bool:
    """Whether trying all thresholds would take longer than to prove the text: rows times trees, against nodes."""
    ensembles = [op for op in model.ops if isinstance(op, TreeEnsemble)]
    trees = sum(op.n_trees for op in ensembles)
    proving = trees * _SECONDS_A_TREE + sum(op.n_nodes for op in ensembles) * _SECONDS_A_NODE
    return count > rows and count * trees * _SECONDS_A_ROW > proving


def _verify_model(model: LoadedModel, targets: dict[str, GeneratedCode], rows: int, seed: int) -> list[ModelReport]:
    ir = model.ir
    for code in targets.values():
        block_of(code.folder, ir)  # the model's, before anything takes time
    x = probe_rows(ir, rows, seed, again=True)
    proof = _words(ir, targets) if _is_worth_a_proof(ir, len(x), rows) else ""
    if proof:
        # the text is the model's for all inputs: what is left to try is the library, on a sample of the rows
        x = probe_rows(ir, rows, seed, sampled=True)
    return [model_report(model, x, targets, proof=proof)]


def _words(model: ModelIR, targets: Mapping[str, GeneratedCode]) -> str:
    """What `prove` says of a model's text in all targets; nothing where it does not answer for one."""
    found = dict.fromkeys(targets, "")
    for name, code in targets.items():
        result = prove_model(model, code)
        if not result.is_proved:
            return ""
        found[name] = result.words
    return " and ".join(dict.fromkeys(found.values()))
