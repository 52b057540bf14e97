"""File ▸ Share…"""

from __future__ import annotations

from degense.app.features.share.install import Sharing


def test_the_scene_is_shared_with_the_prompts_that_are_shown(opened, idle, tmp_path, monkeypatch):
    out = tmp_path / "scene.html"
    monkeypatch.setattr(opened, "ask_save", lambda *words: out)
    opened.registry.run("file.share")
    idle()
    assert opened.statusBar().currentMessage().startswith(f"{out}: ")
    assert out.stat().st_size > 10_000
    assert opened.service(Sharing) is not None
