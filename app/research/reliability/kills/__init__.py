"""Programs that write are killed at random moments, or lose their power; what they leave opens, or says in a sentence what is lost."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import accumulate
from pathlib import Path

from degense.app.research.reliability.guarded import guarded, silence
from degense.app.research.reliability.kills.disk import Disk
from degense.app.research.reliability.kills.filesystem_log import lay_out, moments, record
from degense.app.research.reliability.kills.program import Killed, Program
from degense.app.research.reliability.kills.programs import programs
from degense.app.research.reliability.kills.system_calls import calls, follow, missing, wait_to_be_followed
from degense.app.research.reliability.tally import Tally
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent

LONGEST, PATIENCE = 15.0, 60.0  # seconds until a kill at the latest, and for which SIGTERM is waited for
COUNT, QUICK_COUNT = 200, 30
POWER = "power cut"


def tallies(count: int, scratch: Path, seed: int, progress: Progress = silent, longest: float = LONGEST) -> Iterator[Tally]:
    """Kill the programs `count` times in all, each as often in each way as it weighs."""
    pairs = [(program, how) for program in programs() for how in program.ends]
    ends = [count * end / sum(program.weight for program, _ in pairs) for end in accumulate(program.weight for program, _ in pairs)]
    for number, (program, how) in enumerate(pairs):
        share = round(ends[number]) - (round(ends[number - 1]) if number else 0)
        progress(number / len(pairs), f"{program.name}, {how}")
        yield tally(program, how, share, scratch.resolve() / f"{number:02d}", seed, longest)


def tally(program: Program, how: str, count: int, scratch: Path, seed: int, longest: float = LONGEST) -> Tally:
    """End one program `count` times in one way. `scratch` is made, and taken away again."""
    found = Tally(f"{program.name}, {how}")
    if how == POWER and program.by_system_calls and (reason := missing()):
        found.note = reason
        return found
    whole, at, rng = scratch / "whole", scratch / "at", random.Random(f"{seed} {program.name} {how}")
    whole.mkdir(parents=True)
    made = guarded(lambda: program.prepare(whole), 600, 16 << 10)
    if not made.sound:
        raise DegenseError(f"What {program.name} needs cannot be made: {made.outcome} {made.words}")
    cut_power = _cut_power_in_calls if program.by_system_calls else _cut_power
    cut = cut_power if how == POWER else partial(_kill, signal.Signals[how])
    for words, killed in cut(program, whole, at, count, rng, longest):
        if (scratch / "failed").exists():
            raise DegenseError(f"{program.name} failed by itself: {(scratch / 'failed').read_text(encoding='utf-8')}")
        begun = program.begun(at)
        found.add(guarded(partial(program.check, at, killed), program.patience, 16 << 10), words, begun)
    shutil.rmtree(scratch)
    return found


Ends = Iterator[tuple[str, Killed]]


def _kill(sign: signal.Signals, program: Program, whole: Path, at: Path, count: int, rng: random.Random, longest: float) -> Ends:
    alone = longest  # seconds that it takes undisturbed, which the first case shows
    for case in range(-1, count):
        shutil.rmtree(at, ignore_errors=True)
        shutil.copytree(whole, at)
        (at / "out").mkdir(exist_ok=True)
        begin = time.monotonic()
        child = _started(lambda: program.work(at), whole.parent / "failed")
        delay = rng.uniform(0.0, alone) if case >= 0 else longest
        ended = _wait(child, delay)
        if case < 0:
            alone = min(longest, time.monotonic() - begin) if ended else longest
        moment = time.monotonic()
        others = _children(child) if rng.random() < 0.5 else []
        _signal(child, sign)
        for other in others:
            with suppress(ProcessLookupError):
                os.kill(other, sign)
        if not _wait(child, PATIENCE):
            _signal(child, signal.SIGKILL)
            _wait(child, PATIENCE)
        if case >= 0:
            yield f"case {case}, after {delay:.2f} s", Killed(moment, power=False)


def _cut_power(program: Program, whole: Path, at: Path, count: int, rng: random.Random, longest: float) -> Ends:
    """What one run syncs is recorded; the power fails at `count` moments of it."""
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


def _cut_power_in_calls(program: Program, whole: Path, at: Path, count: int, rng: random.Random, longest: float) -> Ends:
    """All calls of one run are recorded; the power fails before `count` of those that change the disk."""
    shutil.copytree(whole, at)
    out, log = at / "out", whole.parent / "log"
    out.mkdir(exist_ok=True)
    before = whole.parent / "before"
    shutil.copytree(out, before)

    def work() -> None:
        wait_to_be_followed()
        program.work(at)

    child = _started(work, whole.parent / "failed")
    with follow(child, log):
        if not _wait(child, 2 * longest):
            _signal(child, signal.SIGKILL)
            _wait(child, PATIENCE)
    made = calls(log)
    changes = [place for place, call in enumerate(made) if call.name not in ("openat", "lseek", "close")]
    if not changes:
        raise DegenseError("nothing was written in the time that was given; give more")
    for case in range(count):
        shutil.rmtree(out)
        last = rng.choice(changes)
        disk = Disk(out, before)
        disk.do(made[:last])
        disk.lay_out(out, rng)
        yield f"case {case}, after {last} calls", Killed(time.monotonic(), power=True)


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


def _children(process: int) -> list[int]:
    """The processes that one has started."""
    return [int(child) for path in Path(f"/proc/{process}/task").glob("*/children") for child in path.read_text(encoding="ascii").split()]


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
