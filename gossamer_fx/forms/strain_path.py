"""Straight paths in strain space, e(s) = e0 + s (e1 - e0) with 0 ≤ s ≤ 1, cut where a material changes its state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import ufl

from gossamer_fx.forms.kinematics import Expr

SHORT = 0.2  # length of a path over the sum of the radii at its ends, up to which four Gauss points miss less than 1e-9


@dataclass(frozen=True)
class Piece:
    """The stretch start ≤ s ≤ end of a path in one state of the material; it may be empty.

    `stress(ea, eb)` is the stress of that state averaged along the straight path from ea to eb.
    """

    start: Expr
    end: Expr
    stress: Callable[[Expr, Expr], Expr]


def gradient(ψ: Callable[[Expr], Expr], e: Expr) -> Expr:
    """ψ'(e)."""
    e = ufl.variable(e)
    return ufl.diff(ψ(e), e)


def within_cone(e0: Expr, e1: Expr, m: Expr, margin: float) -> tuple[Expr, Expr]:
    """The (start, end) of the stretch in which h + margin ≥ m r, with h and r centre and radius of Mohr's circle.

    A cone is convex, so there is one such stretch, or none (start = end).  Its ends are among the roots of
    (h + margin)² - m² r², which is quadratic in s: A s² + 2 B s + C.
    """

    def product(a: tuple[Expr, ...], b: tuple[Expr, ...]) -> Expr:
        return a[0] * b[0] - m**2 * (a[1] * b[1] + a[2] * b[2])

    (h0, *r0), (h1, *r1) = _mohr(e0), _mohr(e1)
    first, last = (h0 + margin, *r0), (h1 + margin, *r1)
    change = tuple(b - a for a, b in zip(first, last, strict=True))
    A, B, C = product(change, change), product(first, change), product(first, first)
    root = ufl.sqrt(ufl.max_value(B**2 - A * C, 0))
    falls = ufl.lt(B, 0)  # of two expressions for a root, the one without cancellation
    entry = ufl.conditional(falls, _fraction(root - B, A), _fraction(-C, B + root))
    exit = ufl.conditional(falls, _fraction(C, root - B), _fraction(-B - root, A))
    starts = ufl.And(ufl.ge(first[0], 0), ufl.ge(C, 0))
    ends = ufl.And(ufl.ge(last[0], 0), ufl.ge(product(last, last), 0))
    through = ufl.And(
        ufl.lt(A, 0), ufl.And(ufl.gt(B**2, A * C), ufl.lt(first[0] * A, B * change[0]))
    )
    start = ufl.conditional(starts, 0.0, ufl.conditional(ufl.Or(ends, through), entry, 1.0))
    end = ufl.conditional(ends, 1.0, ufl.conditional(ufl.Or(starts, through), exit, start))
    return start, ufl.max_value(start, end)


def _fraction(a: Expr, b: Expr) -> Expr:
    """a/b, kept in [0, 1]."""
    inside = ufl.And(ufl.gt(a * b, 0), ufl.lt(abs(a), abs(b)))
    beyond = ufl.conditional(ufl.gt(a * b, 0), 1.0, 0.0)
    return ufl.conditional(inside, a / ufl.conditional(inside, b, 1.0), beyond)


def mean_gradient(ea: Expr, eb: Expr) -> Expr:
    """The gradient of h r, centre times radius of Mohr's circle, averaged along the path from ea to eb.

    With d = ((e1 - e2)/2, e3/2), r = |d|, it is r̄ ∂h + G·∂d, where r̄ and G are the averages of r and h d/r.  On
    -1 ≤ t ≤ 1, where h = h̄ + η t and d = m + k t, they follow from the averages Jn of tⁿ/r:

        J0 = artanh(2|k|/(ra + rb))/|k|
        k² J1 = (rb - ra)/2 - m·k J0
        k² J2 = (ra + rb)/4 - m² J0/2 - 3/2 m·k J1

    Short paths, on which these lose digits, take Gauss points.
    """
    (ha, xa, ya), (hb, xb, yb) = _mohr(ea), _mohr(eb)
    ra, rb = _norm(xa, ya), _norm(xb, yb)
    h, x, y = (ha + hb) / 2, (xa + xb) / 2, (ya + yb) / 2
    η, kx, ky = (hb - ha) / 2, (xb - xa) / 2, (yb - ya) / 2
    k, both = _norm(kx, ky), ra + rb
    k2 = ufl.max_value(kx**2 + ky**2, (SHORT / 4 * both) ** 2)

    along, across = xa * xb + ya * yb, xa * yb - ya * xb
    turned = across**2 / (ra * rb - ufl.min_value(along, 0))  # ra rb + along, without cancellation
    opening = ufl.conditional(
        ufl.lt(along, 0), ufl.max_value(turned, 1e-24 * ra * rb), ra * rb + along
    )
    mk, m2 = x * kx + y * ky, x**2 + y**2
    J0 = ufl.ln((both + 2 * k) ** 2 / (2 * opening)) / (2 * k)
    J1 = ((rb - ra) / 2 - mk * J0) / k2
    J2 = (both / 4 - m2 / 2 * J0 - 1.5 * mk * J1) / k2
    exact = [
        m2 * J0 + 2 * mk * J1 + k2 * J2,
        h * x * J0 + (h * kx + η * x) * J1 + η * kx * J2,
        h * y * J0 + (h * ky + η * y) * J1 + η * ky * J2,
    ]
    points: list[Expr] = [0, 0, 0]
    for t, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        ht, xt, yt = h + float(t) * η, x + float(t) * kx, y + float(t) * ky
        r = _norm(xt, yt)
        for i, value in enumerate((r, ht * xt / r, ht * yt / r)):
            points[i] += float(weight) / 2 * value
    short = ufl.lt(2 * k, SHORT * both)
    r, Gx, Gy = (ufl.conditional(short, a, b) for a, b in zip(points, exact, strict=True))
    return ufl.as_vector([(r + Gx) / 2, (r - Gx) / 2, Gy / 2])


def _mohr(e: Expr) -> tuple[Expr, Expr, Expr]:
    """Centre h of Mohr's circle, and the two components of its radius."""
    return (e[0] + e[1]) / 2, (e[0] - e[1]) / 2, e[2] / 2


def _norm(x: Expr, y: Expr) -> Expr:
    return ufl.sqrt(ufl.max_value(x**2 + y**2, 1e-30))
