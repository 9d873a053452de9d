from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from app.commands.evaluate_alignment import run
from app.config import Settings
from app.errors import InputError


def test_engines_and_aligners_are_measured(tmp_path: Path) -> None:
    figures, shown = tmp_path / "timing.json", io.StringIO()
    run(Settings(), [], count=2, figures=figures, out=Console(file=shown, width=200), err=Console(file=io.StringIO()))
    rows = json.loads(figures.read_text())
    (calibrated, raw) = [row for row in rows if row["measured"] == "hibari"]
    assert (calibrated["against"], calibrated["calibrated"], calibrated["sentences"]) == ("pocketsphinx", True, 2)
    assert not raw["calibrated"]
    assert calibrated["starts"]["median"] < 25 < raw["starts"]["median"]  # 12 and 44 ms over ten sentences
    assert calibrated["starts"]["count"] > 40
    assert "hibari" in shown.getvalue()


def test_what_cannot_be_measured_is_said(tmp_path: Path) -> None:
    settings = Settings.model_validate({"align": {"engine": "mock"}, "speech": {"engines": {"hibari": {"loud": 1}}}})
    nowhere = Console(file=io.StringIO())
    with pytest.raises(InputError, match="cannot be written"):
        run(settings, [], count=1, figures=tmp_path / "no" / "x.json", out=nowhere, err=nowhere)


def test_the_command_explains_itself() -> None:
    shown = subprocess.run(
        [sys.executable, "-m", "app", "evaluate-alignment", "--help"], capture_output=True, text=True, check=True
    )
    assert "--sentences" in shown.stdout
