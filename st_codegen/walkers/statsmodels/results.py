"""Fitted results of statsmodels: linear regressions, GLM, models of counts and of two classes, as `predict` computes.

It multiplies the columns with the parameters (regression/linear_model.py, robust/robust_linear_model.py,
genmod/generalized_linear_model.py, discrete/discrete_model.py) and, for a GLM, takes the inverse of the link
(genmod/families/links.py). Offsets and exposures of the fit take no part, but for models that are refused with one, nor
do parameters of a distribution, which stand behind those of the columns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Feature, FloatArray, Function, Source
from st_codegen.walkers.base import LIBRARIES, GraphBuilder, LoadedModel, walk_any, walks

#: Names of the column of ones.
_CONSTANT = ("const", "Intercept")
#: What models other than GLM make of their sums.
_MODELS: dict[str, Function | None] = {
    **dict.fromkeys(("OLS", "WLS", "GLS", "GLSAR", "QuantReg", "RLM")),
    "Logit": Function.LOGISTIC,
    "Probit": Function.ERF,
    **dict.fromkeys(("Poisson", "NegativeBinomial", "NegativeBinomialP", "GeneralizedPoisson"), Function.EXP),
}
#: Models that add the offset and the exposure of each row of the fit to whatever rows they predict.
_KEEP_OFFSETS = ("GeneralizedPoisson", "NegativeBinomialP")
#: The functions that are the inverses of links; those of powers stand beside it.
_INVERSES = {"Identity": None, "Log": Function.EXP, "Logit": Function.LOGISTIC, "Probit": Function.ERF}
_POWERS = ("Power", "InversePower", "Sqrt", "InverseSquared")


def load_object(results: Any, name: str) -> LoadedModel:
    """Fitted results as a model; a column of ones is no feature. Raises UnsupportedModelError, InputError."""
    names, constant = _columns(results)
    features = [Feature(column) for number, column in enumerate(names) if number != constant]
    if not features:
        raise InputError("the model has no columns but a constant")
    builder = GraphBuilder(len(features))
    walk_any(results, builder, 0)
    model = results.model
    family = f"({type(model.family).__name__}, {type(model.family.link).__name__})" if hasattr(model, "family") else ""
    version = str(__import__("statsmodels").__version__)
    note = () if constant is None else (f"the column {names[constant]} of ones is part of the block",)
    source = Source(LIBRARIES["statsmodels"], version, type(model).__name__ + family, notes=note)

    def predict(x: FloatArray) -> FloatArray:
        whole = x if constant is None else np.insert(x, constant, 1.0, axis=1)
        with np.errstate(all="ignore"):
            return np.asarray(results.predict(whole, transform=False), np.float64).reshape(len(x), -1)

    return LoadedModel(builder.model(name, tuple(features), source), predict)


def _columns(results: Any) -> tuple[list[str], int | None]:
    """The names of the parameters, and which of them is that of a column of ones."""
    model = getattr(results, "model", None)
    names = [str(column) for column in getattr(model, "exog_names", None) or []]
    names = names[: len(names) - _beside(model)]
    made = [column for column in names if not column.isidentifier()] if hasattr(model, "formula") else []
    if made:
        raise UnsupportedModelError(
            f"the formula computes columns ({', '.join(made[:3])}): fit on the columns themselves, computed before"
        )
    constant = getattr(getattr(model, "data", None), "const_idx", None)
    if constant is None or not 0 <= constant < len(names) or names[constant] not in _CONSTANT:
        return names, None
    ones = getattr(model, "exog", None)
    return names, constant if ones is not None and bool(np.all(ones[:, constant] == 1.0)) else None


def _beside(model: Any) -> int:
    """How many parameters of a distribution stand behind those of the columns."""
    extra = getattr(model, "k_extra", 0)
    return extra if type(model).__name__ in _MODELS and isinstance(extra, int) and extra in (0, 1) else 0


#: What the classes of results are called before `ResultsWrapper`.
_KINDS = """
    Binary Count GLM GeneralizedPoisson L1Binary L1GeneralizedPoisson L1NegativeBinomial L1Poisson NegativeBinomial
    NegativeBinomialP Poisson RLM Regression Regularized
"""


@walks(*(f"statsmodels.{kind}ResultsWrapper" for kind in _KINDS.split()))
def _results(results: Any, builder: GraphBuilder, value: int) -> int:
    names, constant = _columns(results)
    kind = type(results.model).__name__
    parameters = np.asarray(results.params, np.float64)
    parameters = parameters[: len(parameters) - _beside(results.model)] if parameters.ndim == 1 else parameters
    if kind not in (*_MODELS, "GLM") or parameters.shape != (len(names),):
        raise UnsupportedModelError(
            f"results of {kind} with {parameters.shape} parameters; supported are {', '.join(_MODELS)} and GLM of one "
            "number"
        )
    kept = [name for name in ("offset", "exposure") if kind in _KEEP_OFFSETS and hasattr(results.model, name)]
    if kept:
        raise UnsupportedModelError(
            f"{kind} with {' and '.join(kept)}: its predict adds those of the rows that it was fitted on to any other "
            "rows; fit it without, or take Poisson or NegativeBinomial, which leave them out"
        )
    weights = parameters if constant is None else np.delete(parameters, constant)
    bias = np.zeros(1) if constant is None else parameters[[constant]]
    builder.refuse_nan(value)
    builder.refuse_magnitude(math.inf)
    total = builder.linear(value, weights[None, :], bias)
    if kind == "GLM":
        return _inverse(results.model.family.link, builder, total)
    return _of_sum(_MODELS[kind], builder, total)


def _of_sum(function: Function | None, builder: GraphBuilder, value: int) -> int:
    """A function of a sum; the share of a normal distribution below it is that of its error function."""
    if function is Function.ERF:
        return builder.chain(builder.function(builder.scale(value, "*", 0.5**0.5), function), ("+", 1.0), ("*", 0.5))
    return value if function is None else builder.function(value, function)


def _inverse(link: Any, builder: GraphBuilder, value: int) -> int:
    """The inverse of a link; NumPy's power is within the bound."""
    name = type(link).__name__
    if name in _POWERS:
        power = float(link.power)
        return value if power == 1 else builder.function(value, "power", parameter=1.0 / power)
    if name not in _INVERSES:
        known = ", ".join((*_INVERSES, *_POWERS))
        raise UnsupportedModelError(f"the link {name}: supported are {known}")
    return _of_sum(_INVERSES[name], builder, value)
