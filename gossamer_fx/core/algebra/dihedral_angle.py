"""Signed dihedral angle of a fold, its gradient, and a discrete gradient that conserves energy.

Notation.  At a point of a fold the array X (3, 3) has three vectors as rows: t along the fold, p
and m into the panels on its left and on its right.  With

    C = (t·p)(t·m) - (t·t)(p·m),    S = |t| J,    J = t·(p × m)                                  (1)

the angle of the fold is θ = atan2(S, C).  It is zero where the panels continue each other, and
positive where they have turned towards t × p, the normal of the left panel.

Problem.  A time step from X0 to X1 conserves energy and angular momentum if the torque of the fold
acts through a discrete gradient G with

    G·(X1 - X0) = θ1 - θ0,    Σ X_mid × G = 0,    X_mid = ½(X0 + X1),                            (2)

where the sum is over the three rows.

Algorithm.

1. Every product of two quantities has the discrete gradient of the product rule, Δ(a b) = a_mean Δb
   + b_mean Δa.  It starts from the dot products and √(t·t), whose discrete gradients need only the
   vectors X_mid and exert no torque.  This gives the gradients G_C and G_S of C and S, up to the
   gradient G_J of J.
2. J is cubic, so the gradient at X_mid does not satisfy (2).  Split the change ΔX = R + P, where
   R = ω × X_mid is the rotation that fits ΔX best, and correct the gradient:

       G_J = ∇J(X_mid) + 𝒫 (¼ R×R + ⅛ (R×P + P×R) + 1/12 P×P)                                    (3)

   Here X×Y has the rows p × m', m × t', t × p' of X = (t, p, m) and Y = (t', p', m'), and 𝒫 removes
   rotations about X_mid.  G_J is smooth, satisfies G_J·ΔX = ΔJ, and exerts no torque.
3. The angle follows from C and S:

       G = Δθ/((ρ0 + ρ1) sin ½Δθ) (cos θ_mid G_S - sin θ_mid G_C)                                (4)

   with θ_mid = ½(θ0 + θ1) and ρ = √(C² + S²).  It satisfies (2) exactly for changes of the angle up
   to a whole turn.

All arrays have the shape (..., 3, 3) with the vectors as rows.  All functions but `angle` are
analytic, so that complex steps give their derivatives.  As a compiled law (`core.laws`), of 20
numbers in and 9 out, (3) and (4) were not differentiated within ten minutes.

Discrete gradients: O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162.  Complex
steps: W. Squire & G. Trapp, SIAM Rev. 40 (1998) 110, doi:10.1137/S003614459631241X.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

# Real or complex.
Numbers = npt.NDArray[Any]
Array = npt.NDArray[np.floating]

# Size of the complex step.  It takes no difference of two values, so nothing cancels, and a
# step this small has no truncation error either.
STEP = 1e-30

# Half changes of angle [rad] below which x/sin x is replaced by its series 1 + x²/6 + 7 x⁴/360; the
# term that is left out is of the order of 1e-20.
SMALL_HALF_ANGLE = 1e-3


def angle(X: Array) -> Array:
    """Signed dihedral angle θ (...) [rad], in [-π, π], of folds X (..., 3, 3) whose rows, vectors
    of any unit, are t along the fold, p and m into the panels on its left and on its right.

    θ = atan2(S, C) with C = (t·p)(t·m) - (t·t)(p·m) and S = |t| t·(p × m).  It is zero where the
    two panels continue each other; where p or m is parallel to t it has no meaning, but raises no
    error.

    >>> import numpy as np
    >>> t, p, m = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    >>> float(np.degrees(angle(np.array([t, p, m]))))
    90.0
    """
    C, S = _cosine_and_sine(X)
    return np.arctan2(S, C)


def gradient(X: Numbers) -> Numbers:
    """Gradient ∂θ/∂X (..., 3, 3) of the dihedral angle of folds X (..., 3, 3), in the inverse of
    their unit: (C ∂S/∂X - S ∂C/∂X)/(C² + S²), with S and C of `angle`.

    X may be complex, for derivatives by complex steps.  A panel without area gives NaN.
    """
    # tt = t·t, tp = t·p, tm = t·m, pm = p·m; gC and gS are the gradients of C and S.
    tt, tp, tm, pm, J, length = _products(X)
    C = tp * tm - tt * pm
    S = length * J
    gC = _gradient_of_cosine(X, (tt, tp, tm, pm))
    # The product rule for S = |t| J, whose factor |t| depends on t only.
    gS = _by_fold(length) * _cross_pairs(X, X)
    gS[..., 0, :] += _by_vector(J / length) * X[..., 0, :]
    return (_by_fold(C) * gS - _by_fold(S) * gC) / _by_fold(C * C + S * S)


def discrete_gradient(X0: Array, X1: Numbers, θ0: Array, θ1: Numbers) -> Numbers:
    """Discrete gradient G (..., 3, 3) of the dihedral angle of folds over a step from X0 to X1
    (..., 3, 3), in the inverse of their unit; equations (3) and (4) of the module.

    G·(X1 - X0) = θ1 - θ0 and Σ X_mid × G = 0 over the three rows, so that the moment of a crease
    conserves energy and angular momentum; at X1 = X0 it is the gradient.  The angles θ0 and θ1
    (...) [rad] may be on any branch, less than a whole turn apart, which is not checked.  X1 may be
    complex, for derivatives by complex steps.  Three vectors that are parallel at the middle of the
    step raise `LinAlgError`.

    >>> import numpy as np
    >>> X0 = np.eye(3)
    >>> X1 = X0 + 0.1 * np.arange(9).reshape(3, 3)
    >>> change = angle(X1) - angle(X0)
    >>> G = discrete_gradient(X0, X1, angle(X0), angle(X1))
    >>> bool(np.isclose((G * (X1 - X0)).sum(), change))
    True
    """
    X_mid = (X0 + X1) / 2
    ΔX = X1 - X0
    t = X_mid[..., 0, :]
    products0 = _products(X0)
    products1 = _products(X1)
    # Means over the step of t·t, t·p, t·m, p·m, J and |t|.
    means = [(before + after) / 2 for before, after in zip(products0, products1, strict=True)]
    tt, tp, tm, pm, J, length = means

    # Step 1.  gC, gJ and gS are the discrete gradients of C, J and S.
    gC = _gradient_of_cosine(X_mid, (tt, tp, tm, pm))
    # Step 2, equation (3).  The change ΔX is a rotation R about X_mid and the rest P.
    P = _without_rotation(X_mid, ΔX)
    R = ΔX - P
    correction = (
        _cross_pairs(R, R) / 4
        + (_cross_pairs(R, P) + _cross_pairs(P, R)) / 8
        + _cross_pairs(P, P) / 12
    )
    gJ = _cross_pairs(X_mid, X_mid) + _without_rotation(X_mid, correction)
    gS = _by_fold(length) * gJ
    gS[..., 0, :] += _by_vector(J / length) * t

    # Step 3, equation (4).  ρ = √(C² + S²); 0 and 1 are the start and the end of the step.
    C0, S0 = _cosine_and_sine(X0)
    C1, S1 = _cosine_and_sine(X1)
    half = (θ1 - θ0) / 2
    θ_mid = (θ0 + θ1) / 2
    is_small = np.abs(half) < SMALL_HALF_ANGLE
    # np.where evaluates both branches, so the divisor must not vanish.
    safe = np.where(is_small, 1.0, half)
    series = 1 + half**2 / 6 + 7 * half**4 / 360
    ratio = np.where(is_small, series, safe / np.sin(safe))
    ρ0 = np.sqrt(C0 * C0 + S0 * S0)
    ρ1 = np.sqrt(C1 * C1 + S1 * S1)
    factor = 2 * ratio / (ρ0 + ρ1)
    weight_of_sine = _by_fold(factor * np.cos(θ_mid))
    weight_of_cosine = _by_fold(factor * np.sin(θ_mid))
    return weight_of_sine * gS - weight_of_cosine * gC


def discrete_gradient_derivative(X0: Array, X1: Array, θ0: Array, θ1: Array) -> Array:
    """Derivative ∂G/∂X1 (n, 3, 3, 3, 3) of `discrete_gradient` of n folds X0 and X1 (n, 3, 3) with
    the angles θ0 and θ1 (n,) [rad], by complex steps, exact to round-off; the last two axes are
    those of X1."""
    # The angle at the end follows X1: θ (9, n) is θ1 with its change in each of the nine steps.
    change_of_angle = gradient(X1).reshape(-1, 9).T
    θ = θ1 + 1j * STEP * change_of_angle
    return _derivative(discrete_gradient(X0, _stepped(X1), θ0, θ))


def gradient_derivative(X: Array) -> Array:
    """Second derivative ∂²θ/∂X² (n, 3, 3, 3, 3) of n folds X (n, 3, 3), by complex steps, exact to
    round-off."""
    return _derivative(gradient(_stepped(X)))


def _stepped(X: Array) -> Numbers:
    """Folds (9, n, 3, 3) with a complex step in each of the nine components of X (n, 3, 3)."""
    directions = np.eye(9).reshape(9, 1, 3, 3)
    return X + 1j * STEP * directions


def _derivative(G: Numbers) -> Array:
    """Derivatives (n, 3, 3, 3, 3) of a gradient whose values at the folds of `_stepped` are G
    (9, n, 3, 3); the last two axes are those of the stepped component."""
    columns = np.moveaxis(G.imag / STEP, 0, -1)
    return columns.reshape(*G.shape[1:], 3, 3)


def _products(X: Numbers) -> tuple[Numbers, ...]:
    """The products t·t, t·p, t·m, p·m, J and |t| of folds, (...) each."""
    t, p, m = _rows(X)
    tt = _dot(t, t)
    tp = _dot(t, p)
    tm = _dot(t, m)
    pm = _dot(p, m)
    J = _dot(t, _cross(p, m))
    return tt, tp, tm, pm, J, np.sqrt(tt)


def _cosine_and_sine(X: Numbers) -> tuple[Numbers, Numbers]:
    """C and S, equation (1): cosine and sine of the angle, times the same positive factor."""
    tt, tp, tm, pm, J, length = _products(X)
    C = tp * tm - tt * pm
    S = length * J
    return C, S


def _gradient_of_cosine(X: Numbers, products: tuple[Numbers, ...]) -> Numbers:
    """Gradient (..., 3, 3) of C = (t·p)(t·m) - (t·t)(p·m) from the products t·t, t·p, t·m and p·m,
    (...) each.  With those of X it is the derivative; with means over a step, and X at its middle,
    the discrete gradient."""
    t, p, m = _rows(X)
    # tt = t·t, tp = t·p, tm = t·m, pm = p·m, with one more axis for products with vectors.
    tt, tp, tm, pm = (_by_vector(product) for product in products)
    return np.stack(
        [
            tp * m + tm * p - 2 * pm * t,
            tm * t - tt * m,
            tp * t - tt * p,
        ],
        axis=-2,
    )


def _without_rotation(X: Numbers, Y: Numbers) -> Numbers:
    """Changes Y (..., 3, 3) of folds X (..., 3, 3) less the rotation ω × X that fits them best; for
    the rest Σ X × Y over the rows is zero."""
    transposed = np.swapaxes(X, -1, -2)
    squares = (X * X).sum(axis=(-1, -2))
    # The tensor of inertia of unit masses at the three vectors, and their angular momentum.
    inertia = _by_fold(squares) * np.eye(3) - transposed @ X
    momentum = _cross(X, Y).sum(axis=-2)
    ω = np.linalg.solve(inertia, _by_vector(momentum))
    return Y - _cross(np.swapaxes(ω, -1, -2), X)


def _cross_pairs(X: Numbers, Y: Numbers) -> Numbers:
    """Rows X₂×Y₃, X₃×Y₁, X₁×Y₂ (..., 3, 3) of two arrays of three rows; with Y = X the gradient of
    the triple product J = X₁·(X₂ × X₃)."""
    # t, p, m are the rows of X, and u, q, n those of Y.
    t, p, m = _rows(X)
    u, q, n = _rows(Y)
    return np.stack(
        [
            _cross(p, n),
            _cross(m, u),
            _cross(t, q),
        ],
        axis=-2,
    )


def _rows(X: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """The vectors t, p and m (..., 3) of folds."""
    return X[..., 0, :], X[..., 1, :], X[..., 2, :]


def _by_vector(x: Numbers) -> Numbers:
    """Numbers (...) as (..., 1), factors of vectors (..., 3)."""
    return x[..., None]


def _by_fold(x: Numbers) -> Numbers:
    """Numbers (...) as (..., 1, 1), factors of arrays (..., 3, 3) of three vectors."""
    return x[..., None, None]


def _dot(a: Numbers, b: Numbers) -> Numbers:
    """Dot products over the last axis."""
    return (a * b).sum(axis=-1)


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """Cross products (..., 3) of real or complex vectors that broadcast, several times faster than
    those of NumPy."""
    # Components (...): x, y, z of a, and u, v, w of b.
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack(
        [
            y * w - z * v,
            z * u - x * w,
            x * v - y * u,
        ],
        axis=-1,
    )
