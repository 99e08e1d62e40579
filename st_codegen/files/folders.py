"""Folders that appear whole: completed beside the place where they belong, and put there in one step."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path

from st_codegen.errors import InputError
from st_codegen.files.temporary import sweep, temporary_folder
from st_codegen.files.text import make_folder


def is_device(name: str) -> bool:
    """Whether a name of files or folders is one that Windows keeps for a device, with any suffix."""
    return re.fullmatch(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", name, re.IGNORECASE) is not None


def check_replaceable(folder: Path) -> None:
    """Raise InputError where a folder cannot be replaced by another: it is a file, or a process would stand in it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; a folder is to be written there")
    if folder.exists() and folder.samefile(Path.cwd()):
        raise InputError(f"{folder} is the folder that this command runs in, and would be replaced: name another one")


def replace_folder(new: Path, folder: Path) -> None:
    """Put a folder where another one is or none, in one step; the old one stands beside `new`, or in its place, after.

    Two steps where the system cannot exchange folders. `new` stands in a temporary folder of the same file system.
    """
    if not folder.exists():
        new.rename(folder)
        return
    if _exchange(new, folder):
        return
    old = new.with_name(f"{new.name}.old")
    folder.rename(old)
    try:
        new.rename(folder)
    except OSError:
        old.rename(folder)
        raise


def link_file(path: str | Path, target: str | Path) -> None:
    """A second name for a file where the file system can, else a copy."""
    try:
        os.link(path, target, follow_symlinks=False)
    except OSError:
        shutil.copy2(path, target, follow_symlinks=False)


def keep_others(folder: Path, stage: Path, ours: Collection[str]) -> None:
    """Bring what is in a folder, but for some names, into the one that is to replace it.

    Raises InputError where a new file has the name of one of these.
    """
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        target = stage / path.name
        if path.name in ours:
            continue
        if os.path.lexists(target):
            raise InputError(
                f"{path} is none of the files that are replaced, and a new one has its name: rename or move it"
            )
        if path.is_dir() and not path.is_symlink():
            shutil.copytree(path, target, symlinks=True, copy_function=link_file)
        else:
            link_file(path, target)


def write_texts(folder: Path, texts: Mapping[str, str], folders: Mapping[str, Path] | None = None) -> None:
    """Write files, and move folders (name -> where it was made), into a folder.

    A new folder appears with all of them in one step. In one that exists all are complete before the first appears, and
    each appears whole; what else is in it stays. Raises InputError where a folder has a file's name.
    """
    folders = folders or {}
    folder = Path(os.path.realpath(folder))
    sweep(folder.parent)  # what is left beside it of the run that was to make it
    for name in texts:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder; a file is to be written there")
    exists = folder.exists()
    make_folder(folder if exists else folder.parent)
    with temporary_folder(folder if exists else folder.parent) as made:
        stage = made / "stage"
        stage.mkdir()
        for name, text in texts.items():
            (stage / name).write_text(text, encoding="utf-8", newline="\n")
        for name, path in folders.items():
            path.rename(stage / name)
        if not exists:
            replace_folder(stage, folder)
            return
        for name in folders:
            replace_folder(stage / name, folder / name)
        for name in texts:
            (stage / name).replace(folder / name)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders in one step (Linux renameat2 with RENAME_EXCHANGE); False where that does not exist."""
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):
        return False
    here, exchange = -100, 2
    return bool(call(here, os.fsencode(one), here, os.fsencode(other), exchange) == 0)
