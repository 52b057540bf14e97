"""A process that does one job after the other and tells how far it is, in JSON lines over its standard streams; nothing is pickled."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import IO, Any

from degense.engine.untrusted import parse_json

SAVE_SECONDS, TERMINATE_SECONDS = 30.0, 5.0
POLL_SECONDS = 0.1
MAX_LINE = 1 << 20


class ProcessGone(Exception):
    """The process ended without an answer; the words say how."""


class JobProcess:
    """The side that gives the jobs.

    It sends `{"do": JOB}` and `{"stop": true}`; the process answers with any JSON objects, of which one with "outcome" ends the job. The
    process ends itself when its standard input closes, so that it does not outlive this one, killed or not (`serve` does so).
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        flags: dict[str, Any] = {"start_new_session": True}  # Ctrl-C at the terminal is for this process, which asks the other to stop
        if sys.platform == "win32":
            flags = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env={**os.environ, **environment}, **flags)
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._complaints: deque[str] = deque(maxlen=30)
        listeners = ((self._hear, self._process.stdout), (self._overhear, self._process.stderr))
        self._listeners = [threading.Thread(target=target, args=(stream,), daemon=True) for target, stream in listeners]
        for listener in self._listeners:
            listener.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def do(self, job: Mapping[str, Any], tell: Callable[[dict[str, Any]], None], stop: Callable[[], bool]) -> dict[str, Any]:
        """The answer with "outcome". What comes before it is told; when `stop()` turns true the process is asked to stop.

        One that does not is terminated, and at last killed. ProcessGone when it ends, or is ended, without an outcome.
        """
        self._send({"do": dict(job)})
        asked: float | None = None
        while True:
            if asked is None and stop():
                asked = time.monotonic()
                self._send({"stop": True})
            if asked is not None and time.monotonic() - asked > SAVE_SECONDS:
                self.close()
            try:
                answer = self._answers.get(timeout=POLL_SECONDS)
            except queue.Empty:
                continue
            if answer is None:
                self.close()
                raise ProcessGone(self._last_words())
            if "outcome" in answer:
                return answer
            tell(answer)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def close(self) -> None:
        """End the process: its input closes, then it is terminated, then killed."""
        process = self._process
        assert process.stdin is not None
        with suppress(OSError):  # it has gone, with words unread
            process.stdin.close()
        for insist in (lambda: None, process.terminate, process.kill):
            insist()
            try:
                process.wait(TERMINATE_SECONDS)
                break
            except subprocess.TimeoutExpired:
                continue
        for listener in self._listeners:
            listener.join(TERMINATE_SECONDS)

    def _send(self, words: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # the end of its output says that it has gone
            self._process.stdin.write(json.dumps(words).encode() + b"\n")
            self._process.stdin.flush()

    def _hear(self, stream: IO[bytes]) -> None:
        with stream:
            while line := stream.readline(MAX_LINE):
                try:
                    answer = parse_json(line)
                except ValueError:
                    continue
                if isinstance(answer, dict):
                    self._answers.put(answer)
        self._answers.put(None)

    def _overhear(self, stream: IO[bytes]) -> None:
        with stream:
            while line := stream.readline(MAX_LINE):
                if text := line.decode("utf-8", "replace").strip():
                    self._complaints.append(text[:500])

    def _last_words(self) -> str:
        status = self._process.wait()
        how = f"was ended by the system (signal {-status})" if status < 0 else f"ended with status {status}"
        return f"its process {how}" + (f": {self._complaints[-1]}" if self._complaints and status > 0 else "")


Tell = Callable[[dict[str, Any]], None]


def serve(work: Callable[[dict[str, Any], Tell, Callable[[], bool]], dict[str, Any]]) -> None:
    """The side that does the jobs, until its standard input closes: `work(job, tell, stop)` returns the answer with "outcome".

    What libraries print goes to standard error. When the other side has gone the process ends at once, whatever it does: what it keeps is
    written whole or not at all.
    """
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as lines:
        os.dup2(2, 1)
        jobs: queue.Queue[dict[str, Any]] = queue.Queue()
        stop, lock = threading.Event(), threading.Lock()

        def tell(words: dict[str, Any]) -> None:
            with lock:
                lines.write(json.dumps(words) + "\n")
                lines.flush()

        threading.Thread(target=_listen, args=(jobs, stop), name="orders", daemon=True).start()
        while True:
            job = jobs.get()
            try:
                tell(work(job, tell, stop.is_set))
            except BrokenPipeError:
                os._exit(1)


def _listen(jobs: queue.Queue[dict[str, Any]], stop: threading.Event) -> None:
    # os.read, not sys.stdin: a thread that waits inside sys.stdin's lock makes Python abort at exit.
    rest = b""
    while piece := os.read(0, 1 << 16):
        *lines, rest = (rest + piece).split(b"\n")
        for line in lines:
            words = json.loads(line)
            if "do" in words:
                stop.clear()
                jobs.put(words["do"])
            elif "stop" in words:
                stop.set()
    os._exit(1)
