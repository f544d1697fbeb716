"""Kinematics of surfaces and lines in space, as UFL: every measure is quadratic in positions and directors.

Positions `x` are the unknowns; the mesh is the stress-free shape.  Components of surface tensors refer to the local
orthonormal frame `B` of the mesh, and symmetric ones are written as vectors (E11, E22, 2 E12), stresses as
(S11, S22, S12), so that their dot product is the work per unit reference area.
"""

from __future__ import annotations

from typing import Any

import ufl
from dolfinx.mesh import Mesh

Expr = Any  # ufl has no type hints


def frame(mesh: Mesh) -> Expr:
    """Local orthonormal frame B (3x2) of a triangle mesh in space: first edge, and its normal in the surface."""
    J = ufl.Jacobian(mesh)
    normal = ufl.cross(J[:, 0], J[:, 1])
    t1 = J[:, 0] / ufl.sqrt(ufl.dot(J[:, 0], J[:, 0]))
    t2 = ufl.cross(normal, t1) / ufl.sqrt(ufl.dot(normal, normal))
    return ufl.as_matrix([[t1[i], t2[i]] for i in range(3)])


def surface_gradient(x: Expr, B: Expr) -> Expr:
    """F = ∇x·B (3x2): the images of the two frame vectors under the motion x."""
    return ufl.dot(ufl.grad(x), B)


def green_lagrange(F: Expr) -> Expr:
    """E = ½(FᵀF - I) as (E11, E22, 2 E12)."""
    C = ufl.dot(F.T, F)
    return ufl.as_vector([(C[0, 0] - 1) / 2, (C[1, 1] - 1) / 2, C[0, 1]])


def area_vector(F: Expr) -> Expr:
    """Normal of the deformed surface times its area per unit reference area."""
    return ufl.cross(F[:, 0], F[:, 1])


def half_trace_and_radius(e: Expr) -> tuple[Expr, Expr]:
    """Centre and radius of Mohr's circle of e = (e11, e22, 2 e12): principal values are h + r and h - r.

    The radius is guarded at 1e-15: its derivative at equal principal values is zero instead of 0/0.
    """
    h = (e[0] + e[1]) / 2
    r = ufl.sqrt(ufl.max_value(((e[0] - e[1]) ** 2 + e[2] ** 2) / 4, 1e-30))
    return h, r


def tension(S: Expr) -> Expr:
    """The part (S11, S22, S12) of a plane stress that pulls: its principal values where they are positive."""
    h, r = half_trace_and_radius(ufl.as_vector([S[0], S[1], 2 * S[2]]))
    high, low = (ufl.max_value(s, 0.0) for s in (h + r, h - r))
    mean, share = (high + low) / 2, (high - low) / (2 * r)
    return ufl.as_vector([mean + share * (S[0] - h), mean + share * (S[1] - h), share * S[2]])


def line_derivative(f: Expr) -> Expr:
    """f' along the reference length of a mesh of line elements."""
    J = ufl.Jacobian(ufl.domain.extract_unique_domain(f))[:, 0]
    return ufl.dot(ufl.grad(f), J / ufl.sqrt(ufl.dot(J, J)))


def bar_strain(x: Expr) -> Expr:
    """Green-Lagrange strain of a line, (ε,) with ε = ½(x'·x' - 1)."""
    dx = line_derivative(x)
    return ufl.as_vector([(ufl.dot(dx, dx) - 1) / 2])


def beam_strain(q: Expr) -> Expr:
    """Strains (ε, γ2, γ3, κ2, κ3, τ) of a beam q = (x, d2, d3).

    ε = ½(x'·x' - 1), γ_i = x'·d_i, κ_i = x'·d_i', τ = ½(d2'·d3 - d3'·d2).
    """
    dq = line_derivative(q)
    dx, dd2, dd3 = (ufl.as_vector([dq[3 * k + i] for i in range(3)]) for k in range(3))
    d2, d3 = (ufl.as_vector([q[3 * k + i] for i in range(3)]) for k in (1, 2))
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
