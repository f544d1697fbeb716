"""The signed angle of a fold, and its discrete gradient, which conserves energy and angular momentum.

At a point of a fold X (3, 3) holds three vectors: t along it, p and m into the panels on its left and right.  With

    C = (t·p)(t·m) - (t·t)(p·m),    S = |t| J,    J = t·(p × m)

the angle of the fold is θ = atan2(S, C): zero when the panels continue each other, positive when they have turned
towards t × p, the normal of the left one.

Over a step X0, X1 with means X̄ the gradient of every product is built by the product rule, Δ(ab) = ā Δb + b̄ Δa, from
the dot products and √(t·t), which are exact with the vectors X̄ and exert no torque.  The triple product is cubic.  With
the change ΔX = R + P, R = ω × X̄ the rotation about X̄ that fits it best, its gradient is

    G_J = ∇J(X̄) + 𝒫 (¼ R×R + ⅛ (R×P + P×R) + 1/12 P×P),    X×Y: (p × m', m × t', t × p') of the rows of X and Y

where 𝒫 takes rotations about X̄ away.  It is smooth, G_J·ΔX = ΔJ, and it exerts no torque.  At last

    G = Δθ/((ρ0 + ρ1) sin ½Δθ) (cos θm G_S - sin θm G_C),    θm = ½(θ0 + θ1),  ρ = √(C² + S²)

has G·ΔX = Δθ and Σ X̄×G = 0 exactly, for changes of angle up to a whole turn.

All arrays are (..., 3, 3) with the vectors as rows; all functions but `angle` are analytic, for complex steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[Any]  # real or complex
Array = npt.NDArray[np.floating]

STEP = 1e-30  # of the complex step: no difference is taken, so that it may be as small as it likes


def angle(X: Array) -> Array:
    """θ (...) in [-π, π]."""
    C, S = _cosine_and_sine(X)
    result: Array = np.arctan2(S, C)
    return result


def gradient(X: Numbers) -> Numbers:
    """∂θ/∂X (..., 3, 3)."""
    C, S = _cosine_and_sine(X)
    t, p, m = _rows(X)
    σ, a, b, d = _dot(t, t), _dot(t, p), _dot(t, m), _dot(p, m)
    gC = np.stack(
        [_v(a) * m + _v(b) * p - 2 * _v(d) * t, _v(b) * t - _v(σ) * m, _v(a) * t - _v(σ) * p],
        axis=-2,
    )
    length = np.sqrt(σ)
    gS = _v(_v(length)) * _cross_pairs(X, X)
    gS[..., 0, :] += _v(_dot(t, _cross(p, m)) / length) * t
    return (_v(_v(C)) * gS - _v(_v(S)) * gC) / _v(_v(C * C + S * S))


def discrete_gradient(X0: Array, X1: Numbers, θ0: Array, θ1: Numbers) -> Numbers:
    """G (..., 3, 3) of a step: G·(X1 - X0) = θ1 - θ0 and Σ X_mid×G = 0; at X1 = X0 the gradient.

    θ0 and θ1 are angles of X0 and X1, on any branch, less than a turn apart.
    """
    X_mid, Δ = (X0 + X1) / 2, X1 - X0
    t, p, m = _rows(X_mid)
    ends = [(*_products(X), *_cosine_and_sine(X)) for X in (X0, X1)]
    σ, a, b, d, J, length = (
        (before + after) / 2 for before, after in zip(*(e[:6] for e in ends), strict=True)
    )
    gC = np.stack(
        [_v(a) * m + _v(b) * p - 2 * _v(d) * t, _v(b) * t - _v(σ) * m, _v(a) * t - _v(σ) * p],
        axis=-2,
    )
    P = _without_rotation(X_mid, Δ)
    R = Δ - P
    rest = (
        _cross_pairs(R, R) / 4
        + (_cross_pairs(R, P) + _cross_pairs(P, R)) / 8
        + _cross_pairs(P, P) / 12
    )
    gS = _v(_v(length)) * (_cross_pairs(X_mid, X_mid) + _without_rotation(X_mid, rest))
    gS[..., 0, :] += _v(J / length) * t
    (C0, S0), (C1, S1) = (e[6:] for e in ends)
    half, θm = (θ1 - θ0) / 2, (θ0 + θ1) / 2
    small = np.abs(half) < 1e-3
    safe = np.where(small, 1.0, half)
    ratio = np.where(small, 1 + half**2 / 6 + 7 * half**4 / 360, safe / np.sin(safe))
    ratio = 2 * ratio / (np.sqrt(C0 * C0 + S0 * S0) + np.sqrt(C1 * C1 + S1 * S1))
    return _v(_v(ratio * np.cos(θm))) * gS - _v(_v(ratio * np.sin(θm))) * gC


def discrete_gradient_derivative(X0: Array, X1: Array, θ0: Array, θ1: Array) -> Array:
    """∂G/∂X1 (n, 3, 3, 3, 3) of arrays over n points, by complex steps, exact to round-off."""
    X, θ = _stepped(X1), _v(θ1).T + 1j * STEP * gradient(X1).reshape(-1, 9).T
    return _derivative(discrete_gradient(X0, X, θ0, θ))


def gradient_derivative(X: Array) -> Array:
    """∂²θ/∂X² (n, 3, 3, 3, 3) of arrays over n points, by complex steps, exact to round-off."""
    return _derivative(gradient(_stepped(X)))


def _stepped(X: Array) -> Numbers:
    """(9, n, 3, 3): a complex step in each of the nine components."""
    return X + 1j * STEP * np.eye(9).reshape(9, 1, 3, 3)


def _derivative(G: Numbers) -> Array:
    """(n, 3, 3, 3, 3) of the stepped values (9, n, 3, 3)."""
    result: Array = np.moveaxis(G.imag / STEP, 0, -1).reshape(*G.shape[1:], 3, 3)
    return result


def _products(X: Numbers) -> tuple[Numbers, ...]:
    """t·t, t·p, t·m, p·m, J and |t|."""
    t, p, m = _rows(X)
    σ = _dot(t, t)
    return σ, _dot(t, p), _dot(t, m), _dot(p, m), _dot(t, _cross(p, m)), np.sqrt(σ)


def _cosine_and_sine(X: Numbers) -> tuple[Numbers, Numbers]:
    """C and S."""
    σ, a, b, d, J, length = _products(X)
    return a * b - σ * d, length * J


def _without_rotation(X: Numbers, Y: Numbers) -> Numbers:
    """Y less the rotation ω × X that fits it best: Σ X×Y of the rest is zero."""
    transposed = np.swapaxes(X, -1, -2)
    A = _v(_v((X * X).sum(axis=(-1, -2)))) * np.eye(3) - transposed @ X
    ω = np.linalg.solve(A, _v(_cross(X, Y).sum(axis=-2)))
    return Y - _cross(np.swapaxes(ω, -1, -2), X)


def _cross_pairs(X: Numbers, Y: Numbers) -> Numbers:
    """Rows X₂×Y₃, X₃×Y₁, X₁×Y₂; with Y = X the gradient of the triple product."""
    (t, p, m), (u, q, n) = _rows(X), _rows(Y)
    return np.stack([_cross(p, n), _cross(m, u), _cross(t, q)], axis=-2)


def _rows(X: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    return X[..., 0, :], X[..., 1, :], X[..., 2, :]


def _v(x: Numbers) -> Numbers:
    """With one more axis."""
    return x[..., None]


def _dot(a: Numbers, b: Numbers) -> Numbers:
    product: Numbers = (a * b).sum(axis=-1)
    return product


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """a × b; several times faster than NumPy's, and for broadcast arrays."""
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
