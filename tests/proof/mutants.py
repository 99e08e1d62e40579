"""Changed texts and changed certificates: `prove` and the checker must reject each, or the text is equal in all cells.

python -m tests.proof.mutants [TEXTS [CERTIFICATES]]        1,000 of each without numbers; exit 1 when one survives
"""

import copy
import json
import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from st_codegen.driver import generate
from st_codegen.errors import StCodegenError
from st_codegen.ir import reference
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.probes import probe_rows
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
LAYOUTS = {
    "table": Options(),
    "ranks": Options(layout=Layout.RANKED),
    "trees": Options(layout=Layout.TREES),
}
#: What a rejected certificate may raise, as in the checker's own main.
REJECTIONS = (check_certificate.Reject, OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError)


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


def _ulp(text, numbers, chance):
    number = chance.choice(numbers)
    moved = float(np.nextafter(float(number[0]), chance.choice([-np.inf, np.inf])))
    return text[: number.start()] + repr(moved).replace("e", "E") + text[number.end() :]


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


_OTHER = {"<=": "<", "<": "<=", ">": ">="}

MUTATIONS = {
    "threshold by one ulp": _table("EDGE|THRESHOLD|VALUE", _ulp),
    "leaf by one ulp": _table("LEAF|CELL", _ulp),
    "< for <=": _one(r"(IF \S+ |\] )(<=|<|>)( [A-Z]\w*\[| nKey)", lambda m, c: m[1] + _OTHER[m[2]] + m[3]),
    "swapped leaves": _table("LEAF_2 |LEAF_1 |CELL", _swapped),
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


def prepared(folder, names=MODELS):
    """Generated texts of all models in all layouts: (model, generated folder, text)."""
    cases = []
    for layout, options in LAYOUTS.items():
        for name in names:
            models = folder / "models" / Path(name).stem
            models.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / "golden" / "lone" / "models" / name, models)
            bundle = load(models)
            out = folder / layout / Path(name).stem
            generate(bundle, "iec", out, options=options)
            cases.append((bundle, models, out, next((out / "iec").glob("*.st"))))
    return cases


def accepted_by_prove(bundle: Bundle, out):
    try:
        return prove(bundle, out).proved
    except StCodegenError:
        return False


def accepted_by_checker(bundle, out):
    (loaded,) = bundle.models
    entry = {"block": prove_block(out), "outputs": [f"fOut{n + 1}" for n in range(len(loaded.ir.outputs))]}
    try:
        model = check_certificate.read_model(ROOT / "golden" / "lone" / "models" / loaded.ir.source.file)
        check_certificate.Check(model, out / "iec", entry)
    except REJECTIONS:
        return False
    return True


def prove_block(out):
    return re.search(r"^FUNCTION_BLOCK (\w+)", next((out / "iec").glob("*.st")).read_text(), re.M)[1]


def equal_when_run(bundle, out):
    """Library and executed text on every threshold, its neighbours and rows between."""
    (loaded,) = bundle.models
    x = probe_rows(loaded.ir, 3000, 1)
    expected = reference.evaluate(loaded.ir, x)
    result = GeneratedCode(out / "iec", "iec").run_model(prove_block(out), x, expected.shape[1])
    return np.array_equal(expected, np.where(result.valid[:, None], result.values, np.nan), equal_nan=True)


def texts(count, seed=0, names=MODELS):
    """Mutate texts; counts of verdicts, and descriptions of mutants that survived wrongly."""
    chance, counts, wrong = random.Random(seed), Counter(), []
    with tempfile.TemporaryDirectory() as folder:
        cases = prepared(Path(folder), names)
        for number in range(count):
            bundle, _, out, path = cases[number % len(cases)]
            original = path.read_text()
            name, changed = mutated(original, chance)
            path.write_text(changed)
            verdicts = accepted_by_prove(bundle, out), accepted_by_checker(bundle, out)
            counts[name, "rejected by both" if not any(verdicts) else "equal" if all(verdicts) else "one accepts"] += 1
            if any(verdicts) and not equal_when_run(bundle, out):
                wrong.append(f"{name} in {path.parent.parent}: prove and checker say {verdicts}")
            path.write_text(original)
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


def certificates(count, seed=0):
    """Mutate certificates; how many were rejected, and those that were accepted."""
    chance, rejected, wrong = random.Random(seed), 0, []
    with tempfile.TemporaryDirectory() as folder:
        bundle, models, out, _ = prepared(Path(folder), MODELS[:1])[1]
        content = certificate(bundle, models, out, prove(bundle, out))
        path = Path(folder) / "certificate.json"
        path.write_text(json.dumps(content))
        check_certificate.main(path, models, out)
        for _ in range(count):
            changed = content
            while changed == content:
                changed = mutated_certificate(content, chance)
            path.write_text(json.dumps(changed))
            try:
                check_certificate.main(path, models, out)
                wrong.append(json.dumps(changed))
            except REJECTIONS:
                rejected += 1
    return rejected, wrong


def main(arguments):
    numbers = [int(argument) for argument in arguments] + [1000, 1000][len(arguments) :]
    counts, wrong = texts(numbers[0])
    for (name, verdict), count in sorted(counts.items()):
        print(f"{name:30} {verdict:20} {count:5}")
    rejected, accepted = certificates(numbers[1])
    print(f"certificates rejected: {rejected} of {numbers[1]}")
    for line in wrong + accepted:
        print(line)
    return 1 if wrong or accepted else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
