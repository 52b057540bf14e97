"""Labelling frames and reviewing labels."""

from __future__ import annotations

from functools import partial

from degense.app.features.annotate.controller import Annotator
from degense.app.features.annotate.exchange import LabelExchange
from degense.app.features.annotate.state import TOOLS
from degense.app.features.train.controller import Training
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.engine.annotation.formats import LABEL_FORMATS

TOOL_TITLES = {"brush": "Brush", "eraser": "Eraser", "superpixels": "Superpixel brush", "polygon": "Polygon", "fill": "Fill"}
TOOL_KEYS = {"brush": "R", "eraser": "E", "superpixels": "S", "polygon": "P", "fill": "G"}
MENU, IMPORT, EXPORT = ("Annotate",), ("Annotate", "Import labels"), ("Annotate", "Export labels")


def install(shell: Shell) -> None:
    viewer = shell.service(Viewer)
    if viewer is None:
        return
    shell.worker.add_channel("annotate", 60)
    annotating, exchange = Annotator(viewer), LabelExchange(shell, shell.service(Training))
    shell.provide(annotating)
    shell.provide(exchange)
    _add_actions(shell, annotating, exchange)


def _add_actions(shell: Shell, annotating: Annotator, exchange: LabelExchange) -> None:
    session, training = shell.session, shell.service(Training)
    part = session.annotations

    def on() -> bool:
        return part.active and part.work is not None

    def has_frames() -> bool:
        return session.frames > 0

    def is_tool(tool: str) -> bool:
        return part.tool == tool

    def waits() -> bool:
        return on() and part.work is not None and part.work.record(session.frame).proposal is not None

    def any_waits() -> bool:
        return on() and part.work is not None and bool(part.work.waiting())

    def can_carry() -> bool:
        return on() and session.clip is not None and not shell.worker.busy("annotate")

    def has_prompt() -> bool:
        return on() and session.scene is not None and bool(session.view_state.visible_prompts)

    def has_labels() -> bool:
        return part.work is not None and any(record.labels is not None for record in part.work.records.values())

    def can_teach() -> bool:
        return has_labels() and session.clip is not None and training is not None and not training.running

    shell.add_actions(
        Action("annotate.mode", "Annotate", annotating.toggle, MENU, ("A",), has_frames, lambda: part.active, help="label masks paint"),
        *(
            Action(
                f"annotate.{tool}",
                TOOL_TITLES[tool],
                partial(part.choose, tool),
                MENU,
                (TOOL_KEYS[tool],),
                on,
                partial(is_tool, tool),
                group=1,
                help="tool; 1–9 choose the class, [ and ] the size",
            )
            for tool in TOOLS
        ),
        Action("annotate.holes", "Fill holes of the class", annotating.fill_holes, MENU, ("H",), on, group=2),
        Action("annotate.largest", "Keep the largest part of the class", annotating.keep_largest, MENU, (), on, group=2),
        Action("annotate.prompt", "Take the masks of the prompts", annotating.take_prompt, MENU, (), has_prompt, group=2),
        Action(
            "annotate.propagate",
            "Carry labels to all frames",
            annotating.propagate,
            MENU,
            ("Ctrl+G",),
            can_carry,
            group=3,
            help="time",
        ),
        Action("annotate.stop", "Stop carrying", annotating.stop, MENU, (), lambda: shell.worker.busy("annotate"), group=3),
        Action("annotate.accept", "Accept this frame's proposal", annotating.accept, MENU, ("Y",), waits, group=4),
        Action("annotate.reject", "Reject this frame's proposal", annotating.reject, MENU, ("Shift+Y",), waits, group=4),
        Action("annotate.accept-all", "Accept all proposals", annotating.accept_all, MENU, (), any_waits, group=4),
        Action("annotate.reject-all", "Reject all proposals", annotating.reject_all, MENU, (), any_waits, group=4),
        Action("annotate.done", "This frame is done", partial(part.set_status, "done"), MENU, ("D",), on, group=5, help="review"),
        Action("annotate.flag", "Flag this frame", partial(part.set_status, "flagged"), MENU, ("Shift+F",), on, group=5, help="review"),
        Action("annotate.next", "Next flagged frame (Tab)", annotating.go_to_flagged, MENU, (), on, group=5, help="doubtful review"),
        Action("annotate.teach", "Train with these labels…", exchange.teach, MENU, (), can_teach, group=6, help="teacher"),
        *(
            Action(f"annotate.import-{name}", f"From {entry.title}…", partial(exchange.ask_to_import, name), IMPORT, (), has_frames)
            for name, entry in LABEL_FORMATS.items()
        ),
        *(
            Action(f"annotate.export-{name}", f"As {entry.title}…", partial(exchange.ask_to_export, name), EXPORT, (), has_labels)
            for name, entry in LABEL_FORMATS.items()
        ),
    )
