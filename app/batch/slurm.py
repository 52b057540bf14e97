"""A batch as a job array of Slurm: each task does its share of the jobs in a folder that all nodes see."""

from __future__ import annotations

import shlex
import unicodedata
from pathlib import Path

from degense.engine.errors import DegenseError

MOST_TASKS = 1000  # Slurm's MaxArraySize is 1001 unless a cluster says otherwise


def slurm_script(folder: Path, jobs: int, slots: int, device: str) -> str:
    """The script for `sbatch`, of which `slots` tasks run at a time. DegenseError for a folder that no script can name."""
    if any(unicodedata.category(letter) == "Cc" for letter in str(folder)):
        raise DegenseError(f"{str(folder)!r} holds control characters, which have no place in a script; choose another folder.")
    tasks = min(jobs, MOST_TASKS)
    command = f'{shlex.join(["degense", "batch", "--out", str(folder)])} --share "$SLURM_ARRAY_TASK_ID/{tasks}" --slots 1 --json'
    gpu = "" if device == "cpu" else "#SBATCH --gres=gpu:1\n"
    return f"""#!/bin/bash
# {jobs} jobs in {tasks} tasks. Set partition, account, time and memory as your cluster needs, and submit it with sbatch.
# A task that is stopped or requeued saves a checkpoint; submitted again, the array does what is left.
#SBATCH --job-name=degense
#SBATCH --array=0-{tasks - 1}%{slots}
#SBATCH --cpus-per-task=4
#SBATCH --mem=8G
{gpu}#SBATCH --time=04:00:00
#SBATCH --requeue
#SBATCH --signal=B:TERM@120
exec {command}
"""
