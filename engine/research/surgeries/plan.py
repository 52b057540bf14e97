"""What a surgery of the family consists of: everything that a seed draws, in plain numbers, before anything is built."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

DEVELOP, REPORT = range(0, 100), range(100, 120)  # seeds to choose settings on, and seeds that nothing is chosen on

#: sRGB of tissues: main tone, second tone, vessels; then number of vessels, relief (mm), wetness.
LOOKS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int], int, float, float]] = {
    "abdominal wall": ((214, 132, 106), (176, 88, 74), (146, 40, 42), 26, 0.12, 0.35),
    "liver": ((116, 44, 42), (86, 30, 33), (146, 66, 60), 40, 0.045, 0.85),
    "gallbladder": ((214, 196, 140), (170, 160, 118), (150, 46, 52), 52, 0.028, 1.0),
    "fat": ((242, 196, 112), (222, 156, 78), (184, 70, 54), 30, 0.2, 0.6),
    "connective tissue": ((228, 180, 166), (198, 122, 112), (160, 52, 54), 60, 0.1, 0.8),
    "small intestine": ((230, 164, 146), (208, 128, 116), (170, 58, 62), 60, 0.035, 1.0),
    "kidney parenchyma": ((142, 62, 50), (104, 38, 38), (92, 26, 30), 24, 0.045, 0.95),
    "covered kidney": ((226, 176, 138), (198, 126, 104), (150, 44, 48), 46, 0.06, 0.75),
    "cystic duct": ((226, 190, 160), (196, 148, 122), (160, 60, 60), 20, 0.05, 0.9),
}
Camera = Literal["still", "orbit", "hand-held"]
GROUND = ("abdominal wall", "fat", "liver", "connective tissue")  # what lies behind all else
ROUND = ("liver", "gallbladder", "fat", "kidney parenchyma", "covered kidney", "connective tissue")
CAMERAS: tuple[Camera, ...] = ("still", "still", "orbit", "hand-held")
LONG = ("small intestine", "gallbladder", "cystic duct")


@dataclass(frozen=True)
class Organ:
    """A dome, or a tube along a path, that rises from what lies behind it; material mm."""

    tissue: str
    shape: Literal["ground", "dome", "tube"]
    points: tuple[tuple[float, float], ...]  # centre of a dome, path of a tube
    radii: tuple[float, float]  # half axes of a dome; half width and how far a tube's ends are thinner
    angle: float  # of a dome, radians
    height: float
    tone: tuple[float, float, float]  # factors of its colours


@dataclass(frozen=True)
class Burn:
    """A place that chars."""

    path: tuple[tuple[float, float], ...]  # of the instrument's tip, material mm
    radius: float  # mm
    begins: float  # clip time
    lasts: float  # clip time that the instrument takes along the path, and the front beyond it
    rise: float  # clip time that one place takes
    darkness: float  # how far it gets: 0.3 pale, 1 black
    edge: float  # share of the radius over which it fades: 0.1 sharp, 0.9 soft
    hook: bool  # whether an electrocautery hook is seen at it
    static: bool  # whether the tissue around it stands still


@dataclass(frozen=True)
class Pull:
    """A grasper, or tension from outside the view, that drags tissue along."""

    at: tuple[float, float]
    towards: tuple[float, float, float]
    length: float  # mm
    reach: float  # mm
    begins: float
    lasts: float
    grasper: bool


@dataclass(frozen=True)
class Cut:
    """A line along which tissue parts and shows what lies beneath."""

    y: float
    x: tuple[float, float]
    begins: float
    lasts: float
    gape: float  # mm
    scissors: bool


@dataclass(frozen=True)
class Blood:
    """A pool that wells up and spreads over the tissue, with which it moves."""

    source: tuple[float, float]
    radius: float
    begins: float
    lasts: float
    suction: bool


@dataclass(frozen=True)
class SurgeryPlan:
    """All that a seed has drawn. Times are of the clip, 0 to 1; lengths mm; material coordinates as in `anatomy`."""

    seed: int
    organs: tuple[Organ, ...]
    texture: float  # strength of grain and tone: 0.05 nearly blank, 1 rich
    vessels: float  # factor of their number
    breath: float  # mm
    breaths: float  # in the clip
    irregular: float  # 0 to 1
    burns: tuple[Burn, ...]
    pulls: tuple[Pull, ...]
    cut: Cut | None
    blood: Blood | None
    passing: bool  # an instrument that crosses the view without touching anything
    camera: Camera
    camera_motion: float  # mm
    falloff: float  # power of distance with which light falls: 2 is physical
    gleam: float  # strength of highlights
    drift: float  # of the exposure, natural logarithm
    smoke: float  # thickest share of it in a pixel
    noise: float  # standard deviation, grey levels
    jpeg: int  # quality of a compression that the frames have gone through; 100 is none

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the labels: tissues from back to front, what they turn into, and tools."""
        tissues = tuple(dict.fromkeys(organ.tissue for organ in self.organs))
        turned = ("charred tissue",) * bool(self.burns) + ("blood",) * bool(self.blood)
        return (*tissues, *turned, *self.tools)

    @property
    def tools(self) -> tuple[str, ...]:
        """Names of the instruments, each once."""
        seen = {
            "grasper": self.passing or any(pull.grasper for pull in self.pulls),
            "L-hook electrocautery": any(burn.hook for burn in self.burns),
            "scissors": self.cut is not None and self.cut.scissors,
            "suction instrument": self.blood is not None and self.blood.suction,
        }
        return tuple(name for name, used in seen.items() if used)

    def words(self) -> str:
        """What this surgery shows, in a line."""
        texture = "blank" if self.texture < 0.25 else "fair" if self.texture < 0.6 else "rich"
        parts = [f"{len(self.organs)} organs, {texture} texture, {self.camera} camera, breathing {self.breath:.1f} mm"]
        for burn in self.burns:
            edge, ground = "soft" if burn.edge > 0.45 else "sharp", "static" if burn.static else "moving"
            parts.append(f"a {edge} burn of {burn.radius:.0f} mm on {ground} tissue" + ("" if burn.hook else " without a hook"))
        parts += [f"a pull of {pull.length:.0f} mm" for pull in self.pulls]
        parts += ["a cut"] * (self.cut is not None) + ["blood"] * (self.blood is not None) + ["smoke"] * (self.smoke > 0)
        return ", ".join(parts)


def draw_plan(seed: int) -> SurgeryPlan:
    """The surgery of a seed."""
    rng = np.random.default_rng([seed, 2024])
    camera = CAMERAS[rng.integers(4)]
    pulls = tuple(_pull(rng) for _ in range(rng.choice(3, p=[0.35, 0.45, 0.2])))
    burns = tuple(_burn(rng) for _ in range(rng.choice(3, p=[0.4, 0.45, 0.15])))
    cut = _cut(rng) if rng.random() < 0.2 else None
    blood = _blood(rng) if rng.random() < 0.25 else None
    return SurgeryPlan(
        seed=seed,
        organs=_organs(rng),
        texture=float(rng.uniform(0.05, 0.3) if rng.random() < 0.45 else rng.uniform(0.3, 1.0)),
        vessels=float(rng.uniform(0, 1.5)),
        breath=float(rng.choice([0.0, rng.uniform(0.4, 2.4)], p=[0.15, 0.85])),
        breaths=float(rng.uniform(1.5, 4.0)),
        irregular=float(rng.choice([0.0, rng.uniform(0.2, 1.0)])),
        burns=burns,
        pulls=pulls,
        cut=cut,
        blood=blood,
        passing=bool(rng.random() < 0.2),
        camera=camera,
        camera_motion={"still": 0.0, "orbit": float(rng.uniform(2, 8)), "hand-held": float(rng.uniform(0.5, 2.5))}[camera],
        falloff=float(rng.uniform(1.2, 2.2)),
        gleam=float(rng.uniform(0.0, 1.6)),
        drift=float(rng.choice([0.0, rng.uniform(0.03, 0.2)])),
        smoke=float(rng.choice([0.0, rng.uniform(0.08, 0.35)], p=[0.75, 0.25])),
        noise=float(rng.uniform(0.8, 3.5)),
        jpeg=int(rng.choice([100, int(rng.integers(75, 96))])),
    )


def _organs(rng: np.random.Generator) -> tuple[Organ, ...]:
    """Two to six, from back to front, of different tissues."""
    count = int(rng.integers(2, 7))
    ground = str(rng.choice(GROUND))
    found = [Organ(ground, "ground", (), (0.0, 0.0), float(rng.uniform(-0.12, 0.12)), 0.0, _tone(rng))]
    used = {ground}
    places = rng.permutation(6)[: count - 1]  # sectors of the view, so that organs do not all lie on one another
    for place in places:
        around = 2 * np.pi * (place + rng.uniform(0, 0.6)) / 6
        away = rng.uniform(0.2, 0.85)
        centre = (float(40 * away * np.cos(around)), float(30 * away * np.sin(around)))
        long = rng.random() < 0.3
        choices = [name for name in (LONG if long else ROUND) if name not in used]
        if not choices:
            continue
        tissue = str(rng.choice(choices))
        used.add(tissue)
        heading = rng.uniform(0, np.pi)
        if long:
            length = rng.uniform(22, 60)
            bend = rng.uniform(-0.5, 0.5, 5)
            steps = np.linspace(-0.5, 0.5, 5)
            path = [
                (
                    float(centre[0] + length * s * np.cos(heading) - 12 * b * np.sin(heading)),
                    float(centre[1] + length * s * np.sin(heading) + 12 * b * np.cos(heading)),
                )
                for s, b in zip(steps, bend, strict=True)
            ]
            width = float(rng.uniform(5, 12) if tissue != "cystic duct" else rng.uniform(3, 5))
            found.append(Organ(tissue, "tube", tuple(path), (width, float(rng.uniform(0, 0.5))), 0.0, 1.1 * width, _tone(rng)))
        else:
            radii = float(rng.uniform(16, 46)), float(rng.uniform(12, 32))
            found.append(Organ(tissue, "dome", (centre,), radii, float(heading), float(rng.uniform(10, 26)), _tone(rng)))
    return tuple(found)


def _tone(rng: np.random.Generator) -> tuple[float, float, float]:
    """Patients differ: a factor of brightness and a little of hue."""
    red, green, blue = rng.uniform(0.75, 1.2) * np.exp(rng.normal(0, 0.06, 3))
    return float(red), float(green), float(blue)


def _burn(rng: np.random.Generator) -> Burn:
    start = rng.uniform(-1, 1, 2) * np.array([26, 18])
    turns = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.5, 4))
    stride = rng.uniform(0.0, 4.5)
    path = np.concatenate([[start], start + np.cumsum(stride * np.stack([np.cos(turns), np.sin(turns)], -1), 0)])
    soft = rng.random() < 0.5
    begins = float(rng.uniform(0.1, 0.5))
    return Burn(
        path=tuple((float(x), float(y)) for x, y in path),
        radius=float(rng.uniform(2.5, 13)),
        begins=begins,
        lasts=float(rng.uniform(0.1, 0.95 - begins)),
        rise=float(rng.choice([rng.uniform(0.03, 0.1), rng.uniform(0.1, 0.5)])),
        darkness=float(rng.uniform(0.35, 1.0)),
        edge=float(rng.uniform(0.5, 0.95) if soft else rng.uniform(0.1, 0.35)),
        hook=bool(rng.random() < 0.5),
        static=bool(rng.random() < 0.6),
    )


def _pull(rng: np.random.Generator) -> Pull:
    towards = rng.normal(0, 1, 3) * np.array([1, 1, 0.4]) - np.array([0, 0, 0.5])
    towards /= np.linalg.norm(towards)
    begins = float(rng.uniform(0.05, 0.6))
    at = rng.uniform(-1, 1, 2) * np.array([30, 22])
    return Pull(
        (float(at[0]), float(at[1])),
        (float(towards[0]), float(towards[1]), float(towards[2])),
        length=float(rng.uniform(3, 12)),
        reach=float(rng.uniform(24, 50)),
        begins=begins,
        lasts=float(rng.uniform(0.15, 0.95 - begins)),
        grasper=bool(rng.random() < 0.7),
    )


def _cut(rng: np.random.Generator) -> Cut:
    left, begins = float(rng.uniform(-28, -8)), float(rng.uniform(0.08, 0.35))
    right = left + float(rng.uniform(18, 36))
    gape = float(rng.uniform(1.5, 3.2))
    return Cut(float(rng.uniform(-8, 8)), (left, right), begins, float(rng.uniform(0.2, 0.5)), gape, bool(rng.random() < 0.8))


def _blood(rng: np.random.Generator) -> Blood:
    begins, at = float(rng.uniform(0.1, 0.45)), rng.uniform(-1, 1, 2) * np.array([24, 16])
    lasts = float(rng.uniform(0.2, 0.5))
    return Blood((float(at[0]), float(at[1])), float(rng.uniform(7, 20)), begins, lasts, bool(rng.random() < 0.5))
