"""`python -m tests.files.kills FOLDER`: writers that are killed at each of their steps; what they leave, as JSON.

Each writer has two results that overwrite each other. It runs in a child that is killed when it touches FOLDER for the
n-th time, for n = 1, 2, .. until it is quicker than the kill.
"""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": "1"}

import numpy as np
import polars  # noqa: F401  imported once and not in each child
import skops.io  # noqa: F401
from sklearn.linear_model import LinearRegression

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.files.folders import write_texts
from st_codegen.files.temporary import PREFIX
from st_codegen.rig.campaign import Measuring, simulate_campaign
from st_codegen.rig.model import read_rig
from st_codegen.te.harmonics import Direction, Quantity
from st_codegen.training.export import BundleHead, FittedModel, write_bundle

RIG = read_rig(Path(__file__).parents[2] / "examples" / "rv160n" / "rig.toml")


def texts(out, number):
    """As `simulate motion`, `tables` and `reconcile --update-models` write."""
    made = out.with_name(f"made{number}")
    (made / "inside").mkdir(parents=True, exist_ok=True)
    (made / "inside" / "model.txt").write_text(f"{number}")
    write_texts(
        out, {name: f"{name} {number}\n" for name in ("a.json", "b.csv", "c.html")}, {"models": made / "inside"}
    )


def bundle(out, number):
    """As `train` writes."""
    rows = np.random.default_rng(number).normal(size=(20, 3))
    fitted = LinearRegression().fit(rows, rows[:, 0])
    models = [FittedModel(Direction.FORWARD, order, Quantity.COSINE, fitted) for order in range(2 + number)]
    write_bundle(out, BundleHead("small", 81.0, np.array([[0.0, 1.0]] * 3)), models)


def campaign(out, number):
    """As `simulate campaign` writes: into a new folder, so that its two results are runs and repeated runs."""
    points = [OperatingPoint(1000.0, 100.0, 25.0), OperatingPoint(1000.0, 100.0 * (1 + number), 30.0 - 5 * number)]
    simulate_campaign(RIG, points[: 2 - number] * (1 + number), out, Measuring(600))


def killed_at(folder, last):
    """Kill this process when it touches `folder` for the n-th time."""
    count = 0

    def touched(event, arguments):
        nonlocal count
        touches = event.startswith(("os.", "shutil.", "open")) and any(str(a).startswith(folder) for a in arguments)
        if touches or (event == "ctypes.dlsym" and arguments[1] == "renameat2"):
            count += 1
            if count == last:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(touched)


def in_child(action):
    """Whether a child that does this was killed; a child that fails fails this program."""
    child = os.fork()
    if not child:
        action()
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or not status, status
    return os.WIFSIGNALED(status)


def below(folder):
    """The files below a folder with their content; of archives, which have times in them, the mark of their end."""
    files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {
        name: path.read_bytes()[slice(-22, -18) if path.suffix == ".skops" else slice(None)]
        for name, path in files.items()
        if not name.startswith(PREFIX)
    }


def killed_everywhere(writer, root, *, over):
    """What the kills of a writer left: counts of old, new, mixed and torn results, and temporary folders at the end.

    over: it overwrites its other result; else it writes where nothing is.
    """
    wholes = []
    for number in (0, 1):
        in_child(lambda number=number: writer(root / f"whole{number}", number))
        wholes.append(below(root / f"whole{number}"))
    assert wholes[0] != wholes[1]
    out, before = root / "out", wholes[0] if over else {}

    def attempt(last):
        killed_at(str(root), last)
        writer(out, 1)

    found = {"old": 0, "new": 0, "mixed": 0, "torn": 0}
    for last in range(1, 500):
        shutil.rmtree(out, ignore_errors=True)
        if over:
            shutil.copytree(root / "whole0", out)
        killed = in_child(lambda last=last: attempt(last))
        files = below(out)
        known = [content in (before.get(name), wholes[1].get(name)) for name, content in files.items()]
        if files in (before, wholes[1]):
            found["old" if files == before else "new"] += 1
        else:
            found["mixed" if over and all(known) else "torn"] += 1
        if not killed:
            assert files == wholes[1]
            break
    found["left"] = sorted(path.name for path in root.rglob(f"{PREFIX}*"))
    return found


def main():
    """Kill all writers everywhere."""
    results = {}
    for writer, over in ((texts, False), (texts, True), (bundle, False), (bundle, True), (campaign, False)):
        name = f"{writer.__name__} {'over another' if over else 'new'}"
        root = Path(sys.argv[1]) / name
        root.mkdir()
        results[name] = killed_everywhere(writer, root, over=over)
    sys.stdout.write(json.dumps(results))


if __name__ == "__main__":
    main()
