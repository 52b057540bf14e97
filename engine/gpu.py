"""Whether this machine's GPU can be used: one must be there and answer, with compiled kernels or a compiler for them."""

from __future__ import annotations

import importlib.util
import logging
import os
import shutil
from functools import lru_cache
from pathlib import Path

log = logging.getLogger(__name__)


def gpu_usable() -> bool:
    """Whether a GPU draws and trains here. Where one is that cannot, that is said once."""
    import torch

    if not torch.cuda.is_available():
        return False
    if sentence := lacking_kernels() or driver_fault():
        _say_once(sentence)
        return False
    return True


def driver_fault() -> str:
    """What to do where a driver promises a GPU and fails at its first use, as after an update of the driver; empty where it works."""
    import torch

    try:
        torch.zeros(1, device="cuda")
    except (RuntimeError, torch.cuda.DeferredCudaCallError) as error:
        reason = str(error).strip().partition("\n")[0].rstrip(".")
        return (
            f"The GPU cannot be used ({reason}): close what else uses it, restart the computer, or see degense doctor; "
            "meanwhile the processor does all."
        )
    return ""


def lacking_kernels() -> str:
    """What to do where there is a GPU without compiled kernels and without nvcc, which compiles them; empty elsewhere. Imports no gsplat,
    whose import would compile them."""
    import torch

    if not torch.cuda.is_available() or kernels_compiled() or nvcc():
        return ""
    return (
        f"There is a GPU, but not the compiler of its kernels: install the CUDA toolkit {torch.version.cuda} (nvcc) to use it; "
        "meanwhile the processor does all."
    )


def kernels_compiled() -> bool:
    """Whether gsplat's kernels are there, from an earlier start or in its package."""
    from torch.utils.cpp_extension import get_default_build_root

    root = Path(os.environ.get("TORCH_EXTENSIONS_DIR") or get_default_build_root())
    package = importlib.util.find_spec("gsplat")
    places = [Path(place) for place in (package.submodule_search_locations or ())] if package is not None else []
    return any(root.glob("**/gsplat_cuda.so")) or any(next(place.glob("csrc*.[sp][oy]*"), None) for place in places)


def nvcc() -> str:
    """The CUDA toolkit that torch would compile with; empty without one."""
    from torch.utils.cpp_extension import CUDA_HOME

    found = CUDA_HOME or ""
    if found and (Path(found, "bin", "nvcc").is_file() or Path(found, "bin", "nvcc.exe").is_file()):
        return found
    return str(Path(compiler).parent.parent) if (compiler := shutil.which("nvcc")) else ""


@lru_cache
def _say_once(sentence: str) -> None:
    log.warning(sentence)
