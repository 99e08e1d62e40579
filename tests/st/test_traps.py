"""Everything that stops a controller stops the engine: each trap at its edge, and one step before it."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest

from st_codegen.st import Machine, StRuntimeError, StUsageError
from tests.st.helpers import block, fault, problems, project, run, value

SMALL = {"SINT": 8, "INT": 16, "DINT": 32, "USINT": 8, "UINT": 16, "UDINT": 32}
SIGNALLING = struct.unpack("<d", struct.pack("<Q", 0x7FF0000000000001))[0]
TINY = 5e-324


def bounds(name: str) -> tuple[int, int]:
    bits = SMALL[name]
    return (0, 2**bits - 1) if name[0] == "U" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def stopped(expression: str, type_: str, dialect: str = "twincat", **given: tuple[str, Any]) -> StRuntimeError:
    with pytest.raises(StRuntimeError) as caught:
        value(expression, type_, dialect, **given)
    return caught.value


# --- integers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SMALL)
def test_intermediate_sums_differences_and_products_above_and_below(name: str) -> None:
    low, high = bounds(name)
    one = (name, 1)
    for expression, a, b, is_stopped in (
        ("a + b", high, 1, True),
        ("a + b", high - 1, 1, False),
        ("a - b", low, 1, True),
        ("a - b", low + 1, 1, False),
        ("a * b", high // 2 + 1, 2, True),
        ("a * b", high // 2, 2, False),
    ):
        given = {"a": (name, a), "b": (name, b), "c": one}
        if is_stopped:
            error = stopped(f"({expression}) > c", "BOOL", **given)
            assert (error.kind, error.operands) == ("integer overflow", (a, b))
        else:
            assert value(f"({expression}) > c", "BOOL", **given) is (eval(expression, {}, {"a": a, "b": b}) > 1)
    if low < 0:
        for a, b in ((low, 1), (-1, high)):
            assert fault("(a + d) < c", "BOOL", a=(name, a), d=(name, low), c=one) == "integer overflow"
            assert isinstance(value("(a + b) < c", "BOOL", a=(name, a), b=(name, b), c=one), bool)
        assert fault("(a * b) < c", "BOOL", a=(name, low // 2 - 1), b=(name, 2), c=one) == "integer overflow"
        assert value("(a * b) < c", "BOOL", a=(name, low // 2), b=(name, 2), c=one) is True
        assert stopped("(-a) > c", "BOOL", a=(name, low), c=one).operands == (0, low)
        assert value("(-a) > c", "BOOL", a=(name, low + 1), c=one) is True
        assert stopped("ABS(a)", name, a=(name, low)).operands == (low,)
        assert value("ABS(a)", name, a=(name, low + 1)) == high
    else:
        assert fault("(-a) > c", "BOOL", a=(name, 1), c=one) == "integer overflow"


def test_stored_results_wrap_instead() -> None:
    for name in SMALL:
        low, high = bounds(name)
        assert value("a + b", name, a=(name, high), b=(name, 1)) == low
        assert value("a - b", name, a=(name, low), b=(name, 1)) == high


def test_durations() -> None:
    error = stopped("(a - b) > T#0ms", "BOOL", a=("TIME", 1), b=("TIME", 2))
    assert (error.kind, error.operands) == ("integer overflow", (1, 2))
    assert fault("(a * n) > T#0ms", "BOOL", a=("TIME", 1), n=("DINT", -1)) == "integer overflow"
    assert fault("a / n", "TIME", a=("TIME", 1), n=("DINT", -1)) == "integer overflow"
    assert fault("a / n", "TIME", a=("TIME", 1), n=("DINT", 0)) == "division by zero"


@pytest.mark.parametrize("name", [*SMALL, "LINT", "ULINT"])
@pytest.mark.parametrize("operator", ["/", "MOD"])
def test_integer_division(name: str, operator: str) -> None:
    error = stopped(f"a {operator} b", name, a=(name, 7), b=(name, 0))
    assert (error.kind, error.operands) == ("division by zero", (7, 0))
    if name[0] != "U":
        low = -(2**63) if name == "LINT" else bounds(name)[0]
        assert stopped(f"a {operator} b", name, a=(name, low), b=(name, -1)).operands == (low, -1)
        assert value(f"a {operator} b", name, a=(name, low + 1), b=(name, -1)) == (0 if operator == "MOD" else -low - 1)


@pytest.mark.parametrize("name", ["BYTE", "WORD", "DWORD", "LWORD"])
def test_shifts(name: str) -> None:
    bits = {"BYTE": 8, "WORD": 16, "DWORD": 32, "LWORD": 64}[name]
    for function in ("SHL", "SHR"):
        for n in (bits, -1):
            error = stopped(f"{function}(a, n)", name, a=(name, 1), n=("DINT", n))
            assert (error.kind, error.operands) == ("shift out of range", (1, n))
        assert value(f"{function}(a, n)", name, a=(name, 1), n=("DINT", bits - 1)) in (0, 1 << (bits - 1))
    for function in ("ROL", "ROR"):
        assert fault(f"{function}(a, n)", name, a=(name, 1), n=("DINT", -1)) == "shift out of range"
        assert value(f"{function}(a, n)", name, a=(name, 1), n=("DINT", bits)) == 1


# --- indices, loops, references ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [-2, 4])
@pytest.mark.parametrize("place", ["x := t[n];", "t[n] := x;", "x := T2[n];", "x := s[n].f;", "FC(t[n]);"])
def test_indices(index: int, place: str) -> None:
    before = (
        "TYPE S : STRUCT f : LREAL; END_STRUCT END_TYPE FUNCTION FC VAR_IN_OUT io : LREAL; END_VAR io := 1.0; "
        "END_FUNCTION"
    )
    tables = (
        "x : LREAL; t : ARRAY[-1..3] OF LREAL; s : ARRAY[-1..3] OF S; END_VAR "
        "VAR CONSTANT T2 : ARRAY[-1..3] OF LREAL := [1.0, 2.0, 3.0, 4.0, 5.0];"
    )
    text = block(place, tables, before, "n : DINT;")
    for inside in (-1, 3):
        run(text, "x", n=inside)
    with pytest.raises(StRuntimeError, match=rf"{index} is outside of -1\.\.3") as caught:
        run(text, "x", n=index)
    assert (caught.value.kind, caught.value.operands) == ("index out of range", (index,))


@pytest.mark.parametrize(("i", "j"), [(0, 2), (0, 5), (3, 3), (-1, 4)])
def test_each_index_of_several(i: int, j: int) -> None:
    text = block("x := t[i, j];", "x : DINT; t : ARRAY[0..2, 3..4] OF DINT;", inputs="i : INT; j : ULINT;")
    with pytest.raises(StRuntimeError) as caught:
        run(text, "x", i=i, j=j)
    assert caught.value.operands == ((i,) if not 0 <= i <= 2 else (j,))


def test_a_large_unsigned_index_is_not_a_small_negative_one() -> None:
    text = block("x := t[n];", "x : DINT; t : ARRAY[-1..1] OF DINT;", inputs="n : UDINT;")
    with pytest.raises(StRuntimeError, match=r"4294967295 is outside of -1\.\.1"):
        run(text, "x", n=2**32 - 1)


def test_mux() -> None:
    for k in (-1, 2):
        error = stopped("MUX(k, 1, 2)", "DINT", k=("SINT", k))
        assert (error.kind, error.detail) == ("index out of range", f"MUX has no input {k}")
    assert value("MUX(k, 10, 20)", "DINT", k=("SINT", 1)) == 20


@pytest.mark.parametrize(
    "loop",
    [
        "WHILE n < 1000 DO n := n + 1; END_WHILE;",
        "REPEAT n := n + 1; UNTIL n >= 1000 END_REPEAT;",
        "FOR i := 1 TO m DO n := n + 1; END_FOR;",
        "FOR i := m TO 1 BY -1 DO n := n + 1; END_FOR;",
        "FOR i := 1 TO 1000 DO n := n + 1; END_FOR;",
    ],
)
def test_rounds_of_loops(loop: str) -> None:
    text = block("n := 0;\n" + loop, "n : DINT; i : DINT; m : DINT := 1000;")
    for limit, is_stopped in ((1000, False), (999, True)):
        instance = Machine(project(text), loop_limit=limit).instance("FB_T")
        if not is_stopped:
            instance()
            assert instance["n"] == 1000
            continue
        with pytest.raises(StRuntimeError) as caught:
            instance()
        error = caught.value
        assert (error.kind, error.operands, error.position.line) == ("loop limit", (999,), 5)


@pytest.mark.parametrize(("bounds_", "type_"), [("0 TO 255", "USINT"), ("127 TO -128 BY -1", "SINT")])
def test_a_counter_that_wraps_never_ends(bounds_: str, type_: str) -> None:
    with pytest.raises(StRuntimeError, match="loop limit"):
        run(block(f"FOR i := {bounds_} DO ; END_FOR;", f"i : {type_};"), "i")


def test_steps() -> None:
    text = block("FOR i := 1 TO 3 BY n DO ; END_FOR;", "i : INT;", inputs="n : INT;")
    assert run(text, "i", n=2) == 5
    with pytest.raises(StRuntimeError) as caught:
        run(text, "i", n=0)
    assert (caught.value.kind, caught.value.operands) == ("step of zero", (0,))


def test_a_reference_is_used_by_the_text_alone() -> None:
    before = "FUNCTION_BLOCK FB_R VAR_IN_OUT io : DINT; END_VAR io := io + 1; END_FUNCTION_BLOCK"
    instance = Machine(project(block("fb(io := n);", "fb : FB_R; n : DINT := 4;", before))).instance("FB_T")
    instance()
    assert instance["n"] == 5
    with pytest.raises(StUsageError, match="'io' is a VAR_IN_OUT: name the variable that it refers to"):
        instance["fb.io"]
    for body in ("x := fb.io;", "fb.io := 3;"):
        (problem,) = problems(block(body, "fb : FB_R; x : DINT;", before))
        assert "VAR_IN_OUT and cannot be read from outside" in problem


# --- real numbers -----------------------------------------------------------------------------------------------------

LARGE = {"LREAL": float(np.finfo(np.float64).max), "REAL": float(np.finfo(np.float32).max)}


@pytest.mark.parametrize("name", LARGE)
@pytest.mark.parametrize(
    ("operator", "a", "b", "kind"),
    [
        ("+", "large", "large", "overflow"),
        ("-", "-large", "large", "overflow"),
        ("*", "large", "2", "overflow"),
        ("/", "large", "0.5", "overflow"),
        ("/", "1", "0", "division by zero"),
        ("/", "0", "-0.0", "division by zero"),
        ("/", "large", "0", "division by zero"),
        ("+", "inf", "-inf", "invalid operation"),
        ("-", "inf", "inf", "invalid operation"),
        ("*", "0", "inf", "invalid operation"),
        ("/", "inf", "-inf", "invalid operation"),
        ("+", "large", "0", ""),
        ("*", "large", "1", ""),
        ("-", "inf", "large", ""),
        ("/", "inf", "0", ""),
        ("/", "large", "inf", ""),
        ("*", "nan", "inf", ""),
        ("/", "nan", "0", ""),
    ],
)
def test_real_arithmetic(name: str, operator: str, a: str, b: str, kind: str) -> None:
    known = {"large": LARGE[name], "inf": math.inf, "nan": math.nan}
    x, y = (float(eval(text, {}, known)) for text in (a, b))
    if kind:
        error = stopped(f"a {operator} b", name, a=(name, x), b=(name, y))
        assert (error.kind, error.operands) == (kind, (x, y))
    else:
        value(f"a {operator} b", name, a=(name, x), b=(name, y))


def test_underflow_to_zero_is_no_trap() -> None:
    assert value("a * b", "LREAL", a=("LREAL", TINY), b=("LREAL", 0.5)) == 0.0
    assert value("a / b", "REAL", a=("REAL", 1e-45), b=("REAL", 4.0)) == 0.0


@pytest.mark.parametrize("operator", ["+", "-", "*", "/"])
def test_signalling_nan(operator: str) -> None:
    for a, b in ((SIGNALLING, 1.0), (1.0, SIGNALLING), (math.nan, SIGNALLING)):
        assert fault(f"a {operator} b", "LREAL", a=("LREAL", a), b=("LREAL", b)) == "invalid operation"
    assert math.isnan(value(f"a {operator} b", "LREAL", a=("LREAL", math.nan), b=("LREAL", 1.0)))


@pytest.mark.parametrize("name", ["LREAL", "REAL"])
@pytest.mark.parametrize("operator", ["=", "<>", "<", "<=", ">", ">="])
def test_comparisons_with_nan(name: str, operator: str) -> None:
    for a, b in ((math.nan, 1.0), (1.0, math.nan)):
        error = stopped(f"a {operator} b", "BOOL", a=(name, a), b=(name, b))
        assert error.kind == "comparison with NaN"
    assert fault(f"a {operator} 1.0", "BOOL", a=("LREAL", math.nan)) == "comparison with NaN"
    for function in ("MIN(a, b)", "MAX(b, a)", "LIMIT(a, b, 2.0)", "LIMIT(0.0, a, b)", "LIMIT(0.0, b, a)"):
        assert fault(function, "LREAL", a=("LREAL", math.nan), b=("LREAL", 1.0)) == "comparison with NaN"


def test_the_portable_test_for_nan_is_allowed_in_portable_text_only() -> None:
    test = "a < 1.0 OR a > -1.0"
    assert value(test, "BOOL", "iec", a=("LREAL", math.nan)) is False
    for number in (math.inf, -math.inf, 0.0, 1.0, -1.0):
        assert value(test, "BOOL", "iec", a=("LREAL", number)) is True
    assert fault(test, "BOOL", "twincat", a=("LREAL", math.nan)) == "comparison with NaN"
    for other in ("a = a", "a <> a", "a < 1.0", "a < 1.0 AND a > -1.0"):
        assert fault(other, "BOOL", "iec", a=("LREAL", math.nan)) == "comparison with NaN"


LIMIT = 709.782712893384
DOMAINS = [
    ("SQRT", -TINY, "invalid operation", -0.0),
    ("LN", 0.0, "invalid operation", TINY),
    ("LN", -1.0, "invalid operation", math.inf),
    ("LOG", 0.0, "invalid operation", TINY),
    ("EXP", math.nextafter(LIMIT, 800), "overflow", LIMIT),
    ("EXP", 1e308, "overflow", math.inf),
    ("SIN", math.inf, "invalid operation", 1e308),
    ("COS", -math.inf, "invalid operation", -1e308),
    ("TAN", math.inf, "invalid operation", 1e308),
    ("ASIN", math.nextafter(1, 2), "invalid operation", 1.0),
    ("ACOS", math.nextafter(-1, -2), "invalid operation", -1.0),
]


@pytest.mark.parametrize(("name", "outside", "kind", "inside"), DOMAINS)
def test_domains_of_functions(name: str, outside: float, kind: str, inside: float) -> None:
    error = stopped(f"{name}(a)", "LREAL", a=("LREAL", outside))
    assert (error.kind, error.operands) == (kind, (outside,))
    value(f"{name}(a)", "LREAL", a=("LREAL", inside))
    assert math.isnan(value(f"{name}(a)", "LREAL", a=("LREAL", math.nan)))
    assert fault(f"{name}(a)", "LREAL", a=("LREAL", SIGNALLING)) == "invalid operation"


@pytest.mark.parametrize(
    ("x", "y", "kind"),
    [
        (0.0, -1.0, "division by zero"),
        (-0.0, -0.5, "division by zero"),
        (-8.0, 1 / 3, "invalid operation"),
        (1e200, 2.0, "overflow"),
        (-1e200, 3.0, "overflow"),
        (1e-200, -2.0, "overflow"),
        (0.0, -math.inf, ""),
        (-math.inf, 0.5, ""),
        (math.inf, 2.0, ""),
        (-8.0, 3.0, ""),
        (0.0, 0.0, ""),
        (1e200, -2.0, ""),
    ],
)
def test_powers(x: float, y: float, kind: str) -> None:
    if kind:
        error = stopped("EXPT(x, y)", "LREAL", x=("LREAL", x), y=("LREAL", y))
        assert (error.kind, error.operands) == (kind, (x, y))
    else:
        assert value("EXPT(x, y)", "LREAL", x=("LREAL", x), y=("LREAL", y)) == x**y


def test_functions_of_real_overflow_when_rounded() -> None:
    error = stopped("EXP(a)", "REAL", a=("REAL", 89.0))
    assert (error.kind, error.operands) == ("overflow", (89.0,))
    assert value("EXP(a)", "REAL", a=("REAL", 88.0)) == float(np.float32(math.exp(88.0)))
    assert fault("EXPT(a, b)", "REAL", a=("REAL", 1e30), b=("REAL", 2.0)) == "overflow"


@pytest.mark.parametrize("name", [*SMALL, "LINT", "ULINT", "BYTE", "LWORD"])
def test_real_numbers_to_integers(name: str) -> None:
    bits = {"LINT": 64, "ULINT": 64, "BYTE": 8, "LWORD": 64}.get(name) or SMALL[name]
    is_signed = name in ("SINT", "INT", "DINT", "LINT")
    low, end = (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1)) if is_signed else (0.0, 2.0**bits)
    below = low - 0.75 if bits < 64 else math.nextafter(low, -math.inf) if is_signed else -0.75
    for bad in (end, end - 0.5 if bits < 64 else end, below, math.inf, -math.inf, math.nan):
        error = stopped(f"LREAL_TO_{name}(a)", name, a=("LREAL", bad))
        assert error.kind == "conversion out of range"
    largest = end - 0.75 if bits < 64 else math.nextafter(end, 0)
    assert value(f"LREAL_TO_{name}(a)", name, a=("LREAL", largest)) == round(largest)
    assert value(f"LREAL_TO_{name}(a)", name, a=("LREAL", low - 0.5 if bits < 64 else low)) == int(low)


def test_lreal_to_real_and_trunc() -> None:
    most = LARGE["REAL"]
    half = math.nextafter(most + 2.0**103, 0)  # rounds down to the largest REAL
    assert value("LREAL_TO_REAL(a)", "REAL", a=("LREAL", half)) == most
    for bad in (most + 2.0**103, math.inf, math.nan):
        assert fault("LREAL_TO_REAL(a)", "REAL", a=("LREAL", bad)) == "conversion out of range"
    for bad in (2.0**31, -(2.0**31) - 1, math.nan):
        assert fault("TRUNC(a)", "DINT", a=("LREAL", bad)) == "conversion out of range"
    assert value("TRUNC(a)", "DINT", a=("LREAL", 2.0**31 - 0.5)) == 2**31 - 1
    assert value("TRUNC(a)", "DINT", a=("LREAL", -(2.0**31) - 0.5)) == -(2**31)


def test_nothing_is_contracted_or_reordered() -> None:
    a, b = 1.0 + 2.0**-30, 1.0 - 2.0**-30
    assert value("a * b - 1.0", "LREAL", a=("LREAL", a), b=("LREAL", b)) == a * b - 1.0 == 0.0
    assert value("a + b + c", "LREAL", a=("LREAL", 1e16), b=("LREAL", 1.0), c=("LREAL", 1.0)) == 1e16
    rows = np.random.default_rng(0).normal(size=(7, 100))
    text = block(
        "s := 0.0; FOR i := 0 TO 99 DO s := s + t[i] * t[i]; END_FOR;",
        "s : LREAL; t : ARRAY[0..99] OF LREAL; i : DINT;",
    )
    instance = Machine(project(text), 7).instance("FB_T")
    instance["t"] = rows
    instance()
    expected = []
    for row in rows.tolist():
        total = 0.0
        for x in row:
            total += x * x
        expected.append(total)
    assert instance["s"].tolist() == expected


# --- rows -------------------------------------------------------------------------------------------------------------


def test_a_trap_that_nobody_reads_is_still_one() -> None:
    text = block("x := 1.0 / a; x := 2.0;", "x : LREAL;", inputs="a : LREAL;")
    assert run(text, "x", a=1.0) == 2.0
    with pytest.raises(StRuntimeError, match="division by zero"):
        run(text, "x", a=0.0)


def test_faults_in_called_units_have_their_own_places() -> None:
    before = "FUNCTION FC : LREAL VAR_INPUT a : LREAL; END_VAR\nFC := 1.0 / a;\nEND_FUNCTION\n"
    before += "FUNCTION_BLOCK FB_I VAR_INPUT a : LREAL; END_VAR VAR_OUTPUT o : LREAL; END_VAR\no := FC(a);\n"
    before += "END_FUNCTION_BLOCK\n"
    text = block("fb(a := a);", "fb : FB_I;", before, "a : LREAL;")
    with pytest.raises(StRuntimeError) as caught:
        run(text, "fb.o", a=0.0)
    assert (caught.value.position.line, caught.value.position.pou) == (2, "FC")


@pytest.mark.parametrize("type_", ["BOOL", "BYTE", "TIME", "STRING", "ARRAY[0..1] OF LREAL"])
def test_abs_takes_numbers_only(type_: str) -> None:
    name = "STRING(80)" if type_ == "STRING" else type_
    assert problems(block("x := ABS(a);", f"x : LREAL; a : {type_};")) == [f"no ABS of {name}"]
