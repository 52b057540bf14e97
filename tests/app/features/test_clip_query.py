"""Task: ask the whole clip, watch the areas fill, stop it, write the masks down."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PySide6.QtCore import Qt

from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.app import installed as on


@pytest.fixture
def asked(opened, idle):
    """The window with two prompts and one that takes pixels from them."""
    on.statistics(opened)._quiet.setInterval(10**7)  # nobody else looks at other frames
    for text in ("gallbladder", "tool, not hook", "fat"):
        opened.session.view.add_prompt(text)
    opened.session.view.set_negative("fat", True)
    idle()
    on.viewer(opened).panel.setFocus()
    return opened


def test_the_areas_of_the_whole_clip(qtbot, asked, idle, screenshot):
    view_state = asked.session.view_state
    qtbot.keyClick(on.viewer(asked).panel, Qt.Key.Key_Q)
    assert on.statistics(asked).running
    assert not asked.menus.actions["query.clip"].isEnabled()
    idle()
    scene = asked.session.scene
    other = Scene(scene.run, scene.model, scene.basis, scene.encoder, scene.clip)  # nothing is kept in it
    for text in ("gallbladder", "tool, not hook"):
        alone = PromptSet((text,), ("fat",), view_state.decoder, view_state.threshold)
        shares = [decode_frame(other, alone, i).masks[0].mean() for i in range(10)]
        assert on.statistics(asked).areas.curve(text, view_state, 10).tolist() == shares
    assert max(shares) > 0
    assert "gallbladder in 10 of 10 frames" in asked.statusBar().currentMessage()
    assert asked.menus.actions["query.clip"].isEnabled()
    screenshot(asked, "query-clip")


def test_what_was_found_before_a_stop_is_kept_and_not_asked_again(qtbot, asked, idle):
    view_state = asked.session.view_state
    curve = on.statistics(asked).areas.curve("gallbladder", view_state, 10)
    asked.menus.run("query.clip")
    qtbot.waitUntil(lambda: np.isfinite(curve).sum() >= 2)
    asked.menus.run("query.stop")
    idle()
    known = np.isfinite(curve)
    assert 2 <= known.sum() < 10
    curve[known] = -1.0
    asked.menus.run("query.clip")
    idle()
    assert (curve[known] == -1).all()
    assert (curve[~known] > 0).all()


def test_masks_of_the_whole_clip_go_into_a_folder(asked, idle, tmp_path):
    out = tmp_path / "masks"
    on.statistics(asked).save(out)
    idle()
    assert json.loads((out / "classes.json").read_text())["classes"] == ["gallbladder", "tool, not hook"]
    assert len(list((out / "labels").iterdir())) == 10
    areas = np.loadtxt(out / "areas.csv", delimiter=",", skiprows=1)
    assert (areas[:, 1] > 0).all()
    assert "masks of 10 frames" in asked.statusBar().currentMessage()
