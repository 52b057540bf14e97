"""Relations between objects in a picture: pure geometry of masks. An object is a connected piece of a mask (8 neighbours)."""

from __future__ import annotations

import math

import cv2
import numpy as np

from degense.engine.vocabulary.questions import Relation

#: Share of the picture's diagonal up to which a gap counts as contact: outlines of masks are that uncertain, 4 pixels of 640 × 512.
CONTACT = 0.005
#: The same for "near".
NEAR = 0.1
#: Largest angle between the way from the other's centre to the object's and the direction that a relation names. What lies on a diagonal
#: is then both left of and above.
SECTOR = math.radians(60)
#: Share of an object that must lie inside of the other, or between the others.
ENCLOSED = 0.5
#: x to the right, y down.
DIRECTIONS: dict[Relation, tuple[int, int]] = {"left of": (-1, 0), "right of": (1, 0), "above": (0, -1), "below": (0, 1)}


def related(mask: np.ndarray, relation: Relation, other: np.ndarray, negated: bool = False) -> np.ndarray:
    """The objects of a mask bool [H, W] that stand in a relation to another mask as a whole, or, when negated, all others.

    left of, right of, above, below: from centre to centre, as the picture shows it, within 60° of that direction.
    touching, near: the smallest gap is no more than `CONTACT`, `NEAR` of the picture's diagonal. Nothing is known of the gap in depth.
    inside: half of the object lies in the other or in its holes. between: half of it lies in the convex hull of the other.
    Nothing stands in a relation to an empty mask.
    """
    count, objects, boxes, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    holds = np.zeros(count, bool)
    if other.any() and count > 1:
        areas = boxes[:, cv2.CC_STAT_AREA]
        if relation in DIRECTIONS:
            rows, columns = np.nonzero(other)
            holds = towards(centres - (columns.mean(), rows.mean()), DIRECTIONS[relation])
        elif relation in ("touching", "near"):
            holds = _gaps(objects, count, other) <= (CONTACT if relation == "touching" else NEAR) * math.hypot(*mask.shape)
        else:
            region = filled(other) if relation == "inside" else hull(other)
            holds = np.bincount(objects[region], minlength=count) >= ENCLOSED * areas
    holds = ~holds if negated else holds
    holds[0] = False  # the background
    return holds[objects]


def extreme(mask: np.ndarray, largest: bool) -> np.ndarray:
    """The object of a mask bool [H, W] with the largest or the smallest area."""
    count, objects, boxes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count == 1:
        return mask
    areas = boxes[1:, cv2.CC_STAT_AREA]
    return objects == 1 + (areas.argmax() if largest else areas.argmin())


def towards(way: np.ndarray, direction: tuple[int, int]) -> np.ndarray:
    """Which ways float [n, 2], (x, y), lie within the sector of a direction, bool [n]."""
    along = way @ np.array(direction, way.dtype)
    return (along > 0) & (along >= math.cos(SECTOR) * np.hypot(*way.T))


def gap_to(mask: np.ndarray) -> np.ndarray:
    """Pixels between each pixel and a mask bool [H, W] at its nearest, float32 [H, W]; 0 in it and beside it."""
    return np.maximum(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - 1.0, 0.0)


def _gaps(objects: np.ndarray, count: int, other: np.ndarray) -> np.ndarray:
    """Pixels between each object and the other mask at their nearest, float [count]; 0 where they overlap or are neighbours."""
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, objects.ravel(), gap_to(other).ravel())
    return nearest


def filled(mask: np.ndarray) -> np.ndarray:
    """A mask bool [H, W] with its holes: all that the border of the picture is not reached from."""
    around = np.pad(~mask, 1, constant_values=True)
    _, regions = cv2.connectedComponents(around.astype(np.uint8), connectivity=4)
    return (regions != regions[0, 0])[1:-1, 1:-1]


def hull(mask: np.ndarray) -> np.ndarray:
    """The convex hull of a mask bool [H, W] that is not empty."""
    points = np.argwhere(mask)[:, ::-1].astype(np.int32)
    drawn = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(drawn, cv2.convexHull(points), 1)
    return drawn.astype(bool)
