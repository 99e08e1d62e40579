"""Who takes part in the race: each makes a shared library with `race`, or is called from Python.

A contender that cannot express a model, or fails on today's libraries, raises; `race.py` lists the error.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

#: The same compiler and flags for all C; contraction would change results, and baseline x86-64 has no FMA anyhow
GCC = ("gcc", "-O2", "-fPIC", "-ffp-contract=off", "-fwrapv", "-w")
#: Compiled contenders; `make clean` removes them
CACHE = Path(__file__).resolve().parent.parent / "build" / "race"
#: Seconds after which gcc is stopped
COMPILE_LIMIT = float(os.environ.get("RACE_GCC_LIMIT_S", "240"))


class TooSlowError(Exception):
    """A compiler was stopped; for how long it ran is kept, so that it is not tried again."""


@dataclass(frozen=True)
class Case:
    """A fitted estimator and rows inside its trained range, shape (rows, features)."""

    name: str
    estimator: Any
    rows: np.ndarray

    @property
    def library(self) -> str:
        return type(self.estimator).__module__.partition(".")[0]

    @property
    def scores(self) -> int:
        """How many numbers a peer computes for a row: a score for each class, or 1 where there are none."""
        return len(getattr(self.estimator, "classes_", (0,)))

    def expected(self, rows: np.ndarray) -> np.ndarray:
        """What the library predicts, shape (rows,); classes are numbered from 0."""
        return np.asarray(self.estimator.predict(rows), np.float64).reshape(len(rows))


@dataclass
class Built:
    """What a contender made: a library with `race`, or a Python function of one row, shape (1, features)."""

    generate_s: float
    compile_s: float = 0.0
    library: Path | None = None
    outputs: int = 1
    code_bytes: int | None = None
    data_bytes: int | None = None
    call: Callable[[np.ndarray], Any] | None = None
    note: str = ""
    expected_most: int | None = None


def compiled(
    sources: list[Path], folder: Path, generate_s: float, outputs: int = 1, objects: tuple[Path, ...] = ()
) -> Built:
    """Compile C files and link them; sizes are those of all objects but the glue.

    gcc takes minutes for the if-else code of a forest, so libraries are kept in build/race/ under the hash of their
    sources, with the seconds that they took then.
    """
    content = b"".join(path.read_bytes() for path in (*sources, *objects))
    kept = CACHE / hashlib.sha256(" ".join(GCC).encode() + content).hexdigest()[:24]
    stopped = kept.with_suffix(".stopped")
    if stopped.is_file() and float(stopped.read_text()) >= COMPILE_LIMIT:
        raise TooSlowError(f"gcc was stopped after {float(stopped.read_text()):.0f} s")
    if not kept.is_dir():
        CACHE.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        made = list(objects)
        for source in sources:
            target = source.with_suffix(".o")
            try:
                _gcc([*GCC, "-c", str(source), "-o", str(target)])
            except subprocess.TimeoutExpired:
                stopped.write_text(str(COMPILE_LIMIT))
                raise TooSlowError(f"gcc was stopped after {COMPILE_LIMIT:.0f} s") from None
            made.append(target)
        library = folder / "race.so"
        subprocess.run(["gcc", "-shared", "-o", library, *made, "-lm", "-ldl"], check=True, capture_output=True)
        seconds = time.perf_counter() - start
        code, data = sizes([target for target in made if target.stem != "glue"])
        partial = folder / "kept"
        partial.mkdir()
        shutil.copy(library, partial / "race.so")
        (partial / "meta.json").write_text(json.dumps({"compile_s": seconds, "code_bytes": code, "data_bytes": data}))
        shutil.move(partial, kept)
    meta = json.loads((kept / "meta.json").read_text())
    return Built(generate_s, library=kept / "race.so", outputs=outputs, **meta)


def _gcc(command: list[str]) -> None:
    """Run gcc; when it takes too long, end it with the compiler proper that it started."""
    with subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True) as process:
        try:
            _, errors = process.communicate(timeout=COMPILE_LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command, stderr=errors)


def sizes(objects: list[Path]) -> tuple[int, int]:
    """Bytes of code and of data in object files."""
    code = data = 0
    for target in objects:
        text = subprocess.run(["size", "-A", target], check=True, capture_output=True, text=True).stdout
        for section, size in re.findall(r"^(\.[\w.]+)\s+(\d+)", text, re.M):
            if section.startswith((".text", ".ltext")):
                code += int(size)
            elif section.startswith((".rodata", ".data", ".bss", ".lrodata", ".ldata")):
                data += int(size)
    return code, data


# --- ours ---


def bundle_of(case: Case) -> Any:
    from st_codegen.passes.domain import limit_inputs
    from st_codegen.passes.outputs import with_outputs
    from st_codegen.project.bundle import Bundle
    from st_codegen.walkers.base import LoadedModel
    from st_codegen.walkers.objects import from_estimator

    loaded = from_estimator(case.estimator, "model")
    ir, columns = with_outputs(loaded.ir, ())
    return Bundle((LoadedModel(limit_inputs(ir), lambda x: loaded.predict(x)[:, columns]),), None)


def st_codegen(case: Case, folder: Path, **options: Any) -> Built:
    """Our text, through the translator."""
    from benchmarks.bound import expected
    from benchmarks.st_to_c import ports, translate
    from st_codegen.cost.profile import load_profile
    from st_codegen.cost.report import project_cost
    from st_codegen.driver import generate
    from st_codegen.emit.targets import TARGETS
    from st_codegen.st import load_project

    start = time.perf_counter()
    bundle = bundle_of(case)
    generated = generate(bundle, TARGETS["twincat"], folder / "st", **options)
    seconds = time.perf_counter() - start
    project = load_project([generated.folder], "twincat")
    source = folder / "model.c"
    source.write_text(translate(project, "FB_Model", "race"))
    built = compiled([source], folder, seconds, ports(project, "FB_Model")[1])
    cost = project_cost(project, load_profile(), ["FB_Model"])
    layout = generated.compiled.decisions[0].chosen
    most = expected(cost.blocks["FB_Model"].operations, sum(ports(project, "FB_Model")))
    return dataclasses.replace(built, note=f"{layout}; worst case on cx5140: {estimate(cost)}", expected_most=most)


def estimate(cost: Any) -> str:
    """The modelled worst case in words."""
    loops = ", loops without a bound" if cost.unbounded else ""
    return f"{cost.warm_us:.1f} us warm, {cost.cold_us:.1f} us cold{loops}"


# --- peers that generate code ---

#: Peers give scores or probabilities; the glue makes the number of the class of them, as the libraries do.
_LARGEST = """
static double answer(const %(kind)s *r)
{
    int best = 0;
    for (int i = 1; i < %(count)d; i++) if (r[i] > r[best]) best = i;
    return %(count)d > 1 ? best : r[0];
}
"""
#: m2cgen gives the scores of the pairs of a support vector machine.
_VOTES = """
static double answer(const double *r)
{
    int votes[%(count)d] = {0}, best = 0;
    for (int i = 0; i < %(count)d; i++) for (int k = i + 1; k < %(count)d; k++) votes[*r++ > 0 ? i : k]++;
    for (int i = 1; i < %(count)d; i++) if (votes[i] > votes[best]) best = i;
    return best;
}
"""


def _answer(case: Case, kind: str = "double", text: str = _LARGEST) -> str:
    """C that makes the answer `answer(r)` of what a peer computes."""
    return text % {"kind": kind, "count": case.scores}


def m2cgen(case: Case, folder: Path) -> Built:
    import m2cgen as peer

    sys.setrecursionlimit(100_000)
    start = time.perf_counter()
    text = peer.export_to_c(case.estimator)
    seconds = time.perf_counter() - start
    source = folder / "model.c"
    if case.scores == 1:
        glue = "\nvoid race(const double *x, double *y) { y[0] = score((double *)x); }\n"
    else:
        glue = _answer(case, text=_VOTES if hasattr(case.estimator, "support_vectors_") else _LARGEST)
        glue += f"void race(const double *x, double *y) {{ double r[{case.scores**2}]; "
        glue += "score((double *)x, r); y[0] = answer(r); }\n"
    source.write_text(text + glue)
    return compiled([source], folder, seconds)


def tl2cgen(case: Case, folder: Path) -> Built:
    import tl2cgen as peer
    import treelite

    start = time.perf_counter()
    if case.library == "lightgbm":
        model = treelite.frontend.from_lightgbm(case.estimator.booster_)
    elif case.library == "xgboost":
        model = treelite.frontend.from_xgboost(case.estimator.get_booster())
    else:
        model = treelite.sklearn.import_model(case.estimator)
    peer.generate_c_code(model, dirpath=str(folder / "c"), params={})
    seconds = time.perf_counter() - start
    header = (folder / "c" / "header.h").read_text()
    kind = re.search(r"(float|double) fvalue", header)[1]
    result = re.search(r"void predict\(union Entry\* data, int pred_margin, (float|double)\* result", header)[1]
    features = case.rows.shape[1]
    glue = folder / "c" / "glue.c"
    glue.write_text(
        f'#include "header.h"\n{_answer(case, result)}'
        f"void race(const double *x, double *y)\n{{\n    union Entry e[{features}];\n"
        f"    {result} r[{case.scores}] = {{0}};\n"
        f"    for (int i = 0; i < {features}; i++) e[i].fvalue = ({kind})x[i];\n"
        "    predict(e, 0, r);\n    y[0] = answer(r);\n}\n"
    )
    sources = sorted((folder / "c").glob("*.c"))
    return compiled(sources, folder, seconds)


#: lleaves needs an llvmlite from before the one that we use: both stand in a folder of their own, see the Makefile.
OLD_PACKAGES = Path(sys.prefix) / "lleaves"
_LLEAVES = """
import sys
sys.path.insert(0, sys.argv[1])
import lleaves
lleaves.Model(sys.argv[2]).compile(cache=sys.argv[3])
"""


def lleaves(case: Case, folder: Path) -> Built:
    if case.library != "lightgbm":
        raise NotImplementedError("LightGBM models only")
    start = time.perf_counter()
    text = folder / "model.txt"
    case.estimator.booster_.save_model(text)
    generated = time.perf_counter()
    kept = CACHE / f"lleaves-{hashlib.sha256(text.read_bytes()).hexdigest()[:24]}"
    target, took = kept / "forest.o", kept / "compile_s"
    if not took.is_file():
        kept.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, "-c", _LLEAVES, OLD_PACKAGES, text, target], check=True)
        took.write_text(str(time.perf_counter() - generated))
    seconds = float(took.read_text())
    glue = folder / "glue.c"
    glue.write_text(
        f"void forest_root(double *, double *, int, int);\n{_answer(case)}"
        f"void race(const double *x, double *y) {{ double r[{case.scores}]; forest_root((double *)x, r, 0, 1); "
        "y[0] = answer(r); }\n"
    )
    built = compiled([glue], folder, generated - start, objects=(target,))
    return dataclasses.replace(built, compile_s=seconds, note="compiled by LLVM with its own flags")


def emlearn(case: Case, folder: Path) -> Built:
    """Nested IFs that vote, with thresholds of six decimals: other classes than the library's in some rows."""
    import emlearn as peer

    if case.library != "sklearn" or case.scores == 1 or not hasattr(case.estimator, "estimators_"):
        raise NotImplementedError("forests of scikit-learn that give classes only")
    start = time.perf_counter()
    source = folder / "model.c"
    peer.convert(case.estimator, method="inline", dtype="float").save(file=str(source), name="forest", format="c")
    seconds = time.perf_counter() - start
    features = case.rows.shape[1]
    with source.open("a") as file:
        file.write(
            f"void race(const double *x, double *y)\n{{\n    float f[{features}];\n"
            f"    for (int i = 0; i < {features}; i++) f[i] = (float)x[i];\n"
            f"    y[0] = forest_predict(f, {features});\n}}\n"
        )
    return compiled([source], folder, seconds)


# --- libraries ---


_LIGHTGBM = """#include <dlfcn.h>
#include <stdlib.h>
%(answer)s
static void *fast; static int (*predict)(void *, const void *, long *, double *);
void race(const double *x, double *y)
{
    long n;
    double r[%(scores)d];
    if (!fast) {
        void *library = dlopen("%(library)s", RTLD_NOW), *booster; int iterations;
        int (*create)(const char *, int *, void **) = dlsym(library, "LGBM_BoosterCreateFromModelfile");
        int (*init)(void *, int, int, int, int, int, const char *, void **) =
            dlsym(library, "LGBM_BoosterPredictForMatSingleRowFastInit");
        predict = dlsym(library, "LGBM_BoosterPredictForMatSingleRowFast");
        if (create("%(model)s", &iterations, &booster)) abort();
        if (init(booster, 0, 0, -1, 1, %(features)d, "num_threads=1", &fast)) abort();
    }
    predict(fast, x, &n, r);
    y[0] = answer(r);
}
"""

_XGBOOST = """#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
typedef unsigned long size;
static void *booster;
static int (*predict)(void *, const char *, const char *, void *, const size **, size *, const float **);
static const char *how = "{\\"type\\":0,\\"training\\":false,\\"iteration_begin\\":0,\\"iteration_end\\":0,"
    "\\"strict_shape\\":false,\\"missing\\":NaN,\\"cache_id\\":0}";
static const char *rows = "{\\"data\\":[%%lu,true],\\"shape\\":[1,%(features)d],"
    "\\"typestr\\":\\"<f8\\",\\"version\\":3}";
void race(const double *x, double *y)
{
    char values[200];
    const size *shape;
    size n;
    const float *result;
    if (!booster) {
        void *library = dlopen("%(library)s", RTLD_NOW);
        int (*create)(void *, size, void **) = dlsym(library, "XGBoosterCreate");
        int (*load)(void *, const char *) = dlsym(library, "XGBoosterLoadModel");
        int (*set)(void *, const char *, const char *) = dlsym(library, "XGBoosterSetParam");
        predict = dlsym(library, "XGBoosterPredictFromDense");
        if (create(0, 0, &booster) || load(booster, "%(model)s") || set(booster, "nthread", "1")) abort();
    }
    snprintf(values, sizeof values, rows, (size)x);
    if (predict(booster, values, how, 0, &shape, &n, &result)) abort();
    y[0] = result[0];
}
"""


def library(case: Case, folder: Path) -> Built:
    """The library itself: by its C interface where it has one, else from Python."""
    start = time.perf_counter()
    features = case.rows.shape[1]
    if case.library not in ("lightgbm", "xgboost"):
        return Built(time.perf_counter() - start, call=case.estimator.predict, note="called from Python")
    if case.library == "lightgbm":
        import lightgbm as module

        model = folder / "model.txt"
        case.estimator.booster_.save_model(model)
        text, name = _LIGHTGBM, "lib_lightgbm.so"
    else:
        import xgboost as module

        model = folder / "model.json"
        case.estimator.get_booster().save_model(model)
        text, name = _XGBOOST, "libxgboost.so"
    (found,) = Path(module.__file__).parent.rglob(name)
    glue = folder / "glue.c"
    glue.write_text(
        text % {"library": found, "model": model, "features": features, "scores": case.scores, "answer": _answer(case)}
    )
    built = compiled([glue], folder, time.perf_counter() - start)
    return dataclasses.replace(built, code_bytes=None, data_bytes=None, note="C interface")


def onnx_runtime(case: Case, _: Path) -> Built:
    import onnxruntime

    start = time.perf_counter()
    features = case.rows.shape[1]
    if case.library == "lightgbm":
        from onnxmltools import convert_lightgbm as convert
        from onnxmltools.convert.common.data_types import FloatTensorType
    elif case.library == "xgboost":
        from onnxmltools import convert_xgboost as convert
        from onnxmltools.convert.common.data_types import FloatTensorType
    else:
        from skl2onnx import convert_sklearn as convert
        from skl2onnx.common.data_types import FloatTensorType
    model = convert(case.estimator, initial_types=[("x", FloatTensorType([None, features]))])
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])

    def call(row: np.ndarray) -> np.ndarray:
        return session.run(None, {"x": row.astype(np.float32)})[0]

    return Built(time.perf_counter() - start, call=call, note="called from Python")


PEERS: dict[str, Callable[[Case, Path], Built]] = {
    "m2cgen": m2cgen,
    "tl2cgen": tl2cgen,
    "lleaves": lleaves,
    "emlearn": emlearn,
    "ONNX Runtime": onnx_runtime,
    "library": library,
}

#: Those that wait for a compiler
COMPILED_PEERS = (m2cgen, tl2cgen, lleaves, emlearn)
