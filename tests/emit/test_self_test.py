"""FB_SelfTest finds nothing where arithmetic is right, and each fault that is switched on, without a trap."""

import platform
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import joblib
import pytest
from sklearn.linear_model import LinearRegression

from benchmarks.st_to_c import translate
from st_codegen.driver import generate
from st_codegen.emit.blocks.self_test import FAULTS, SELF_TEST
from st_codegen.emit.contents import Contents
from st_codegen.emit.render import render
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.st import Machine, load_project

BITS = {name: 1 << bit for bit, (name, _) in enumerate(FAULTS)}
IS_X86 = platform.machine() in ("x86_64", "AMD64")
#: As a compiler of a controller should: what the text says, in the order of the text.
STRICT = ("-O2", "-ffp-contract=off")
MAIN = """
#include <fenv.h>
#include <stdio.h>
#ifdef FLUSH
#include <immintrin.h>
#endif
int main(void)
{
    double y[3] = {0.0, 0.0, 0.0};
#ifdef FLUSH
    _mm_setcsr(_mm_getcsr() | FLUSH);
#endif
#ifdef ROUNDING
    fesetround(ROUNDING);
#endif
    feclearexcept(FE_ALL_EXCEPT);
    self_test(0, y);
    int traps = fetestexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
    self_test(0, y);
    printf("%d %d %d %d\\n", (int)y[0], (int)y[1], (int)y[2], traps);
    return 0;
}
"""
#: What a fault does to the C, by the assumption that it breaks.
FLAGS = [
    ("CONTRACTION", (*STRICT, "-mfma", "-ffp-contract=fast")),
    ("EXTENDED", (*STRICT, "-mfpmath=387")),
    ("EXTENDED", (*STRICT, "-mfpmath=387", "-ffloat-store")),
    ("EXTENDED", ("-O0", "-ffp-contract=off", "-mfpmath=387")),
    ("DENORMAL", (*STRICT, "-DFLUSH=0x8000")),  # results
    ("DENORMAL", (*STRICT, "-DFLUSH=0x0040")),  # operands
    ("ROUNDING", (*STRICT, "-frounding-math", "-DROUNDING=FE_UPWARD")),
    ("ROUNDING", (*STRICT, "-frounding-math", "-DROUNDING=FE_DOWNWARD")),
    ("ROUNDING", (*STRICT, "-frounding-math", "-DROUNDING=FE_TOWARDZERO")),
    ("ORDER", (*STRICT, "-ffast-math")),
    ("ORDER", (*STRICT, "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math")),
    ("ORDER", (*STRICT, "-freciprocal-math")),
    ("LREAL", (*STRICT, "-fsingle-precision-constant")),
]
#: What a fault does to the translated text.
CHANGES = [
    ("LOOP", r"<= 4;", "< 4;"),
    ("LOOP", r"<= stop1;", "< stop1;"),  # the loop of one round runs none
    ("LOOP", r"for \((.*) = 1; (.*) <= stop2; (.*)\)", r"for (\1 = 1; \2 <= stop2 + 1; \3)"),  # that of none runs one
    ("LOOP", r"\+= 4\)", "+= 1)"),
    ("INTEGER", r"\(int32_t\)\((\(self->FONE \+ 0x1.0000000000000p-1\))\)", r"(int32_t)llrint(\1)"),
    ("INTEGER", r"\(double\)\((self->NMANY)\)", r"(double)(float)(\1)"),
    ("INTEGER", r"% 4", "/ 4"),
    ("ROUNDING", r"\(float\)", "(float)0.9999999 * (float)"),
]


@cache
def text(target):
    """The files of a project without models: FB_SelfTest and what it needs."""
    return {file.path: "".join(file.pieces) for file in render(Contents(()), TARGETS[target])}


@pytest.fixture(scope="module")
def c_code(tmp_path_factory):
    folder = tmp_path_factory.mktemp("text")
    (path,) = text("iec")
    (folder / path).write_text(text("iec")[path], encoding="utf-8")
    return translate(load_project([folder / path], "iec"), SELF_TEST, "self_test")


def run(folder, code, flags):
    """bPassed, nFaults and the traps of the program; skips where this machine cannot build or run it."""
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc: apt-get install gcc")
    if not IS_X86 and any(flag.startswith(("-m", "-DFLUSH")) for flag in flags):
        pytest.skip(f"{flags}: for processors of the x86 family")
    if "-mfma" in flags and not re.search(r"\bfma\b", Path("/proc/cpuinfo").read_text(encoding="utf-8")):
        pytest.skip("this processor has no fused multiply-add")
    (folder / "test.c").write_text(code + MAIN, encoding="utf-8")
    program = folder / "test"
    subprocess.run(["gcc", "-w", "-fwrapv", *flags, "-o", program, folder / "test.c", "-lm"], check=True)
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    finished, *results = map(int, done.stdout.split())
    assert finished == 1
    return results


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_nothing_is_found_in_the_engine(target, tmp_path):
    files = {path: content for path, content in text(target).items() if SELF_TEST in path}
    (content,) = files.values()
    path = tmp_path / ("block.st" if target == "iec" else "block.TcPOU")
    path.write_text(content, encoding="utf-8")
    machine = Machine(load_project([path], target), 1)
    block = machine.instance(SELF_TEST)
    assert not block["bPassed"]
    for _ in range(3):
        block()
        assert (block["bDone"], block["bPassed"], block["nFaults"]) == (True, True, 0)


@pytest.mark.parametrize("flags", [STRICT, ("-O0", "-ffp-contract=off"), ("-O3", "-ffp-contract=off")])
def test_nothing_is_found_where_a_compiler_keeps_to_the_text(flags, c_code, tmp_path):
    assert run(tmp_path, c_code, flags) == [1, 0, 0]


@pytest.mark.parametrize(("fault", "flags"), FLAGS)
def test_arithmetic_that_differs_is_found_without_a_trap(fault, flags, c_code, tmp_path):
    passed, faults, traps = run(tmp_path, c_code, flags)
    assert not passed
    assert faults & BITS[fault]
    assert not traps


@pytest.mark.parametrize(("fault", "pattern", "replacement"), CHANGES)
def test_loops_and_conversions_that_differ_are_found(fault, pattern, replacement, c_code, tmp_path):
    changed = re.sub(pattern, replacement, c_code)
    assert changed != c_code
    assert run(tmp_path, changed, STRICT) == [0, BITS[fault], 0]


def test_an_lreal_of_32_bits_is_found(c_code, tmp_path):
    narrow = c_code.replace("double", "float").replace("(const float *x, float *y)", "(const double *x, double *y)")
    passed, faults, traps = run(tmp_path, narrow, STRICT)
    assert (passed, traps) == (0, 0)
    assert faults & BITS["LREAL"]


def test_no_model_takes_the_place_of_the_block_that_tests_the_controller(tmp_path):
    model = LinearRegression().fit([[0.0], [1.0]], [0.0, 1.0])
    joblib.dump(model, tmp_path / "selftest.joblib")
    bundle = load(tmp_path / "selftest.joblib", trust_pickle=True)
    with pytest.raises(
        InputError, match=r"model 'selftest': FB_SelfTest is the name of the block .*: rename the model"
    ):
        generate(bundle, "twincat", tmp_path / "out")
    assert not (tmp_path / "out").exists()
