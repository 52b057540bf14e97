"""The kind "cautery": a grasper pulls the gallbladder while a hook chars tissue that stands still."""

from __future__ import annotations

import numpy as np

from degense.engine.data.synthetic.anatomy import CHARRED, CLASSES, Anatomy, build_anatomy
from degense.engine.data.synthetic.motion import BURN, CHAR_RISE, Script, write_script
from degense.engine.data.synthetic.render import CHARS
from degense.engine.data.synthetic.stage import Patch
from degense.engine.data.synthetic.tools import Tool, grasper, hook

FINER = 3  # texture points along a mesh cell


class Cautery:
    """See `engine.data.synthetic.stage.PhantomStage`; `half` and `cells` are those of `Bleeding`."""

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
    change, changed_label, change_time = CHARS, CHARRED, CHAR_RISE

    def __init__(self, half: tuple[float, float], cells: int, rng: np.random.Generator):
        self.anatomy: Anatomy = build_anatomy(rng, half, cells, FINER, BURN)
        self.script: Script = write_script(self.anatomy, rng)
        self.texture, self.organs = self.anatomy.texture, self.anatomy.labels
        rows, columns = self.anatomy.mesh.shape
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        self.patches = [Patch(self.anatomy.rest, np.stack([x, y], -1) * float(FINER))]

    def displacements(self, s: float) -> list[np.ndarray]:
        return [self.script.displacement(s)]

    def tools(self, s: float) -> list[Tool]:
        return [grasper(self.anatomy, self.script, s), hook(self.anatomy, s)]
