"""Colours of the window come from the theme's palette roles: a widget that brings its own would be unreadable in another theme."""

from __future__ import annotations

import re

from tests.house.source import ROOT, modules

#: A colour written out: in a style sheet, or given to QColor. Marks over pictures are black and white by numbers: they lie on no role.
WRITTEN = re.compile(r"#[0-9a-fA-F]{6}\b|setStyleSheet\(")
THEME = "widgets/theme.py"


def test_only_the_theme_knows_colours():
    found = [
        f"{path}:{number}"
        for path in [*modules("widgets"), *(path for path in modules("app") if path.parts[1] in ("shell", "features"))]
        if path.as_posix() != THEME
        for number, line in enumerate((ROOT / path).read_text(encoding="utf-8").splitlines(), 1)
        if WRITTEN.search(line)
    ]
    assert not found
