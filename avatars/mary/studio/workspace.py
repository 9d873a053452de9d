"""Where the steps leave their work for each other, and what comes out in the end."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FPS = 25
"""Frames a second of everything."""


@dataclass(frozen=True)
class Mouths:
    """The face controls of every frame of the recording.

    Attributes:
        names: of the C controls.
        weights: (T, C), most of them 0..1.
        lead: seconds by which the lips are ahead of the sound.
    """

    names: tuple[str, ...]
    weights: NDArray[np.float32]
    lead: float

    def controls(self, frame: int) -> dict[str, float]:
        """One frame's, by name."""
        return {name: float(weight) for name, weight in zip(self.names, self.weights[frame], strict=True)}

    def representatives(self) -> list[int]:
        """For each frame the first one with the same mouth (to a thousandth): one picture serves them all."""
        first: dict[bytes, int] = {}
        return [first.setdefault(np.round(row, 3).tobytes(), frame) for frame, row in enumerate(self.weights)]


@dataclass(frozen=True)
class Workspace:
    """A folder, and the names in it.

    Attributes:
        root: the folder; it need not exist.
    """

    root: Path

    @property
    def sound(self) -> Path:
        """Mono, 16 bit."""
        return self.root / "recording/audio.wav"

    @property
    def sentences(self) -> Path:
        """JSON list of text, start, end."""
        return self.root / "recording/transcript.json"

    @property
    def phones(self) -> Path:
        """JSON list of [ARPAbet without stress, start, end]; gapless."""
        return self.root / "recording/phones.json"

    @property
    def words(self) -> Path:
        """JSON list of [word, start, end]."""
        return self.root / "recording/words.json"

    @property
    def weights(self) -> Path:
        """The face controls of every frame."""
        return self.root / "recording/weights.npz"

    @property
    def bake(self) -> Path:
        """Folder of the pictures of her skin."""
        return self.root / "bake"

    @property
    def still(self) -> Path:
        """The whole frame at rest, rendered well."""
        return self.root / "still.png"

    @property
    def smile(self) -> Path:
        """The whole frame with a light smile."""
        return self.root / "smile.png"

    @property
    def positions(self) -> Path:
        """Where in space each pixel of the still is."""
        return self.root / "positions.npz"

    def mouth(self, frame: int) -> Path:
        """The mouth's box of a frame, as rendered."""
        return self.root / f"mouth/{frame:05d}.png"

    def clean_mouth(self, frame: int) -> Path:
        """The same without noise, fitting into the still."""
        return self.root / f"clean_mouth/{frame:05d}.png"

    def blink(self, level: int) -> Path:
        """The eyes' box, the lids closed by `motion.BLINK_LEVELS[level]`."""
        return self.root / f"blink/{level}.png"

    def viseme(self, name: str) -> Path:
        """The mouth's box in one of the shapes of `visemes.VISEMES`."""
        return self.root / f"visemes/{name}.png"

    def idle(self, frame: int) -> Path:
        """A whole frame of the idle loop."""
        return self.root / f"idle/{frame:05d}.png"

    def rendered_idle(self, frame: int) -> Path:
        """The same, rendered instead of made from the still: to compare."""
        return self.root / f"rendered_idle/{frame:05d}.png"

    @property
    def idle_pose(self) -> Path:
        """How the head turns in the loop."""
        return self.root / "idle/pose.json"

    def moving(self, frame: int) -> Path:
        """A whole frame of the clip with the moving head."""
        return self.root / f"moving/{frame:05d}.png"

    @property
    def moving_pose(self) -> Path:
        """How the head moves in that clip."""
        return self.root / "moving/pose.json"

    def product(self, name: str) -> Path:
        """One of the results."""
        path = self.root / "products" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def read_mouths(self) -> Mouths:
        """The controls that `curves` has written."""
        with np.load(self.weights) as file:
            return Mouths(tuple(str(name) for name in file["names"]), file["weights"], float(file["lead"]))


def read_json(path: Path) -> Any:
    """What a JSON file holds."""
    return json.loads(path.read_text(encoding="utf-8"))


def write_json(path: Path, content: Any, *, indent: int | None = None) -> None:
    """Write a JSON file, and its folder if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=indent) + "\n", encoding="utf-8")
