"""The rule that discretises energies in time, and its mixed Newton iteration; nothing else knows it.

One step from q0 to q1 of length h, q̄ = (1-α) q0 + α q1, with a quadratic measure e(q):

    residual   ∫ S̄·De(q̄)[w] dx,     S̄ = stress rule(e0, e1)

`PathAverage` (α = ½) takes S̄ = ∫₀¹ ψ'(e0 + s(e1 - e0)) ds.  Then S̄·(e1 - e0) = ψ(e1) - ψ(e0) and
De(q̄)(q1 - q0) = e1 - e0, so energy is conserved; invariance of e conserves momentum and angular momentum.  The
average of a convex ψ is the gradient of a convex function of e1: its tangent is symmetric and positive semi-definite,
so a film that switches between taut, wrinkled and slack does not make Newton's iteration cycle.  The integral is exact
where the law tells the pieces of the path between which its state switches, and taken with Gauss points elsewhere; what
is missed, c = (Δψ - S̄·Δe)/(Δe·Δe), is added along Δe, and its derivative to the tangent.  Gauss points miss so much
that the tangent gets indefinite: on fine meshes a slack film is so soft that the iteration then cycles.

`EndPoint` (α = 1) takes S̄ = ψ'(e1): statics, and steppers to compare with.

Mixed iteration (Magisano, Leonetti & Garcea, IJNME 109 (2017) 1237, doi:10.1002/nme.5328): the strain ê at the
quadrature points is a variable of its own, condensed:

    residual   ∫ (S̄(ê) + D̄(ê)(e(q1) - ê))·De(q̄)[w] dx
    tangent    ∫ D̄ De(q1)[δ]·De(q̄)[w] + α S̄(ê)·D²e[δ, w] dx
    update     ê = e(q1) - ½ D²e[δ, δ]     the *linearised* strain of the last iterate

(S̄, D̄) are evaluated once an iteration, by compiled expressions, and the forms only read them.  A path that stays in one
state has an expression of its own, which costs a third to a sixth of the one for all paths.

Measured on the free sheet of `demos/spinning_sheet.py` by `demos/studies/stress_rule.py`; its table is in README.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce
from typing import Any, Protocol

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.checks.errors import check
from gossamer_fx.forms.compilation import compile_expression, compile_form, constant
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.strain_path import gradient as gradient
from gossamer_fx.model.terms import Array, Dissipation, Indices, StoredEnergy

ROUND_OFF = 4 * np.finfo(float).eps  # of a difference of energies, over their sum

# Of the mixed iteration: stiffness of what surrounds a point, over the largest of its own; error of the linearised
# stress, over the stress, from which on the strain is chosen; iterations after which it no longer is, lest they cycle.
SURROUNDINGS, FAR, CHOSEN = 0.03, 0.1, 12


class StressRule(Protocol):
    """How the stress of a step follows from the strains at its ends."""

    @property
    def alpha(self) -> float:
        """Weight of the end in the configuration q̄ at which forces act."""
        ...

    def stress(self, part: StoredEnergy, e0: Expr, e1: Expr) -> Expr:
        """S̄, an expression of e0 and the UFL variable e1."""
        ...

    def cases(self, part: StoredEnergy, e0: Expr, e1: Expr) -> list[tuple[Expr, Expr]]:
        """Conditions under which S̄ costs less, and S̄ under each of them; the first that holds counts."""
        return []


@dataclass(frozen=True)
class PathAverage(StressRule):
    """Stress averaged along the straight path in strain space; see the module.

    `points` of Gauss serve the laws that do not tell the pieces of the path.
    """

    points: int = 10
    alpha = 0.5

    def __post_init__(self) -> None:
        check(self.points >= 1, f"PathAverage: points is {self.points!r}; take at least one Gauss point.")

    def stress(self, part: StoredEnergy, e0: Expr, e1: Expr) -> Expr:
        ψ, Δe = part.density, e1 - e0
        if part.quadratic:
            return gradient(ψ, (e0 + e1) / 2)
        S = ufl.zero(Δe.ufl_shape)
        # where the pieces meet they have the same stress, so that the places need not be derived
        pieces = part.pieces(e0, e1.expression()) if part.pieces else []
        for piece in pieces:
            S += (piece.end - piece.start) * piece.stress(e0 + piece.start * Δe, e0 + piece.end * Δe)
        if not pieces:
            for p, w in zip(*np.polynomial.legendre.leggauss(self.points), strict=True):
                S += float(w) / 2 * gradient(ψ, e0 + float(1 + p) / 2 * Δe)
        return S + defect(ψ, S, e0, e1)

    def cases(self, part: StoredEnergy, e0: Expr, e1: Expr) -> list[tuple[Expr, Expr]]:
        """Paths that stay in one state: six of ten in the iterations of a film that flutters, seven before it does."""
        if part.quadratic or not part.pieces:
            return []
        lengths: dict[Callable[[Expr, Expr], Expr], list[Expr]] = {}
        for piece in part.pieces(e0, e1.expression()):
            lengths.setdefault(piece.stress, []).append(piece.end - piece.start)
        found = []
        for stress, parts in lengths.items():
            S = stress(e0, e1)
            found.append((ufl.ge(sum(parts[1:], parts[0]), 1.0), S + defect(part.density, S, e0, e1)))
        return found


@dataclass(frozen=True)
class EndPoint(StressRule):
    """Stress at the end of the step."""

    alpha = 1.0

    def stress(self, part: StoredEnergy, e0: Expr, e1: Expr) -> Expr:
        return gradient(part.density, e1)


def defect(ψ: Any, S: Expr, e0: Expr, e1: Expr) -> Expr:
    """What S lacks of conserving energy exactly, along Δe.

    Left out is what may be the round-off of the energies, and what belongs to |Δe| < 1e-5 |e|: along Δe it would be a
    noise of the stress, which keeps a film that is taut all the way (where nothing is missing) from converging.
    """
    Δe = e1 - e0
    Δe2 = ufl.dot(Δe, Δe)
    smallest = ufl.max_value(1e-10 * (ufl.dot(e0, e0) + ufl.dot(e1, e1)), 1e-40)
    ψ0, ψ1 = ψ(e0), ψ(e1)
    missing, noise = ψ1 - ψ0 - ufl.dot(S, Δe), ROUND_OFF * (ψ0 + ψ1)
    missing -= ufl.max_value(ufl.min_value(missing, noise), -noise)
    return ufl.conditional(ufl.gt(Δe2, smallest), missing / ufl.max_value(Δe2, smallest), 0.0) * Δe


class Coordinates:
    """The coordinates of one mesh body in a step: start q0, end q1, increment δ of the iteration, step h."""

    def __init__(self, space: fem.FunctionSpace, alpha: float) -> None:
        self.q0, self.q1, self.δ = (fem.Function(space) for _ in range(3))
        self.α = constant(space.mesh, alpha)
        self.h = constant(space.mesh, 1.0)
        self.mid = (1 - self.α) * self.q0 + self.α * self.q1
        self.w, self.dq = ufl.TestFunction(space), ufl.TrialFunction(space)


class ElementForces:
    """Forces, tangent and energy of one `StoredEnergy` or `Dissipation` part, compiled."""

    def __init__(self, part: StoredEnergy | Dissipation, at: Coordinates, rule: StressRule) -> None:
        self.part = part
        q, w, dq, δ = at.q1, at.w, at.dq, at.δ
        e = part.measure(q)
        De = ufl.derivative(e, q, w)
        De_mid = ufl.replace(De, {q: at.mid})
        De_dq = ufl.derivative(e, q, dq)
        D2e = ufl.derivative(De, q, dq)
        D2e_δδ = ufl.derivative(ufl.derivative(e, q, δ), q, δ)

        m = e.ufl_shape[0]
        mesh, metadata = at.q1.function_space.mesh, part.dx.metadata()
        element = _quadrature_element(mesh, metadata, (m,))
        Q = fem.functionspace(mesh, element)
        self._e0, self._ê = fem.Function(Q), fem.Function(Q)
        self._response = fem.Function(fem.functionspace(mesh, _quadrature_element(mesh, metadata, (m + m * m,))))
        S = ufl.as_vector([self._response[i] for i in range(m)])
        D = ufl.as_matrix([[self._response[m + i * m + j] for j in range(m)] for i in range(m)])

        ê = ufl.variable(self._ê)
        if isinstance(part, StoredEnergy):
            S̄ = rule.stress(part, self._e0, ê)
            cases = rule.cases(part, self._e0, ê)
            self._energy = compile_form(part.density(self._e0) * part.dx)
        else:
            S̄, cases = gradient(part.density, (ê - self._e0) / at.h), []
            self._work = compile_form(ufl.dot(S, self._ê - self._e0) * part.dx)
        points = Q.element.interpolation_points()
        stresses = [S̄, *(S for _, S in cases)]  # the first serves every point
        self._responses = [compile_expression(_with_derivative(S, ê), points) for S in stresses]
        if cases:
            case: Expr = ufl.as_ufl(0.0)
            for k, (holds, _) in reversed(list(enumerate(cases, 1))):
                case = ufl.conditional(holds, float(k), case)
            self._case = compile_expression(case, points)
        self._strain = compile_expression(e, points)
        linearised = e - D2e_δδ / 2
        self._linearised = compile_expression(linearised, points)
        cells = mesh.topology.index_map(mesh.topology.dim)
        self._cells = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        self._size = m
        self._switches = isinstance(part, StoredEnergy) and not part.quadratic and rule.alpha == 0.5
        if self._switches:
            self._expected = fem.Function(fem.functionspace(mesh, _quadrature_element(mesh, metadata, (2 * m + 2,))))
            change, stiffness = linearised - self._ê, _largest(D[i, i] for i in range(m))
            σ = S + ufl.dot(D, change)
            numbers = [*linearised, *σ, stiffness, ufl.sqrt(ufl.dot(change, change))]
            self._expect = compile_expression(ufl.as_vector(numbers), points)
            σ = [self._expected[m + i] for i in range(m)]
            misses = _largest(abs(S[i] - σ[i]) for i in range(m))
            stress = _largest(abs(s) for i in range(m) for s in (S[i], σ[i]))
            resistance = SURROUNDINGS * ufl.max_value(stiffness, self._expected[2 * m])
            self._resist = compile_expression(ufl.conditional(ufl.gt(misses, FAR * stress), resistance, 0.0), points)
        self._before = self._e0.x.array.copy()
        self._known = 0

        self.residual = compile_form(ufl.dot(S + ufl.dot(D, e - self._ê), De_mid) * part.dx)
        self.tangent = compile_form((ufl.dot(ufl.dot(D, De_dq), De_mid) + at.α * ufl.dot(S, D2e)) * part.dx)

    def begin(self) -> None:
        """Start a step: of its stress nothing is known yet."""
        self._known = 0

    def accept(self) -> None:
        """End a step: the strain of its end is that of the next one's start."""
        self._before[:] = self._e0.x.array
        self._e0.x.array[:] = self._ê.x.array

    def linearise(self) -> None:
        """ê from the strain at the last iterate and its linear change by δ; then the stress."""
        if not self._switches or self._known > CHOSEN:
            self._tabulate(self._linearised, self._ê)
            self._respond()
        elif not self._known:
            self._ê.x.array[:] = self._before
            self._respond()
        else:
            self._choose()
        self._known += 1

    def evaluate(self) -> None:
        """ê = e(q1): the true strain; then the stress."""
        self._tabulate(self._strain, self._ê)
        self._respond()

    def _choose(self) -> None:
        """ê between the linearised strain and the one that has the linearised stress; see the module."""
        m, mesh = self._size, self._ê.function_space.mesh
        self._tabulate(self._expect, self._expected)
        expected, e = self._expected.x.array.reshape(-1, 2 * m + 2), self._ê.x.array.reshape(-1, m)
        e[:] = expected[:, :m]
        self._respond()
        resistance = self._resist.eval(mesh, self._cells)
        is_far = resistance > 0
        far = self._ê.function_space.dofmap.list[is_far]
        S, D = np.split(self._response.x.array.reshape(-1, m + m * m)[far], [m], axis=1)
        K = D.reshape(-1, m, m) + resistance[is_far][:, None, None] * np.eye(m)
        change = np.linalg.solve(K, (expected[far, m : 2 * m] - S)[..., None])[..., 0]
        room = expected[far, -1] / np.maximum(np.linalg.norm(change, axis=1), 1e-300)
        e[far] += np.minimum(1, room)[:, None] * change
        self._respond(self._cells[is_far.any(axis=1)])

    def _respond(self, cells: Indices | None = None) -> None:
        """(S̄, D̄) in some cells (or all), by the cheapest expression that serves all points of a cell."""
        cells, (general, *special) = self._cells if cells is None else cells, self._responses
        if special:
            case = self._case.eval(self._ê.function_space.mesh, cells)
            case = np.where((case == case[:, :1]).all(axis=1), case[:, 0], 0)
            for k, expression in enumerate(special, 1):
                self._tabulate(expression, self._response, cells[case == k])
            cells = cells[case == 0]
        self._tabulate(general, self._response, cells)

    def _tabulate(self, expression: fem.Expression, at_points: fem.Function, cells: Indices | None = None) -> None:
        """The expression at the quadrature points of some cells (or all), as `interpolate` but without its copies."""
        cells, dofmap = self._cells if cells is None else cells, at_points.function_space.dofmap
        places, values = dofmap.list[cells], expression.eval(at_points.function_space.mesh, cells)
        at_points.x.array.reshape(-1, dofmap.index_map_bs)[places] = values.reshape(*places.shape, dofmap.index_map_bs)

    def energy(self) -> float:
        """Owned share of the stored energy at the last accepted state."""
        return float(fem.assemble_scalar(self._energy))

    def dissipated(self) -> float:
        """Owned share of the energy that this part takes in the step; before `accept`."""
        return float(fem.assemble_scalar(self._work))

    @property
    def strain(self) -> Array:
        """Strains at the quadrature points, owned and ghost."""
        array: Array = self._ê.x.array
        return array


def _with_derivative(S: Expr, e: Expr) -> Expr:
    """S and dS/de, row after row, as one vector."""
    m, D = S.ufl_shape[0], ufl.diff(S, e)
    return ufl.as_vector([S[i] for i in range(m)] + [D[i, j] for i in range(m) for j in range(m)])


def _largest(numbers: Iterable[Expr]) -> Expr:
    return reduce(ufl.max_value, numbers)


def _quadrature_element(mesh: Any, metadata: dict[str, Any], shape: tuple[int, ...]) -> Any:
    return basix.ufl.quadrature_element(
        mesh.basix_cell(), value_shape=shape, degree=metadata["quadrature_degree"], scheme="default"
    )
