"""Walkers for scikit-learn's support vector machines, neural networks and linear models.

These add products through BLAS, whose order is not specified: equal within the bound of `bounds.py`, not to the bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Activation, Function, Kernel, KernelSum, Linear
from st_codegen.walkers.base import GraphBuilder, walks
from st_codegen.walkers.fitted import Fitted

_KERNELS = {
    "linear": Kernel.LINEAR,
    "poly": Kernel.POLYNOMIAL,
    "rbf": Kernel.RBF,
    "sigmoid": Kernel.SIGMOID,
}
_FUNCTIONS = {
    "identity": Function.IDENTITY,
    "tanh": Function.TANH,
    "logistic": Function.LOGISTIC,
    "relu": Function.RELU,
    "exp": Function.EXP,
}


@walks("sklearn.SVR", "sklearn.NuSVR")
def walk_svr(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Sum of dual coefficient * kernel, plus intercept (`sklearn/svm/src/libsvm/svm.cpp: svm_predict_values`).

    scikit-learn predicts with `_dual_coef_` and `_intercept_`, of which the public attributes are copies.
    """
    fitted = Fitted(estimator)
    support_vectors = fitted.get("support_vectors_")
    _refuse_nan_and_infinity(builder)
    kernel = fitted.choice("kernel", _KERNELS)
    if not isinstance(support_vectors, np.ndarray) or fitted.flag("_sparse"):
        raise UnsupportedModelError(
            f"{type(estimator).__name__} was fitted on a sparse matrix: fit it on a dense array"
        )
    width = builder.width(value)
    support_vectors = fitted.floats("support_vectors_", (None, width))
    count = len(support_vectors)
    intercept = fitted.floats("_intercept_", (1,))
    coefficients = fitted.floats("_dual_coef_", (1, count))
    # libsvm reads as many entries of these as it has support vectors, and two of the numbers a class
    fitted.integers("support_", (count,), low=0, high=2**31 - 1)
    fitted.integers("_n_support", (2,), low=0, high=2**31 - 1)
    for public, used in (("intercept_", intercept), ("dual_coef_", coefficients)):
        if not np.array_equal(fitted.floats(public, used.shape), used):
            raise fitted.fail(public, f"differs from _{public}, with which scikit-learn predicts")
    if not count:  # every target lies within epsilon of the mean: a constant
        return builder.add(Linear((value,), np.zeros((1, width)), intercept))
    return builder.add(
        KernelSum(
            inputs=(value,),
            kernel=kernel,
            support_vectors=support_vectors,
            coefficients=coefficients,
            intercept=intercept,
            gamma=fitted.number("_gamma"),
            coef0=fitted.number("coef0"),
            degree=fitted.integer("degree", 0, 2**31 - 1),
        )
    )


@walks(
    "sklearn.MLPRegressor",
    trusts=(
        "sklearn.neural_network._stochastic_optimizers.AdamOptimizer",
        "sklearn.neural_network._stochastic_optimizers.SGDOptimizer",
    ),
)
def walk_mlp(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Add the dense layers of a network, each with its function (`_multilayer_perceptron.py: _forward_pass_fast`)."""
    fitted = Fitted(estimator)
    layers = fitted.items("coefs_")
    last = len(layers) - 1
    biases = fitted.items("intercepts_", len(layers))
    fitted.integers("n_layers_", (), low=len(layers) + 1, high=len(layers) + 1)
    _refuse_nan_and_infinity(builder)
    for layer, (given, given_bias) in enumerate(zip(layers, biases, strict=True)):
        weights = fitted.floats_of(f"coefs_[{layer}]", given, (builder.width(value), None))
        bias = fitted.floats_of(f"intercepts_[{layer}]", given_bias, (weights.shape[1],))
        value = builder.add(Linear((value,), weights.T, bias))
        function = fitted.choice("out_activation_" if layer == last else "activation", _FUNCTIONS)
        if function is not Function.IDENTITY:
            value = builder.add(Activation((value,), function, builder.width(value)))
    return value


@walks(
    "sklearn.LinearRegression",
    "sklearn.Ridge",
    "sklearn.RidgeCV",
    "sklearn.Lasso",
    "sklearn.LassoCV",
    "sklearn.ElasticNet",
    "sklearn.ElasticNetCV",
    "sklearn.LinearSVR",
)
def walk_linear(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """`X @ coef_.T + intercept_` (`sklearn/linear_model/_base.py: LinearModel._decision_function`)."""
    fitted = Fitted(estimator)
    width = builder.width(value)
    weights = np.atleast_2d(fitted.floats("coef_", (width,), (None, width)))
    _refuse_nan_and_infinity(builder)
    intercept = fitted.floats("intercept_", (), (1,), (len(weights),))
    return builder.add(Linear((value,), weights, np.broadcast_to(intercept, (len(weights),))))


def _refuse_nan_and_infinity(builder: GraphBuilder) -> None:
    """scikit-learn's `check_array` raises for both."""
    builder.refuse_nan()
    builder.refuse_magnitude(math.inf)
