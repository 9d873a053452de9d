from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.models.mfcc import COUNT, FILTERS, FLOOR, HIGHEST, LOWEST, PRE_EMPHASIS, RATE, mel, mfcc

Float = NDArray[np.float32]


@pytest.fixture(scope="module")
def noise() -> Float:
    random = np.random.default_rng(3)
    tone = 0.3 * np.sin(2 * np.pi * 440 * np.arange(RATE // 2) / RATE)
    return (tone + 0.1 * random.standard_normal(RATE // 2)).astype(np.float32)


def written_out(samples: Float, centre: float, window: float) -> list[float]:
    """One vector by the definition, sum by sum: no transform, no matrix."""
    emphasised = [
        float(each) - (PRE_EMPHASIS * float(samples[at - 1]) if at else 0.0) for at, each in enumerate(samples)
    ]
    length = round(window * RATE)
    first = round(centre * RATE) - length // 2
    size = 1
    while size < length:
        size *= 2
    cut = []
    for at in range(length):
        inside = 0 <= first + at < len(emphasised)
        weight = 0.54 - 0.46 * math.cos(2 * math.pi * at / (length - 1))
        cut.append((emphasised[first + at] if inside else 0.0) * weight)
    power = []
    for number in range(size // 2 + 1):
        angle = -2 * math.pi * number / size
        real = sum(each * math.cos(angle * at) for at, each in enumerate(cut))
        imaginary = sum(each * math.sin(angle * at) for at, each in enumerate(cut))
        power.append((real * real + imaginary * imaginary) / size)
    low, high = (2595 * math.log10(1 + edge / 700) for edge in (LOWEST, HIGHEST))
    edges = [700 * (10 ** ((low + (high - low) * at / (FILTERS + 1)) / 2595) - 1) for at in range(FILTERS + 2)]
    loud = []
    for at in range(FILTERS):
        left, middle, right = edges[at : at + 3]
        total = 0.0
        for number, each in enumerate(power):
            hertz = number * RATE / size
            if left < hertz <= middle:
                total += each * (hertz - left) / (middle - left)
            elif middle < hertz < right:
                total += each * (right - hertz) / (right - middle)
        loud.append(math.log(max(total, FLOOR)))
    found = []
    for number in range(COUNT):
        total = sum(each * math.cos(math.pi * number * (2 * at + 1) / (2 * FILTERS)) for at, each in enumerate(loud))
        found.append(total * math.sqrt((1 if number == 0 else 2) / FILTERS))
    return found


@pytest.mark.parametrize(("centre", "window"), [(0.2, 0.025), (0.0, 0.025), (0.497, 0.04)])
def test_a_vector_is_what_the_definition_says(noise: Float, centre: float, window: float) -> None:
    (row,) = mfcc(noise, np.array([centre]), window=window)
    np.testing.assert_allclose(row, written_out(noise, centre, window), atol=2e-4)


def test_silence_has_the_floor_and_nothing_else() -> None:
    rows = mfcc(np.zeros(RATE, np.float32), np.arange(5) / 10)
    np.testing.assert_allclose(rows[:, 0], math.log(FLOOR) * math.sqrt(FILTERS), rtol=1e-6)
    np.testing.assert_allclose(rows[:, 1:], 0, atol=1e-4)


@pytest.mark.parametrize("centre", [-3.0, 90.0])
def test_far_outside_there_is_silence(noise: Float, centre: float) -> None:
    assert np.array_equal(mfcc(noise, np.array([centre])), mfcc(np.zeros(8, np.float32), np.array([0.0])))


def test_no_moments_and_no_sound(noise: Float) -> None:
    assert mfcc(noise, np.zeros(0)).shape == (0, COUNT)
    assert mfcc(noise[:0], np.array([0.1])).shape == (1, COUNT)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.2, 20), st.integers(0, 2**31))
def test_loudness_moves_the_first_coefficient_alone(gain: float, seed: int) -> None:
    samples = np.random.default_rng(seed).uniform(-0.5, 0.5, RATE // 4).astype(np.float32)
    centres = np.arange(1, 5) / 25
    quiet, loud = mfcc(samples, centres), mfcc(samples * np.float32(gain), centres)
    np.testing.assert_allclose(loud[:, 1:], quiet[:, 1:], atol=2e-3)
    np.testing.assert_allclose(loud[:, 0] - quiet[:, 0], 2 * math.log(gain) * math.sqrt(FILTERS), atol=2e-3)


def test_mel_is_that_of_the_textbooks() -> None:
    np.testing.assert_allclose(mel(np.array([0.0, 1000.0])), [0.0, 1000.0], atol=0.02)
