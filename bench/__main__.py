"""`python -m bench [NAME ...]`: run the benchmarks, print their tables, write `bench/results.json`."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from rich.console import Console

from bench.report import Report, machine, save

BENCHES = {
    "engine": "frames a second, fast against reference, threads against processes",
    "trajectory": "Fu 2011's table 4.3, banded against dense",
    "picture": "against the recording: closed and open test, sharpness, lip closure",
    "talker": "a real talker from end to end: time, memory, unheard sentences (needs recordings)",
    "speech": "engines and aligners: first audio, phone times, what they hold up",
    "recogniser": "phones without a transcript: a real talker (needs GRID) and a voice, whole and live",
    "sync": "a minute of speech: where its tracks end",
    "seams": "idle clip to live picture and back in Chromium: phase, standstill, jumps; stop() to a closed mouth",
    "latency": "Enter to the first live frame in Chromium, 10 and 300 words",
    "conversation": "live text, word events and interruptions, as a viewer over HTTP-FLV gets them",
    "session": "MARY_BENCH_MINUTES (10) of talk and three viewers: offset of sound and picture, memory",
}


def main(names: list[str]) -> int:
    """Run the named benchmarks, or all; 1 if a bar was missed, 2 for an unknown name."""
    console = Console(width=160)
    unknown = [name for name in names if name not in BENCHES]
    if unknown:
        known = "\n".join(f"  {name:12} {what}" for name, what in BENCHES.items())
        console.print(f"there is no benchmark {unknown[0]!r}; known:\n{known}", highlight=False)
        return 2
    console.print(machine(), highlight=False)
    reports: list[Report] = []
    for name in names or BENCHES:
        for report in importlib.import_module(f"bench.{name}").run():
            report.show(console)
            reports.append(report)
    save(reports, Path(__file__).parent / "results.json")
    missed = [figure for report in reports for figure in report.figures if figure.passed is False]
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
