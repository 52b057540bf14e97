"""How many trainings run beside the window, and what each may use."""

from __future__ import annotations

from degense.app.features.train.job import TrainingJob
from degense.engine.gpu import gpu_usable
from degense.engine.processes.capacity import cores, slot_environment, trainings_at_once

CORES_EACH = 4  # of a processor, so that the window and the trainings stay quick


def fitting() -> int:
    """As many as the machine holds: on GPUs as their memory does, else one for four cores."""
    if gpu_usable():
        return trainings_at_once("cuda")
    return max(1, min(cores() // CORES_EACH, trainings_at_once("cpu")))


def environment_of(job: TrainingJob, number: int, slots: int) -> dict[str, str]:
    """Variables for the training in slot `number`; none where it has the machine to itself."""
    if slots == 1:
        return {}
    device = "cuda" if job.device != "cpu" and gpu_usable() else "cpu"
    return slot_environment(number, slots, device)
