"""Average stress along a straight path between two strains, for film laws that wrinkle (UFL).

Problem.  The energy-conserving time step (`terms.discrete_gradient`) needs, at each
quadrature point, the stress ψ'(e) of a film averaged over the straight path between the strains of
two instants,

    S_mean = ∫₀¹ ψ'(e(s)) ds,    e(s) = e0 + s (e1 - e0),    0 ≤ s ≤ 1.                          (1)

The energy is conserved only as accurately as (1) is integrated, because S_mean·(e1 - e0) = ψ(e1) -
ψ(e0) holds for the exact integral alone.  A film law is smooth while the film stays taut, wrinkled
or slack, and has kinks in its stress where the state changes.  Gauss points converge slowly across
such a kink, and they leave a tangent that is not positive definite.

Idea.  Cut the path where the film changes its state; integrate each piece in closed form.  Strains
are vectors (e1, e2, e3) = (E11, E22, 2 E12).  Mohr's circle of a strain has the centre h and the
radius r,

    h = (e1 + e2)/2,    d = ((e1 - e2)/2, e3/2),    r = |d|,                                     (2)

and the principal strains are h + r and h - r.  In the space (h, d) the taut strains and the slack
strains of `materials.film.Miyazaki` fill two circular cones h + margin ≥ m r.  A straight line
meets a convex cone in one interval.

Algorithm.

1. The law names its cones; `within_cone` returns the interval (start, end) of the path in each of
   them.  Its ends lie at roots of

       q(s) = (h(s) + margin)² - m² r(s)² = A s² + 2 B s + C,                                    (3)

   of which the one is chosen, for entry and exit, whose expression does not subtract nearly equal
   numbers.
2. The rest of the path, before, between and after these intervals, is wrinkled.
3. Taut and slack energies are quadratic: their mean stress is that at the middle of the piece.
4. The wrinkled energy is quadratic except for a multiple of h r.  `mean_gradient` averages the
   gradient of h r,

       ∂(h r)/∂e = r ∂h/∂e + (h/r) d·∂d/∂e,                                                      (4)

   over a piece.  On -1 ≤ t ≤ 1, with h = h_mid + h_rate t and d = d_mid + k t, it needs the
   averages

       J_n = ½ ∫ tⁿ/r dt,    n = 0, 1, 2,                                                        (5)

   which follow from the lengths ra and rb of d at both ends:

       J0 = artanh(2|k|/(ra + rb))/|k|                                                           (6)
       k² J1 = (rb - ra)/2 - d_mid·k J0                                                          (7)
       k² J2 = (ra + rb)/4 - |d_mid|² J0/2 - 3/2 d_mid·k J1                                      (8)

5. Pieces that are short compared with their distance from r = 0 lose digits in (7) and (8).  They
   are integrated by four Gauss points; the integrand is smooth there.
6. The caller adds the means of all pieces, each times its share end - start of the path.

Cost.  No loop and no iteration: everything is one UFL expression with one square root a cone, and
one logarithm and seven square roots a wrinkled piece.  UFL takes its derivative with respect to e1
for the tangent.

Limits.  The law must be isotropic, with states that are cones in (h, d); other laws return no
pieces and are integrated by Gauss points.  Radii are kept above 1e-15, so that a path through r = 0
has a finite average.

Source of equation (1), the discrete gradient of the mean-value type: A. Harten, P. D. Lax & B. van
Leer, SIAM Rev. 25 (1983) 35, doi:10.1137/1025002.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import ufl

from gossamer_fx.core.forms.kinematics import Expr

# Step 5: a piece is short if |d(e1) - d(e0)| is less than this fraction of ra + rb.  Up to it the
# relative error of four Gauss points is below 2e-8, less where h changes no more than d.
SHORT = 0.2

# Gauss points for short pieces.
SHORT_PATH_POINTS = 4

# The smallest square of a radius.  The square root is then differentiable where both principal
# strains are equal.
SMALLEST_SQUARE = 1e-30

# The smallest value of (ra rb + da·db)/(ra rb), twice the squared sine of half the angle between da
# and -db.  It is zero for a path through r = 0, where J0 is infinite but its factors vanish.
SMALLEST_OPENING = 1e-24


@dataclass(frozen=True)
class Piece:
    """One interval of a path in strain space, 0 ≤ start ≤ end ≤ 1, on which the film stays in one
    state; empty where start = end.

    `stress(ea, eb)` is the stress (3,) [N/m] of that state, averaged along the path from the strain
    ea (3,) to the strain eb (3,); `state` is its number, of a law that has several.
    """

    start: Expr
    end: Expr
    stress: Callable[[Expr, Expr], Expr]
    state: int = 0


def energy_gradient(ψ: Callable[[Expr], Expr], e: Expr) -> Expr:
    """Derivative ψ'(e) of a scalar function of a strain, such as an energy density [J/m²], as an
    expression of the shape of e.

    >>> import ufl
    >>> energy_gradient(lambda e: e[0] ** 2, ufl.as_vector([3.0, 0.0, 0.0])).ufl_shape
    (3,)
    """
    e = ufl.variable(e)
    return ufl.diff(ψ(e), e)


def with_derivative(S: Expr, e: Expr) -> Expr:
    """A stress S (m,) as an expression of a `ufl.variable` e (m,), and its derivative dS/de, row
    after row, as one vector (m + m²,).

    >>> import ufl
    >>> e = ufl.variable(ufl.as_vector([3.0, 1.0]))
    >>> with_derivative(2 * e, e).ufl_shape
    (6,)
    """
    m = S.ufl_shape[0]
    # Derivative (m, m): D[i, j] = dS_i/de_j
    D = ufl.diff(S, e)
    components = [S[i] for i in range(m)]
    components += [D[i, j] for i in range(m) for j in range(m)]
    return ufl.as_vector(components)


def within_cone(e0: Expr, e1: Expr, m: Expr, margin: float) -> tuple[Expr, Expr]:
    """Interval (start, end), 0 ≤ start ≤ end ≤ 1, of the path from the strain e0 to e1 (E11, E22, 2
    E12) on which h + margin ≥ m r, m > 0; start = end if it misses this cone.

    h and r are centre and radius of Mohr's circle of the strain, d its deviator (2,), |d| = r.
    With s from 0 to 1, q(s) = (h + margin)² - m² r² = A s² + 2 B s + C is positive inside the cone
    and its opposite one.

    >>> import ufl
    >>> slack = ufl.as_vector([-1.0, -1.0, 0.0])
    >>> taut = ufl.as_vector([1.0, 1.0, 0.0])
    >>> start, end = within_cone(slack, taut, 1.0, 0.0)
    >>> round(start(()), 12), end(())
    (0.5, 1.0)
    """

    def product(a: tuple[Expr, ...], b: tuple[Expr, ...]) -> Expr:
        """The bilinear form whose value at a = b is positive inside the double cone."""
        return a[0] * b[0] - m**2 * (a[1] * b[1] + a[2] * b[2])

    h0, *d0 = _mohr(e0)
    h1, *d1 = _mohr(e1)
    first = (h0 + margin, *d0)
    last = (h1 + margin, *d1)
    change = tuple(b - a for a, b in zip(first, last, strict=True))

    # Coefficients of q(s) in equation (3).
    A = product(change, change)
    B = product(first, change)
    C = product(first, first)
    # The path misses the cone if the discriminant is negative; the value is not used then.
    root = ufl.sqrt(ufl.max_value(B**2 - A * C, 0))

    # Each root of q has two expressions; the one is taken whose terms have the same sign, so that
    # nothing cancels.
    falls = ufl.lt(B, 0)
    entry = ufl.conditional(
        falls,
        _fraction(root - B, A),
        _fraction(-C, B + root),
    )
    exit = ufl.conditional(
        falls,
        _fraction(C, root - B),
        _fraction(-B - root, A),
    )

    # q > 0 in the opposite cone h + margin ≤ -m r too; the sign of h + margin tells both apart.
    starts_inside = ufl.And(
        ufl.ge(first[0], 0),
        ufl.ge(C, 0),
    )
    ends_inside = ufl.And(
        ufl.ge(last[0], 0),
        ufl.ge(product(last, last), 0),
    )
    # Both ends outside: the path can still pass through if q has a maximum (A < 0) that is
    # positive, and h + margin is positive at that maximum, s = -B/A.
    maximum_is_positive = ufl.gt(B**2, A * C)
    maximum_is_in_this_cone = ufl.lt(first[0] * A, B * change[0])
    through = ufl.And(ufl.lt(A, 0), ufl.And(maximum_is_positive, maximum_is_in_this_cone))

    enters = ufl.Or(ends_inside, through)
    start_if_outside = ufl.conditional(enters, entry, 1.0)
    start = ufl.conditional(starts_inside, 0.0, start_if_outside)
    leaves = ufl.Or(starts_inside, through)
    end_if_outside = ufl.conditional(leaves, exit, start)
    end = ufl.conditional(ends_inside, 1.0, end_if_outside)
    # Round-off may put the exit before the entry.
    return start, ufl.max_value(start, end)


def _fraction(a: Expr, b: Expr) -> Expr:
    """The quotient a/b limited to [0, 1], without a division by zero: roots of a quadratic equation
    beyond the ends of a path are moved to the ends."""
    is_positive = ufl.gt(a * b, 0)
    inside = ufl.And(is_positive, ufl.lt(abs(a), abs(b)))
    beyond = ufl.conditional(is_positive, 1.0, 0.0)
    # Both branches of a UFL conditional are evaluated and differentiated, so the denominator must
    # never vanish.
    denominator = ufl.conditional(inside, b, 1.0)
    return ufl.conditional(inside, a / denominator, beyond)


def mean_gradient(ea: Expr, eb: Expr) -> Expr:
    """Gradient (3,) of h r with respect to the strain, averaged along the straight path from ea to
    eb (E11, E22, 2 E12); equations (4) to (8) of the module.  It is finite also for ea = eb and for
    paths through r = 0.

    h and r are centre and radius of Mohr's circle.  In the code a and b denote both ends, (x, y) is
    the deviator, whose norm is r, (kx, ky) half its change, with the norm k.  J0, J1 and J2 are the
    averages of 1/r, t/r and t²/r over -1 ≤ t ≤ 1.

    >>> import ufl
    >>> e = ufl.as_vector([3.0, 1.0, 0.0])  # h = 2, r = 1; the gradient is (½(r + h), ½(r - h), 0)
    >>> [round(component(()), 9) for component in mean_gradient(e, e)]
    [1.5, -0.5, 0.0]
    """
    ha, xa, ya = _mohr(ea)
    hb, xb, yb = _mohr(eb)
    ra = _norm(xa, ya)
    rb = _norm(xb, yb)
    both = ra + rb

    # The path about its middle: h + h_rate t and (x + kx t, y + ky t), -1 ≤ t ≤ 1.
    h = (ha + hb) / 2
    x = (xa + xb) / 2
    y = (ya + yb) / 2
    h_rate = (hb - ha) / 2
    kx = (xb - xa) / 2
    ky = (yb - ya) / 2
    k = _norm(kx, ky)
    # J1 and J2 divide by k²; for short pieces, whose closed form is not used, the divisor stays
    # away from zero.
    k_square = ufl.max_value(kx**2 + ky**2, (SHORT / 4 * both) ** 2)

    J0 = _mean_inverse_radius(
        xa=xa,
        ya=ya,
        xb=xb,
        yb=yb,
        ra=ra,
        rb=rb,
        k=k,
    )
    along_k = x * kx + y * ky
    middle_square = x**2 + y**2
    J1 = ((rb - ra) / 2 - along_k * J0) / k_square  # equation (7)
    J2 = (both / 4 - middle_square / 2 * J0 - 1.5 * along_k * J1) / k_square  # equation (8)

    # The averages of r and of (h/r) d, by r = r²/r and the products of the linear functions of t.
    exact = [
        middle_square * J0 + 2 * along_k * J1 + k_square * J2,
        _mean_of_product((h, h_rate), (x, kx), (J0, J1, J2)),
        _mean_of_product((h, h_rate), (y, ky), (J0, J1, J2)),
    ]

    # The same averages by Gauss points, step 5 of the module.
    by_points: list[Expr] = [0, 0, 0]
    points, weights = np.polynomial.legendre.leggauss(SHORT_PATH_POINTS)
    for t, weight in zip(points, weights, strict=True):
        h_there = h + float(t) * h_rate
        x_there = x + float(t) * kx
        y_there = y + float(t) * ky
        r_there = _norm(x_there, y_there)
        values = (
            r_there,
            h_there * x_there / r_there,
            h_there * y_there / r_there,
        )
        for i, value in enumerate(values):
            by_points[i] += float(weight) / 2 * value

    is_short = ufl.lt(2 * k, SHORT * both)
    r_mean = ufl.conditional(is_short, by_points[0], exact[0])
    Gx = ufl.conditional(is_short, by_points[1], exact[1])
    Gy = ufl.conditional(is_short, by_points[2], exact[2])
    # Equation (4): ∂h/∂e = (½, ½, 0), and ∂d/∂e has the columns (½, 0), (-½, 0), (0, ½).
    return ufl.as_vector(
        [
            (r_mean + Gx) / 2,
            (r_mean - Gx) / 2,
            Gy / 2,
        ]
    )


def _mean_of_product(
    a: tuple[Expr, Expr], b: tuple[Expr, Expr], J: tuple[Expr, Expr, Expr]
) -> Expr:
    """The average of a b/r, with two linear functions a = a[0] + a[1] t and b = b[0] + b[1] t, over
    -1 ≤ t ≤ 1."""
    constant = a[0] * b[0]
    linear = a[0] * b[1] + a[1] * b[0]
    quadratic = a[1] * b[1]
    return constant * J[0] + linear * J[1] + quadratic * J[2]


def _mean_inverse_radius(
    xa: Expr, ya: Expr, xb: Expr, yb: Expr, ra: Expr, rb: Expr, k: Expr
) -> Expr:
    """The average J0 of 1/|d| along a straight path of vectors d from da to db; k > 0 is the length
    of (db - da)/2.

    With 2 artanh(z) = ln((1 + z)/(1 - z)) it is

        J0 = ln((ra + rb + 2|k|)²/(2 opening))/(2|k|),    opening = ra rb + da·db,

    since (ra + rb)² - 4 k² = 2 opening.
    """
    along = xa * xb + ya * yb
    across = xa * yb - ya * xb
    # Where da and db point in opposite directions ra rb and da·db cancel; (ra rb)² - (da·db)² =
    # (da×db)² avoids that.
    without_cancellation = across**2 / (ra * rb - ufl.min_value(along, 0))
    opening = ufl.conditional(
        ufl.lt(along, 0),
        ufl.max_value(without_cancellation, SMALLEST_OPENING * ra * rb),
        ra * rb + along,
    )
    both = ra + rb
    return ufl.ln((both + 2 * k) ** 2 / (2 * opening)) / (2 * k)


def _mohr(e: Expr) -> tuple[Expr, Expr, Expr]:
    """Centre h of Mohr's circle of a strain (E11, E22, 2 E12), and the components of d, whose
    length is its radius.
    """
    h = (e[0] + e[1]) / 2
    x = (e[0] - e[1]) / 2
    y = e[2] / 2
    return h, x, y


def _norm(x: Expr, y: Expr) -> Expr:
    """Length of the vector (x, y), at least 1e-15, so that its derivative at zero is zero instead
    of 0/0."""
    return ufl.sqrt(ufl.max_value(x**2 + y**2, SMALLEST_SQUARE))


def mean_of_positive_part(y0: Expr, y1: Expr) -> Expr:
    """Average of max(y, 0) along the straight path from y0 to y1, in UFL;
    `terms.rows.one_sided_average` is the same for laws of numbers, and says how."""
    positive0 = ufl.max_value(y0, 0.0)
    positive1 = ufl.max_value(y1, 0.0)
    passes_zero = ufl.lt(y0 * y1, 0.0)
    change = ufl.conditional(passes_zero, y1 - y0, 1.0)
    quotient = (positive1**2 - positive0**2) / (2 * change)
    return ufl.conditional(passes_zero, quotient, (positive0 + positive1) / 2)
