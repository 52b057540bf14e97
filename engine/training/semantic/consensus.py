"""Consensus over time: what a place is, from what a teacher calls it in all other frames and from what it calls all that looks like it.

A teacher errs in single frames, and a scene sees each place in all of them. No way of erring is assumed: how often the teacher contradicts
the consensus says how far it can be relied on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from degense.engine.latest import Latest
from degense.engine.progress import Progress, silent
from degense.engine.threads import kernel_threads, made_ahead, one_torch_thread
from degense.engine.training.semantic.appearance import Appearance, Looks
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.regions import Regions
from degense.engine.training.semantic.targets import SemanticTargets, SureAnswer
from degense.engine.training.semantic.vectors import shares_of, words_of

Made = TypeVar("Made")

COLOR_SCALE = 0.1  # of 1: difference of colour from which on a Gaussian counts as something else than before
PRIOR_PIXELS = 0.5  # pixels' worth of the clip's mean that every Gaussian begins with
LEAST = 1e-3  # of a share of votes: what all frames deny may still be
AROUND = 0.01  # the same for the regions around: what is small lies among others
NEAR = 0.05  # of the picture's width: how far the regions around reach at least
ROUNDS = 2  # in all but the first, frames vote with the consensus of the round before
SETTLED = 5e-3  # share of the pixels that the first round calls otherwise than the teacher, up to which it is taken at its word
MOST_VOTERS = 64  # frames that vote, evenly spread; a long clip has more
SCORE_BYTES = 1 << 29  # of what is known of frames, kept
AT_ONCE = 4  # frames at most, each with all its pixels in memory
PIXELS = 400_000  # of all frames, that the appearance is learned from


class Votes:
    """What each frame calls the Gaussians."""

    def __init__(self, geometry: FinishedGeometry):
        self._geometry = geometry
        self._sums: dict[int, Tensor] = {}  # by frame, Σ_p w_ip shares_p beside Σ_p w_ip, float [N, K + 1]
        self._colors: dict[int, Tensor] = {}

    @torch.no_grad()
    def add(self, frame: int, shares: Float[Tensor, "pixels words"]) -> None:
        """Let a frame vote: onto each Gaussian by its share in each pixel, so as far as it is visible there and then."""
        width, height = self._geometry.frames.size
        known = (shares.sum(1) > 0).to(shares).reshape(height, width)
        found = self._geometry.placed(frame).backproject(shares.reshape(height, width, -1), known)
        self._sums[frame], self._colors[frame] = torch.cat([found.total, found.weight[:, None]], 1), self._geometry.splats(frame).colors

    @torch.no_grad()
    def read(self, frame: int) -> Float[Tensor, "pixels words"]:
        """The shares of all other frames' votes at each pixel of a frame.

        A Gaussian i has Σ_s k_is Σ_p w_ip shares_p, with k_is = exp(−‖c_i − c_is‖² / 2 h²) of its colours now and in the voting frame:
        tissue that was charred since is asked what it is called now. Its shares are blended as colours are.
        """
        colors = self._geometry.splats(frame).colors
        total = torch.zeros_like(next(iter(self._sums.values())))
        for voter, sums in self._sums.items():
            if voter != frame or len(self._sums) == 1:
                far = (colors - self._colors[voter]).square().sum(1, keepdim=True)
                total.addcmul_(torch.exp(far / (-2 * COLOR_SCALE**2)), sums)
        votes, count = total[:, :-1], total[:, -1:]
        usual = votes.sum(0) / count.sum().clamp_min(1e-9)
        image = self._geometry.placed(frame).draw((votes + PRIOR_PIXELS * usual) / (count + PRIOR_PIXELS))
        flat = image.reshape(-1, image.shape[2]) + LEAST * usual
        return flat / flat.sum(1, keepdim=True).clamp_min(1e-9)


class Consensus:
    """What each pixel of a clip's frames is called, by all frames together.

        log q₀(word) = log p(word | votes of the other frames) + log p(word | look) − ½ log p(word) + λ [the frame's own word] + const
        log q(word) = log q₀(word) + 2 e log(p(word | q₀ of the regions around) + `AROUND`)

    The third term takes back half of the clip's frequencies of words, which both before it contain. λ ≥ 0 is `own_weight`, the log odds
    that the teacher is right where not all agree, e = 1 / (1 + exp λ): one that does not err is right where the scene is blurred and where
    regions of like colour meet. The regions (`Regions`) settle where one place and one look do not: whole regions called by another name
    for a while, and boundaries that wander. They reach farther, the more often votes and looks, which hold all frames, contradict each
    other: by that share of the picture's width beyond `NEAR`.

    A teacher that the first round contradicts in hardly a pixel (`SETTLED`) is taken at its word, and no other round follows: what would be
    changed are pixels at edges, which the scene blurs.

    The targets, which are the teacher's answers, are told their `disagreement` and `accuracy`.
    """

    @one_torch_thread()
    def __init__(self, geometry: FinishedGeometry, targets: SemanticTargets, seed: int, progress: Progress = silent):
        self._frames = frames = geometry.frames
        self._targets, self._words = targets, words_of(targets.sample, targets.classes)
        width, height = frames.size
        self._scores = Latest(max(2, SCORE_BYTES // (2 * width * height * len(self._words))))
        self._regions, self._looks = Regions(geometry), Looks(frames.size, frames.device)
        asked = targets.labelled_frames
        voters = [asked[i] for i in np.unique(np.linspace(0, len(asked) - 1, min(len(asked), MOST_VOTERS)).round().astype(int))]
        random, shares = torch.Generator().manual_seed(seed), self._told
        for done in range(ROUNDS):

            def tell(f: float, done: int = done) -> None:
                progress((done + f) / ROUNDS, "comparing what the teacher says over time")

            contested, pixels = self._round(voters, shares, geometry, random, tell)
            number, otherwise, around = torch.stack(list(self._each(self._beside_teacher, voters))).sum(0).tolist()
            self._settled = done == 0 and otherwise <= SETTLED * number
            if self._settled:
                break
            shares = self.shares
        targets.accuracy = accuracy_of(contested, pixels)
        targets.disagreement, self._around_right = otherwise / max(number, 1), max(around / max(number, 1) / targets.accuracy, 1e-3)

    def _round(
        self,
        voters: list[int],
        shares: Callable[[int], Tensor],
        geometry: FinishedGeometry,
        random: torch.Generator,
        progress: Callable[[float], None],
    ) -> tuple[Tensor, int]:
        """Let frames vote with their `shares`, fit the look of words to them, let regions vote with both; `_contested` of all frames."""
        votes, seen, called = Votes(geometry), [], []
        for i, (frame, looks) in enumerate(zip(voters, made_ahead(self._seen, voters), strict=True)):
            progress(i / len(voters))
            known = self._told(frame).sum(1) > 0
            found = shares(frame) * known[:, None]
            votes.add(frame, found)
            known = torch.nonzero(known)[:, 0]
            rows = known[torch.randperm(len(known), generator=random)[: PIXELS // len(voters)].to(known.device)]
            seen.append(looks[rows])
            called.append(found[rows])
        self._votes, self._usual = votes, torch.cat(called).mean(0).clamp_min(1e-4)
        self._appearance = Appearance(torch.cat(seen), torch.cat(called), random.initial_seed())
        self._scores = Latest(self._scores.limit)
        counts, labelled = zip(*self._each(self._contested, voters), strict=True)
        contested, pixels = torch.stack(counts).sum(0), sum(labelled)
        self._own, self._reach = own_weight(contested), NEAR + float(contested[3] - contested[0]) / max(pixels, 1)
        self._regions.clear()
        for frame, sums in zip(voters, self._each(self._of_regions, voters), strict=True):
            self._regions.add(frame, sums)
        return contested, pixels

    def _each(self, work: Callable[[int], Made], frames: list[int]) -> Iterable[Made]:
        """What is made of each frame, in order; on a CPU each of its threads takes other frames."""
        return map(work, frames) if self._frames.device.type == "cuda" else made_ahead(work, frames, min(AT_ONCE, kernel_threads()))

    def _seen(self, frame: int) -> Tensor:
        """The looks of a frame; its regions are found too."""
        self._regions.of(frame)
        return self._looks(self._frames.image(frame))

    def shares(self, frame: int) -> Float[Tensor, "pixels words"]:
        """q of each pixel of a frame, rows of sum 1."""
        around = (self._regions.read(frame, self._reach) + AROUND).log()
        return torch.softmax(self._before_regions(frame, self._told(frame)) + 2 * around / (1 + math.exp(self._own)), 1)

    def _of_regions(self, frame: int) -> Tensor:
        """What the regions of a frame are called before others are asked, by their pixels that the teacher names: float [regions, K]."""
        told = self._told(frame)
        return self._regions.sums(frame, torch.softmax(self._before_regions(frame, told), 1) * (told.sum(1, keepdim=True) > 0))

    def _before_regions(self, frame: int, told: Tensor) -> Tensor:
        """log q₀, but for a constant: float [H × W, K]."""
        return self._scores.get(frame, lambda: self._score(*self._raters(frame))).float() + self._own * told

    def answer(self, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The teacher's words float32 [K, D]; which is the likeliest at each pixel of a frame, int32 [H, W], −1 where the teacher says
        nothing; and its q, float32 [H, W]. Of a teacher that is taken at its word both are its own: its shares of words in place of q."""
        told = self._told(frame)
        sure, named = (told if self._settled else self.shares(frame)).max(1)
        width, height = self._frames.size
        named[told.sum(1) == 0] = -1
        index, confidence = (values.reshape(height, width).cpu().numpy() for values in (named.int(), sure))
        return self._words, index, confidence

    def rightness(self, frame: int) -> Float[Tensor, "pixels words"]:
        """How often words are right, where the teacher says anything; of single pixels a rough estimate, which may be above 1:

            (1 − e) [word is the teacher's] / p + e p(word | regions around) / p_around

        with the accuracies p of both; the regions give the teacher's word a share of p p_around in the mean. What the teacher says of this
        frame is part of what the scene learned: the oftener it errs where not all agree (e), the less it proves.
        """
        own = torch.nn.functional.one_hot(self._told(frame).argmax(1), len(self._words)) / self._targets.accuracy
        return own.lerp(self._regions.read(frame, self._reach) / self._around_right, 1 / (1 + math.exp(self._own)))

    def _beside_teacher(self, frame: int) -> Tensor:
        """Of the pixels of a frame where the teacher says something: how many there are, in how many the consensus differs, and the sum of
        the shares of the teacher's word around; float64 [3]."""
        told = self._told(frame)
        word, known = told.argmax(1, keepdim=True), told.sum(1, keepdim=True) > 0
        otherwise = known & (word != self.shares(frame).argmax(1, keepdim=True))
        around = self._regions.read(frame, self._reach).gather(1, word) * known
        return torch.stack([values.sum(dtype=torch.float64) for values in (known, otherwise, around)])

    def _told(self, frame: int) -> Tensor:
        """What the teacher calls each pixel of one of its frames, in shares of its words: float [H × W, K], rows of sum 1, or 0 where it
        says nothing."""
        answer = self._targets.answer(frame)
        assert answer is not None
        parts, index = (torch.from_numpy(values).to(self._frames.device) for values in (shares_of(answer[0], self._words), answer[1]))
        return torch.cat([parts, torch.zeros_like(parts[:1])])[index.flatten().long()]  # −1, nothing, is the last

    def _raters(self, frame: int) -> tuple[Tensor, Tensor]:
        """log p(word | votes of the other frames) and log p(word | look) of each pixel of a frame."""
        return self._votes.read(frame).log(), self._appearance(self._looks(self._frames.image(frame)))

    def _score(self, votes: Tensor, looks: Tensor) -> Tensor:
        return (votes + looks - self._usual.log() / 2).half()

    def _contested(self, frame: int) -> tuple[Tensor, int]:
        """Of how many pixels of a frame the teacher alone, the votes alone, the looks alone say something else than both others, and of how
        many not all three say the same, int64 [4]; and how many the teacher labels."""
        own, raters = self._told(frame), self._raters(frame)
        self._scores.keep(frame, self._score(*raters))
        teacher, votes, looks = (values[own.sum(1) > 0].argmax(1) for values in (own, *raters))
        alone = [(votes == looks) & (teacher != votes), (teacher == looks) & (votes != looks), (teacher == votes) & (looks != votes)]
        return torch.stack([*alone, ~((teacher == votes) & (votes == looks))]).sum(1), len(teacher)


def agreed_answers(consensus: Consensus, targets: SemanticTargets) -> dict[str, Tensor]:
    """All answers of a consensus as tensors, for a checkpoint: `words` [K, D], `index` int8 and `sure` float16 [T, H, W] of
    the teacher's frames, its `disagreement` and its `accuracy`."""
    words, index, sure = zip(*(consensus.answer(frame) for frame in targets.labelled_frames), strict=True)
    stacked = (torch.from_numpy(np.stack(values).astype(kind)) for values, kind in ((index, np.int8), (sure, np.float16)))
    tensors = torch.from_numpy(words[0]), *stacked, torch.tensor(targets.disagreement), torch.tensor(targets.accuracy)
    return dict(zip(("words", "index", "sure", "disagreement", "accuracy"), tensors, strict=True))


def answers_of(agreed: Mapping[str, Tensor], frames: Sequence[int]) -> Callable[[int], SureAnswer]:
    """The inverse of `agreed_answers`."""
    words, index, sure = (agreed[name].cpu().numpy() for name in ("words", "index", "sure"))
    return lambda frame: (words, index[(k := frames.index(frame))].astype(np.int32), sure[k].astype(np.float32))


def accuracy_of(contested: Int[Tensor, " raters"], pixels: int) -> float:
    """How often the teacher is right in a frame, in (0, 1], of so many pixels that it labels.

    Raters that err independently agree as often as both are right, A_ij ≈ p_i p_j, since mistakes seldom are the same (Dawid & Skene 1979).
    Of three,  p_teacher = √(A_teacher,votes A_teacher,looks / A_votes,looks).
    """
    teacher, votes, looks, none = contested.tolist()
    with_votes, with_looks, others = (max(pixels - none + alone, 1) / max(pixels, 1) for alone in (looks, votes, teacher))
    return min(math.sqrt(with_votes * with_looks / others), 1.0)


def own_weight(contested: Int[Tensor, " raters"]) -> float:
    """Log odds, at least 0, that the teacher is right in a frame where not all agree: λ of `Consensus`.

    Of three that err independently (Dawid & Skene 1979), the two others are alone together as often as both err at once. What the teacher
    stands alone beyond that, it errs:  e = n_teacher − n_votes n_looks,  λ = log((1 − e) / e),  with shares n of the contested pixels.
    """
    teacher, votes, looks, _ = (contested / contested[3].clamp_min(1)).tolist()
    error = min(max(teacher - votes * looks, 1e-4), 0.5)
    return math.log((1 - error) / error)
