"""Damaged copies of a `.skops` file, each loaded in a process of its own with limits of time and memory.

`python -m tests.walkers.mutants COUNT SEED FILE..` prints for each file how many were refused, accepted, or ended in
another way.
"""

import contextlib
import gc
import importlib
import io
import json
import os
import random
import resource
import sys
import traceback
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np

from st_codegen.errors import StCodegenError
from st_codegen.ir.reference import valid_rows
from st_codegen.walkers.files import load_model

SECONDS, MEMORY = 60, 4 * 2**30


def mutant(data: bytes, rng: random.Random) -> bytes:
    """The archive with one to four changes of a member: bits, pieces of bytes, lines of text, or nodes of the tree."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    for _ in range(rng.choice((1, 1, 2, 4))):
        name = rng.choice(list(members))
        schema = json.loads(members["schema.json"])
        texts = [node for node in _nodes(schema) if len(str(node.get("content", ""))) > 500]
        if name == "schema.json" and texts and rng.random() < 0.5:
            node = rng.choice(texts)
            if isinstance(node["content"], str):
                lines = node["content"].split("\\n")
                _change_list(lines, rng)
                node["content"] = "\\n".join(lines)
                members[name] = json.dumps(schema).encode()
                continue
        if name == "schema.json" and rng.random() < 0.5:
            _change_tree(schema, rng)
            members[name] = json.dumps(schema).encode()
        else:
            members[name] = _change_bytes(members[name], rng)
            if name == "schema.json":
                break  # it may be no JSON any more
    result = io.BytesIO()
    with zipfile.ZipFile(result, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return result.getvalue()


def _nodes(value: object) -> list[dict]:
    if isinstance(value, dict):
        here = [value] if "__class__" in value else []
        return here + [node for entry in value.values() for node in _nodes(entry)]
    return [node for entry in value for node in _nodes(entry)] if isinstance(value, list) else []


def _change_bytes(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    where = rng.randrange(len(changed))
    kind = rng.randrange(4)
    if kind == 0:
        changed[where] ^= 1 << rng.randrange(8)
    elif kind == 1:
        changed[where] = rng.choice(b"0123456789-.eE\xff\0{}[]SL\n")
    elif kind == 2:
        del changed[where : where + rng.choice((1, 2, 4, 8, 100))]
    else:
        changed[where:where] = changed[where : where + rng.choice((1, 4, 100))]
    return bytes(changed)


def _change_list(entries: list, rng: random.Random) -> None:
    where = rng.randrange(len(entries))
    kind = rng.randrange(5)
    if kind == 0:
        del entries[where]
    elif kind == 1:
        entries.insert(where, entries[rng.randrange(len(entries))])
    elif kind == 2:
        entries.insert(where, "")
    elif kind == 3:
        entries[where] = entries[where].partition("=")[0] + rng.choice(("=", "=0", "=-1", "=9999999999", "=nan", "=x"))
    else:
        words = entries[where].split(" ")
        words[rng.randrange(len(words))] = rng.choice(("", "0", "-1", "7", "1e300", "nan"))
        entries[where] = " ".join(words)


def _change_tree(schema: dict, rng: random.Random) -> None:
    nodes = _nodes(schema)
    one, other = rng.choice(nodes), rng.choice(nodes)
    key = rng.choice(list(one))
    kind = rng.randrange(4)
    if kind == 0:
        del one[key]
    elif kind == 1:
        one[key] = rng.choice((None, 0, -1, "", "x", [], {}, 1e300, True))
    elif kind == 2:
        one[key] = json.loads(json.dumps(other.get(key)))
    else:
        changed = json.loads(json.dumps(other))
        one.clear()
        one.update(changed)


def outcome(path: Path) -> str:
    """Load and predict in a child: 'accepted', 'refused', or how else it ended."""
    child = os.fork()
    if child == 0:
        code = 70
        gc.freeze()  # a collection that writes to what the parent made would copy all of it
        try:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))  # a busy machine makes no copy slow
            model = load_model(path, "m")
            rows = np.random.default_rng(0).normal(size=(9, len(model.ir.features)))
            model.predict(rows[valid_rows(model.ir, rows)])
            code = 0
        except StCodegenError:
            code = 2
        except Exception:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return f"signal {os.WTERMSIG(status)}"
    return {0: "accepted", 2: "refused"}.get(os.WEXITSTATUS(status), f"exit {os.WEXITSTATUS(status)}")


def outcomes_of(source: Path, count: int, seed: int) -> Counter[str]:
    """How `count` mutants of a file ended; those that are neither accepted nor refused are kept."""
    data, rng, outcomes = source.read_bytes(), random.Random(seed), Counter[str]()
    path = source.with_name(f"mutant_{source.name}")
    for number in range(count):
        path.write_bytes(mutant(data, rng))
        result = outcome(path)
        outcomes[result] += 1
        if result not in ("accepted", "refused"):
            path.rename(source.with_name(f"bad_{number}_{source.name}"))
    return outcomes


def main(count: int, seed: int, sources: list[Path]) -> None:
    """Print the outcomes of the mutants of each file as JSON."""
    # imported once, not in each child; nothing is loaded here, for threads of a library do not survive a fork
    for library in ("skops.io", "sklearn.ensemble", "lightgbm", "xgboost"):
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    sys.stdout.write(json.dumps({source.stem: outcomes_of(source, count, seed) for source in sources}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), list(map(Path, sys.argv[3:])))
