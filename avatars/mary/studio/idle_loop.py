"""The idle loop: the still, moved. Every frame has real parallax, because every pixel's place in space is known, and
none has a renderer's noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.boxes import EYES, FRAME
from avatars.mary.studio.camera import Camera
from avatars.mary.studio.head import HeadPose, head_weight, pivot, turned
from avatars.mary.studio.images import Picture, read_picture, write_picture
from avatars.mary.studio.landmarks import NEAR, pixels, rounded
from avatars.mary.studio.motion import BLINK_LEVELS, IDLE_FRAMES, idle_motion
from avatars.mary.studio.mouths import edge_ramp
from avatars.mary.studio.smoothstep import smoothstep
from avatars.mary.studio.workspace import FPS, Workspace, write_json

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]

SHIRT, BODY, HEAD = range(3)
NOTHING = 9.0  # m: farther than anything
STEP = 0.012  # m: a larger jump in depth is an edge
MAP_STEP = 4  # pixels between the nodes of the dense map that is kept
NOTE = (
    "l/r = her left/right; pixel coordinates, y down; head rotation R=Ry(yaw)Rx(pitch)Rz(roll) in degrees about pivot"
)


@dataclass(frozen=True)
class _Scene:
    """The still in space.

    Attributes:
        position: (H, W, 3) dm, NaN on the backdrop.
        cover: (H, W) how much of a pixel the figure covers.
        head: (H, W) how far a pixel goes along with the head.
        breath: (H, W) and with breathing.
        camera, neck: as they were.
    """

    position: Array
    cover: Picture
    head: Array
    breath: Array
    camera: Camera
    neck: Array

    @property
    def solid(self) -> NDArray[np.bool_]:
        """(H, W) pixels of the figure."""
        return ~np.isnan(self.position[..., 0])

    @classmethod
    def read(cls, workspace: Workspace) -> _Scene:
        with np.load(workspace.positions) as file:
            position, cover, part, neck = (file[name] for name in ("position", "cover", "part", "neck"))
            camera = Camera(file["view"], float(file["focal"]))
        parts = [part == SHIRT, part == BODY]
        head = np.select(parts, [np.zeros_like(cover, np.float64), head_weight(position, neck)], 1.0)
        chest = 1 - smoothstep(neck[1] - 0.5, neck[1] + 0.2, position[..., 1])
        breath = np.select(parts, [np.ones_like(chest), chest], 0.0)
        return cls(position, cover.astype(np.float32), head, breath, camera, neck)


def make_idle(workspace: Workspace, frames: range = range(IDLE_FRAMES)) -> None:
    """Write frames of the loop, its pose, and the dense map from the still to each of the frames."""
    scene = _Scene.read(workspace)
    still = read_picture(workspace.still)
    plate = _plate(still, scene.cover)
    marks = _landmarks(scene)
    lids = _Lids(workspace, still, marks)
    edges = _Edges(scene)
    maps = np.zeros((IDLE_FRAMES, FRAME // MAP_STEP, FRAME // MAP_STEP, 2), np.float16)
    for frame in frames:
        motion = idle_motion(frame)
        back = _backward(scene, edges, motion.head, motion.breath)
        maps[frame] = back[::MAP_STEP, ::MAP_STEP]
        write_picture(workspace.idle(frame), _moved(lids.picture(motion.blink), scene.cover, plate, back))
    _write_pose(workspace, scene, marks)
    np.savez_compressed(workspace.idle_pose.with_name("warp.npz"), warp=maps, step=MAP_STEP)


def _write_pose(workspace: Workspace, scene: _Scene, marks: Array) -> None:
    names = list(NEAR)
    poses = []
    for frame in range(IDLE_FRAMES):
        motion = idle_motion(frame)
        head = motion.head
        points, _ = scene.camera.project(turned(marks, head, scene.neck), FRAME)
        angles = {"yaw": round(head.yaw, 4), "pitch": round(head.pitch, 4), "roll": round(head.roll, 4)}
        blink = BLINK_LEVELS[_level(motion.blink)]
        poses.append({"frame": frame, **angles, "blink": blink, "landmarks": rounded(names, points)})
    content = {
        "fps": FPS,
        "frames": IDLE_FRAMES,
        "loop": f"frame {IDLE_FRAMES} == frame 0",
        "size": FRAME,
        "pivot_dm": pivot(scene.neck).tolist(),
        "note": NOTE,
        "neutral": rounded(names, scene.camera.project(marks, FRAME)[0]),
        "poses": poses,
    }
    write_json(workspace.idle_pose, content)


def _landmarks(scene: _Scene) -> Array:
    """(n, 3) the places of the landmarks' pixels, dm."""
    places = [scene.position[row, column] for column, row in pixels(scene.camera).values()]
    return np.where(np.isnan(places), list(NEAR.values()), places)


def _level(blink: float) -> int:
    """The rendered closure that is nearest: a mix of two would show two lids."""
    return round(blink * (len(BLINK_LEVELS) - 1))


class _Lids:
    """The still with the eyes closed more or less."""

    def __init__(self, workspace: Workspace, still: Picture, marks: Array) -> None:
        """Args: marks (n, 3) landmarks, dm."""
        self._still = still
        self._levels = [read_picture(workspace.blink(level)) for level in range(len(BLINK_LEVELS))]
        camera = _Scene.read(workspace).camera
        points = rounded(list(NEAR), camera.project(marks, FRAME)[0])
        x, y = np.meshgrid(np.arange(EYES.width, dtype=np.float32), np.arange(EYES.height, dtype=np.float32))
        mask = np.zeros((EYES.height, EYES.width))
        for side in "lr":
            corners = np.array([points[f"eye_{side}_in"], points[f"eye_{side}_out"]])
            centre = corners.mean(0) - [EYES.x, EYES.y]
            radius = np.sqrt(((x - centre[0]) / 37) ** 2 + ((y - centre[1] + 3) / 29) ** 2)
            mask = np.maximum(mask, 1 - smoothstep(0.72, 1.0, radius))
        self._mask = (mask * edge_ramp(EYES.width, EYES.height, 10))[..., None].astype(np.float32)

    def picture(self, blink: float) -> Picture:
        """The whole frame."""
        picture = self._still.copy()
        if _level(blink):
            eyes = picture[EYES.slices]
            picture[EYES.slices] = eyes * (1 - self._mask) + self._levels[_level(blink)] * self._mask
        return picture


def _plate(still: Picture, cover: Picture) -> Picture:
    """(H, W, 3) the backdrop without the figure: a polynomial of the sixth degree through what is seen of it."""
    y, x = (np.mgrid[0:FRAME, 0:FRAME] - FRAME / 2) / FRAME * 2
    terms = np.stack([x**i * y**j for i in range(7) for j in range(7 - i)], -1)
    seen = cv2.dilate((cover > 0.004).astype(np.uint8), np.ones((13, 13))) == 0
    channels = [terms @ np.linalg.lstsq(terms[seen], still[..., at][seen], rcond=None)[0] for at in range(3)]
    return np.stack(channels, -1).astype(np.float32)


class _Edges:
    """Pixels whose motion is another pixel's: of the backdrop, and those that show two surfaces at once."""

    def __init__(self, scene: _Scene) -> None:
        self.origin, depth = scene.camera.project(scene.position, FRAME)
        number = np.arange(FRAME * FRAME).reshape(FRAME, FRAME)
        self.nearest_solid = _nearest(scene.solid)
        depth = np.where(scene.solid, depth, NOTHING).astype(np.float32)
        near = cv2.erode(depth, np.ones((5, 5)))
        self.mixed = (depth - near > STEP) & scene.solid & (cv2.dilate(depth, np.ones((3, 3))) < NOTHING - 1)
        self.nearer_surface = number.copy()  # mixed pixels travel with the nearer surface
        for down in range(-2, 3):
            for across in range(-2, 3):
                shifted = np.roll(depth, (down, across), (0, 1))
                source = np.roll(number, (down, across), (0, 1))
                take = self.mixed & (np.abs(shifted - near) < 1e-6)
                self.nearer_surface[take] = source[take]


def _nearest(there: NDArray[np.bool_]) -> Numbers:
    """(H, W) number of the nearest pixel that is there."""
    _, labels = cv2.distanceTransformWithLabels(
        (~there).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    source = np.zeros(labels.max() + 1, np.intp)
    source[labels[there]] = np.flatnonzero(there.ravel())
    return cast(Numbers, source[labels])


def _backward(scene: _Scene, edges: _Edges, head: HeadPose, breath: float) -> Picture:
    """(H, W, 2) pixels: from each pixel of the moved frame to what it shows of the still.

    The forward motion is known for every pixel of the still; it is drawn at double resolution, the farthest first, and
    what no pixel reaches takes the motion of the farther neighbour in its row.
    """
    place = turned(scene.position, head, scene.neck, scene.head)
    place = place + np.stack([np.zeros_like(scene.breath), scene.breath * breath * 10, np.zeros_like(scene.breath)], -1)
    target, depth = scene.camera.project(place, FRAME)
    motion = (target - edges.origin).reshape(-1, 2)[edges.nearest_solid].astype(np.float32)
    motion = np.stack([cv2.medianBlur(np.ascontiguousarray(motion[..., axis]), 5) for axis in (0, 1)], -1)
    motion = motion.reshape(-1, 2)[edges.nearer_surface]
    depth = np.where(scene.solid, depth, NOTHING).astype(np.float32)
    nearer = cv2.erode(depth, np.ones((5, 5))) + np.where(edges.mixed, 1e-4, NOTHING).astype(np.float32)
    drawn, drawn_depth = _splat(motion, np.minimum(depth, nearer))
    _fill_rows(drawn, drawn_depth)
    hole = np.isnan(drawn[..., 0])
    if hole.any():
        drawn = drawn.reshape(-1, 2)[_nearest(~hole)]
    smooth = [
        cv2.GaussianBlur(cv2.medianBlur(np.ascontiguousarray(drawn[..., axis]), 3), (0, 0), 0.6) for axis in (0, 1)
    ]
    return cast(Picture, -np.stack(smooth, -1))


def _splat(motion: Picture, depth: Picture) -> tuple[Picture, Picture]:
    """Motion (H, W, 2) and depth (H, W) at the pixels they lead to; NaN where none does. The nearest surface wins."""
    double = (2 * FRAME, 2 * FRAME)
    fine = cv2.resize(motion, double, interpolation=cv2.INTER_LINEAR)
    fine_depth = cv2.resize(depth, double, interpolation=cv2.INTER_NEAREST)
    y, x = (np.mgrid[0 : 2 * FRAME, 0 : 2 * FRAME] + 0.5) / 2 - 0.5
    column, row = np.rint(x + fine[..., 0]).astype(int), np.rint(y + fine[..., 1]).astype(int)
    inside = (column >= 0) & (column < FRAME) & (row >= 0) & (row < FRAME)
    order = np.argsort(-fine_depth[inside], kind="stable")
    target = (row[inside] * FRAME + column[inside])[order]
    drawn = np.full((FRAME * FRAME, 2), np.nan, np.float32)
    drawn_depth = np.full(FRAME * FRAME, np.nan, np.float32)
    drawn[target], drawn_depth[target] = fine[inside][order], fine_depth[inside][order]
    return drawn.reshape(FRAME, FRAME, 2), drawn_depth.reshape(FRAME, FRAME)


def _fill_rows(drawn: Picture, depth: Picture) -> None:
    """What has come into view takes the motion of what is farther away, left or right of it."""
    hole = np.isnan(depth)
    if not hole.any():
        return
    column = np.broadcast_to(np.arange(FRAME), hole.shape)
    left = np.maximum.accumulate(np.where(hole, -1, column), 1)
    right = np.minimum.accumulate(np.where(hole, FRAME, column)[:, ::-1], 1)[:, ::-1]
    row = np.arange(FRAME)[:, None]
    left_depth = np.where(left >= 0, depth[row, left.clip(0)], -1)
    right_depth = np.where(right < FRAME, depth[row, right.clip(0, FRAME - 1)], -1)
    source = np.where(left_depth >= right_depth, left.clip(0), right.clip(0, FRAME - 1))
    known = hole & (np.maximum(left_depth, right_depth) > 0)
    drawn[known] = drawn[np.nonzero(known)[0], source[known]]


def _moved(picture: Picture, cover: Picture, plate: Picture, back: Picture) -> Picture:
    """The figure cut out of the picture, moved, and set before the plate."""
    y, x = np.mgrid[0:FRAME, 0:FRAME].astype(np.float32)
    map_x, map_y = x + back[..., 0], y + back[..., 1]

    def pulled(image: Picture) -> Picture:
        return cast(Picture, cv2.remap(image, map_x, map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    figure = pulled(picture - (1 - cover[..., None]) * plate)
    return (figure + (1 - pulled(cover)[..., None].clip(0, 1)) * plate).astype(np.float32)
