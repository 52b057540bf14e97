"""Answers that need no scene, and that a scene must beat: of teachers, of optical flow, of the clip itself."""

from degense.engine.research.baselines.clip_flow import ClipFlow
from degense.engine.research.baselines.score import below_baseline, note, number, score_baselines

__all__ = ["ClipFlow", "below_baseline", "note", "number", "score_baselines"]
