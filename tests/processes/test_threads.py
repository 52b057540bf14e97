"""How many threads kernels and torch use; and those of generators: a generator may be closed by the garbage collector, in any thread, and
must wait for nothing there."""

import ast
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import torch

import degense.engine
from degense.engine.motion import flow
from degense.engine.research.bench.timing import threads
from degense.engine.threads import kernel_threads, made_ahead, many_torch_threads, one_torch_thread

ROOT = Path(degense.engine.__file__).parent.parent


@pytest.fixture
def blocked(monkeypatch):
    """A search of flow that goes on until the test is over; and what says that it has begun."""
    begun, over = threading.Event(), threading.Event()

    def search(a, b, initial=None, smoothness=0.0):
        begun.set()
        over.wait(30)
        return np.zeros((*a.shape[:2], 2), np.float32)

    monkeypatch.setattr(flow, "_search", search)
    yield begun, over
    over.set()


def test_a_generator_that_is_left_waits_for_none_of_its_threads(blocked):
    begun, over = blocked
    made = made_ahead(lambda item: item if item == 0 else over.wait(30), range(8), 2)
    assert next(made) == 0
    steps = flow.steps_between(np.zeros((8, 12, 12, 3), np.uint8), threads=2)
    asking = threading.Thread(target=lambda: next(steps), daemon=True)
    asking.start()
    assert begun.wait(10)
    made.close()
    assert not over.is_set(), "closed while its thread goes on"
    over.set()
    asking.join(10)
    steps.close()


def test_kernels_keep_their_threads_where_torch_has_one():
    with threads(3):
        assert kernel_threads() == 3
        with one_torch_thread():
            assert (torch.get_num_threads(), kernel_threads()) == (1, 3)
            with one_torch_thread(1):
                assert (torch.get_num_threads(), kernel_threads()) == (1, 1)
            assert list(made_ahead(lambda _: torch.get_num_threads(), range(4), 2)) == [1] * 4
            assert (torch.get_num_threads(), kernel_threads()) == (1, 3)
            elsewhere = []
            thread = threading.Thread(target=lambda: elsewhere.append(kernel_threads()))
            thread.start()
            thread.join()
            assert elsewhere == [torch.get_num_threads()], "only the calling thread is meant"
        assert (torch.get_num_threads(), kernel_threads()) == (3, 3)


def test_large_operations_have_all_threads_again_for_a_while():
    with threads(3), one_torch_thread():
        with many_torch_threads():
            assert (torch.get_num_threads(), kernel_threads()) == (3, 3)
        assert (torch.get_num_threads(), kernel_threads()) == (1, 3)


def test_what_is_made_ahead_comes_in_order():
    assert list(made_ahead(lambda item: 2 * item, range(11), 3)) == [2 * item for item in range(11)]
    assert list(made_ahead(str, [])) == []


def test_no_generator_waits_for_threads_at_its_end():
    """Each takes its threads from `abandonable_pool`: `with ThreadPoolExecutor(…)` waits when the garbage collector closes it."""
    found = []
    for path in [*ROOT.glob("engine/**/*.py"), *ROOT.glob("app/**/*.py")]:
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(function, ast.FunctionDef):
                continue
            nodes = list(ast.walk(function))
            entered = [item for node in nodes if isinstance(node, ast.With) for item in node.items]
            waits = any("ThreadPoolExecutor(" in ast.unparse(item) for item in entered)
            if waits and any(isinstance(node, ast.Yield | ast.YieldFrom) for node in nodes):
                found.append(f"{path.relative_to(ROOT)}: {function.name}")
    assert not found


def test_the_command_tells_threads_to_sleep_before_the_libraries_are_loaded_that_ask():
    code = "import os, sys, degense.app.cli.main; print('numpy' in sys.modules, os.environ['OPENBLAS_THREAD_TIMEOUT'])"
    told = {name: value for name, value in os.environ.items() if name != "OPENBLAS_THREAD_TIMEOUT"}
    for environment, wait in ((told, "4"), (told | {"OPENBLAS_THREAD_TIMEOUT": "26"}, "26")):
        child = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=True
        )
        assert child.stdout.split() == ["False", wait], "a user's own choice stands"
