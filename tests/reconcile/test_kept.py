"""Answers that are kept go with what was asked about."""

import gc
import weakref

import numpy as np

from st_codegen.reconcile.data.kept import KeptAnswers
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.mistakes.votes import expected_of, noise_power
from st_codegen.reconcile.rest.structure import structure

from .test_measurement import RIG, measured


def test_the_last_few_answers_are_kept():
    kept, asked, counted = KeptAnswers[int](2), [np.zeros(1) for _ in range(3)], []

    def ask(number, beside=None):
        return kept.of((asked[number],), lambda: counted.append(number) or len(counted), beside)

    assert [ask(0), ask(1), ask(1), ask(0)] == [1, 2, 2, 1]
    assert [ask(2), ask(1), ask(0)] == [3, 2, 4], "two are kept, the oldest goes"
    assert [ask(0, b"x"), ask(0, b"x"), ask(0)] == [5, 5, 4], "something else beside it is another question"


def test_what_was_asked_of_a_campaign_goes_with_it():
    """The last one stayed in memory, with all its curves, as long as the process."""
    data = measured()
    target = FitData(data, np.full(data.values.shape, 3e-5), np.ones(len(data), bool), groups_of(data.at))
    residual = data.values - expected_of(data, RIG)
    asked = data, data.at, target, residual, noise_power(data), expected_of(data, RIG), structure(target, residual)
    assert noise_power(data) is asked[4] and expected_of(data, RIG) is asked[5]
    assert structure(target, residual) is asked[6]
    kept = [weakref.ref(one) for one in asked]
    del data, target, residual, asked
    gc.collect()
    assert [one() is None for one in kept] == [True] * 7
