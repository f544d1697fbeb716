"""Membrane strain of thin plates of order 2 that neither locks nor leaves motions without stiffness, as UFL.

Where a plate bends, positions of order 2 cannot be isometric everywhere in a cell: strains at three points lock, at
one point they leave motions in the plane unresisted.  So the Green-Lagrange strain is interpolated in the Regge element
of degree 1 (Neunteufel & Schöberl, Comput. Methods Appl. Mech. Eng. 373 (2021) 113524,
doi:10.1016/j.cma.2020.113524): on each edge, with the vector τ along it, τ·E τ is replaced by its linear part, and its
mean over the cell is kept:

    τ·E τ = μ + b (λ₂ - λ₁) + 3 (μ - ē)(λ₀ - 1/3)

    c = ∂x/∂τ at the middle of the edge, d = ∂²x/∂τ²;  ē = ½(c·c + d·d/12 - τ·τ), b = ½ c·d;  μ the mean over the cell
    λ₁, λ₂ barycentric coordinates of the ends of the edge, λ₀ that of the vertex opposite

Strains that are linear in a cell stay as they are, so small motions in the plane have the stiffness of the film of
order 2.  Each strain is quadratic in x and invariant to rigid motions.
"""

from __future__ import annotations

import ufl
from dolfinx.mesh import Mesh
from ufl.geometry import CellVertices

from gossamer_fx.forms.kinematics import Expr


def tied_strain(domain: Mesh, x: Expr, B: Expr) -> Expr:
    """(E11, E22, 2 E12) in the frame B (3x2) of positions x of order 2, on plane triangles with straight edges."""
    X, all_vertices = ufl.SpatialCoordinate(domain), CellVertices(domain)
    v = [ufl.as_vector([all_vertices[i, j] for j in range(3)]) for i in range(3)]
    F, H = ufl.grad(x), ufl.grad(ufl.grad(x))
    normal = ufl.cross(v[1] - v[0], v[2] - v[0])
    λ = [
        ufl.dot(ufl.cross(v[i - 1] - v[i - 2], X - v[i - 2]), normal) / ufl.dot(normal, normal)
        for i in range(3)
    ]
    middles = [(v[i - 2] + v[i - 1]) / 2 for i in range(3)]

    def second(a: Expr, b: Expr) -> Expr:
        i, j, k = ufl.indices(3)
        return ufl.as_vector(H[i, j, k] * a[j] * b[k], i)

    tied, rows = [], []
    for i in range(3):
        τ = v[i - 1] - v[i - 2]
        along = [ufl.dot(F, τ) + second(τ, p - X) for p in middles]
        c, d, l2 = along[i], second(τ, τ), ufl.dot(τ, τ)
        edge = (ufl.dot(c, c) + ufl.dot(d, d) / 12 - l2) / 2
        mean = (sum(ufl.dot(a, a) for a in along) / 3 - l2) / 2
        tied.append(
            mean + ufl.dot(c, d) / 2 * (λ[i - 1] - λ[i - 2]) + 3 * (mean - edge) * (λ[i] - 1.0 / 3)
        )
        t = ufl.dot(B.T, τ)
        rows.append([t[0] ** 2, t[1] ** 2, t[0] * t[1]])
    return ufl.dot(ufl.inv(ufl.as_matrix(rows)), ufl.as_vector(tied))
