"""Imports under PySide without reading their sources.

From its own import on, PySide reads the source of every module that is imported and looks for its name there, to know where
`from __feature__ import …` may act. Nothing here uses that, and the lines stay in memory: 72 MB with torch, numba and scipy
(docs/decisions/0052).
"""

from __future__ import annotations

import sys

import PySide6.QtCore  # noqa: F401  (brings what reads)


def leave_sources_unread() -> None:
    """Let PySide take every module for one that does not use its features. Versions that do not ask so go on as they do."""
    features = sys.modules.get("shibokensupport.feature")
    if features is not None and hasattr(features, "_mod_uses_pyside"):
        vars(features)["_mod_uses_pyside"] = lambda module: False
