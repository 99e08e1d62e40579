"""Inputs of a block of trees as terms: what is left of each once missing and refused values are set aside.

In front of trees the executor follows an input on its axis, interval by interval. Behind trees numbers are terms. An
input that enters such a number must be one and the same chain of operations on its limited value wherever the model
takes it: the number itself, the end of its declared range beyond that, and 0.0 where it is missing or refused.
"""

from __future__ import annotations

import numpy as np

from st_codegen.ir import Feature, FloatArray, ModelIR
from st_codegen.proof.prove.axis import AxisValue, from_keys
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import Link, bits, run_chain
from st_codegen.proof.prove.intervals import Interval, hull
from st_codegen.proof.prove.model import InputDomain, domain_of
from st_codegen.proof.prove.terms import Term, Terms, Value


class InputTerms:
    """The limited inputs of a model, whether they are missing, and values on their axes, as terms."""

    def __init__(self, terms: Terms, model: ModelIR) -> None:
        self.terms, self.features, self.domain = terms, model.features, domain_of(model)
        self.numbers: list[Value] = []
        self.missing: list[Value] = []
        #: Conditions under which the block takes its inputs, and the term of each.
        self.taken: list[tuple[object, Term]] = []
        #: Numbers in front of trees that are computed of several inputs; each has an axis behind those of the inputs.
        self.computed: list[Term] = []
        self._known: dict[int, tuple[AxisValue, Value]] = {}
        for number, feature in enumerate(model.features):
            self.numbers.append(terms.leaf(("input", number), "real", _ends(feature, self.domain, number)))
            self.missing.append(
                terms.leaf(("missing", number), "bool", (0.0, 1.0, False)) if self.domain.nan[number] else False
            )

    def number(self, value: AxisValue) -> Value:
        """A chain of operations on an input. Raises NotProvedError for a value that is none."""
        if id(value) not in self._known:
            links = self._links(value)
            term = [*self.numbers, *self.computed][value.axis.feature]
            for name, constant in links:
                term = self._linked(name, term, constant)
            self._known[id(value)] = value, term
        return self._known[id(value)][1]

    def _linked(self, name: str, term: Value, constant: float) -> Value:
        if name in ("neg", "abs", "single"):
            return self.terms.real(name, term)
        if name.startswith("r"):
            return self.terms.real(name[1:], constant, term)
        return self.terms.real(name, term, constant)

    def _links(self, value: AxisValue) -> tuple[Link, ...]:
        value.lift()
        value.held_alike()
        axis, taken = value.axis, value.axis.taken
        chain = np.zeros(axis.lanes, np.int64) if value.chain is None else value.chain
        found = {value.chains[number - 1] for number in np.unique(chain[taken & (chain > 0)]).tolist()}
        if len(found) != 1 or (value.known is not None and not np.all(value.known[taken])):
            raise NotProvedError("a number that depends on an input in several ways")
        (links,) = found
        first, last = axis.low, axis.high
        if axis.feature < len(self.features):
            first, last = (_limited(self.features[axis.feature], ends) for ends in (first, last))
        varying, fixed = taken & (chain > 0), taken & (chain == 0)
        whole = (bits(first) == bits(axis.low)) & (bits(last) == bits(axis.high))
        same = (bits(first) == bits(last)) & (bits(run_chain(links, first)) == bits(value.constant))
        if not np.all(whole[varying]) or not np.all(same[fixed]):
            raise NotProvedError("a number that is not computed from the limited input")
        return links

    def truth(self, value: object) -> Value:
        """A condition as a term: whether an input is missing, or whether the block takes its inputs."""
        if not isinstance(value, AxisValue):
            return value if isinstance(value, bool | Term) else self.condition(value)
        value.lift()
        here = value.constant.astype(np.bool_)
        taken = value.axis.taken
        for truth in (True, False):
            if np.all(here == truth):
                return truth
        missing = np.isnan(value.axis.low)
        may_miss = value.axis.feature < len(self.features) and self.domain.nan[value.axis.feature]
        if may_miss and np.all(here[taken] == missing[taken]):
            value.held_alike()
            return self.missing[value.axis.feature]
        return self.condition(value)

    def condition(self, value: object) -> Value:
        """A condition on inputs, each for itself, of which only that it is the same one is known."""
        for known, term in self.taken:
            if known is value:
                return term
        term = self.terms.leaf(("taken", len(self.taken)), "bool", (0.0, 1.0, False))
        self.taken.append((value, term))
        return term


def _ends(feature: Feature, domain: InputDomain, number: int) -> Interval:
    keys = np.array([domain.low[number], domain.high[number], 0])
    low, high, zero = _limited(feature, from_keys(keys)).tolist()
    return hull((low, high, False), (min(zero, 0.0), max(zero, 0.0), False))


def _limited(feature: Feature, x: FloatArray) -> FloatArray:
    """Numbers as a block limits them; 0.0 for NaN."""
    x = np.where(np.isnan(x), 0.0, x)
    if feature.lower is None or feature.upper is None:
        return x
    return np.where(x < feature.lower, feature.lower, np.where(x > feature.upper, feature.upper, x))
