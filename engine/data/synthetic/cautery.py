"""The kind "cautery": a grasper pulls the gallbladder while a hook chars tissue that stands still."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.data.synthetic.anatomy import CHAR_RADIUS, CHARRED, CLASSES, GRASPER, HOOK, Anatomy, build_anatomy
from degense.engine.data.synthetic.paint import distance_to_path, smoothstep
from degense.engine.data.synthetic.render import CHARS
from degense.engine.data.synthetic.stage import Optics, Patch, approach, breathing, sway
from degense.engine.data.synthetic.tools import Tool, direction, grasper, hook

FINER = 3  # texture points along a mesh cell
GRASP = (0.14, 0.20)  # jaws close
PULL = (0.20, 0.58)
BURN = (0.46, 0.80)
CHAR_RISE = 0.07  # clip time from the first browning to the final black
STILL = (CHAR_RADIUS + 2.0, 22.0)  # mm of material from the burn path: no motion at all within the first, full motion beyond the second
OUT_OF_VIEW = 55.0  # mm that a tool is drawn back before it enters


class Cautery:
    """See `engine.data.synthetic.stage.PhantomStage`.

    Displacements vanish at s = 0 and, always, around the charred region.
    """

    classes: tuple[str, ...] = CLASSES
    palette: tuple[tuple[int, int, int], ...] = (
        (214, 140, 116),
        (126, 46, 44),
        (120, 178, 104),
        (240, 200, 96),
        (196, 132, 190),
        (40, 30, 28),
        (70, 150, 220),
        (90, 220, 220),
    )
    change, changed_labels, change_time = CHARS, (CHARRED, CHARRED), CHAR_RISE
    noise: float | None = None
    jpeg = 100
    facts: dict[str, Any] = {}  # noqa: RUF012

    @staticmethod
    def margin(seed: int, camera_motion: float) -> float:
        return 1.12 + 0.022 * camera_motion

    def __init__(self, half: tuple[float, float], cells: int, seed: int):
        rng = np.random.default_rng(seed)
        self.anatomy: Anatomy = build_anatomy(rng, half, cells, FINER, BURN)
        self.texture, self.organs = self.anatomy.texture, self.anatomy.labels
        rows, columns = self.anatomy.mesh.shape
        self.patches = [Patch(self.anatomy.rest, np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1) * float(FINER))]
        x, y = self.anatomy.mesh.points
        still = smoothstep((distance_to_path(x, y, self.anatomy.burn)[0] - STILL[0]) / (STILL[1] - STILL[0]))[..., None]
        depth_of_breath = rng.uniform(1.1, 1.6) * (1 + 0.25 * np.sin(x / 31 + rng.uniform(0, 6)) + 0.2 * np.cos(y / 27))[..., None]
        self._breath = still * depth_of_breath * np.array([0.18, 0.72, -0.55])
        hold = self.anatomy.at_rest(self.anatomy.grasp[None])[0]
        near = np.clip(np.linalg.norm(self.anatomy.rest - hold, axis=-1) / 46.0, 0, 1)
        support = (1 - near) ** 4 * (4 * near + 1)  # Wendland's C² function: compact, smooth
        towards = np.array([0.66, -0.60, -0.45]) + rng.uniform(-0.1, 0.1, 3)
        self._pull = still * support[..., None] * towards / np.linalg.norm(towards) * rng.uniform(9.5, 11.5)
        self._sway = float(rng.uniform(0, 2 * np.pi))

    def optics(self, s: float) -> Optics:
        return Optics()

    def viewmat(self, s: float, amplitude: float) -> np.ndarray:
        return sway(amplitude, s)

    def displacements(self, s: float) -> list[np.ndarray]:
        traction = smoothstep((s - PULL[0]) / (PULL[1] - PULL[0])) * (1 + 0.07 * np.sin(2 * np.pi * 2.3 * s + self._sway))
        return [self._breath * breathing(s) + self._pull * float(traction)]

    def tools(self, s: float) -> list[Tool]:
        return [self._grasper(s), self._hook(s)]

    def _grasper(self, s: float) -> Tool:
        """It enters open, closes on the gallbladder and follows the tissue it holds."""
        anatomy = self.anatomy
        cell = np.rint((anatomy.grasp - [anatomy.mesh.x[0], anatomy.mesh.y[0]]) / anatomy.mesh.step).astype(int)
        tip = anatomy.rest[cell[1], cell[0]] + self.displacements(s)[0][cell[1], cell[0]]
        back = direction(0.80, -0.42, -0.44)
        tip = tip + back * (OUT_OF_VIEW * approach(s, (0.0, GRASP[0])) - 1.5)
        opening = 0.10 + 0.42 * (1 - smoothstep((s - GRASP[0]) / (GRASP[1] - GRASP[0])))
        return grasper(tip, back, float(opening), GRASPER)

    def _hook(self, s: float) -> Tool:
        """It enters, draws its tip over the tissue that chars, and leaves."""
        back = direction(-0.12, 0.80, -0.55)
        drawn = approach(s, (BURN[0] - 0.14, BURN[0]), (BURN[1] + 0.01, BURN[1] + 0.13))
        tip = self._burn_point(s) + back * OUT_OF_VIEW * drawn
        return hook(tip, back, HOOK)

    def _burn_point(self, s: float) -> np.ndarray:
        """Where the hook's tip touches, mm, float64 [3]; before and after burning, the ends of its path."""
        burn = self.anatomy.burn
        along = np.clip((s - BURN[0]) / (BURN[1] - BURN[0]), 0, 1) * (len(burn) - 1)
        i = min(int(along), len(burn) - 2)
        return self.anatomy.at_rest((burn[i] + (along - i) * (burn[i + 1] - burn[i]))[None])[0]
