"""Variables as bytes in the layout of a controller."""

import ctypes

import numpy as np
import pytest

from st_codegen.live.symbols import WireVariables, assigned_globals, type_name
from st_codegen.st import Machine, parse_project

TEXT = """
TYPE E_Mode : (OFF := 0, ON := 3) DINT; END_TYPE
TYPE ST_Inner : STRUCT bFirst : BOOL; fValue : LREAL; nLast : INT; END_STRUCT END_TYPE
TYPE ST_Outer : STRUCT
    nByte : BYTE; aInner : ARRAY[0..1] OF ST_Inner; sText : STRING(5); eMode : E_Mode;
END_STRUCT END_TYPE
FUNCTION_BLOCK FB_Adds VAR_IN_OUT fSum : LREAL; END_VAR fSum := fSum + 1.0; END_FUNCTION_BLOCK
PROGRAM PRG_Main VAR fbAdds : FB_Adds; nCalls : DINT; END_VAR
nCalls := nCalls + 1;
fbAdds(fSum := fSum);
stOuter.nByte := nIn;
END_PROGRAM
VAR_GLOBAL fSum : LREAL; nIn : BYTE; bFlags : ARRAY[0..2] OF BOOL; stOuter : ST_Outer; END_VAR
"""


class Inner(ctypes.Structure):
    _fields_ = (("bFirst", ctypes.c_bool), ("fValue", ctypes.c_double), ("nLast", ctypes.c_int16))


class Outer(ctypes.Structure):
    _fields_ = (
        ("nByte", ctypes.c_uint8),
        ("aInner", Inner * 2),
        ("sText", ctypes.c_char * 6),
        ("eMode", ctypes.c_int32),
    )


@pytest.fixture
def machine():
    return Machine(parse_project({"a.st": TEXT}), optimised=False)


@pytest.fixture
def symbols(machine):
    return WireVariables(machine, frozenset({".NIN", "GLOBALS.NIN"}), {})


def test_a_structure_goes_out_and_comes_in_as_a_c_compiler_has_it(machine, symbols):
    symbol = symbols["stOuter"]
    assert symbol.size == ctypes.sizeof(Outer)
    given = Outer(7, (Inner * 2)(Inner(True, 2.5, -3), Inner(False, -1e300, 9)), b"h\xe4ll", 3)
    symbol.write(bytes(given))
    assert symbol.read() == bytes(given)
    assert machine.globals["stOuter.aInner[1].fValue"] == -1e300
    assert machine.globals["stOuter.sText"] == "häll"
    assert machine.globals["stOuter.eMode"] == 3
    assert symbols["stOuter.aInner[0].nLast"].read() == b"\xfd\xff"


def test_the_fields_of_a_union_share_their_bytes_as_those_of_c_do():
    class Raw(ctypes.Union):
        _fields_ = (("fValue", ctypes.c_double), ("aBytes", ctypes.c_uint8 * 9))

    class Framed(ctypes.Structure):
        _fields_ = (("bFirst", ctypes.c_bool), ("uRaw", Raw), ("nLast", ctypes.c_int16))

    text = """
    TYPE U_Raw : UNION fValue : LREAL; aBytes : ARRAY[0..8] OF BYTE; END_UNION END_TYPE
    TYPE ST_Framed : STRUCT bFirst : BOOL; uRaw : U_Raw; nLast : INT; END_STRUCT END_TYPE
    PROGRAM PRG_Main VAR nCalls : DINT; END_VAR nCalls := 1; END_PROGRAM
    VAR_GLOBAL stFramed : ST_Framed; END_VAR
    """
    machine = Machine(parse_project({"a.st": text}), optimised=False)
    symbol = WireVariables(machine, frozenset(), {})["stFramed"]
    assert symbol.size == ctypes.sizeof(Framed)
    given = Framed(True, Raw(aBytes=(ctypes.c_uint8 * 9)(*range(1, 10))), -5)
    symbol.write(bytes(given))
    assert symbol.read() == bytes(given)
    assert machine.globals["stFramed.uRaw.aBytes[8]"] == 9
    assert machine.globals["stFramed.uRaw.fValue"] == given.uRaw.fValue
    assert machine.globals["stFramed.nLast"] == -5


def test_values_that_do_not_fit(symbols):
    with pytest.raises(ValueError, match="8 bytes, not the 4"):
        symbols["fSum"].write(b"1234")
    symbols["bFlags"].write(b"\x00\x02\xff")
    assert symbols["bFlags"].read() == b"\x00\x01\x01"
    for name in ("nothing", "PRG_Main.fbAdds", "bFlags[3]", "PRG_Main.", ""):
        with pytest.raises(KeyError):
            symbols[name]


def test_programs_have_variables_too(machine, symbols):
    machine.program("PRG_Main")()
    assert symbols["prg_main.ncalls"].read() == np.int32(1).tobytes()
    assert "PRG_Main.nCalls" in set(symbols.names())


def test_what_the_text_assigns(machine):
    roots = {name.rpartition(".")[2] for name in assigned_globals(machine.project, frozenset())}
    assert roots == {"FSUM", "STOUTER"}
    assert not assigned_globals(machine.project, frozenset({"PRG_MAIN"}))


def test_names_of_types(machine, symbols):
    assert type_name(symbols["bFlags"].type) == "ARRAY [0..2] OF BOOL"
    assert type_name(symbols["stOuter.sText"].type) == "STRING(5)"
