"""docs/seeds.md names only what there is, and leaves out no number of the papers."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "seeds.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:app|tests|bench|static|docs)/[^`:\s]+)(?:::([\w.]+))?`", PAGE)))

NUMBERS = {
    "Fu 2011": {
        "eq": {"3.1", "3.2", "3.3", "3.4", "3.5", "4.1"},
        "figure": {"3-1", "3-2", "4-1", "4-2", "4-3", "4-4", "4-5", "5-1", "5-2", "5-3", "5-4"},
        "table": {"4.1", "4.2", "4.3", "5.1", "5.2"},
    },
    "Deena 2010": {
        "eq": {str(number) for number in range(1, 15)},
        "algorithm": {"1", "2"},
        "figure": {"1", "2", "3", "4"},
        "table": {"1"},
    },
    "Wang 2010": {
        "eq": {str(number) for number in range(1, 18)},
        "figure": {str(number) for number in range(1, 11)},
        "table": {"I"},
    },
}


def defined(body: list[ast.stmt]) -> dict[str, list[ast.stmt]]:
    """Names that statements define, with what is inside them."""
    found: dict[str, list[ast.stmt]] = {}
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found[node.name] = node.body
        elif isinstance(node, ast.Assign):
            found |= {target.id: [] for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found[node.target.id] = []
    return found


def test_every_named_file_exists_and_defines_what_is_named() -> None:
    assert len(NAMED) > 80
    for path, name in NAMED:
        assert (ROOT / path).is_file(), path
        if name:
            inside = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
            for part in name.split("."):
                assert part in defined(inside), f"{path} has no {name}"
                inside = defined(inside)[part]


def test_every_link_leads_to_a_page() -> None:
    for target in re.findall(r"\]\(([\w./-]+\.md)\)", PAGE):
        assert (ROOT / "docs" / target).is_file(), target


@pytest.mark.parametrize("seed", NUMBERS)
def test_every_number_has_its_row(seed: str) -> None:
    section = PAGE.split(f"\n## {seed}\n")[1].split("\n## ")[0]
    rows = [line.split("|")[1:-1] for line in section.splitlines() if line.startswith("|")][2:]
    found: dict[str, list[str]] = {kind: [] for kind in NUMBERS[seed]}
    for number, _, where, *rest in rows:
        assert len(rest) == 2, number
        assert where.strip(), number
        kind = number.split()[0].rstrip(".").lower()
        kind = {"fig": "figure"}.get(kind, kind)
        if kind in found:  # appendix A has letters
            its = re.sub(r"\(.*?\)|, (?:with|and) .*", "", number).split(maxsplit=1)[1]
            found[kind] += [each.strip() for each in its.split(",")]
    for kind, numbers in NUMBERS[seed].items():
        assert sorted(found[kind]) == sorted(numbers), kind
