"""A report of what is open, as one file."""

from __future__ import annotations

from degense.app.features.report.controller import Reporter
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer, session = shell.service(Viewer), shell.session
    if viewer is None:
        return
    reporter = Reporter(viewer)
    shell.provide(reporter)
    ask, menu = reporter.ask, ("File", "Export")
    shell.add_actions(Action("export.report", "Report…", ask, menu, ("Ctrl+Alt+R",), lambda: session.frames > 0, group=1, help="pdf html"))
