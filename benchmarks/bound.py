"""Is the worst case that the cost model counts one? Instructions that it expects against those that are executed.

    python benchmarks/bound.py [WORD ..]      golden models whose names have one of the words; `make bound` takes all

The operations on the worst path of each golden block, times the instructions that gcc -O0 makes of each on x86-64 at
most, against what callgrind counts in single calls of that code. The inputs are those at which a model changes its
answer, with their neighbours, NaN and random ones, and then rows made of the worst, with some of their numbers replaced
by those of others. Without optimisation gcc keeps variables in memory between statements, as compilers of controllers
do. Exit code 1 where a block executes more than is expected of it, or less than two thirds.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from benchmarks.harness import Harness  # noqa: E402
from benchmarks.st_to_c import ports, translate  # noqa: E402
from st_codegen.cost.profile import load_profile  # noqa: E402
from st_codegen.cost.report import project_cost  # noqa: E402
from st_codegen.project.bundle import load  # noqa: E402
from st_codegen.proof.probes import probe_rows  # noqa: E402
from st_codegen.st import load_project  # noqa: E402
from st_codegen.st.tree import Project  # noqa: E402

GOLDEN = ROOT / "golden" / "lone"

#: Instructions of an operation at most: gcc -O0 on x86-64, where a variable of a block is reached by a pointer that is
#: loaded anew. A test compiles single statements. Functions of the C library: the most of many arguments.
INSTRUCTIONS: Mapping[str, int] = {
    name: number
    for number, names in {
        1: "add multiply divide integer_multiply",
        2: "load store index",
        3: "integer compare real_compare convert branch",
        5: "integer_divide",
        9: "loop",
        12: "select call sqrt",
        60: "ln",
        80: "exp atan",
        500: "sin cos tan",  # of angles of any size
    }.items()
    for name in names.split()
}
#: The call from outside, and the copy of each input and output.
CALL, PORT = 20, 5
#: A bound is at most so many times what was executed.
LOOSEST = 1.5
#: Rows at first, worst rows that are changed, rows made of each, rounds.
ROWS, WORST, CHANGED, ROUNDS = 160, 3, 20, 2


@dataclass(frozen=True)
class Bound:
    """Instructions of the worst call of a block: as expected, and the most that were seen."""

    block: str
    expected: int
    executed: int

    @property
    def ratio(self) -> float:
        return self.expected / self.executed

    @property
    def holds(self) -> bool:
        return 1.0 <= self.ratio <= LOOSEST


def expected(operations: Mapping[str, int], n_ports: int) -> int:
    """The instructions of a call whose worst path has these operations."""
    return CALL + PORT * n_ports + sum(INSTRUCTIONS[name] * number for name, number in operations.items())


def compiled(project: Project, block: str, folder: Path) -> Path:
    """The library of a block, with its variables in memory."""
    (folder / "block.c").write_text(translate(project, block, "race"))
    library = folder / "block.so"
    command = ["gcc", "-O0", "-w", "-shared", "-fPIC", "-o", str(library), str(folder / "block.c"), "-lm"]
    subprocess.run(command, check=True)
    return library


def executed(harness: Harness, library: Path, outputs: int, rows: np.ndarray, folder: Path) -> np.ndarray:
    """Instructions of a call with each row; callgrind writes a file a call."""
    for file in folder.glob("calls.*"):
        file.unlink()
    (folder / "rows.bin").write_bytes(np.ascontiguousarray(rows, np.float64).tobytes())
    callgrind = ["valgrind", "--tool=callgrind", "--toggle-collect=race", "--dump-after=race"]
    callgrind.append(f"--callgrind-out-file={folder / 'calls'}")
    command = [harness.program, library, folder / "rows.bin", rows.shape[1], outputs, "count", len(rows)]
    subprocess.run([*callgrind, *map(str, command)], check=True, capture_output=True)
    files = sorted(folder.glob("calls.*"), key=lambda file: int(file.suffix[1:]))
    counts = [re.search(r"^(?:totals|summary): (\d+)", file.read_text(), re.MULTILINE) for file in files]
    # the first call makes what is made once, the last file is that of the end
    return np.array([int(count[1]) for count in counts[1 : len(rows) + 1] if count is not None])


def worst_call(
    harness: Harness, library: Path, outputs: int, rows: np.ndarray, folder: Path, rounds: int = ROUNDS
) -> int:
    """The most instructions of a call that were found, from `rows` on."""
    random = np.random.default_rng(0)
    counts = executed(harness, library, outputs, rows, folder)
    for _ in range(rounds):
        parents = np.repeat(rows[np.argsort(-counts, kind="stable")[:WORST]], CHANGED, axis=0)
        others = rows[random.integers(len(rows), size=parents.shape), np.arange(rows.shape[1])]
        rows = np.vstack([rows, np.where(random.uniform(size=parents.shape) < 0.3, others, parents)])
        changed = rows[-len(parents) :]
        counts = np.concatenate([counts, executed(harness, library, outputs, changed, folder)])
    return int(counts.max())


def bounds_of(names: Sequence[str], n_rows: int = ROWS, rounds: int = ROUNDS) -> list[Bound]:
    """The bounds of golden models."""
    project = load_project([GOLDEN / "generated" / "twincat"], "twincat")
    costs = project_cost(project, load_profile())
    found = []
    with tempfile.TemporaryDirectory(prefix="bound-") as text:
        folder = Path(text)
        harness = Harness(folder)
        for file in (file for file in sorted((GOLDEN / "models").iterdir()) if file.stem in names):
            (model,) = load(file).irs
            block = f"FB_{model.name.capitalize()}"
            inputs, outputs = ports(project, block)
            library, rows = compiled(project, block, folder), probe_rows(model, n_rows, sampled=True)
            most = worst_call(harness, library, outputs, rows, folder, rounds)
            found.append(Bound(block, expected(costs.blocks[block].operations, inputs + outputs), most))
    return found


def main(words: list[str]) -> int:
    """Print the table of the golden models."""
    missing = [tool for tool in ("gcc", "valgrind") if shutil.which(tool) is None]
    if missing:
        print(f"{' and '.join(missing)} needed: apt-get install {' '.join(missing)}")
        return 2
    names = [file.stem for file in (GOLDEN / "models").iterdir()]
    found = bounds_of([name for name in names if not words or any(word in name for word in words)])
    if not found:
        print("no golden model has such a name")
        return 2
    print("| block | instructions expected at most | executed at most | expected / executed |\n|---|--:|--:|--:|")
    for bound in found:
        print(f"| {bound.block} | {bound.expected:,} | {bound.executed:,} | {bound.ratio:.2f} |")
    wrong = [bound.block for bound in found if not bound.holds]
    ratios = [bound.ratio for bound in found]
    print(f"\n{len(found)} blocks, {min(ratios):.2f} to {max(ratios):.2f}; outside of 1 to {LOOSEST}: {len(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
