"""What the teacher's resolution and the rank of the latents cost and bring."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import BenchTraining, base_config, phantoms, protocol, score_all, size_of
from degense.engine.research.degraded_teachers import VLM_LIKE
from degense.engine.semantics.prompts import DECODERS

COARSENESS = (1, 4, 8, 16, 32)  # pixels of the frame along a side of the teacher's patches
RANKS = (2, 4, 8, 16, 32, 128)
COLUMNS = [
    *(Column(f"miou {d}", f"mIoU {d}", 3, "mean") for d in DECODERS),
    Column("boundary", "boundary F (argmax)", 3, "mean"),
    Column("error", "1 − mIoU argmax", 3, "mean"),
    Column("train_seconds", "training, s", 1, "mean"),
    Column("query_ms", "another prompt, ms", 1),
    Column("query_new_frame_ms", "prompt on a new frame, ms", 1),
]


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """For each phantom, resolutions and ranks."""
    clips = phantoms(options, lambda fraction, words: progress(0.03 * fraction, words))
    longest, done = max(size_of(options).width, size_of(options).height), 0
    for kind, clip in clips.items():
        resolutions = {f"1/{c}" if c > 1 else "full": (replace(VLM_LIKE, patches=longest // c if c > 1 else 0), 32) for c in COARSENESS}
        ranks = {f"{r}" if r < 128 else "all": (VLM_LIKE, r) for r in RANKS}
        for what, heading, variants in (
            ("resolution", "teacher's features", resolutions),
            ("rank", "at most so many latent dimensions", ranks),
        ):
            trainings = [
                BenchTraining(
                    clip,
                    options.scratch / f"latent-{kind}-{what}-{i}-{seed}",
                    base_config(options, seed=seed, max_rank=rank),
                    f"degraded:{teacher}",
                )
                for i, (teacher, rank) in enumerate(variants.values())
                for seed in options.seeds
            ]

            def tell(fraction: float, words: str, n: int = done) -> None:
                progress(0.03 + 0.97 * (n + fraction) / (2 * len(clips)), words)

            scores = score_all(trainings, options, tell, f"{kind}, {what}: trainings")
            done += 1
            rows: list[dict[str, Cell]] = []
            for i, name in enumerate(variants):
                runs = scores[i * len(options.seeds) : (i + 1) * len(options.seeds)]
                row: dict[str, Cell] = {"name": name, "rank": [r["rank"] for r in runs]}
                row |= {f"miou {d}": [r["miou"][d] for r in runs] for d in DECODERS}
                row |= {"boundary": [r["masks"]["argmax"]["boundary_f"] for r in runs], "error": [1 - r["miou"]["argmax"] for r in runs]}
                rows.append(row | {key: [r[key] for r in runs] for key in ("train_seconds", "query_ms", "query_new_frame_ms")})
            columns = [Column("name", heading), Column("rank", "rank used", 0, "mean"), *COLUMNS]
            title = f"{'Resolution of the features' if what == 'resolution' else 'Rank of the latents'}, phantom “{kind}”"
            words = f"{protocol(options)} Teacher: {VLM_LIKE}, but for what the row says. Times on processes that share the machine."
            yield Table(f"latent-{kind}-{what}", title, words, columns, rows, pareto=("train_seconds", "error"))
