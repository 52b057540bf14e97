"""A search over an archive: how long a question takes, and that the time to make its index grows with the frames."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from degense.engine.archive.frame_facts import PERCENTILES, Key, frame_facts
from degense.engine.archive.index_file import INDEX, create_index, open_index
from degense.engine.archive.names import Things
from degense.engine.archive.observed import ColumnTable, Observed
from degense.engine.archive.search import search
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Column, Table

#: Clips, and the frames of each; the largest archive is that of the questions.
ARCHIVES, QUICK_ARCHIVES = ((125, 250, 500, 1_000), 2_000), ((2, 4), 100)
WIDTH, HEIGHT = 80, 64
CLASSES = ("liver", "gallbladder", "fat", "connective tissue", "grasper", "hook")
#: Films that are drawn; each clip is one of them from another frame on.
FILMS = 8
QUESTIONS = (
    *("grasper", "grasper touching gallbladder", "hook left of the gallbladder and near the liver", "tool between liver and gallbladder"),
    *("largest fat not near the hook", "liver while no grasper", "first grasper touching gallbladder after hook touching liver"),
)


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    archives, frames = QUICK_ARCHIVES if options.quick else ARCHIVES
    made, asked = _tables(archives[-1], frames, options.repeats)
    folder = options.scratch / "archive"
    films = []
    for seed in range(FILMS):
        progress(0.1 * seed / FILMS, "simulating clips")
        films.append(_film(seed, frames))
    for number, clips in enumerate(archives):
        progress(0.1 + 0.7 * number / len(archives), f"an index of {clips} clips")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        begin, written = time.perf_counter(), _write(folder, films, clips)
        seconds = time.perf_counter() - begin
        size = (folder / INDEX).stat().st_size
        total = clips * frames
        made.rows.append(
            {
                "clips": clips,
                "frames": total,
                "seconds": seconds,
                "each": 1e6 * written / total,
                "size": size / 2**20,
                "bytes": size / total,
            }
        )
    yield made
    for number, text in enumerate(QUESTIONS):
        progress(0.8 + 0.2 * number / len(QUESTIONS), text)
        times, cpu = [], []
        for _ in range(options.repeats + 1):
            begin, used = time.perf_counter(), time.process_time()
            with open_index(folder / INDEX) as index:
                found = search(index, text)
            times.append(1e3 * (time.perf_counter() - begin))
            cpu.append(1e3 * (time.process_time() - used))
        assert not found.unanswered
        asked.rows.append(
            {"question": text, "time": times[1:], "cpu": cpu[1:], "first": times[0], "runs": len(found.hits), "moments": found.moments}
        )
    yield asked


def _tables(clips: int, frames: int, repeats: int) -> tuple[Table, Table]:
    made = Table(
        "search-index",
        "An index by the number of clips",
        f"Simulated clips of {frames:,} frames, {WIDTH} × {HEIGHT}, of up to {len(CLASSES)} classes and their kinds: "
        f"drawn ellipses that move, {FILMS} films, of which each clip has another part. Written to one file; what is "
        "timed as written is SQLite's part alone, without simulating the masks and without drawing a scene, which takes longer by far.",
        [
            Column("clips", "clips", 0),
            Column("frames", "frames", 0),
            Column("seconds", "in all, s", 1),
            Column("each", "written, µs a frame", 1),
            Column("size", "file, MB", 0),
            Column("bytes", "bytes a frame", 0),
        ],
    )
    asked = Table(
        "search-query",
        "Questions of an archive",
        f"{clips:,} clips of {frames:,} frames, the last of the table above. From opening the file to the moments of all clips, in a "
        f"program that runs; the file lies in the system's memory. Times of {repeats} repeats; the first time, which also reads the "
        "vocabulary, apart.",
        [
            Column("question", "question"),
            Column("time", "time, ms", 0),
            Column("cpu", "CPU time, ms", 0),
            Column("first", "first time, ms", 0),
            Column("runs", "clips that answer", 0),
            Column("moments", "moments", 0),
        ],
    )
    return made, asked


def _film(seed: int, frames: int) -> Observed:
    """Ellipses on circles; instruments come and go."""
    random, table = np.random.default_rng(seed), ColumnTable(frames)
    classes = tuple(name for name in CLASSES if name in ("grasper", "gallbladder", "liver") or random.random() < 0.7)
    things = Things.of(classes, True)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    phases, speeds = random.uniform(0, 6.3, len(classes)), random.uniform(0.01, 0.05, len(classes))
    for frame in range(frames):
        masks, taken = {}, np.zeros((HEIGHT, WIDTH), bool)
        for name, phase, speed in reversed([*zip(classes, phases, speeds, strict=True)]):
            angle, tool = phase + speed * frame, name in ("grasper", "hook")
            middle = WIDTH / 2 + 20 * np.cos(angle), HEIGHT / 2 + 20 * np.sin(1.7 * angle)
            radius = (0.0 if np.sin(0.3 * angle) < -0.5 else 7.0) if tool else 15.0
            masks[name] = ((x - middle[0]) ** 2 + 1.5 * (y - middle[1]) ** 2 < radius**2) & ~taken
            taken |= masks[name]
        for kind, members in things.kinds:
            masks[kind] = np.logical_or.reduce([masks[name] for name in members])
        facts = frame_facts(masks, classes)
        for name in [name for name in masks if masks[name].any()]:
            facts["confidence", name, ""] = np.array([0.8])
            facts["displacement", name, ""] = np.arange(len(PERCENTILES), dtype=float)[None]
        table.add(frame, facts)
    return Observed(frames, (WIDTH, HEIGHT), 25.0, "mm", things, table.columns())


def _write(folder: Path, films: list[Observed], clips: int) -> float:
    """Write the index; seconds that the file took."""
    create_index(folder / INDEX)
    seconds = 0.0
    with open_index(folder / INDEX, write=True) as index:
        for clip in range(clips):
            film = films[clip % len(films)]
            turned = Observed(film.frames, film.size, film.fps, film.unit, film.things, _turned(film, clip * 37 % film.frames))
            begin = time.perf_counter()
            index.put(PurePosixPath(f"clip-{clip:04d}"), str(clip), turned)
            seconds += time.perf_counter() - begin
    return seconds


def _turned(film: Observed, by: int) -> dict[Key, np.ndarray]:
    """A film that begins at another frame."""
    turned = {}
    for key, values in film.columns.items():
        counts = film.columns.get(("counts", key[1], ""))
        of_objects = counts is not None and key[0] in ("sizes", "centres", "touching", "near", "inside", "between")
        turned[key] = np.roll(values, -int(counts[:by].sum()) if of_objects and counts is not None else -by, 0)
    return turned
