"""Shows how far long work is and how long it will take: a bar on a terminal, a line a step elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

FIRST_ESTIMATE = 0.04
"""Share of the work after which the time left can be told."""


class LongWork:
    """Told of steps and their shares; knows the share of the whole.

    Args:
        shares: of each step in the time of the whole, in order; they need not add up to one.
    """

    def __init__(self, shares: Mapping[str, float]) -> None:
        total = sum(shares.values())
        self._width = {name: share / total for name, share in shares.items()}
        self._begin: dict[str, float] = {}
        at = 0.0
        for name, width in self._width.items():
            self._begin[name] = at
            at += width
        self.done = 0.0
        self.step = ""

    def tell(self, step: str, share: float) -> None:
        """Take note of a step's progress; the whole never goes back."""
        self.step = step
        if step in self._begin:
            self.done = max(self.done, self._begin[step] + self._width[step] * min(share, 1.0))

    def left(self, elapsed: float) -> float | None:
        """Seconds left after so many; None before that can be told."""
        if self.done < FIRST_ESTIMATE:
            return None
        return elapsed * (1 - self.done) / self.done


def told(seconds: float | None) -> str:
    """A time left, as people say it."""
    if seconds is None:
        return ""
    if seconds < 90:
        return f"about {max(5, round(seconds / 5) * 5)} s left"
    return f"about {round(seconds / 60)} min left"


@contextmanager
def shown(console: Console, work: LongWork) -> Iterator[LongWork]:
    """Show the work while it goes on."""
    begin = time.monotonic()
    if not console.is_terminal:
        yield _Lines(console, work, begin)
        return
    columns = (
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("starting", total=1.0, left="")
        yield _Bar(progress, task, work, begin)


class _Bar(LongWork):
    def __init__(self, progress: Progress, task: object, work: LongWork, begin: float) -> None:
        self.__dict__.update(work.__dict__)
        self._progress, self._task, self._start = progress, task, begin

    def tell(self, step: str, share: float) -> None:
        super().tell(step, share)
        left = told(self.left(time.monotonic() - self._start))
        self._progress.update(self._task, description=step, completed=self.done, left=left)  # type: ignore[arg-type]


class _Lines(LongWork):
    def __init__(self, console: Console, work: LongWork, begin: float) -> None:
        self.__dict__.update(work.__dict__)
        self._console, self._start = console, begin

    def tell(self, step: str, share: float) -> None:
        new = step != self.step
        super().tell(step, share)
        if new:
            left = told(self.left(time.monotonic() - self._start))
            self._console.print(f"mary: {step}" + (f" ({left})" if left else ""), highlight=False)
