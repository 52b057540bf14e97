"""Programs that write are killed at random moments, or lose their power; what they leave opens, or says in a sentence what is lost."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from degense.app.research.reliability.filesystem_log import lay_out, moments, record
from degense.app.research.reliability.guarded import guarded, silence
from degense.app.research.reliability.programs import Killed, Program, programs
from degense.app.research.reliability.tally import Tally
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent

#: How a program ends: by a signal, or because the power fails.
ENDS = {"SIGKILL": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "power cut": None}
LONGEST, PATIENCE = 12.0, 60.0  # seconds until a kill at the latest, and for which SIGTERM is waited for
COUNT, QUICK_COUNT = 200, 30
#: Indexing writes through SQLite, whose syncs the model of a power cut does not see.
UNSEEN = ("index",)


def tallies(count: int, scratch: Path, seed: int, progress: Progress = silent, longest: float = LONGEST) -> Iterator[Tally]:
    """Kill each program `count` / 15 times in each way."""
    pairs = [(program, how) for program in programs() for how in ENDS if how != "power cut" or program.name not in UNSEEN]
    for number, (program, how) in enumerate(pairs):
        share = count * (number + 1) // len(pairs) - count * number // len(pairs)
        progress(number / len(pairs), f"{program.name}, {how}")
        yield tally(program, how, share, scratch / f"{number:02d}", seed, longest)


def tally(program: Program, how: str, count: int, scratch: Path, seed: int, longest: float = LONGEST) -> Tally:
    """End one program `count` times in one way. `scratch` is made, and taken away again."""
    whole, at, rng = scratch / "whole", scratch / "at", random.Random(f"{seed} {program.name} {how}")
    whole.mkdir(parents=True)
    made = guarded(lambda: program.prepare(whole), 600, 16 << 10)
    if not made.sound:
        raise DegenseError(f"What {program.name} needs cannot be made: {made.outcome} {made.words}")
    found = Tally(f"{program.name}, {how}")
    sign = ENDS[how]
    cut = _cut_power if sign is None else partial(_kill, sign)
    for words, killed in cut(program, whole, at, count, rng, longest):
        if (scratch / "failed").exists():
            raise DegenseError(f"{program.name} failed by itself: {(scratch / 'failed').read_text(encoding='utf-8')}")
        found.add(guarded(partial(program.check, at, killed), PATIENCE, 16 << 10), words)
    shutil.rmtree(scratch)
    return found


Ends = Iterator[tuple[str, Killed]]


def _kill(sign: signal.Signals, program: Program, whole: Path, at: Path, count: int, rng: random.Random, longest: float) -> Ends:
    alone = longest  # seconds that it takes undisturbed, which the first case shows
    for case in range(-1, count):
        shutil.rmtree(at, ignore_errors=True)
        shutil.copytree(whole, at)
        (at / "out").mkdir()
        begin = time.monotonic()
        child = _started(lambda: program.work(at), whole.parent / "failed")
        delay = rng.uniform(0.0, alone) if case >= 0 else longest
        ended = _wait(child, delay)
        if case < 0:
            alone = min(longest, time.monotonic() - begin) if ended else longest
        moment = time.monotonic()
        _signal(child, sign)
        if not _wait(child, PATIENCE):
            _signal(child, signal.SIGKILL)
            _wait(child, PATIENCE)
        if case >= 0:
            yield f"case {case}, after {delay:.2f} s", Killed(moment, power=False)


def _cut_power(program: Program, whole: Path, at: Path, count: int, rng: random.Random, longest: float) -> Ends:
    """One run is recorded; the power fails at `count` moments of it."""
    shutil.copytree(whole, at)
    out, log = at / "out", whole.parent / "log"
    out.mkdir()
    inode = out.stat().st_ino

    def work() -> None:
        record(out, log)
        program.work(at)

    child = _started(work, whole.parent / "failed")
    if not _wait(child, 2 * longest):
        _signal(child, signal.SIGKILL)
        _wait(child, PATIENCE)
    first, last = moments(log)
    for case in range(count):
        shutil.rmtree(out)
        moment = rng.uniform(first, last)
        lay_out(log, moment, inode, out)
        yield f"case {case}, after {moment - first:.2f} s", Killed(moment, power=True)


def _started(work: Callable[[], object], failed: Path) -> int:
    """Do something in a fork, of which the process number is returned; what goes wrong there is written into a file."""
    child = os.fork()
    if child:
        return child
    silence()
    try:
        work()
    except Exception:
        failed.write_text(traceback.format_exc(), encoding="utf-8")
    finally:
        os._exit(0)


def _signal(child: int, sign: signal.Signals) -> None:
    if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        os.kill(child, sign)


def _wait(child: int, seconds: float) -> bool:
    """Whether a process has ended by then."""
    end = time.monotonic() + seconds
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        if time.monotonic() > end:
            return False
        time.sleep(0.002)
    return True
