"""What is trained on real clips: clips × methods × seeds."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.readers import open_clip
from degense.engine.errors import DegenseError
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.real_clips.held_out_maps import read_held_out_maps
from degense.engine.research.sweep.schedule import QUICK, Schedule, said, schedule_of
from degense.engine.semantics.teachers.target_cache import digest

#: Options of surgeries, which are drawn; a clip is what it is.
OF_SURGERIES = {"which": "set", "scenes": "scenes", "size": "size", "frames": "frames", "teachers": "teachers", "depths": "depth"}


@dataclass(frozen=True)
class RealClip:
    """A clip of the sweep.

    Attributes
    ----------
    name : str
        Of its folder; of a video its folder's and its own.
    content : str
        Names what is trained on and scored (`content_of`), so that a changed clip is trained anew.
    maps : Path or None
        Label maps of further frames, which are scored and never trained on (`held_out_maps`).
    """

    name: str
    path: Path
    content: str
    maps: Path | None = None

    def __str__(self) -> str:
        return self.name

    @property
    def slug(self) -> str:
        """Its name as part of a file's."""
        return f"{re.sub(r'[^A-Za-z0-9_.+-]+', '-', self.name)}-{self.content[:8]}"


@dataclass(frozen=True)
class ClipJob:
    """One training."""

    scene: RealClip
    method: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.scene.slug}-{self.method}-{self.seed}"


@dataclass(frozen=True)
class ClipsPlan(Schedule):
    """A sweep over real clips."""

    scenes: tuple[RealClip, ...] = ()
    held_out_maps: Path | None = None  # the folder of label maps by the names of clips

    @property
    def jobs(self) -> list[ClipJob]:
        """Clip by clip, so that what is done when the time is over has every method."""
        return [ClipJob(scene, method, seed) for scene, seed, method in product(self.scenes, self.seeds, self.methods)]

    @property
    def fixed(self) -> dict[str, Any]:
        return {"set": "clips", "preset": self.preset, "settings": self.settings}

    def command(self) -> str:
        """What to type to do it again; of a clip only its name, not where it lies."""
        words = [word for scene in self.scenes for word in ("--clip", scene.name)]
        words += [] if self.held_out_maps is None else ["--held-out-maps", self.held_out_maps.as_posix()]
        return shlex.join(["degense", "bench", "clips", *words, *self.options()])


def plan_of(options: BenchOptions) -> ClipsPlan:
    """The sweep that the command line asks for. DegenseError without clips, for clips of one name, and for options of surgeries."""
    if given := [f"--{option}" for name, option in OF_SURGERIES.items() if name in said(options)]:
        raise DegenseError(f"real clips are taken as they are: leave {', '.join(given)} out")
    if not options.clips:
        raise DegenseError("name the clips to train on, each with --clip")
    chosen = schedule_of(options)
    if options.quick and not chosen["settings"]:
        chosen["settings"] = QUICK
    maps = said(options).get("held_out_maps")
    scenes = tuple(_clip_of(path, maps) for path in options.clips)
    name, count = Counter(scene.name for scene in scenes).most_common(1)[0]
    if count > 1:
        raise DegenseError(f"{count} clips are called {name!r}; rename their folders, for tables know clips by their names")
    plan = ClipsPlan(scenes=scenes, held_out_maps=maps, **chosen)
    for method in plan.methods:
        plan.config(method, 0)
    return plan


def _clip_of(path: Path, maps: Path | None) -> RealClip:
    """The clip at a path, with the label maps that lie under its name in a folder, if there are any. DegenseError when they do not fit."""
    name, clip = name_of(path), open_clip(path)
    file = None if maps is None else (maps / f"{name}.json").resolve()
    if file is None or not file.exists():
        return RealClip(name, path.resolve(), content_of(clip))
    return RealClip(name, path.resolve(), content_of(clip, read_held_out_maps(file, clip).values()), file)


def name_of(path: Path) -> str:
    """What a clip is called: as its folder; a video as its folder and itself, for many are called the same."""
    path = path.resolve()
    return path.name if path.is_dir() else f"{path.parent.name}-{path.stem}"


def content_of(clip: Clip, further: Iterable[np.ndarray] = ()) -> str:
    """A name for what is trained on and scored: all masks and label maps, `further` ones too, and the held-out frames; hex digits."""
    shown = [clip.frame(i) for i in clip.test_frames]
    masks = [clip.valid(i) for i in range(len(clip))]
    maps = [labels for i in clip.labelled_frames if (labels := clip.labels(i)) is not None]
    return digest(*shown, *masks, *maps, *further)
