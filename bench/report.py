"""What a benchmark hands back: figures with the bar each has to pass, as a table and as JSON."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True)
class Figure:
    """One measured number.

    Attributes:
        name: what was measured.
        value: the number.
        unit: its unit.
        bar: what it must reach, with the direction: ">= 400" or "<= 30"; empty if it is for information.
        note: the baseline or the thesis's figure.
    """

    name: str
    value: float
    unit: str
    bar: str = ""
    note: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the bar is reached; None without one."""
        if not self.bar:
            return None
        relation, limit = self.bar.split()
        return self.value >= float(limit) if relation == ">=" else self.value <= float(limit)


@dataclass
class Report:
    """The figures of one benchmark."""

    name: str
    title: str
    figures: list[Figure] = field(default_factory=list)

    def add(self, name: str, value: float, unit: str, bar: str = "", note: str = "") -> None:
        """Append a figure."""
        self.figures.append(Figure(name, float(value), unit, bar, note))

    def show(self, console: Console) -> None:
        """Print the figures as a table."""
        table = Table(title=self.title, title_justify="left")
        for column in ("figure", "value", "unit", "must be", "", "beside it"):
            table.add_column(column, justify="right" if column == "value" else "left")
        for figure in self.figures:
            mark = {True: "[green]ok[/]", False: "[red]missed[/]", None: ""}[figure.passed]
            table.add_row(figure.name, f"{figure.value:.4g}", figure.unit, figure.bar, mark, figure.note)
        console.print(table)


def machine() -> dict[str, object]:
    """What the figures were measured on."""
    model = platform.processor()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    return {"cores": os.cpu_count(), "processor": model, "python": platform.python_version()}


def save(reports: list[Report], path: Path) -> None:
    """Write the figures as JSON, beside its place and then moved there."""
    content = {"machine": machine(), "reports": [asdict(report) for report in reports]}
    draft = path.with_suffix(".part")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    draft.replace(path)
