"""The demo as it opens, and the tasks to try on it."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from degense.app.features.annotate.state import AnnotationState
from degense.app.features.documents.controller import Documents
from degense.app.features.prompts.controller import PromptControls
from degense.app.session.sample import is_demo
from degense.app.shell.shell import Shell

#: Name of each task, its title, and what it shows.
TASKS = (
    ("movement", "What moved?", "Displacement in millimetres over the frame, while it plays"),
    ("grasper", "Find the grasper", "Type a word, and see its mask in every frame"),
    ("label", "Correct a label", "Paint over a frame, then let the label follow the tissue"),
)
#: What the demo is asked, and what the task that finds something is.
PROMPT, INSTRUMENT = "gallbladder", "grasper"


class Samples(QObject):
    """Opens the demo with something to see: a prompt, and displacement over the colours."""

    arranged = Signal(str)  # (task) the demo is open and shows what the task needs

    def __init__(self, shell: Shell, documents: Documents) -> None:
        super().__init__(shell)
        self.shell, self.session, self.documents = shell, shell.session, documents
        self._task = ""
        self.session.opened.connect(self._opened)

    def begin(self, task: str) -> None:
        """Open the demo for one of `TASKS`."""
        self._task = task
        self.documents.open_demo()

    def _opened(self) -> None:
        task, self._task = self._task or "movement", ""
        scene = self.session.scene
        if scene is None or not is_demo(self.documents.path):
            return
        prompts, annotations = self.shell.service(PromptControls), self.shell.service(AnnotationState)
        self.session.go_to(2 * scene.frames // 3)  # by then something has moved
        self.session.view.add_prompt(INSTRUMENT if task == "grasper" else PROMPT)
        if task == "movement":
            self.session.view.set_layer_visible("displacement", True)
        elif task == "grasper" and prompts is not None:
            prompts.focus()
        elif task == "label" and annotations is not None:
            annotations.tool.active = True
        self.arranged.emit(task)
