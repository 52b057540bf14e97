"""How `degense batch` shows how far it is: a table that stays in place, plain lines, or JSON lines."""

from __future__ import annotations

import json
import shutil
import sys
import time

from degense.app.batch.progress import BatchProgress, JobProgress

DRAW_SECONDS = 0.2


class JsonLines:
    """Every change as one JSON object a line on standard output."""

    def begin(self, progress: BatchProgress) -> None:
        count = progress.count()
        print(json.dumps({"event": "batch", "jobs": len(progress.jobs), "done": count["done"]}), flush=True)

    def changed(self, job: JobProgress) -> None:
        print(json.dumps(job.to_json(), ensure_ascii=False), flush=True)

    def end(self) -> None:
        pass


class PlainLines:
    """On standard error, a line when a job begins a stage or ends."""

    def __init__(self) -> None:
        self._shown: dict[str, tuple[str, str]] = {}
        self._progress: BatchProgress | None = None

    def begin(self, progress: BatchProgress) -> None:
        self._progress = progress
        print(summary(progress), file=sys.stderr, flush=True)

    def changed(self, job: JobProgress) -> None:
        state = (job.state, job.stage)
        if self._shown.get(job.name) == state or (job.state == "running" and not job.stage):
            return
        self._shown[job.name] = state
        assert self._progress is not None
        if job.state == "running":
            words = job.stage
        else:
            words = " ".join(filter(None, [job.state, f"after {job.seconds:.0f} s" if job.seconds else "", job.words and f"({job.words})"]))
            words += f"; {summary(self._progress)}"
        print(f"{job.name}: {words}", file=sys.stderr, flush=True)

    def end(self) -> None:
        pass


class TerminalTable:
    """On a terminal: a line for all, and as many as fit for jobs that run, failed, were stopped or wait for something; drawn over."""

    def __init__(self) -> None:
        self._stream, self._height, self._last = sys.stderr, 0, 0.0
        self._progress: BatchProgress | None = None
        self._begun = time.monotonic()

    def begin(self, progress: BatchProgress) -> None:
        self._progress = progress
        self._draw()

    def changed(self, job: JobProgress) -> None:
        if time.monotonic() - self._last >= DRAW_SECONDS or job.state != "running":
            self._draw()

    def end(self) -> None:
        self._draw()

    def lines(self, width: int, height: int) -> list[str]:
        """What is shown on so many columns and rows."""
        assert self._progress is not None
        jobs = list(self._progress.jobs.values())
        shown = [job for state in ("waiting", "running", "failed", "stopped") for job in jobs if job.state == state]
        shown = [job for job in shown if job.state != "waiting" or job.words]
        room = max(1, height - 3)
        name = min(32, max((len(job.name) for job in shown[:room]), default=0))
        lines = [f"{summary(self._progress)}, {time.monotonic() - self._begun:.0f} s"]
        lines += [_row(job, name) for job in shown[:room]]
        if len(shown) > room:
            lines.append(f"… and {len(shown) - room} more")
        return [line[: width - 1] for line in lines]

    def _draw(self) -> None:
        size = shutil.get_terminal_size()
        lines = self.lines(size.columns, size.lines)
        up = f"\x1b[{self._height}A" if self._height else ""
        self._stream.write(f"\r{up}\x1b[J" + "\n".join(lines) + "\n")
        self._stream.flush()
        self._height, self._last = len(lines), time.monotonic()


def summary(progress: BatchProgress) -> str:
    """How many jobs are in which state."""
    count = progress.count()
    words = [f"{count['done']} of {len(progress.jobs)} done"]
    words += [f"{count[state]} {state}" for state in ("running", "failed", "stopped", "waiting") if count[state]]
    return ", ".join(words)


def _row(job: JobProgress, name: int) -> str:
    if job.state != "running":
        return f"{job.name:<{name}.{name}}  {job.state}: {job.words}"
    filled = round(16 * min(1.0, max(0.0, job.fraction)))
    return f"{job.name:<{name}.{name}}  [{'#' * filled}{'.' * (16 - filled)}] {job.stage:<12.12} {job.words}"
