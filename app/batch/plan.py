"""What a batch does: one job for each clip and setting, of a training and of what is made from its run."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

from degense.app.features.export.formats import get_format
from degense.app.features.train.job import TrainingJob
from degense.engine.data.clip_options import ClipOptions
from degense.engine.errors import DegenseError, what_is_wrong

MOST_JOBS, LONGEST_NAME, LONGEST_TEXT = 100_000, 100, 4096
#: What Windows reserves, in any case and with any suffix.
RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10))}
#: What may differ between two calls for the same run: where it is computed, and whether it goes on.
FREE = ("device", "resume", "out")


@dataclass(frozen=True)
class BatchJob:
    """One training and what follows it.

    Attributes
    ----------
    name : str
        Of its run folder and its exports: unique in the batch, also where upper and lower case are the same.
    training : TrainingJob
        With absolute paths; its run folder is `runs/NAME` of the batch.
    prompts : tuple of str
        Questions that the run is asked, and whose masks label maps are exported of; none: it is not asked, and exports are of its classes.
    decoder, threshold
        As of `degense query`.
    exports : tuple of str
        Formats of `degense export`.
    scores : bool
        Whether the run is scored on its held-out frames.
    anonymise : bool
        Whether exports and the report name neither clips nor files; then `name` is a number, unless a plan gave one.
    cover : str or None
        With `anonymise`: a picture of the clip's size, not black where exports are to be black or empty.
    """

    name: str
    training: TrainingJob
    prompts: tuple[str, ...] = ()
    decoder: str | None = None
    threshold: float | None = None
    exports: tuple[str, ...] = ()
    scores: bool = True
    anonymise: bool = False
    cover: str | None = None

    def stages(self) -> dict[str, Any]:
        """The stages in their order, each with all that its outcome depends on, as JSON values."""
        training = {name: value for name, value in self.training.to_json().items() if name not in FREE}
        asked = {"prompts": list(self.prompts), "decoder": self.decoder, "threshold": self.threshold}
        found: dict[str, Any] = {"train": training}
        if self.scores:
            found["eval"] = True
        if self.prompts:
            found["query"] = asked
        shown = asked | ({"anonymise": True, "cover": self.cover} if self.anonymise else {})
        return json.loads(json.dumps(found | {f"export {name}": shown for name in self.exports}))

    def to_json(self) -> dict[str, Any]:
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "training"}
        return {**own, "training": self.training.to_json()}

    @staticmethod
    def from_json(data: Any) -> BatchJob:
        """The job that `to_json` wrote. DegenseError when it is none."""
        try:
            own = {item.name: data[item.name] for item in fields(BatchJob) if item.name in data}
            own |= {name: tuple(own[name]) for name in ("prompts", "exports") if name in own}
            if wrong := [name for name, value in own.items() if name != "training" and not _fits(value, get_type_hints(BatchJob)[name])]:
                raise ValueError(f"{wrong[0]} cannot be {str(own[wrong[0]])[:80]!r}")
            job = BatchJob(**{**own, "training": TrainingJob.from_json(data["training"])})
            check_name(job.name)
        except (KeyError, TypeError, ValueError) as error:
            raise DegenseError(f"A job of the batch cannot be read ({what_is_wrong(error)}).") from error
        check(job)
        return job


@dataclass(frozen=True)
class JobOptions:
    """What is said about a job beside its clip, on the command line or in a plan; None, and empty, leave the choice to the defaults."""

    preset: str = "balanced"
    routing: str | None = None
    teacher: str | None = None
    iterations: int | None = None
    max_gaussians: int | None = None
    device: str | None = None
    seed: int | None = None
    layout: str | None = None
    mask_means: str | None = None
    focal: float | None = None
    poses: str | None = None
    pose_axes: str | None = None
    labels: str | None = None
    start: int | None = None
    stride: int | None = None
    max_frames: int | None = None
    settings: tuple[tuple[str, str], ...] = ()
    prompts: tuple[str, ...] = ()
    decoder: str | None = None
    threshold: float | None = None
    exports: tuple[str, ...] = ()
    scores: bool = True
    anonymise: bool = False
    cover: str | None = None

    def job(self, clip: Path, name: str, base: Path) -> BatchJob:
        """The job of a clip; folders are meant as seen from `base`. DegenseError when something said is not allowed."""
        for text in (str(clip), self.labels or "", self.teacher or "", self.cover or ""):
            check_text(text)
        said = asdict(self)
        own = {key: said.pop(key) for key in ("prompts", "decoder", "threshold", "exports", "scores", "anonymise", "cover")}
        own["cover"] = None if self.cover is None else str((base / self.cover).resolve())
        said["labels"] = None if self.labels is None else str((base / self.labels).resolve())
        said["teacher"] = _teacher(self.teacher, base)
        job = BatchJob(name, TrainingJob(clip=(base / clip).resolve(), out=Path("run"), **said), **own)
        check(job)
        return job


def check(job: BatchJob) -> None:
    """DegenseError for a job that could never be done, whatever its clip is."""
    from degense.engine.semantics.prompts import PromptSet

    job.training.config()
    ClipOptions(**job.training.clip_options())
    PromptSet.chosen(list(job.prompts), job.decoder, job.threshold)
    for name in job.exports:
        get_format(name)
    if job.cover is not None:
        _check_cover(job)
    training = job.training
    for text in (*job.prompts, str(training.clip), str(training.out), training.teacher or "", training.labels or "", job.cover or ""):
        check_text(text)
    for what, given in (("prompt", [text.casefold() for text in job.prompts]), ("format", job.exports)):
        if len(set(given)) < len(given):
            raise DegenseError(f"{job.name} names a {what} twice; give each once.")


def _check_cover(job: BatchJob) -> None:
    from degense.engine.scene.anonymous import HOLD_GAUSSIANS, NOT_COVERED

    if not job.anonymise:
        raise DegenseError("A cover blacks out a region of what is anonymised; anonymise too.")
    if set(job.exports) & set(HOLD_GAUSSIANS):
        raise DegenseError(NOT_COVERED)


def check_text(text: str) -> None:
    """DegenseError for a prompt or path that nothing could be done with."""
    if len(text) > LONGEST_TEXT or any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text):
        raise DegenseError(f"{text[:40]!r} is too long or holds control characters; give another prompt or path.")


def check_name(name: str) -> None:
    """DegenseError for a name that no folder may have on some system."""
    plain = name.split(".")[0].casefold()
    if not re.fullmatch(r"\w[\w.+-]*", name) or len(name) > LONGEST_NAME or name.endswith(".") or plain in RESERVED:
        raise DegenseError(
            f"{name[:40]!r} cannot name a job: a name has letters, digits, '-', '_', '+' and '.', at most {LONGEST_NAME}, "
            "and is none that Windows reserves."
        )


def numbered(number: int) -> Path:
    """What takes the place of the path of the `number`th clip, from 1, where names are made and none may be told."""
    return Path(f"clip-{number:04d}")


def name_of(clip: Path, variant: str = "") -> str:
    """A name for the job of a clip, from the clip's own."""
    plain = re.sub(r"[^\w.+-]+", "-", unicodedata.normalize("NFC", clip.stem if clip.suffix else clip.name)).strip("-.+_")
    name = "-".join(filter(None, [plain[: LONGEST_NAME - 40] or "clip", variant]))
    return f"{name}-clip" if name.split(".")[0].casefold() in RESERVED else name


def with_own_names(jobs: Sequence[BatchJob]) -> list[BatchJob]:
    """The jobs with names that no two share: the second `a` becomes `a-2`. DegenseError when there are too many, or none."""
    if not jobs or len(jobs) > MOST_JOBS:
        raise DegenseError(f"The batch has {len(jobs):,} jobs; it takes 1 to {MOST_JOBS:,}.")
    taken: set[str] = set()
    latest: dict[str, int] = {}
    found = []
    for job in jobs:
        name = job.name
        while name.casefold() in taken:
            latest[job.name] = latest.get(job.name, 1) + 1
            name = f"{job.name}-{latest[job.name]}"
        check_name(name)
        taken.add(name.casefold())
        found.append(replace(job, name=name))
    return found


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value of a kept job is of the kind of its field."""
    if kind == tuple[str, ...]:
        return all(isinstance(text, str) for text in value)
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, kind) or (kind == (float | None) and isinstance(value, int))


def _teacher(teacher: str | None, base: Path) -> str | None:
    """A teacher whose folder, if it names one that is there, is given in full: workers may stand elsewhere."""
    kind, colon, place = (teacher or "").partition(":")
    folder, question, query = place.partition("?")
    if not folder or kind not in ("precomputed", "vlm") or not (base / folder).exists():
        return teacher
    return f"{kind}{colon}{(base / folder).resolve()}{question}{query}"
