"""Labelling frames and reviewing labels."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from degense.app.features.annotate.controller import Annotator
from degense.app.features.annotate.exchange import LabelExchange
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.annotate.tool import TOOLS, ToolKind
from degense.app.features.train.controller import Training
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.engine.annotation.formats import LABEL_FORMATS

#: Whether something can be done now.
Condition = Callable[[], bool]
MENU, IMPORT = ("Annotate",), ("Annotate", "Import labels")


def install(shell: Shell) -> None:
    viewer = shell.service(Viewer)
    if viewer is None:
        return
    state = AnnotationState(shell.session)
    shell.session.register("annotations", state)
    shell.worker.add_channel("annotate", 60)
    annotator, exchange = Annotator(viewer, state), LabelExchange(shell, state, shell.service(Training))
    for service in (state, annotator, exchange):
        shell.provide(service)
    tool = state.tool

    def ready() -> bool:
        return tool.active and state.work is not None

    def has_frames() -> bool:
        return shell.session.frames > 0

    toggle = Action("annotate.mode", "Annotate", annotator.toggle, MENU, ("A",), has_frames, lambda: tool.active, help="label masks paint")
    shell.add_actions(toggle, *_painting(annotator, ready), *_review(annotator, ready), *_exchange(state, exchange, has_frames))


def _painting(annotator: Annotator, ready: Condition) -> list[Action]:
    session, painter, tool = annotator.session, annotator.painter, annotator.state.tool

    def has_prompt() -> bool:
        return ready() and session.scene is not None and bool(session.view_state.visible_prompts)

    def tool_action(kind: ToolKind) -> Action:
        choose, keys = partial(tool.choose, kind.name), "tool; 1–9 choose the class, [ and ] the size"
        return Action(f"annotate.{kind.name}", kind.title, choose, MENU, (kind.key,), ready, lambda: tool.name == kind.name, 1, keys)

    return [
        *map(tool_action, TOOLS),
        Action("annotate.holes", "Fill holes of the class", painter.fill_holes, MENU, ("H",), ready, group=2),
        Action("annotate.largest", "Keep the largest part of the class", painter.keep_largest, MENU, (), ready, group=2),
        Action("annotate.prompt", "Take the masks of the prompts", painter.paint_prompts, MENU, (), has_prompt, group=2),
    ]


def _review(annotator: Annotator, ready: Condition) -> list[Action]:
    session, state, review = annotator.session, annotator.state, annotator.review

    def busy() -> bool:
        return annotator.shell.worker.busy("annotate")

    def can_propagate() -> bool:
        return ready() and session.clip is not None and not busy()

    def proposed() -> bool:
        return ready() and state.work is not None and state.work.record(session.frame).proposal is not None

    def any_proposed() -> bool:
        return ready() and state.work is not None and bool(state.work.waiting())

    accept, reject = partial(review.answer, state.accept), partial(review.answer, state.reject)
    accept_all, reject_all = partial(accept, all_frames=True), partial(reject, all_frames=True)
    done, flag = partial(state.set_status, "done"), partial(state.set_status, "flagged")
    return [
        Action("annotate.propagate", "Propagate labels to all frames", review.propagate, MENU, ("Ctrl+G",), can_propagate, None, 3, "time"),
        Action("annotate.stop", "Stop propagating", review.stop, MENU, (), busy, group=3),
        Action("annotate.accept", "Accept this frame's proposal", accept, MENU, ("Y",), proposed, group=4),
        Action("annotate.reject", "Reject this frame's proposal", reject, MENU, ("Shift+Y",), proposed, group=4),
        Action("annotate.accept-all", "Accept all proposals", accept_all, MENU, (), any_proposed, group=4),
        Action("annotate.reject-all", "Reject all proposals", reject_all, MENU, (), any_proposed, group=4),
        Action("annotate.done", "This frame is done", done, MENU, ("D",), ready, group=5, help="review"),
        Action("annotate.flag", "Flag this frame", flag, MENU, ("Shift+F",), ready, group=5, help="review"),
        Action("annotate.next", "Next doubtful frame (N)", partial(review.go_on, 1), MENU, (), ready, group=5, help="flagged review"),
        Action("annotate.previous", "Previous doubtful frame (P)", partial(review.go_on, -1), MENU, (), ready, group=5, help="flagged"),
    ]


def _exchange(state: AnnotationState, exchange: LabelExchange, has_frames: Condition) -> list[Action]:
    session, training = exchange.session, exchange.training

    def has_labels() -> bool:
        return state.work is not None and any(record.labels is not None for record in state.work.records.values())

    def can_train() -> bool:
        return has_labels() and session.clip is not None and training is not None and not training.running

    return [
        Action("annotate.teach", "Train with these labels…", exchange.teach, MENU, (), can_train, group=6, help="teacher"),
        *(
            Action(f"annotate.import-{name}", f"From {entry.title}…", partial(exchange.ask_to_import, name), IMPORT, (), has_frames)
            for name, entry in LABEL_FORMATS.items()
        ),
    ]
