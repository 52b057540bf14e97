"""The pages of the user guide: Markdown files, in their order, and where a word stands in them. No Qt."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from degense.engine.errors import DegenseError

FOLDER = Path(__file__).resolve().parents[3] / "docs" / "guide"
#: The order in which one reads them, by task.
ORDER = ("index", "open", "train", "look", "prompt", "inspect", "track", "measure", "annotate", "export", "share", "shortcuts", "trouble")


@dataclass(frozen=True)
class Page:
    """One page; its title is its first line."""

    name: str
    text: str

    @property
    def title(self) -> str:
        return self.text.partition("\n")[0].removeprefix("# ")

    def holds(self, words: str) -> bool:
        """Whether every one of the words stands in what one reads of it, whatever its case."""
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", self.text).replace("*", "").replace("`", "").casefold()
        return all(word in plain for word in words.casefold().split())


def read_guide() -> tuple[Page, ...]:
    """All pages, in order. DegenseError when this installation does not hold them."""
    try:
        return tuple(Page(name, (FOLDER / f"{name}.md").read_text(encoding="utf-8")) for name in ORDER)
    except OSError as error:
        raise DegenseError(f"The user guide is missing from this installation ({FOLDER}); install the program again.") from error
