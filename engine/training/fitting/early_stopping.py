"""Early stopping: when validation frames stop improving, the cool-down begins at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

VALIDATION_FRAMES = 4
FEWEST_FRAMES = 100  # training frames below which none is held out: of 42, four cost more quality than an early stop could save
COOLDOWN = 0.3  # last part of a schedule, in which all learning rates fall and nothing is densified
WATCHED = 0.5  # share of a schedule after which validation ends: little time could be saved then, and the frames are needed for training


def validation_frames(train_frames: Sequence[int]) -> list[int]:
    """Up to `VALIDATION_FRAMES` training frames, evenly spread, never the first (displacement starts there) nor the last.

    They are left out of the colour loss only while they are watched: from half of the schedule on, or from an earlier cool-down, they are
    trained on like all others. Test frames serve for the score alone, and the error on trained frames never stops falling
    (docs/decisions/0011). Empty for clips with fewer than `FEWEST_FRAMES` training frames, which train to the end of their schedule.
    """
    if len(train_frames) < FEWEST_FRAMES:
        return []
    step = len(train_frames) / VALIDATION_FRAMES
    return [train_frames[int((k + 0.5) * step)] for k in range(VALIDATION_FRAMES)]


@dataclass(frozen=True)
class Schedule:
    """Where in its schedule a training stands: learning rates and densification follow `progress`, not the step.

    Attributes
    ----------
    iterations : int
        Steps of the whole schedule.
    cooldown : float
        Its last part, in (0, 1].
    skipped : int
        Steps left out between the early stop and the cool-down.
    """

    iterations: int
    cooldown: float = COOLDOWN
    skipped: int = 0

    def __post_init__(self) -> None:
        if self.iterations < 1 or not 0 < self.cooldown <= 1 or not 0 <= self.skipped < self.iterations:
            raise ValueError(f"no schedule: {self}")

    @property
    def total(self) -> int:
        """Steps that are really made."""
        return self.iterations - self.skipped

    def progress(self, step: int) -> float:
        """(step + skipped) / iterations, in [0, 1]: 1 when training is complete."""
        return min(1.0, (step + self.skipped) / self.iterations)

    def cooling(self, step: int) -> bool:
        """Whether the cool-down has begun."""
        return step + self.skipped >= self._start

    def cool_down(self, step: int) -> Schedule:
        """The schedule that goes on with the cool-down after `step` steps; the same when it has begun."""
        return self if self.cooling(step) else replace(self, skipped=self._start - step)

    @property
    def _start(self) -> int:
        return min(self.iterations - 1, math.ceil((1 - self.cooldown) * self.iterations))


@dataclass
class StoppingRule:
    """Decides from validation scores whether a training still improves.

    Attributes
    ----------
    patience : int
        Steps over which the score must have improved.
    gain : float
        By how much, dB.
    scores : list of (int, float)
        Steps and scores so far: all that a resumed training needs.
    """

    patience: int
    gain: float = 0.2
    scores: list[tuple[int, float]] = field(default_factory=list)

    def observe(self, iteration: int, psnr: float) -> bool:
        """Add a score; True when the best of the last `patience` steps is less than `gain` above the best before them.

        Scores that are not finite are not counted: a training that diverges is rolled back, not finished.
        """
        if math.isfinite(psnr):
            self.scores.append((iteration, psnr))
        before = [score for step, score in self.scores if step <= iteration - self.patience]
        since = [score for step, score in self.scores if step > iteration - self.patience]
        return bool(before and since) and max(since) < max(before) + self.gain

    @property
    def reason(self) -> str:
        """What was observed, for the record."""
        if not self.scores:
            return "nothing was watched"
        step, best = max(self.scores, key=lambda entry: entry[1])
        return f"validation frames gained less than {self.gain:g} dB in {self.patience:,} steps; best {best:.2f} dB at step {step:,}"


class EarlyStopping:
    """Validation frames, the rule that judges their scores, and the schedule that it may shorten.

    Parameters
    ----------
    iterations : int
    train_frames : sequence of int
        Empty for a training that never stops early.
    patience : int, optional
        See `StoppingRule`; by default a sixth of the iterations.
    """

    def __init__(self, iterations: int, train_frames: Sequence[int], patience: int | None = None):
        self.schedule, self.frames = Schedule(iterations), validation_frames(train_frames)
        self.rule = StoppingRule(patience or max(1, iterations // 6))

    def held_out(self, step: int) -> frozenset[int]:
        """Frames that the colour loss must leave out at this step: the validation frames, as long as they are watched."""
        return frozenset(self.frames) if self._watches(step) else frozenset()

    def observe(self, step: int, psnr: float) -> bool:
        """Add a score of the validation frames; True when the cool-down begins at this step."""
        if not self._watches(step) or not self.rule.observe(step, psnr):
            return False
        self.schedule = self.schedule.cool_down(step)
        return True

    def state(self) -> dict[str, object]:
        """For a checkpoint, as JSON values."""
        return {"skipped": self.schedule.skipped, "seen": [list(entry) for entry in self.rule.scores]}

    def restore(self, skipped: int, seen: Sequence[Sequence[float]]) -> None:
        """Go back to what `state` returned."""
        self.schedule = replace(self.schedule, skipped=skipped)
        self.rule.scores = [(int(step), float(score)) for step, score in seen]

    def to_json(self) -> dict[str, object]:
        """For run.json, as the choices of `engine.training.fitting.budget` are written."""
        why = self.rule.reason if self.schedule.skipped else "the validation frames improved as long as they were watched"
        return {
            "preset": self.schedule.iterations,
            "chosen": self.schedule.total,
            "why": why if self.frames else "too few frames to spare any",
        }

    def _watches(self, step: int) -> bool:
        return self.schedule.progress(step) < WATCHED and not self.schedule.cooling(step)
