"""The parser of the command line. It knows names and types only, so that it is made at once; commands import what they need."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from degense.app.cli.arguments.anonymise_options import add_anonymise_options as _anonymise
from degense.app.cli.arguments.argument_types import frame_range as _frame_range
from degense.app.cli.arguments.argument_types import labelled_or_range as _labelled_or_range
from degense.app.cli.arguments.argument_types import number_range as _range
from degense.app.cli.arguments.argument_types import positive as _positive
from degense.app.cli.arguments.argument_types import setting as _setting
from degense.app.cli.arguments.argument_types import size as _size
from degense.app.cli.arguments.batch_options import add_batch_options
from degense.app.cli.arguments.clip_arguments import add_clip_options
from degense.app.cli.arguments.movie_options import add_movie_options
from degense.app.cli.arguments.reliability_options import add_reliability_options
from degense.app.cli.arguments.search_options import add_search_options
from degense.app.cli.arguments.sweep_options import add_sweep_options

LABEL_FORMATS = "masks-png, coco, cvat, cvat-video, label-studio, yolo, nifti, seg-nrrd, dicom-seg, cholecseg8k or endovis18"
SYSTEMS = "langsplat, opengaussian, dgd, fe4dgs, surgtpgs, degensegs, degense"
RUN_ENCODER = "answers prompts instead of what the run keeps of it: the model or file that made its text vectors, no other"
CLASS_ENCODER = "gives a teacher's classes their vectors: a CLIP's or sentence model's folder, or a file of text vectors (.safetensors)"
#: Adds a command: its name, "MODULE:FUNCTION" in this package, and what it does.
Command = Callable[[str, str, str], argparse.ArgumentParser]


def build_parser() -> tuple[argparse.ArgumentParser, set[str]]:
    """The parser and the names of its commands."""
    parser = argparse.ArgumentParser(
        prog="degense",
        description="Reconstruct a surgical video as a 4D Gaussian scene, prompt it in words, and inspect how tissue moved.",
        epilog="Without a command, `degense [PATH]` opens the window, with a clip or a run in it. For research; not a medical device.",
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def command(name: str, run: str, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        sub.set_defaults(run=f"degense.app.cli.{run}", parser=sub)
        return sub

    for group in (_window, _clips, _training, _scores, _outputs, _questions, _exports, _labels, _machine):
        group(command)
    return parser, set(commands.choices)


def _window(command: Command) -> None:
    sub = command("open", "window:window", "open the window (the default)")
    sub.add_argument("path", nargs="?", type=Path, metavar="PATH", help="a clip (folder or video file) or a run folder")

    sub = command("view", "window:view", "show a run in the window, or in the viewer rerun")
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--rerun", action="store_true", help="in rerun (extra rerun), which reports how its viewer is used unless told not to")
    sub.add_argument("--save", type=Path, metavar="FILE", help="with --rerun: write a recording (.rrd) instead of opening its viewer")

    sub = command("demo", "window:demo", "show the embedded sample: no data, no GPU")
    sub.add_argument("--headless", type=Path, metavar="OUT", help="no window: write its pictures into the folder OUT")


def _clips(command: Command) -> None:
    sub = command("phantom", "clips:phantom", "make a synthetic clip with exact truth")
    sub.add_argument("out", type=Path, metavar="OUT", help="folder to write")
    sub.add_argument("--frames", type=_positive, metavar="N", help="number of frames")
    sub.add_argument("--size", type=_size, metavar="WxH", help="picture size, such as 320x256")
    sub.add_argument("--seed", type=int, metavar="S", help="another seed, another scene")
    sub.add_argument("--camera-motion", type=float, metavar="A", help="amplitude of the camera's motion; 0 stands still")
    sub.add_argument("--noise", type=float, metavar="S", help="standard deviation of the sensor noise, in grey levels")
    sub.add_argument("--kind", metavar="NAME", help="cautery (default) or family: what happens in it")
    sub.add_argument("--family", type=int, metavar="N", help="surgery number N of the family: short for --kind family --seed N")
    sub.add_argument("--depth", metavar="WHICH", help="exact (default), noisy as of a stereo endoscope, or none")
    sub.add_argument("--tool-masks", action="store_true", help="write masks/ too (255 = tool): instruments are then left out of everything")

    sub = command("info", "clips:info", "say what is found in a clip")
    sub.add_argument("clip", type=Path, metavar="CLIP")
    add_clip_options(sub)

    sub = command("datasets", "clips:datasets", "list the clips of a data set")
    sub.add_argument("folder", type=Path, metavar="FOLDER", help="a data set as downloaded, or any folder of clips")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the list there too")


def _training(command: Command) -> None:
    sub = command("train", "training:train", "reconstruct a clip")
    sub.add_argument("clip", type=Path, metavar="CLIP")
    sub.add_argument("--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    sub.add_argument("--preset", default="balanced", metavar="NAME", help="quick, balanced (default) or best")
    sub.add_argument("--routing", metavar="NAME", help="how semantic gradients travel: paper, isolated or coupled")
    sub.add_argument("--system", metavar="NAME", help=f"train as a system that the paper compares ({SYSTEMS})")
    sub.add_argument(
        "--teacher", metavar="NAME", help="where semantics come from: labels, strokes, precomputed[:FOLDER], vlm:MODEL or none"
    )
    sub.add_argument("--encoder", metavar="PLACE", help=CLASS_ENCODER)
    sub.add_argument("--iterations", type=_positive, metavar="N")
    sub.add_argument("--max-gaussians", type=_positive, metavar="N")
    sub.add_argument("--device", metavar="NAME", help="auto (default), cpu or cuda")
    sub.add_argument("--seed", type=int, metavar="S")
    sub.add_argument(
        "--set",
        type=_setting,
        action="append",
        default=[],
        dest="settings",
        metavar="NAME=VALUE",
        help="any other setting, repeatable; --set help explains them all",
    )
    sub.add_argument("--resume", action="store_true", help="go on from the last checkpoint in RUN")
    sub.add_argument("--profile", action="store_true", help="print where the time goes; RUN/profile.json and RUN/profile.svg keep it")
    sub.add_argument("--logger", choices=("tensorboard",), help="also write every term of the loss to RUN/tensorboard (extra tensorboard)")
    sub.add_argument("--events", action="store_true", help="one JSON object a line on standard output; `stop` on standard input stops")
    add_clip_options(sub)

    add_batch_options(
        command("batch", "batch.command:batch", "train, score, ask and export any number of clips, and go on where it stopped")
    )


def _scores(command: Command) -> None:
    sub = command("eval", "scores:evaluate", "score a run against its clip")
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--clip", type=Path, metavar="CLIP", help="where the clip is, when it has moved")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the scores there too")
    sub.add_argument("--lpips", action="store_true", help="score LPIPS too; downloads its network when it is missing (extra lpips)")
    sub.add_argument("--report", type=Path, metavar="FOLDER", help="write report.json, report.md and report.html there, with pictures")
    _anonymise(sub)
    add_clip_options(sub)

    sub = command("compare", "scores:compare", "train and score the systems that the paper compares on one clip")
    sub.add_argument("clip", type=Path, metavar="CLIP", help="with label maps")
    sub.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for runs, scores and the report; goes on where it stopped"
    )
    sub.add_argument("--methods", metavar="NAME,...", help=f"{SYSTEMS} (default: all)")
    sub.add_argument("--seeds", type=_positive, default=1, metavar="N", help="trainings of each (default 1; intervals take 2 or more)")
    sub.add_argument("--teacher", metavar="NAME", help="where semantics come from, the same for all: as for train")
    sub.add_argument("--preset", default="balanced", metavar="NAME", help="quick, balanced (default) or best")
    sub.add_argument("--iterations", type=_positive, metavar="N")
    sub.add_argument("--max-gaussians", type=_positive, metavar="N")
    sub.add_argument("--device", metavar="NAME", help="auto (default), cpu or cuda")
    add_clip_options(sub)

    sub = command("bench", "scores:bench", "measure run time against error on this machine")
    sub.add_argument(
        "names", nargs="*", metavar="NAME", help="benchmarks, or all; none lists them; `report FOLDER` makes a page of saved tables"
    )
    sub.add_argument("--device", default="auto", metavar="NAME", help="auto (default), cpu or cuda")
    sub.add_argument("--seeds", type=_positive, metavar="N", help="trainings and random scenes of each kind (default 3; with --quick 1)")
    sub.add_argument("--repeats", type=_positive, metavar="N", help="of each timing (default 15; with --quick 5)")
    sub.add_argument("--quick", action="store_true", help="small scenes, short trainings: to see that it runs, not to quote")
    sub.add_argument("--clip", type=Path, action="append", default=[], metavar="CLIP", help="a real clip, of clips and cameras; repeatable")
    sub.add_argument("--out", type=Path, metavar="PATH", help="folder for tables (.json) and plots (.png); of a report, the file")
    group = sub.add_argument_group("of the benchmarks surgeries and clips", "which go on where they stopped in the folder of --out")
    add_sweep_options(group, _setting, _size, _positive)
    add_reliability_options(sub.add_argument_group("of the benchmark reliability", "whose parts may follow its name"), _positive)


def _outputs(command: Command) -> None:
    sub = command("render", "outputs:render", "draw a layer of a run")
    _run_and_frames(sub).add_argument(
        "--cameras", type=Path, metavar="PATH", help="a camera path that the window saved (.json): a flight along it, .mp4"
    )
    sub.add_argument("--layer", default="rgb", metavar="NAME", help="rgb (default), or a name from the README")
    sub.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help=".png, or .npy for raw values; with --frames a folder, .npy or .mp4"
    )
    sub.add_argument("--range", type=_range, metavar="LOW:HIGH", help="values of the first and last colour (default: from the frames)")
    _prompts(sub, required=False)
    sub.add_argument("--encoder", metavar="PLACE", help=RUN_ENCODER)
    _anonymise(sub)

    sub = command("segment", "outputs:segment", "write the masks of prompts")
    _run_and_frames(sub)
    sub.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help=".png: 255 in the mask (several prompts: 1, 2 …); .npy: bool [H, W] or [n, H, W]; "
        "with --frames a folder for label maps, masks and areas, in which what is there already is kept",
    )
    _prompts(sub, required=True)
    sub.add_argument("--encoder", metavar="PLACE", help=RUN_ENCODER)
    _anonymise(sub)

    sub = command("checksum", "outputs:checksum", "write check sums of a finished run, or say whether it was changed since")
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--check", action="store_true", help="compare the run with its check sums")


def _questions(command: Command) -> None:
    sub = command("query", "questions.query:query", "say when, and with how large a mask, questions are answered in a run")
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("prompts", nargs="+", metavar="QUESTION", help='such as "grasper touching liver", "vessel left of gallbladder"')
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the moments and the areas of all frames there")
    sub.add_argument("--out", type=Path, metavar="DIR", help="write there the masks of the frames that answer, a folder for each question")
    _decoding(sub)
    sub.add_argument("--encoder", metavar="PLACE", help=RUN_ENCODER)
    _anonymise(sub)

    sub = command("search", "questions.search:search", "ask all runs of a folder at once, from an index that is made beside them")
    add_search_options(sub, _positive)

    sub = command("track", "tracks:track", "follow points through a run, in the picture and in space, or through a clip, in the picture")
    sub.add_argument("path", type=Path, metavar="PATH", help="a run, or a clip: then along its optical flow alone")
    which = sub.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "--points",
        type=Path,
        metavar="FILE",
        help="from where it first knows them: .json as of VL-SurgPT, .csv, .npz as of TAP-Vid, or the folder of a sequence of STIR, "
        "VL-SurgPT or SurgT",
    )
    which.add_argument("--grid", type=_positive, metavar="N", help="N × N points all over a frame")
    sub.add_argument("--frame", type=int, default=0, metavar="I", help="frame of the grid (default 0)")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write there where each point is in every frame")


def _exports(command: Command) -> None:
    sub = command("export", "outputs:export", "write a run, or the annotations of a clip, in formats that other tools read")
    sub.add_argument("path", type=Path, metavar="PATH", help="run folder, or a clip: then its annotations")
    sub.add_argument("--format", required=True, metavar="NAME", help=f"ply, spz, gltf, ply-sequence, movie, {LABEL_FORMATS}")
    sub.add_argument("--out", type=Path, required=True, metavar="PATH", help="file, or folder for ply-sequence and masks-png")
    sub.add_argument("--frame", type=float, metavar="I", help="frame of a single ply, spz or gltf (default: the reference frame)")
    sub.add_argument("--layer", default="rgb", metavar="NAME", help="layer of a movie")
    sub.add_argument(
        "--frames",
        type=_labelled_or_range,
        metavar="A:B",
        help="label maps of frames A up to but not including B, of the annotated frames (labelled), or of all (default)",
    )
    sub.add_argument(
        "--source",
        choices=("masks", "annotations"),
        help="label maps of what the run answers or of what was annotated (default: annotations, if there are any and no prompts)",
    )
    _prompts(sub, required=False)
    _anonymise(sub)

    sub = command("movie", "movies:movie", "write a movie of layers, side by side, through time or along a camera path")
    add_movie_options(sub)
    _anonymise(sub)
    _prompts(sub, required=False)

    sub = command("share", "outputs:share", "write a run as one web page that turns and plays in any browser, from disk")
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="page to write (.html)")
    _anonymise(sub)
    _prompts(sub, required=False)


def _labels(command: Command) -> None:
    sub = command("annotate", "labels:annotate", "propagate label maps of some frames to all others")
    sub.add_argument("path", type=Path, metavar="PATH", help="a run, or a clip: then along its motion alone")
    maps = "indexed or grey PNG with class numbers, 255 unlabelled; repeatable (default: what was annotated by hand, else the clip's)"
    sub.add_argument("--labels", type=Path, action="append", default=[], metavar="FILE", help=maps)
    sub.add_argument("--frame", type=int, action="append", default=[], metavar="I", help="the frame of each --labels, from 0")
    sub.add_argument("--out", type=Path, metavar="PATH", help="folder or file to write")
    sub.add_argument("--format", default="masks-png", metavar="NAME", help=f"{LABEL_FORMATS} (default masks-png)")
    sub.add_argument("--review", action="store_true", help="keep them with the run or clip as proposals, to accept or reject in the window")
    sub.add_argument(
        "--unknown", action="store_true", help="with --out: call what no labelled frame shows unknown, for a training that keeps it apart"
    )
    sub.add_argument("--replace", action="store_true", help="with --review: also for frames that have labels")

    sub = command("import", "labels:import_labels", "take label maps of another tool as annotations of a run or clip")
    sub.add_argument("path", type=Path, metavar="PATH", help="a run or a clip")
    sub.add_argument("file", type=Path, metavar="FILE", help="file or folder to read")
    sub.add_argument("--format", required=True, metavar="NAME", help=LABEL_FORMATS)


def _machine(command: Command) -> None:
    sub = command("cache", "machine:cache", "say what teachers' answers take on disk, and make room")
    sub.add_argument("--clear", action="store_true", help="remove them all; they are made again when needed")
    sub.add_argument("--limit", type=float, metavar="GB", help="the most they may take from now on")

    command("doctor", "machine:doctor", "say what this machine can do, and what is missing")


def _run_and_frames(sub: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    which = sub.add_mutually_exclusive_group(required=True)
    which.add_argument("--frame", type=float, metavar="I", help="frame number; fractions lie between frames")
    which.add_argument("--frames", type=_frame_range, metavar="A:B", help="frames A up to but not including B, or all")
    return which


def _prompts(sub: argparse.ArgumentParser, required: bool) -> None:
    sub.add_argument("--prompt", action="append", default=[], required=required, metavar="TEXT", dest="prompts", help="repeatable")
    _decoding(sub)


def _decoding(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--decoder", metavar="NAME", help="rnse (default), threshold, argmax, rnse+argmax or rnse-paper")
    sub.add_argument("--threshold", type=float, metavar="X", help="cosine from which a pixel belongs to a mask")
