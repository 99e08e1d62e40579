"""Steps with copy=False, which write into the rows that they are given: where other parts read these, no number holds.

The library's own answers then depend on the kind of table that it is given, since it makes a copy of some kinds alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.walkers.sklearn.native import objects_in

#: The packages of sklearn (1.9) whose steps obey `copy` in `transform`; others do in `fit` alone.
_PREPARE = ("sklearn.preprocessing", "sklearn.impute")
#: Compositions that hand each of their estimators a copy of some columns.
_COPY_COLUMNS = ("Bagging", "RFE")
#: Attributes of compositions that read what others answer, not the rows.
_READ_ANSWERS = ("final_estimator_", "transformer_")


def check_rows_are_kept(estimator: Any) -> None:
    """Raise UnsupportedModelError where a step of a fitted estimator writes into rows that its other parts read."""
    if any(_writes(part) for part in objects_in(estimator)):
        for step in _writers(estimator, shared=False):
            raise UnsupportedModelError(
                f"{type(step).__name__}(copy=False), which writes into rows that other parts of the model read: what "
                "the library answers depends on the kind of table; set copy=True, and train the model again"
            )


def _writes(part: Any) -> bool:
    return type(part).__module__.startswith(_PREPARE) and not getattr(part, "copy", True)


def _writers(part: Any, shared: bool) -> Iterator[Any]:
    """The steps that write into rows which others read as well; `shared`: whether others read the rows of this part."""
    if type(part).__module__.startswith(_PREPARE):
        if shared and _writes(part):
            yield part
    elif hasattr(part, "steps"):
        for _, step in part.steps:
            yield from _writers(step, shared)
            shared = shared and (step in (None, "passthrough") or getattr(step, "func", step) is None)
    elif hasattr(part, "transformers_"):
        several = sum(not (isinstance(step, str) and step == "drop") for _, step, _ in part.transformers_) > 1
        for _, step, columns in part.transformers_:  # other choices of columns than slices are copies
            yield from _writers(step, isinstance(columns, slice) and (shared or several))
    else:
        inside, name = _estimators_in(part), type(part).__name__
        # a chain, and one against one, ask each estimator twice; a stack may read the rows once more
        shared |= len(inside) > 1 or name.endswith("Chain") or name.startswith("OneVsOne")
        shared |= bool(getattr(part, "passthrough", False))
        for one in inside:
            yield from _writers(one, shared and not name.startswith(_COPY_COLUMNS))


def _estimators_in(part: Any) -> list[Any]:
    """The fitted estimators of a composition that read its rows."""
    own = vars(part) if hasattr(part, "__dict__") else {}
    if "transformer_list" in own:
        return [one for _, one in own["transformer_list"]]
    fitted = [own[name] for name in ("estimators_", "calibrated_classifiers_") if name in own]
    fitted = fitted or [[held] for name, held in own.items() if name.endswith("_") and name not in _READ_ANSWERS]
    for held in fitted, [[own.get("estimator")]]:
        listed = [one for place in held for one in (place.ravel() if isinstance(place, np.ndarray) else place)]
        if found := [one for one in listed if hasattr(one, "predict") or hasattr(one, "predict_proba")]:
            return found
    return []
