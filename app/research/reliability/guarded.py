"""Runs something in a process of its own, with bounds on its time and memory, and says what became of it."""

from __future__ import annotations

import os
import re
import resource
import select
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from degense.engine.errors import LONGEST, DegenseError

READ, REFUSED = "read", "refused"
#: What belongs to Python and not to a reader.
PYTHONS = re.compile(r"Traceback|NoneType|has no attribute|object at 0x|<class |\w+(?:Error|Exception|Warning)\b|Errno")


@dataclass(frozen=True)
class Fate:
    """What became of a call: "read", "refused", or in capitals what is wrong; in words; its seconds."""

    outcome: str
    words: str = ""
    seconds: float = 0.0

    @property
    def sound(self) -> bool:
        return self.outcome in (READ, REFUSED)


def guarded(work: Callable[[], object], seconds: float, mebibytes: int) -> Fate:
    """Do `work` in a fork that may take `mebibytes` more than this process has, and is killed when after `seconds` it has not ended.

    A process that only waits for a core is given time until it has had `seconds` of one.

    A DegenseError of one sentence (`is_sentence`) is a refusal; any other exception, signal, hang or want of memory is a defect.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    answers, writing = os.pipe()
    begin = time.perf_counter()
    child = os.fork()
    if child == 0:
        os.close(answers)
        _do(work, writing, mebibytes)
    os.close(writing)
    ready, _, _ = select.select([answers], [], [], seconds)
    while not ready and waits_for_a_core(child, seconds):
        ready, _, _ = select.select([answers], [], [], 1.0)
    if not ready:
        os.kill(child, signal.SIGKILL)
    text = os.read(answers, 1 << 16).decode("utf-8", "replace") if ready else ""
    os.close(answers)
    _, status = os.waitpid(child, 0)
    spent = time.perf_counter() - begin
    if not ready:
        return Fate("HUNG", f"more than {seconds:g} s", spent)
    outcome, _, words = text.partition("\n")
    return Fate(outcome, words, spent) if outcome else Fate("DIED", f"status {status}", spent)


def waits_for_a_core(process: int, seconds: float) -> bool:
    """Whether a process would go on if the machine were not busy: it could run, and has had less than `seconds` of processor time."""
    threads = [path.read_text(encoding="ascii").rpartition(")")[2].split() for path in Path(f"/proc/{process}/task").glob("*/stat")]
    ticks = sum(int(thread[11]) + int(thread[12]) for thread in threads)
    return any(thread[0] in "RD" for thread in threads) and ticks < seconds * os.sysconf("SC_CLK_TCK")


def is_sentence(text: str) -> bool:
    """Whether a text can be shown as it is: a line of at least three words and at most `LONGEST` letters, none of them Python's own."""
    return text.isprintable() and text == text.strip() and len(text.split()) >= 3 and len(text) <= LONGEST and not PYTHONS.search(text)


def silence() -> None:
    """From now on this process prints nothing and reads nothing from its terminal."""
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(quiet, stream)


def _do(work: Callable[[], object], writing: int, mebibytes: int) -> None:
    """The child's side: it never returns."""
    silence()
    with open("/proc/self/statm", encoding="ascii") as file:
        pages = int(file.read().split()[0])
    most = pages * resource.getpagesize() + (mebibytes << 20)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        work()
        text = READ
    except DegenseError as error:
        text = f"{REFUSED if is_sentence(str(error)) else 'NO SENTENCE'}\n{error}"
    except MemoryError:
        text = "MEMORY\n" + _where()
    except BaseException as error:
        text = f"CRASHED\n{type(error).__name__}: {str(error)[:300]} {_where()}"
    os.write(writing, text.encode("utf-8", "replace")[: 1 << 15])
    os._exit(0)


def _where() -> str:
    """The last places of ours in the traceback of the present exception."""
    places, trace = [], sys.exc_info()[2]
    while trace is not None:
        code = trace.tb_frame.f_code
        places.append(f"{os.sep.join(code.co_filename.split(os.sep)[-2:])}:{trace.tb_lineno}")
        trace = trace.tb_next
    return " < ".join(reversed(places[-6:]))
