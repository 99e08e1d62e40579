"""Every estimator of a peer's own tests is compiled and verified, or refused in one line."""

import importlib
import sys
import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")

from st_codegen.errors import InputError
from tests.classifiers import GAPS, SCORE, THREE, TWO, X, loaded, verified
from tests.peers.m2cgen import entries

ENTRIES = list(entries())
ANSWERS = {
    "numbers": SCORE,
    "counts": np.abs(SCORE) + 0.1,
    "shares": 1.0 / (1.0 + np.exp(-SCORE)),
    "three": THREE,
    "two": TWO.astype(int),
}


def made(name, parameters):
    """An estimator of a class; texts that name classes become estimators."""
    module, kind = name.split(".")
    package = module if module in ("lightgbm", "xgboost") else f"sklearn.{module}"
    given = {key: made(value, {}) if key == "estimator" else value for key, value in parameters.items()}
    quiet = {"verbose": -1} if module == "lightgbm" else {}
    return getattr(importlib.import_module(package), kind)(**given, **quiet)


def outcome(name, parameters, kind, folder):
    """'taken' for an estimator whose text was verified, else why it is refused."""
    data, _, gaps = kind.partition(" with ")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        estimator = made(name, parameters).fit(GAPS if gaps else X, ANSWERS[data])
    try:
        model = loaded(estimator)
    except InputError as error:
        assert "\n" not in str(error)
        return str(error)
    verified(model, folder, rows=100)
    return "taken"


def test_the_list_is_the_peer_s():
    assert len(ENTRIES) == 128
    assert sum(kind.startswith(("three", "two")) for _, _, kind in ENTRIES) == 65


SMALL = [number for number, (_, parameters, _) in enumerate(ENTRIES) if parameters.get("n_estimators", 0) < 100]


@pytest.mark.parametrize("number", SMALL[4::20])
def test_one_in_twenty(number, tmp_path):
    assert outcome(*ENTRIES[number], tmp_path) == "taken"


@pytest.mark.slow
def test_all_of_them(tmp_path, capsys):
    """`make peers`: minutes."""
    found = {}
    for number, entry in enumerate(ENTRIES):
        found[number] = outcome(*entry, tmp_path / str(number))
    refused = {f"{ENTRIES[number][0]} ({ENTRIES[number][2]})": why for number, why in found.items() if why != "taken"}
    lines = [f"m2cgen's estimators: {len(found) - len(refused)} taken, {len(refused)} refused"]
    with capsys.disabled():
        sys.stdout.write("\n".join(["", *lines, *(f"  {name}: {why}" for name, why in refused.items()), ""]))
    assert not refused
