"""A search over an archive: how long a question takes, and that the time to make its index grows with the frames."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from degense.engine.archive.frame_facts import PERCENTILES, Key, frame_facts
from degense.engine.archive.index_file import INDEX, create_index, open_index
from degense.engine.archive.indexing import stamp, update_index
from degense.engine.archive.layout import OF_FRAMES
from degense.engine.archive.listing import list_moments
from degense.engine.archive.names import Things
from degense.engine.archive.observed import PICTURES, ColumnTable, Observed, small_jpeg
from degense.engine.archive.search import Found, search
from degense.engine.progress import Progress, finish
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.scenes import trained_scene
from degense.engine.research.bench.table import Cell, Column, Table

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
#: Moments that `degense search` lists unless it is told otherwise.
LISTED = 100
#: Times that a real run is looked through.
ROUNDS = 3


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    archives, frames = QUICK_ARCHIVES if options.quick else ARCHIVES
    folder = options.scratch / "archive"
    films = []
    for seed in range(FILMS):
        progress(0.3 * seed / FILMS, "simulating clips")
        films.append(_film(seed, frames))
    yield _growth(folder, films, archives, lambda fraction, words: progress(0.3 + 0.3 * fraction, words))
    yield _questions(folder, archives[-1], frames, options.repeats, lambda fraction, words: progress(0.6 + 0.1 * fraction, words))
    yield _commands(folder, options, lambda fraction, words: progress(0.7 + 0.3 * fraction, words))


def _growth(folder: Path, films: list[Observed], archives: tuple[int, ...], progress: Progress) -> Table:
    """The index of each archive; that of the last is left in the folder."""
    frames = films[0].frames
    table = Table(
        "search-index",
        "An index by the number of clips",
        f"Simulated clips of {frames:,} frames, {WIDTH} × {HEIGHT}, of up to {len(CLASSES)} classes and their kinds: drawn ellipses that "
        f"move, with confidences, displacements and {PICTURES} pictures; {FILMS} films, of which each clip has another part. Written to "
        "one file, a clip at a time, without simulating the masks; what a real run costs is in the last table. The power of the frames "
        "is that of a line through the logarithms of frames and seconds.",
        [
            Column("clips", "clips", 0),
            Column("frames", "frames", 0),
            Column("seconds", "written, s", 1),
            Column("each", "a frame, µs", 1),
            Column("cpu", "CPU time a frame, µs", 1),
            Column("size", "file, MB", 0),
            Column("bytes", "bytes a frame", 0),
            Column("power", "seconds grow with the frames to the power", 2),
        ],
    )
    totals, times = [clips * frames for clips in archives], []
    for number, (clips, total) in enumerate(zip(archives, totals, strict=True)):
        progress(number / len(archives), f"an index of {clips} clips")
        seconds, cpu = _write(folder, films, clips)
        times.append(seconds)
        size = (folder / INDEX).stat().st_size
        row: dict[str, Cell] = {"clips": clips, "frames": total, "seconds": seconds, "each": 1e6 * seconds / total}
        table.rows.append(row | {"cpu": 1e6 * cpu / total, "size": size / 2**20, "bytes": size / total})
    table.rows[-1]["power"] = float(np.polyfit(np.log(totals), np.log(times), 1)[0])
    return table


def _questions(folder: Path, clips: int, frames: int, repeats: int, progress: Progress) -> Table:
    table = Table(
        "search-query",
        "Questions of an archive",
        f"{clips:,} clips of {frames:,} frames, the last of the table above. From opening the file to all moments, with confidence, "
        f"displacement and picture of the first {LISTED}, in a program that runs; the file lies in the system's memory. Times of {repeats} "
        "repeats; the first time, which also reads the vocabulary, apart.",
        [
            Column("question", "question"),
            Column("time", "time, ms", 0),
            Column("cpu", "CPU time, ms", 0),
            Column("first", "first time, ms", 0),
            Column("runs", "clips that answer", 0),
            Column("moments", "moments", 0),
        ],
    )
    for number, text in enumerate(QUESTIONS):
        progress(number / len(QUESTIONS), text)
        found: list[Found] = []
        wall, cpu = _clocked(lambda text=text, found=found: found.append(_ask(folder, text)), repeats + 1)  # type: ignore[misc]
        assert not found[0].unanswered
        row: dict[str, Cell] = {"question": text, "time": wall[1:], "cpu": cpu[1:], "first": wall[0]}
        table.rows.append(row | {"runs": len(found[0].hits), "moments": found[0].moments})
    return table


def _commands(folder: Path, options: BenchOptions, progress: Progress) -> Table:
    scene, words = trained_scene(options, lambda fraction, message: progress(0.5 * fraction, message))
    table = Table(
        "search-command",
        "What else a search takes",
        f"The archive of the questions, in whose folder nothing is new. A command is a process of its own, its start included. The run "
        f"that is looked through, so that it can be found: {words.split(', then')[0]}; a frame is drawn, all its classes and kinds are "
        "segmented, their confidences, displacements and relations measured.",
        [Column("what", "what"), Column("time", "time, ms", 0), Column("cpu", "CPU time, ms", 0)],
    )
    command = [sys.executable, "-m", "degense.app", "search", str(folder), QUESTIONS[1]]
    pictures = ["--thumbnails", str(options.scratch / "thumbnails")]

    def ask(*more: str) -> None:
        subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)

    works: tuple[tuple[str, Callable[[], object]], ...] = (
        ("looking for new runs in the folder", lambda: finish(update_index(folder))),
        (f'degense search DIR "{QUESTIONS[1]}"', ask),
        (f'degense search DIR "{QUESTIONS[1]}" --thumbnails FOLDER', lambda: ask(*pictures)),
    )
    for number, (what, work) in enumerate(works):
        progress(0.5 + 0.1 * number, what)
        wall, cpu = _clocked(work, options.repeats)
        table.rows.append({"what": what, "time": wall, "cpu": cpu})
    progress(0.8, "looking through a real run")
    shutil.copytree(scene.run.path, options.scratch / "real" / "one")
    wall, cpu = _clocked(lambda: _index_anew(options.scratch / "real"), min(ROUNDS, options.repeats))
    a_frame = [[time / scene.frames for time in times] for times in (wall, cpu)]
    table.rows.append({"what": "looking through a run, a frame", "time": a_frame[0], "cpu": a_frame[1]})
    return table


def _ask(folder: Path, text: str) -> Found:
    """What a question costs a program that runs."""
    with open_index(folder / INDEX) as index:
        found = search(index, text)
        list_moments(index, found, text, LISTED, pictures=True)
    return found


def _index_anew(folder: Path) -> None:
    (folder / INDEX).unlink(missing_ok=True)
    assert len(finish(update_index(folder)).indexed) == 1


def _clocked(work: Callable[[], object], repeats: int) -> tuple[list[float], list[float]]:
    """Wall and CPU times of some calls, of processes that they start too, ms."""
    wall, cpu = [], []
    for _ in range(repeats):
        begin, used = time.perf_counter(), _cpu_seconds()
        work()
        wall.append(1e3 * (time.perf_counter() - begin))
        cpu.append(1e3 * (_cpu_seconds() - used))
    return wall, cpu


def _cpu_seconds() -> float:
    of_children = os.times()
    return time.process_time() + of_children.children_user + of_children.children_system


def _film(seed: int, frames: int) -> Observed:
    """Ellipses on circles; instruments come and go."""
    random, table = np.random.default_rng(seed), ColumnTable(frames)
    classes = tuple(name for name in CLASSES if name in ("grasper", "gallbladder", "liver") or random.random() < 0.7)
    things = Things.of(classes, True)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    colours = random.integers(40, 255, (len(things.names), 3), np.uint8)
    spread, pictures = {*np.linspace(0, frames - 1, min(PICTURES, frames)).round().astype(int).tolist()}, {}
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
            facts["confidence", name] = random.random(1)
            facts["displacement", name] = np.sort(random.random((1, len(PERCENTILES))))
        table.add(frame, facts)
        if frame in spread:
            drawn = np.sum([masks[name][..., None] * colour for name, colour in zip(classes, colours, strict=False)], 0, dtype=np.uint8)
            pictures[frame] = small_jpeg(drawn.repeat(2, 0).repeat(2, 1))
    return Observed(frames, (WIDTH, HEIGHT), 25.0, "mm", things, table.columns(), pictures)


def _write(folder: Path, films: list[Observed], clips: int) -> tuple[float, float]:
    """An archive of runs that only their index knows; seconds that the file took, and of the CPU."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    create_index(folder / INDEX)
    seconds = cpu = 0.0
    with open_index(folder / INDEX, write=True) as index:
        for clip in range(clips):
            film = films[clip % len(films)]
            run, turned = folder / f"clip-{clip:04d}", _turned(film, clip * 37 % film.frames)
            run.mkdir()
            (run / "run.json").write_text("{}")
            begin, used = time.perf_counter(), time.process_time()
            index.put(PurePosixPath(run.name), stamp(run), turned)
            seconds, cpu = seconds + time.perf_counter() - begin, cpu + time.process_time() - used
    return seconds, cpu


def _turned(film: Observed, by: int) -> Observed:
    """A film that begins at another frame."""
    turned: dict[Key, np.ndarray] = {}
    for key, values in film.columns.items():
        counts = film.columns.get(("counts", key[1]))
        of_objects = counts is not None and key[0] not in OF_FRAMES
        turned[key] = np.roll(values, -int(counts[:by].sum()) if of_objects and counts is not None else -by, 0)
    pictures = {(frame - by) % film.frames: picture for frame, picture in film.pictures.items()}
    return replace(film, columns=turned, pictures=pictures)
