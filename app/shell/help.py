"""Help: the palette, the cheat sheet, what layers show, the log, the doctor, and what this is."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject

from degense.app.session.session import Session
from degense.app.shell.actions import ActionRegistry
from degense.app.shell.messages import show_about, show_cheat_sheet, show_page, show_text
from degense.app.shell.palette import Palette
from degense.app.shell.parts import Parts
from degense.app.shell.worker import RenderService


class Helping(QObject):
    """Shows what helps. `run` is how the palette does what was chosen."""

    def __init__(
        self, registry: ActionRegistry, session: Session, service: RenderService, parts: Parts, complain: Callable[[str], None]
    ) -> None:
        super().__init__(parts)
        self.registry, self.session, self.service, self.parts, self.complain = registry, session, service, parts, complain
        self.run: Callable[[str], None] = registry.run

    def show_palette(self) -> None:
        palette = Palette(self.registry, self.run, self.parts.window)
        palette.show()
        palette.input.setFocus()

    def show_cheat_sheet(self) -> None:
        show_cheat_sheet(self.parts.window, self.registry.cheat_sheet())

    def show_layers(self) -> None:
        from degense.app.features.viewer.layer_help import layer_help
        from degense.engine.layers import LAYERS

        scene = self.session.scene
        units = {name: layer.unit(scene) for name, layer in LAYERS.items()} if scene is not None else {}
        show_page(self.parts.window, "What the layers show", layer_help(units))

    def show_log(self) -> None:
        self.parts.log_dock.show()
        self.parts.log_dock.raise_()

    def show_about(self) -> None:
        show_about(self.parts.window)

    def show_doctor(self) -> None:
        """Examine the machine in the worker (it takes seconds), then show the report."""
        from degense.app.diagnostics import report

        self.parts.set_busy("Examining this machine")

        def done(result: tuple[str, bool]) -> None:
            self.parts.set_busy()
            show_text(self.parts.window, "Doctor", result[0])

        def failed(message: str) -> None:
            self.parts.set_busy()
            self.complain(message)

        self.service.submit("doctor", report, done, failed)
