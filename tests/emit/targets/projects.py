"""An application that has one of everything a target may have to write."""

import numpy as np

from st_codegen.emit.blocks.application import (
    Application,
    ArrayAlias,
    Enumeration,
    EnumValue,
    GlobalList,
    Structure,
    Task,
)
from st_codegen.emit.blocks.listing import ArrayElement, Block, BlockVariable, CodeSection, Group, Table
from st_codegen.emit.render import print_plans

#: A block counts cycles; a program owns it; two tasks.
COUNTER = Block(
    name="FB_Counter",
    header=("FB_Counter: made for a test, 1 < 2 & 3 > 2",),
    inputs=(BlockVariable("aValues", "T_Values", comment="a & b"), BlockVariable("nIgnored", "DINT", initial="3")),
    outputs=(
        BlockVariable("bValid", "BOOL"),
        BlockVariable("fOut1", "LREAL", comment="x < y"),
    ),
    variables=(
        BlockVariable("aInput", "LREAL", length=3),
        BlockVariable("bUsable", "BOOL", initial="TRUE"),
        BlockVariable("eMode", "E_Mode"),
        BlockVariable("stState", "ST_State"),
        BlockVariable("sText", "STRING(20)"),
    ),
    constants=(BlockVariable("SMALLEST", "LREAL", initial="-2.5E-3", comment="smallest < x"),),
    tables=(
        Table("WEIGHT", "LREAL", np.array([0.1, -2.0, 1e-300, 4.0, 5.0]), (Group("tree 0", 0, 2), Group("<&>", 2, 5))),
        Table("SPLIT", "SINT", np.array([0, 1, 1], np.int8)),
    ),
    sections=(
        CodeSection(
            "outputs & more",
            "outputs",
            {
                "assignments": [{"output": "fOut1", "value": ArrayElement("WEIGHT", 1), "cut": False}],
                "ranged": False,
                "aged": False,
                "plausible": [],
            },
        ),
    ),
)
MAIN = Block(
    name="PRG_Main",
    header=("PRG_Main: made for a test",),
    variables=(BlockVariable("fbCounter", "FB_Counter"), BlockVariable("nTimes", "DINT")),
    kind="PROGRAM",
)
APPLICATION = Application(
    name="everything",
    types=(
        Enumeration(
            "E_Mode", ("What goes on.",), (EnumValue("Idle", 0, "nothing"), EnumValue("Busy", 5), EnumValue("Bad", 16))
        ),
        ArrayAlias("T_Values", ("Some values.",), "LREAL", 3),
        Structure(
            "ST_State",
            ("State of", "the machine."),
            (
                BlockVariable("fSpeed", "LREAL", initial="1.5", comment="rpm"),
                BlockVariable("anCount", "DINT", length=4, comment="times"),
                BlockVariable("eMode", "E_Mode"),
            ),
        ),
    ),
    globals=(
        GlobalList(
            "GVL_Plant",
            ("Constants of the plant.",),
            (BlockVariable("RATIO", "LREAL", initial="81.0"),),
            (Table("ORDER", "DINT", np.array([0, 1, 39], np.int32)),),
            constant=True,
        ),
        GlobalList("GVL_State", ("What all see.",), (BlockVariable("stState", "ST_State"),)),
    ),
    blocks=(COUNTER, MAIN),
    tasks=(Task("PlcTask", 500, 1, ("PRG_Main",)), Task("SlowTask", 10_000, 20, ("PRG_Main",))),
)


def written(target, application=APPLICATION):
    """The files that a target writes for an application: text by path."""
    return {file.path: "".join(file.pieces) for file in print_plans(target, list(target.files(application)))}
