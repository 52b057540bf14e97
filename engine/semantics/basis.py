"""The latent space: a linear projection from D to d dimensions that preserves angles, and unit vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

LEAST = 1e-12  # a shorter vector has no direction and stays about zero
#: Least share of its squared length that the basis retains of every vector, whatever its weight: a needle covers few pixels.
LEAST_KEPT = 0.9


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., D] at unit length, of the same float type; those of no length stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), LEAST)


@dataclass(frozen=True)
class Basis:
    """An orthonormal basis B of the subspace that the features of a scene span.

    A latent is z = Bᵀf. Then ⟨z, Bᵀv⟩ / (‖z‖‖v‖) is the cosine of Bz with the text vector v.
    It differs from the true cosine of f and v by an angle of at most

        |∠(Bz, v) − ∠(f, v)| ≤ ∠(Bz, f) = arcsin √(1 − ‖Bᵀf‖² / ‖f‖²)

    (triangle inequality on the sphere), whatever v is.
    ‖v‖ is the length before projection: texts unlike anything in the scene have a cosine near 0.
    """

    matrix: Float32[np.ndarray, "D d"]  # B, orthonormal columns, the strongest direction first
    energy: float  # weighted share of the squared lengths that the subspace holds, in [0, 1]

    @property
    def dimension(self) -> int:
        """D."""
        return self.matrix.shape[0]

    @property
    def rank(self) -> int:
        """d."""
        return self.matrix.shape[1]

    def project(self, vectors: Float[np.ndarray, "*batch D"]) -> Float32[np.ndarray, "*batch d"]:
        """Bᵀv, float32 [..., d], of vectors [..., D]. ValueError when D is not this basis's."""
        vectors = np.asarray(vectors, np.float32)
        if vectors.shape[-1] != self.dimension:
            raise ValueError(f"this basis takes vectors of length {self.dimension}, not {vectors.shape[-1]}")
        return vectors @ self.matrix

    def arrays(self) -> dict[str, np.ndarray]:
        """`matrix` and `energy`, as they are saved."""
        return {"matrix": self.matrix, "energy": np.array([self.energy], np.float32)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> Basis:
        """The inverse of `arrays`. ValueError when the arrays are no orthonormal basis."""
        matrix, energy = np.asarray(arrays["matrix"], np.float32), np.asarray(arrays["energy"], np.float32)
        if matrix.ndim != 2 or not 1 <= matrix.shape[1] <= matrix.shape[0] or energy.shape != (1,):
            raise ValueError(f"no basis: matrix {matrix.shape}, energy {energy.shape}")
        if not np.allclose(matrix.T @ matrix, np.eye(matrix.shape[1]), atol=1e-3):
            raise ValueError("no basis: its columns are not orthonormal")
        return cls(matrix, float(energy[0]))


def fit_basis(
    vectors: np.ndarray, weights: np.ndarray, energy: float = 0.999, max_rank: int = 32, anchors: np.ndarray | None = None
) -> Basis:
    """Truncated singular value decomposition of weighted feature vectors, not centred: the origin stays where angles are measured from.

    The basis has the smallest rank that keeps `energy` (in (0, 1], a weighted share of the squared lengths) of all and `LEAST_KEPT` of
    every vector with a weight above 0, up to `max_rank`. Vectors float [n, D] are of unit length for the bound in `Basis`; weights
    float [n] say how much each matters, e.g. its number of pixels.

    `anchors` float [m, D] are vectors of prompts, for vectors that are noisy. Then not every vector is retained: directions no stronger
    than noise are left out (singular values below ω(β) times their median, Gavish & Donoho 2014, for noise of unknown strength), as long as
    the anchors retain `LEAST_KEPT` of what all directions hold of them. ValueError if shapes disagree, a number is not finite, a weight is
    negative, or nothing has weight and length.
    """
    vectors, weights = np.asarray(vectors, np.float64), np.asarray(weights, np.float64)
    if vectors.ndim != 2 or weights.shape != vectors.shape[:1]:
        raise ValueError(f"vectors must be [n, D] and weights [n], not {vectors.shape} and {weights.shape}")
    if not (np.isfinite(vectors).all() and np.isfinite(weights).all() and (weights >= 0).all()):
        raise ValueError("vectors and weights must be finite, and no weight negative")
    if not 0.0 < energy <= 1.0 or max_rank < 1:
        raise ValueError(f"energy must lie in (0, 1] and max_rank be at least 1, not {energy} and {max_rank}")
    counted = (weights > 0) & (np.linalg.norm(vectors, axis=1) > 0)
    if not counted.any():
        raise ValueError("no vector has both weight and length")
    vectors, weights = vectors[counted], weights[counted] / weights[counted].sum()
    # eigenvectors of the D × D second moment: the right singular vectors of √w·V, at a cost that does not grow with n beyond one product
    values, directions = np.linalg.eigh((vectors * weights[:, None]).T @ vectors)
    values, directions = np.maximum(values[::-1], 0.0), directions[:, ::-1]
    kept = np.cumsum(values) / values.sum()
    own = np.cumsum(((vectors if anchors is None else anchors) @ directions) ** 2, axis=1)
    own = own[own[:, -1] > 1e-12]
    enough = kept >= energy - 1e-12
    if anchors is not None:
        enough |= np.arange(1, len(values) + 1) >= _above_noise(values, len(vectors))
    enough &= (own >= LEAST_KEPT * own[:, -1:]).all(0)
    rank = min(int(np.argmax(enough)) + 1, max_rank)
    matrix = directions[:, :rank]
    # an eigenvector has no sign of its own: the largest entry is made positive so that runs compare
    matrix = matrix * np.sign(matrix[np.abs(matrix).argmax(0), np.arange(rank)])
    return Basis(matrix.astype(np.float32), float(min(kept[rank - 1], 1.0)))


def _above_noise(values: np.ndarray, count: int) -> int:
    """How many eigenvalues (descending, of the second moment of `count` vectors) are more than noise."""
    beta = min(len(values), count) / max(len(values), count)
    factor = 0.56 * beta**3 - 0.95 * beta**2 + 1.82 * beta + 1.43
    strengths = np.sqrt(values[: min(len(values), count)])
    return max(1, int(np.count_nonzero(strengths > factor * np.median(strengths))))
