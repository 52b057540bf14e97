"""Everything the user can do, in one table: menus, shortcuts, the command palette and the cheat sheet all read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from engine.errors import DegenseError


def _always() -> bool:
    return True


@dataclass(frozen=True)
class Action:
    """One thing to do.

    Attributes
    ----------
    id : str
        Unique, dotted: `file.open-run`.
    title : str
        As in the menu, starting with a verb or a name.
    menu : tuple of str
        Where it hangs: `("File", "Export")`. Empty: only in the palette and by shortcut.
    shortcuts : tuple of str
        Keys in Qt's portable text form; the first is shown.
    enabled : callable
        Whether it can be done now.
    checked : callable or None
        For switches: whether it is on now.
    group : int
        A separator stands between neighbours of different groups.
    """

    id: str
    title: str
    run: Callable[[], object]
    menu: tuple[str, ...] = ()
    shortcuts: tuple[str, ...] = ()
    enabled: Callable[[], bool] = _always
    checked: Callable[[], bool] | None = None
    group: int = 0
    help: str = ""


class ActionRegistry:
    """The actions in the order they were added. Ids and shortcuts are unique."""

    def __init__(self) -> None:
        self._actions: dict[str, Action] = {}
        self._keys: dict[str, str] = {}

    def add(self, *actions: Action) -> None:
        """Register actions.

        Raises
        ------
        ValueError
            When an id or a shortcut is taken, or a title is empty.
        """
        for action in actions:
            if not action.title or action.id in self._actions:
                raise ValueError(f"action {action.id!r} is registered twice or has no title")
            for key in action.shortcuts:
                if key in self._keys:
                    raise ValueError(f"{key} is already the shortcut of {self._keys[key]!r}, so {action.id!r} cannot have it")
            self._actions[action.id] = action
            self._keys |= dict.fromkeys(action.shortcuts, action.id)

    def __iter__(self) -> Iterator[Action]:
        return iter(self._actions.values())

    def __getitem__(self, action_id: str) -> Action:
        return self._actions[action_id]

    def run(self, action_id: str) -> None:
        """Do it.

        Raises
        ------
        DegenseError
            When it cannot be done now.
        """
        action = self._actions[action_id]
        if not action.enabled():
            raise DegenseError(f"“{action.title}” is not possible now.")
        action.run()

    def search(self, text: str) -> list[Action]:
        """Actions that can be done now and whose title or menu holds every word of `text`, word starts and titles first."""
        words = text.casefold().split()
        ranked = []
        for order, action in enumerate(self):
            title = action.title.casefold()
            place = f"{' '.join(action.menu)} {action.help}".casefold()
            if action.enabled() and all(word in title or word in place for word in words):
                starts = sum(any(part.startswith(word) for part in title.split()) for word in words)
                inside = sum(word in title for word in words)
                ranked.append((-starts, -inside, order, action))
        return [action for *_, action in sorted(ranked, key=lambda entry: entry[:3])]

    def cheat_sheet(self) -> dict[str, list[tuple[str, str]]]:
        """Shortcuts by menu: {"View": [("Ctrl+K", "Command palette"), …], …}."""
        sheet: dict[str, list[tuple[str, str]]] = {}
        for action in self:
            if action.shortcuts:
                sheet.setdefault(action.menu[0] if action.menu else "Everywhere", []).append((" or ".join(action.shortcuts), action.title))
        return sheet
