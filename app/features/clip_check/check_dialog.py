"""Checking a clip on its frames: what was found, and every choice that can be made before anything is written."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QComboBox,
    QDialogButtonBox,
    QFormLayout,
    QLabel,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from degense.app.features.clip_check.check_frames import ASPECTS, CheckFrame, draw_check_frame, field_of_view_words
from degense.app.shell.worker import Worker
from degense.engine.data.clip_options import LAYOUTS, ClipOptions
from degense.widgets import forms
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.scrolling import scrolled

if TYPE_CHECKING:
    from degense.engine.clip import Clip

LAYOUT_WORDS = {
    "endonerf": "EndoNeRF",
    "cholecseg8k": "CholecSeg8k",
    "endovis18": "EndoVis 2018",
    "stir": "STIR or VL-SurgPT",
    "surgt": "SurgT",
    "servct": "SERV-CT",
    "c3vd": "C3VD",
    "frames": "Loose frames",
    "video": "Video file",
}
MASK_WORDS = ((None, "as detected"), ("tool", "white = instrument, left out"), ("keep", "white = tissue, kept"))
POSE_WORDS = (
    ("auto", "as the clip says, else estimated"),
    ("still", "the camera stands still"),
    ("estimate", "the camera moves: estimate it"),
)
AXES_WORDS = (("llff", "down, right, back (as defined)"), ("opencv", "right, down, forward (some converters)"))
#: Changes that follow each other this closely are one reading of the clip, milliseconds.
PATIENCE_MS = 350
#: Of what was found, beside the frame: characters, and the largest share of the screen.
WIDTH, WIDEST = 58, 0.6


class CheckDialog(forms.Dialog):
    """Reads the clip again after each change, in the worker, and shows the result. Nothing is written.

    `answers` are those that differ from what the reader decides by itself, as `ClipOptions` takes them.
    """

    def __init__(self, path: Path, clip: Clip, answers: dict[str, Any], service: Worker, parent: QWidget) -> None:
        super().__init__(parent, "check", f"Check {clip.name}", 1120, 700)
        self._path, self._clip, self._service = path, clip, service
        self.panel = RenderPanel()
        self.panel.setAccessibleName("Frame of the clip")
        self.aspect = forms.choice("What the frame shows", tuple(ASPECTS.items()))
        self.frame = forms.named(QSlider(Qt.Orientation.Horizontal), "Frame")
        self.frame_words = QLabel()
        self.complaint = forms.complaint()
        self.found: dict[str, QLabel] = {}
        self._aspect_of: dict[QObject, str] = {}
        layouts = ((None, "as detected"), *((name, LAYOUT_WORDS.get(name, name)) for name in LAYOUTS))
        self.controls: dict[str, QWidget] = {
            "layout": forms.choice("Layout", layouts),
            "start": forms.number("First frame", 0),
            "stride": forms.number("Each so manyth frame", 1),
            "max_frames": forms.number("Most frames", 1),
            "mask_means": forms.choice("Masks", MASK_WORDS),
            "focal": forms.decimal("Focal length", 0, 100_000, 1, " px", "as detected"),
            "poses": forms.choice("Camera", POSE_WORDS),
            "pose_axes": forms.choice("Axes of the poses", AXES_WORDS),
        }
        for control in self.controls.values():
            if isinstance(control, QComboBox):  # whose longest words would need more than all width with large text
                control.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
                control.setMinimumContentsLength(14)
        self.buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        self.use = self.buttons.addButton("Use these answers", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        self._place()
        self._timer = QTimer(self, singleShot=True, interval=PATIENCE_MS)
        self._timer.timeout.connect(self._read)
        for name, control in self.controls.items():
            forms.enter(control, {**asdict(ClipOptions()), **answers}[name])
        self._bind()
        self._show_clip()

    @property
    def answers(self) -> dict[str, Any]:
        """What was chosen, where it is not the reader's own choice."""
        defaults = asdict(ClipOptions())
        chosen = {name: forms.value(control) for name, control in self.controls.items()}
        return {name: value for name, value in chosen.items() if value != defaults[name]}

    def _place(self) -> None:
        left = forms.column((self.panel, 1), self.aspect, forms.row((self.frame, 1), self.frame_words), margin=0)
        inside = QWidget()
        form = QVBoxLayout(inside)
        form.setSpacing(2)
        self._section(form, "Layout and frames", "frames", (("Layout", "layout"),))
        self.of_video = QWidget()
        video = QFormLayout(self.of_video)
        video.setContentsMargins(0, 0, 0, 4)
        for words, name in (("First frame", "start"), ("Each …th", "stride"), ("At most", "max_frames")):
            video.addRow(words, self.controls[name])
            self._aspect_of[self.controls[name]] = "frames"
        form.addWidget(self.of_video)
        self._section(form, "Masks and field of view", "masks", (("White means", "mask_means"),))
        self._section(form, "Focal length", "focal", (("Focal length", "focal"),))
        self._section(form, "Camera", "poses", (("It moves", "poses"), ("Axes of given poses", "pose_axes")))
        self._section(form, "Depth", "depth", ())
        self._section(form, "Annotations", "labels", ())
        form.addStretch(1)
        area = scrolled(inside)
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        area.setFixedWidth(min(WIDTH * self.fontMetrics().averageCharWidth(), round(WIDEST * self.screen().availableSize().width())))
        forms.column((forms.row((left, 1), area), 1), self.complaint, self.buttons, margin=9, parent=self)

    def _section(self, column: QVBoxLayout, title: str, aspect: str, rows: tuple[tuple[str, str], ...]) -> None:
        self.found[aspect] = forms.label(name=f"{title}: what was found", secondary=True)
        column.addSpacing(8)
        column.addWidget(QLabel(f"<b>{title}</b>"))
        column.addWidget(self.found[aspect])
        form = QFormLayout()
        form.setContentsMargins(0, 2, 0, 2)
        for words, name in rows:
            form.addRow(words, self.controls[name])
            self._aspect_of[self.controls[name]] = aspect
        column.addLayout(form)

    def _bind(self) -> None:
        for control in self.controls.values():
            forms.changed(control).connect(self._changed)
        self.aspect.currentIndexChanged.connect(self._draw)
        self.frame.valueChanged.connect(self._draw)
        for watched in self._aspect_of:
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Show the view that a control is about as soon as one turns to it."""
        if event.type() == QEvent.Type.FocusIn and self._aspect_of.get(watched) in ASPECTS:
            self._turn_to(self._aspect_of[watched])
        return False

    def _turn_to(self, aspect: str) -> None:
        self.aspect.setCurrentIndex(list(ASPECTS).index(aspect))

    def _changed(self) -> None:
        self.use.setEnabled(False)  # until it is known what comes of it
        self._timer.start()

    # Reading

    def _read(self) -> None:
        path, answers = self._path, self.answers

        def read() -> Clip:
            from degense.engine.data.readers import open_clip

            return open_clip(path, ClipOptions(**answers))

        def done(clip: Clip) -> None:
            self._clip = clip
            self.complaint.hide()
            self.use.setEnabled(True)
            self._show_clip()

        def failed(message: str) -> None:
            self.complaint.setText(message)
            self.complaint.show()

        self._service.submit("check", read, done, failed)

    def _show_clip(self) -> None:
        clip, provenance = self._clip, self._clip.provenance
        width, height = clip.size
        self.complaint.setVisible(False)
        self.of_video.setVisible(self._path.is_file())
        words = {
            "frames": f"{len(clip)} frames of {width} × {height}. {provenance.get('frames', '')}",
            "masks": provenance.get("masks", ""),
            "focal": f"{provenance.get('focal', '')}. {field_of_view_words(clip)}",
            "poses": provenance.get("poses", ""),
            "depth": provenance.get("depth", ""),
            "labels": "; ".join(provenance[key] for key in ("labels", "strokes") if key in provenance)
            + (f". Classes: {', '.join(clip.classes)}" if clip.classes else ""),
        }
        for aspect, text in words.items():
            self.found[aspect].setText(text)
        self.frame.setRange(0, len(clip) - 1)
        self._draw()

    def _draw(self) -> None:
        clip, frame, aspect = self._clip, min(self.frame.value(), len(self._clip) - 1), self.aspect.currentData()
        self.frame_words.setText(f"frame {frame} of {len(clip)}")

        def show(drawn: CheckFrame) -> None:
            self.panel.set_image(drawn.rgb)
            self.panel.set_overlay(drawn.overlay)
            self.panel.marks.set_legend([(words, QColor(*colour)) for words, colour in drawn.legend])

        def failed(message: str) -> None:
            self.panel.set_image(None)
            self.panel.set_message(message)

        self._service.submit("check-frame", lambda: draw_check_frame(clip, frame, aspect), show, failed)

    def done(self, result: int) -> None:
        self._timer.stop()
        for channel in ("check", "check-frame"):
            self._service.cancel(channel)
        super().done(result)
