"""FB_SelfTest: whether a controller computes as the generated text assumes, asked on the controller itself."""

from __future__ import annotations

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.literals import real

SELF_TEST = "FB_SelfTest"

#: What the block looks for: the name of each fault, in the order of its bits, and the assumption that fails.
FAULTS = (
    ("CONTRACTION", "a product and a sum are fused: one rounding where the text has two"),
    ("EXTENDED", "intermediate results have more than 53 bits"),
    ("DENORMAL", "numbers below 2.2E-308, or REAL below 1.2E-38, become zero"),
    ("LOOP", "a FOR does not make the rounds that its bounds say"),
    ("ROUNDING", "results are not rounded to nearest, ties to even"),
    ("ORDER", "additions or divisions are not computed as they are written"),
    ("LREAL", "LREAL is no binary64, or a literal is not read as the nearest one"),
    ("INTEGER", "TRUNC, MOD, a division or a conversion of integers gives another number"),
)

#: Operands. None is CONSTANT, so that the controller computes with them, and not the compiler.
_OPERANDS = (
    ("fOne", 1.0, ""),
    ("fTen", 10.0, ""),
    ("fDivided", 49.0, ""),
    ("fUlp", 2.0**-52, "2**-52, from 1.0 to the next LREAL"),
    ("fHalf", 2.0**-53, "half of it: a tie"),
    ("fMore", 1.5 * 2.0**-53, "more than half of it"),
    ("fDouble", 2.0**-53 + 2.0**-65, "more than half of it by less than 64 bits show"),
    ("fFine", 2.0**-60, "2**-60"),
    ("fLarge", 2.0**70, "2**70"),
    ("fHalfReal", 2.0**-24, "half of the distance from 1.0 to the next REAL"),
    ("fMoreReal", 1.5 * 2.0**-24, "more than half of it"),
    ("fShrink", 2.0**-30, "2**-30"),
)


def self_test_block() -> Block:
    """The block, the same in every project of a dialect."""
    lines = [
        f"{SELF_TEST}: does this controller compute as the generated blocks assume?",
        "It runs in its first call only: call it once, or in each cycle. Where",
        "bPassed stays FALSE, results may differ from the library by more than the headers of the",
        "blocks say. nFaults is the sum of the numbers of the assumptions that fail; one cause may",
        "show in several of them. That nothing is found is no proof.",
    ]
    lines += [f"{1 << bit}: {meaning}" for bit, (_, meaning) in enumerate(FAULTS)]
    return Block(
        name=SELF_TEST,
        header=header_lines(*lines),
        outputs=(
            BlockVariable("bDone", "BOOL", comment="the test has run"),
            BlockVariable("bPassed", "BOOL", comment="it has run, and found nothing"),
            BlockVariable("nFaults", "DINT", comment="what it found, a sum of the numbers above"),
        ),
        variables=(
            *(BlockVariable(name, "LREAL", initial=real(value), comment=text) for name, value, text in _OPERANDS),
            BlockVariable("nOnce", "DINT", initial="1", comment="rounds of a loop"),
            BlockVariable("nNone", "DINT", initial="0", comment="no round of a loop"),
            BlockVariable("nMany", "DINT", initial="16777217", comment="more digits than REAL has"),
            BlockVariable("aTerm", "LREAL", 4, comment="terms of a sum"),
            BlockVariable("fX", "LREAL", comment="result"),
            BlockVariable("fY", "LREAL", comment="result"),
            BlockVariable("fZ", "LREAL", comment="result"),
            BlockVariable("nRound", "DINT", comment="round of a loop"),
            BlockVariable("nCount", "DINT", comment="rounds so far"),
            BlockVariable("bFault", "BOOL", comment="the assumption fails"),
        ),
        constants=tuple(
            BlockVariable(f"FAULT_{name}", "DINT", initial=str(1 << bit), comment=meaning)
            for bit, (name, meaning) in enumerate(FAULTS)
        ),
        sections=(CodeSection("each assumption by an example", "self_test", {}),),
    )
