"""Lets several processes share a list of files to make without any of them being made twice."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Whether the file is ours to make: not there yet, and no living process at it. The claim ends with the block."""
    lock = path.with_name(f"{path.name}.lock")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() or not _locked(lock):
        yield False
        return
    try:
        yield not path.exists()
    finally:
        lock.unlink()


def _locked(lock: Path) -> bool:
    try:
        with lock.open("x", encoding="utf-8") as file:
            file.write(str(os.getpid()))
    except FileExistsError:
        if _alive(lock):
            return False
        lock.unlink(missing_ok=True)  # of a process that was stopped
        return _locked(lock)
    return True


def _alive(lock: Path) -> bool:
    try:
        owner = int(lock.read_text(encoding="utf-8") or os.getpid())  # empty: being written at this moment
        os.kill(owner, 0)
    except (FileNotFoundError, ProcessLookupError):
        return False
    except PermissionError:
        return True
    return True
