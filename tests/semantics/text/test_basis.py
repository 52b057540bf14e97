"""The latent basis keeps angles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from degense.engine.semantics.basis import LEAST_KEPT, Basis, fit_basis
from degense.engine.semantics.text.encoder import EmbeddedEncoder

CLASSES = ["liver", "gallbladder", "fat", "grasper", "L-hook electrocautery", "background"]


def unit(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def angular_error(basis, vectors):
    """The bound that `Basis` states, radians, of non-zero vectors [n, D]."""
    vectors, matrix = vectors.astype(float), basis.matrix.astype(float)
    outside = np.linalg.norm(vectors - vectors @ matrix @ matrix.T, axis=1)
    return np.arcsin(np.clip(outside / np.linalg.norm(vectors, axis=1), 0.0, 1.0))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40), dimension=st.integers(1, 48), energy=st.floats(0.3, 1.0), rank=st.integers(1, 48)
)
def test_cosines_of_latents_stay_within_the_bound(seed, n, dimension, energy, rank):
    rng = np.random.default_rng(seed)
    features = unit(rng.normal(size=(n, dimension)) * np.geomspace(1, 0.01, dimension))
    basis = fit_basis(features, rng.uniform(0.1, 1, n), energy, rank)
    np.testing.assert_allclose(basis.matrix.T @ basis.matrix, np.eye(basis.rank), atol=1e-5)
    queries = unit(rng.normal(size=(8, dimension)))
    latents, projected = basis.project(features), basis.project(queries)
    cosine = latents @ projected.T / np.maximum(np.linalg.norm(latents, axis=1, keepdims=True), 1e-12)
    bent = np.abs(np.arccos(np.clip(cosine, -1, 1)) - np.arccos(np.clip(features @ queries.T, -1, 1)))
    bound = angular_error(basis, features)[:, None]
    sound = np.linalg.norm(latents, axis=1) > 1e-4
    assert (bent[sound] <= np.broadcast_to(bound, bent.shape)[sound] + 2e-3).all()


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 30), energy=st.floats(0.5, 1.0))
def test_rank_is_the_smallest_that_keeps_enough(seed, n, energy):
    rng = np.random.default_rng(seed)
    features = unit(rng.normal(size=(n, 20)) * np.geomspace(1, 0.05, 20))
    weights = rng.uniform(0.01, 1, n)
    basis = fit_basis(features, weights, energy, max_rank=20)
    # oracle: singular values of the weighted matrix
    _, singular, right = np.linalg.svd(np.sqrt(weights / weights.sum())[:, None] * features, full_matrices=True)
    share = np.cumsum(np.pad(singular**2, (0, 20 - len(singular)))) / (singular**2).sum()

    def enough(rank):
        own = ((features @ right[:rank].T) ** 2).sum(1)
        return share[rank - 1] >= energy - 1e-9 and own.min() >= LEAST_KEPT - 1e-9

    assert basis.energy == pytest.approx(share[basis.rank - 1], abs=1e-6)
    assert enough(basis.rank)
    assert basis.rank == 1 or not enough(basis.rank - 1)


def test_a_rare_class_is_not_dropped():
    vectors = EmbeddedEncoder(CLASSES).encode(CLASSES)
    basis = fit_basis(vectors, np.array([1e6, 1e6, 1e6, 1e6, 3, 1e6]))
    assert angular_error(basis, vectors).max() < 0.33
    assert np.linalg.norm(basis.project(vectors[4])) > 0.94


def test_zero_weights_do_not_count():
    vectors = EmbeddedEncoder(CLASSES).encode(CLASSES)
    assert fit_basis(vectors, np.array([1, 1, 0, 0, 0, 0])).rank == 2


def test_absent_words_have_no_similarity():
    encoder = EmbeddedEncoder(CLASSES)
    basis = fit_basis(encoder.encode(CLASSES), np.ones(len(CLASSES)))
    latents = basis.project(encoder.encode(CLASSES))
    stranger = basis.project(encoder.encode(["smoke"]))[0]
    assert np.abs(latents @ stranger).max() < 1e-5


def test_lift_inverts_project_inside_the_subspace():
    encoder = EmbeddedEncoder(CLASSES)
    vectors = encoder.encode(CLASSES)
    basis = fit_basis(vectors, np.ones(len(CLASSES)), energy=1.0)
    np.testing.assert_allclose(basis.project(vectors) @ basis.matrix.T, vectors, atol=1e-5)


def test_arrays_round_trip_and_are_checked():
    basis = fit_basis(np.random.default_rng(0).normal(size=(9, 7)), np.ones(9), 0.9, 4)
    again = Basis.from_arrays(basis.arrays())
    np.testing.assert_array_equal(again.matrix, basis.matrix)
    assert again.energy == pytest.approx(basis.energy)
    with pytest.raises(ValueError, match="orthonormal"):
        Basis.from_arrays({"matrix": 2 * basis.matrix, "energy": np.ones(1)})
    with pytest.raises(ValueError, match="no basis"):
        Basis.from_arrays({"matrix": basis.matrix.T, "energy": np.ones(1)})


@pytest.mark.parametrize(
    ("vectors", "weights"),
    [(np.ones(3), np.ones(3)), (np.ones((2, 3)), np.ones(3)), (np.full((2, 3), np.nan), np.ones(2)),
     (np.ones((2, 3)), -np.ones(2)), (np.zeros((2, 3)), np.ones(2))],
)  # fmt: skip
def test_nonsense_is_refused(vectors, weights):
    with pytest.raises(ValueError, match=r"must be|finite|no vector"):
        fit_basis(vectors, weights)


def test_project_refuses_another_space():
    basis = fit_basis(np.eye(4), np.ones(4))
    with pytest.raises(ValueError, match="length 4, not 5"):
        basis.project(np.ones(5))
