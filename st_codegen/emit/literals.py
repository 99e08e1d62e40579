"""Numbers and names as Structured Text.

Every real number is written with the fewest digits that read back as the same float64, always with a dot, as strict
compilers require.
"""

from __future__ import annotations

import math
import re
import unicodedata
from typing import Any

import numpy as np

from st_codegen.errors import InputError
from st_codegen.files.toml_tables import shown
from st_codegen.ir import AnyArray

#: Reserved words of IEC 61131-3 and TwinCAT and their operators, in upper case; `is_keyword` knows conversions as well.
KEYWORDS = frozenset(
    """
    ABS ACOS ACTION ADD ADR AND AND_THEN ANY ANY_BIT ANY_DATE ANY_INT ANY_NUM ANY_REAL ARRAY ASIN AT ATAN ATAN2 BIT
    BITADR BOOL BY BYTE CASE CHAR CLASS CONFIGURATION CONSTANT CONTINUE COS DATE DATE_AND_TIME DINT DIV DO DT DWORD
    ELSE ELSIF END_ACTION END_CASE END_CLASS END_CONFIGURATION END_FOR END_FUNCTION END_FUNCTION_BLOCK END_IF
    END_INTERFACE END_METHOD END_NAMESPACE END_PROGRAM END_PROPERTY END_REPEAT END_RESOURCE END_STEP END_STRUCT
    END_TRANSITION END_TYPE END_UNION END_VAR END_WHILE EQ EXIT EXP EXPT EXTENDS FALSE FOR FROM FUNCTION
    FUNCTION_BLOCK GE GT IF IMPLEMENTS INDEXOF INITIAL_STEP INT INTERFACE LDATE LDT LE LIMIT LINT LN LOG LREAL LT
    LTIME LTOD LWORD MAX METHOD MIN MOD MOVE MUL MUX NAMESPACE NE NON_RETAIN NOT NULL OF OR OR_ELSE PERSISTENT POINTER
    PRIVATE PROGRAM PROPERTY PROTECTED PUBLIC READ_ONLY READ_WRITE REAL REFERENCE REF_TO REPEAT RESOURCE RETAIN RETURN
    ROL ROR RTC SEL SHL SHR SIN SINT SIZEOF SQRT STEP STRING STRUCT SUB SUPER TAN THEN THIS TIME TIME_OF_DAY TO TOD
    TRANSITION TRUE TRUNC TYPE UDINT UINT ULINT UNION UNTIL USING USINT VAR VAR_ACCESS VAR_CONFIG VAR_EXTERNAL
    VAR_GENERIC VAR_GLOBAL VAR_INPUT VAR_INST VAR_IN_OUT VAR_OUTPUT VAR_STAT VAR_TEMP VOID WCHAR WHILE WORD WSTRING
    UXINT XINT XOR XWORD
    """.split()
)

_TYPE = "BOOL|L?REAL|[DL]?WORD|BYTE|U?[SDL]?INT|W?STRING|W?CHAR|L?TIME|L?DATE|L?TOD|L?DT"
_CONVERSION = re.compile(rf"(({_TYPE})_)?(TO|TRUNC)_({_TYPE})")

#: Longer names are cut by some tools without a word.
MAX_IDENTIFIER = 48

_UNITS = str.maketrans({"°": "deg", "µ": "u", "μ": "u", "·": " ", "²": "^2", "³": "^3", "Ω": "Ohm"})

_LETTERS = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss", "°": "deg", "µ": "u", "μ": "u"}
)


def is_keyword(name: str) -> bool:
    """Whether a name is a word of the language whatever its case, which no name of a user may be."""
    upper = name.upper()
    return upper in KEYWORDS or _CONVERSION.fullmatch(upper) is not None


def real(value: float) -> str:
    """A finite float64 as a real literal that reads back as the same bits: 1.0, -2.5E-7, 1.0E16.

    Raises InputError for NaN and infinities, which Structured Text cannot write.
    """
    if not math.isfinite(value):
        raise InputError(f"{value} cannot be written as a number in Structured Text")
    text = repr(float(value))
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}E{int(exponent)}"


def reals(values: AnyArray) -> list[str]:
    """What `real` makes of each number, many at a time."""
    numbers = np.asarray(values, np.float64)
    texts = texts_of(numbers.tolist())
    # all others are written with a point and without an exponent
    size = np.abs(numbers)
    for place in np.flatnonzero(~((size >= 1e-4) & (size < 1e16) | (size == 0.0))).tolist():
        texts[place] = real(float(numbers[place]))
    return texts


def texts_of(numbers: list[Any]) -> list[str]:
    """What `repr` makes of each number, many at a time."""
    return repr(numbers)[1:-1].split(", ") if numbers else []


def real32(value: float) -> str:
    """A finite float32 as a real literal: the shortest that reads back as the same bits, at once or by way of LREAL."""
    single = np.float32(value)
    shortest = float(str(single))
    return real(shortest if np.float32(shortest) == single else float(single))


#: What ends, or begins, a comment of either kind or CDATA; and how it looks in a text that a model file brought along.
_ENDS = {"*)": r"\x2a)", "(*": r"(\x2a", "/*": r"/\x2a", "*/": r"\x2a/", "]]>": r"\x5d]>"}


def harmless(text: str) -> str:
    """A text of a model file as it may stand in a comment: what `check_text` refuses is escaped as Python does it."""
    shown = "".join(c if c.isascii() and c.isprintable() else ascii(c)[1:-1] for c in text)
    for ending, escaped in _ENDS.items():
        shown = shown.replace(ending, escaped)
    return shown


def check_text(text: str, what: str) -> str:
    """`text` if it may stand in a comment of a generated file, else InputError that names `what` it is.

    A comment must not end early, CDATA must not end early, and files stay ASCII on every controller.
    """
    for forbidden, name in (*((end, f"'{end}'") for end in _ENDS), ("\n", "a line end"), ("\r", "a line end")):
        if forbidden in text:
            raise InputError(f"{what} {shown(text)} contains {name}, which would break the generated file: rename it")
    if not text.isascii() or not text.isprintable():
        bad = next(character for character in text if not character.isascii() or not character.isprintable())
        raise InputError(f"{what} {shown(text)} contains {bad!r}: use printable ASCII characters only")
    return text


def unit_text(unit: str, what: str) -> str:
    """A unit in ASCII (degC for °C), checked like any other text."""
    return check_text(unit.translate(_UNITS), what)


def identifier(name: str, what: str, prefix: str = "") -> str:
    """`name` as the inner part of an ST identifier: blanks and punctuation become single underscores.

    `prefix` is what will stand in front of it: FB_Log is a name, though LOG is a reserved word. Raises InputError,
    naming `what` it is, for an empty or over-long name, a keyword, non-ASCII and what `check_text` refuses.
    """
    check_text(re.sub(r"/\*|\*/", "_", name), what)  # which no compiler sees: comments show the name as `harmless` does
    text = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_]", "_", name)).strip("_")
    if not text:
        raise InputError(f"{what} {shown(name)} has no letter or digit: rename it")
    if is_keyword(prefix + text):
        raise InputError(f"{what} {shown(name)} is a reserved word of Structured Text: rename it")
    if len(text) > MAX_IDENTIFIER:
        raise InputError(f"{what} {shown(name)} is longer than {MAX_IDENTIFIER} characters: shorten it")
    return text


def spelt(text: str) -> str:
    """A text in ASCII, as it is spelt without other letters; what cannot be is left out."""
    return unicodedata.normalize("NFKD", text.translate(_LETTERS)).encode("ascii", "ignore").decode()


def capitalised(name: str) -> str:
    """First letter upper case, the rest as it is: the inner part of a block's name."""
    return name[:1].upper() + name[1:]
