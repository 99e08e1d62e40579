"""Does a physical feature help: where an order's frequency lies in respect of the resonance that lifts it?

An order k turns with k * speed / (60 * reduction ratio) Hz. `plain`: speed, torque and oil temperature, as the models
of the bundle have. `distance`: a further feature, that frequency minus the resonance's. `response`: two further ones,
real and imaginary part of the response 1 / (1 - r^2 + 2i*zeta*r) of an oscillator at r = frequency / resonance.
`warped`: the phase of that response in place of the speed. Mean absolute complex error in deg, by cross-validation on
the paper's training points alone and at its test points:

    python benchmarks/resonance_feature.py ../shared/data
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable, read_table
from st_codegen.te.harmonics import Direction
from st_codegen.training.families import Learner
from st_codegen.training.search import fold_numbers

RATIO, RESONANCE_HZ, DAMPING = 81.0, 54.0, 0.05
ORDERS = (156, 162, 240)
FOLDS = 10
#: what learns: lengths of the SVM are in standard deviations here, since features differ in unit
LEARNERS = {
    "ERT": Learner("ERT", {"n_estimators": 60, "max_depth": 15, "min_samples_split": 3}),
    "GBM": Learner("GBM", {"learning_rate": 0.07, "max_depth": 6, "n_estimators": 150, "subsample": 0.5}),
}


def plain(table: HarmonicTable, order: int) -> Any:
    """Speed, torque, temperature (rows, 3)."""
    del order
    return table.conditions


def distance(table: HarmonicTable, order: int) -> Any:
    """And the distance from the resonance in Hz (rows, 4)."""
    return np.column_stack([table.conditions, frequency(table, order) - RESONANCE_HZ])


def response(table: HarmonicTable, order: int) -> Any:
    """And the response of an oscillator (rows, 5)."""
    at = oscillator(table, order)
    return np.column_stack([table.conditions, at.real, at.imag])


def warped(table: HarmonicTable, order: int) -> Any:
    """Phase of the response, torque, temperature (rows, 3)."""
    return np.column_stack([np.angle(oscillator(table, order)), table.conditions[:, 1:]])


def frequency(table: HarmonicTable, order: int) -> Any:
    """Hz (rows,)."""
    return order * table.speed_rpm / (60.0 * RATIO)


def oscillator(table: HarmonicTable, order: int) -> Any:
    """Complex response (rows,)."""
    r = frequency(table, order) / RESONANCE_HZ
    return 1.0 / (1.0 - r**2 + 2j * DAMPING * r)


def predicted(learner: Learner, x: Any, y: Any, at: Any) -> Any:
    """Complex coefficients at `at` from those at x."""
    return learner.fit(x, y.real, 0).predict(at) + 1j * learner.fit(x, y.imag, 0).predict(at)


def errors(learner: Learner, features: Callable[[HarmonicTable, int], Any], order: int, tables: Any) -> Any:
    """Mean absolute complex errors: by cross-validation, at the test points."""
    train, test = tables
    x, y = features(train, order), train.column(order)
    fold = fold_numbers(train.conditions, FOLDS, 0)
    left_out = np.empty_like(y)
    for number in range(FOLDS):
        out = fold == number
        left_out[out] = predicted(learner, x[~out], y[~out], x[out])
    at_test = predicted(learner, x, y, features(test, order))
    return np.abs(left_out - y).mean(), np.abs(at_test - test.column(order)).mean()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder of the measured tables")
    data = parser.parse_args().data
    table = read_table(data / "rv160n_harmonics.csv").direction(Direction.FORWARD)
    wanted = {tuple(row) for row in read_table(data / "rv160n_paper_test_predictions_hgbm.csv").conditions.tolist()}
    is_test = np.array([tuple(row) in wanted for row in table.conditions.tolist()])
    tables = (table.rows(~is_test), table.rows(is_test))
    print(f"{'order':>5} {'family':<7} {'features':<9} {'validation':>11} {'test':>11}")
    for order in ORDERS:
        for name, learner in LEARNERS.items():
            for features in (plain, distance, response, warped):
                validation, test = errors(learner, features, order, tables)
                print(f"{order:>5} {name:<7} {features.__name__:<9} {validation:11.3e} {test:11.3e}", flush=True)


if __name__ == "__main__":
    main()
