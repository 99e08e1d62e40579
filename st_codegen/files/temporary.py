"""Temporary folders beside what is being written, which the next run removes where a run was killed.

The process that uses such a folder holds a lock on it, which the system takes back when the process ends in any way: a
folder that can be locked belongs to nobody. Where folders cannot be locked (Windows, some network disks) they stay.
"""

from __future__ import annotations

import errno
import importlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Python's module of locks that the system takes back, where there is one.
_locks = importlib.import_module("fcntl") if os.name == "posix" else None

PREFIX = ".st-codegen-"

#: What a disk says in the middle of a write, when the system names no file. Other languages give no number.
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, None)

#: Folders in which this process has looked for what killed runs left: once each, for some hold thousands of files.
_swept: set[Path] = set()


@contextmanager
def temporary_folder(parent: Path, becomes: Path | None = None) -> Iterator[Path]:
    """A new folder in `parent`, which must exist; it is gone when the block ends. Removes those of killed runs.

    An error of the disk names `becomes`, which is being made there, or `parent`: the new folder tells nobody anything.
    """
    place = parent.resolve()
    with errors_of_disk(becomes or parent, place):
        sweep(place)
        path, lock = _made(place)
    try:
        with errors_of_disk(becomes or parent, path):
            yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        if lock is not None:
            os.close(lock)


@contextmanager
def held(path: Path, text: str) -> Iterator[bool]:
    """Whether a file, made with `text` where it is missing, is held by no other process; then this one holds it.

    It is not handed to processes that this one starts, which may outlive it. Where files cannot be locked nobody holds.
    A lock of POSIX ends when this process closes the file that it is of, also where another function had opened it.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if os.fstat(descriptor).st_size == 0:
            with errors_of_disk(path):
                os.write(descriptor, text.encode())
        if _locks is not None:
            try:
                _locks.lockf(descriptor, _locks.LOCK_EX | _locks.LOCK_NB)
            except OSError as error:
                if error.errno in (errno.EACCES, errno.EAGAIN):
                    yield False
                    return
        yield True
    finally:
        os.close(descriptor)


@contextmanager
def errors_of_disk(name: Path, inside: Path | None = None) -> Iterator[None]:
    """Errors of the disk without a file's name, or with one of a file `inside` a folder, get another name."""
    try:
        yield
    except OSError as error:
        unnamed = error.filename is None and error.errno in _DISK_ERRORS
        if unnamed or (inside is not None and Path(str(error.filename)).is_relative_to(inside)):
            error.filename, error.filename2 = name, None
        raise


def sweep(parent: Path) -> None:
    """Remove the temporary folders that killed runs left in a folder."""
    if parent not in _swept:
        _swept.add(parent)
        for left in parent.glob(f"{PREFIX}*"):
            _remove_stale(left)


def _made(parent: Path) -> tuple[Path, int | None]:
    """A new folder and its lock; made again where another run took it for a stale one before it was locked."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        if _locks is None:
            return path, None
        try:
            lock = os.open(path, os.O_RDONLY)
        except FileNotFoundError:
            continue
        try:
            _locks.flock(lock, _locks.LOCK_EX)
        except OSError:  # nobody can lock it, so nobody takes it for stale
            return path, lock
        if _is_at(lock, path):
            return path, lock
        os.close(lock)


def _remove_stale(path: Path) -> None:
    """Remove a folder unless a process that still runs has locked it."""
    if _locks is None or path.is_symlink() or not path.is_dir():
        return
    try:
        lock = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return
    try:
        _locks.flock(lock, _locks.LOCK_EX | _locks.LOCK_NB)
        if _is_at(lock, path):
            shutil.rmtree(path, ignore_errors=True)
    except OSError:  # locked, or cannot be
        pass
    finally:
        os.close(lock)


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether an open folder is still the one of this path."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False
