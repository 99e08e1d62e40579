"""What `fit` leaves in an estimator, checked where it is read: present, of the type, shape and size that `fit` makes.

Anybody can write any object into a file, and libraries use some of these arrays in native code without a look at their
lengths. A walker reads every attribute on which predictions depend through `Fitted`; the library predicts after that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MethodType
from typing import Any, TypeVar

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, BoolArray, FloatArray, IntArray

#: One length for each axis; None where any length will do.
Shape = tuple[int | None, ...]

_T = TypeVar("_T")
_LARGEST_WHOLE = 2.0**53
#: Numbers of a sparse matrix, its zeros included.
_LARGEST_DENSE = 2.0**26
#: The types of sparse matrices in files.
SPARSE = ("scipy.sparse._csr.csr_matrix",)


class Fitted:
    """The attributes of a fitted estimator. Each method raises InputError that names what is not as `fit` makes it."""

    def __init__(self, estimator: Any) -> None:
        self.estimator = estimator
        self.kind = type(estimator).__name__
        own = vars(estimator) if hasattr(estimator, "__dict__") else {}
        hidden = [name for name in sorted(own.keys() & _of_class(type(estimator))) if not self._is_own_method(name)]
        if hidden:
            raise self.fail(hidden[0], "hides what the class defines")

    def _is_own_method(self, name: str) -> bool:
        """Whether an attribute is the method that the class defines: scorers of early stopping put one back so."""
        found = vars(self.estimator)[name]
        same = isinstance(found, MethodType) and found.__self__ is self.estimator
        return same and found.__func__ is getattr(type(self.estimator), name)

    def fail(self, name: str, message: str) -> InputError:
        """An error that names the attribute."""
        return InputError(
            f"{self.kind}.{name}: {message}; the model was changed after it was fitted, saved by another version of "
            "its library, or is damaged"
        )

    def get(self, name: str) -> Any:
        """An attribute of any type. One that is missing means that `fit` was not called."""
        try:
            return getattr(self.estimator, name)
        except AttributeError:
            learnt = {own for own in vars(self.estimator) if own.endswith("_") and not own.startswith("_")}
            if learnt - {"n_features_in_", "feature_names_in_"}:  # these are known before training begins
                raise InputError(
                    f"{self.kind} has no {name}: another version of its library saved it, or it is damaged; train it "
                    "again with the installed version"
                ) from None
            raise InputError(f"{self.kind} is not fitted ({name} is missing): call fit() before saving it") from None

    def refuse_old(self, name: str, choice: str) -> None:
        """Raise UnsupportedModelError where an older version trained with a choice that newer ones do not compute."""
        if self.estimator.__dict__.get(name) == choice:
            raise UnsupportedModelError(
                f"{self.kind} with {name}='{choice}', of which newer versions of scikit-learn compute other numbers "
                "than the version that trained it: train it again"
            )

    def other_type(self, name: str, what: str) -> UnsupportedModelError:
        """An error for numbers of a type that `fit` takes from its training data, and that is not compiled."""
        return UnsupportedModelError(
            f"{self.kind}.{name}: {what}; float64 is supported, and of most models float32: fit it on "
            "X.astype('float64') and y.astype('float64')"
        )

    def floats(self, name: str, *shapes: Shape) -> FloatArray:
        """Finite numbers as float64, in an array of one of the shapes (without shapes: of any).

        A sparse matrix, as `sparsify()` and random projections make it, is read as the array that it stands for.
        """
        value = self.get(name)
        if type(value).__module__.startswith("scipy.sparse"):
            if np.prod([float(length) for length in value.shape]) > _LARGEST_DENSE:
                raise self.fail(name, f"a sparse matrix of shape {value.shape}, which no block could hold")
            value = value.toarray()
        return self.floats_of(name, value, *shapes)

    def floats_of(self, name: str, value: Any, *shapes: Shape) -> FloatArray:
        """As `floats`, for a value that stands inside an attribute."""
        array = self._array(name, value, "fiu", shapes)
        if array.dtype.kind == "f":
            if array.dtype.itemsize not in (4, 8):
                raise self.other_type(name, f"numbers of type {array.dtype}")
        elif array.size and np.max(np.abs(array.astype(np.float64))) > _LARGEST_WHOLE:
            raise self.fail(name, "an integer that float64 does not hold")
        result = array.astype(np.float64, order="C")  # sums of it are then the same however it was stored
        bad = np.flatnonzero(~np.isfinite(result.ravel()))
        if bad.size:
            raise InputError(
                f"{self.kind}.{name}: number {bad[0]} is {result.ravel()[bad[0]]}, not finite; train the model again"
            )
        return result

    def number(self, name: str) -> float:
        """One finite number."""
        return float(self.floats(name, ()))

    def integers(self, name: str, *shapes: Shape, low: int, high: int) -> IntArray:
        """Integers of low .. high."""
        return self.integers_of(name, self.get(name), *shapes, low=low, high=high)

    def integers_of(self, name: str, value: Any, *shapes: Shape, low: int, high: int) -> IntArray:
        """As `integers`, for a value that stands inside an attribute."""
        array = self._array(name, value, "iu", shapes)
        bad = np.flatnonzero((array.ravel() < low) | (array.ravel() > high))
        if bad.size:
            raise self.fail(name, f"number {bad[0]} is {array.ravel()[bad[0]]}, expected {low} .. {high}")
        return array.astype(np.int64)

    def integer(self, name: str, low: int, high: int) -> int:
        """One integer of low .. high."""
        return int(self.integers(name, (), low=low, high=high))

    def flags(self, name: str, *shapes: Shape) -> BoolArray:
        """An attribute of truth values, of one of some shapes. Raises UnsupportedModelError for anything else."""
        return self.flags_of(name, self.get(name), *shapes)

    def flags_of(self, name: str, value: Any, *shapes: Shape) -> BoolArray:
        """As `flags`, for a value that stands inside an attribute."""
        return self._array(name, value, "b", shapes)

    def flag(self, name: str) -> bool:
        """One truth value."""
        return bool(self.flags(name, ()))

    def items(self, name: str, count: int | None = None) -> list[Any]:
        """The entries of a list, of which there must be `count` if it is given, else at least one."""
        value = self.get(name)
        if not isinstance(value, list | tuple):
            raise self.fail(name, f"{_kind_of(value)}, expected a list")
        if len(value) != count if count is not None else not value:
            raise self.fail(
                name, f"{counted(len(value), 'entry', 'entries')}, expected {'some' if count is None else count}"
            )
        return list(value)

    def choice(self, name: str, known: Mapping[str, _T]) -> _T:
        """What one of the known words stands for. Raises UnsupportedModelError for another word."""
        value = self.get(name)
        if isinstance(value, str) and value in known:
            return known[value]
        given = value[:40] if isinstance(value, str) else _kind_of(value)
        raise UnsupportedModelError(f"{self.kind} with {name}={given}: supported are {', '.join(known)}")

    def _array(self, name: str, value: Any, kinds: str, shapes: Iterable[Shape]) -> AnyArray:
        """A number or an array of a kind of numbers and of one of some shapes."""
        if not isinstance(value, np.ndarray | np.generic | float | int):
            raise self.fail(name, f"{_kind_of(value)}, expected numbers")
        array: AnyArray = np.asarray(value)
        if kinds == "fiu" and array.dtype.kind == "b":
            raise self.other_type(name, "truth values")
        if array.dtype.kind not in kinds or not array.dtype.isnative:
            raise self.fail(name, f"values of type {array.dtype}, expected {_KINDS[kinds]}")
        allowed = list(shapes)
        if allowed and not any(_fits(array.shape, shape) for shape in allowed):
            raise self.fail(name, f"shape {array.shape}, expected {' or '.join(map(_shape_text, allowed))}")
        return array


_KINDS = {"fiu": "numbers", "iu": "integers", "b": "truth values"}


def _fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    return len(shape) == len(wanted) and all(
        want is None or have == want for have, want in zip(shape, wanted, strict=True)
    )


def _shape_text(shape: Shape) -> str:
    inside = ", ".join("any" if length is None else str(length) for length in shape)
    return f"({inside},)" if len(shape) == 1 else f"({inside})"


def _kind_of(value: Any) -> str:
    return f"a {type(value).__module__}.{type(value).__name__}".replace("a builtins.", "a ")


def _of_class(kind: type) -> set[str]:
    """The names that a class defines and its objects do not set: methods, properties, constants."""
    return {name for base in kind.__mro__ for name in vars(base) if name not in _SET_IN_BOTH}


#: Names that classes have as well as their objects.
_SET_IN_BOTH = frozenset({"__doc__", "__module__", "__dict__", "__weakref__", "positive"})
