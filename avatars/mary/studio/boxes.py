"""The picture's size, and the parts of it that are rendered by themselves."""

from __future__ import annotations

from dataclasses import dataclass

FRAME = 512  # pixels, both ways


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of the picture, pixels from its upper left corner."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)


MOUTH = Box(168, 268, 176, 148)
"""Where the recording moves: mouth, cheeks, jaw."""

EYES = Box(160, 188, 192, 76)
"""Where a blink moves."""
