"""The signed fold angle: its sign, its derivatives, and the discrete gradient that conserves energy
and torque."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.core.algebra import dihedral_angle
from gossamer_fx.core.algebra.dihedral_angle import Array


def panels(θ: float) -> Array:
    """t, p, m (3, 3) of a fold of angle θ between panels whose normal is z while they are flat."""
    return np.array(
        [[0.0, 1, 0], [-np.cos(θ / 2), 0, np.sin(θ / 2)], [np.cos(θ / 2), 0, np.sin(θ / 2)]]
    )


def steps(largest: float, n: int = 300) -> tuple[Array, Array, Array, Array]:
    """X0, X1 (n, 3, 3) at random, the angle of X0, and that of X1 within half a turn of it."""
    random = np.random.default_rng(0)
    X0 = random.normal(size=(n, 3, 3))
    X1 = X0 + largest * random.uniform(size=(n, 1, 1)) * random.normal(size=(n, 3, 3))
    return (
        X0,
        X1,
        dihedral_angle.angle(X0),
        near(dihedral_angle.angle(X0), dihedral_angle.angle(X1)),
    )


def near(θ0: Array, θ: Array) -> Array:
    return θ0 + np.remainder(θ - θ0 + np.pi, 2 * np.pi) - np.pi


@pytest.mark.parametrize("θ", [-3.0, -1.0, 0.0, 0.4, 2.0, 3.1])
def test_panels_that_rise_to_the_normal_have_a_positive_angle(θ: float) -> None:
    assert dihedral_angle.angle(panels(θ)) == pytest.approx(θ)


def test_vectors_along_the_fold_do_not_change_its_angle() -> None:
    """The angle is that between the planes of the panels, however these are sheared and
    stretched."""
    X = panels(0.7)
    sheared = np.array([[2.0, 0, 0], [0.3, 1.5, 0], [-0.8, 0, 0.6]]) @ X
    assert dihedral_angle.angle(sheared) == pytest.approx(0.7)


def test_gradient() -> None:
    X, _, θ, _ = steps(0.0)
    D = np.random.default_rng(1).normal(size=X.shape)
    change = (
        near(0 * θ, dihedral_angle.angle(X + 1e-6 * D) - dihedral_angle.angle(X - 1e-6 * D)) / 2e-6
    )
    slope = np.einsum("nij,nij->n", dihedral_angle.gradient(X), D)
    np.testing.assert_allclose(slope, change, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("largest", [1e-9, 1e-3, 0.3, 2.0])
def test_the_discrete_gradient_gives_the_change_of_angle_and_no_torque(largest: float) -> None:
    X0, X1, θ0, θ1 = steps(largest)
    G = dihedral_angle.discrete_gradient(X0, X1, θ0, θ1)
    np.testing.assert_allclose(np.einsum("nij,nij->n", G, X1 - X0), θ1 - θ0, rtol=0, atol=1e-12)
    torque = np.cross((X0 + X1) / 2, G).sum(axis=1)
    assert np.abs(torque).max() < 1e-12 * max(1.0, float(np.abs(G).max()))


def test_it_is_the_gradient_where_nothing_moves() -> None:
    X, _, θ, _ = steps(0.0)
    np.testing.assert_allclose(
        dihedral_angle.discrete_gradient(X, X, θ, θ),
        dihedral_angle.gradient(X),
        rtol=1e-10,
        atol=1e-10,
    )


def test_a_fold_that_turns_beyond_half_a_turn_in_a_step() -> None:
    X0 = panels(-1.9)
    X1 = panels(1.9)
    G = dihedral_angle.discrete_gradient(X0, X1, np.array(-1.9), np.array(1.9))
    assert np.sum(G * (X1 - X0)) == pytest.approx(3.8, rel=1e-12)


@pytest.mark.parametrize("largest", [1e-3, 0.5, 2.0])
def test_derivative_of_the_discrete_gradient(largest: float) -> None:
    X0, X1, θ0, θ1 = steps(largest)
    D = np.random.default_rng(2).normal(size=X1.shape)

    def at(s: float) -> Array:
        X = X1 + s * D
        return np.asarray(
            dihedral_angle.discrete_gradient(X0, X, θ0, near(θ1, dihedral_angle.angle(X)))
        )

    expected = (at(1e-6) - at(-1e-6)) / 2e-6
    found = np.einsum(
        "nijkl,nkl->nij", dihedral_angle.discrete_gradient_derivative(X0, X1, θ0, θ1), D
    )
    error = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    assert np.median(error) < 1e-8
    assert (
        error.max() < 1e-4
    )  # differences are what is not exact where two vectors are nearly parallel


def test_second_derivative() -> None:
    X, _, _, _ = steps(0.0)
    D = np.random.default_rng(3).normal(size=X.shape)
    expected = (
        dihedral_angle.gradient(X + 1e-6 * D) - dihedral_angle.gradient(X - 1e-6 * D)
    ) / 2e-6
    found = np.einsum("nijkl,nkl->nij", dihedral_angle.gradient_derivative(X), D)
    error = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    assert np.median(error) < 1e-8
    assert error.max() < 1e-4
