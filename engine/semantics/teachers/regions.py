"""A frame as a graph of superpixels, on which known classes spread to regions of similar appearance.

A random walk with restarts (Grady, "Random walks for image segmentation", PAMI 2006, with the prior model of CVPR 2005): the class
probabilities x of all regions minimise Σ_ij w_ij (x_i − x_j)² + Σ_i t_i (x_i − p_i)² + γ Σ_i (x_i − q_i)², where w_ij is small across an
edge of the frame, p_i are the known probabilities of region i with weight t_i, and q_i those that its appearance suggests: a Gaussian for
each class over the features of its regions.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu
from scipy.special import softmax

from degense.engine.semantics.masks.superpixels import superpixels

REGIONS = 6400  # about so many, whatever the size of the frame
COLOUR_STEP = 3.0  # CIELAB difference between neighbours that divides the weight of their edge by e
LIKENESS_STEP = 0.5  # the same for the difference of their likenesses, half the L1 distance
PULL = 0.003  # γ
BLURS = (1 / 210, 1 / 85, 1 / 35)  # scales of the features, fractions of the width
FINEST = 1e-6  # least weight of an edge, so that every region has a solution


class Regions:
    """Superpixels of one frame uint8 [H, W, 3], their features and their neighbours; regions mostly outside of `valid` have none."""

    def __init__(self, rgb: np.ndarray, valid: np.ndarray):
        height, width = rgb.shape[:2]
        side = max(3, round((height * width / REGIONS) ** 0.5))
        self.of = superpixels(rgb, side)  # int32 [H, W]; region of each pixel
        self.sizes = np.bincount(self.of.ravel()).astype(np.float64)
        self.inside = self.share(valid) > 0.5  # bool [n]
        lab = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
        self.colours = self.mean(lab)
        #: float32 [n, F]; means of colour (CIELAB) as it is and blurred, and of its local deviation; nothing about the place.
        self.features = np.concatenate([self.colours, *(self.mean(picture) for picture in _surroundings(lab))], 1)
        self._pairs, border = _neighbours(self.of, self.inside)
        self._lengths = border / side

    def __len__(self) -> int:
        return len(self.sizes)

    def mean(self, picture: np.ndarray) -> np.ndarray:
        """Mean over each region of a picture [H, W, C], float32 [n, C]."""
        sums = [np.bincount(self.of.ravel(), channel.ravel(), len(self)) for channel in np.moveaxis(picture, -1, 0)]
        return (np.stack(sums, 1) / self.sizes[:, None]).astype(np.float32)

    def share(self, mask: np.ndarray) -> np.ndarray:
        """Share of each region that lies in a mask bool [H, W], float64 [n]."""
        return np.bincount(self.of.ravel(), mask.ravel(), len(self)) / self.sizes

    def walk(self, likeness: np.ndarray, known: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Class probabilities of each region, float64 [n, k], rows of sum 1, as are those by its appearance, `likeness` [n, k].

        The `known` ones [n, k] are read where `weight` [n] is positive.
        """
        a, b = self._pairs.T
        unlike = np.linalg.norm(self.colours[a] - self.colours[b], axis=1) / COLOUR_STEP
        unlike += np.abs(likeness[a] - likeness[b]).sum(1) / 2 / LIKENESS_STEP
        edges = coo_matrix((self._lengths * np.exp(-unlike) + FINEST, (a, b)), (len(self), len(self))).tocsr()
        edges = edges + edges.T
        laplacian = diags(np.asarray(edges.sum(1)).ravel() + PULL + weight) - edges
        found = splu(laplacian.tocsc()).solve(PULL * likeness + weight[:, None] * known)
        found = np.maximum(found, 0)
        return found / np.maximum(found.sum(1, keepdims=True), 1e-12)


def _surroundings(lab: np.ndarray) -> list[np.ndarray]:
    """Blurred colour at each scale, and the local deviation of colour at all but the coarsest; float32 [H, W, 3] each."""
    height, width = lab.shape[:2]
    out = []
    for place, blur in enumerate(BLURS):
        sigma = blur * width
        shrink = max(1, int(sigma / 2))  # a wide blur needs no full resolution
        small = cv2.resize(lab, (max(1, width // shrink), max(1, height // shrink)), interpolation=cv2.INTER_AREA)
        mean = cv2.GaussianBlur(small, (0, 0), sigma / shrink)
        out.append(cv2.resize(mean, (width, height)))
        if place < len(BLURS) - 1:
            square = cv2.GaussianBlur(cv2.resize(lab * lab, small.shape[1::-1], interpolation=cv2.INTER_AREA), (0, 0), sigma / shrink)
            out.append(cv2.resize(np.sqrt(np.maximum(square - mean * mean, 0)), (width, height)))
    return out


def _neighbours(of: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of regions that touch, int64 [e, 2], and the length of their border in pixels, float64 [e]."""
    touching = [(here[here != there], there[here != there]) for here, there in ((of[:, :-1], of[:, 1:]), (of[:-1], of[1:]))]
    pairs = np.sort(np.concatenate([np.stack(sides, 1) for sides in touching]).astype(np.int64), axis=1)
    pairs = pairs[inside[pairs].all(1)]
    codes, lengths = np.unique(pairs[:, 0] * len(inside) + pairs[:, 1], return_counts=True)
    return np.stack([codes // len(inside), codes % len(inside)], 1), lengths.astype(np.float64)


SHARED = 0.2  # of each class's covariance that is the mean of all classes'
ROUND = 0.1  # of the shared covariance that is a ball, and a fifth of it again for each class
COOL = 2.0  # the features are not independent: log-likelihoods are divided by this


@dataclass(frozen=True)
class Appearance:
    """Class-conditional Gaussians in standardised features."""

    centre: np.ndarray  # float64 [F]; of the standardisation
    scale: np.ndarray  # float64 [F]; of the standardisation
    means: np.ndarray  # float64 [k, F]
    inverses: np.ndarray  # float64 [k, F, F]; of the covariances
    constants: np.ndarray  # float64 [k]; −½ log det of the covariances

    @classmethod
    def fit(cls, features: np.ndarray, weights: np.ndarray) -> Appearance:
        """From features [n, F] and how much each row belongs to each class [n, k]; every class needs some weight."""
        weighted = weights.sum(1) > 0
        features, weights = features[weighted].astype(np.float64), weights[weighted]
        centre, scale = features.mean(0), features.std(0) + 1e-6
        z = (features - centre) / scale
        total = np.maximum(weights.sum(0), 1e-9)
        means = weights.T @ z / total[:, None]
        own = np.stack([(w[:, None] * (z - m)).T @ (z - m) / t for w, m, t in zip(weights.T, means, total, strict=True)])
        shared, ball = own.mean(0), np.eye(z.shape[1])
        shared = (1 - ROUND) * shared + ROUND * np.trace(shared) / len(shared) * ball
        covariances = SHARED * shared + (1 - SHARED) * own + ROUND / 5 * (np.trace(shared) / len(shared) + 1e-6) * ball
        return cls(centre, scale, means, np.linalg.inv(covariances), -0.5 * np.linalg.slogdet(covariances)[1])

    def likeness(self, features: np.ndarray) -> np.ndarray:
        """Probability of each class given the features [n, F] alone, float64 [n, k]; all classes count as equally frequent."""
        z = (features - self.centre) / self.scale
        logs = []
        for mean, inverse, constant in zip(self.means, self.inverses, self.constants, strict=True):
            away = z - mean
            logs.append(-0.5 * np.einsum("nf,nf->n", away @ inverse, away) + constant)
        return softmax(np.stack(logs, 1) / COOL, axis=1)
