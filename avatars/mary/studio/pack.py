"""The results: whatever is complete is packed."""

from __future__ import annotations

import shutil

import cv2
import numpy as np

from avatars.mary.studio.boxes import MOUTH
from avatars.mary.studio.images import read_picture, to_bytes
from avatars.mary.studio.motion import IDLE_FRAMES, MOVING_FRAMES
from avatars.mary.studio.mouths import clean_mouths, rendered_frames, set_into, whole_frames
from avatars.mary.studio.textgrid import textgrid
from avatars.mary.studio.video import write_fine, write_lossless
from avatars.mary.studio.visemes import VISEMES
from avatars.mary.studio.workspace import FPS, Workspace, read_json

SHEET = (4, 6)  # rows and columns of the sheet of visemes
MOVING_CRF = 4


def pack(workspace: Workspace) -> None:
    """Write into `products` all that can be made of what has been rendered, and say what that is."""
    if workspace.phones.exists() and workspace.words.exists():
        _pack_labels(workspace)
    if workspace.still.exists() and workspace.weights.exists():
        _pack_recording(workspace)
    if all(workspace.idle(frame).exists() for frame in range(IDLE_FRAMES)):
        frames = (to_bytes(read_picture(workspace.idle(frame))) for frame in range(IDLE_FRAMES))
        write_lossless(workspace.product("idle.mkv"), frames)
        shutil.copy(workspace.idle_pose, workspace.product("pose.json"))
        print(f"idle.mkv, pose.json: {IDLE_FRAMES} frames")
    if all(workspace.moving(frame).exists() for frame in range(MOVING_FRAMES)):
        frames = (to_bytes(read_picture(workspace.moving(frame))) for frame in range(MOVING_FRAMES))
        write_fine(workspace.product("moving_head/clip.mkv"), frames, crf=MOVING_CRF)
        shutil.copy(workspace.moving_pose, workspace.product("moving_head/pose.json"))
        print(f"moving_head: {MOVING_FRAMES} frames")
    if workspace.still.exists() and all(workspace.viseme(name).exists() for name in VISEMES):
        _pack_visemes(workspace)


def _pack_labels(workspace: Workspace) -> None:
    phones = [("" if symbol == "SIL" else symbol, start, end) for symbol, start, end in read_json(workspace.phones)]
    words = [(text.strip(".,!?"), start, end) for text, start, end in read_json(workspace.words)]
    text = textgrid({"words": words, "phones": phones}, phones[-1][2])
    workspace.product("recording.TextGrid").write_text(text, encoding="utf-8")
    print(f"recording.TextGrid: {len(words)} words, {sum(bool(phone) for phone, *_ in phones)} phones")


def _pack_recording(workspace: Workspace) -> None:
    frames = rendered_frames(workspace)
    total = len(workspace.read_mouths().weights)
    shutil.copy(workspace.weights, workspace.product("weights.npz"))
    if frames:
        clean_mouths(workspace, frames)
        write_fine(workspace.product("recording.mp4"), whole_frames(workspace, frames), sound=workspace.sound)
    print(f"recording.mp4: the first {frames} of {total} frames, {frames / FPS:.2f} s")


def _pack_visemes(workspace: Workspace) -> None:
    """All mouth shapes on one sheet, named: for people."""
    still = read_picture(workspace.still)[MOUTH.slices]
    rows, columns = SHEET
    scale, title = 1.6, 18
    width, height = int(MOUTH.width * scale), int(MOUTH.height * scale)
    sheet = np.full((rows * (height + title), columns * width, 3), 20, np.uint8)
    for number, name in enumerate(VISEMES):
        x, y = number % columns * width, number // columns * (height + title)
        mouth = to_bytes(set_into(still, read_picture(workspace.viseme(name))))
        large = cv2.resize(mouth, (width, height), interpolation=cv2.INTER_LANCZOS4)
        sheet[y + title : y + title + height, x : x + width] = large
        cv2.putText(sheet, name, (x + 4, y + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 230, 120), 1, cv2.LINE_AA)
    cv2.imwrite(str(workspace.product("visemes.png")), sheet[..., ::-1])
    print("visemes.png")
