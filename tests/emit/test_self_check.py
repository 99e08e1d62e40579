"""`--self-check` and `--with-age`: blocks that find damage in their constants, and say how old an answer is."""

import re
import struct
import zlib

import numpy as np
import pytest

from st_codegen.driver import differences, generate
from st_codegen.emit.blocks.self_check import SLICE, checksum
from st_codegen.emit.literals import real
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import TargetError
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from tests.emit.test_golden import GOLDEN

MODELS = GOLDEN / "lone" / "models"
NEVER = 2**31 - 1
#: Cells, packed nodes, nodes as trained, support vectors, weights, categories.
KINDS = {
    "decision_tree.skops": Layout.TABLE,
    "extra_trees_ranked.skops": Layout.RANKED,
    "random_forest.skops": Layout.TREES,
    "svr.skops": Layout.AUTO,
    "mlp_tanh.skops": Layout.AUTO,
    "hist_gradient_boosting_category.skops": Layout.AUTO,
}
ROW = {"fF0": 500.0, "fF1": 600.0, "fF2": 1.0}


def made(model, target, folder, **wishes):
    """What is generated, the name of its one block, and the block's text."""
    generated = generate(load(model), target, folder, **wishes)
    (block,) = (facts["block"] for facts in generated.facts["models"].values())
    (path,) = (path for path in generated.folder.rglob(f"{block}.*"))
    return generated, block, path


def answers(generated, block, output, rows):
    """An output in one call after another, with an input for each call."""
    instance = GeneratedCode(generated.folder, TARGETS[generated.target].dialect)._instance(block, 1)
    found = []
    for row in rows:
        for name, value in row.items():
            instance[name] = np.array([value])
        instance()
        found.append(np.asarray(instance[output]).item())
    return found


def flipped(number, bit=0):
    """A number of a text with another bit in it."""
    if "." not in number:
        return str(int(number) ^ 1)
    bits = struct.unpack("<q", struct.pack("<d", float(number)))[0] ^ (1 << bit)
    return f"{struct.unpack('<d', struct.pack('<q', bits))[0]!r}".upper().replace("E+", "E")


def numbers_of(text):
    """Where the numbers of all tables stand."""
    lines = re.finditer(r"^ {8}(?! )[-0-9].*$", text, re.M)
    return [n for line in lines for n in re.compile(r"-?\d+(\.\d+(E-?\d+)?)?").finditer(text, *line.span())]


@pytest.mark.parametrize("name", KINDS)
def test_an_intact_block_stays_valid_and_a_changed_bit_ends_that(name, tmp_path):
    target = "twincat" if name < "m" else "iec"
    generated, block, path = made(MODELS / name, target, tmp_path, self_check=True, options=Options(KINDS[name]))
    text = path.read_text(encoding="utf-8-sig")
    constants, calls = map(int, re.search(r"all (\d+) constants in (\d+) calls", text).groups())
    numbers = numbers_of(text)
    scalars = re.findall(r"^    \w+ : [A-Z]+ := .*;", text[text.index("VAR CONSTANT") :], re.M)
    assert constants == len(numbers) + len(scalars) - 1  # all but what the checksum must be
    assert calls == -(-constants // SLICE)
    assert all(answers(generated, block, "bValid", [ROW] * (2 * calls + 1)))
    number = numbers[len(numbers) // 2]
    path.write_text(text[: number.start()] + flipped(number[0]) + text[number.end() :], encoding="utf-8")
    assert not any(answers(generated, block, "bValid", [ROW] * (calls + 3))[calls - 1 :])


def test_the_row_shows_damage_in_the_first_call(tmp_path):
    """Where an answer is another one, though no constant has been looked at."""
    generated, block, path = made(MODELS / "decision_tree.skops", "iec", tmp_path, self_check=True)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("aStep2[0] := CELL_2[nCell];", "aStep2[0] := CELL_2[nCell] * 2.0;"), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    assert answers(generated, block, "bValid", [ROW] * 2) == [False, False]
    assert answers(generated, block, "fOut1", [ROW] * 2) == [0.0, 0.0]


def test_self_check_changes_no_answer(tmp_path):
    bundle = load(MODELS / "xgboost_two_outputs.json")
    generate(bundle, "iec", tmp_path, self_check=True, with_age=True)
    result = verify(bundle, tmp_path, rows=300)
    assert result.passed
    assert list(differences(bundle, "iec", tmp_path, self_check=True, with_age=True)) == []
    assert list(differences(bundle, "iec", tmp_path))


def test_blocks_of_a_bundle_check_themselves(bundle_folder, tmp_path):
    bundle = load(bundle_folder)
    generate(bundle, "twincat", tmp_path, self_check=True)
    assert verify(bundle, tmp_path, rows=200).passed


@pytest.mark.parametrize("name", ["decision_tree.skops", "lasso.skops"])
def test_prove_takes_blocks_with_an_age_and_says_why_it_takes_none_that_check_themselves(name, tmp_path):
    bundle = load(MODELS / name)
    for folder, wishes in ((tmp_path / "age", {"with_age": True}), (tmp_path / "check", {"self_check": True})):
        generate(bundle, "iec", folder, **wishes)
    (aged,), (checked,) = (prove(bundle, tmp_path / folder).results for folder in ("age", "check"))
    assert aged.verdict is Verdict.PROVED
    assert checked.verdict is Verdict.NOT_PROVED and "the block checks itself (--self-check)" in checked.reason
    texts = ["".join(path.read_text() for path in (tmp_path / kind).rglob("FB_[DL]*.st")) for kind in ("age", "check")]
    assert ["verify and prove check it" in text for text in texts] == [name == "decision_tree.skops", False]
    assert ("verify checks it" in texts[1]) == (name == "decision_tree.skops")


def test_every_single_bit_of_a_number_changes_the_checksum():
    """All bits of numbers of every size; what becomes no number, or infinite, the text notes by itself."""
    values = np.array([1.0, -0.3, 5e-324, -2.2e-308, 1.7e308, 123456.0, 1e-37, 3.0])
    known = checksum([values])
    for place in range(len(values)):
        for bit in range(64):
            bits = values.view(np.uint64).copy()
            bits[place] ^= np.uint64(1) << np.uint64(bit)
            changed = bits.view(np.float64)
            assert not np.isfinite(changed[place]) or checksum([changed]) != known, (values[place], bit)
    assert checksum([values[::-1]]) != known


@pytest.mark.parametrize("kind", [np.int8, np.int32])
def test_every_single_bit_of_an_integer_changes_the_checksum(kind):
    values = np.array([0, 1, -1, 100, -128], kind)
    known = checksum([values])
    for place in range(len(values)):
        for bit in range(8 * values.itemsize):
            changed = values.copy()
            changed.view(f"u{values.itemsize}")[place] ^= 1 << bit
            assert checksum([changed]) != known, (values[place], bit)


def test_the_checksum_is_that_of_zlib():
    numbers = [np.array([1.5, -2.0]), np.array([7, -1], np.int32)]
    words = [
        (value >> shift) & 0xFFFF for value in (*numbers[0].view(np.uint64).tolist(),) for shift in (48, 32, 16, 0)
    ]
    words += [(value >> shift) & 0xFFFF for value in (7, 2**32 - 1) for shift in (16, 0)]
    assert checksum(numbers) == zlib.crc32(b"".join(word.to_bytes(2, "little") for word in words))


def test_the_text_computes_the_checksum_of_numbers_of_every_size(tmp_path):
    trees = pytest.importorskip("sklearn.tree")
    values = np.array([5e-324, -2.2e-308, 1e303, -1e303, 0.0, 1.0, -0.3, 2.0**-63, 2.0**64, 256.0, 1e-300, 3e200])
    rows = np.arange(len(values), dtype=np.float64)[:, None]
    model = trees.DecisionTreeRegressor().fit(rows, rows[:, 0])
    model.tree_.value[model.tree_.children_left < 0, 0, 0] = values
    generated = generate(load(model), "twincat", tmp_path, self_check=True, options=Options(Layout.TREES))
    (path,) = generated.folder.rglob("FB_Model.*")
    text = path.read_text(encoding="utf-8-sig")
    assert all(real(value) in text for value in values)
    assert all(answers(generated, "FB_Model", "bValid", [{"fF0": 3.0}] * 40))


def test_age_counts_the_calls_since_the_outputs_were_valid(tmp_path):
    generated, block, _ = made(MODELS / "lasso.skops", "twincat", tmp_path, with_age=True)
    rows = [{**ROW, "fF0": value} for value in (np.nan, 1.0, 1.0, np.nan, np.nan, 2.0)]
    ages = answers(generated, block, "nAge", rows)
    assert ages == [NEVER, 0, 0, 1, 2, 0]


def test_a_target_whose_blocks_hold_no_numbers_refuses_both(tmp_path):
    for wish, option in (("self_check", "--self-check"), ("with_age", "--with-age")):
        with pytest.raises(TargetError, match=f"{option} goes with"):
            generate(load(MODELS / "svr.skops"), "beckhoff-ml", tmp_path, **{wish: True})
    assert not list(tmp_path.iterdir())


def test_a_target_that_has_all_models_in_each_call_refuses_to_spread_them(bundle_folder, tmp_path):
    with pytest.raises(TargetError, match="--outputs-per-cycle goes with iec"):
        generate(load(bundle_folder), "beckhoff-ml", tmp_path / "out", options=Options(outputs_per_cycle=1))
    assert not (tmp_path / "out").exists()


def test_the_header_names_version_layout_and_options(tmp_path):
    _, _, path = made(MODELS / "decision_tree.skops", "iec", tmp_path, max_array=40, with_age=True)
    assert re.search(
        r"Generated by: st-codegen [\d.]+, layout table, options --max-array 40 --with-age", path.read_text()
    )
