from __future__ import annotations

import ctypes
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st import StRuntimeError
from st_codegen.st.check import arithmetic
from tests.examples import examples
from tests.st import functions
from tests.st.helpers import bits, block, fault, run, value

C_TYPES = {
    "SINT": ctypes.c_int8,
    "INT": ctypes.c_int16,
    "DINT": ctypes.c_int32,
    "LINT": ctypes.c_int64,
    "USINT": ctypes.c_uint8,
    "UINT": ctypes.c_uint16,
    "UDINT": ctypes.c_uint32,
    "ULINT": ctypes.c_uint64,
    "BYTE": ctypes.c_uint8,
    "WORD": ctypes.c_uint16,
    "DWORD": ctypes.c_uint32,
    "LWORD": ctypes.c_uint64,
}
INTEGERS = [name for name in C_TYPES if name.endswith("INT")]
BITS = [name for name in C_TYPES if not name.endswith("INT")]
SIZES = {name: 8 * ctypes.sizeof(c_type) for name, c_type in C_TYPES.items()}
INF, NAN = math.inf, math.nan
SIGNALLING = struct.unpack("<d", struct.pack("<Q", 0x7FF0000000000001))[0]
EXAMPLES = examples(25)


def bounds(name: str) -> tuple[int, int]:
    low = 0 if name[0] == "U" or name in BITS else -(1 << (SIZES[name] - 1))
    return low, low + (1 << SIZES[name]) - 1


def numbers(name: str) -> s.SearchStrategy[int]:
    low, high = bounds(name)
    near = s.sampled_from([low, low + 1, high, high - 1, 0, 1, 2, 7, 100])
    return s.one_of(near, s.integers(low, high))


# --- integers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", INTEGERS)
@EXAMPLES
@given(data=s.data())
def test_stored_sums_wrap_as_in_c(name: str, data: s.DataObject) -> None:
    a, b, c = (data.draw(numbers(name)) for _ in range(3))
    for operator, expected in (("+", a + b - c), ("-", a - b - c), ("*", a * b - c)):
        found = value(f"a {operator} b - c", name, a=(name, a), b=(name, b), c=(name, c))
        assert found == C_TYPES[name](expected).value


@pytest.mark.parametrize("name", INTEGERS)
@EXAMPLES
@given(data=s.data())
def test_division_cuts_towards_zero_and_the_remainder_has_the_sign_of_the_dividend(
    name: str, data: s.DataObject
) -> None:
    a, b = data.draw(numbers(name)), data.draw(numbers(name))
    given_ = {"a": (name, a), "b": (name, b)}
    low, high = bounds(name)
    if b == 0:
        assert fault("a / b", name, **given_) == fault("a MOD b", name, **given_) == "division by zero"
    elif (a, b) == (low, -1):
        assert fault("a / b", name, **given_) == fault("a MOD b", name, **given_) == "integer overflow"
    else:
        quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
        assert low <= quotient <= high
        assert value("a / b", name, **given_) == quotient
        assert value("a MOD b", name, **given_) == a - b * quotient


@pytest.mark.parametrize("name", INTEGERS)
def test_negation_of_the_smallest_value_wraps(name: str) -> None:
    low, _ = bounds(name)
    for number in (low, low + 1, 5):
        assert value("-a", name, a=(name, number)) == C_TYPES[name](-number).value


@pytest.mark.parametrize("name", ["SINT", "INT", "DINT", "UDINT", "USINT"])
def test_an_overflow_that_is_not_stored_depends_on_the_target_and_is_an_error(name: str) -> None:
    low, high = bounds(name)
    assert fault("(a + b) > b", "BOOL", a=(name, high), b=(name, 1)) == "integer overflow"
    assert fault("(a - b) < b", "BOOL", a=(name, low), b=(name, 1)) == "integer overflow"
    assert fault("(a * b) / b", name, a=(name, high), b=(name, 2)) == "integer overflow"
    assert value("(a - b) < a", "BOOL", a=(name, high), b=(name, 1)) is True
    if low:
        assert fault("ABS(a)", name, a=(name, low)) == "integer overflow"


def test_overflow_of_an_index_names_operands_and_position() -> None:
    text = block("x := t[a + b];", "x : DINT; t : ARRAY[0..1] OF DINT;", inputs="a : DINT; b : DINT;")
    with pytest.raises(StRuntimeError) as caught:
        run(text, "x", a=2**31 - 1, b=1)
    error = caught.value
    assert (error.kind, error.operands, error.row) == ("integer overflow", (2**31 - 1, 1), 0)
    assert str(error) == "t.st:5:10 (FB_T): integer overflow: operands 2147483647, 1, row 0"


def test_64_bits_wrap_everywhere() -> None:
    assert value("(a + b) < 0", "BOOL", a=("LINT", 2**63 - 1), b=("LINT", 1)) is True
    assert value("(a - b) > b", "BOOL", a=("ULINT", 0), b=("ULINT", 1)) is True


@pytest.mark.parametrize("source", [*C_TYPES])
@pytest.mark.parametrize("target", [*C_TYPES])
def test_conversions_between_integers_keep_the_low_bits(source: str, target: str) -> None:
    low, high = bounds(source)
    for number in (low, high, 1, high // 3):
        found = value(f"{source}_TO_{target}(a)" if source != target else "a", target, a=(source, number))
        assert found == C_TYPES[target](number).value


@pytest.mark.parametrize("name", BITS)
@EXAMPLES
@given(data=s.data())
def test_bit_operations(name: str, data: s.DataObject) -> None:
    a, b = data.draw(numbers(name)), data.draw(numbers(name))
    size = SIZES[name]
    n = data.draw(s.integers(0, size - 1))
    turns = data.draw(s.integers(0, 200))
    mask = (1 << size) - 1
    given_ = {"a": (name, a), "b": (name, b), "n": ("DINT", n), "turns": ("DINT", turns)}
    text = f"{a:0{size}b}"
    turn = turns % size
    expected = {
        "a AND b": a & b,
        "a OR b": a | b,
        "a XOR b": a ^ b,
        "NOT a": a ^ mask,
        "SHL(a, n)": (a << n) & mask,
        "SHR(a, n)": a >> n,
        "ROL(a, turns)": int(text[turn:] + text[:turn], 2),
        "ROR(a, turns)": int(text[size - turn :] + text[: size - turn], 2),
    }
    for expression, number in expected.items():
        assert value(expression, name, **given_) == number, expression


def test_shifts_beyond_the_width_depend_on_the_target_and_are_errors() -> None:
    for name in ("SHL", "SHR"):
        for n in (8, -1):
            assert fault(f"{name}(a, n)", "BYTE", a=("BYTE", 1), n=("INT", n)) == "shift out of range"
    assert fault("ROL(a, n)", "BYTE", a=("BYTE", 1), n=("INT", -1)) == "shift out of range"


def test_right_shift_of_signed_values_keeps_the_sign() -> None:
    assert value("SHR(a, 2)", "INT", a=("INT", -9)) == -9 >> 2
    assert value("SHL(a, 2)", "INT", a=("INT", -9)) == -36
    assert value("ROL(a, 4)", "INT", a=("INT", -2)) == C_TYPES["INT"](0xFFEF).value


# --- real numbers -----------------------------------------------------------------------------------------------------

REALS = s.floats(allow_nan=False, allow_infinity=False)


@EXAMPLES
@given(REALS, REALS)
def test_lreal_is_float64(a: float, b: float) -> None:
    for operator, function in (("+", np.add), ("-", np.subtract), ("*", np.multiply), ("/", np.divide)):
        with np.errstate(all="ignore"):
            expected = float(function(np.float64(a), np.float64(b)))
        given_ = {"a": ("LREAL", a), "b": ("LREAL", b)}
        if operator == "/" and b == 0:
            assert fault(f"a {operator} b", "LREAL", **given_) == "division by zero"
        elif math.isinf(expected):
            assert fault(f"a {operator} b", "LREAL", **given_) == "overflow"
        else:
            assert bits(value(f"a {operator} b", "LREAL", **given_)) == bits(expected)


@EXAMPLES
@given(
    s.floats(width=32, allow_nan=False, allow_infinity=False), s.floats(width=32, allow_nan=False, allow_infinity=False)
)
def test_real_rounds_to_float32_after_each_operation(a: float, b: float) -> None:
    for operator, function in (("+", np.add), ("-", np.subtract), ("*", np.multiply), ("/", np.divide)):
        with np.errstate(all="ignore"):
            expected = float(function(np.float32(a), np.float32(b)))
        given_ = {"a": ("REAL", a), "b": ("REAL", b)}
        if operator == "/" and b == 0:
            assert fault(f"a {operator} b", "REAL", **given_) == "division by zero"
        elif math.isinf(expected):
            assert fault(f"a {operator} b", "REAL", **given_) == "overflow"
        else:
            assert bits(value(f"a {operator} b", "REAL", **given_)) == bits(expected)


@EXAMPLES
@given(REALS)
def test_lreal_to_real_rounds_to_nearest(a: float) -> None:
    with np.errstate(over="ignore"):
        expected = float(np.float32(a))
    if math.isinf(expected):
        assert fault("LREAL_TO_REAL(a)", "REAL", a=("LREAL", a)) == "conversion out of range"
    else:
        assert bits(value("LREAL_TO_REAL(a)", "REAL", a=("LREAL", a))) == bits(expected)


INTEGER_NAMES = s.sampled_from([*C_TYPES])


@examples()
@given(
    s.one_of(s.floats(), s.integers(-(2**65), 2**65).map(float), s.integers(-300, 300).map(lambda i: i / 2)),
    INTEGER_NAMES,
)
def test_real_to_integer_rounds_to_nearest_ties_to_even(a: float, name: str) -> None:
    low, high = bounds(name)
    expression = f"LREAL_TO_{name}(a)"
    if math.isfinite(a) and low <= round(a) <= high:
        assert value(expression, name, a=("LREAL", a)) == round(a)
    else:
        assert fault(expression, name, a=("LREAL", a)) == "conversion out of range"


@EXAMPLES
@given(s.one_of(s.floats(), s.floats(-3e9, 3e9)))
def test_trunc_cuts(a: float) -> None:
    if math.isfinite(a) and -(2**31) <= math.trunc(a) < 2**31:
        assert value("TRUNC(a)", "DINT", a=("LREAL", a)) == math.trunc(a)
    else:
        assert fault("TRUNC(a)", "DINT", a=("LREAL", a)) == "conversion out of range"


@pytest.mark.parametrize("name", [*C_TYPES])
@pytest.mark.parametrize("target", ["REAL", "LREAL"])
def test_integer_to_real_rounds_to_nearest(name: str, target: str) -> None:
    low, high = bounds(name)
    for number in (low, high, high - 1, 2**24 + 1 if high > 2**24 else 3):
        expected = float(np.float32(number)) if target == "REAL" else float(number)
        assert value(f"{name}_TO_{target}(a)", target, a=(name, number)) == expected


def test_conversions_of_bool() -> None:
    for name in ("DINT", "BYTE", "ULINT"):
        assert value(f"BOOL_TO_{name}(a)", name, a=("BOOL", True)) == 1
        assert value(f"{name}_TO_BOOL(a)", "BOOL", a=(name, 2)) is True
        assert value(f"{name}_TO_BOOL(a)", "BOOL", a=(name, 0)) is False
    assert value("BOOL_TO_LREAL(a)", "LREAL", a=("BOOL", True)) == 1.0
    assert value("LREAL_TO_BOOL(a)", "BOOL", a=("LREAL", 0.5)) is True


# --- floating point exceptions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expression", "a", "b", "kind"),
    [
        ("a / b", 1.0, 0.0, "division by zero"),
        ("a / b", 0.0, 0.0, "division by zero"),
        ("a / b", -1.0, -0.0, "division by zero"),
        ("a - b", INF, INF, "invalid operation"),
        ("a + b", INF, -INF, "invalid operation"),
        ("a * b", 0.0, INF, "invalid operation"),
        ("a / b", INF, INF, "invalid operation"),
        ("a + b", 1.7e308, 1.7e308, "overflow"),
        ("a - b", -1.7e308, 1.7e308, "overflow"),
        ("a * b", 1e200, 1e200, "overflow"),
        ("a / b", 1e200, 1e-200, "overflow"),
        ("a + b", SIGNALLING, 1.0, "invalid operation"),
        ("1.0 / (a * b)", 1e200, 1e200, "overflow"),
        ("a * b - a * b", 1e200, 1e200, "overflow"),
        ("SQRT(a)", -1.0, 0.0, "invalid operation"),
        ("LN(a)", 0.0, 0.0, "invalid operation"),
        ("LN(a)", -1.0, 0.0, "invalid operation"),
        ("LOG(a)", -0.0, 0.0, "invalid operation"),
        ("EXP(a)", 710.0, 0.0, "overflow"),
        ("SIN(a)", INF, 0.0, "invalid operation"),
        ("COS(a)", -INF, 0.0, "invalid operation"),
        ("TAN(a)", INF, 0.0, "invalid operation"),
        ("ASIN(a)", 1.0000001, 0.0, "invalid operation"),
        ("ACOS(a)", -1.5, 0.0, "invalid operation"),
        ("EXPT(a, b)", 0.0, -1.0, "division by zero"),
        ("EXPT(a, b)", -2.0, 0.5, "invalid operation"),
        ("EXPT(a, b)", 1e200, 2.0, "overflow"),
        ("EXP(a)", SIGNALLING, 0.0, "invalid operation"),
        ("SQRT(a)", SIGNALLING, 0.0, "invalid operation"),
        ("MIN(a, b)", NAN, 0.0, "comparison with NaN"),
        ("MAX(a, b)", 0.0, NAN, "comparison with NaN"),
        ("LIMIT(0.0, a, 1.0)", NAN, 0.0, "comparison with NaN"),
        ("LREAL_TO_REAL(a)", NAN, 0.0, "conversion out of range"),
        ("LREAL_TO_REAL(a)", INF, 0.0, "conversion out of range"),
        ("DINT_TO_LREAL(LREAL_TO_DINT(a))", NAN, 0.0, "conversion out of range"),
        ("DINT_TO_LREAL(TRUNC(a))", -INF, 0.0, "conversion out of range"),
    ],
)
def test_exceptions(expression: str, a: float, b: float, kind: str) -> None:
    if "REAL_TO_REAL" in expression or "LREAL_TO_REAL" in expression:
        assert fault(expression, "REAL", a=("LREAL", a)) == kind
    else:
        assert fault(expression, "LREAL", a=("LREAL", a), b=("LREAL", b)) == kind


@pytest.mark.parametrize(
    ("expression", "a", "b", "expected"),
    [
        ("a", NAN, 0.0, NAN),
        ("a", SIGNALLING, 0.0, SIGNALLING),
        ("-a", INF, 0.0, -INF),
        ("ABS(a)", -INF, 0.0, INF),
        ("a + b", INF, 1.0, INF),
        ("a - b", INF, -INF, INF),
        ("a * b", INF, -2.0, -INF),
        ("a / b", 1.0, INF, 0.0),
        ("a / b", INF, 0.0, INF),
        ("a / b", -INF, 0.0, -INF),
        ("a + b", NAN, 1.0, NAN),
        ("a * b", NAN, 0.0, NAN),
        ("a / b", NAN, 0.0, NAN),
        ("a * b", 5e-324, 0.5, 0.0),
        ("SQRT(a)", INF, 0.0, INF),
        ("SQRT(a)", -0.0, 0.0, -0.0),
        ("SQRT(a)", NAN, 0.0, NAN),
        ("EXP(a)", -INF, 0.0, 0.0),
        ("EXP(a)", INF, 0.0, INF),
        ("EXP(a)", -800.0, 0.0, 0.0),
        ("EXP(a)", 709.78, 0.0, float(np.exp(709.78))),
        ("LN(a)", INF, 0.0, INF),
        ("LN(a)", NAN, 0.0, NAN),
        ("SIN(a)", NAN, 0.0, NAN),
        ("ATAN(a)", INF, 0.0, math.pi / 2),
        ("ATAN2(a, b)", 0.0, 0.0, 0.0),
        ("ATAN2(a, b)", 1.0, -INF, math.pi),
        ("EXPT(a, b)", -2.0, 3.0, -8.0),
        ("EXPT(a, b)", 2.0, -INF, 0.0),
        ("SEL(FALSE, a, b)", NAN, 1.0, NAN),
        ("MIN(a, b)", -INF, 1.0, -INF),
        ("LIMIT(-1.0, a, b)", INF, 2.0, 2.0),
        ("REAL_TO_LREAL(LREAL_TO_REAL(a))", 0.1, 0.0, float(np.float32(0.1))),
    ],
)
def test_no_exceptions(expression: str, a: float, b: float, expected: float) -> None:
    found = value(expression, "LREAL", a=("LREAL", a), b=("LREAL", b))
    if math.isnan(expected) and expression != "a":
        assert math.isnan(found)
    else:
        assert bits(found) == bits(expected)


@pytest.mark.parametrize("operator", ["=", "<>", "<", "<=", ">", ">="])
def test_comparisons(operator: str) -> None:
    python = {"=": "==", "<>": "!="}.get(operator, operator)
    for a in (-INF, -0.0, 0.0, 1.5, INF):
        for b in (-INF, 0.0, 1.5, INF):
            expected = eval(f"x {python} y", {"x": a, "y": b})
            assert value(f"a {operator} b", "BOOL", a=("LREAL", a), b=("LREAL", b)) is expected
    for a, b in ((NAN, 1.0), (1.0, NAN), (NAN, NAN), (SIGNALLING, 0.0)):
        assert fault(f"a {operator} b", "BOOL", a=("LREAL", a), b=("LREAL", b)) == "comparison with NaN"
        assert fault(f"a {operator} 0.5", "BOOL", a=("LREAL", NAN), b=("LREAL", b)) == "comparison with NaN"


@pytest.mark.parametrize("test", ["a < 1.0 OR a > -1.0", "a >= 0.0 OR a <= 0.5", "NOT NOT (a <= 2.0 OR a > 1.0)"])
def test_two_ranges_without_a_gap_are_the_nan_test_of_the_portable_dialect_only(test: str) -> None:
    for number in (-INF, -1.0, -0.0, 0.5, 1.0, 2.0, INF):
        assert value(test, "BOOL", "iec", a=("LREAL", number)) is True
    for nan in (NAN, SIGNALLING):
        assert value(test, "BOOL", "iec", a=("LREAL", nan)) is False
        assert fault(test, "BOOL", "twincat", a=("LREAL", nan)) == "comparison with NaN"


@pytest.mark.parametrize(
    "test",
    [
        *("a = a", "a <> a", "a < 1.0 OR a > 1.0", "a < 0.0 OR a > 0.5", "a < 1.0 AND a > -1.0"),
        *("a > -1.0 OR a > -2.0", "a < 1.0 OR b > -1.0", "a < b OR a > -1.0", "a < 1.0", "a < 1.0 XOR a > -1.0"),
        "a + 0.0 < 1.0 OR a + 0.0 > 0.0",
    ],
)
def test_no_other_comparison_may_meet_nan_in_the_portable_dialect(test: str) -> None:
    assert fault(test, "BOOL", "iec", a=("LREAL", NAN), b=("LREAL", 1.0)) == "comparison with NaN"


def test_an_array_element_is_tested_for_nan() -> None:
    text = "t[1] := a; x := t[i] < 1.0 OR t[i] > -1.0; y := t[{}] < 1.0 OR t[i] > -1.0;"
    declared = {"variables": "x : BOOL; y : BOOL; t : ARRAY[0..1] OF LREAL;", "inputs": "i : DINT; a : LREAL;"}
    assert run(block(text.format("i"), **declared), ("x", "y"), "iec", i=1, a=NAN) == (False, False)
    with pytest.raises(StRuntimeError, match="comparison with NaN"):
        run(block(text.format(0), **declared), ("x", "y"), "iec", i=1, a=NAN)


def test_error_has_row_position_and_operands() -> None:
    text = block("x := 1.0;\nx := x / a;", "x : LREAL;", inputs="a : LREAL;")
    with pytest.raises(StRuntimeError) as caught:
        run(text, "x", a=0.0)
    error = caught.value
    assert (error.kind, error.row, error.operands) == ("division by zero", 0, (1.0, 0.0))
    assert str(error) == "t.st:6:8 (FB_T): division by zero: operands 1.0, 0.0, row 0"


@pytest.mark.parametrize("name", ["SQRT", "EXP", "LN", "LOG", "SIN", "COS", "TAN", "ATAN"])
@EXAMPLES
@given(s.floats(0.0625, 80.0, width=32))
def test_functions_of_real_round_once_more(name: str, a: float) -> None:
    wide = value(f"{name}(a)", "LREAL", a=("LREAL", a))
    assert value(f"{name}(a)", "REAL", a=("REAL", a)) == float(np.float32(wide))


USUAL = {
    "SQRT": math.sqrt,
    "EXP": math.exp,
    "LN": math.log,
    "LOG": math.log10,
    "SIN": math.sin,
    "COS": math.cos,
    "TAN": math.tan,
    "ASIN": math.asin,
    "ACOS": math.acos,
    "ATAN": math.atan,
}


@pytest.mark.parametrize("name", USUAL)
def test_functions_are_those_of_the_c_library(name: str) -> None:
    for a in (0.0625, 0.3, 0.99):
        expected = USUAL[name](a)
        found = value(f"{name}(a)", "LREAL", a=("LREAL", a))
        assert found == expected


@pytest.mark.parametrize("name", USUAL)
@EXAMPLES
@given(s.floats(0.0, 1.0) | s.floats(1e-300, 700.0))
def test_functions_of_constants_and_of_variables_have_the_same_bits(name: str, x: float) -> None:
    if (name in ("ASIN", "ACOS") and x > 1.0) or (name in ("LN", "LOG") and x == 0.0):
        return
    assert bits(value(f"{name}(x)", "LREAL", x=("LREAL", x))) == bits(arithmetic.FUNCTIONS[name](x))
    y = 1.5 - x / 2
    if abs(x) < 100:
        assert bits(value("EXPT(x, y)", "LREAL", x=("LREAL", x + 0.1), y=("LREAL", y))) == bits(
            functions.expt(x + 0.1, y)
        )


# --- selection --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expression", "type_", "expected"),
    [
        ("MIN(3, 1, 2)", "DINT", 1),
        ("MAX(1.5, 2.5, 0.5)", "LREAL", 2.5),
        ("LIMIT(1, 5, 3)", "DINT", 3),
        ("LIMIT(1, 0, 3)", "DINT", 1),
        ("LIMIT(MN := 1, IN := 2, MX := 3)", "DINT", 2),
        ("SEL(TRUE, 1, 2)", "DINT", 2),
        ("SEL(G := FALSE, IN0 := 1, IN1 := 2)", "DINT", 1),
        ("MUX(2, 10, 20, 30)", "DINT", 30),
        ("MUX(K := 0, IN0 := 10, IN1 := 20)", "DINT", 10),
        ("ABS(-5)", "DINT", 5),
        ("ABS(-5.5)", "LREAL", 5.5),
        ("MOVE(7)", "DINT", 7),
        ("ADD(1, 2, 3)", "DINT", 6),
        ("SUB(5, 3)", "DINT", 2),
        ("MUL(2, 3)", "DINT", 6),
        ("DIV(7, 2)", "DINT", 3),
        ("GT(2, 1)", "BOOL", True),
        ("NE(2, 2)", "BOOL", False),
        ("2 ** 3", "LREAL", 8.0),
        ("7 / 2", "LREAL", 3.0),
        ("7.0 / 2", "LREAL", 3.5),
        ("16#FF AND 16#0F", "DINT", 15),
    ],
)
def test_selection_and_constants(expression: str, type_: str, expected: object) -> None:
    if "AND" in expression:
        assert value("a AND b", "WORD", a=("WORD", 255), b=("WORD", 15)) == expected
    else:
        assert value(expression, type_) == expected


def test_mux_beyond_its_inputs_is_an_error() -> None:
    for k in (-1, 2):
        assert fault("MUX(k, 1, 2)", "DINT", k=("DINT", k)) == "index out of range"


def test_and_evaluates_both_sides_and_and_then_does_not() -> None:
    assert fault("a <> 0 AND 10 / a > 1", "BOOL", a=("DINT", 0)) == "division by zero"
    assert value("a <> 0 AND_THEN 10 / a > 1", "BOOL", a=("DINT", 0)) is False
    assert value("a = 0 OR_ELSE 10 / a > 1", "BOOL", a=("DINT", 0)) is True
    assert value("a <> 0 AND_THEN 10 / a > 1", "BOOL", a=("DINT", 3)) is True


def test_durations() -> None:
    assert value("T#1s + T#500ms", "TIME") == 1500
    assert value("TIME_TO_UDINT(T#2s * 3)", "UDINT") == 6000
    assert value("T#7s / 2", "TIME") == 3500
    assert value("a > T#1s", "BOOL", a=("TIME", 1001)) is True
    assert value("DINT_TO_TIME(a)", "TIME", a=("DINT", 250)) == 250
    assert value("LTIME#250us", "LTIME") == 250_000
    assert value("T#250us + T#1ms", "TIME", "iec") == 1_250_000
    assert fault("(a - T#1s) > T#0s", "BOOL", a=("TIME", 0)) == "integer overflow"
    assert fault("a / n", "TIME", a=("TIME", 5), n=("INT", -1)) == "integer overflow"
