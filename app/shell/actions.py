"""Everything the user can do, in one table: menus, shortcuts, the command palette and the cheat sheet all read it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from degense.engine.errors import DegenseError

#: Words that mean the same to the palette; the first of a group is found before the others.
SYNONYMS = (
    ("movie", "video", "film", "animation"),
    ("picture", "image", "photo", "frame", "screenshot"),
    ("save", "export", "write", "download"),
    ("open", "load", "import", "read"),
    ("annotate", "label", "paint", "draw", "brush"),
    ("mask", "segment", "prompt"),
    ("measure", "distance", "length", "ruler"),
    ("settings", "preferences", "options", "configuration"),
    ("quit", "exit", "close"),
    ("undo", "back", "revert"),
    ("colour", "color"),
    ("train", "reconstruct", "fit"),
    ("movement", "motion", "displacement", "deformation"),
    ("keys", "shortcuts", "hotkeys"),
    ("opaque", "opacity", "transparent", "transparency"),
)


def alike(word: str) -> list[str]:
    """Those that mean the same as a word that this one, small, begins; a single letter begins too many."""
    groups = [group for group in SYNONYMS if len(word) > 1 and any(other.startswith(word) for other in group)]
    return [other for group in groups for other in group if other != word]


@dataclass(frozen=True)
class Action:
    """One thing to do."""

    id: str  # unique, dotted: `file.open-run`
    title: str  # as in the menu, starting with a verb or a name
    run: Callable[[], object]
    menu: tuple[str, ...] = ()  # where it hangs: `("File", "Export")`. Empty: only in the palette and by shortcut
    shortcuts: tuple[str, ...] = ()  # keys in Qt's portable text form; the first is shown
    enabled: Callable[[], bool] = lambda: True  # whether it can be done now
    checked: Callable[[], bool] | None = None  # for switches: whether it is on now
    group: int = 0  # a separator stands between neighbours of different groups
    help: str = ""


class ActionRegistry:
    """The actions in the order they were added. Ids and shortcuts are unique."""

    def __init__(self) -> None:
        self._actions: dict[str, Action] = {}
        self._keys: dict[str, str] = {}
        self._given: dict[str, tuple[str, ...]] = {}

    def add(self, *actions: Action) -> None:
        """Register actions.

        ValueError when an id or a shortcut is taken, a title is empty, or the action has neither a place in a menu nor a shortcut.
        """
        for action in actions:
            if not action.title or action.id in self._actions:
                raise ValueError(f"action {action.id!r} is registered twice or has no title")
            if not (action.menu or action.shortcuts):
                raise ValueError(f"action {action.id!r} has neither a place in a menu nor a shortcut")
            for key in action.shortcuts:
                if key in self._keys:
                    raise ValueError(f"{key} is already the shortcut of {self._keys[key]!r}, so {action.id!r} cannot have it")
            self._actions[action.id] = action
            self._keys |= dict.fromkeys(action.shortcuts, action.id)

    def arrange(self, menus: Sequence[str]) -> None:
        """Order the table as these menus stand in the menu bar, and each menu by its groups."""
        place = {menu: index for index, menu in enumerate(menus)}

        def order(action: Action) -> tuple[int, int]:
            return place.get(action.menu[0], len(place)) if action.menu else -1, action.group if len(action.menu) == 1 else 0

        self._actions = {action.id: action for action in sorted(self._actions.values(), key=order)}

    def keys(self, action_id: str) -> tuple[str, ...]:
        """The shortcuts in force: the user's own, else those of the action."""
        return self._given.get(action_id, self._actions[action_id].shortcuts)

    @property
    def given(self) -> dict[str, tuple[str, ...]]:
        """The shortcuts that the user has changed, by action."""
        return dict(self._given)

    def rebind(self, given: Mapping[str, Sequence[str]]) -> list[str]:
        """Give actions other shortcuts; those not named have their own again. An id that is not known (of another version) is kept aside.

        Returns a sentence for each key that two actions have. The one that comes first in the table keeps it.
        """
        known = {action_id: tuple(keys) for action_id, keys in given.items() if action_id in self._actions}
        self._given = {action_id: keys for action_id, keys in known.items() if keys != self._actions[action_id].shortcuts}
        owners: dict[str, str] = {}
        clashes = []
        for action_id in self._actions:
            free = []
            for key in self.keys(action_id):
                if key in owners:
                    first, second = self._actions[owners[key]].title, self._actions[action_id].title
                    clashes.append(f"{key} is the shortcut of “{first}”, so “{second}” cannot have it.")
                else:
                    owners[key] = action_id
                    free.append(key)
            if len(free) < len(self.keys(action_id)):
                self._given[action_id] = tuple(free)
        return clashes

    def __iter__(self) -> Iterator[Action]:
        return iter(self._actions.values())

    def __getitem__(self, action_id: str) -> Action:
        return self._actions[action_id]

    def run(self, action_id: str) -> None:
        """Do it. DegenseError when it cannot be done now."""
        action = self._actions[action_id]
        if not action.enabled():
            raise DegenseError(f"“{action.title}” is not possible now.")
        action.run()

    def search(self, text: str) -> list[Action]:
        """Actions that can be done now and that each word of `text` finds (`_distance`), the nearest first."""
        words = text.casefold().split()
        ranked = []
        for order, action in enumerate(self):
            distances = [_distance(word, action) for word in words]
            if action.enabled() and None not in distances:
                ranked.append((sum(distance for distance in distances if distance is not None), order, action))
        return [action for *_, action in sorted(ranked, key=lambda entry: entry[:2])]

    def cheat_sheet(self) -> dict[str, list[tuple[str, str]]]:
        """Shortcuts by menu: {"View": [("Ctrl+K", "Command palette"), …], …}."""
        sheet: dict[str, list[tuple[str, str]]] = {}
        for action in self:
            if keys := self.keys(action.id):
                sheet.setdefault(action.menu[0] if action.menu else "Everywhere", []).append((" or ".join(keys), action.title))
        return sheet


def _distance(word: str, action: Action) -> float | None:
    """How far an action is from a word: first titles that have it, then its menu, then titles with words that mean the same, then help
    texts; None where it is in none of them.
    """
    title, menu, words = action.title.casefold(), " ".join(action.menu).casefold(), action.help.casefold()
    parts, others = re.findall(r"\w+", title), alike(word)
    ways = (
        (0.0, word in parts),
        (1.0, any(part.startswith(word) for part in parts)),
        (2.0, word in title),
        (3.0, word in menu),
        *((4.0 + place / 100, other in parts) for place, other in enumerate(others)),
        *((5.0 + place / 100, any(part.startswith(other) for part in parts)) for place, other in enumerate(others)),
        (6.0, word in words),
        (7.0, any(other in menu or other in words for other in others)),
    )
    return next((distance for distance, holds in ways if holds), None)
