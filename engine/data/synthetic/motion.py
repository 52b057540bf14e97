"""What moves and when: breathing, the grasper's pull, charring, the two tools and the camera, as functions of clip time s in [0, 1]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from degense.engine.data.synthetic.anatomy import CHAR_RADIUS, Anatomy
from degense.engine.data.synthetic.paint import distance_to_path, smoothstep

GRASP = (0.14, 0.20)  # jaws close
PULL = (0.20, 0.58)
BURN = (0.46, 0.80)
CHAR_RISE = 0.07  # clip time from the first browning to the final black
BREATHS = 3.0
STILL = (CHAR_RADIUS + 2.0, 22.0)  # mm of material from the burn path: no motion at all within the first, full motion beyond the second


@dataclass(frozen=True)
class Script:
    """Motion of one phantom. Displacements vanish at s = 0 and, always, around the charred region."""

    breath: np.ndarray  # float64 [Hm, Wm, 3]; displacement of every mesh vertex at full inspiration, mm
    pull: np.ndarray  # float64 [Hm, Wm, 3]; the same at full traction
    sway: float  # phase of the slow sway of the pulling hand

    def displacement(self, s: float) -> np.ndarray:
        """Offset of every mesh vertex from its place at s = 0, mm, float64 [Hm, Wm, 3]."""
        return self.breath * breathing(s) + self.pull * self.traction(s)

    def traction(self, s: float) -> float:
        """How far the pull has got, 0 to about 1."""
        amount = smoothstep((s - PULL[0]) / (PULL[1] - PULL[0]))
        return float(amount * (1 + 0.07 * np.sin(2 * np.pi * 2.3 * s + self.sway)))


def camera_path(amplitude: float, s: float) -> np.ndarray:
    """World to camera, float64 [4, 4], of a camera that sways by `amplitude` mm; the identity at s = 0."""
    turn = 2 * np.pi * s
    centre = amplitude * np.array([np.sin(turn), 0.6 * np.sin(2 * turn), 0.35 * (1 - np.cos(turn))])
    forward = np.array([0.35 * centre[0], 0.35 * centre[1], 90.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ centre
    return viewmat


def breathing(s: float) -> float:
    """Inspiration, 0 to 1; 0 at s = 0."""
    return float(0.5 - 0.5 * np.cos(2 * np.pi * BREATHS * s))


def write_script(anatomy: Anatomy, rng: np.random.Generator) -> Script:
    """Motion that suits an anatomy; `rng` varies amplitudes and directions."""
    x, y = anatomy.mesh.points
    still = smoothstep((distance_to_path(x, y, anatomy.burn)[0] - STILL[0]) / (STILL[1] - STILL[0]))[..., None]
    depth_of_breath = rng.uniform(1.1, 1.6) * (1 + 0.25 * np.sin(x / 31 + rng.uniform(0, 6)) + 0.2 * np.cos(y / 27))[..., None]
    breath = still * depth_of_breath * np.array([0.18, 0.72, -0.55])
    hold = anatomy.at_rest(anatomy.grasp[None])[0]
    near = np.clip(np.linalg.norm(anatomy.rest - hold, axis=-1) / 46.0, 0, 1)
    support = (1 - near) ** 4 * (4 * near + 1)  # Wendland's C² function: compact, smooth
    towards = np.array([0.66, -0.60, -0.45]) + rng.uniform(-0.1, 0.1, 3)
    pull = still * support[..., None] * towards / np.linalg.norm(towards) * rng.uniform(9.5, 11.5)
    return Script(breath, pull, float(rng.uniform(0, 2 * np.pi)))


def approach(s: float, arrive: tuple[float, float], leave: tuple[float, float] | None = None) -> float:
    """How far a tool is drawn back from where it works: 1 is out of view, 0 at work."""
    out = 1 - smoothstep((s - arrive[0]) / (arrive[1] - arrive[0]))
    if leave is not None:
        out = max(out, smoothstep((s - leave[0]) / (leave[1] - leave[0])))
    return float(out)


def burn_point(anatomy: Anatomy, s: float) -> np.ndarray:
    """Where the hook's tip touches, mm, float64 [3]; before and after burning, the ends of its path."""
    along = np.clip((s - BURN[0]) / (BURN[1] - BURN[0]), 0, 1) * (len(anatomy.burn) - 1)
    i = min(int(along), len(anatomy.burn) - 2)
    return anatomy.at_rest((anatomy.burn[i] + (along - i) * (anatomy.burn[i + 1] - anatomy.burn[i]))[None])[0]
