"""What holds of every model file that is accepted: the library's answers are those of the reference."""

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir import reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.proof import bounds
from st_codegen.proof.probes import probe_rows

ROWS = 60


def agrees(loaded):
    """Whether library and reference agree on the rows that verification would try first.

    A library that refuses the model with an exception refuses it in one line: raises InputError.
    """
    ir = limit_inputs(loaded.ir)
    x = probe_rows(ir, ROWS)
    x = x[np.unique(np.linspace(0, len(x) - 1, 4 * ROWS).astype(int))]
    expected = reference.evaluate(ir, x)
    usable = np.all(np.isfinite(expected), axis=1)
    x, expected = reference.limited(ir, x)[usable], expected[usable]
    if not len(x):
        return True
    try:
        library = loaded.predict(x)
    except Exception as error:
        raise InputError(f"the library refuses the model: {type(error).__name__}: {error}") from None
    with np.errstate(all="ignore"):
        bound = bounds.difference_bound(ir, x)
        same = (library == expected) | (np.abs(library - expected) <= bound) | np.isinf(bound)
    if not same.all():
        row = int(np.flatnonzero(~same.all(axis=1))[0])
        print(f"differ at {x[row].tolist()}: {library[row]} and {expected[row]}, bound {bound[row]}")
    return bool(same.all())
