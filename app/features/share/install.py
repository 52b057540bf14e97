"""File ▸ Share: the scene as one page that anyone can open."""

from __future__ import annotations

from pathlib import Path

from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


class Sharing:
    """Asks where to, then writes the page in the worker while the window goes on."""

    def __init__(self, shell: Shell) -> None:
        self._shell, self._session = shell, shell.session

    def ask(self) -> None:
        path = self._shell.ask_save("Share this scene as a page", f"{self._session.name}.html", "Web page (*.html)")
        if path is not None:
            self.write(path)

    def write(self, out: Path) -> None:
        """Write the page, with masks of the visible prompts in their colours, or of all classes when there are none."""
        from degense.app.features.share.page import share

        scene, view_state = self._session.scene, self._session.view_state
        assert scene is not None
        colours = tuple(prompt.colour for prompt in view_state.visible_prompts)
        self._shell.run_task("export", f"Writing {out.name}", lambda: share(scene, out, view_state.prompt_set, colours), detailed=True)


def install(shell: Shell) -> None:
    sharing = Sharing(shell)
    shell.provide(sharing)
    shell.add_actions(
        Action("file.share", "Share…", sharing.ask, ("File",), (), shell.session.has_scene, group=3, help="page html browser web")
    )
