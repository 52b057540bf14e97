"""What a training does now, in words."""

from __future__ import annotations

from degense.engine.events import Event, Stage, Step

STAGES = {
    "poses": "Finding the camera",
    "load": "Reading the clip",
    "teacher": "Asking the teacher what is where",
    "flow": "Measuring motion",
    "coarse": "Coarse: static Gaussians",
    "joint": "Joint: motion, colour and semantics",
    "semantics": "Semantics: what is where",
}


def stage_words(event: Event) -> str | None:
    """The stage that an event tells of; None for events of other kinds."""
    match event:
        case Stage(stage):
            return STAGES.get(stage, stage)
        case Step(stage, fraction):
            return f"{STAGES.get(stage, stage)}: {fraction:.0%}"
    return None
