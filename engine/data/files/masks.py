"""What a mask's high value means. Published clips use both polarities, so it is decided by evidence and said in words.

And the bright disc of an endoscope's picture, found from the dark border around it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from degense.engine.data.clip_options import MaskMeans
from degense.engine.data.files.images import checked, read_index

SURE = 2.0  # votes; less is an assumption and is called one


@dataclass(frozen=True)
class Polarity:
    """The decision and its reason."""

    means: MaskMeans  # what high values mark: pixels to leave out, or pixels to reconstruct
    words: str  # for `provenance["masks"]`


def read_mask(path: Path, size: tuple[int, int]) -> tuple[np.ndarray, int]:
    """High pixels of a mask, bool [H, W], and its largest value: 0/255 masks (possibly with soft edges) and 0/1 masks alike.

    ClipError for a damaged file.
    """
    mask = checked(read_index(path), path, size)
    top = int(mask.max())
    return (mask >= 128 if top >= 128 else mask > 0), top


def decide(highs: Sequence[np.ndarray], frames: Sequence[np.ndarray], top: int, asked: MaskMeans | None = None) -> Polarity:
    """Decide what high values mean, from masks and frames of the same moments.

    Votes, for "high = tool" (+) or "high = keep" (−): a polarity that would leave nothing of a frame is out (4); a black part is the one
    left out (4); the smaller part is (2 under 35 %, else 1); the greyer part is (1, instruments have less colour than tissue); when all
    that says nothing, 0/1 masks are taken for keep and 0/255 masks for tool, as most clips have it (0.5). When the user said what they mean
    (`asked`), only the words are made.

    `highs` are bool [H, W], `frames` uint8 [H, W, 3]; `top` is the largest value of all masks.
    """
    stack = np.stack(highs)
    value = top or 255
    if not stack.any():
        return Polarity("tool", "empty: nothing is left out")
    if stack.all():
        if asked == "tool":
            return Polarity("tool", f"{value} = tool (as set): everything is left out")
        return Polarity("keep", f"{value} = keep (all pixels are marked): nothing is left out")
    votes = _votes(stack, np.stack(frames), value)
    score = sum(votes.values())
    means = asked or ("tool" if score > 0 else "keep")
    left_out = stack if means == "tool" else ~stack
    reasons = _reasons(left_out, np.stack(frames), votes)
    if asked is not None:
        return Polarity(means, f"{value} = {means} (as set; {reasons})")
    if abs(score) < SURE:
        return Polarity(means, f"assumed {value} = {means} ({reasons}; the masks alone do not tell); set mask_means to change")
    return Polarity(means, f"{value} = {means} ({reasons})")


def _votes(stack: np.ndarray, frames: np.ndarray, value: int) -> dict[str, float]:
    share = float(stack.mean())
    per_frame = stack.mean(axis=(1, 2))
    votes = {"convention": 0.5 if value > 1 else -0.5}
    if (per_frame == 0).any() != (per_frame == 1).any():
        votes["nothing left"] = 4.0 if (per_frame == 0).any() else -4.0
    dark_high, dark_low = _black_share(frames, stack), _black_share(frames, ~stack)
    if dark_high > 0.8 and dark_low < 0.4:
        votes["black"] = 4.0
    elif dark_low > 0.8 and dark_high < 0.4:
        votes["black"] = -4.0
    minority = min(share, 1 - share)
    votes["smaller"] = (2.0 if minority < 0.35 else 1.0 if minority < 0.48 else 0.0) * (1 if share < 0.5 else -1)
    grey_high, grey_low = _colourfulness(frames, stack), _colourfulness(frames, ~stack)
    if abs(grey_high - grey_low) > 0.1:
        votes["greyer"] = 1.0 if grey_high < grey_low else -1.0
    return votes


def _black_share(frames: np.ndarray, where: np.ndarray) -> float:
    return float((frames.max(axis=3)[where] < 24).mean())


def _colourfulness(frames: np.ndarray, where: np.ndarray) -> float:
    """Median saturation of pixels that are neither black nor burnt out; 0.5 when there are none."""
    pixels = frames[where].astype(np.float32)
    high, low = pixels.max(axis=1), pixels.min(axis=1)
    seen = (high > 30) & (low < 220)
    return float(np.median((high[seen] - low[seen]) / high[seen])) if seen.any() else 0.5


def _reasons(left_out: np.ndarray, frames: np.ndarray, votes: dict[str, float]) -> str:
    moves = len(left_out) > 1 and float((left_out[1:] != left_out[:-1]).mean()) > 0.02 * float(left_out.mean())
    words = [f"excluded area {100 * float(left_out.mean()):.0f} % of the frame"]
    if len(left_out) > 1:
        words.append("moves between frames" if moves else "stands still")
    if _black_share(frames, left_out) > 0.8:
        words.append("black, so outside the field of view" if not moves else "black")
    elif "greyer" in votes and _colourfulness(frames, left_out) < _colourfulness(frames, ~left_out):
        words.append("greyer than the rest")
    return ", ".join(words)


class MaskFiles:
    """The tool or field-of-view masks of a clip, one a frame, in a decided polarity."""

    def __init__(self, files: list[Path], size: tuple[int, int], polarity: Polarity):
        self.files, self.size, self.polarity = files, size, polarity

    def keep(self, index: int) -> np.ndarray:
        """Pixels to reconstruct, bool [H, W]. An empty mask says nothing, so all pixels are."""
        high, _ = read_mask(self.files[index], self.size)
        return high if self.polarity.means == "keep" and high.any() else ~high


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
