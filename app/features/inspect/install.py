"""Looking closely: what moved, how far, and where it moved without reason."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from degense.app.features.inspect.findings import Findings
from degense.app.features.inspect.probe import Probe
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer = shell.service(Viewer)
    if viewer is None:
        return
    for channel, urgency in (("material", 31), ("probe", 50), ("curves", 51), ("rank", 52)):
        shell.worker.add_channel(channel, urgency)
    probe, findings = Probe(viewer), Findings(viewer)
    shell.provide(probe)
    shell.provide(findings)
    _add_actions(shell, probe, findings)


def _add_actions(shell: Shell, probe: Probe, findings: Findings) -> None:
    session, menu = shell.session, ("Inspect",)

    def has_scene() -> bool:
        return session.scene is not None

    def listed() -> bool:
        return bool(findings.findings())

    def ask(what: str, save: Callable[[Path], None]) -> None:
        path = shell.ask_save(f"Save {what}", f"{session.name}-{what}.csv", "Table (*.csv);;Picture (*.png)")
        if path is not None:
            shell.attempt(lambda: save(path))

    shell.add_actions(
        *(
            Action(
                f"inspect.{name}",
                f"Follow a region: {name}",
                partial(probe.take_tool, name),
                menu,
                (key,),
                has_scene,
                partial(probe.has_tool, name),
                help="probe curves outline",
            )
            for name, key in (("rectangle", "B"), ("lasso", "L"))
        ),
        Action(
            "inspect.mask",
            "Follow the mask of a prompt",
            probe.follow_mask,
            menu,
            ("K",),
            lambda: has_scene() and bool(session.view_state.visible_prompts),
            help="probe curves class area",
        ),
        Action("inspect.unpin", "Follow nothing", probe.unpin, menu, ("Escape",), lambda: session.probe is not None, help="probe"),
        Action(
            "inspect.save-curves",
            "Save the curves…",
            partial(ask, "curves", probe.save_curves),
            menu,
            (),
            lambda: probe.curves is not None,
            help="csv png table",
        ),
        Action("inspect.rank", "Find the worst places", findings.search, menu, ("Shift+W",), findings.can_search, group=1, help="ranking"),
        Action("inspect.next", "Next finding", partial(findings.go_on, 1), menu, ("N",), listed, group=1),
        Action("inspect.previous", "Previous finding", partial(findings.go_on, -1), menu, ("Shift+N",), listed, group=1),
        Action(
            "inspect.save-findings",
            "Save the findings…",
            partial(ask, "findings", findings.save),
            menu,
            (),
            listed,
            group=1,
            help="csv png table sheet",
        ),
    )
