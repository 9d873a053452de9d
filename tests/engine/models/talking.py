"""Sentences whose mouths can be heard: every phone has its pitch, its mouth, and a way there from the one before."""

from __future__ import annotations

import numpy as np

from app.engine.models.model import Spoken
from app.engine.models.sound import Sound
from app.speech import Phone

FPS = 25
RATE = 16_000
FRAMES = 5
"""Of every phone."""
REST = np.zeros(3, np.float32)
MOUTHS = {"SIL": (0, 0, 0), "AA": (8, 2, -1), "B": (-3, 1, 2), "S": (2, -4, 1)}
PITCHES = {"SIL": 0, "AA": 700, "B": 250, "S": 4000}


def talk(*symbols: str, seed: int = 0) -> Spoken:
    """These phones, said once; some louder than others, and then the mouth is wider too."""
    rng = np.random.default_rng(seed)
    seconds = FRAMES / FPS
    phones = tuple(Phone(name, seconds * at, seconds * (at + 1)) for at, name in enumerate(symbols))
    effort = rng.uniform(0.5, 1.5, len(symbols))
    times = np.arange(round(seconds * len(symbols) * RATE)) / RATE
    place = np.minimum((times / seconds).astype(int), len(symbols) - 1)
    tone = np.sin(2 * np.pi * np.array([PITCHES[name] for name in symbols])[place] * times)
    samples = 0.2 * effort[place] * tone + 0.001 * rng.standard_normal(len(times))
    target = np.repeat(np.array([MOUTHS[name] for name in symbols]) * effort[:, None], FRAMES, axis=0)
    padded = np.pad(target, ((1, 1), (0, 0)), mode="edge")
    rows = (padded[:-2] + padded[1:-1] + padded[2:]) / 3 + 0.05 * rng.standard_normal(target.shape)
    return Spoken(phones, rows.astype(np.float32), np.ones(len(rows), bool), Sound(samples.astype(np.float32), RATE))


def talked(count: int) -> list[Spoken]:
    """So many sentences of ten phones between silences."""
    rng = np.random.default_rng(1)
    return [talk("SIL", *rng.choice(["AA", "B", "S"], 10), "SIL", seed=number) for number in range(count)]
