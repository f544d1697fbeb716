"""Bending of plates whose stress-free shape is flat, as UFL: the C0 interior penalty method for all components alike.

While strains are small the curvature tensor of the moved surface has |II|² = |D²x|², so the bending energy is the
quadratic form ½ a(x, x) of Engel et al. (Comput. Methods Appl. Mech. Eng. 191 (2002) 3669,
doi:10.1016/S0045-7825(02)00286-4)

    a(x, w) = ∫ M(x):D²w dA - Σ_edges ∫ ({m(x)}·[w,n] + {m(w)}·[x,n] - s [x,n]·[w,n]) ds

with the moment M(x) = D ((1-ν) D²x + ν tr(D²x) I), m = n·M n across an edge, x,n = ∂x/∂n along the outer conormal of
each cell (so that [x,n] is their sum) and {·} the mean of both cells.  It takes positions of order 2, is invariant to
rigid motions, and exact for isometric ones of any size.

For these M is constant in a cell of area A, so ∫ m² ds ≤ D l/A ∫ M:D²x dA on an edge of length l; with three edges a
cell a(x, x) ≥ 0 for s ≥ ¾ D l (1/A₊ + 1/A₋) on interior edges and s ≥ 3 D l/A on clamped ones, whatever the
triangles.  The penalty is `PENALTY` times that.

Of order 1 only the angles between cells are left.  The usual energy of such hinges, ½ D Σ 3 l²/(A₊ + A₋) θ²,
converges to what the pattern of the mesh makes of it: the cantilever under PL²/EI = 10 rises to 0.65 L on parallel and
alternating diagonals, 0.56 L on crossed ones, 0.60 L on an irregular mesh, and not to 0.81 L.
"""

from __future__ import annotations

from collections.abc import Callable

import ufl

from gossamer_fx.forms.kinematics import Expr

PENALTY = 1.5
DEGREE, EDGE_DEGREE = 0, 2  # D²x is constant in a cell, x,n linear along an edge


def second_gradient(x: Expr, B: Expr) -> Expr:
    """D²x (3, 2, 2): second derivatives of the positions x along the frame B (3x2) of a plane cell."""
    i, j, k, a, b = ufl.indices(5)
    return ufl.as_tensor(ufl.grad(ufl.grad(x))[i, j, k] * B[j, a] * B[k, b], (i, a, b))


def moment(H: Expr, D: Expr, ν: Expr) -> Expr:
    """D ((1-ν) H + ν tr(H) I) of a curvature H (2, 2)."""
    return D * ((1 - ν) * H + ν * ufl.tr(H) * ufl.Identity(2))


def curvature(x: Expr, B: Expr) -> Expr:
    """κ = n·D²x (2, 2) [1/m] of the moved surface, n its unit normal."""
    F = ufl.dot(ufl.grad(x), B)
    n, H = ufl.cross(F[:, 0], F[:, 1]), second_gradient(x, B)
    return ufl.as_matrix([[ufl.dot(n, H[:, a, b]) for b in range(2)] for a in range(2)]) / ufl.sqrt(
        ufl.dot(n, n)
    )


class Bending:
    """The bending of a plate: its forms.

    Args:
        domain: plane triangles with straight edges, B (3x2) their frame.
        D: bending stiffness E t³/(12 (1-ν²)) [N m], ν: Poisson's ratio.
        rest: curvature (2, 2) [1/m] of the plate without bending moments; none: flat.
    """

    def __init__(
        self, domain: ufl.Mesh, B: Expr, D: Expr, ν: Expr, penalty: Expr, rest: Expr | None = None
    ) -> None:
        self._B, self._D, self._ν, self._η, self.rest = B, D, ν, penalty, rest
        self._n, self._length, self._area = (
            ufl.FacetNormal(domain),
            ufl.FacetArea(domain),
            ufl.CellVolume(domain),
        )

    # ---- the quadratic form --------------------------------------------------------------------------------------

    def cells(self, x: Expr, w: Expr, dx: ufl.Measure) -> ufl.Form:
        """The cells' part of a(x, w)."""
        H, G = second_gradient(x, self._B), second_gradient(w, self._B)
        return (
            sum(ufl.inner(moment(H[i, :, :], self._D, self._ν), G[i, :, :]) for i in range(3)) * dx
        )

    def edges(self, x: Expr, w: Expr, dS: ufl.Measure) -> ufl.Form:
        """The part of a(x, w) of interior edges that transmit bending."""
        s = (
            0.75
            * self._η
            * self._length("+")
            * sum((self._D / self._area)(side) for side in ("+", "-"))
        )
        dx, dw = jump(self.slope, x), jump(self.slope, w)
        m, mw = mean(self._edge_moment, x), mean(self._edge_moment, w)
        return (s * ufl.dot(dx, dw) - ufl.dot(m, dw) - ufl.dot(mw, dx)) * dS

    def clamp(self, x: Expr, w: Expr, d: Expr, ds: ufl.Measure) -> ufl.Form:
        """The part of a(x, w) of edges of the rim where the plate is tangent to the unit vector d (3,)."""
        dx, dw = (u - ufl.dot(u, d) * d for u in (self.slope(x), self.slope(w)))
        s = 3 * self._η * self._length * self._D / self._area
        form = (
            s * ufl.dot(dx, dw)
            - ufl.dot(self._edge_moment(x), dw)
            - ufl.dot(self._edge_moment(w), dx)
        )
        if self.rest is not None:  # -m0 (n·d), n the normal x,n × x,t
            form -= self._across(self.rest_moment) * sum(
                ufl.dot(ufl.cross(self.slope(u), self._along(v)), d) for u, v in ((x, w), (w, x))
            )
        return form * ds

    # ---- rest curvature ------------------------------------------------------------------------------------------

    @property
    def rest_moment(self) -> Expr:
        """M0 (2, 2), the moment of the rest curvature."""
        return moment(self.rest, self._D, self._ν)

    def rest_energy(self, dx: ufl.Measure) -> ufl.Form:
        """½∫ M0:H0 dA: the energy of the flat plate."""
        return ufl.inner(self.rest_moment, self.rest) / 2 * dx

    def rest_in_cells(self, x: Expr) -> tuple[Expr, Expr, Expr]:
        """Three vectors (3,) whose triple product is -M0:(n·D²x), n = x,1 × x,2."""
        F, H, M0 = ufl.dot(ufl.grad(x), self._B), second_gradient(x, self._B), self.rest_moment
        return F[:, 0], F[:, 1], -sum(M0[a, b] * H[:, a, b] for a in range(2) for b in range(2))

    def rest_at_edges(self, x: Expr) -> tuple[Expr, Expr, Expr]:
        """Three vectors (3,) whose triple product is {m0} n·[x,n], the same with n = x,n × x,t of either cell."""
        m0 = (self._across(self.rest_moment)("+") + self._across(self.rest_moment)("-")) / 2
        return self.slope(x)("+"), self._along(x)("+"), m0 * self.slope(x)("-")

    # ---- on an edge ----------------------------------------------------------------------------------------------

    def slope(self, x: Expr) -> Expr:
        """x,n (3,), n the outer conormal."""
        return ufl.dot(ufl.grad(x), self._n)

    def edge_normal(self, x: Expr) -> Expr:
        """x,n × x,t (3,): the normal of the surface at the edge."""
        return ufl.cross(self.slope(x), self._along(x))

    def _along(self, x: Expr) -> Expr:
        """x,t (3,), along the edge: (n, t, normal of the mesh) is right-handed."""
        return ufl.dot(ufl.grad(x), ufl.cross(ufl.cross(self._B[:, 0], self._B[:, 1]), self._n))

    def _across(self, M: Expr) -> Expr:
        """n·M n."""
        n = ufl.dot(self._B.T, self._n)
        return ufl.dot(n, ufl.dot(M, n))

    def _edge_moment(self, x: Expr) -> Expr:
        """m(x) (3,)."""
        H = second_gradient(x, self._B)
        return ufl.as_vector([self._across(moment(H[i, :, :], self._D, self._ν)) for i in range(3)])


def jump(of: Callable[[Expr], Expr], x: Expr) -> Expr:
    """Sum of a quantity whose sign is that of the side."""
    return of(x)("+") + of(x)("-")


def mean(of: Callable[[Expr], Expr], x: Expr) -> Expr:
    return (of(x)("+") + of(x)("-")) / 2
