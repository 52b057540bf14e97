"""Appearance of each class: a Gaussian over the features of its regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

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
