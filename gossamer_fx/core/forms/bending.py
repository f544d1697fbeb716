"""Bending energy of plates by the C0 interior penalty method, as UFL forms.

Problem.  Positions of order 2 are continuous across the edges of triangles, but their slopes are
not; so the curvature has no square-integrable meaning across an edge, where a plate nevertheless
transmits moments.

Method.  While strains are small the curvature tensor II of the moved surface has |II|² = |D²x|²,
with D²x the second derivatives of the positions x.  For a plate whose stress-free shape is flat the
bending energy is therefore the quadratic form ½ a(x, x) of Engel et al., applied to each component
of x alike:

    a(x, w) = ∫ M(x):D²w dA - Σ_edges ∫ ({m(x)}·[w,n] + {m(w)}·[x,n] - s [x,n]·[w,n]) ds         (1)

    M(x) = D ((1-ν) D²x + ν tr(D²x) I)    bending moment [N], D = E t³/(12 (1-ν²)) [N m]         (2)
    m = n·M n                             bending moment across an edge
    x,n = ∂x/∂n                           slope along the outer conormal n of each cell, so that the
                                          jump [x,n] is the sum of both sides
    {·}                                   mean of both cells

It is invariant to rigid motions, and exact for isometric ones of any size.

Penalty.  M is constant in a cell of area A, so on an edge of length l ∫ m² ds ≤ (D l/A) ∫ M:D²x dA.
With three edges a cell a(x, x) ≥ 0, whatever the triangles, for

    s ≥ ¾ D l (1/A₊ + 1/A₋)    on interior edges,    s ≥ 3 D l/A    on clamped edges.            (3)

The penalty is `PENALTY` times that bound.

Orthotropic plates.  M = D:D²x with a tensor of stiffnesses (`OrthotropicBending`), without coupling
to the membrane strain (B = 0).  By the inequality of Cauchy and Schwarz m² ≤ D_nn M:D²x with D_nn =
(n⊗n):D:(n⊗n), so that the bound (3) holds with D_nn in place of D.

Rest curvature.  A plate that is free of moments with the curvature H0 has the energy ½ a(x, x) - ∫
M0:κ dA + const., with M0 the moment of H0, and κ = n·D²x the curvature of the moved surface.  The
normal n makes these terms triple products of vectors (`Bending.rest_in_cells`,
`Bending.rest_at_edges`).

Curved plates.  The stress-free shape x0 is of order 2 on the plane triangles between its corners,
and H0 = n0·D²x0.  Three changes make x0, wherever it is turned, free of energy and of forces:

    ∇²x = D²x - F (F0⁺ D²x0)    in place of D²x: second derivatives in the metric of x0          (4)
    x,ν with |x0,ν| = 1 and x0,ν·x0,t = 0    in place of x,n                                     (5)
    [x,ν] - [x0,ν], turned with the plate    in place of [x,n]: x0 has small kinks of angle θ0   (6)

with F = ∂x and the pseudo-inverse F0⁺ of F0 = ∂x0.  While lengths are those of x0, ∇²x is the
curvature times the normal (the Christoffel symbols belong to the metric, not to the shape).  For
kinks (6) is a multiple of the two products of `rest_at_edges`, whose derivatives vanish at x0.
The products of M0 with n = x,1 × x,2/|x0,1 × x0,2| grow with the area.  So that this leaves no
membrane stress at x0, M0:H0 times half the trace of the metric of x in that of x0 is added, the
same in cells and at kinks.

Limits.  Positions of order 1 leave only the angles between cells.  The usual energy of such hinges,
½ D Σ 3 l²/(A₊ + A₋) θ², converges to a value that depends on the pattern of the mesh: the tip of a
cantilever under PL²/EI = 10 rises to 0.65 L on parallel and alternating diagonals, 0.56 L on
crossed ones and 0.60 L on an irregular mesh, instead of 0.81 L.

Source: G. Engel et al., Comput. Methods Appl. Mech. Eng. 191 (2002) 3669.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import ufl

from gossamer_fx.core.forms.kinematics import Expr

# Factor on the bound (3): above 1 the form is definite; larger values only make it stiffer and
# worse conditioned.
PENALTY = 1.5

# Polynomial degree of the integrands: D²x is constant in a cell, x,n linear along an edge.
DEGREE = 0
EDGE_DEGREE = 2


def second_gradient(x: Expr, B: Expr) -> Expr:
    """Second derivatives D²x (3, 2, 2) [1/m] of positions x (3,) along the cell axes B (3, 2) of a
    plane cell.
    """
    i, j, k, a, b = ufl.indices(5)
    H = ufl.grad(ufl.grad(x))
    return ufl.as_tensor(H[i, j, k] * B[j, a] * B[k, b], (i, a, b))


def moment(H: Expr, D: Expr, ν: Expr) -> Expr:
    """Bending moment D ((1-ν) H + ν tr(H) I) (2, 2) [N] of a curvature H (2, 2) [1/m], with the
    bending stiffness D [N m] and Poisson's ratio ν.

    >>> import ufl
    >>> cylinder = ufl.as_matrix([[1.0, 0.0], [0.0, 0.0]])
    >>> M = moment(cylinder, D=2.0, ν=0.25)
    >>> M[0, 0](()), M[1, 1](())
    (2.0, 0.5)
    """
    return D * ((1 - ν) * H + ν * ufl.tr(H) * ufl.Identity(2))


class BendingStiffness(Protocol):
    """How bending moments follow from curvatures, in the cell axes."""

    @property
    def reference(self) -> Expr:
        """A positive stiffness [N m], by which integrands are made dimensionless."""

    def moment(self, H: Expr) -> Expr:
        """Bending moment (2, 2) of a curvature (2, 2)."""

    def across(self, n: Expr) -> Expr:
        """Stiffness (n⊗n):D:(n⊗n) [N m] of bending along a unit vector n (2,)."""


@dataclass(frozen=True, eq=False)
class IsotropicBending:
    """The bending stiffness D = E t³/(12 (1-ν²)) [N m] of an isotropic plate, and its Poisson's
    ratio ν."""

    D: Expr
    ν: Expr

    @property
    def reference(self) -> Expr:
        return self.D

    def moment(self, H: Expr) -> Expr:
        return moment(H, self.D, self.ν)

    def across(self, n: Expr) -> Expr:
        return self.D


@dataclass(frozen=True, eq=False)
class OrthotropicBending:
    """The bending stiffnesses D11, D12, D22, D66 [N m] of an orthotropic plate in its axes, without
    coupling to the membrane strain:

        M1 = D11 κ1 + D12 κ2,    M2 = D12 κ1 + D22 κ2,    M12 = 2 D66 κ12

    `cosine` and `sine` are of the angle of the first axis in the cell axes.
    """

    D11: Expr
    D12: Expr
    D22: Expr
    D66: Expr
    cosine: Expr
    sine: Expr

    @property
    def reference(self) -> Expr:
        return self.D11

    @property
    def _axes(self) -> Expr:
        """The axes as columns (2, 2), in the cell axes."""
        return ufl.as_matrix([[self.cosine, -self.sine], [self.sine, self.cosine]])

    def moment(self, H: Expr) -> Expr:
        """Moments (2, 2) [N] of symmetric curvatures H (2, 2) [1/m], both in the cell axes;
        Q (2, 2) has the axes of the material as columns."""
        Q = self._axes
        κ = ufl.dot(Q.T, ufl.dot(H, Q))
        M1 = self.D11 * κ[0, 0] + self.D12 * κ[1, 1]
        M2 = self.D12 * κ[0, 0] + self.D22 * κ[1, 1]
        M12 = 2 * self.D66 * κ[0, 1]
        return ufl.dot(Q, ufl.dot(ufl.as_matrix([[M1, M12], [M12, M2]]), Q.T))

    def across(self, n: Expr) -> Expr:
        a = ufl.dot(self._axes.T, n)
        mixed = 2 * (self.D12 + 2 * self.D66)
        return self.D11 * a[0] ** 4 + mixed * a[0] ** 2 * a[1] ** 2 + self.D22 * a[1] ** 4


def curvature(x: Expr, B: Expr) -> Expr:
    """Curvature κ = n·D²x (2, 2) [1/m] of the moved surface, n its unit normal, in the cell axes B
    (3, 2) of the mesh; zero for positions x (3,) [m] of order 1."""
    F = ufl.dot(ufl.grad(x), B)
    normal = ufl.cross(F[:, 0], F[:, 1])
    H = second_gradient(x, B)
    rows = []
    for a in range(2):
        row = [ufl.dot(normal, H[:, a, b]) for b in range(2)]
        rows.append(row)
    return ufl.as_matrix(rows) / ufl.sqrt(ufl.dot(normal, normal))


class Bending:
    """Bending forms [J] of one plate of plane triangles with straight edges; equation numbers are
    those of the module.

    B (3, 2) are the cell axes, `penalty` the factor on the bound (3), `rest` the
    curvature (2, 2) [1/m] of the plate without bending moments, None for a flat plate, `shape` the
    stress-free positions x0 of a curved one.  In the methods x (3,) [m] are positions of order 2, w
    a test function like x; the degree of measures of cells is `DEGREE`, of edges `EDGE_DEGREE`.
    """

    def __init__(
        self,
        domain: ufl.Mesh,
        B: Expr,
        stiffness: BendingStiffness,
        penalty: Expr,
        rest: Expr | None = None,
        shape: Expr | None = None,
    ) -> None:
        self._B = B
        self._shape = shape
        self._stiffness = stiffness
        self._penalty = penalty
        self.rest = rest
        self._n = ufl.FacetNormal(domain)
        self._length = ufl.FacetArea(domain)
        self._area = ufl.CellVolume(domain)

    # ---- the quadratic form ----------------------------------------------------------------------

    def cells(self, x: Expr, w: Expr, dx: ufl.Measure) -> ufl.Form:
        """Integral ∫ M(x):D²w dA over the cells; the bending energy is half of it with w = x."""
        H = self._second_gradient(x)
        G = self._second_gradient(w)
        densities = []
        for i in range(3):
            M = self._moment(H[i, :, :])
            densities.append(ufl.inner(M, G[i, :, :]))
        if self._shape is not None:
            stretch = ufl.dot(self._gradient(x), ufl.inv(self._metric))
            densities.append(self._bent_shape() * ufl.inner(stretch, self._gradient(w)))
        return sum(densities) * dx

    def edges(self, x: Expr, w: Expr, dS: ufl.Measure) -> ufl.Form:
        """Integral over interior edges that transmit bending: moments times jumps of slopes, and a
        penalty on the jumps with the factor s [N], the second term of (1)."""
        s = self._edge_penalty()
        jump_x = jump(self.slope, x)
        jump_w = jump(self.slope, w)
        moment_x = mean(self._edge_moment, x)
        moment_w = mean(self._edge_moment, w)
        penalty_term = s * ufl.dot(jump_x, jump_w)
        work_of_moments = ufl.dot(moment_x, jump_w)
        # The transposed term makes the form symmetric.
        work_of_test_moments = ufl.dot(moment_w, jump_x)
        form = penalty_term - work_of_moments - work_of_test_moments
        if self._shape is not None:
            form += self._stretch_at_kinks(x, w)
        return form * dS

    def clamp(self, x: Expr, w: Expr, d: Expr, ds: ufl.Measure) -> ufl.Form:
        """Integral over boundary edges where the plate is tangent to a unit vector d (3,), with
        that of a rest curvature (`rest_clamp`)."""
        # The jump is the part of the slope perpendicular to d; along d the slope is free.
        slope_x = self.slope(x)
        slope_w = self.slope(w)
        jump_x = slope_x - ufl.dot(slope_x, d) * d
        jump_w = slope_w - ufl.dot(slope_w, d) * d
        s = 3 * self._penalty * self._length * self._edge_stiffness() / self._area
        form = (
            s * ufl.dot(jump_x, jump_w)
            - ufl.dot(self._edge_moment(x), jump_w)
            - ufl.dot(self._edge_moment(w), jump_x)
        )
        if self.rest is not None:
            return form * ds + self.rest_clamp(x, w, d, self.rest, ds)
        return form * ds

    def rest_clamp(self, x: Expr, w: Expr, d: Expr, rest: Expr, ds: ufl.Measure) -> ufl.Form:
        """The part of `clamp` that a rest curvature (2, 2) [1/m] adds; half of it with w = x is the
        energy -∫ m0 n·d ds."""
        # -m0 (n·d), with the normal n = x,n × x,t of the surface at the edge, which is bilinear in
        # x.
        m0 = self._across(self._moment(rest))
        normal_x = ufl.cross(self.slope(x), self._along(w))
        normal_w = ufl.cross(self.slope(w), self._along(x))
        return -m0 * (ufl.dot(normal_x, d) + ufl.dot(normal_w, d)) * ds

    # ---- rest curvature --------------------------------------------------------------------------

    @property
    def rest_moment(self) -> Expr:
        """Moment M0 (2, 2) [N] of the rest curvature, equation (2)."""
        return self._moment(self.rest)

    def rest_energy(self, dx: ufl.Measure) -> ufl.Form:
        """Energy ½∫ M0:H0 dA [J] of the plate when it is held flat."""
        return ufl.inner(self.rest_moment, self.rest) / 2 * dx

    def rest_in_cells(self, x: Expr) -> tuple[Expr, Expr, Expr]:
        """Three vectors whose triple product is -M0:(n·D²x), the energy of a rest curvature in
        cells: x,1 and x,2 (3,) [-], and -M0:D²x (3,) [N/m].  M0 [N] is the moment of the rest
        curvature, n = x,1 × x,2 the normal in the cell axes."""
        F = self._gradient(x)
        # The normal removes what (4) subtracts.
        H = second_gradient(x, self._B)
        M0 = self.rest_moment
        pairs = [(a, b) for a in range(2) for b in range(2)]
        third = -sum(M0[a, b] * H[:, a, b] for a, b in pairs)
        if self._shape is not None:
            third /= ufl.sqrt(ufl.det(self._metric))
        return F[:, 0], F[:, 1], third

    def rest_at_edges(self, x: Expr) -> tuple[Expr, Expr, Expr]:
        """Three vectors whose triple product is {m0} n·[x,n], the energy of a rest curvature at
        edges: x,n and x,t (3,) [-] of the cell "+", and {m0} x,n (3,) [N] of the cell "-".

        {m0} is the mean of both sides of the moment m0 [N] of the rest curvature across the edge,
        [x,n] the jump of the slope.  The normal n = x,n × x,t of either cell gives the same
        product.  With the kinks θ0 of a curved plate the product is

            ({m0} - s sin θ0) n·[x,ν]/cos θ0 + 2 tan(½θ0) n·{m(x)}.
        """
        n_here = self.slope(x)("+")
        t_here = self._along(x)("+")
        n_there = self.slope(x)("-")
        m0 = mean(self._across, self.rest_moment)
        if self._shape is None:
            return n_here, t_here, m0 * n_there
        sine, cosine = self._kink()
        of_jump = (m0 - self._edge_penalty() * sine) / cosine * n_there
        of_moment = 2 * sine / (1 + cosine) * mean(self._edge_moment, x)
        return n_here, t_here, of_jump + of_moment

    def shape_energy(self, dx: ufl.Measure, dS: ufl.Measure) -> ufl.Form:
        """Constant [J] that, together with `rest_energy`, makes the energy of a curved plate zero
        in its stress-free shape: minus the energy of `cells`, `edges` and the terms of its rest
        curvature there, without `rest_energy`."""
        _, cosine = self._kink()
        return -self._bent_shape() * dx + self._kink_energy() * (1 / cosine - 2) * dS

    # ---- in a cell -------------------------------------------------------------------------------

    def _gradient(self, x: Expr) -> Expr:
        """F (3, 2) of positions x along the cell axes."""
        return ufl.dot(ufl.grad(x), self._B)

    @property
    def _metric(self) -> Expr:
        """Metric (2, 2) of the shape of a curved plate in the cell axes."""
        F0 = self._gradient(self._shape)
        return ufl.dot(F0.T, F0)

    def _bent_shape(self) -> Expr:
        """M0:H0 [J/m²] of the shape of a curved plate."""
        H0 = curvature(self._shape, self._B)
        return ufl.inner(self._moment(H0), H0)

    def _second_gradient(self, x: Expr) -> Expr:
        """D²x (3, 2, 2) [1/m] in the cell axes, of a curved plate ∇²x by (4)."""
        H = second_gradient(x, self._B)
        if self._shape is None:
            return H
        F = self._gradient(x)
        pseudo_inverse = ufl.dot(ufl.inv(self._metric), self._gradient(self._shape).T)
        H0 = second_gradient(self._shape, self._B)
        i, k, a, b, c = ufl.indices(5)
        Γ = ufl.as_tensor(pseudo_inverse[c, k] * H0[k, a, b], (c, a, b))
        return H - ufl.as_tensor(F[i, c] * Γ[c, a, b], (i, a, b))

    # ---- on an edge ------------------------------------------------------------------------------

    def slope(self, x: Expr) -> Expr:
        """Slope x,n (3,) along the outer conormal n of the cell; x,ν of a curved plate."""
        if self._shape is None:
            return ufl.dot(ufl.grad(x), self._n)
        n = ufl.dot(self._B.T, self._n)
        ν = ufl.dot(ufl.inv(self._metric), n)
        return ufl.dot(self._gradient(x), ν) / ufl.sqrt(ufl.dot(n, ν))

    def edge_normal(self, x: Expr) -> Expr:
        """Normal x,n × x,t (3,) of the moved surface at the edge."""
        return ufl.cross(self.slope(x), self._along(x))

    def _along(self, x: Expr) -> Expr:
        """Derivative x,t (3,) along the edge; (n, t, normal of the mesh) is right-handed."""
        mesh_normal = ufl.cross(self._B[:, 0], self._B[:, 1])
        t = ufl.cross(mesh_normal, self._n)
        if self._shape is None:
            return ufl.dot(ufl.grad(x), t)
        t0 = ufl.dot(ufl.grad(self._shape), t)
        return ufl.dot(ufl.grad(x), t) / ufl.sqrt(ufl.dot(t0, t0))

    def _across(self, M: Expr) -> Expr:
        """Component n·M n of a tensor (2, 2) across the edge."""
        n = ufl.dot(self._B.T, self._n)
        return ufl.dot(n, ufl.dot(M, n))

    def _edge_stiffness(self) -> Expr:
        """Stiffness [N m] of bending across the edge."""
        return self._stiffness.across(ufl.dot(self._B.T, self._n))

    def _edge_penalty(self) -> Expr:
        """Factor s [N] of the penalty on interior edges, a multiple of the bound (3)."""
        stiffness_per_area = sum((self._edge_stiffness() / self._area)(side) for side in ("+", "-"))
        return 0.75 * self._penalty * self._length("+") * stiffness_per_area

    def _kink(self) -> tuple[Expr, Expr]:
        """Sine and cosine of the angle θ0 between both sides of an edge of a curved plate."""
        x0 = self._shape
        n_there = self.slope(x0)("-")
        sine = ufl.dot(self.edge_normal(x0)("+"), n_there)
        return sine, -ufl.dot(self.slope(x0)("+"), n_there)

    def _stretch_at_kinks(self, x: Expr, w: Expr) -> Expr:
        """What removes the membrane stress that the other terms of the kinks leave in the shape of
        a curved plate: stretches of x,ν on both sides and of x,t, each with its factor [N]."""
        sine, cosine = self._kink()
        m0 = self._across(self.rest_moment)
        of_penalty = self._edge_penalty() * (1 - cosine)
        # `rest_at_edges` has the normal of the cell "+" only.
        here = of_penalty - sine * (m0("+") + m0("-") / 2)
        there = of_penalty - sine * m0("-") / 2
        along = 2 * of_penalty - sine * (m0("+") + m0("-"))
        slope_x = self.slope(x)
        slope_w = self.slope(w)
        of_slopes = here * ufl.dot(slope_x, slope_w)("+") + there * ufl.dot(slope_x, slope_w)("-")
        return of_slopes + along * ufl.dot(self._along(x), self._along(w))("+")

    def _kink_energy(self) -> Expr:
        """½ s θ0² - {m0} θ0 [J/m] for small kinks θ0 of a curved plate."""
        sine, cosine = self._kink()
        m0 = mean(self._across, self.rest_moment)
        return self._edge_penalty() * (1 - cosine) - m0 * sine

    def _edge_moment(self, x: Expr) -> Expr:
        """Bending moment m(x) (3,) [N] across the edge, for each component of the positions."""
        H = self._second_gradient(x)
        components = []
        for i in range(3):
            M = self._moment(H[i, :, :])
            components.append(self._across(M))
        return ufl.as_vector(components)

    def _moment(self, H: Expr) -> Expr:
        """Bending moment (2, 2) of a curvature (2, 2) with the stiffness of this plate, equation
        (2).
        """
        return self._stiffness.moment(H)


def jump(of: Callable[[Expr], Expr], x: Expr) -> Expr:
    """Sum over both sides of an edge of a quantity `of` x that changes its sign with the side, such
    as a slope."""
    return of(x)("+") + of(x)("-")


def mean(of: Callable[[Expr], Expr], x: Expr) -> Expr:
    """Mean over both sides of an edge of a quantity `of` x."""
    return (of(x)("+") + of(x)("-")) / 2
