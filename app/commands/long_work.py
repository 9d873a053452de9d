"""Shows how far long work is and how long it will take: a bar on a terminal, a line a step elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

FIRST_ESTIMATE = 0.04
"""Share of the work after which the time left can be told."""


class LongWork:
    """Told of steps and their shares; knows the share of the whole.

    Args:
        shares: of each step in the time of the whole, in order; they need not add up to one.

    Attributes:
        step, done: what was told last, and the share of the whole.
        new: whether the step has just begun.
        news: called after each `tell`.
    """

    def __init__(self, shares: Mapping[str, float]) -> None:
        self.news: Callable[[LongWork], None] = lambda _: None
        total = sum(shares.values())
        self._width = {name: share / total for name, share in shares.items()}
        self._begin: dict[str, float] = {}
        at = 0.0
        for name, width in self._width.items():
            self._begin[name] = at
            at += width
        self.done = 0.0
        self.step = ""
        self.new = False

    def tell(self, step: str, share: float) -> None:
        """Take note of a step's progress; the whole never goes back."""
        self.new, self.step = step != self.step, step
        if step in self._begin:
            self.done = max(self.done, self._begin[step] + self._width[step] * min(share, 1.0))
        self.news(self)

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

        def print_line(now: LongWork) -> None:
            if now.new:
                left = told(now.left(time.monotonic() - begin))
                console.print(f"mary: {now.step}" + (f" ({left})" if left else ""), highlight=False)

        work.news = print_line
        yield work
        return
    columns = (
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("starting", total=1.0, left="")

        def move_bar(now: LongWork) -> None:
            left = told(now.left(time.monotonic() - begin))
            progress.update(task, description=now.step, completed=now.done, left=left)

        work.news = move_bar
        yield work
