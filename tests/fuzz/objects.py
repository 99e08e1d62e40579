"""Changed copies of fitted estimators: what a pickle or a `.skops` file may hold and `fit` would never make."""

import copy

import numpy as np


def slots(value, path=(), depth=0):
    """The paths to everything that stands in an estimator: arrays, numbers, texts, lists, and what is inside them."""
    if path:
        yield path
    if depth > 7:
        return
    for key, entry in entries_of(value):
        yield from slots(entry, (*path, key), depth + 1)


def entries_of(value):
    if isinstance(value, dict):
        return [(("entry", key), entry) for key, entry in value.items()]
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.dtype == object):
        return (
            [(("entry", index), value[index]) for index in np.ndindex(np.shape(value))]
            if isinstance(value, np.ndarray)
            else [(("entry", index), entry) for index, entry in enumerate(value)]
        )
    if type(value).__module__.partition(".")[0] in ("sklearn", "lightgbm", "xgboost") and hasattr(value, "__dict__"):
        return [(("attribute", key), entry) for key, entry in vars(value).items()]
    return []


def get(value, path):
    for kind, key in path:
        value = getattr(value, key) if kind == "attribute" else value[key]
    return value


def put(value, path, new):
    """Replace what stands at a path; tuples on the way are made anew."""
    *before, (kind, key) = path
    owner = get(value, before)
    if isinstance(owner, tuple):
        changed = list(owner)
        changed[key] = new
        put(value, before, tuple(changed))
    elif kind == "attribute":
        setattr(owner, key, new)
    else:
        owner[key] = new


def changed_array(array, random):
    """An array with one structural change; of object arrays only the shape changes."""
    choice = random.integers(0, 8 if array.dtype == object else 12)
    if choice == 0:
        return array[:-1]
    if choice == 1:
        return np.concatenate([array, array[:1]]) if array.ndim else np.repeat(array, 2)
    if choice == 2:
        return array[..., :-1] if array.ndim else array.reshape(1, 1)
    if choice == 3:
        return np.concatenate([array, array[..., :1]], axis=-1) if array.ndim else array
    if choice == 4:
        return array[:0]
    if choice == 5:
        return array.reshape(*array.shape, 1)
    if choice == 6:
        return array.ravel()
    if choice == 7:
        return array.astype(object)
    if choice == 8:
        kinds = [np.float32, np.float16, np.int64, np.int8, np.complex128, "U20", ">f8", np.longdouble, bool]
        return array.astype(kinds[random.integers(0, len(kinds))])
    return _other_value(array, random)


def _other_value(array, random):
    """One number of an array, or of one field of its records, replaced."""
    changed = array.copy()
    target = changed
    if changed.dtype.names:
        target = changed[changed.dtype.names[random.integers(0, len(changed.dtype.names))]]
    if not target.size:
        return changed
    where = np.unravel_index(random.integers(0, target.size), target.shape)
    if target.dtype.kind == "f":
        target[where] = random.choice([np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0, 1e-320, 3.7])
    elif target.dtype.kind in "iu":
        info = np.iinfo(target.dtype)
        choices = [info.max, info.min, 0, 1, 2, 7, min(300, info.max)]
        target[where] = choices[random.integers(0, len(choices))]
    elif target.dtype.kind == "b":
        target[where] = not target[where]
    elif target.dtype.kind == "O":
        target[where] = None
    return changed


def changed_value(value, random):
    """Another value in the place of one that is no array."""
    others = [
        None,
        0,
        -1,
        1,
        2,
        2**40,
        1.5,
        float("nan"),
        float("inf"),
        "",
        "poly",
        True,
        False,
        [],
        {},
        (),
        np.zeros(0),
    ]
    others += [np.zeros(3), np.array(["a"]), np.array([None]), np.float64(1e300), "passthrough", slice(0, 1)]
    if isinstance(value, list) and value:
        others += [value[:-1], value + value[:1], value[::-1]]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        others += [value + 1, -value, float(value), np.float32(value)]
    return others[random.integers(0, len(others))]


def mutant(estimator, random):
    """A deep copy of an estimator with one to three changes."""
    changed = copy.deepcopy(estimator)
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        paths = list(slots(changed))
        arrays = [path for path in paths if isinstance(get(changed, path), np.ndarray)]
        if arrays and random.random() < 0.6:
            path = arrays[random.integers(0, len(arrays))]
            new = changed_array(get(changed, path), random)
        else:
            path = paths[random.integers(0, len(paths))]
            new = changed_value(get(changed, path), random)
        put(changed, path, new)
    return changed
