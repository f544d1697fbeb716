"""Membrane strain of thin plates with positions of order 2, as a UFL expression, free of locking
and of zero modes.

Problem.  Where a plate bends, positions of order 2 cannot be isometric everywhere in a cell.
Membrane strains that are sampled at three points then resist bending (membrane locking); strains
sampled at one point leave motions within the plane without stiffness.

Idea.  Interpolate the Green-Lagrange strain E in the Regge element of degree 1, whose degrees of
freedom are the tangential strains τ·E τ along the edges τ.  On each edge τ·E τ, which is quadratic,
is replaced by a linear function, and its mean over the cell is kept:

    τ·E τ = μ + b (λ₂ - λ₁) + 3 (μ - ē)(λ₀ - 1/3)                                                (1)

    c = ∂x/∂τ at the middle of the edge,  d = ∂²x/∂τ²
    ē = ½(c·c + d·d/12 - τ·τ)      mean of τ·E τ along the edge                                  (2)
    b = ½ c·d                      half the difference between its ends                          (3)
    μ                              mean of τ·E τ over the cell (4)
    λ₁, λ₂                         barycentric coordinates of the ends of the edge
    λ₀                             barycentric coordinate of the vertex opposite

Strains that are linear in a cell are reproduced, so small motions in the plane have the stiffness
of a film of order 2.  Each strain is quadratic in x and does not change under rigid motions.

Source: M. Neunteufel & J. Schöberl, Comput. Methods Appl. Mech. Eng. 373 (2021) 113524.
"""

from __future__ import annotations

import ufl
from dolfinx.mesh import Mesh
from ufl.geometry import CellVertices

from gossamer_fx.core.forms.kinematics import Expr


def tied_strain(domain: Mesh, x: Expr, B: Expr) -> Expr:
    """Green-Lagrange strain (E11, E22, 2 E12) of a plate with positions x (3,) [m] of order 2 on
    plane triangles with straight edges, in their cell axes B (3, 2), linear in each cell and free
    of membrane locking.

    The tangential strains along the edges, which are quadratic, are replaced by linear functions
    with the same mean over the cell (M. Neunteufel & J. Schöberl, Comput. Methods Appl. Mech. Eng.
    373 (2021) 113524).  In the code X is a point of the cell, F and H are the first and second
    derivatives of x there; the other symbols are those of the module.

    >>> import basix.ufl
    >>> import ufl
    >>> from gossamer_fx.core.forms.kinematics import cell_axes
    >>> triangles = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,)))
    >>> quadratic = basix.ufl.element("Lagrange", "triangle", 2, shape=(3,))
    >>> x = ufl.Coefficient(ufl.FunctionSpace(triangles, quadratic))
    >>> tied_strain(triangles, x, cell_axes(triangles)).ufl_shape
    (3,)
    """
    X = ufl.SpatialCoordinate(domain)
    all_vertices = CellVertices(domain)
    vertices = []
    for i in range(3):
        components = [all_vertices[i, j] for j in range(3)]
        vertices.append(ufl.as_vector(components))
    F = ufl.grad(x)
    H = ufl.grad(ufl.grad(x))

    # Edge i lies opposite vertex i; it leads from vertex i - 2 to vertex i - 1, counted modulo 3.
    def edge(i: int) -> Expr:
        """Vector (3,) [m] along edge i."""
        return vertices[i - 1] - vertices[i - 2]

    middles = [(vertices[i - 2] + vertices[i - 1]) / 2 for i in range(3)]
    normal = ufl.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    λ = []
    for i in range(3):
        area = ufl.dot(ufl.cross(edge(i), X - vertices[i - 2]), normal)
        λ.append(area / ufl.dot(normal, normal))

    def second_derivative(a: Expr, b: Expr) -> Expr:
        """∂²x/∂a∂b (3,) along two vectors (3,); it is constant in a cell."""
        i, j, k = ufl.indices(3)
        return ufl.as_vector(H[i, j, k] * a[j] * b[k], i)

    tangential_strains = []
    rows = []
    for i in range(3):
        τ = edge(i)
        # ∂x/∂τ at the middles of all edges: x is quadratic, so its gradient continues linearly from
        # the point X.
        at_middles = [ufl.dot(F, τ) + second_derivative(τ, middle - X) for middle in middles]
        c = at_middles[i]
        d = second_derivative(τ, τ)
        length_square = ufl.dot(τ, τ)
        edge_mean = (ufl.dot(c, c) + ufl.dot(d, d) / 12 - length_square) / 2  # equation (2)
        # The middles of the edges integrate quadratic functions exactly.
        squares = sum(ufl.dot(a, a) for a in at_middles)
        cell_mean = (squares / 3 - length_square) / 2  # equation (4)
        b = ufl.dot(c, d) / 2  # equation (3)
        between_ends = b * (λ[i - 1] - λ[i - 2])
        towards_vertex = 3 * (cell_mean - edge_mean) * (λ[i] - 1.0 / 3)
        tangential_strains.append(cell_mean + between_ends + towards_vertex)  # equation (1)
        # τ·E τ = t1² E11 + t2² E22 + t1 t2 (2 E12), with the components t of τ in the cell axes.
        t = ufl.dot(B.T, τ)
        row = [
            t[0] ** 2,
            t[1] ** 2,
            t[0] * t[1],
        ]
        rows.append(row)

    # Three tangential strains determine the three components of E.
    to_components = ufl.inv(ufl.as_matrix(rows))
    return ufl.dot(to_components, ufl.as_vector(tangential_strains))
