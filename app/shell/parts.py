"""The widgets of the window and where they sit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QDockWidget,
    QFrame,
    QLabel,
    QMainWindow,
    QProgressBar,
    QScrollArea,
    QSizePolicy,
    QSplitter,
    QTabBar,
    QVBoxLayout,
    QWidget,
)

from degense.app.features.annotate.panel import AnnotationPanel
from degense.app.features.cameras.panel import CameraList
from degense.app.features.clip_check.facts import Facts
from degense.app.features.inspect.probe_panel import ProbePanel
from degense.app.features.inspect.ranking_panel import RankingList
from degense.app.features.prompts.panel import PromptBar
from degense.app.features.train.monitor import TrainingMonitor
from degense.app.features.viewer.layer_list import LayerList
from degense.app.features.viewer.view import draw_still
from degense.app.features.viewer.view_bar import ViewBar
from degense.app.shell.history_list import HistoryList
from degense.app.shell.log_view import LogView
from degense.widgets.colour_bar import ColourBar
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.timeline import Timeline

if TYPE_CHECKING:
    from degense.widgets.splats.splat_view import SplatView

WELCOME = "Drop a clip or a run here, or open one from the File menu.\nHelp ▸ Demo shows a finished scene."


class Parts(QObject):
    """All widgets, in place.

    Attributes
    ----------
    similarity : CurvePlot
        Similarity to the prompts over time, below the probe's displacement: another unit, another plot.
    bars : list of ViewBar
        The colour bar in each view.
    splats : SplatView or None
        The 3D view. It comes after the window is on the screen (`add_splat_view`), because loading VTK, which draws it on a GPU,
        takes a second.
    """

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.window = window
        self.panel = RenderPanel()
        self.panel.set_message(WELCOME)
        self.splats: SplatView | None = None
        self.timeline = Timeline()
        self.layers = LayerList()
        self.colour_bar = ColourBar()
        self.colour_bar.hide()
        self.prompts = PromptBar()
        self.probe = ProbePanel()
        self.similarity = CurvePlot()
        self.similarity.set_labels("frame", "cosine")
        self.similarity.hide()
        self.ranking = RankingList()
        self.cameras = CameraList()
        self.bars = [ViewBar(self.panel)]
        self.facts = Facts()
        self.monitor = TrainingMonitor()
        self.log = LogView()
        self.history = HistoryList()
        self.annotation = AnnotationPanel()
        self._place()
        self._status()
        _LayerDigits(self.panel)

    def add_splat_view(self) -> SplatView:
        """Put the 3D view at the left of the picture."""
        from degense.widgets.splats.opengl import has_gpu
        from degense.widgets.splats.splat_view import SplatView

        self.splats = SplatView(draw=None if has_gpu() else draw_still)
        self.views.insertWidget(0, self.splats)
        self.bars.append(ViewBar(self.splats))
        self.views.setStretchFactor(0, 1)
        self.views.setStretchFactor(1, 1)
        self.views.setSizes([1000, 1000])
        return self.splats

    def say(self, text: str, seconds: float = 8.0) -> None:
        """A line in the status bar, for some seconds."""
        self.window.statusBar().showMessage(text, round(seconds * 1000))

    def set_busy(self, text: str = "", fraction: float | None = None) -> None:
        """Show that something is being done; an empty text hides it. Without a fraction the bar only moves."""
        self.busy_text.setText(text)
        self.busy_text.setVisible(bool(text))
        self.busy_bar.setVisible(bool(text))
        self.busy_bar.setRange(0, 0 if fraction is None else 100)
        if fraction is not None:
            self.busy_bar.setValue(round(100 * fraction))

    def _place(self) -> None:
        window = self.window
        self.views = QSplitter(Qt.Orientation.Horizontal)
        self.views.setObjectName("views")
        self.views.setChildrenCollapsible(False)
        self.views.addWidget(self.panel)
        centre = QWidget()
        column = QVBoxLayout(centre)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.views, 1)
        column.addWidget(self.timeline)
        window.setCentralWidget(centre)
        window.setDockOptions(QMainWindow.DockOption.AllowTabbedDocks | QMainWindow.DockOption.AnimatedDocks)
        window.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, window.tabPosition(Qt.DockWidgetArea.TopDockWidgetArea))
        right, bottom = Qt.DockWidgetArea.RightDockWidgetArea, Qt.DockWidgetArea.BottomDockWidgetArea
        layers = QWidget()
        layers.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)
        stack = QVBoxLayout(layers)
        stack.setContentsMargins(6, 6, 6, 6)
        stack.addWidget(self.layers)
        stack.addWidget(self.colour_bar)
        stack.addStretch(1)
        self.layers_dock = self._dock("Layers", layers, right)
        self.prompts_dock = self._dock("Prompts", self.prompts, right)
        probe = QWidget()
        below = QVBoxLayout(probe)
        below.setContentsMargins(0, 0, 0, 0)
        below.addWidget(self.probe, 3)
        below.addWidget(self.similarity, 2)
        self.probe_dock = self._tab("Probe", probe)
        self.ranking_dock = self._tab("Findings", self.ranking)
        self.cameras_dock = self._tab("Cameras", self.cameras)
        self.cameras_dock.hide()
        self.facts_dock = self._tab("Facts", self.facts)
        self.history_dock = self._tab("History", self.history)
        self.annotation_dock = self._tab("Annotation", self.annotation)
        self.monitor_dock = self._dock("Training", self.monitor, bottom)
        self.log_dock = self._dock("Log", self.log, bottom)
        self.monitor_dock.hide()
        self.log_dock.hide()
        window.tabifyDockWidget(self.probe_dock, self.ranking_dock)
        window.tabifyDockWidget(self.ranking_dock, self.cameras_dock)
        window.tabifyDockWidget(self.cameras_dock, self.facts_dock)
        window.tabifyDockWidget(self.facts_dock, self.history_dock)
        window.tabifyDockWidget(self.history_dock, self.annotation_dock)
        window.resizeDocks([self.layers_dock, self.prompts_dock, self.probe_dock], [240, 160, 420], Qt.Orientation.Vertical)
        window.resizeDocks([self.layers_dock], [400], Qt.Orientation.Horizontal)
        for bar in window.findChildren(QTabBar):
            bar.setElideMode(Qt.TextElideMode.ElideNone)
        self.probe_dock.raise_()
        # A click is no wish to type: Space and arrows go on moving time. Tab still reaches everything.
        for owner in (*self.docks, self.timeline):
            for kind in (QAbstractButton, QAbstractSlider):
                for widget in owner.findChildren(kind):
                    if widget.focusPolicy() != Qt.FocusPolicy.NoFocus:
                        widget.setFocusPolicy(Qt.FocusPolicy.TabFocus)

    def _dock(self, title: str, widget: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        dock = QDockWidget(title, self.window)
        dock.setObjectName(title)
        dock.setWidget(widget)
        self.window.addDockWidget(area, dock)
        return dock

    def _tab(self, title: str, widget: QWidget) -> QDockWidget:
        """A dock of the right column's lower part. It scrolls, so that no panel can push the window beyond the screen."""
        room = QScrollArea()
        room.setAccessibleName(title)
        room.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        room.setFrameShape(QFrame.Shape.NoFrame)
        room.setWidgetResizable(True)
        room.setWidget(widget)
        return self._dock(title, room, Qt.DockWidgetArea.RightDockWidgetArea)

    @property
    def docks(self) -> tuple[QDockWidget, ...]:
        right = (
            self.layers_dock,
            self.prompts_dock,
            self.probe_dock,
            self.ranking_dock,
            self.facts_dock,
            self.history_dock,
            self.annotation_dock,
            self.cameras_dock,
        )
        return *right, self.monitor_dock, self.log_dock

    def _status(self) -> None:
        bar = self.window.statusBar()
        self.busy_text, self.busy_bar = QLabel(), QProgressBar()
        self.busy_bar.setAccessibleName("What is being done")
        self.busy_bar.setTextVisible(False)
        self.busy_bar.setFixedWidth(140)
        self.busy_bar.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        bar.addPermanentWidget(self.busy_text)
        bar.addPermanentWidget(self.busy_bar)
        self.set_busy()


class _LayerDigits(QObject):
    """Leaves the key 1 to the layers, also while the picture has the focus (there it would zoom to 100 %)."""

    def __init__(self, panel: RenderPanel) -> None:
        super().__init__(panel)
        panel.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_1:
            event.ignore()
            return True
        return False
