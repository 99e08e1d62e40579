"""What a reviewer wants to know before reading a diff of generated code: what changed, in the engineer's words.

Sizes and ranges come from the manifests that `generate` writes; the changes of the outputs are found by running both
emitted texts, run on the same operating points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.cost.profile import Profile
from st_codegen.cost.report import project_cost
from st_codegen.emit.output import Manifest, content_of, read_manifest
from st_codegen.errors import GeneratedCodeError, counted
from st_codegen.ir import FloatArray
from st_codegen.processes import Progress
from st_codegen.project.purpose import ANSWERS
from st_codegen.proof.probes import RangeSource
from st_codegen.proof.runner import BlockResult, GeneratedCode, target_folders
from st_codegen.st.check.flow import all_reached
from st_codegen.st.syntax.source import SUFFIXES
from st_codegen.st.tree import Section

#: Points of a curve
_CURVE = 120

#: Facts of a model that are compared one by one, with their labels.
_FACTS = {
    "library": "library",
    "class": "model class",
    "features": "features",
    "outputs": "outputs",
    "inputs": "inputs of the block",
    "variables": "outputs of the block, with what is plausible",
    "labels": "labels",
    "accepts_nan": "takes missing values",
    "exact": "equals the library",
    "layout": "layout",
    "block": "block",
    "trees": "trees",
    "nodes": "nodes",
    "support_vectors": "support vectors",
    "table_bytes": "bytes of tables",
    "worst_us": "worst case with cold caches, us",
}


@dataclass(frozen=True)
class Change:
    """One fact before and after."""

    what: str
    before: Any
    after: Any


@dataclass(frozen=True)
class Sweep:
    """An output before and after along one feature, the others as at the point of the largest change."""

    feature: str
    x: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]


@dataclass(frozen=True)
class OutputChange:
    """How one output moved over the operating range; `where` is the operating point of the largest change.

    `moved` is the share of the points that both texts answer at which the output is another number; of the number of a
    class (`is_label`), which has no size, at which it stands for another label: `largest` is then 1.
    """

    output: str
    largest: float
    mean: float
    where: dict[str, float]
    moved: float = 0.0
    curves: tuple[Sweep, ...] = ()
    is_label: bool = False

    @property
    def sizes(self) -> tuple[float | str, float | str]:
        """The largest change and the mean; nothing of what has no size."""
        return ("", "") if self.is_label else (self.largest, self.mean)


@dataclass(frozen=True)
class LabelChange:
    """A label, the one that came in its place, and the share of the points that both texts answer at which it did."""

    before: str
    after: str
    share: float


@dataclass(frozen=True)
class ModelChange:
    """What changed in one model that both folders have.

    `labels`: of a classifier, which labels came in place of which, the most frequent change first.
    `rows_lost`: points that only the old text answered; `answered`: those that both did; `guessed`: features whose
    operating range is not known, so that the points lie where the model's own numbers are.
    """

    name: str
    facts: tuple[Change, ...]
    outputs: tuple[OutputChange, ...]
    rows: int
    rows_lost: int
    rows_gained: int
    text_changed: bool
    guessed: tuple[str, ...] = ()
    labels: tuple[LabelChange, ...] = ()
    answered: int = 0

    def label(self, output: OutputChange) -> str:
        """The name of an output, for a table."""
        return self.name if len(self.outputs) == 1 and self.name not in ANSWERS else f"{self.name}[{output.output}]"

    @property
    def points(self) -> str:
        """The points at which outputs were compared, in words."""
        if self.answered == self.rows:
            return counted(self.rows, "point")
        return f"the {self.answered:,} of {self.rows:,} points that both texts answer"

    @property
    def renumbered(self) -> dict[Any, tuple[int, int]]:
        """The labels of both that have another number than before, with it and the new one."""
        for change in self.facts:
            if change.what == _FACTS["labels"] and change.before and change.after:
                old, new = ({label: n for n, label in enumerate(labels)} for labels in (change.before, change.after))
                return {label: (old[label], new[label]) for label in old if new.get(label, old[label]) != old[label]}
        return {}

    @property
    def changed(self) -> bool:
        return bool(
            self.facts
            or self.labels
            or self.text_changed
            or self.rows_lost
            or self.rows_gained
            or any(o.largest for o in self.outputs)
        )


def tried_text(changed: Sequence[ModelChange], target: str, around: Sequence[ModelChange] = ()) -> str:
    """At which points the outputs of changed models, and of blocks around them, were compared, in whole sentences."""
    text = (
        f"Both texts of the target {target} were run at random points of the operating range, at which no input is "
        "missing; a larger change may lie elsewhere. Every third point has whole numbers where a range holds two, so "
        "that means and shares are not those of evenly spread points."
    )
    if partly := [model.name for model in (*changed, *around) if model.answered < model.rows]:
        text += f" Of these the points are those that both texts answer: {', '.join(partly)}."
    guessed = sorted({f"{model.name}: {', '.join(model.guessed)}" for model in changed if model.guessed})
    if guessed:
        text += (
            " No operating range is known for these features, and the points lie where the model's own numbers are: "
            f"{'; '.join(guessed)}. st-codegen.toml can give it."
        )
    if blocks := [block.name for block in around if block.outputs]:
        text += (
            f" Changes of {', '.join(blocks)} are in deg, of the complex number A * exp(i * phi) of an order, in the "
            "ranges that both have; what one of them does not have counts as 0."
        )
    return text


@dataclass(frozen=True)
class Review:
    """The difference of two generated folders of one target.

    `around`: blocks around the models that changed, with those of their answers that moved.
    """

    target: str
    added: tuple[str, ...]
    removed: tuple[str, ...]
    models: tuple[ModelChange, ...]
    project: tuple[Change, ...]
    files: dict[str, str] = field(default_factory=dict)
    around: tuple[ModelChange, ...] = ()

    @property
    def changed(self) -> bool:
        return bool(self.added or self.removed or self.project or self.files or any(m.changed for m in self.models))

    def as_json(self) -> dict[str, Any]:
        """Everything but the curves, with `changed` on top."""
        content = {"changed": self.changed, **asdict(self)}
        for output in (one for model in (*content["models"], *content["around"]) for one in model["outputs"]):
            del output["curves"]
        return content


def diff(
    old: Path | str,
    new: Path | str,
    *,
    rows: int = 10_000,
    seed: int = 0,
    profile: Profile | None = None,
    progress: Progress | None = None,
) -> Review:
    """Compare two folders that `generate` wrote: the models in the first target that both have, the files in all.

    With a `profile` the worst case of each model's block is compared too. Raises GeneratedCodeError where a folder
    holds no generated files, or they have no target in common.
    """
    before, after, others = _common_target(Path(old), Path(new))
    manifests = [read_manifest(folder) for folder in (before, after)]
    codes = [GeneratedCode(folder) for folder in (before, after)]
    files = _changed_files(before, after)
    models = [_with_sizes(manifest, code, profile) for manifest, code in zip(manifests, codes, strict=True)]
    common = sorted(set(models[0]) & set(models[1]))
    changes = []
    for number, name in enumerate(common):
        if progress is not None:
            progress(number, len(common), name)
        changes.append(_compare_model(name, (models[0][name], models[1][name]), codes, files, rows, seed))
    if progress is not None:
        progress(len(common), len(common), "")
    project = [manifest.purpose for manifest in manifests]
    return Review(
        target=before.name,
        added=tuple(sorted(set(models[1]) - set(models[0]))),
        removed=tuple(sorted(set(models[0]) - set(models[1]))),
        models=tuple(changes),
        project=tuple(
            Change(key.replace("_", " "), project[0].get(key), project[1].get(key))
            for key in sorted({*project[0], *project[1]})
            if project[0].get(key) != project[1].get(key)
        ),
        files=files
        | {f"{one.name}/{name}": kind for one, other in others for name, kind in _changed_files(one, other).items()},
        around=tuple(_compare_around(models, codes, files, rows, seed)),
    )


def _common_target(old: Path, new: Path) -> tuple[Path, Path, list[tuple[Path, Path]]]:
    """The folders of the first target that both have, and of all others, which one may lack; none with one given."""
    before = {folder.name: folder for folder in target_folders(old)}
    after = {folder.name: folder for folder in target_folders(new)}
    for name, folder in before.items():
        if name in after:
            single = folder == old or after[name] == new
            others = [] if single else sorted({*before, *after} - {name})
            return folder, after[name], [(old / other, new / other) for other in others]
    raise GeneratedCodeError(f"{old} has the targets {', '.join(before)}, {new} has {', '.join(after)}: none in common")


def _with_sizes(manifest: Manifest, code: GeneratedCode, profile: Profile | None) -> dict[str, dict[str, Any]]:
    """The facts of the models, with what their blocks take in memory and time by the text (not of a shared block's).

    With them go the names by which a program calls a block, as the text declares them.
    """
    models: dict[str, dict[str, Any]] = manifest.facts["models"]
    models = {name: {**facts, **_interface(facts, code)} for name, facts in models.items()}
    own = {name: facts["block"] for name, facts in models.items() if not facts.get("shared")}
    more: dict[str, dict[str, Any]] = {name: {"table_bytes": code.table_bytes(block)} for name, block in own.items()}
    if profile is not None and own:
        costs = project_cost(code.project, profile, sorted(set(own.values()))).blocks
        for name, block in own.items():
            if costs[block].is_bounded:
                more[name]["worst_us"] = round(costs[block].cold_us, 2)
    return {name: {**facts, **more.get(name, {})} for name, facts in models.items()}


def _interface(facts: dict[str, Any], code: GeneratedCode) -> dict[str, Any]:
    """The inputs of a model's block, and those of its outputs that are the model's, with unit and plausible range."""
    block, wanted = facts["block"], facts.get("block_outputs", range(len(facts["outputs"])))
    code.check_block(block, len(facts["features"]), wanted)
    names = code.variables(block, Section.OUTPUT)
    described = [*facts.get("ports", ()), *({"unit": ""} for _ in wanted)][: len(wanted)]
    return {
        "inputs": [{"name": name, "unit": ""} for name in code.variables(block, Section.INPUT)],
        "variables": [{"name": names[number], **port} for number, port in zip(wanted, described, strict=True)],
    }


def _changed_files(before: Path, after: Path) -> dict[str, str]:
    """Generated files that differ as they are on disk (but for editors' traces): added, removed or changed."""
    texts = [
        {name: content_of(folder / name) for name in read_manifest(folder).files if (folder / name).is_file()}
        for folder in (before, after)
    ]
    kinds = {}
    for name in sorted({*texts[0], *texts[1]}):
        if texts[0].get(name) != texts[1].get(name):
            kinds[name] = "added" if name not in texts[0] else "removed" if name not in texts[1] else "changed"
    return kinds


def _compare_model(
    name: str,
    facts: tuple[dict[str, Any], dict[str, Any]],
    codes: list[GeneratedCode],
    files: Mapping[str, str],
    rows: int,
    seed: int,
) -> ModelChange:
    old, new = facts
    if ("ports" in old) != ("ports" in new):
        # an older manifest does not tell what is plausible; what one describes anew stands in the text, too
        old, new = ({**one, "variables": [{"name": v["name"], "unit": ""} for v in one["variables"]]} for one in facts)
    changes = tuple(
        Change(label, _known(old.get(key)), _known(new.get(key)))
        for key, label in _FACTS.items()
        if _known(old.get(key)) != _known(new.get(key))
    )
    text_changed = codes[0].text(old["block"]) != codes[1].text(new["block"])
    same_shape = len(old["outputs"]) == len(new["outputs"])
    classifies = "labels" in old and "labels" in new
    may_differ = text_changed or _reaches(codes[1], new["block"], files)
    if len(old["features"]) != len(new["features"]) or not (same_shape or classifies) or not may_differ:
        return ModelChange(name, changes, (), 0, 0, 0, text_changed)
    x = _operating_points(old, new, rows, seed)
    results = _answers(facts, codes, x)
    both = results[0].valid & results[1].valid
    difference = np.zeros((int(both.sum()), 0))
    if same_shape:
        difference = np.abs(results[1].values[both] - results[0].values[both])
    labels: tuple[LabelChange, ...] = ()
    if classifies:
        chosen = [
            [f["labels"][int(number)] for number in result.values[both, 0]]
            for f, result in zip(facts, results, strict=True)
        ]
        labels = _label_changes(*chosen)
        if same_shape:  # numbers of classes have no distance
            difference[:, 0] = [one != other for one, other in zip(*chosen, strict=True)]
    if new.get("shared"):  # the text is that of other models too
        text_changed = bool(changes or np.any(difference) or np.any(results[0].valid != results[1].valid))
    names = [feature["name"] for feature in new["features"]]
    sweep = _sweeps(facts, codes, x)
    return ModelChange(
        name,
        changes,
        tuple(
            replace(
                _output_change(output, number, difference[:, number], x[both], names, sweep),
                is_label=classifies and number == 0,
            )
            for number, output in enumerate(new["outputs"][: difference.shape[1]])
            if both.any()
        ),
        len(x),
        int(np.sum(results[0].valid & ~results[1].valid)),
        int(np.sum(results[1].valid & ~results[0].valid)),
        text_changed,
        tuple(f["name"] for f in new["features"] if f.get("range_from") == RangeSource.GUESS),
        labels,
        int(both.sum()),
    )


def _compare_around(
    models: Sequence[Mapping[str, dict[str, Any]]],
    codes: list[GeneratedCode],
    files: Mapping[str, str],
    rows: int,
    seed: int,
) -> Iterator[ModelChange]:
    """The blocks around the models that both have and that changed, or call what changed; all read the same inputs."""
    for block, answer in ANSWERS.items():
        if any(block.upper() not in code.project.pous for code in codes):
            continue
        text_changed = codes[0].text(block) != codes[1].text(block)
        if not text_changed and not _reaches(codes[1], block, files):
            continue
        old, new = (next(iter(facts.values())) for facts in models)
        names = [feature["name"] for feature in new["features"]]
        x = np.zeros((0, 0))
        if len(old["features"]) == len(names):
            x = _operating_points(old, new, rows, seed, common=True)
        if not len(x):
            yield ModelChange(block, (), (), 0, 0, 0, text_changed=True)
            continue
        (before, valid), (after, still) = (
            answer(code, dict(zip(code.variables(block, Section.INPUT), x[:, _columns(f, new)].T, strict=True)))
            for code, f in zip(codes, (old, new), strict=True)
        )
        both, zero = valid & still, np.zeros(len(x))
        changes = {part: np.abs(after.get(part, zero) - before.get(part, zero))[both] for part in before | after}
        outputs = tuple(
            _output_change(part, 0, change, x[both], names, lambda _point, _number: ())
            for part, change in changes.items()
            if np.any(change)
        )
        lost, gained = int(np.sum(valid & ~still)), int(np.sum(still & ~valid))
        yield ModelChange(block, (), outputs, len(x), lost, gained, text_changed, answered=int(both.sum()))


def _reaches(code: GeneratedCode, block: str, files: Mapping[str, str]) -> bool:
    """Whether a block calls what stands in one of some files: those of units are called after them.

    A file that is called after none of the project's units may hold any of them.
    """
    reached, known = all_reached(code.project, block.upper()), code.project.pous
    kept = (name for name, kind in files.items() if kind != "removed" and name.lower().endswith(SUFFIXES))
    stems = (Path(name).stem.upper() for name in kept)
    return any(stem in reached or stem not in known for stem in stems)


def _answers(facts: tuple[dict[str, Any], ...], codes: list[GeneratedCode], x: FloatArray) -> list[BlockResult]:
    """What the blocks before and after answer to points in the order of the new features."""
    return [
        code.run_model(f["block"], x[:, _columns(f, facts[-1])], f.get("block_outputs", len(f["outputs"])))
        for code, f in zip(codes, facts, strict=True)
    ]


def _columns(own: dict[str, Any], new: dict[str, Any]) -> list[int]:
    """Where each feature of a model stands among the new ones: by name where all names are the same, else in order."""
    names, given = ([feature["name"] for feature in facts["features"]] for facts in (new, own))
    return [names.index(name) for name in given] if sorted(names) == sorted(given) else list(range(len(given)))


def _sweeps(
    facts: tuple[dict[str, Any], ...], codes: list[GeneratedCode], x: FloatArray
) -> Callable[[FloatArray, int], tuple[Sweep, ...]]:
    """A function that gives an output before and after along each feature through a point, as far as `x` reaches."""
    names = [feature["name"] for feature in facts[-1]["features"]]
    ends = x.min(axis=0), x.max(axis=0)

    def sweep(point: FloatArray, number: int) -> tuple[Sweep, ...]:
        lines = np.repeat(point[None], len(names) * _CURVE, axis=0).reshape(len(names), _CURVE, -1)
        for feature, (low, high) in enumerate(zip(*ends, strict=True)):
            lines[feature, :, feature] = np.linspace(low, high, _CURVE)
        runs = _answers(facts, codes, lines.reshape(-1, len(names)))
        values = [np.where(r.valid, r.values[:, number], np.nan).reshape(len(names), _CURVE) for r in runs]
        return tuple(
            Sweep(name, *(tuple(map(float, v)) for v in (lines[n, :, n], values[0][n], values[1][n])))
            for n, name in enumerate(names)
        )

    return sweep


def _label_changes(before: list[Any], after: list[Any]) -> tuple[LabelChange, ...]:
    """Which labels came in place of which others, the most frequent change first."""
    counts = Counter((str(one), str(other)) for one, other in zip(before, after, strict=True) if one != other)
    return tuple(LabelChange(*pair, share=count / len(before)) for pair, count in counts.most_common())


def _known(value: Any) -> Any:
    """A fact of a model; of features without ranges that are guesses, which move with every training."""
    if not isinstance(value, list):
        return value
    return [
        {key: v for key, v in entry.items() if key != "range" or entry.get("range_from") != RangeSource.GUESS}
        if isinstance(entry, dict)
        else entry
        for entry in value
    ]


def _operating_points(
    old: dict[str, Any], new: dict[str, Any], rows: int, seed: int, *, common: bool = False
) -> FloatArray:
    """Points at random in the operating range; what only one of two differing ranges covers belongs to it.

    With `common` it does not; without a common range there are no points.

    In every third point the numbers are whole where the range holds two whole numbers, as those of categories are.
    """
    ends = np.array([[feature["range"] for feature in facts["features"]] for facts in (old, new)])
    ends[0, _columns(old, new)] = ends[0].copy()
    lower, upper = ends[:, :, 0].min(axis=0), ends[:, :, 1].max(axis=0)
    if common:
        lower, upper = ends[:, :, 0].max(axis=0), ends[:, :, 1].min(axis=0)
        rows = rows if np.all(lower <= upper) else 0
    random = np.random.default_rng(seed)
    points: FloatArray = lower + (upper - lower) * random.random((rows, len(lower)))
    first, last = np.ceil(lower), np.floor(upper)
    whole = np.minimum(first + np.floor((last - first + 1.0) * random.random(points[::3].shape)), last)
    points[::3] = np.where(last > first, whole, points[::3])
    return points


def _output_change(
    output: str,
    number: int,
    difference: FloatArray,
    x: FloatArray,
    names: list[str],
    sweep: Callable[[FloatArray, int], tuple[Sweep, ...]],
) -> OutputChange:
    worst = int(np.argmax(difference))
    return OutputChange(
        output,
        float(difference[worst]),
        float(np.mean(difference)),
        {name: float(value) for name, value in zip(names, x[worst], strict=True)},
        float(np.mean(difference > 0)),
        sweep(x[worst], number) if difference[worst] else (),
    )
