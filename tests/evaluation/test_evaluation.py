from __future__ import annotations

import io
import json

from invented import invented
from rich.console import Console

from app.evaluation.comparison_tables import comparison_tables, sizes_table
from app.evaluation.evaluation import VERSION
from app.evaluation.tables import tables


def test_the_machine_readable_form_holds_every_figure() -> None:
    found = json.loads(json.dumps(invented("open", "closed").as_dict(), allow_nan=False))
    assert found["version"] == VERSION
    assert found["avatar"] == "nobody"
    assert set(found["tests"]) == {"open", "closed"}
    scores = found["tests"]["open"]
    assert scores["trajectories"][0]["scores"]["error_weighted"] == 0.4
    assert scores["reconstruction"]["speech"]["serving"]["psnr"] == 40
    assert scores["reconstruction"]["speech"]["literal"] is None
    assert scores["gains"][1]["psnr"] is None  # not a number
    assert scores["closure"] == {"recorded": 1.0, "shown": 0.75, "phones": 4}
    assert {bar["figure"]: bar["met"] for bar in scores["bars"]}["serving model, dB"]
    assert not {bar["figure"]: bar["met"] for bar in scores["bars"]}["literal model, dB"]
    rows = {row["model"]: row for row in scores["comparison"]["rows"]}
    assert list(rows) == ["rest", "gaussian", "analysed"]
    assert rows["gaussian"]["scores"]["trajectory"]["error"] == 0.6
    assert rows["gaussian"]["rendered"][1]["renderer"] == "reference"
    assert rows["rest"]["scores"]["unclosed"] is None
    assert [point["scores"] is None for point in found["sizes"]] == [True, False, False]
    assert found["words"]["inner"]["median"] == 20
    assert found["refused"][0] == {"take": "clip 4", "frame": None, "reason": "it has no transcript"}
    assert found["notes"] == ["Only an open test."]


def test_the_tables_say_what_was_found() -> None:
    console = Console(file=io.StringIO(), width=150)
    for each in tables(invented("open", "closed")):
        console.print(each)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    for words in (
        "nobody, open test: 2 clips, 2 sentences, 80 frames, 40 of them speech", "nobody, closed test", "0.600 ± 0.100",
        "40.00 dB", "75%", "open test: trajectories in the common space", "0.600±0.100", "0.300±0.100",
        "analysed (ceiling), reference", "33.25",
        "25% of 4", "62.5", "64.0", "closed test: motion", "too few",
        "not measured", "it has no transcript", "the face was lost", "-5", "Only an open test.",
    ):  # fmt: skip
        assert words in text, words


def test_the_tables_of_models_fit_a_narrow_terminal() -> None:
    found = invented("open").measured
    for each in (*comparison_tables(found.comparisons[0]), sizes_table(found.sizes)):
        console = Console(file=io.StringIO(), width=80)
        console.print(each)
        text = console.file.getvalue()  # type: ignore[attr-defined]
        assert "…" not in text
        assert max(len(line) for line in text.splitlines()) <= 80
