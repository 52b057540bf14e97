"""A surgery of the family: the stage on which a plan is played."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from degense.engine.data.synthetic.paint import distance_to_path, smoothstep
from degense.engine.data.synthetic.render import CHARS
from degense.engine.data.synthetic.stage import Optics, approach, looking
from degense.engine.data.synthetic.tools import Tool, direction, grasper, hook
from degense.engine.research.surgeries.plan import Burn, Pull, SurgeryPlan, draw_plan
from degense.engine.research.surgeries.tissue import build_tissue
from degense.engine.research.surgeries.tools import scissors, suction

FAR_BACK = 75.0  # mm that a tool is drawn back before it enters
CALM = 2.0, 20.0  # mm beyond a static burn's radius: no motion within the first, full motion beyond the second
ENTERS = 0.12  # clip time that a tool takes to come and to leave
COLOURS = {
    "abdominal wall": (214, 140, 116),
    "liver": (126, 46, 44),
    "gallbladder": (120, 178, 104),
    "fat": (240, 200, 96),
    "connective tissue": (196, 132, 190),
    "small intestine": (224, 150, 130),
    "kidney parenchyma": (142, 62, 50),
    "covered kidney": (222, 176, 140),
    "cystic duct": (160, 200, 160),
    "charred tissue": (40, 30, 28),
    "blood": (160, 10, 16),
    "grasper": (70, 150, 220),
    "L-hook electrocautery": (90, 220, 220),
    "scissors": (70, 120, 240),
    "suction instrument": (120, 220, 160),
}


class Surgery:
    """See `engine.data.synthetic.stage.PhantomStage`. Displacements vanish at s = 0."""

    change, change_time = CHARS, 1.0  # the texture says both for each place

    @staticmethod
    def margin(seed: int, camera_motion: float) -> float:
        """Tissue that is pulled inwards must not lay its edge open."""
        return 1.3 + 0.044 * max(camera_motion, draw_plan(seed).camera_motion)

    def __init__(self, half: tuple[float, float], cells: int, seed: int):
        self.plan: SurgeryPlan = draw_plan(seed)
        self.noise: float | None = self.plan.noise
        self.jpeg = self.plan.jpeg
        self.facts: dict[str, Any] = {"words": self.plan.words(), "plan": asdict(self.plan)}
        plan, rng = self.plan, np.random.default_rng([seed, 7])
        self.classes = plan.classes
        self.palette = tuple(COLOURS[name] for name in plan.classes)
        self.changed_labels = self._label("charred tissue"), self._label("blood")
        self.tissue = build_tissue(plan, half, cells, rng)
        self.texture, self.organs, self.patches = self.tissue.texture, self.tissue.labels, self.tissue.patches
        self._phases = rng.uniform(0, 2 * np.pi, 8)
        towards = np.array([*(rng.uniform(-1, 1, 2) * [0.5, 1.0]), -rng.uniform(0.3, 0.8)])
        self._backs = [self._back(angle) for angle in rng.permutation(np.linspace(0, 2 * np.pi, 6, endpoint=False) + rng.uniform(0, 1))]
        self._breath, self._pulls, self._part = [], [], []
        for points, patch, side in zip(self.tissue.points, self.patches, self.tissue.sides, strict=True):
            x, y = points[..., 0], points[..., 1]
            free = self._free(x, y)[..., None]
            swing = 1 + 0.25 * np.sin(x / 31 + self._phases[0]) + 0.2 * np.cos(y / 27 + self._phases[1])
            self._breath.append(free * plan.breath * swing[..., None] * towards / np.linalg.norm(towards))
            self._pulls.append([free * self._pulled(pull, patch.rest) for pull in plan.pulls])
            self._part.append(self._parting(x, y, side) * free)

    def _label(self, name: str) -> int:
        return self.classes.index(name) if name in self.classes else 255

    @staticmethod
    def _back(angle: float) -> np.ndarray:
        """A direction in which a tool is drawn out of the view."""
        return direction(0.8 * np.cos(angle), 0.8 * np.sin(angle), -0.55)

    def _free(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """How freely tissue at (x, y) moves, 0 within static burns to 1 away from them."""
        free = np.ones_like(x)
        for burn in self.plan.burns:
            if burn.static:
                away = _distance(x, y, burn)
                free = np.minimum(free, smoothstep((away - burn.radius - CALM[0]) / (CALM[1] - CALM[0])))
        return free

    def _pulled(self, pull: Pull, rest: np.ndarray) -> np.ndarray:
        """Displacement, mm, [h, w, 3], by a pull at its fullest."""
        near = np.clip(np.linalg.norm(rest - self._at_rest(np.array(pull.at)), axis=-1) / pull.reach, 0, 1)
        support = (1 - near) ** 4 * (4 * near + 1)  # Wendland's C² function: compact, smooth
        return support[..., None] * np.array(pull.towards) * pull.length

    def _parting(self, x: np.ndarray, y: np.ndarray, side: float) -> np.ndarray:
        """Displacement of a patch when the cut gapes fully: its lip moves away from the other and takes its surroundings along."""
        if (cut := self.plan.cut) is None:
            return np.zeros((*x.shape, 3))
        lip = self.tissue.points[1][0] if len(self.tissue.points) > 1 else np.zeros((2, 2))
        apart = np.abs(y - np.interp(x, lip[:, 0], lip[:, 1]))
        along = np.clip((x - cut.x[0]) / (cut.x[1] - cut.x[0]), 0, 1)
        near = np.clip(apart / 22.0, 0, 1)
        support = (1 - near) ** 4 * (4 * near + 1) * (4 * along * (1 - along)) ** 0.8
        moved = np.stack([np.zeros_like(x), np.full_like(x, side), -0.3 * abs(side) * np.exp(-apart / 3.0)], -1)
        return cut.gape * support[..., None] * moved

    def displacements(self, s: float) -> list[np.ndarray]:
        plan, cut = self.plan, self.plan.cut
        turn = 2 * np.pi * plan.breaths * s + plan.irregular * (np.sin(4.3 * np.pi * s + self._phases[2]) - np.sin(self._phases[2]))
        inspired = (0.5 - 0.5 * np.cos(turn)) * (1 + 0.4 * plan.irregular * np.sin(2.6 * np.pi * s))
        found = []
        for points, breath, pulls, part in zip(self.tissue.points, self._breath, self._pulls, self._part, strict=True):
            moved = breath * inspired
            for pull, pulled in zip(plan.pulls, pulls, strict=True):
                traction = smoothstep((s - pull.begins) / pull.lasts)
                moved = moved + pulled * (traction * (1 + 0.07 * np.sin(15 * (s - pull.begins))))
            if cut is not None:
                along = np.clip((points[..., 0] - cut.x[0]) / (cut.x[1] - cut.x[0]), 0, 1)
                moved = moved + part * smoothstep((s - cut.begins - cut.lasts * along) / 0.2)[..., None]
            found.append(moved)
        return found

    def optics(self, s: float) -> Optics:
        plan = self.plan
        exposure = np.exp(plan.drift * (np.sin(2 * np.pi * 0.8 * s + self._phases[3]) - np.sin(self._phases[3])))
        thick = plan.smoke * float(smoothstep(s / 0.3)) * (0.7 + 0.3 * np.sin(9 * s + self._phases[4]))
        return Optics(plan.falloff, plan.gleam, float(exposure), float(thick), (0.6 * s, -0.4 * s))

    def viewmat(self, s: float, amplitude: float) -> np.ndarray:
        plan, phases = self.plan, self._phases[4:]
        size = max(amplitude, plan.camera_motion)
        if plan.camera == "hand-held":  # a slow drift with a tremor
            rates = 2 * np.pi * np.array([[0.7, 5.3], [0.9, 6.1], [0.4, 4.2]])
            waves = [np.sin(rate * s + phases[:2]) - np.sin(phases[:2]) for rate in rates]
            return looking(size * np.array([wave @ [0.8, 0.15] for wave in waves]) * [1, 1, 0.6])
        turn = 2 * np.pi * s
        way = np.array(
            [np.sin(turn + phases[0]) - np.sin(phases[0]), 0.6 * (np.sin(turn + phases[1]) - np.sin(phases[1])), 0.35 * (1 - np.cos(turn))]
        )
        return looking(size * way)

    def _at_rest(self, at: np.ndarray) -> np.ndarray:
        """The vertex nearest to material coordinates `at` [2], mm, float64 [3]."""
        patch, row, column = self._vertex(at)
        return self.patches[patch].rest[row, column]

    def _vertex(self, at: np.ndarray) -> tuple[int, int, int]:
        gaps = [((points - at) ** 2).sum(-1) for points in self.tissue.points[: 2 if len(self.tissue.points) > 1 else 1]]
        patch = int(np.argmin([gap.min() for gap in gaps]))
        row, column = np.unravel_index(int(gaps[patch].argmin()), gaps[patch].shape)
        return patch, int(row), int(column)

    def _seen(self, at: np.ndarray, s: float) -> np.ndarray:
        """Where the tissue at material coordinates `at` is at clip time s."""
        patch, row, column = self._vertex(at)
        return self.patches[patch].rest[row, column] + self.displacements(s)[patch][row, column]

    def tools(self, s: float) -> list[Tool]:
        plan, found, backs = self.plan, list[Tool](), iter(self._backs)
        for pull in plan.pulls:
            if pull.grasper:
                back, away = next(backs), approach(s, (pull.begins - ENTERS, pull.begins))
                found.append(
                    grasper(
                        self._seen(np.array(pull.at), s) + back * (FAR_BACK * away - 1.5), back, 0.1 + 0.4 * away, self._label("grasper")
                    )
                )
        for burn in plan.burns:
            if burn.hook:
                back, end = next(backs), burn.begins + burn.lasts
                drawn = approach(s, (burn.begins - ENTERS, burn.begins), (end, end + ENTERS))
                at = _along(burn, np.clip((s - burn.begins) / burn.lasts, 0, 1))
                found.append(hook(self._seen(at, s) + back * FAR_BACK * drawn, back, self._label("L-hook electrocautery")))
        if (cut := plan.cut) is not None and cut.scissors:
            back, end = next(backs), cut.begins + cut.lasts
            drawn = approach(s, (cut.begins - ENTERS, cut.begins), (end, end + ENTERS))
            at = np.array([cut.x[0] + (cut.x[1] - cut.x[0]) * np.clip((s - cut.begins) / cut.lasts, 0, 1), cut.y])
            opening = 0.07 + 0.16 * (0.5 + 0.5 * np.cos(2 * np.pi * 14 * s))
            found.append(scissors(self._seen(at, s) + back * (FAR_BACK * drawn - 0.8), back, float(opening), self._label("scissors")))
        if (blood := plan.blood) is not None and blood.suction:
            back, begins = next(backs), blood.begins + 0.6 * blood.lasts
            drawn = approach(s, (begins - ENTERS, begins))
            found.append(
                suction(self._seen(np.array(blood.source), s) + back * (FAR_BACK * drawn + 0.4), back, self._label("suction instrument"))
            )
        if plan.passing:
            back = next(backs)
            across = np.array([-back[1], back[0], 0.0]) * 70 * (s - 0.5)
            out = FAR_BACK * abs(2 * s - 1) ** 2
            found.append(grasper(np.array([0.0, 0.0, 70.0]) + across + back * out, back, 0.2, self._label("grasper")))
        return found


def _distance(x: np.ndarray, y: np.ndarray, burn: Burn) -> np.ndarray:
    path = np.array(burn.path)
    if np.ptp(path, axis=0).max() == 0:
        return np.hypot(x - path[0, 0], y - path[0, 1])
    return distance_to_path(x, y, path)[0]


def _along(burn: Burn, share: float) -> np.ndarray:
    """Where a burn's instrument is after a share of its path, material coordinates [2]."""
    path = np.array(burn.path)
    at = share * (len(path) - 1)
    return np.array([np.interp(at, np.arange(len(path)), path[:, axis]) for axis in (0, 1)])
