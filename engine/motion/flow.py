"""Dense optical flow between two frames, and where it can be believed.

Flow is in pixels, float32 [H, W, 2] (x to the right, y down): the point seen at pixel p of the first frame is seen at p + flow(p) in the second.
"""

from __future__ import annotations

import cv2
import numpy as np

WINDOW = 7  # pixels: side of the window that confidence looks at


def flow_between(rgb_a: np.ndarray, rgb_b: np.ndarray) -> np.ndarray:
    """Optical flow a → b by dense inverse search (Kroeger et al., ECCV 2016) with variational refinement.

    Local contrast is evened out first, so that the light that travels with an endoscope is not taken for motion.
    Safe to call from several threads.

    Parameters
    ----------
    rgb_a, rgb_b : uint8 [H, W, 3]
        At least 12 pixels on each side.

    Returns
    -------
    float32 [H, W, 2]
    """
    if rgb_a.shape != rgb_b.shape:
        raise ValueError(f"frames differ in size: {rgb_a.shape} and {rgb_b.shape}")
    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    return search.calc(_grey(rgb_a), _grey(rgb_b), None)


def sample(field: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """A field [H, W] or [H, W, C] of the second frame, looked up bilinearly where the flow of the first frame leads; NaN outside the image."""
    height, width = flow.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = x + flow[..., 0].astype(np.float32), y + flow[..., 1].astype(np.float32)
    found = cv2.remap(np.ascontiguousarray(field, np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    outside = ~((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))  # also where the flow is NaN
    found[outside] = np.nan
    return found


def consistent(forward: np.ndarray, backward: np.ndarray, tolerance: float = 0.7, share: float = 0.02) -> np.ndarray:
    """Where going there and back ends where it began: ‖f(p) + b(p + f(p))‖ ≤ tolerance + share · (‖f(p)‖ + ‖b(p + f(p))‖).

    Points that become hidden, leave the image or were matched wrongly fail. Points on texture-free surfaces may pass: see `confidence`.

    Parameters
    ----------
    forward, backward : float32 [H, W, 2]
        Flow a → b and b → a, pixels.
    tolerance : float
        Pixels.
    share : float
        Part of the length of the way that may be lost in addition.

    Returns
    -------
    bool [H, W]
    """
    back = sample(backward, forward)
    error = np.linalg.norm(forward + back, axis=-1)
    return error <= tolerance + share * (np.linalg.norm(forward, axis=-1) + np.linalg.norm(back, axis=-1))


def chain(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Flow a → c from a → b and b → c: f(p) + g(p + f(p)); NaN where the way leaves the image."""
    return first + sample(second, first)


def confidence(rgb: np.ndarray, noise: float = 2.0) -> np.ndarray:
    """How well texture pins down motion, float32 [H, W] in [0, 1].

    1 − e / λ₂ clipped at 0, where λ₂ is the smaller eigenvalue of the structure tensor averaged over a window and e is what noise alone would give. Near 0 on plain
    or overexposed surfaces and along straight edges, where flow is a guess of the smoothness term; near 1 on texture in two directions.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    noise : float
        Standard deviation of the sensor noise, grey levels.
    """
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    dx, dy = cv2.Scharr(grey, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(grey, cv2.CV_32F, 0, 1) / 32
    xx, yy, xy = (cv2.boxFilter(product, -1, (WINDOW, WINDOW)) for product in (dx * dx, dy * dy, dx * dy))
    smaller = 0.5 * (xx + yy - np.sqrt((xx - yy) ** 2 + 4 * xy**2))
    # White noise of unit variance has the gradient variance 1 / (8 π σ⁴) after a Gaussian of σ = 1; the channels' mean has a little less.
    floor = noise**2 / (8 * np.pi)
    return np.clip(1 - floor / np.maximum(smaller, 1e-12), 0, 1)


def _grey(rgb: np.ndarray) -> np.ndarray:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return cv2.createCLAHE(2.0, (8, 8)).apply(grey)
