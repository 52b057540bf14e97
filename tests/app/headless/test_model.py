"""Signal, undo stack, view state and session, without Qt."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from degense.app.session.session import Session
from degense.app.session.state import Signal
from degense.app.session.targets import Spot
from degense.app.session.undo import UndoStack
from degense.app.session.view_state import PROMPT_COLOURS, ColourRange, Prompt, ViewState
from degense.engine.errors import DegenseError, PromptError, RunError
from tests.app.painting import FakeScene, Strokes
from tests.fakes import MemoryClip
from tests.house.source import ROOT


@pytest.fixture
def session(tmp_path) -> Session:
    session = Session()
    session.open_scene(FakeScene(tmp_path))
    return session


def test_the_model_needs_no_qt():
    modules = [f"degense.app.session.{path.stem}" for path in sorted((ROOT / "app/session").glob("*.py"))]
    assert len(modules) > 5
    code = (
        f"import sys, importlib\nfor name in {modules}:\n    importlib.import_module(name)\n"
        "    assert not any(known.startswith(('PySide6', 'vtk', 'pyvista')) for known in sys.modules), name"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0


def test_signal_calls_in_order_until_disconnected():
    signal: Signal[[int]] = Signal()
    received: list[str] = []
    stop = signal.connect(lambda value: received.append(f"a{value}"))
    signal.connect(lambda value: received.append(f"b{value}"))
    signal.emit(1)
    stop()
    stop()
    signal.emit(2)
    assert received == ["a1", "b1", "b2"]


@given(st.lists(st.one_of(st.integers(0, 9), st.sampled_from(["undo", "redo"])), max_size=40))
def test_undo_stack_agrees_with_a_list_of_states(steps):
    """The oracle keeps all states and an index."""
    state = [0]

    def put(value: int) -> None:
        state[0] = value

    stack = UndoStack()
    states, at = [0], 0
    for step in steps:
        if step == "undo":
            stack.undo()
            at = max(0, at - 1)
        elif step == "redo":
            stack.redo()
            at = min(len(states) - 1, at + 1)
        elif step != state[0]:
            stack.do(str(step), put, state[0], step)
            states[at + 1 :] = [step]
            at += 1
        assert state[0] == states[at]
        assert (stack.undo_name is None, stack.redo_name is None) == (at == 0, at == len(states) - 1)


def test_a_drag_is_one_step_and_a_pause_ends_it():
    now = [0.0]
    state = [0]

    def put(value: int) -> None:
        state[0] = value

    stack = UndoStack(clock=lambda: now[0])
    for value in (1, 2, 3):
        stack.do("slide", put, value - 1, value, key="slider")
        now[0] += 0.5
    now[0] += 5
    stack.do("slide", put, 3, 4, key="slider")
    stack.do("slide", put, 4, 4, key="other")  # nothing changes: no step
    stack.undo()
    assert state == [3]
    stack.undo()
    assert state == [0]
    assert stack.undo_name is None


def test_undo_remembers_only_so_many():
    stack = UndoStack(limit=3)
    for value in range(10):
        stack.record(str(value), print, value, value + 1)
    assert [stack.undo() for _ in range(4)] == ["9", "8", "7", None]


def test_undo_keeps_to_its_memory_but_never_forgets_the_last_edit():
    stack = UndoStack(memory=1000)
    for value in range(10):
        stack.record(str(value), print, value, value + 1, size=300)
    assert (stack.entries, stack.size) == (("7", "8", "9"), 900)
    stack.record("huge", print, 0, 1, size=5000)
    assert stack.entries == ("huge",)


def test_one_history_over_several_states():
    """Edits of a view and of a mask share the stack; the list goes to any entry; something new ends what was undone."""
    places = {"view": 0, "mask": 0}
    stack = UndoStack(clock=lambda: 0.0)
    put = {name: lambda value, name=name: places.__setitem__(name, value) for name in places}
    for name, after in (("view", 1), ("mask", 1), ("mask", 2), ("view", 2)):
        stack.do(f"{name} {after}", put[name], places[name], after, key=name)
    assert stack.entries == ("view 1", "mask 2", "view 2")  # the two of the mask became one, the view in between did not
    stack.go_to(1)
    assert (places, stack.position) == ({"view": 1, "mask": 0}, 1)
    stack.go_to(99)
    assert (places, stack.position) == ({"view": 2, "mask": 2}, 3)
    stack.go_to(0)
    stack.do("mask 7", put["mask"], 0, 7)
    assert stack.entries == ("mask 7",)


view_states = st.builds(
    ViewState,
    layer=st.sampled_from(["rgb", "warp"]),
    prompts=st.lists(st.builds(Prompt, st.text(max_size=20), st.sampled_from(PROMPT_COLOURS), st.booleans()), max_size=3).map(tuple),
    threshold=st.floats(0, 1),
    masks_shown=st.booleans(),
    overlay_opacity=st.floats(0, 1),
    compare=st.sampled_from(["off", "wipe", "difference"]),
    ranges=st.just((("depth", ColourRange("fixed", 1.0, 2.5, "magma")),)),
)


@given(view_states)
def test_a_view_state_survives_json(view_state):
    assert ViewState.from_json(json.loads(json.dumps(view_state.to_json())), "here") == view_state


def test_a_view_state_of_an_earlier_version_has_todays_layers():
    data = ViewState(layer="support", ranges=(("support", ColourRange("fixed", 0.0, 1.0, "magma")),)).to_json()
    view_state = ViewState.from_json(data, "here")
    assert (view_state.layer, view_state.ranges[0][0]) == ("observability", "observability")


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: data.pop("layer"),
        lambda data: data.update(compare="sideways"),
        lambda data: data.update(prompts=[{"text": "liver"}]),
        lambda data: data.update(surprise=1),
        lambda data: data.update(ranges=[["depth", {"mode": "frame", "low": "x", "high": 1, "cmap": ""}]]),
    ],
)
def test_a_spoilt_view_state_is_refused_in_a_sentence(spoil):
    data = ViewState(prompts=(Prompt("liver", (1, 2, 3)),)).to_json()
    spoil(data)
    with pytest.raises(RunError, match=r"session\.json .*delete it"):
        ViewState.from_json(data, "session.json")


def test_prompts_take_free_colours_and_undo(session):
    for text in ("liver", "fat", "gallbladder"):
        session.view.add_prompt(text)
    assert [prompt.colour for prompt in session.view_state.prompts] == list(PROMPT_COLOURS[:3])
    session.view.remove_prompt("FAT")
    assert session.undo.undo_name == "Remove fat"
    session.undo.undo()
    assert [prompt.text for prompt in session.view_state.prompts] == ["liver", "fat", "gallbladder"]
    session.undo.undo()
    session.undo.undo()
    assert session.undo.redo_name == "Prompt fat"
    session.view.set_visible("liver", False)
    assert session.view_state.visible_prompts == ()
    assert session.undo.redo_name == "Prompt fat"  # an eye is no edit, and ends nothing that can be done again
    session.undo.redo()
    assert [prompt.visible for prompt in session.view_state.prompts] == [False, True]
    session.undo.undo()
    session.view.set_negative("liver", True)
    assert session.undo.redo_name is None


@pytest.mark.parametrize(("text", "words"), [("  ", "Type what"), ("Liver", "already"), ("xyzzy", "vocabulary")])
def test_prompts_that_cannot_be_answered_change_nothing(session, text, words):
    session.view.add_prompt("liver")
    before = session.view_state
    with pytest.raises(PromptError, match=words):
        session.view.add_prompt(text)
    assert session.view_state is before


def test_no_prompt_without_a_scene():
    with pytest.raises(PromptError, match="Open a run"):
        Session().view.add_prompt("liver")


def test_frames_are_clamped_and_said_once(session):
    received: list[int] = []
    session.frame_changed.connect(received.append)
    for frame in (3, 3, 99, -5):
        session.go_to(frame)
    session.play()
    session.step(2)
    assert received == [3, 9, 0, 2]
    assert not session.playing


def test_the_view_state_is_saved_with_the_run_and_found_again(session, tmp_path):
    dirty: list[bool] = []
    session.dirty_changed.connect(dirty.append)
    session.view.add_prompt("liver")
    session.view.set_layer("depth")
    session.save()
    assert dirty == [True, False]
    session.close()
    again = Session()
    again.open_scene(FakeScene(tmp_path))
    assert (again.view_state.layer, [prompt.text for prompt in again.view_state.prompts]) == ("depth", ["liver"])
    assert not again.dirty
    again.view.set_threshold(0.3)
    again.undo.undo()
    assert not again.dirty


def test_states_are_saved_by_name_and_those_of_others_stay_in_the_file(session, tmp_path):
    strokes = Strokes()
    session.register("strokes", strokes)
    with pytest.raises(ValueError, match="strokes"):
        session.register("strokes", Strokes())
    strokes.add(7)
    assert session.dirty
    session.save()
    assert not session.dirty
    session.close()
    other = Session()  # knows no strokes
    other.open_scene(FakeScene(tmp_path))
    other.view.set_layer("depth")
    other.save()
    other.close()
    session.open_scene(FakeScene(tmp_path))
    assert (strokes.strokes, session.view_state.layer, session.dirty) == ([7], "depth", False)
    session.open_clip(MemoryClip())
    assert strokes.strokes == []


def test_the_cursor_comes_back_and_the_views_are_told(session, tmp_path):
    session.go_to(7)
    session.camera_mode, session.probe = "free", Spot(7, 3.5, 4.5)
    assert not session.dirty
    session.save()
    session.close()
    again, received = Session(), []
    for signal in (again.frame_changed, again.camera_mode_changed, again.probe_changed):
        signal.connect(received.append)
    again.open_scene(FakeScene(tmp_path))
    assert received == [7, "free", Spot(7, 3.5, 4.5)]
    assert (again.frame, again.camera_mode, again.probe, again.dirty) == (7, "free", Spot(7, 3.5, 4.5), False)


def test_a_clip_replaces_a_scene(session):
    session.view.set_layer("depth")
    session.go_to(4)
    session.open_clip(MemoryClip())
    assert (session.scene, session.frames, session.size, session.frame, session.view_state) == (None, 10, (48, 40), 0, ViewState())
    assert session.undo.undo_name is None


def test_save_into_a_folder_that_is_gone(session, tmp_path):
    session.view.set_layer("depth")
    session.store.folder = tmp_path / "file" / "x"
    (tmp_path / "file").write_text("")
    with pytest.raises(DegenseError, match="cannot be written"):
        session.save()
    assert session.dirty


def test_ranges_are_kept_by_layer():
    view_state = ViewState().with_range("depth", ColourRange("fixed", 1, 2)).with_range("warp", ColourRange("frame"))
    assert view_state.range("depth") == ColourRange("fixed", 1, 2)
    assert view_state.range("displacement") == ColourRange()
    assert replace(view_state, layer="warp").range("warp").mode == "frame"
