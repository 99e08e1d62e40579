"""What may be asked of generated files: the one table behind the options of `generate` and the keys of [build].

It imports nothing, since `--help` reads it.
"""

from __future__ import annotations

from dataclasses import dataclass

LAYOUTS = ("auto", "trees", "ranked", "cut", "ifs", "table")
#: What a development environment is given to open.
PROJECT_FORMS = ("solution", "plc", "library")
TABLE_KILOBYTES = 64


@dataclass(frozen=True)
class BuildOption:
    """One option: a flag (bool), a whole number from 1 on (int), or a text, which may be one of some `choices`."""

    kind: type[bool | int | str]
    help: str
    default: int | None = None
    choices: tuple[str, ...] = ()
    metavar: str | None = None


def option_name(name: str) -> str:
    """An option as it is called on the command line, by its name in [build]."""
    return f"--{name.replace('_', '-')}"


#: By their names in [build].
BUILD_OPTIONS = {
    "with_tests": BuildOption(
        bool,
        "Also write TcUnit suites that compare the blocks of models, and FB_TEPredict, with the library's answers, and "
        "a task that runs them.",
    ),
    "with_configuration": BuildOption(
        bool, "For iec: write one file with programs that call the blocks and a CONFIGURATION that runs them."
    ),
    "with_comparison": BuildOption(
        bool, "For twincat: also write the programs that `compare` and `record` need on the controller."
    ),
    "project": BuildOption(
        str,
        "For TwinCAT: a solution that opens by itself, a PLC project alone to be added to a solution of yours, or a "
        "library of the blocks, without programs and tasks.",
        choices=PROJECT_FORMS,
    ),
    "self_check": BuildOption(
        bool,
        "Blocks check their constants, a few in each call, and in the first one a row whose answer is known, if there "
        "is one: once they find damage, bValid stays FALSE. prove does not follow them.",
    ),
    "with_age": BuildOption(bool, "Blocks of models have the output nAge: the calls since their outputs were valid."),
    "outputs_per_cycle": BuildOption(
        int,
        "Spread the models of a bundle over several calls of about equal cost, on average with so many outputs each. "
        "Default: all in each.",
    ),
    "real": BuildOption(
        bool,
        "For iec, plcopen, codesys: REAL instead of LREAL, for controllers that have no LREAL. What may be "
        "lost is computed and printed, or bounded by verify row by row.",
    ),
    "library_version": BuildOption(str, "With --project library: its version. Default: 1.0.0.0.", metavar="1.0.0.0"),
    "company": BuildOption(str, "With --project library: who offers it.", metavar="NAME"),
    "namespace": BuildOption(
        str, "With --project library: its namespace. Default: the project's name.", metavar="NAME"
    ),
    "max_array": BuildOption(
        int,
        "Largest number of elements in one array (default: the target's). Tables of trees, neurons and support "
        "vectors are cut into several, a tree or a vector never; what cannot be cut is refused.",
    ),
    "max_bytes": BuildOption(
        int, "Largest number of bytes of all tables together (default: the target's); more is an error."
    ),
    "layout": BuildOption(
        str,
        "How trees are written: trees, as they were trained, to be read; ranked, as nodes that compare ranks, "
        "which is faster where trees are many; cut, the same, with deep trees cut into the cells of a coarse grid of "
        "the inputs, in fewer steps and with more memory; ifs, as nested IFs, a model of one small tree; table, as "
        "their values in every cell. With auto, and where what is asked for is impossible, whichever is cheapest.",
        choices=LAYOUTS,
    ),
    "table_limit": BuildOption(
        int,
        "Largest table of an output in KB; one that is in place may grow to a quarter more.",
        default=TABLE_KILOBYTES,
    ),
}
