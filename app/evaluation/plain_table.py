"""The look that all tables of an evaluation share."""

from __future__ import annotations

from rich.table import Table


def plain_table(*columns: str, title: str = "", names: int = 22) -> Table:
    """A table without lines: names on the left, at least so many characters wide, figures on the right."""
    table = Table(title=title, box=None, pad_edge=False, title_justify="left", title_style="bold")
    for number, column in enumerate(columns):
        table.add_column(
            column, justify="right" if number else "left", no_wrap=number > 0, min_width=0 if number else names
        )
    return table
