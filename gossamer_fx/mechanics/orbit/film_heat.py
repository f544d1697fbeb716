"""Temperature of thin film that absorbs and radiates heat, and what the central body sends to a
face.

The film has one temperature T across its thickness.  Per area of the stress-free film

    C dT/dt = A - B T⁴                                                                           (1)

with the heat capacity C, the absorbed flux A, and B = (ε_front + ε_back) σ J, where J is the area
of the deformed film over that of the stress-free one.

In a step of the motion A and B are constant.  Equation (1) is integrated by the method of Alexander
with two implicit stages, which is of order 2 and damps fast changes (L-stable),

    T_i = T + h Σ_j a_ij f(T_j),    a = [[γ, 0], [1 - γ, γ]],    γ = 1 - 1/√2.                   (2)

Each stage is one equation T + b T⁴ = R, which Newton's method solves from above: its left side is
convex and grows.  A step that is long compared with the time constant C/(4 B T³) is divided, since
the explicit part of the second stage could lead below 0 K.  Where the division would be too fine,
the temperature follows the fluxes at once, and one implicit Euler step is made.

The emitted heat is the sum of h b_i B T_i⁴ over the stages, b = (1 - γ, γ): absorbed, emitted and
stored heat balance to the tolerance of Newton's method.

Source of (2): R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006.
"""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.extend import Array

# Stefan-Boltzmann constant [W/(m² K⁴)], exact in SI units to these digits (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8

# γ of the method (2).
GAMMA = 1 - 1 / math.sqrt(2)

# Sub-steps in a step over its length in time constants, and the largest number of them.
SUBSTEPS_PER_TIME_CONSTANT = 2.0
MAX_SUBSTEPS = 200

# Relative change of a temperature at which Newton's method ends.  It converges quadratically, so
# that the error is then round-off.
NEWTON_TOLERANCE = 1e-12
NEWTON_ITERATIONS = 60


def substeps(T: Array, h: float, C: Array | float, A: Array, B: Array) -> int:
    """Number of sub-steps that a step of length h [s] needs on this rank, for the arguments of
    `advance`: two in a time constant, from 1 to 201, which stands for more than `MAX_SUBSTEPS`."""
    if not len(T):
        return 1
    # Between the present and the equilibrium temperature, where the time constant is least.
    hottest = np.maximum(T, equilibrium_temperature(A, B))
    constants_in_step = h * 4 * B * hottest**3 / C
    longest = float(constants_in_step.max(initial=0.0))
    return math.ceil(min(SUBSTEPS_PER_TIME_CONSTANT * longest, MAX_SUBSTEPS + 1)) or 1


def equilibrium_temperature(A: Array, B: Array) -> Array:
    """(A/B)^¼ [K], at which as much heat is absorbed as emitted; zero where nothing is emitted."""
    radiating = np.where(B > 0, B, 1.0)
    return np.where(B > 0, (A / radiating) ** 0.25, 0.0)


def advance(
    T: Array, h: float, C: Array | float, A: Array, B: Array, *, count: int
) -> tuple[Array, Array]:
    """Temperatures (n,) [K] of triangles of a film a time h [s] later, and the heat (n,) [J/m²]
    that they have emitted.

    They follow C dT/dt = A - B T⁴, with the heat capacity per area C [J/(m² K)], the absorbed flux
    A (n,) [W/m²] and B (n,) [W/(m² K⁴)], integrated in `count` sub-steps of an implicit method of
    order 2 with two stages (R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006); for more than
    `MAX_SUBSTEPS` one implicit Euler step is made.

    >>> import numpy as np
    >>> black = np.array([2 * STEFAN_BOLTZMANN])
    >>> at_rest = black * 300.0**4
    >>> T, emitted = advance(np.array([300.0]), 1.0, 20.0, at_rest, black, count=4)
    >>> round(float(T[0]), 9), round(float(emitted[0] / at_rest[0]), 9)
    (300.0, 1.0)
    """
    if count > MAX_SUBSTEPS:
        T = _stage(T, h, C, A, B)
        return T, h * B * T**4
    substep = h / count
    emitted = np.zeros(len(T))
    for _ in range(count):
        first = _stage(T, GAMMA * substep, C, A, B)
        # h (1 - γ) f(T_1), from the change in the first stage
        explicit = (1 - GAMMA) / GAMMA * (first - T)
        T = _stage(T + explicit, GAMMA * substep, C, A, B)
        emitted += substep * B * ((1 - GAMMA) * first**4 + GAMMA * T**4)
    return T, emitted


def _stage(start: Array, time: float, C: Array | float, A: Array, B: Array) -> Array:
    """Solve one implicit stage of a length `time` [s]: the root T (n,) [K] of T + time B T⁴/C =
    start + time A/C, with A, B and C of `advance`.

    Newton's method ends after 60 iterations without an error; it falls to the root from above, so
    that it converges for all physical input.
    """
    right_side = start + time * A / C
    b = time * B / C
    # Both are above the root of a convex function that grows, from where Newton's method goes down.
    radiating = np.where(b > 0, b, 1.0)
    by_radiation = np.where(b > 0, (right_side / radiating) ** 0.25, np.inf)
    T = np.minimum(right_side, by_radiation)
    for _ in range(NEWTON_ITERATIONS):
        change = (T + b * T**4 - right_side) / (1 + 4 * b * T**3)
        T = T - change
        if not (np.abs(change) > NEWTON_TOLERANCE * T).any():
            break
    return T


def view_factor(cosine: Array, height: float) -> Array:
    """Share F (n,) of a full hemisphere of radiation that a flat face gets from a sphere: (1/π) ∫
    cos θ dΩ over the visible part of the sphere that is above the plane of the face.

    `cosine` (n,) is of the angle between the outward normal of the face and the direction to the
    centre, `height` the distance from the centre over the radius of the sphere, at least 1.  The
    closed form is compared with a quadrature in `tests/orbit/test_heating.py`.

    >>> import numpy as np
    >>> view_factor(np.array([1.0, -1.0]), 2.0).tolist()
    [0.25, 0.0]
    """
    sine = np.sqrt(np.maximum(1 - cosine**2, 0.0))
    horizon = math.sqrt(max(height**2 - 1, 0.0))
    whole = np.maximum(cosine, 0.0) / height**2
    # The plane of the face cuts the sphere where |cos| < 1/height.
    is_cut = (np.abs(cosine) * height < 1) & (sine > 0)
    safe_sine = np.where(is_cut, sine, 1.0)
    chord = np.sqrt(np.maximum(1 - (height * cosine) ** 2, 0.0))
    slant = np.clip(-horizon * cosine / safe_sine, -1.0, 1.0)
    edge = np.clip(horizon / (height * safe_sine), -1.0, 1.0)
    cut = (
        0.5
        - np.arcsin(edge) / math.pi
        + (cosine * np.arccos(slant) - horizon * chord) / (math.pi * height**2)
    )
    return np.where(is_cut, np.maximum(cut, 0.0), whole)
