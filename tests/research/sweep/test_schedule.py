"""Slots of a sweep: processes that begin at the same time."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from types import SimpleNamespace

import torch

run = import_module("degense.engine.research.sweep.run")  # the package calls its function so


def test_slots_that_begin_together_have_the_gpus_in_turn(monkeypatch, tmp_path):
    begun = []

    class Slow:
        """A process that takes a while to begin, in the environment of that time."""

        def __init__(self, *args, **options):
            pass

        def submit(self, *args):
            time.sleep(0.02)
            begun.append(os.environ["CUDA_VISIBLE_DEVICES"])

    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    monkeypatch.setattr(run, "ProcessPoolExecutor", Slow)
    plan = SimpleNamespace(slots=12, device="cuda", out=tmp_path)
    with ThreadPoolExecutor(12) as threads:
        list(threads.map(lambda number: run._slot_pool(plan, number), range(12)))
    assert sorted(begun) == sorted("0123" * 3)
    assert "CUDA_VISIBLE_DEVICES" not in os.environ
