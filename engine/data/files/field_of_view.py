"""The bright disc of an endoscope's picture, found from the dark border around it."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

DARK = 24  # 8-bit brightness under which a border counts as black; compression noise stays below it


def border_words(inside: np.ndarray | None, what: str) -> str:
    """`provenance["masks"]` of a clip without mask files. `what` tells how the border was found."""
    if inside is None:
        return "none: nothing is left out"
    share = 100 * float((~inside).mean())
    return f"none; outside the field of view ({what}, {share:.0f} % of the frame) nothing is reconstructed"


def brightest(frames: Iterable[np.ndarray]) -> np.ndarray:
    """Largest channel of each pixel over some RGB frames, uint8 [H, W]: what is dark in it is dark all the time."""
    return np.max([frame.max(axis=2) for frame in frames], axis=0)


def field_of_view(bright: np.ndarray) -> np.ndarray | None:
    """Pixels inside the optical field of view, bool [H, W], from the `brightest` of some frames; None when there is no dark border.

    An optical field of view cut by the frame is convex, so the hull of what is bright takes dark tissue at the rim back in. Thin bright
    things, such as text on the border, are opened away first. None also when all is dark, when less than 1 % of the frame is outside, or
    when fewer than two corners are: a dark corner alone may be a shadow or an instrument.
    """
    height, width = bright.shape
    radius = max(2, round(min(height, width) / 100))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    lit = cv2.morphologyEx((bright >= DARK).astype(np.uint8), cv2.MORPH_OPEN, disc, borderType=cv2.BORDER_REPLICATE)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(lit, connectivity=4)
    if count < 2:
        return None
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    ys, xs = np.nonzero(parts == largest)
    hull = cv2.convexHull(np.stack([xs, ys], 1).astype(np.int32))
    inside = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(inside, hull, 1)
    # the rim is blurred by the optics and by compression; what touches the frame's own edge is sharp and stays
    inside = cv2.erode(inside, disc, borderType=cv2.BORDER_REPLICATE).astype(bool)
    corners = sum(not inside[y, x] for y in (0, -1) for x in (0, -1))
    if corners < 2 or (~inside).mean() < 0.01 or inside.mean() < 0.05:
        return None
    return inside
