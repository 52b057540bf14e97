"""Files that the worker writes while the window goes on."""

from __future__ import annotations

from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.worker import Job, RenderService


def write_in_worker(service: RenderService, parts: Parts, words: str, job: Job, *, detailed: bool = False) -> None:
    """Run an export; Export ▸ Stop exporting ends it.

    Parameters
    ----------
    words : str
        Shown while it runs, for example "Exporting liver.mp4".
    job : Job
        Its steps are (fraction, what is being done), its answer is the sentence to show at the end.
    detailed : bool
        Show what is being done too.
    """

    def done(text: str) -> None:
        parts.set_busy()
        parts.say(text)

    def failed(message: str) -> None:
        parts.set_busy()
        show_error(parts.window, message)

    def progress(step: tuple[float, str]) -> None:
        parts.set_busy(f"{words}: {step[1]}" if detailed else words, step[0])

    service.submit("export", job, done, failed, progress)
