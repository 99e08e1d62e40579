"""Walkers for scikit-learn's support vector machines, neural networks and linear models.

These add products through BLAS, whose order is not specified: equal within the bound of `bounds.py`, not to the bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Activation, Function, Kernel, KernelSum, Linear
from st_codegen.walkers.base import GraphBuilder, require_fitted, walks

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
    """Sum of dual coefficient * kernel, plus intercept (`sklearn/svm/src/libsvm/svm.cpp: svm_predict_values`)."""
    require_fitted(estimator, "dual_coef_")
    _refuse_nan_and_infinity(builder)
    if estimator.kernel not in _KERNELS:
        kernel = estimator.kernel if isinstance(estimator.kernel, str) else "a Python function"
        raise UnsupportedModelError(
            f"{type(estimator).__name__} with kernel={kernel}: supported are {', '.join(_KERNELS)}"
        )
    if not isinstance(estimator.support_vectors_, np.ndarray):
        raise UnsupportedModelError(
            f"{type(estimator).__name__} was fitted on a sparse matrix: fit it on a dense array"
        )
    if not len(estimator.support_vectors_):  # every target lies within epsilon of the mean: a constant
        return builder.add(Linear((value,), np.zeros((1, builder.width(value))), estimator.intercept_))
    return builder.add(
        KernelSum(
            inputs=(value,),
            kernel=_KERNELS[estimator.kernel],
            support_vectors=estimator.support_vectors_,
            coefficients=estimator.dual_coef_,
            intercept=np.ravel(estimator.intercept_),
            gamma=float(estimator._gamma),
            coef0=float(estimator.coef0),
            degree=int(estimator.degree),
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
    require_fitted(estimator, "coefs_")
    _refuse_nan_and_infinity(builder)
    last = len(estimator.coefs_) - 1
    for layer, (weights, bias) in enumerate(zip(estimator.coefs_, estimator.intercepts_, strict=True)):
        value = builder.add(Linear((value,), np.transpose(weights), bias))
        name = estimator.out_activation_ if layer == last else estimator.activation
        if name not in _FUNCTIONS:
            raise UnsupportedModelError(f"MLPRegressor with activation={name!r}: supported are {', '.join(_FUNCTIONS)}")
        if name != "identity":
            value = builder.add(Activation((value,), _FUNCTIONS[name], builder.width(value)))
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
    require_fitted(estimator, "coef_")
    _refuse_nan_and_infinity(builder)
    weights = np.atleast_2d(estimator.coef_)
    bias = np.broadcast_to(np.ravel(estimator.intercept_), (len(weights),))
    return builder.add(Linear((value,), weights, bias))


def _refuse_nan_and_infinity(builder: GraphBuilder) -> None:
    """scikit-learn's `check_array` raises for both."""
    builder.refuse_nan()
    builder.refuse_magnitude(math.inf)
