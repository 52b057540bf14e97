"""How many trainings a machine holds at a time, on imagined GPUs; and that the window's queue begins so many."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from degense.app.features.train import slots
from degense.app.features.train.job import TrainingJob
from degense.app.features.train.queue import TrainingQueue
from degense.engine.processes import capacity
from degense.engine.processes.capacity import trainings_at_once

GIB = 1 << 30
CORES = 64


@pytest.fixture
def machine(monkeypatch):
    """Imagines a machine with so many cores, bytes of memory, and free bytes on each GPU."""

    def imagine(*free: int, cores: int = CORES, ram: int | None = None) -> None:
        monkeypatch.setattr(capacity, "cores", lambda: cores)
        monkeypatch.setattr(slots, "cores", lambda: cores)
        monkeypatch.setattr(capacity, "free_ram", lambda: ram)
        monkeypatch.setattr(torch.cuda, "device_count", lambda: len(free))
        monkeypatch.setattr(torch.cuda, "mem_get_info", lambda index: (free[index], 96 * GIB))
        monkeypatch.setattr(slots, "gpu_usable", lambda: bool(free))
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")

    return imagine


@pytest.mark.parametrize(("gib", "fits"), [(2, 1), (8, 2), (16, 4), (24, 6), (80, 12)])
def test_on_one_gpu(machine, gib, fits):
    """Four GiB each, a dozen at most: more would only wait for the GPU. One is tried also where less is free."""
    machine(gib * GIB)
    assert trainings_at_once("cuda") == slots.fitting() == fits


@pytest.mark.parametrize(
    ("free", "cores", "ram", "fits"),
    [
        ((24, 24), CORES, None, 12),
        ((80, 80, 8), CORES, None, 26),
        ((24,), 4, None, 4),  # each wants a core
        ((24,), CORES, 3 * GIB, 2),  # and 1.5 GiB of memory beside the processor
        ((), CORES, None, 1),
    ],
)
def test_on_several_and_where_something_else_is_short(machine, free, cores, ram, fits):
    machine(*(gib * GIB for gib in free), cores=cores, ram=ram)
    assert trainings_at_once("cuda") == fits


def test_on_the_processor_the_window_keeps_cores_for_itself(machine):
    machine(cores=16)
    assert (trainings_at_once("cpu"), slots.fitting()) == (16, 4)
    machine(cores=16, ram=3 * GIB)
    assert slots.fitting() == 2


@pytest.mark.parametrize(("gib", "fits"), [(8, 2), (16, 4), (24, 6), (80, 12)])
def test_the_queue_begins_as_many_as_fit_each_with_its_share(machine, monkeypatch, gib, fits):
    machine(gib * GIB)
    queue = TrainingQueue(slots.fitting)
    jobs = [TrainingJob(Path("clip"), Path(f"run-{number}"), device="auto") for number in range(fits + 2)]
    for job in jobs:
        queue.add(job)
    begun = [job for _ in range(fits + 2) if (job := queue.next()) is not None]
    assert begun == jobs[:fits]
    assert queue.full
    shares = [slots.environment_of(job, number, fits) for number, job in enumerate(begun)]
    assert {share["CUDA_VISIBLE_DEVICES"] for share in shares} == {"0"}
    assert {share["OMP_NUM_THREADS"] for share in shares} == {str(CORES // fits)}
    queue.ended(begun[0])
    assert queue.next() == jobs[fits]
    assert queue.next() is None


def test_several_gpus_are_used_in_turn(machine):
    machine(8 * GIB, 8 * GIB)
    shares = [slots.environment_of(TrainingJob(Path("clip"), Path("run")), number, slots.fitting()) for number in range(4)]
    assert [share["CUDA_VISIBLE_DEVICES"] for share in shares] == ["0", "1", "0", "1"]
