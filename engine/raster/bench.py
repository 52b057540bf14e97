"""How fast is the CPU back end? `python -m engine.raster.bench` prints a table: medians of wall time, ms."""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable

import torch

from engine.raster.scenes import draw_scene, random_scene


def median_ms(work: Callable[[], object], repeats: int) -> float:
    """Median wall time of `work`, ms, after three calls that warm up."""
    times = []
    for i in range(3 + repeats):
        begin = time.perf_counter()
        work()
        if i >= 3:
            times.append((time.perf_counter() - begin) * 1e3)
    return statistics.median(times)


def main() -> None:
    """Parse the size of the job and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gaussians", type=int, default=30_000)
    parser.add_argument("--size", default="640x512", help="WIDTHxHEIGHT")
    parser.add_argument("--footprint", type=float, default=2.5, help="median standard deviation of a Gaussian on the screen, pixels")
    parser.add_argument("--repeats", type=int, default=25)
    options = parser.parse_args()
    width, height = (int(number) for number in options.size.split("x"))
    begin = time.perf_counter()
    tensors, camera = random_scene(10, 8, 8, 1, 0)
    draw_scene([tensor.requires_grad_() for tensor in tensors], camera).image.sum().backward()
    print(f"first picture (compiling, or reading what was compiled): {time.perf_counter() - begin:.1f} s")

    scene = f"{options.gaussians} Gaussians, {width} × {height}"
    for channels in (4, 20):
        tensors, camera = random_scene(options.gaussians, width, height, channels, 0, footprint=options.footprint)
        leaves = [tensor.clone().requires_grad_() for tensor in tensors]
        pull = torch.randn(height, width, channels)

        def forward(tensors=tensors, camera=camera):
            with torch.no_grad():
                return draw_scene(tensors, camera)

        def both(leaves=leaves, camera=camera, pull=pull):
            draw_scene(leaves, camera).image.backward(pull)

        def features_only(tensors=tensors, leaves=leaves, camera=camera, pull=pull):
            draw_scene([*tensors[:4], leaves[4]], camera).image.backward(pull)

        if channels == 4:
            threads, load = torch.get_num_threads(), os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
            print(f"{scene}, mean alpha {forward().alpha.mean():.2f}, {threads} threads, load {load:.1f}")
        print(f"{channels:3d} channels: forward {median_ms(forward, options.repeats):6.1f}", end="")
        print(f"   forward + backward {median_ms(both, options.repeats):6.1f}", end="")
        print(f"   features only {median_ms(features_only, options.repeats):6.1f}")

    tensors, camera = random_scene(options.gaussians, width, height, 3, 0, footprint=options.footprint)

    def frame():
        with torch.no_grad():
            return draw_scene(tensors, camera).image.mul_(255.0).clamp_(0.0, 255.0).to(torch.uint8).numpy()

    print(f"baked playback, uint8 frame: {median_ms(frame, options.repeats):6.1f}")


if __name__ == "__main__":
    main()
