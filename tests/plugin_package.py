"""A package as a third party would install it, with plug-ins of one kind."""

from __future__ import annotations

from pathlib import Path

import pytest


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, group: str, name: str, base: str) -> None:
    """Entry points: `name`, which works; "stone", which is something else; "lost", whose library is not there.

    Args:
        folder: empty, for the package's files.
        monkeypatch: lets it be found until the end of the test.
        group: of the entry points.
        name: of the plug-in that works.
        base: "module.Class" of ours that it is like.
    """
    module, _, class_name = base.rpartition(".")
    ours = f"{group.replace('.', '_')}_{name}"  # modules stay loaded: no other test's
    (folder / f"{ours}.py").write_text(
        f"from {module} import {class_name}\n\n"
        f"class Theirs({class_name}):\n    name = {name!r}\n\n"
        "class Stone:\n    name = 'stone'\n"
    )
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    points = [f"{name} = {ours}:Theirs", f"stone = {ours}:Stone", "lost = no_such_library:Nothing"]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *points, ""]))
    monkeypatch.syspath_prepend(str(folder))
