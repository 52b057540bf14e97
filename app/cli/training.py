"""`degense train`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import sys
import threading
import traceback
from contextlib import nullcontext
from types import FrameType

from degense.app.cli.options import chosen_encoder, clip_options, refuse_non_empty
from degense.app.cli.training_events import JsonEvents, TensorBoardEvents, TerminalEvents
from degense.engine.errors import OUT_OF_MEMORY, DegenseError, is_out_of_memory
from degense.engine.events import Event, Events, Failed, Stopped


def train(options: argparse.Namespace) -> None:
    """Train in this process. With `--events`, print JSON lines; otherwise show a bar."""
    if ("help", "") in options.settings:
        return list_settings(options.preset)
    stop = StopFlag()
    report: Events = JsonEvents(stop.set) if options.events else TerminalEvents()
    if options.events:
        stop.listen()
    with stop:
        try:
            _train(options, report, stop)
        except DegenseError as error:
            report(Failed(str(error)))
            raise
        except Exception as error:
            if is_out_of_memory(error):
                report(Failed(OUT_OF_MEMORY))
                raise DegenseError(OUT_OF_MEMORY) from error
            report(Failed(f"Training met a defect of the program ({type(error).__name__}: {error})."))
            traceback.print_exc()
            raise SystemExit(1) from error


def _train(options: argparse.Namespace, report: Events, stop: StopFlag) -> None:
    if not options.resume:
        refuse_non_empty(options.out)
    if options.system or options.resume or str(options.teacher).startswith(("degraded", "unseen")):
        importlib.import_module("degense.engine.research")  # adds teachers and distillations that a run may have begun with
    from degense.app.features.train.job import parse_settings
    from degense.engine.data.readers import open_clip
    from degense.engine.profile import recording
    from degense.engine.training import TrainConfig
    from degense.engine.training import train as run_training
    from degense.engine.training.config import choose_device

    config = TrainConfig.preset_of(
        options.preset,
        routing=options.routing,
        iterations=options.iterations,
        max_gaussians=options.max_gaussians,
        device=options.device,
        seed=options.seed,
        **parse_settings(tuple(options.settings)),
    )
    if options.system:
        config = importlib.import_module("degense.engine.research.systems").training_of(options.system, config)
    clip = open_clip(options.clip, clip_options(options))
    recorder = recording(choose_device(config.device).type) if options.profile else nullcontext()
    board = TensorBoardEvents(options.out) if options.logger == "tensorboard" else None
    stopped = False

    def tell(event: Event) -> None:
        nonlocal stopped
        stopped = stopped or isinstance(event, Stopped)
        report(event)
        if board is not None:
            board(event)

    encoder = chosen_encoder(options)
    try:
        with recorder as profile:
            run = run_training(
                clip, options.out, config, teacher=options.teacher, encoder=encoder, resume=options.resume, events=tell, stop=stop
            )
    finally:
        if board is not None:
            board.close()
    if run is None and not stopped:  # it had not come to its first step
        report(Stopped(0))
    if profile is not None and options.out.is_dir():
        from degense.app.cli.profile_report import write_profile

        print(write_profile(profile, options.out), file=sys.stderr, flush=True)


def list_settings(preset: str) -> None:
    """What `--set` takes, by group, with the values of a preset."""
    from degense.app.features.train.settings_help import settings_of
    from degense.engine.training.config import GROUPS, TrainConfig

    settings = {setting.name: setting for setting in settings_of(TrainConfig.preset_of(preset))}
    for title, names in GROUPS.items():
        print(f"\n{title}\n")
        for setting in (settings[name] for name in names if name in settings):
            value = list(setting.value) if isinstance(setting.value, tuple) else setting.value
            print(f"{setting.name}={json.dumps(value)}\n    {setting.words}")


class StopFlag(threading.Event):
    """Whether the user asked to stop: Ctrl-C, SIGTERM, or `stop` on standard input. Callable, as the trainer wants it.

    As a context it holds the signals; a second Ctrl-C interrupts at once.
    """

    __call__ = threading.Event.is_set

    def __enter__(self) -> StopFlag:
        self._previous = {number: signal.signal(number, self._on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def listen(self) -> None:
        """Watch standard input for a line `stop`. The end of the input means nothing: scripts start us without one."""
        threading.Thread(target=self._read, name="stop listener", daemon=True).start()

    def _read(self) -> None:
        # os.read, not sys.stdin: a thread that waits inside sys.stdin's lock makes Python abort at exit.
        line = b""
        while piece := os.read(0, 4096):
            *lines, line = (line + piece).split(b"\n")
            if any(entry.strip() == b"stop" for entry in lines):
                self.set()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self():
            raise KeyboardInterrupt
        self.set()
