"""What is fuzzed: for each kind of file its seeds, how they are changed, and what must hold of what is accepted."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import read_run
from st_codegen.campaign.harmonic_table import read_table
from st_codegen.files.toml_tables import parse_toml
from st_codegen.project import configuration as configurations_of
from st_codegen.project.configuration import read_configuration
from st_codegen.proof.predict import read_table as read_inputs
from st_codegen.rig.model import read_rig
from st_codegen.st import load_project
from st_codegen.te.bundle_file import read_description
from st_codegen.walkers.files import load_model
from tests.fuzz.models import agrees
from tests.walkers import mutants as archives

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "golden"


@dataclass(frozen=True)
class Kind:
    """`seeds`: contents of good files; `name` of the file to write; `check(path)` of a mutant: whether all is equal."""

    name: str
    seeds: Callable[[], list[bytes]]
    check: Callable[[Path], bool]
    mutant: Callable[[bytes, object], bytes]


def model(path):
    return agrees(load_model(path, "m"))


def twice(read):
    """What is accepted is the same when it is read again."""
    return lambda path: repr(read(path)) == repr(read(path))


def inputs(path):
    """A table of inputs: each cell is the number that its text is, read in another way."""
    found = read_inputs(path)
    separator = ";" if b";" in path.read_bytes().splitlines()[0] else ","
    text = path.read_text(encoding="utf-8-sig")
    if '"' in text:
        return True
    rows = [line.split(separator) for line in re.split(r"\r\n|\r|\n", text) if re.sub(r"[\s,;]", "", line)]
    texts = np.array([[cell.strip().replace(",", ".") for cell in row] for row in rows[1:]]).reshape(-1, len(found))
    return all(
        np.array_equal(values, texts[:, number].astype(np.float64), equal_nan=True)
        for number, values in enumerate(found.values())
    )


def curve(path):
    point = OperatingPoint(1000.0, 1100.0, 25.0)
    run = read_run(path, point)
    again = read_run(path, point)
    return run.curves.keys() == again.curves.keys() and all(
        np.array_equal(getattr(run.curves[way], name), getattr(again.curves[way], name))
        for way in run.curves
        for name in ("angle_deg", "te_deg")
    )


def text(path):
    project = load_project([path], "iec")
    return sorted(project.pous) == sorted(load_project([path], "iec").pous)


def rig(path):
    """The numbers of the file are those of the model."""
    found = read_rig(path)
    ratio = parse_toml(path.read_text(encoding="utf-8-sig"), "rig")["rig"]["reduction_ratio"]
    return found.constants.reduction_ratio == ratio


def bundle(path):
    found = read_description(path)
    table = parse_toml(path.read_text(encoding="utf-8-sig"), "bundle")["bundle"]
    return (found.reduction_ratio, list(found.orders)) == (table["reduction_ratio"], table["orders"])


def configuration(path):
    found = read_configuration(path.parent)
    return found.build == parse_toml(path.read_text(encoding="utf-8-sig"), "configuration").get("build", {})


def changed_bytes(data, random):
    """One to four changes: bits, bytes, pieces, lines, numbers."""
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 4))):
        if not changed:
            break
        where = random.randrange(len(changed))
        kind = random.randrange(9)
        if kind == 0:
            changed[where] ^= 1 << random.randrange(8)
        elif kind == 1:
            changed[where] = random.choice(b"0123456789-.,;eE\xff\0{}[]\"'<>&=#\n \t_")
        elif kind == 2:
            del changed[where : where + random.choice((1, 2, 4, 8, 100, 1000))]
        elif kind == 3:
            piece = changed[where : where + random.choice((1, 4, 40, 400))]
            changed[where:where] = piece * random.choice((1, 1, 2, 50))
        elif kind == 4:
            changed[where:where] = random.choice(WORDS)
        elif kind < 7:
            _change_number(changed, random)
        else:
            _change_line(changed, random)
    return bytes(changed)


WORDS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e400",
    b"99999999999999999999",
    b"1_0",
    "\u0661".encode(),
    b"\xef\xbb\xbf",
    b"[" * 300,
]
WORDS += [
    b"{",
    b"]]",
    b'"""',
    b"<!DOCTYPE a>",
    b"<a>",
    b"]]>",
    b"(*",
    b"\r",
    b"\x1b[2J",
    b"$",
    b"../x",
    b"true",
    b"-0.0",
    b"\t",
    b"--",
    b"=",
    b"\n",
]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def _change_number(changed, random):
    """A number of the text becomes another one."""
    start = random.randrange(len(changed))
    found = _NUMBER.search(changed, start) or _NUMBER.search(changed)
    if found:
        new = random.choice(
            (b"0", b"-1", b"1", b"2", b"7", b"2147483648", b"1e308", b"1e-320", b"nan", b"", b"0.5", b"3e9")
        )
        changed[found.start() : found.end()] = new


def _change_line(changed, random):
    """A line goes, comes twice, is empty, or loses or doubles a word."""
    lines = changed.split(b"\n")
    where = random.randrange(len(lines))
    words = re.split(rb"([ ,;=])", lines[where])
    choice = random.randrange(6)
    if choice == 0:
        del lines[where]
    elif choice == 1:
        lines.insert(where, lines[random.randrange(len(lines))])
    elif choice == 2:
        lines.insert(where, b"")
    elif choice == 3:
        lines[where] = lines[where].partition(b"=")[0] + b"="
    else:
        word = random.randrange(len(words))
        words[word : word + 1] = words[word : word + 1] * (2 if choice == 4 else 0)
        lines[where] = b"".join(words)
    changed[:] = b"\n".join(lines)


def changed_trees(data, random):
    """LightGBM's text: most changes move what follows, so that `tree_sizes` is made right again, or goes."""
    changed = changed_bytes(data, random)
    kind = random.randrange(3)
    if kind:
        trees = re.findall(rb"^Tree=.*?(?=^Tree=|^end of trees)", changed, re.DOTALL | re.MULTILINE)
        sizes = b"tree_sizes=%s\n" % b" ".join(b"%d" % len(tree) for tree in trees)
        changed = re.sub(rb"^tree_sizes=.*\n", sizes if kind == 1 else b"", changed, count=1, flags=re.MULTILINE)
    return changed


def changed_json(data, random):
    """An entry of a document goes, comes twice, or becomes another value; or its bytes change."""
    if random.random() < 0.3:
        return changed_bytes(data, random)
    document = json.loads(data)
    owners = [value for value in _inside(document) if value]
    for _ in range(random.choice((1, 1, 2))):
        owner = random.choice(owners)
        key = random.choice(list(owner)) if isinstance(owner, dict) else random.randrange(len(owner))
        others = [None, 0, -1, 1, 2, 7, 2**31, 1e308, 0.5, "", "x", "0", "-1", "1e9", [], {}, [1], True, float("nan")]
        choice = random.randrange(4)
        if choice == 0:
            del owner[key]
            owners = [value for value in _inside(document) if value]
            if not owners:
                break
        elif choice == 1 and isinstance(owner, list):
            owner.insert(key, owner[random.randrange(len(owner))])
        else:
            owner[key] = random.choice(others)
    return json.dumps(document).encode()


def _inside(value):
    found = [value] if isinstance(value, (dict, list)) else []
    entries = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
    return found + [one for entry in entries for one in _inside(entry)]


def changed_archive(data, random):
    return archives.mutant(data, random) if random.random() < 0.9 else changed_bytes(data, random)


def files(pattern, largest=200_000):
    return lambda: [path.read_bytes() for path in sorted(GOLDEN.glob(pattern)) if path.stat().st_size < largest]


def examples(*paths):
    return lambda: [(ROOT / path).read_bytes() for path in paths]


HEADER = "Poisition_Output_Reducer_Fw,Transmission_Error_Fw,Position_Output_Reducer_Bw,Transmission_Error_Bw"


def curves():
    angle = np.linspace(0, 360, 130)
    rows = [f"{a:.3f},{0.01 * np.sin(a):.6f},{360 - a:.3f},{0.02 * np.cos(a):.6f}" for a in angle]
    german = [row.replace(",", ";").replace(".", ",") for row in rows]
    return ["\n".join(lines).encode() for lines in (rows, german, [HEADER, *rows])]


def tables():
    rows = ["direction,speed_rpm,torque_Nm,temperature_C,A0,A1,phi1"]
    rows += [f"{way},{speed},900,30,0.1,0.2,{0.01 * speed}" for way in ("forward", "backward") for speed in (100, 200)]
    return ["\n".join(rows).encode()]


def configurations():
    text = configurations_of.__doc__.partition("\n\n")[2]
    return [
        text.replace("5f1c..", "5f1c" * 16).encode(),
        *examples("examples/user_repository/models/st-codegen.toml")(),
    ]


def vendors():
    from tests.beckhoff_ml.test_reader import FILES

    return [text.encode() for text in FILES.values()]


KINDS = {
    kind.name: kind
    for kind in (
        Kind("lightgbm.txt", files("lone/models/*.txt"), model, changed_trees),
        Kind("xgboost.json", files("lone/models/*.json"), model, changed_json),
        Kind("xgboost.ubj", files("lone/models/*.ubj"), model, changed_bytes),
        Kind("onnx.onnx", files("lone/models/*.onnx"), model, changed_bytes),
        Kind("vendor.xml", vendors, model, changed_bytes),
        Kind("sklearn.skops", files("lone/models/*.skops"), model, changed_archive),
        Kind("bundle.toml", examples("golden/bundle/models/bundle.toml"), bundle, changed_bytes),
        Kind("st-codegen.toml", configurations, configuration, changed_bytes),
        Kind("rig.toml", examples("examples/rv160n/rig.toml"), rig, changed_bytes),
        Kind("curve.csv", curves, curve, changed_bytes),
        Kind("table.csv", tables, twice(lambda path: read_table(path).__dict__), changed_bytes),
        Kind("inputs.csv", lambda: [b"f0,f1\n1,2.5\n-3e5,nan\n", b"f0;f1\n1,5;2\n"], inputs, changed_bytes),
        Kind("plcopen.xml", files("plcopen/*trees.xml"), text, changed_bytes),
        Kind(
            "block.st",
            lambda: [b.replace(b"\r", b"") for b in files("lone/generated/iec/FB_[EO]*.st", 20_000)()],
            text,
            changed_bytes,
        ),
    )
}
