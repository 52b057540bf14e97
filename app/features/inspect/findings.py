"""The worst frames and places of the layer that is shown: searched in the worker, listed, and gone to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QHeaderView, QWidget

from degense.app.features.inspect.findings_files import findings_sheet, findings_table
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.view_rendering import layer_request
from degense.app.session.targets import Spot
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.layer_titles import with_unit
from degense.widgets import forms
from degense.widgets.keys import ARROWS, keep_keys

if TYPE_CHECKING:
    from degense.engine.layers.ranking import Finding, Ranking


#: What is said while nothing is listed, and where there is nothing to search for.
HINT = "Show a layer of motion, such as displacement, speed or spurious warp; Find then lists where it is largest."
#: What the value of a finding is; the probe shows that of a single pixel.
STATISTICS = {"frames": "99th percentile", "places": "Mean around"}


class Findings(QObject):
    """Fills its list while it searches; another layer clears it."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.worker = viewer, viewer.shell, viewer.session, viewer.worker
        self.ranking: Ranking | None = None
        panel = QWidget()
        panel.setAccessibleName("Worst frames and places")
        self._kinds = forms.choice("What is listed", (("frames", "Worst frames"), ("places", "Worst places")), self._list)
        find = forms.button("Find", self.search, "Search all frames of the layer that is shown")
        self._note = forms.label(secondary=True)
        self.table = forms.table("Findings", ["", "", ""])
        self.table.currentCellChanged.connect(lambda row, *_: self._go(row) if row >= 0 else None)
        for column in (0, 1):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        keep_keys(self.table, ARROWS)
        side = forms.column(self._kinds, find, self._note, 0, margin=0)
        forms.row(side, (self.table, 1), parent=panel).setContentsMargins(6, 0, 6, 6)
        self.dock = self.shell.add_dock("Findings", panel)
        self._say(HINT)
        self._list()
        self.session.opened.connect(self._clear)
        self.session.view_state_changed.connect(self._view_state_changed)

    def _say(self, text: str) -> None:
        """What is listed, or why nothing is."""
        self._note.setText(text)
        self._note.setVisible(bool(text))

    def can_search(self) -> bool:
        """Whether the layer that is shown has worst places."""
        scene, view_state = self.session.scene, self.session.view_state
        if scene is None:  # asked while the window is built: layers load torch
            return False
        layer = get_layer(view_state.layer)
        return layer.of_motion and not layer.missing(scene, ())

    def search(self) -> None:
        scene, view_state = self.session.scene, self.session.view_state
        if scene is None or not self.can_search():
            self._say(HINT)
            return
        from degense.engine.layers.ranking import rank

        layer = get_layer(view_state.layer)
        request = layer_request(view_state, 0)
        self.shell.docks.bring(self.dock)
        self.worker.submit("rank", lambda: rank(scene, layer, request), self._take, self._say, self._take)

    def _take(self, ranking: Ranking) -> None:
        self.ranking = ranking
        assert self.session.scene is not None
        frames, title = self.session.scene.frames, get_layer(ranking.layer).title
        searching = ranking.done < frames
        self._say(f"{title}: looking, {ranking.done} of {frames} frames" if searching else title)
        self._list()

    def findings(self) -> tuple[Finding, ...]:
        """What is listed."""
        if self.ranking is None:
            return ()
        return self.ranking.frames if self._kinds.currentData() == "frames" else self.ranking.places

    def statistic(self) -> str:
        """What the values of the list are."""
        return STATISTICS[self._kinds.currentData()]

    def _list(self) -> None:
        """Write the list. Nothing is chosen."""
        unit = self.ranking.unit if self.ranking is not None else ""
        self.table.setHorizontalHeaderLabels(["Frame", "Place [px]", with_unit(self.statistic(), unit)])
        self.table.setCurrentCell(-1, -1)
        forms.fill(self.table, [(str(f.frame), f"{f.x:.0f}, {f.y:.0f}", f"{f.value:.3g}") for f in self.findings()], right=True)
        self.shell.refresh()

    def _go(self, row: int) -> None:
        finding = self.findings()[row]
        self.session.pause()
        self.session.go_to(finding.frame)
        self.session.probe = Spot(finding.frame, finding.x, finding.y)

    def go_on(self, step: int) -> None:
        """To the next finding, or back, round and round."""
        if count := self.table.rowCount():
            row = self.table.currentRow()
            self.table.setCurrentCell((row + step) % count if row >= 0 else 0, 0)

    def _clear(self) -> None:
        self.worker.cancel("rank")
        self.ranking = None
        self._say(HINT)
        self._list()

    def _view_state_changed(self, before: ViewState, after: ViewState) -> None:
        if before.layer != after.layer:
            self._clear()

    # Saving

    def save(self, path: Path) -> None:
        """The list as a table (`.csv`), or as a sheet of images (`.png`), which the worker draws.

        DegenseError when nothing has been found yet, or the file cannot be written.
        """
        scene, ranking, findings = self.session.scene, self.ranking, self.findings()
        if scene is None or ranking is None or not findings:
            raise DegenseError("Look for the worst frames first: nothing is listed yet.")
        if path.suffix.lower() == ".csv":
            write_text(path, findings_table(findings, self.statistic(), ranking.unit, scene.fps))
            self.shell.say(f"Saved {path}")
            return
        request, view = layer_request(self.session.view_state, 0), self.viewer.view
        span = view.spans.get(ranking.layer, (0.0, 1.0)) if view is not None else (0.0, 1.0)
        statistic, words = self.statistic(), f"Drawing {path.name}"
        self.shell.run_task("export", words, lambda: findings_sheet(scene, ranking, findings, statistic, request, span, path))
