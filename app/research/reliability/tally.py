"""What became of many cases of one kind, as a line of a table."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from degense.app.research.reliability.guarded import READ, REFUSED, Fate
from degense.engine.research.bench.table import Cell, Column

NOTHING = "nothing yet"
COLUMNS = [
    Column("what", "what"),
    Column("cases", "cases", 0),
    Column("read", "read", 0),
    Column("refused", "refused in a sentence", 0),
    Column("defects", "neither", 0),
    Column("seconds", "longest, s", 1),
    Column("words", "what was neither"),
]


@dataclass
class Tally:
    """Outcomes of the cases of one kind; `defects` describes those that were neither read nor refused.

    `steps` is how many steps of the program were seen to be taken, where they were followed.
    """

    name: str
    outcomes: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    defects: list[str] = field(default_factory=list)
    steps: int | None = None
    note: str = ""  # why there are no cases

    def add(self, fate: Fate, words: str, begun: bool = True) -> None:
        """Count a case; one in which nothing had `begun` yet cannot be read, and is counted apart."""
        self.outcomes[NOTHING if fate.outcome == READ and not begun else fate.outcome] += 1
        self.seconds = max(self.seconds, fate.seconds)
        if not fate.sound:
            self.defects.append(f"{fate.outcome}: {words}: {fate.words}")

    def row(self) -> dict[str, Cell]:
        about: dict[str, Cell] = {"what": self.name, "cases": self.outcomes.total(), "seconds": self.seconds}
        counts: dict[str, Cell] = {"read": self.outcomes[READ], "refused": self.outcomes[REFUSED], "defects": len(self.defects)}
        words = self.note or "; ".join(defect[:160] for defect in self.defects[:3])
        return {**about, **counts, "nothing": self.outcomes[NOTHING], "steps": self.steps, "words": words}
