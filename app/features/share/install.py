"""File ▸ Share: the scene as one page that anyone can open."""

from __future__ import annotations

from pathlib import Path

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.file_dialog import FileDialog
from degense.app.session.sample import is_demo
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError

HINT = "One web page (.html) with the scene, its masks and its displacement, which any browser shows from disk."
KINDS = "Web page (*.html)"


class Sharing:
    """Asks where to, then writes the page in the worker while the window goes on."""

    def __init__(self, shell: Shell) -> None:
        self._shell, self._session = shell, shell.session

    def ask(self) -> None:
        scene = self._session.scene
        assert scene is not None
        folder = Path.home() if is_demo(scene.run.path) else scene.run.path.parent
        proposal = folder / f"{self._session.name}.html"
        FileDialog(self._shell, "share", "Share", "Share", HINT, KINDS, proposal, "scene.html", self.write).open()

    def write(self, out: Path, hidden: Anonymity) -> None:
        """Write the page, with masks of the visible prompts in their colours, or of all classes when there are none.

        DegenseError for another suffix, and where something is blacked out, which Gaussians cannot be.
        """
        from degense.app.features.share.page import check_suffix, share
        from degense.engine.scene.anonymous import NOT_COVERED

        check_suffix(out)
        if hidden.covering:
            raise DegenseError(NOT_COVERED)
        scene, view_state = self._session.scene, self._session.view_state
        assert scene is not None
        shown, colours = hidden.scene(scene), tuple(prompt.colour for prompt in view_state.visible_prompts)
        self._shell.run_task("export", f"Writing {out.name}", lambda: share(shown, out, view_state.prompt_set, colours), detailed=True)


def install(shell: Shell) -> None:
    sharing = Sharing(shell)
    shell.provide(sharing)
    shell.add_actions(
        Action("file.share", "Share…", sharing.ask, ("File",), (), shell.session.has_scene, group=3, help="page html browser web")
    )
