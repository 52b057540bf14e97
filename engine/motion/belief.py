"""Where optical flow can be believed."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.motion.flow import sample

WINDOW = 7  # pixels: side of the window that `confidence` looks at


def consistent(forward: np.ndarray, backward: np.ndarray, tolerance: float = 0.7, share: float = 0.02) -> np.ndarray:
    """Where going there and back ends where it began: ‖f(p) + b(p + f(p))‖ ≤ tolerance + share · (‖f(p)‖ + ‖b(p + f(p))‖).

    Points that become hidden, leave the image or were matched wrongly fail. Plain surfaces, where the smoothness
    term guesses alike both ways, pass by mistake: see `confidence`.

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
    return _length(forward + back) <= tolerance + share * (_length(forward) + _length(back))


def _length(flow: np.ndarray) -> np.ndarray:
    """‖f(p)‖ [H, W]: many times as fast as `np.linalg.norm` along so short an axis."""
    return np.sqrt(flow[..., 0] ** 2 + flow[..., 1] ** 2)


def confidence(rgb: np.ndarray, noise: float = 2.0) -> np.ndarray:
    """How well texture pins down motion, float32 [H, W] in [0, 1]: 1 − e / λ, clipped at 0.

    λ is the smaller eigenvalue of the structure tensor (of the grey picture blurred by σ = 1 pixel) averaged over a window, e what noise
    alone would give. Near 0 on plain or overexposed surfaces and along straight edges, where flow is a guess of its smoothness term;
    near 1 on texture in two directions.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    noise : float
        Standard deviation of the grey picture's noise, grey levels.
    """
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    dx, dy = cv2.Scharr(grey, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(grey, cv2.CV_32F, 0, 1) / 32
    xx, yy, xy = (cv2.boxFilter(product, -1, (WINDOW, WINDOW)) for product in (dx * dx, dy * dy, dx * dy))
    smaller = 0.5 * (xx + yy - np.sqrt((xx - yy) ** 2 + 4 * xy**2))
    # White noise of unit variance, blurred by σ = 1, has a gradient of variance 1 / (8 π σ⁴).
    return np.clip(1 - noise**2 / (8 * np.pi) / np.maximum(smaller, 1e-12), 0, 1)
