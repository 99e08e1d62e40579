"""Changed texts and changed certificates: `prove` and the checker must reject each, or the text is equal in all cells.

python -m tests.proof.mutants [TEXTS [CERTIFICATES]]        1,000 of each without numbers; exit 1 when one survives

Progress goes to the standard error, a table of the kinds of changes to the standard output.
"""

import contextlib
import copy
import io
import json
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np

from st_codegen.driver import generate
from st_codegen.emit.output import block_of
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import StCodegenError
from st_codegen.ir import TreeEnsemble, reference
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.prove.certificate import certificate
from st_codegen.proof.prove.prove import prove
from st_codegen.proof.runner import GeneratedCode

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "checker"))
import check_certificate

MODELS = ("decision_tree.skops", "extra_trees.skops", "gradient_boosting.skops", "hist_gradient_boosting.skops")
MODELS += (
    "lightgbm_gbdt.txt",
    "lightgbm_missing.txt",
    "random_forest.skops",
    "xgboost_gbtree.json",
    "xgboost_missing.ubj",
)
#: Models of one small tree, which may be nested IFs.
SMALL = ("decision_tree.skops", "extra_tree.skops")
#: The ways in which the texts are laid out, the target of each, and the models that have no other way there.
LAYOUTS = {
    "table": ("iec", Options(), MODELS),
    "ranks": ("iec", Options(layout=Layout.RANKED), MODELS),
    "trees": ("iec", Options(layout=Layout.TREES), MODELS),
    "nested IFs": ("iec", Options(layout=Layout.IFS), SMALL),
    "table in a project": ("twincat", Options(), MODELS),
    "trees in a project": ("twincat", Options(layout=Layout.TREES), MODELS),
    "nested IFs in a project": ("twincat", Options(layout=Layout.IFS), SMALL),
}


def _one(pattern, change):
    """A mutation that changes one match of a pattern."""

    def mutate(text, chance):
        found = list(re.finditer(pattern, text))
        if not found:
            return None
        match = chance.choice(found)
        new = change(match, chance)
        return None if new is None else text[: match.start()] + new + text[match.end() :]

    return mutate


def _table(names, change):
    """A mutation of one list of numbers."""

    def mutate(match, chance):
        numbers = list(
            re.finditer(r"-?\d[\d.E+-]*", re.sub(r"\(\*.*?\*\)", lambda m: " " * len(m[0]), match[2], flags=re.S))
        )
        return match[1] + change(match[2], numbers, chance) if len(numbers) > 1 else None

    return _one(rf"((?:{names})\w* : ARRAY[^=]*:= \[)([^\]]*)", mutate)


def _moved(number, chance):
    """The text of a number beside another."""
    return repr(float(np.nextafter(float(number), chance.choice([-np.inf, np.inf])))).replace("e", "E")


def _ulp(text, numbers, chance):
    number = chance.choice(numbers)
    return text[: number.start()] + _moved(number[0], chance) + text[number.end() :]


def _swapped(text, numbers, chance):
    one, other = sorted(chance.sample(numbers, 2), key=lambda m: m.start())
    between = text[one.end() : other.start()]
    return text[: one.start()] + other[0] + between + one[0] + text[other.end() :]


def _lines(first, second):
    """A mutation that exchanges two neighbouring statements."""

    def mutate(text, chance):
        lines = text.split("\n")
        at = [n for n in range(len(lines) - 2) if re.search(first, lines[n]) and re.search(second, lines[n + 2])]
        if not at:
            return None
        number = chance.choice(at)
        lines[number], lines[number + 2] = lines[number + 2], lines[number]
        return "\n".join(lines)

    return mutate


def _by_one(match, chance):
    return f"{match[1]}{int(match[2]) + chance.choice([-1, 1])}{match[3]}"


_OTHER = {"<=": "<", "<": "<=", ">": ">=", "AND NOT": "OR", "OR": "AND NOT"}
#: The comparison of an input with a number at the head of an IF.
_TEST = r"(IF aInput\[\d+\] )([<>]=? )"

MUTATIONS = {
    "threshold by one ulp": _table("EDGE|THRESHOLD|VALUE", _ulp),
    "number in an IF by one ulp": _one(_TEST + r"(-?\d[\d.E+-]*)", lambda m, c: m[1] + m[2] + _moved(m[3], c)),
    "< for <= in an IF": _one(_TEST + r"(-?\d)", lambda m, c: m[1] + _OTHER[m[2].strip()] + " " + m[3]),
    "another input in an IF": _one(r"(IF aInput\[)(\d+)(\] [<>])", _by_one),
    "another leaf of an IF": _one(r"(nLeaf := )(\d+)(;)", _by_one),
    "exchanged branches": _one(r"(nLeaf := )(\d+)(;\s*ELSE\s*nLeaf := )(\d+)", lambda m, c: m[1] + m[4] + m[3] + m[2]),
    "other flag of NaN in an IF": _one(r"(AND NOT|OR)( abMissing)", lambda m, c: _OTHER[m[1]] + m[2]),
    "no flag of NaN in an IF": _one(r" (?:AND NOT|OR) abMissing\[\d+\]", lambda m, c: ""),
    "missing branch": _one(r"\n *nLeaf := \d+;", lambda m, c: ""),
    "leaf by one ulp": _table("LEAF|CELL", _ulp),
    "< for <=": _one(r"(IF \S+ |\] )(<=|<|>)( [A-Z]\w*\[| nKey)", lambda m, c: m[1] + _OTHER[m[2]] + m[3]),
    "swapped leaves": _table("LEAF|CELL", _swapped),
    "exchanged children": _table("NODE|RIGHT|JUMP|SPLIT", _swapped),
    "missing tree": _one(r"\n[^\n]*:= [^\n]*aStep\d\[0\] \+ fX[^\n]*;", lambda m, c: ""),
    "missing last tree": _one(r"(FOR nTree := \d+ TO )(\d+)( )", lambda m, c: f"{m[1]}{int(m[2]) - 1}{m[3]}"),
    "other order of additions": _lines(r"fX := LEAF", r"fX := LEAF"),
    "wrong NaN path": _one(r"(IF abMissing[^\n]*\n[^\n]*:= )(-?\d+)(;)", _by_one),
    "wrong NaN value": _table("SLOT_MISSING", _swapped),
    "wrong search bound": _one(r"(EDGE_\w+\[nRank \+ |EDGE_\w+\[|nRank := nRank \+ |nRank := )(\d+)(\]|;)", _by_one),
    "wrong base": _table("START|SKIP", _swapped),
    "missing division": _one(r"\n[^\n]*/ DIVISOR[^\n]*;", lambda m, c: ""),
    "other division": _one(r"(DIVISOR_\w+ : LREAL := )(\d+)(\.0)", _by_one),
    "no check of the input": _one(r"\n *bUsable := FALSE;", lambda m, c: "\n        bUsable := TRUE;"),
}


def mutated(text, chance):
    """A mutation's name and the changed text."""
    while True:
        name = chance.choice(list(MUTATIONS))
        changed = MUTATIONS[name](text, chance)
        if changed is not None and changed != text:
            return name, changed


def prepared(folder, names, layouts=tuple(LAYOUTS)):
    """Generated texts of all models in all layouts: (model, folder of the model, folder of the target, text)."""
    cases = []
    for layout, name in product(layouts, names):
        target, options, taken = LAYOUTS[layout]
        if name not in taken:
            continue
        models = folder / "models" / Path(name).stem
        models.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "golden" / "lone" / "models" / name, models)
        bundle = load(models)
        out = folder / layout / Path(name).stem / target
        generate(bundle, target, out.parent, options=options)
        block, _ = block_of(out, bundle.models[0].ir)
        (path,) = out.rglob(f"{block}.*")
        cases.append((bundle, models, out, path))
    return cases


def accepted_by_prove(bundle: Bundle, out):
    try:
        return prove(bundle, out).proved
    except StCodegenError:
        return False


def accepted_by_checker(bundle, models, out, path):
    (loaded,) = bundle.models
    entry = {"block": path.stem, "outputs": [f"fOut{n + 1}" for n in range(len(loaded.ir.outputs))]}
    entry["inputs"] = [feature.name for feature in loaded.ir.features]
    try:
        check_certificate.Check(check_certificate.read_model(models / loaded.ir.source.file), out, entry)
    except check_certificate.REJECTIONS:
        return False
    return True


def all_cells(model):
    """A row in every cell of a model with few thresholds: on each changeover of a comparison and right beside it.

    The changed texts compare inputs with numbers of the model, or with those one ulp away, and each input with
    those of the others after some changes. An input that no tree reads takes a few numbers only.
    """
    (trees,) = (op for op in model.ops if isinstance(op, TreeEnsemble))
    limits = [np.inf, *(limit for limit in model.magnitude_limits if limit)]
    edges = {float(number) for number in trees.threshold[trees.split >= 0]}
    for number in tuple(edges):
        near = np.float32(number)
        sides = [np.nextafter(near, np.float32(side)) for side in (-np.inf, np.inf)]
        edges |= {(float(near) + float(side)) / 2 for side in sides}
    few = [np.nan, 0.0, *limits, *(np.nextafter(number, 0) for number in limits)]
    ends = [-0.0, *(-number for number in few[2:])]
    many = [number for edge in edges for number in (np.nextafter(edge, -np.inf), edge, np.nextafter(edge, np.inf))]
    read = {trees.columns[number].column for number in set(trees.split.tolist()) - {-1}}
    return np.array(list(product(*(few + ends + many if f in read else few for f in range(len(model.features))))))


def equal_when_run(bundle, out, path):
    """Whether library and executed text have the same bits, and say the same of their validity, in all cells."""
    (loaded,) = bundle.models
    x = all_cells(loaded.ir)
    expected = reference.evaluate(loaded.ir, x)
    code = GeneratedCode(out, TARGETS[out.name].dialect)
    result = code.run_model(path.stem, x, expected.shape[1])
    same = expected.view(np.int64) == result.values.view(np.int64)
    return bool(np.all(np.where(result.valid[:, None], same, np.isnan(expected))))


def shown(done, total, what, start):
    """Print progress every fifty changes."""
    if done % 50 == 0 or done == total:
        print(f"{what}: {done:,} of {total:,}, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)


def texts(count, seed=0, names=(*MODELS, SMALL[1]), layouts=tuple(LAYOUTS)):
    """Change texts; the number of each kind and verdict, and what was accepted wrongly."""
    chance, counts, wrong, start = random.Random(seed), Counter(), [], time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        cases = prepared(Path(folder), names, layouts)
        for number in range(count):
            bundle, models, out, path = cases[number % len(cases)]
            original = path.read_text("utf-8")
            name, changed = mutated(original, chance)
            path.write_text(changed, "utf-8")
            verdicts = accepted_by_prove(bundle, out), accepted_by_checker(bundle, models, out, path)
            verdict = "rejected"
            if any(verdicts):
                verdict = "shown equal" if equal_when_run(bundle, out, path) else "wrongly accepted"
            counts[name, verdict] += 1
            counts[name, "one of the two rejects"] += any(verdicts) and not all(verdicts)
            if verdict == "wrongly accepted":
                wrong.append(f"{name} in {path}: prove and checker say {verdicts}:\n{changed}")
            path.write_text(original, "utf-8")
            shown(number + 1, count, "texts", start)
    return counts, wrong


def _places(value, path=()):
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from _places(value[key], (*path, key))


def mutated_certificate(content, chance):
    """A certificate with one change."""
    content = copy.deepcopy(content)
    path = chance.choice([path for path in _places(content) if path])
    owner = content
    for key in path[:-1]:
        owner = owner[key]
    key, value = path[-1], owner[path[-1]]
    action = chance.choice(["delete", "change", "change", "change", "twice"])
    if action == "delete" or (action == "twice" and not isinstance(owner, list)):
        del owner[key]
    elif action == "twice":
        owner.append(copy.deepcopy(value))
    elif isinstance(value, str):
        at = chance.randrange(len(value))
        owner[key] = value[:at] + chance.choice([c for c in "0123456789abcdefXY_" if c != value[at]]) + value[at + 1 :]
    elif isinstance(value, int):
        owner[key] = value + chance.choice([-1, 1])
    else:
        owner[key] = []
    return content


def certificates(count, seed=0, names=MODELS):
    """Change certificates; how many were rejected, and those that were not."""
    chance, rejected, wrong, start = random.Random(seed), 0, [], time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for bundle, models, out, _ in prepared(Path(folder), names, ("ranks",)):
            content = certificate(bundle, models, out, prove(bundle, out))
            path = Path(folder) / "certificate.json"
            path.write_text(json.dumps(content))
            assert quietly(path, models, out) == (1, 1)
            for _ in range(
                count // len(names) + (bundle.models[0].ir.name == Path(names[0]).stem) * (count % len(names))
            ):
                changed = content
                while changed == content:
                    changed = mutated_certificate(content, chance)
                path.write_text(json.dumps(changed))
                try:
                    wrong.append(f"{quietly(path, models, out)} confirmed of {json.dumps(changed)}")
                except check_certificate.REJECTIONS:
                    rejected += 1
                shown(rejected + len(wrong), count, "certificates", start)
    return rejected, wrong


def quietly(*arguments):
    """What the checker confirms, without what it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        return check_certificate.main(*arguments)


def main(arguments):
    numbers = [int(argument) for argument in arguments] + [1000, 1000][len(arguments) :]
    verdicts = ("rejected", "shown equal", "wrongly accepted", "one of the two rejects")
    counts, wrong = texts(numbers[0])
    kinds = sorted({name for name, _ in counts})
    print("| change of a text | " + " | ".join(verdicts) + " |\n|---|" + "---|" * len(verdicts))
    for name in kinds:
        print(f"| {name} | " + " | ".join(f"{counts[name, verdict]:,}" for verdict in verdicts) + " |")
    totals = (sum(counts[name, verdict] for name in kinds) for verdict in verdicts)
    print("| all | " + " | ".join(f"{total:,}" for total in totals) + " |\n")
    rejected, accepted = certificates(numbers[1])
    print(f"certificates: {rejected:,} of {numbers[1]:,} rejected")
    for line in wrong + accepted:
        print(line)
    return 1 if wrong or accepted else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
