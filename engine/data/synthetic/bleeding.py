"""The kind "bleeding": scissors open the cover of a kidney, blood wells up and spreads over breathing tissue, a thin tube sucks it away."""

from __future__ import annotations

import numpy as np

from degense.engine.data.synthetic.kidney import BLOOD, CLASSES, CUT, SCISSORS, SUCTION, Kidney, build_kidney, suction_path
from degense.engine.data.synthetic.paint import distance_to_path, smoothstep
from degense.engine.data.synthetic.render import BLEEDS
from degense.engine.data.synthetic.stage import approach, breathing
from degense.engine.data.synthetic.tools import METAL, Tool, direction, join, shaft, tube

FINER = 3  # texture points along a mesh cell
CUTTING = (0.12, 0.40)
GAPES = 0.20  # clip time that a place takes to open behind the scissors
BLEEDING = (0.30, 0.74)
BLOOD_RISE = 0.05
SUCKING = (0.62, 0.92)
FAR_BACK = 80.0  # mm that a tool is drawn back before it enters
ABOVE, BELOW, BED = range(3)  # patches of the kidney


class Bleeding:
    """See `engine.data.synthetic.stage.PhantomStage`. Blood is a change of appearance: it moves as the tissue under it.

    `half` is the half extent in x and y, material mm; `cells` are the mesh cells across the width.
    """

    classes: tuple[str, ...] = CLASSES
    palette: tuple[tuple[int, int, int], ...] = (
        (222, 176, 140),
        (142, 62, 50),
        (120, 178, 104),
        (240, 200, 96),
        (214, 140, 196),
        (160, 10, 16),
        (70, 150, 220),
        (90, 220, 220),
    )
    change, changed_label, change_time = BLEEDS, BLOOD, BLOOD_RISE

    def __init__(self, half: tuple[float, float], cells: int, rng: np.random.Generator):
        self.kidney: Kidney = build_kidney(rng, half, cells, FINER, BLEEDING, SUCKING)
        self.texture, self.organs, self.patches = self.kidney.texture, self.kidney.labels, self.kidney.patches
        strength, phases, gape = rng.uniform(1.1, 1.6), rng.uniform(0, 6, 2), rng.uniform(2.7, 3.3)
        towards = np.array([0.35, 0.62, -0.60]) + rng.uniform(-0.1, 0.1, 3)
        self._breath, self._bowel, self._part = [], [], []
        for number, points in enumerate(self.kidney.points):
            x, y = points[..., 0], points[..., 1]
            swing = strength * (1 + 0.25 * np.sin(x / 29 + phases[0]) + 0.2 * np.cos(y / 25 + phases[1]))
            self._breath.append(swing[..., None] * towards)
            away, along = distance_to_path(x, y, self.kidney.bowel)
            self._bowel.append((smoothstep(1 - away / 15.0), along))
            self._part.append(self._parting(x, y, gape, {ABOVE: -1.0, BELOW: 1.0, BED: 0.0}[number]))

    def _parting(self, x: np.ndarray, y: np.ndarray, gape: float, side: float) -> np.ndarray:
        """Displacement of a patch when the cut gapes fully: its lip moves away from the other and up, and takes its surroundings along."""
        apart = np.abs(y - np.interp(x, *self.kidney.cut.T))
        along = np.clip((x - CUT[0]) / (CUT[1] - CUT[0]), 0, 1)
        near = np.clip(apart / 22.0, 0, 1)
        support = (1 - near) ** 4 * (4 * near + 1) * (4 * along * (1 - along)) ** 0.8
        lift = np.exp(-apart / 3.0)
        moved = np.stack([np.zeros_like(x), np.full_like(x, side), -0.3 * abs(side) * lift], -1)
        return gape * support[..., None] * moved

    def _gaping(self, x: np.ndarray, s: float) -> np.ndarray:
        """How far the cut has opened at x, 0 to 1: it follows the scissors, which go from left to right."""
        along = np.clip((x - CUT[0]) / (CUT[1] - CUT[0]), 0, 1)
        return smoothstep((s - CUTTING[0] - (CUTTING[1] - CUTTING[0]) * along) / GAPES)

    def displacements(self, s: float) -> list[np.ndarray]:
        found = []
        for points, breath, (bowel, along), part in zip(self.kidney.points, self._breath, self._bowel, self._part, strict=True):
            phase = 3 * np.pi * along
            wave = bowel * (np.sin(4 * np.pi * s + phase) - np.sin(phase))
            moved = breath * breathing(s) + part * self._gaping(points[..., 0], s)[..., None]
            found.append(moved + wave[..., None] * np.array([0.25, 0.30, -0.45]))
        return found

    def _seen(self, at: np.ndarray, s: float, patch: int) -> np.ndarray:
        """Where the vertex nearest to material coordinates `at` [2] is at clip time s, mm, float64 [3]."""
        points = self.kidney.points[patch]
        row, column = np.unravel_index(np.argmin(((points - at) ** 2).sum(-1)), points.shape[:2])
        return self.patches[patch].rest[row, column] + self.displacements(s)[patch][row, column]

    def tools(self, s: float) -> list[Tool]:
        return [self._scissors(s), self._suction(s)]

    def _scissors(self, s: float) -> Tool:
        """They enter from the upper left, snip their way along the cut and leave."""
        drawn = approach(s, (0.0, CUTTING[0]), (CUTTING[1] + 0.03, CUTTING[1] + 0.15))
        along = np.clip((s - CUTTING[0]) / (CUTTING[1] - CUTTING[0]), 0, 1)
        x = CUT[0] + (CUT[1] - CUT[0]) * along
        back = direction(-0.70, -0.42, -0.58)
        tip = self._seen(np.array([x, np.interp(x, *self.kidney.cut.T)]), s, ABOVE) + back * (FAR_BACK * drawn - 0.8)
        pivot = tip + 13.0 * back
        opening = 0.07 + 0.16 * (0.5 + 0.5 * np.cos(2 * np.pi * 14 * s))
        spread = np.cross(back, direction(0.3, 0.2, -0.9))
        spread /= np.linalg.norm(spread)
        parts = [shaft(pivot + 4 * back, back, 2.3)]
        parts.append(tube(np.stack([pivot - back, pivot + back, pivot + 5 * back]), np.array([1.2, 1.9, 2.1]), METAL))
        for sign in (-1.0, 1.0):
            u = np.linspace(0, 1, 7)[:, None]
            line = pivot - 13.5 * u * back + sign * (u * np.tan(opening) * 13.0 + 0.35 * (1 - u)) * spread
            parts.append(tube(line, np.linspace(1.2, 0.35, 7), METAL, flat=spread))
        return join(parts, SCISSORS)

    def _suction(self, s: float) -> Tool:
        """A bare metal tube, two millimetres thick, that enters from the lower right and stays in the pool."""
        drawn = approach(s, (SUCKING[0] - 0.14, SUCKING[0] - 0.02))
        path = suction_path(self.kidney.source)
        along = np.clip((s - SUCKING[0]) / (SUCKING[1] - SUCKING[0]), 0, 1) * (len(path) - 1)
        at = [np.interp(along, np.arange(len(path)), path[:, axis]) for axis in (0, 1)]
        back = direction(0.62, 0.50, -0.60)
        tip = self._seen(np.array(at), s, BELOW) + back * (FAR_BACK * drawn + 0.4)
        line = tip + np.linspace(0, 100, 61)[:, None] * back
        return join([tube(line, np.full(61, 1.05), METAL), tube(line[:2], np.array([1.15, 1.15]), (0.06, 0.05, 0.05))], SUCTION)
