"""A clip's cameras seen from above: how wide they see, and where they were. No Qt."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

from degense.app.session.view_state import PROMPT_COLOURS, Colour
from degense.engine.colour_maps import UNKNOWN, colourise

if TYPE_CHECKING:
    from degense.engine.camera import Camera
    from degense.engine.clip import Clip

#: Of the sheet, pixels: width and height, what stays free around the drawing, and below it for the words.
WIDTH, HEIGHT, MARGIN, FOOT = 900, 800, 60, 120
#: The side of the inset in which a short path is enlarged, pixels.
INSET = 230
#: Bits of a pixel's fraction with which is drawn.
SHIFT = 4
BACKGROUND, INK = (15, 17, 20), (230, 230, 230)
VIEW: Colour = PROMPT_COLOURS[1]
TIME_MAP = "viridis"
#: Share of the frame's height, around its middle, whose tissue is drawn: more would lie on top of itself.
CUT = 0.08
#: Cameras that are drawn along the path at most, and their length on the sheet, pixels.
STOPS, STOP_LENGTH = 9, 32
#: A camera that moves less, in pixels of the sheet, and turns less, in degrees, stands still.
STILL = 0.01

Legend = tuple[tuple[str, Colour], ...]


def field_of_view(camera: Camera) -> tuple[float, float]:
    """The angles of view across and down, degrees."""
    sides = ((camera.width, camera.fx), (camera.height, camera.fy))
    across, down = (2 * math.degrees(math.atan(side / 2 / focal)) for side, focal in sides)
    return across, down


def angle_plan(clip: Clip, frame: int) -> tuple[np.ndarray, Legend]:
    """The angle of view of a frame and the tissue in it, uint8 [H, W, 3], and what the colours mean."""
    camera = clip.cameras[frame]
    sheet, tissue = _view(clip, frame, camera, VIEW)
    across, down = field_of_view(camera)
    return sheet.rgb, ((f"focal length {camera.fx:.0f} px: {across:.0f}° across, {down:.0f}° down", VIEW), tissue, sheet.bar(clip.unit))


def path_plan(clip: Clip, frame: int) -> tuple[np.ndarray, Legend]:
    """Where the camera was, turned so that the first one faces up, uint8 [H, W, 3], and what the colours mean."""
    cameras, first = clip.cameras, clip.cameras[0]
    known = clip.poses == "given"
    sheet, tissue = _view(clip, frame, first, VIEW if known else UNKNOWN)
    if not known:
        words = "not known yet: training finds out first where the camera was"
        return sheet.rgb, ((words, UNKNOWN), tissue, sheet.bar(clip.unit))
    length = float(np.linalg.norm(np.diff([_place(camera) for camera in cameras], axis=0), axis=1).sum())
    turn = max(_turn(first, camera) for camera in cameras)
    if length * sheet.scale < STILL and turn < STILL:
        return sheet.rgb, (("the camera stands still", VIEW), tissue, sheet.bar(clip.unit))
    path = _above(first, np.stack([_place(camera) for camera in cameras]))
    enlarged: Legend = ()
    if float(np.ptp(path, axis=0).max()) * sheet.scale < INSET / 2:
        inset = _Sheet(path, INSET, INSET, foot=0)
        _draw_path(inset, cameras, path)
        times = sheet.insert(inset)
        enlarged = ((f"in the corner: the path, {times:.2g} times as large", INK),)
    else:
        _draw_path(sheet, cameras, path)
    moved = f"frame {frame}; the camera moves {length:.3g} {clip.unit} in all and turns by up to {turn:.1f}°"
    ends = (("first frame", _colour(0.0)), ("last frame", _colour(1.0)))
    return sheet.rgb, ((moved, VIEW), *ends, *enlarged, tissue, sheet.bar(clip.unit))


def _view(clip: Clip, frame: int, viewer: Camera, colour: Colour) -> tuple[_Sheet, tuple[str, Colour]]:
    """A sheet with what the camera sees at a frame and the tissue there, and the words for that; as `viewer` has them."""
    camera = clip.cameras[frame]
    points, colours, distance = _tissue(clip, frame)
    tissue, wedge = _above(viewer, points), _wedge(camera, viewer, 1.2 * distance)
    path = _above(viewer, np.stack([_place(other) for other in clip.cameras]))
    sheet = _Sheet(np.concatenate([wedge, tissue, path]))
    sheet.fill(wedge, colour)
    sheet.dots(tissue, colours)
    sheet.line(wedge, colour, closed=True)
    if not len(points):
        return sheet, ("no depth is known here", UNKNOWN)
    red, green, blue = colours.mean(0).round().astype(int).tolist()
    return sheet, ("tissue along the middle of the frame", (red, green, blue))


def _draw_path(sheet: _Sheet, cameras: list[Camera], path: np.ndarray) -> None:
    """The places [N, 2] one after another, and some of the cameras there; early and late in other colours."""
    share = np.linspace(0.0, 1.0, len(cameras))
    for start, end, time in zip(path, path[1:], share[1:], strict=False):
        sheet.line(np.stack([start, end]), _colour(time), width=3)
    for stop in np.unique(np.linspace(0, len(cameras) - 1, min(len(cameras), STOPS)).round().astype(int)):
        sheet.line(_wedge(cameras[stop], cameras[0], STOP_LENGTH / sheet.scale), _colour(share[stop]), closed=True)


def _colour(time: float) -> Colour:
    """The colour of a moment, 0 the first and 1 the last; without the map's darkest, for the sheet is dark."""
    red, green, blue = colourise(np.array([time]), TIME_MAP, -0.4, 1.0)[0].tolist()
    return red, green, blue


def _tissue(clip: Clip, frame: int) -> tuple[np.ndarray, np.ndarray, float]:
    """World points [N, 3] of the middle of a frame with their colours uint8 [N, 3], and how far most of it is at most."""
    camera, depth = clip.cameras[frame], clip.depth(frame).astype(np.float64)
    near = np.abs(np.arange(camera.height) + 0.5 - camera.cy) <= max(1.0, CUT / 2 * camera.height)
    y, x = np.nonzero((depth > 0) & clip.valid(frame) & near[:, None])
    points = camera.unproject(np.stack([x, y], -1) + 0.5, depth[y, x])
    known = depth[depth > 0]
    return points, clip.frame(frame)[y, x], float(np.percentile(known, 98)) if known.size else 1.0


def _place(camera: Camera) -> np.ndarray:
    """Where a camera is in the world, [3]."""
    return -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]


def _turn(first: Camera, camera: Camera) -> float:
    """The angle between two cameras, degrees."""
    turned = camera.viewmat[:3, :3] @ first.viewmat[:3, :3].T
    return math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(turned)) - 1) / 2))))


def _above(viewer: Camera, points: np.ndarray) -> np.ndarray:
    """World points [N, 3] from above, [N, 2]: to the right of `viewer`, and before it."""
    return (points @ viewer.viewmat[:3, :3].T + viewer.viewmat[:3, 3])[:, [0, 2]]


def _wedge(camera: Camera, viewer: Camera, length: float) -> np.ndarray:
    """What a camera sees of the middle of its frame up to `length`, from above, [3, 2]: its place, and the two far corners."""
    edges = np.array([[0.0, camera.cy], [camera.width, camera.cy]])
    return _above(viewer, np.concatenate([[_place(camera)], camera.unproject(edges, np.full(2, length))]))


class _Sheet:
    """A dark sheet on which points of the plan, [N, 2], are drawn to scale, `scale` pixels a unit of length: all of `extent` is on it."""

    def __init__(self, extent: np.ndarray, width: int = WIDTH, height: int = HEIGHT, foot: int = FOOT) -> None:
        self.rgb = np.full((height, width, 3), BACKGROUND, np.uint8)
        low, high = extent.min(0), extent.max(0)
        room = np.array([width, height - foot]) - 2 * MARGIN
        self.scale = float((room / np.maximum(high - low, 1e-9)).min())
        self._middle, self._centre = 0.5 * (low + high), [width / 2, (height - foot) / 2]

    def fill(self, corners: np.ndarray, colour: Colour) -> None:
        tinted = self.rgb.copy()
        cv2.fillPoly(tinted, [self._places(corners)], colour, cv2.LINE_AA, SHIFT)
        self.rgb = cv2.addWeighted(tinted, 0.18, self.rgb, 0.82, 0)

    def line(self, points: np.ndarray, colour: Colour, *, closed: bool = False, width: int = 2) -> None:
        cv2.polylines(self.rgb, [self._places(points)], closed, colour, width, cv2.LINE_AA, SHIFT)

    def dots(self, points: np.ndarray, colours: np.ndarray) -> None:
        for place, colour in zip(self._places(points), colours.tolist(), strict=True):
            cv2.circle(self.rgb, tuple(map(int, place)), 2 << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)

    def insert(self, other: _Sheet) -> float:
        """Put a smaller sheet into the lower right corner, beside the foot of a view; how many times as large it shows things."""
        height, width = other.rgb.shape[:2]
        top, left = self.rgb.shape[0] - height - MARGIN, self.rgb.shape[1] - width - MARGIN // 4
        self.rgb[top : top + height, left : left + width] = other.rgb
        cv2.rectangle(self.rgb, (left, top), (left + width - 1, top + height - 1), UNKNOWN, 1)
        return other.scale / self.scale

    def bar(self, unit: str) -> tuple[str, Colour]:
        """Draw a bar of a round length, at most a fifth of the sheet; what it means."""
        height, width = self.rgb.shape[:2]
        wanted = 0.2 * width / self.scale
        step = 10.0 ** math.floor(math.log10(wanted))
        length = max(step * factor for factor in (1, 2, 5) if step * factor <= wanted * (1 + 1e-9))
        right, y = width - MARGIN // 4, height - MARGIN // 2
        cv2.line(self.rgb, (right - round(length * self.scale), y), (right, y), INK, 3, cv2.LINE_AA)
        return f"bar: {length:g} {unit}", INK

    def _places(self, points: np.ndarray) -> np.ndarray:
        """On the sheet, int32 [N, 2] with `SHIFT` bits of fraction; forward is up."""
        places = (points - self._middle) * self.scale * [1.0, -1.0] + self._centre
        return np.round(places * (1 << SHIFT)).astype(np.int32)
