"""A quick estimate of what a model costs on a small PLC in its worst case, to rank candidates of a search.

It counts the operations of the intermediate representation along the longest path and prices them like code without
registers across statements on an Atom of 1.91 GHz with cold caches. What a block does beside the model's own sums, and
the layout that the compiler chooses, are not in it: the text of small models takes several times as long. The judge of
the emitted text is `verify`, not this file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from st_codegen.ir import Activation, KernelSum, Linear, ModelIR, TreeEnsemble
from st_codegen.ir.trees import depths_of
from st_codegen.walkers.objects import from_estimator

_CYCLES_PER_US = 1910.0
#: one level of a tree: loads, comparison, a jump that is predicted wrong, and two lines of tables from memory
_LEVEL = 30.0 + 10.0 + 2 * 191.0
#: a call of EXP or TANH
_FUNCTION = 130.0
#: multiply and add of two array elements
_MULTIPLY_ADD = 25.0
#: calling a block, and checking one of its inputs
_CALL = 50.0
#: a line of 64 bytes from memory, 8 numbers in a row
_LINE = 191.0


def worst_case_us(estimator: Any) -> float:
    """Microseconds of one evaluation. Raises UnsupportedModelError for what cannot be compiled."""
    return model_cost_us(from_estimator(estimator, "model").ir)


def model_cost_us(model: ModelIR) -> float:
    """Microseconds of one evaluation of a model, worst case."""
    checks = _CALL * (1 + len(model.features))
    return (checks + sum(_COUNTS.get(type(op), _unknown)(op) for op in model.ops)) / _CYCLES_PER_US


def _unknown(_: object) -> float:
    return _MULTIPLY_ADD * 4


def _numbers(count: int) -> float:
    return -(-count // 8) * _LINE


def _trees(ensemble: TreeEnsemble) -> float:
    return float(depths_of(ensemble).sum()) * _LEVEL + len(ensemble.roots) * _MULTIPLY_ADD


def _kernels(kernel: KernelSum) -> float:
    vectors, features = map(int, kernel.support_vectors.shape)
    return vectors * (features * _MULTIPLY_ADD + _FUNCTION) + _numbers(vectors * (features + 1))


def _linear(linear: Linear) -> float:
    size = int(linear.weights.size)
    return size * _MULTIPLY_ADD + _numbers(size)


_COUNTS: dict[type, Callable[[Any], float]] = {
    TreeEnsemble: _trees,
    KernelSum: _kernels,
    Linear: _linear,
    Activation: lambda activation: activation.width * _FUNCTION,
}
