"""Strain measures of surfaces and lines in space, as UFL expressions.

The unknowns are positions x [m] (and the directors of beams); the mesh is the stress-free shape.
No measure changes under rigid motions.  All are quadratic in the unknowns, except those of beams,
which have a discrete derivative: that is what the energy-conserving time step needs.

Surface tensors have components in the local orthonormal axes B of the mesh (see `cell_axes`).
Symmetric ones are written as vectors: strains as (E11, E22, 2 E12), stresses as (S11, S22, S12), so
that their dot product is the work per unit reference area.
"""

from __future__ import annotations

from typing import Any

import ufl
from dolfinx.mesh import Mesh

# UFL has no type hints.
Expr = Any

# The smallest square of the radius of Mohr's circle, see `half_trace_and_radius`.
SMALLEST_SQUARE = 1e-30

# Squares of the length of d2 × d3 between which a beam's normal is a unit vector.  An element of
# order 2 that bends by a quarter of a circle has 0.98; shorter or longer normals are those of
# iterates, or of a mesh that is too coarse.
NORMALISED = (0.9, 1.1)


def cell_axes(mesh: Mesh) -> Expr:
    """Return the local orthonormal axes B (3, 2) of a triangle mesh in space, as a UFL expression,
    constant in a cell with straight edges.  Its first column is the direction of the first edge of
    the cell; its second is perpendicular to that, within the surface.

    >>> import basix.ufl
    >>> import ufl
    >>> triangles = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,)))
    >>> cell_axes(triangles).ufl_shape
    (3, 2)
    """
    # Jacobian (3, 2): its columns are the edges of the cell; t1 and t2 are the columns of B.
    J = ufl.Jacobian(mesh)
    normal = ufl.cross(J[:, 0], J[:, 1])
    t1 = J[:, 0] / ufl.sqrt(ufl.dot(J[:, 0], J[:, 0]))
    t2 = ufl.cross(normal, t1) / ufl.sqrt(ufl.dot(normal, normal))
    rows = [[t1[i], t2[i]] for i in range(3)]
    return ufl.as_matrix(rows)


def surface_gradient(x: Expr, B: Expr) -> Expr:
    """Deformation gradient F = ∇x·B (3, 2) of a surface with positions x (3,) [m]: its columns are
    the vectors into which the two vectors of the cell axes B (3, 2) are moved."""
    return ufl.dot(ufl.grad(x), B)


def green_lagrange(F: Expr) -> Expr:
    """Green-Lagrange strain E = ½(FᵀF - I) of a surface as (E11, E22, 2 E12), dimensionless.

    >>> import ufl
    >>> stretched = ufl.as_matrix([[1.1, 0.0], [0.0, 1.0], [0.0, 0.0]])
    >>> [round(component(()), 3) for component in green_lagrange(stretched)]
    [0.105, 0.0, 0.0]
    """
    # Right Cauchy-Green tensor (2, 2)
    C = ufl.dot(F.T, F)
    return ufl.as_vector(
        [
            (C[0, 0] - 1) / 2,
            (C[1, 1] - 1) / 2,
            C[0, 1],
        ]
    )


def area_vector(F: Expr) -> Expr:
    """Normal (3,) of the deformed surface, times its area per unit reference area.

    F (3, 2) is `surface_gradient`.
    """
    return ufl.cross(F[:, 0], F[:, 1])


def half_trace_and_radius(e: Expr) -> tuple[Expr, Expr]:
    """Centre h and radius r of Mohr's circle of a strain (e11, e22, 2 e12), of a stress with twice
    the shear; the principal values are h ± r.  The radius is at least 1e-15, so that its derivative
    at equal principal values is zero instead of 0/0.

    >>> import ufl
    >>> h, r = half_trace_and_radius(ufl.as_vector([3.0, 1.0, 0.0]))
    >>> h(()), r(())
    (2.0, 1.0)
    """
    h = (e[0] + e[1]) / 2
    square = ((e[0] - e[1]) ** 2 + e[2] ** 2) / 4
    r = ufl.sqrt(ufl.max_value(square, SMALLEST_SQUARE))
    return h, r


def tension(S: Expr) -> Expr:
    """Tensile part of a plane stress (S11, S22, S12): negative principal stresses are set to
    zero.

    >>> import ufl
    >>> pulled_and_pressed = ufl.as_vector([5.0, -2.0, 0.0])
    >>> [component(()) for component in tension(pulled_and_pressed)]
    [5.0, 0.0, 0.0]
    """
    # `half_trace_and_radius` takes a strain, whose third component is twice the shear.
    h, r = half_trace_and_radius(ufl.as_vector([S[0], S[1], 2 * S[2]]))
    # h and r are centre and radius of Mohr's circle of the stress; `high` and `low` the tensile
    # parts of the principal stresses.
    high = ufl.max_value(h + r, 0.0)
    low = ufl.max_value(h - r, 0.0)
    # The principal directions stay: the deviator is scaled by the ratio of the new radius to the
    # old one.
    mean = (high + low) / 2
    ratio = (high - low) / (2 * r)
    return ufl.as_vector(
        [
            mean + ratio * (S[0] - h),
            mean + ratio * (S[1] - h),
            ratio * S[2],
        ]
    )


def line_derivative(f: Expr) -> Expr:
    """Derivative of an expression of any shape with respect to the reference length [m] of a mesh
    of line elements."""
    J = ufl.Jacobian(ufl.domain.extract_unique_domain(f))
    tangent = J[:, 0]
    return ufl.dot(ufl.grad(f), tangent / ufl.sqrt(ufl.dot(tangent, tangent)))


def bar_strain(x: Expr) -> Expr:
    """Green-Lagrange strain (ε,) of a line, ε = ½(x'·x' - 1), of positions x (3,) [m]."""
    dx = line_derivative(x)
    return ufl.as_vector([(ufl.dot(dx, dx) - 1) / 2])


def beam_strain(q: Expr) -> Expr:
    """Strains (Γ, γ2, γ3, κ2, κ3, τ) of a geometrically exact beam whose coordinates q (9,) are the
    positions x [m] and the directors d2, d3 [-], which span the cross-section with the unit normal
    d1 = d2 × d3/|d2 × d3|:

        Γ = x'·d1 - 1                  axial strain [-]
        γ_i = x'·d_i                   transverse shear [-]
        κ_i = d1·d_i'                  curvature [1/m]
        τ = ½(d2'·d3 - d3'·d2)         twist [1/m]

    They are quadratic in (x, d1, d2, d3), but not in q.
    """
    _, d2, d3 = _three_vectors(q)
    dx, dd2, dd3 = _three_vectors(line_derivative(q))
    d1 = _unit_normal(q)
    return ufl.as_vector(
        [
            ufl.dot(dx, d1) - 1,
            ufl.dot(dx, d2),
            ufl.dot(dx, d3),
            ufl.dot(d1, dd2),
            ufl.dot(d1, dd3),
            (ufl.dot(dd2, d3) - ufl.dot(dd3, d2)) / 2,
        ]
    )


def beam_strain_change(q0: Expr, q1: Expr, w: Expr) -> Expr:
    """Discrete derivative De(q0, q1)[w] (6,) of `beam_strain` along w (9,), with

        De(q0, q1)[q1 - q0] = e(q1) - e(q0)    De(q0, q1)[ω × ½(q0 + q1)] = 0 for all ω (3,).

    A product changes by Δ(a·b) = Δa·b_m + a_m·Δb with the means over both ends, marked m.  The
    change of the normal follows from what holds at both ends, d1·d1 = ℓ², d1·d2 = 0 and d1·d3 = 0:

        Δd1·d1m = ½Δℓ²    Δd1·d2m = -d1m·Δd2    Δd1·d3m = -d1m·Δd3                               (1)

    These are three equations for Δd1, and w in place of Δ gives the derivative.  The change of the
    product d2 × d3 itself would not turn with the means (d1m is not the normal of d2m and d3m), and
    the force would have a moment.  ℓ² is 1, or beyond `NORMALISED` a multiple of

        G = |d2 × d3|² = g22 g33 - g23²,    g_ij = d_i·d_j,

    and piecewise linear in G: its mean slope over the step is exact.
    """
    mean = (q0 + q1) / 2
    _, d2, d3 = _three_vectors(mean)
    dx, dd2, dd3 = _three_vectors(line_derivative(mean))
    _, w2, w3 = _three_vectors(w)
    dw, dw2, dw3 = _three_vectors(line_derivative(w))
    d1 = (_unit_normal(q0) + _unit_normal(q1)) / 2
    # The change of G along w, and half the slope of ℓ² by G: zero where normals are unit vectors.
    g22, g33, g23 = ((one + two) / 2 for one, two in zip(_products(q0), _products(q1), strict=True))
    by_2 = g33 * d2 - g23 * d3
    by_3 = g22 * d3 - g23 * d2
    change = 2 * (ufl.dot(by_2, w2) + ufl.dot(by_3, w3))
    least, largest = NORMALISED
    G0 = _squared_length(q0)
    G1 = _squared_length(q1)
    slope = _share_below(G0, G1, least) / least + (1 - _share_below(G0, G1, largest)) / largest
    # Equations (1), solved by the reciprocal basis of d1, d2 and d3.
    along_1 = ufl.cross(d2, d3)
    along_2 = ufl.cross(d3, d1)
    along_3 = ufl.cross(d1, d2)
    sides = slope / 2 * change * along_1 - ufl.dot(d1, w2) * along_2 - ufl.dot(d1, w3) * along_3
    w1 = sides / ufl.dot(d1, along_1)
    return ufl.as_vector(
        [
            ufl.dot(dw, d1) + ufl.dot(dx, w1),
            ufl.dot(dw, d2) + ufl.dot(dx, w2),
            ufl.dot(dw, d3) + ufl.dot(dx, w3),
            ufl.dot(w1, dd2) + ufl.dot(d1, dw2),
            ufl.dot(w1, dd3) + ufl.dot(d1, dw3),
            (ufl.dot(dw2, d3) + ufl.dot(dd2, w3) - ufl.dot(dw3, d2) - ufl.dot(dd3, w2)) / 2,
        ]
    )


def _unit_normal(q: Expr) -> Expr:
    """Unit normal d1 (3,) of the section with the coordinates q (9,).

    Interpolated directors are neither unit vectors nor orthogonal between the nodes: d2 × d3 itself
    makes the error of a curvature six times as large.  In the first iterates of a large rotation,
    where directors are several times too long, the quotient would cost twice the iterations; beyond
    `NORMALISED` the normal is d2 × d3 times a constant.
    """
    _, d2, d3 = _three_vectors(q)
    least, largest = NORMALISED
    square = ufl.max_value(ufl.min_value(_squared_length(q), largest), least)
    return ufl.cross(d2, d3) / ufl.sqrt(square)


def _squared_length(q: Expr) -> Expr:
    """G = |d2 × d3|² at the coordinates q (9,)."""
    g22, g33, g23 = _products(q)
    return g22 * g33 - g23**2


def _products(q: Expr) -> tuple[Expr, Expr, Expr]:
    """d2·d2, d3·d3 and d2·d3 at the coordinates q (9,)."""
    _, d2, d3 = _three_vectors(q)
    return ufl.dot(d2, d2), ufl.dot(d3, d3), ufl.dot(d2, d3)


def _share_below(a: Expr, b: Expr, bound: float) -> Expr:
    """Share, 0 to 1, of the straight path from a to b that is below a bound; of a path of length
    zero all or none of it."""
    crosses = ufl.lt((a - bound) * (b - bound), 0.0)
    length = ufl.conditional(crosses, b - a, 1.0)
    share = (ufl.min_value(b, bound) - ufl.min_value(a, bound)) / length
    all_or_none = ufl.conditional(ufl.lt(a + b, 2 * bound), 1.0, 0.0)
    return ufl.conditional(crosses, share, all_or_none)


def _three_vectors(q: Expr) -> list[Expr]:
    """The three vectors (3,) of which a vector q (9,) consists."""
    vectors = []
    for start in (0, 3, 6):
        components = [q[start + i] for i in range(3)]
        vectors.append(ufl.as_vector(components))
    return vectors
