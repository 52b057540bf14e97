"""Dense optical flow between frames, and where it is reliable.

Flow is in pixels, float32 [H, W, 2] (x to the right, y down): the point seen at pixel p of the first frame is seen at p + flow(p) in
the second.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from itertools import pairwise
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from degense.engine.threads import abandonable_pool

Rgb: TypeAlias = UInt8[np.ndarray, "_ _ 3"]
Grey: TypeAlias = UInt8[np.ndarray, "_ _"]
Flow: TypeAlias = Float[np.ndarray, "height width 2"]

FINEST = 200_000  # pixels: larger frames are matched at half resolution, where the same motion has as few pixels
WINDOW = 7  # pixels: side of the window that `confidence` looks at
LEAST_NOISE = 0.3  # grey levels: of rounding
LOCAL = 5.0  # pixels: σ of the window that contrast is normalized in
FAINT, NORMAL = 4.0, 40.0  # grey levels: contrast below which it is noise more and more, and what contrast is afterwards
SMOOTHNESS = 20.0  # weight of neighbours that differ in the refinement of a search, against frames that differ: OpenCV's own
CHAINED = 0.8  # a chained flow is kept where the frames are at most so unlike after it as after the search that began there


def flow_between(rgb_a: Rgb, rgb_b: Rgb, initial: Flow | None = None) -> Flow:
    """Optical flow a → b by dense inverse search (Kroeger et al., ECCV 2016) with variational refinement.

    Local contrast is evened out first, so that the light that travels with an endoscope is not taken for motion. Motion of more than
    some 5 % of the width within a small region is missed, often consistently in both directions: start from an `initial` guess, as
    `follow` does; it must be finite. Frames have at least 16 pixels on each side. Safe to call from several threads.
    """
    return _search(even(rgb_a), even(rgb_b), initial)


def sample(field: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """A field [H, W] or [H, W, C] of the second frame, looked up bilinearly where the flow of the first frame leads.

    float32; NaN where the way leaves the image.
    """
    height, width = flow.shape[:2]
    x = np.arange(width, dtype=np.float32) + flow[..., 0].astype(np.float32)
    y = np.arange(height, dtype=np.float32)[:, None] + flow[..., 1].astype(np.float32)
    found = cv2.remap(np.ascontiguousarray(field, np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    outside = ~((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))  # also where the flow is NaN
    found[outside] = np.nan
    return found


def chain(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Flow a → c from a → b and b → c: f(p) + g(p + f(p)); NaN where the way leaves the image."""
    return first + sample(second, first)


def even(rgb: Rgb) -> Grey:
    """Grey with its contrast evened out, so that the light that travels with an endoscope is not taken for motion.

    What is lighter or darker than all around it stays so, as instruments are: for labels, and points anywhere.
    """
    return cv2.createCLAHE(2.0, (8, 8)).apply(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))


def normalized(rgb: Rgb) -> Grey:
    """Grey with its local contrast normalized, so that neither light nor smoke that drifts is taken for motion: for tissue.

    128 + NORMAL (g − ḡ) / √(σ² + FAINT²),  ḡ and σ² the mean and variance of grey in a Gaussian window
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    rest = grey - cv2.GaussianBlur(grey, (0, 0), LOCAL)
    contrast = np.sqrt(cv2.GaussianBlur(rest * rest, (0, 0), LOCAL) + FAINT**2)
    return np.clip(128.5 + NORMAL * rest / contrast, 0, 255).astype(np.uint8)


def steps_between(
    frames: Iterable[np.ndarray], threads: int = 8, grey: Callable[[Rgb], Grey] = even
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Flow there and back between neighbouring frames uint8 [H, W, 3], in order; so many pairs at a time, and twice as many ahead.

    `grey`, `even` or `normalized`, is what of the frames is matched.
    """
    with abandonable_pool(threads) as pool:
        ahead: deque[Future[tuple[np.ndarray, np.ndarray]]] = deque()
        for a, b in pairwise(grey(frame) for frame in frames):
            ahead.append(pool.submit(lambda a, b: (_search(a, b), _search(b, a)), a, b))
            if len(ahead) > 2 * threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def follow(
    frames: Iterable[np.ndarray],
    steps: Iterable[tuple[np.ndarray, np.ndarray]] | None = None,
    grey: Callable[[Rgb], Grey] = even,
    smoothness: float = SMOOTHNESS,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Flow between the first frame and every later one, as it grows from frame to frame.

    Small steps are chained, which follows motion of any size but drifts; the result starts a search of its own between the two far frames,
    which removes drift but may lose large motion; each pixel keeps the search unless the frames look clearly more alike after the chain.
    Yields flow first → frame and frame → first, float32 [H, W, 2] both, for the second frame, the third, …

    Frames uint8 [H, W, 3] come in the order of time, near enough to each other for `flow_between`. `steps` are flow there and back between
    neighbouring frames, where it was measured already (`steps_between`). `grey` as there. `smoothness` as `SMOOTHNESS`: more of it is more
    exact on weak texture, and less at edges of what moves.
    """
    first = before = None
    measured = None if steps is None else iter(steps)
    with abandonable_pool(1) as other:
        for frame in frames:
            here = grey(frame)
            if first is None or before is None:
                first = before = here
                out = back = np.zeros((*here.shape, 2), np.float32)
                continue
            if measured is None:
                there_step, back_step = _search(before, here, smoothness=smoothness), _search(here, before, smoothness=smoothness)
            else:
                there_step, back_step = next(measured)
            outward = other.submit(_prolong, first, here, out, chain(out, there_step), smoothness)
            back = _prolong(here, first, back_step, chain(back_step, back), smoothness)
            out, before = outward.result(), here
            yield out, back


def consistent(forward: Flow, backward: Flow, tolerance: float = 0.7, share: float = 0.02) -> Bool[np.ndarray, "height width"]:
    """Where going there and back ends where it began: ‖f(p) + b(p + f(p))‖ ≤ tolerance + share · (‖f(p)‖ + ‖b(p + f(p))‖).

    Points that become hidden, leave the image or were matched wrongly fail. Plain surfaces, where the smoothness
    term guesses alike both ways, pass by mistake: see `confidence`. The tolerance is in pixels.
    """
    back = sample(backward, forward)
    return _length(forward + back) <= tolerance + share * (_length(forward) + _length(back))


def _length(flow: np.ndarray) -> np.ndarray:
    """‖f(p)‖ [H, W]: many times as fast as `np.linalg.norm` along so short an axis."""
    return np.sqrt(flow[..., 0] ** 2 + flow[..., 1] ** 2)


def confidence(rgb: Rgb, noise: float = 2.0) -> np.ndarray:
    """How well texture pins down motion, float32 [H, W] in [0, 1]: 1 − e / λ, clipped at 0.

    λ is the smaller eigenvalue of the structure tensor (of the grey frame blurred by σ = 1 pixel) averaged over a window, e what noise
    alone would give. Near 0 on plain or overexposed surfaces and along straight edges, where flow is a guess of its smoothness term;
    near 1 on texture in two directions. `noise` is the standard deviation of the grey frame's noise, grey levels.
    """
    # White noise of unit variance, blurred by σ = 1, has a gradient of variance 1 / (8 π σ⁴).
    return np.clip(1 - noise**2 / (8 * np.pi) / np.maximum(_texture(rgb), 1e-12), 0, 1)


def flow_error(rgb: Rgb) -> np.ndarray:
    """What noise alone makes of flow on this texture: its standard deviation along the less certain direction, pixels, float32 [H, W].

        √2 σ / √(λ n)

    as for a least-squares match of a window of n pixels in two frames of noise σ (estimated: Immerkær 1996, by the median), λ as in
    `confidence`, less what the noise adds to it.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    curved = cv2.filter2D(grey, -1, np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32))
    noise = max(np.median(np.abs(curved)) / (0.6745 * 6), LEAST_NOISE)
    texture = _texture(rgb) - noise**2 / (8 * np.pi)
    return np.sqrt(2) * noise / (WINDOW * np.sqrt(np.maximum(texture, 1e-6)))


def _texture(rgb: Rgb) -> np.ndarray:
    """The smaller eigenvalue of the structure tensor around each pixel, float32 [H, W], grey levels² a pixel²; see `confidence`."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    dx, dy = cv2.Scharr(grey, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(grey, cv2.CV_32F, 0, 1) / 32
    xx, yy, xy = (cv2.boxFilter(product, -1, (WINDOW, WINDOW)) for product in (dx * dx, dy * dy, dx * dy))
    return 0.5 * (xx + yy - np.sqrt((xx - yy) ** 2 + 4 * xy**2))


def _prolong(a: np.ndarray, b: np.ndarray, start: np.ndarray, chained: np.ndarray, smoothness: float) -> np.ndarray:
    """A search a → b that begins at a chained flow, or pixel by pixel the chained flow where it explains b clearly better.

    Without a margin noise decides between two flows that explain b alike, pixel by pixel, and makes the flow rough.
    """
    chained = np.where(np.isfinite(chained), chained, start)
    searched = _search(a, b, chained, smoothness)
    return np.where((_unlikeness(a, b, chained) < CHAINED * _unlikeness(a, b, searched))[..., None], chained, searched)


def _unlikeness(a: np.ndarray, b: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Mean difference in grey around a pixel after a flow a → b; a way out of the image counts as the greatest difference."""
    difference = np.abs(a - sample(b, flow))
    return cv2.GaussianBlur(np.where(np.isfinite(difference), difference, np.float32(255)), (0, 0), 2.0)


def _search(a: np.ndarray, b: np.ndarray, initial: np.ndarray | None = None, smoothness: float = SMOOTHNESS) -> np.ndarray:
    if a.shape != b.shape:
        raise ValueError(f"frames differ in size: {a.shape} and {b.shape}")
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(0 if a.size <= FINEST else 1)
    search.setVariationalRefinementAlpha(smoothness)
    return search.calc(a, b, None if initial is None else np.array(initial, np.float32, order="C"))
