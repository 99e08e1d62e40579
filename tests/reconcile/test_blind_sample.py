"""A handful of the blind cases, on development seeds; `make blind` runs them all on held-out ones."""

import pytest

from .blind import cases, run

pytestmark = pytest.mark.thorough

#: one of each kind that has a clear-cut answer; the slower ones with `-m slow`
SAMPLE = (
    ("single", ("torsional_compliance",), 10.0, "table"),
    ("none", (), 0.0, "table"),
    ("foreign", (), 10.0, "table"),
    ("confounded", ("encoder_eccentricity",), 10.0, "table"),
    pytest.param(("single", ("load_dependent_mesh",), 10.0, "table"), marks=pytest.mark.slow),
    pytest.param(("none", (), 0.0, "curves"), marks=pytest.mark.slow),
    pytest.param(("single", ("control_lag",), 3.0, "recording"), marks=pytest.mark.slow),
)


def chosen(kind, effects, size, form):
    for case in cases.listed("dev", 3 * cases.ROUND):
        if (case.kind, case.effects, case.size, case.format) == (kind, effects, size, form):
            return case
    raise LookupError(f"no case {kind} {effects} {size} {form}")


@pytest.mark.parametrize("wanted", SAMPLE, ids=lambda wanted: "-".join((wanted[0], *wanted[1], wanted[3])))
def test_sample(wanted, tmp_path):
    result = run.run_case(chosen(*wanted), tmp_path, how=run.lean)
    assert result["status"] == "scored", result.get("message", result["status"])
    assert result["score"]["passed"], (result["claims"], result["score"]["remarks"])
    if result["score"]["gap_ratio"] is not None and result["case"]["kind"] == "single":
        assert result["score"]["parameters_right"]
        # what drifted since the rig was made is unexplained, and stands above the floor
        assert result["score"]["gap_ratio"] <= 1.1 or result["unexplained_orders"]
