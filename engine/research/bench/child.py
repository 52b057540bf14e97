"""Work in a process of its own: as a user's command would run it, and with a peak of memory that is its own."""

from __future__ import annotations

import multiprocessing
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from degense.engine.errors import DegenseError
from degense.engine.processes.parent import end_with_parent
from degense.engine.progress import Progress

#: `work(*arguments, progress)`: a module's function; arguments and result are plain enough to be sent.
Work = Callable[..., Any]
Value = TypeVar("Value")


def in_child(work: Work, *arguments: object, progress: Progress) -> Any:
    """What `work` returns in a fresh process, whose progress is passed on.

    A DegenseError is raised here as it was there; anything else becomes a RuntimeError with its traceback. The process does not outlive
    the call.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_serve, args=(sender, work, arguments), daemon=True)
    child.start()
    sender.close()
    try:
        while True:
            kind, payload = receiver.recv()
            if kind == "done":
                return payload
            if kind == "refused":
                raise DegenseError(payload)
            if kind == "failed":
                raise RuntimeError(f"{work.__name__} failed in its process:\n{payload}")
            progress(*payload)
    except EOFError as error:
        child.join()
        raise RuntimeError(f"{work.__name__} ended without a result (exit status {child.exitcode})") from error
    finally:
        child.terminate()
        child.join()
        receiver.close()


def call_in_child(work: Callable[..., Value], *arguments: object) -> Value:
    """`work(*arguments)` in a fresh process. Its exceptions are raised here as they are: in a stress test what is refused is an outcome.

    `work` must be a module's function, its arguments and its value plain enough to be sent.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context, initializer=end_with_parent) as pool:
        return pool.submit(work, *arguments).result()


def _serve(sender: Connection, work: Work, arguments: tuple[object, ...]) -> None:
    end_with_parent()
    try:
        sender.send(("done", work(*arguments, lambda fraction, message: sender.send(("progress", (fraction, message))))))
    except DegenseError as error:
        sender.send(("refused", str(error)))
    except Exception:
        sender.send(("failed", traceback.format_exc()))


def peak_memory() -> float | None:
    """The most memory this process ever held, MB, interpreter and libraries included; None where the system does not tell (not Linux).

    The kernel's high-water mark of this program alone. `ru_maxrss` would not do: it begins at that of the process that started it.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        return None
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))
