"""The options of `degense batch`, and a plan as an example."""

from __future__ import annotations

import argparse

from degense.app.cli.arguments.argument_types import positive, setting, share

PLAN = """\
A plan is a TOML file; paths are meant as seen from its folder:

  clips = ["patients/*", "more/case.mp4"]  # * and ? stand for names within a folder
  preset = "balanced"                      # and whatever else is named here holds for all clips:
  teacher = "labels"                       # routing, iterations, max_gaussians, device, seed, layout, mask_means, focal,
  prompts = ["grasper", "grasper touching liver"]  # poses, pose_axes, labels, start, stride, max_frames, decoder, threshold
  exports = ["coco", "ply"]                # formats of degense export, with the masks of the prompts
  scores = true                            # degense eval
  anonymise = true                         # no names in the report and in exports; cover = "mask.png": black there
  settings = { flow = 7.0 }                # degense train --set help

  [[clip]]                                 # a clip with answers of its own
  path = "odd.mp4"
  name = "case-7"
  poses = "still"

  [variant.paper]                          # every clip is done with every variant
  routing = "paper"
  [variant.ours]
"""
TEXTS = ("preset", "routing", "teacher", "device", "layout", "mask_means", "poses", "pose_axes", "labels", "decoder")
NUMBERS = ("iterations", "max_gaussians", "stride", "max_frames")


def add_batch_options(sub: argparse.ArgumentParser) -> None:
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.epilog = PLAN
    sub.add_argument("paths", nargs="*", metavar="CLIP", help="clips, or one plan (.toml); none: go on with the batch in DIR")
    sub.add_argument("--out", required=True, metavar="DIR", help="folder of the batch; the same command goes on where it stopped")
    sub.add_argument("--slots", type=positive, metavar="N", help="jobs at a time (default: what fits); with --cluster, on each GPU")
    sub.add_argument("--cluster", metavar="ADDRESS", help="do them on the workers of this Dask scheduler (extra cluster)")
    sub.add_argument(
        "--patience",
        type=positive,
        metavar="SECONDS",
        help="with --cluster: how long to wait for a worker where none can go on (default 600)",
    )
    sub.add_argument("--emit", nargs=2, metavar=("slurm", "FILE"), help="write a job array for sbatch instead of doing anything")
    sub.add_argument("--share", type=share, metavar="I/N", help="do only every Nth job, from the Ith on (from 0): for several machines")
    sub.add_argument("--json", action="store_true", help="one JSON object a line on standard output instead of a table")
    group = sub.add_argument_group("of all clips, where no plan says so", "as of train, query and export")
    for name in TEXTS:
        group.add_argument(f"--{name.replace('_', '-')}", metavar="NAME")
    for name in NUMBERS:
        group.add_argument(f"--{name.replace('_', '-')}", type=positive, metavar="N")
    group.add_argument("--seed", type=int, metavar="S")
    group.add_argument("--start", type=int, metavar="N")
    group.add_argument("--focal", type=float, metavar="PX")
    group.add_argument("--threshold", type=float, metavar="X")
    group.add_argument("--set", type=setting, action="append", dest="settings", metavar="NAME=VALUE")
    group.add_argument("--prompt", action="append", dest="prompts", metavar="TEXT", help="ask every run this; repeatable")
    group.add_argument("--export", action="append", dest="exports", metavar="FORMAT", help="write every run in this format; repeatable")
    group.add_argument(
        "--anonymise", action="store_true", default=None, help="number the jobs; the report and exports name neither clips nor files"
    )
    group.add_argument("--cover", metavar="MASK", help="with --anonymise: a picture, not black where exports are blacked out")
    group.add_argument("--no-eval", action="store_false", dest="scores", default=None, help="do not score the runs")
