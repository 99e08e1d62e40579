"""Two states of a folder for `diff`: two folders, or one folder in two revisions of git."""

from __future__ import annotations

import io
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from st_codegen.emit.output import MANIFEST
from st_codegen.errors import InputError
from st_codegen.files.temporary import temporary_folder


@contextmanager
def two_states(old: str, new: str, path: Path | None, *, trust_pickle: bool = False) -> Iterator[tuple[Path, Path]]:
    """Two generated folders: `old` and `new` themselves, or what `path` was in the revisions of these names.

    A folder of models is compiled for TwinCAT in both states, the second one over the first one's layouts. Raises
    InputError where git has no such revision or path.
    """
    if path is None:
        if missing := [name for name in (old, new) if not Path(name).exists()]:
            raise InputError(
                f"{' and '.join(missing)}: no such folder; to compare revisions of git, name the folder behind them: "
                f"st-codegen diff {old} {new} FOLDER"
            )
        yield Path(old), Path(new)
        return
    with temporary_folder(Path(tempfile.gettempdir())) as made:
        folders = [_extracted(revision, path, made / side) for revision, side in ((old, "old"), (new, "new"))]
        if not all(any(folder.rglob(MANIFEST)) for folder in folders):
            folders = _compiled(folders, made, trust_pickle=trust_pickle)
        yield folders[0], folders[1]


def _extracted(revision: str, path: Path, target: Path) -> Path:
    """What a folder was in a revision, as files below `target`."""
    where = path if path.is_dir() else path.parent
    if not where.is_dir():
        raise InputError(f"{path}: no such folder; run this in the repository")
    name = "." if path.is_dir() else f"./{path.name}"
    try:
        # no revision is taken for an option
        done = subprocess.run(
            ["git", "-C", str(where), "archive", "--format=tar", "--end-of-options", revision, name],
            capture_output=True,
            check=False,
        )
    except FileNotFoundError:
        raise InputError("comparing revisions needs git, which is not installed; give two folders") from None
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().removeprefix("fatal: ")
        raise InputError(f"git has no {path} of revision '{revision}': {reason}")
    target.mkdir()
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        try:
            archive.extractall(target, filter="data")
        except tarfile.FilterError as error:  # a link that leads out of the folder
            only = "only what is below the folder is compared"
            raise InputError(f"{path} of revision '{revision}': {error}; {only}") from None
    return target


def _compiled(folders: list[Path], stage: Path, *, trust_pickle: bool) -> list[Path]:
    from st_codegen.driver import generate
    from st_codegen.project.bundle import load

    results: list[Path] = []
    for folder in folders:
        out = stage / f"{folder.name}-generated"
        if results:
            shutil.copytree(results[-1], out)
        generate(load(folder, trust_pickle=trust_pickle), "twincat", out)
        results.append(out)
    return results
