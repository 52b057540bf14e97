"""`degense query`."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from degense.app.cli.options import anonymised_scene, asked_prompts, chosen_encoder
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.prompts.segment import folder_name, write_clip_masks
from degense.engine.errors import DegenseError
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.engine.scene.moments import Answer, Moment


def query(options: argparse.Namespace) -> None:
    """Ask a whole clip: print the moments that answer each question, and write masks and numbers where that is wished."""
    from dataclasses import replace

    from degense.engine.scene import Scene
    from degense.engine.scene.moments import answers_json, ask_clip

    prompts = asked_prompts(options)
    scene = anonymised_scene(Scene.open(options.run_folder, encoder=chosen_encoder(options)), options)
    if options.out is not None and options.out.is_file():
        raise DegenseError(f"{options.out} is a file; masks of several frames go into a folder.")
    answers = run_steps(ask_clip(scene, prompts), Bar())
    for answer in answers:
        print("\n".join(_told(answer, scene.fps)))
    if options.json is not None:
        write_text(options.json, json.dumps(answers_json(answers, scene.fps), ensure_ascii=False))
    for number, answer in enumerate(answers, 1):
        frames = [int(frame) for frame in answer.kept.nonzero()[0]]
        if options.out is not None and frames:
            folder = options.out / folder_name(number, answer.text)
            run_steps(write_clip_masks(scene, replace(prompts, prompts=(answer.text,)), frames, folder), Bar())
            print(f"{folder}: masks of {len(frames)} frames")


def _told(answer: Answer, fps: float) -> list[str]:
    count, frames = len(answer.moments), int(answer.kept.sum())
    if not count:
        return [f"{answer.text}: in none of {len(answer.kept)} frames"]
    moments = f"{count} moment{'s' * (count > 1)}, {frames} of {len(answer.kept)} frames"
    return [f"{answer.text}: {moments}", *(f"  {_line(moment, fps)}" for moment in answer.moments)]


def _line(moment: Moment, fps: float) -> str:
    one = moment.first == moment.last
    when = f"frame {moment.first}" if one else f"frames {moment.first} to {moment.last}"
    seconds = f"{moment.first / fps:.2f} s" if one else f"{moment.first / fps:.2f} to {moment.last / fps:.2f} s"
    largest = f"{moment.area:.1%} of the picture" + ("" if one else f" at most, in frame {moment.peak}")
    return f"{when} ({seconds}): {largest}"
