"""Strain measures of surfaces and lines in space, as UFL expressions.

The unknowns are positions x [m] (and the directors of beams); the mesh is the stress-free shape.
Every measure is quadratic in the unknowns and does not change under rigid motions, which is what
the energy-conserving time step needs.

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
    """Strains (ε, γ2, γ3, κ2, κ3, τ) of a geometrically exact beam whose coordinates q (9,) are the
    positions x [m] and the directors d2, d3 [-], which span the cross-section:

        ε = ½(x'·x' - 1)               axial strain [-]
        γ_i = x'·d_i                   transverse shear [-]
        κ_i = x'·d_i'                  curvature [1/m]
        τ = ½(d2'·d3 - d3'·d2)         twist [1/m]
    """
    # Derivatives along the beam of x, d2 and d3, named dx, dd2 and dd3
    dq = line_derivative(q)
    dx, dd2, dd3 = _three_vectors(dq)
    _, d2, d3 = _three_vectors(q)
    return ufl.as_vector(
        [
            (ufl.dot(dx, dx) - 1) / 2,
            ufl.dot(dx, d2),
            ufl.dot(dx, d3),
            ufl.dot(dx, dd2),
            ufl.dot(dx, dd3),
            (ufl.dot(dd2, d3) - ufl.dot(dd3, d2)) / 2,
        ]
    )


def _three_vectors(q: Expr) -> list[Expr]:
    """The three vectors (3,) of which a vector q (9,) consists."""
    vectors = []
    for start in (0, 3, 6):
        components = [q[start + i] for i in range(3)]
        vectors.append(ufl.as_vector(components))
    return vectors
