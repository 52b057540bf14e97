"""Inspection: values under the cursor, curves over time, and the worst frames and places of a layer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from degense.app.features.inspect.findings import Findings
from degense.app.features.inspect.probe import Probe
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer, guides = shell.service(Viewer), shell.service(GuideSwitches)
    if viewer is None or guides is None:
        return
    for channel, urgency in (("material", 31), ("probe", 50), ("curves", 51), ("rank", 52)):
        shell.worker.add_channel(channel, urgency)
    probe, findings = Probe(viewer, guides), Findings(viewer)
    shell.provide(probe)
    shell.provide(findings)
    _add_probe_actions(shell, probe)
    _add_findings_actions(shell, findings)


def _add_probe_actions(shell: Shell, probe: Probe) -> None:
    session, menu, has_scene = shell.session, ("Inspect",), shell.session.has_scene

    def has_mask() -> bool:
        return has_scene() and bool(session.view_state.visible_prompts)

    def can_measure() -> bool:
        return probe.curves is not None and probe.curves.trail is not None

    def region(name: str, key: str) -> Action:
        run, chosen = partial(probe.take_tool, name), partial(probe.has_tool, name)
        return Action(f"inspect.{name}", f"Follow a region: {name}", run, menu, (key,), has_scene, chosen, help="probe curves outline")

    save = partial(_save, shell, "curves", probe.save_curves)
    shell.add_actions(
        region("rectangle", "R"),
        region("lasso", "L"),
        Action("inspect.mask", "Follow the mask of a prompt", probe.follow_mask, menu, ("K",), has_mask, help="probe curves class area"),
        Action("inspect.measure", "Measure a length from here", probe.measure_from, menu, (), can_measure, help="distance ruler mm 3D"),
        Action("inspect.unpin", "Follow nothing", probe.unpin, menu, ("Escape",), lambda: session.probe is not None, help="probe"),
        Action("inspect.save-curves", "Save the curves…", save, menu, (), lambda: probe.curves is not None, help="csv png table"),
    )


def _add_findings_actions(shell: Shell, findings: Findings) -> None:
    menu = ("Inspect",)

    def listed() -> bool:
        return bool(findings.findings())

    save = partial(_save, shell, "findings", findings.save)
    shell.add_actions(
        Action("inspect.rank", "Find the worst places", findings.search, menu, ("Shift+W",), findings.can_search, group=1, help="ranking"),
        Action("inspect.next", "Next finding", partial(findings.go_on, 1), menu, ("N",), listed, group=1),
        Action("inspect.previous", "Previous finding", partial(findings.go_on, -1), menu, ("Shift+N",), listed, group=1),
        Action("inspect.save-findings", "Save the findings…", save, menu, (), listed, group=1, help="csv png table sheet"),
    )


def _save(shell: Shell, what: str, save: Callable[[Path], None]) -> None:
    path = shell.ask_save(f"Save {what}", f"{shell.session.name}-{what}.csv", "Table (*.csv);;Image (*.png)")
    if path is not None:
        shell.attempt(lambda: save(path))
