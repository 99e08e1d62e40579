"""For each model: that the emitted text gives its numbers for every input; or an input for which it does not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from st_codegen.emit.blocks.self_check import INTACT
from st_codegen.emit.output import block_of
from st_codegen.errors import counted
from st_codegen.files.html_text import html_table
from st_codegen.ir import ModelIR, TreeEnsemble
from st_codegen.processes import Progress
from st_codegen.project.bundle import Bundle
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.prove.arithmetic import EXPRESSION, Findings, prove_arithmetic
from st_codegen.proof.prove.blocks import prove_block
from st_codegen.proof.prove.counterexample import Counterexample, counterexample, edge_rows, of_expressions
from st_codegen.proof.prove.disagree import OtherExpressionError
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.texts import check_interface, check_text
from st_codegen.proof.prove.tree_proof import CELLS, SUMS, TAIL, BlockRun, Difference, TreeProof
from st_codegen.proof.runner import GeneratedCode, target_folders

#: Rows that are executed where a text differs behind numbers that are computed of several inputs.
_PROBES = 5000


class Verdict(StrEnum):
    """What was found for a text, as certificates say it; PROVED: there is a proof, of what its words say."""

    PROVED = "proved"
    REFUTED = "refuted"
    NOT_PROVED = "not proved"


#: What a proof is of, in words (docs/architecture.md): of equal bits for all inputs, of the model's operations one by
#: one for all inputs, of a block around models that no call stops.
EQUAL_BITS, SAME_EXPRESSION, NEVER_FAILS = "proved", "same expression", "never fails"
_AROUND = "invariant of a call"
_WORDS = {SUMS: EQUAL_BITS, CELLS: EQUAL_BITS, EXPRESSION: SAME_EXPRESSION, TAIL: SAME_EXPRESSION, _AROUND: NEVER_FAILS}


@dataclass(frozen=True)
class ProofResult(Findings):
    """The verdict for one model in one target, or for a block around models (`model` is its name)."""

    model: str
    target: str
    block: str
    verdict: Verdict
    reason: str = ""
    outputs: tuple[int, ...] = ()
    counterexample: Counterexample | None = None

    @property
    def is_proved(self) -> bool:
        return self.verdict is Verdict.PROVED

    @property
    def words(self) -> str:
        """What a line of a table says: the verdict, and of a proof what it shows."""
        return _WORDS[self.method] if self.is_proved else self.verdict.value


@dataclass(frozen=True, repr=False)
class ProveReport:
    """All verdicts; `proved`: there is a proof for each text."""

    results: tuple[ProofResult, ...] = ()

    def __repr__(self) -> str:
        return f"ProveReport({self.summary})"

    @property
    def summary(self) -> str:
        """How many texts there are, and how many of them have which words."""
        order = (EQUAL_BITS, SAME_EXPRESSION, NEVER_FAILS, *Verdict)
        counts = Counter(sorted((result.words for result in self.results), key=order.index))
        said = ", ".join(f"{words}: {count}" for words, count in counts.items())
        return f"{counted(len(self.results), 'text')} ({said})" if said else "no texts"

    def _repr_html_(self) -> str:
        rows = [(r.model, r.target, r.block, r.words, r.reason or r.method) for r in self.results]
        return html_table(f"Asked of all inputs: {self.summary}", ("model", "target", "block", "verdict", "by"), rows)

    @property
    def proved(self) -> bool:
        return bool(self.results) and all(result.is_proved for result in self.results)


def prove(bundle: Bundle, generated: Path | str, *, progress: Progress | None = None) -> ProveReport:
    """Prove every model of a bundle for every generated target below `generated`; docs/proof.md says what is assumed.

    Raises GeneratedCodeError for text that is not that of these models, or cannot be read.
    """
    folders = target_folders(Path(generated))
    results = []
    total = len(bundle.models) * len(folders)
    for folder in folders:
        if folder.name == "beckhoff-ml":
            results += [_left_out(model.ir, folder) for model in bundle.models]
            continue
        code = GeneratedCode(folder)
        runs: dict[str, BlockRun] = {}
        for loaded in bundle.models:
            if progress is not None:
                progress(len(results), total, loaded.ir.name)
            results.append(prove_model(loaded.ir, code, runs))
        if bundle.purpose is not None:
            here = [result for result in results if result.target == folder.name]
            results += [_prove_around(around.name, code, bundle, here) for around in bundle.purpose.called_blocks()]
    if progress is not None:
        progress(total, total, "")
    return ProveReport(tuple(results))


def _prove_around(block: str, code: GeneratedCode, bundle: Bundle, models: list[ProofResult]) -> ProofResult:
    """The proof for a block around models of which there are proofs."""
    result = ProofResult(block, code.folder.name, block, Verdict.NOT_PROVED)
    missing = [model.model for model in models if not model.is_proved]
    if missing:
        return replace(result, reason=f"it calls models that are not proved: {', '.join(missing)}")
    irs = {loaded.ir.name: loaded.ir for loaded in bundle.models}
    members: dict[str, list[tuple[ModelIR, tuple[int, ...]]]] = {}
    for model in models:
        members.setdefault(model.block, []).append((irs[model.model], model.outputs))
    try:
        check_text(code, block)
        proof = prove_block(code.project, block, members)
    except NotProvedError as error:
        return replace(result, reason=str(error))
    return replace(result, verdict=Verdict.PROVED, method=_AROUND, claims=proof.claims)


def is_followed(model: ModelIR, code: GeneratedCode) -> bool:
    """Whether proofs follow the text of a model: it computes by itself, in LREAL, each call without the ones before."""
    return _computes(model, code.folder) and not _checks_itself(code, block_of(code.folder, model)[0])


def _computes(model: ModelIR, folder: Path) -> bool:
    """Whether the text in a folder computes a model by itself, and in LREAL."""
    return folder.name != "beckhoff-ml" and not model.is_real


def _checks_itself(code: GeneratedCode, block: str) -> bool:
    """Whether a block was generated with `--self-check`."""
    return any(variable.name == INTACT for variable in code.project.pous[block.upper()].variables)


def _left_out(model: ModelIR, folder: Path) -> ProofResult:
    block, _ = block_of(folder, model)
    reason = "the vendor's runtime computes, not the text"
    if model.is_real:
        reason = "it computes in REAL (--real), of which nothing is proved; verify compares it on a sample"
    return ProofResult(model.name, folder.name, block, Verdict.NOT_PROVED, reason)


_SELF_CHECK = (
    "the block checks itself (--self-check) and keeps the state of that from call to call: prove the same models "
    "generated without it; verify compares this text on a sample"
)


def prove_model(model: ModelIR, code: GeneratedCode, runs: dict[str, BlockRun] | None = None) -> ProofResult:
    """Prove a model in one target; `runs` keeps blocks that several models share."""
    folder = code.folder
    block, outputs = block_of(folder, model)
    result = ProofResult(model.name, folder.name, block, Verdict.NOT_PROVED, outputs=outputs)
    if not _computes(model, folder):
        return _left_out(model, folder)
    code.check_block(block, len(model.features), outputs)
    try:
        check_text(code, block)
        check_interface(model, code.project, block, outputs)
        if any(isinstance(op, TreeEnsemble) for op in model.ops):
            found = TreeProof(model, code, block, outputs, {} if runs is None else runs).check()
        else:
            found = prove_arithmetic(model, code.project, block, outputs)
        return replace(result, verdict=Verdict.PROVED, **found.__dict__)
    except Difference as difference:
        points, to_the_bit = difference.points, difference.to_the_bit
        if points.shape[1] > len(model.features):  # which inputs lead to a number in front of trees is not known
            points = probe_rows(model, _PROBES, 0)
        reason, example = str(difference), counterexample(model, code, block, outputs, points, to_the_bit=to_the_bit)
    except OtherExpressionError as expressions:
        reason, example = str(expressions), counterexample(model, code, block, outputs, edge_rows(model))
        example = example or of_expressions(model, code, block, outputs, expressions)
    except NotProvedError as error:
        example = counterexample(model, code, block, outputs, edge_rows(model))
        if example is None:
            return replace(result, reason=_SELF_CHECK if _checks_itself(code, block) else str(error))
        reason = str(error)
    except RecursionError:  # the other models have verdicts of their own
        return replace(result, reason="an expression of the text is nested too deeply to be followed")
    if example is None:
        return replace(result, reason=f"{reason}; no input was found that shows it")
    return replace(result, verdict=Verdict.REFUTED, reason=reason, counterexample=example)
