"""What the tests of all walkers share: inputs that reach every corner of a model, and comparison by bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from st_codegen import processes
from st_codegen.ir import ModelIR, TreeColumn, TreeEnsemble, reference
from st_codegen.ir.arrays import FloatArray
from st_codegen.walkers.base import LoadedModel

#: Numbers that any comparison or cast may treat in its own way. 1e-35 is LightGBM's limit of zero, 2**24 XGBoost's of
#: category codes; 1e39 overflows float32, whose largest number is 3.4028235e38.
_LIMIT_OF_ZERO = float(np.float32(1e-35))
_AWKWARD = [0.0, -0.0, 0.5, 1.0, 1.5, 1e30, 2.0**24, 2.0**31, 2.0**40, 3.4028234e38, 1e39, 1e300, np.inf]
_TINY = [5e-324, 1e-300, 1e-45, 1e-38, 1e-36, _LIMIT_OF_ZERO]
_SPECIAL = np.array(
    [np.nan]
    + [sign * value for value in _AWKWARD for sign in (1, -1)]
    + [sign * near for value in _TINY for near in (value, value * (1 + 1e-15), value * (1 - 1e-15)) for sign in (1, -1)]
)


@pytest.fixture(scope="session")
def rows_for() -> Callable[..., FloatArray]:
    """Rows for a model: each awkward number, threshold, float neighbour and category code in turn, then mixtures."""
    return _rows_for


def _rows_for(model: ModelIR, seed: int = 0, mixtures: int = 1500) -> FloatArray:
    rng = np.random.default_rng(seed)
    pools = [_pool(model, column, rng) for column in range(len(model.features))]
    usual = np.array([[rng.choice(pool[np.abs(pool) < 1e3]) for pool in pools] for _ in range(40)])
    rows = [np.column_stack([rng.choice(pool, mixtures) for pool in pools])]
    for column, pool in enumerate(pools):
        block = usual[rng.integers(0, len(usual), len(pool))].copy()
        block[:, column] = pool
        rows.append(block)
    return np.vstack(rows)


def _pool(model: ModelIR, column: int, rng: np.random.Generator) -> FloatArray:
    """Values for one input: those of its splits, specials, and random numbers of their size."""
    values = [_SPECIAL, rng.normal(size=200), np.round(rng.normal(size=100) * 3, 1)]
    for op in model.ops:
        if not isinstance(op, TreeEnsemble):
            continue
        for number, reading in enumerate(op.columns):
            if reading.column == column:
                values.append(_at_splits(op, number, reading, rng))
    return np.concatenate(values)


def _at_splits(op: TreeEnsemble, number: int, reading: TreeColumn, rng: np.random.Generator) -> FloatArray:
    if reading.categorical:
        codes = np.arange(-2, reading.n_categories + 3)
        return np.concatenate([codes, codes + 0.7, codes - 0.3])
    thresholds = np.unique(op.threshold[op.split == number])
    if len(thresholds) > 150:
        thresholds = rng.choice(thresholds, 150, replace=False)
    single = thresholds.astype(np.float32)
    neighbours = [np.nextafter(single, np.float32(to)).astype(np.float64) for to in (-np.inf, np.inf)]
    halfway = [(single + neighbour) / 2 for neighbour in neighbours]
    return np.concatenate(
        [thresholds, np.nextafter(thresholds, -np.inf), np.nextafter(thresholds, np.inf), *neighbours, *halfway]
    )


@pytest.fixture(scope="session")
def assert_same() -> Callable[..., None]:
    """Assert that library and reference agree: bit for bit, or within `bound` (given the library's answer)."""
    return _assert_same


def _assert_same(
    model: LoadedModel, x: FloatArray | None = None, bound: Callable[[FloatArray], FloatArray] | None = None
) -> None:
    rows = _rows_for(model.ir) if x is None else x
    rows = rows[reference.valid_rows(model.ir, rows)]
    assert len(rows) > 100 or x is not None
    expected = model.predict(rows)
    found = reference.evaluate(model.ir, rows)
    assert expected.dtype == np.float64
    assert expected.shape == found.shape == (len(rows), len(model.ir.outputs))
    finite = np.all(np.isfinite(expected), axis=1)
    assert np.any(finite)
    assert np.all(np.isnan(found[~finite]))
    assert model.ir.exact == (bound is None)
    if bound is None:
        different = np.flatnonzero(np.any(expected[finite] != found[finite], axis=1))
        assert not len(different), (
            f"{len(different)} rows differ; first {rows[finite][different[0]]}: "
            f"library {expected[finite][different[0]]}, reference {found[finite][different[0]]}"
        )
    else:
        assert np.all(np.abs(expected - found)[finite] <= bound(expected[finite]))


@pytest.fixture
def without_package(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Makes the import of a package fail."""

    def hide(package: str) -> None:
        monkeypatch.setitem(__import__("sys").modules, package, None)

    yield hide


@pytest.fixture
def tried_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models are tried in this process, as on systems without copies of one: of so large a process they take long."""
    monkeypatch.setattr(processes, "can_be_copied", lambda: False)


@pytest.fixture(scope="session")
def mutated() -> Callable[..., bytes]:
    """Damage to the bytes of a file, drawn by hypothesis: cut, replaced, repeated, or a number exchanged."""
    return _mutated


def _mutated(data: Any, original: bytes) -> bytes:
    from hypothesis import strategies as st

    start = data.draw(st.integers(0, len(original)), label="start")
    end = data.draw(st.integers(start, min(start + 60, len(original))), label="end")
    kind = data.draw(st.sampled_from(["cut", "replace", "repeat", "truncate", "number"]), label="kind")
    if kind == "truncate":
        return original[:start]
    if kind == "cut":
        return original[:start] + original[end:]
    if kind == "repeat":
        return original[:end] + original[start:end] + original[end:]
    if kind == "replace":
        return original[:start] + data.draw(st.binary(max_size=8), label="bytes") + original[end:]
    digits = b"0123456789"
    while start < len(original) and original[start] not in digits:
        start += 1
    end = start
    while end < len(original) and original[end] in digits + b".e-+":
        end += 1
    numbers = [
        b"-1",
        b"0",
        b"1",
        b"7",
        b"99999999999999999999",
        b"-2147483649",
        b"2147483648",
        b"nan",
        b"inf",
        b"1e400",
    ]
    numbers += [b"-inf", b"", b"1 2", b"1.5", b"x", b"1_0", b"-", b"\xff", b"0x1"]
    return original[:start] + data.draw(st.sampled_from(numbers), label="number") + original[end:]
