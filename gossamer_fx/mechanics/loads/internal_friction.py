"""Friction within a film, as between the yarns of a fabric or a braid: stress that depends on the
sense of the strain and not on its rate.

Problem.  A woven fabric that is loaded and unloaded goes back on a lower curve: yarns turn against
each other and slide where they cross.  The loss of a cycle does not depend on its frequency.

Idea.  Branches in parallel to the law of the film, each a spring k in series with a slider that
holds up to the force s.  A branch sees one strain of the film, a sum of its components in the axes
of the law,

    e = c1 E11 + c2 E22 + c12 2 E12,                                                             (1)

and slides by z:

    stress k (e - z),  |k (e - z)| <= s,    energy ½ k (e - z)²,    loss s |Δz|                  (2)

Along the straight path of a step from e0 to e1 the stress is k (e - z0) cut off at ±s, whose mean
is known in closed form:

    S_mean (e1 - e0) = ½ k (e1 - z1)² - ½ k (e0 - z0)² + s |z1 - z0|                             (3)

exactly, so that energy is conserved but for the loss, which is never negative.  e is quadratic in
the positions and does not change in rigid motions: momentum and angular momentum stay.  Several
branches make a hysteresis whose loops are those of Masing: the way back is the first loading with
both axes doubled.

In a search for rest the stress is that of one step from the equilibrium before: z follows when the
next search begins, so that the way of the search does not matter.  What is found depends on the way
of the loads, and increments of load have to be as small as that way is curved.

Limits.  Friction does not depend on the pressure between the yarns; give the limit that belongs to
it.  Branches resist wrinkles as well as tension.  A step in which a branch slides back and forth
counts as one way.

Source: of sliders in parallel, W. D. Iwan, J. Appl. Mech. 33 (1966) 893, doi:10.1115/1.3625199.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar, cast

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import NOT_ZERO, at_least, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.forms.cell_loops import tabulation
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import mean_of_positive_part
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.loads.branches import BranchEnergies, BranchForces, check_branches
from gossamer_fx.mechanics.materials.orthotropic import in_axes
from gossamer_fx.mechanics.terms.assembly import Compiler
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import ViscousDissipation


@check_arguments(as_many("stiffness", "limit"))
@dataclass(frozen=True, eq=False)
class InternalFriction(OnBody):
    """Friction within a film, e.g. between yarns: springs with sliders in parallel to its law.

    Each branch has the stress k (e - z) of a strain e of the film, up to ± its limit, beyond which
    z follows.  The loss counts as dissipated, the energy of the springs as stored.  At the start z
    is zero, or as far behind the strain as the limit allows: the film has come from its stress-free
    shape.

    Args:
        body: a film with a law that has a direction, e.g. `Fabric`, `Orthotropic`.
        strain: weights of E11, E22 and 2 E12 in the axes of the law, of which e is the sum: (0, 0,
            1) is the shear between warp and weft, (1, 0, 0) the strain of the warp.  Yarns at ±β
            from the first axis turn against each other by (cos² β, -sin² β, 0), to first order.
        stiffness: k [N/m] of each branch.
        limit: largest stress [N/m] of each branch.
        relaxed: whether the branches have no stress at the start instead, as in a fabric that was
            shaken in this state.
        name: name in messages and output.

    Raises:
        InputError: other numbers of stiffnesses and limits, none, one that is not positive; weights
            that are all zero; a law without a direction; a plate, or a body with thermal expansion.

    Example:
        >>> fabric = gx.LinearOrthotropic(
        ...     E1=2e8, E2=1e8, nu12=0.1, G12=1e6, density=900.0, thickness=2e-4,
        ...     direction=(1, 0, 0),
        ... )
        >>> film = gx.Membrane(mesh, fabric)
        >>> gx.loads.InternalFriction(
        ...     film, strain=(0, 0, 1), stiffness=(2e3, 500.0), limit=(10.0, 20.0)
        ... ).name
        'internal friction'
    """

    body: Membrane
    _: KW_ONLY
    strain: Annotated[tuple[float, float, float], NOT_ZERO]
    stiffness: Annotated[Sequence[Annotated[float, positive("N/m")]], at_least(1)]
    limit: Sequence[Annotated[float, positive("N/m")]]
    relaxed: bool = False
    name: str = "internal friction"

    def __post_init__(self) -> None:
        what = f"InternalFriction '{self.name}'"
        body = self.body
        check_branches(what, body)
        check(
            hasattr(body.law, "direction"),
            f"{what}: the law of '{body.name}' has no direction; use one that has, e.g. "
            "LinearOrthotropic.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        body = self.body
        yield SlidingEnergy(
            self.name,
            body,
            body.measure,
            body.density,
            body.dx,
            weights=self.strain,
            stiffness=tuple(self.stiffness),
            limit=tuple(self.limit),
            relaxed=self.relaxed,
        )


class SlidingEnergies(BranchEnergies):
    """All `SlidingEnergy` terms of a scene."""

    def _branch_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> SlidingForces:
        assert isinstance(term, SlidingEnergy)
        check(
            not rule.takes_mid_strain,
            f"'{term.name}': its stress depends on the strains at the ends of a step; "
            "run its scene with Midpoint.",
        )
        return SlidingForces(term, at, rule)

    def begin_search(self) -> None:
        for forces in self.branches:
            cast(SlidingForces, forces).slide()

    def shape_history(self) -> dict[str, Any]:
        # What has slid up to this state: the next search would begin with it, too.
        self.begin_search()
        return super().shape_history()

    def dissipated(self) -> Array:
        # Also in a search for rest: what has slid from one equilibrium to the next is lost.
        return np.array([forces.dissipated() for forces in self.branches])


@dataclass(frozen=True, eq=False)
class SlidingEnergy(ViscousDissipation):
    """Branches that slide: `weights` are those of (1), `stiffness` k and `limit` s [N/m] of each;
    `relaxed` ones have no stress at the start; `density` has no meaning."""

    _: KW_ONLY
    weights: tuple[float, float, float]
    stiffness: tuple[float, ...]
    limit: tuple[float, ...]
    relaxed: bool
    compiler: ClassVar[Compiler] = SlidingEnergies


class SlidingForces(BranchForces):
    """Stresses, loss and history of one `SlidingEnergy`; equations are those of the module.  The
    history variables are the z of each branch."""

    term: SlidingEnergy

    def __init__(self, term: SlidingEnergy, at: Coordinates, rule: StressRule) -> None:
        """Make the history, all zero, and compile.  Collective."""
        mesh = at.q1.function_space.mesh
        space = fem.functionspace(mesh, self._element(term, mesh, 1))
        # Numbers of the branches: others compile nothing.
        self._k = [constant(mesh, k) for k in term.stiffness]
        self._s = [constant(mesh, s) for s in term.limit]
        self._z = [fem.Function(space) for _ in term.stiffness]
        # The strain (1) at the start of the step
        self._e0 = fem.Function(space)
        weights = ufl.as_vector([constant(mesh, float(weight)) for weight in term.weights])
        assert isinstance(term.body, Membrane)
        c = term.body.constants
        # The gradient of (1), of which the strain in the axes is a linear function.
        self._slope = ufl.as_vector(
            [ufl.dot(weights, in_axes(ufl.unit_vector(m, 3), c)) for m in range(3)]
        )
        self._has_begun = False
        super().__init__(term, at, rule)
        self.history = [self._nothing(1) for _ in term.stiffness]
        # Of the accepted state: q1 may be that of a step which was solved and dropped.
        end = ufl.dot(self._slope, term.measure(at.q0))
        held = [self._held(number, end) for number in range(len(self._z))]
        energies = [k * u**2 / 2 for k, u in zip(self._k, held, strict=True)]
        self._energy = compile_form(sum(energies) * term.dx)
        self._slid = [fem.Function(space) for _ in term.stiffness]
        self._set_slid: list[Callable[[], None]] = []
        for number, slid in enumerate(self._slid):
            by = ufl.as_vector([self._slip(number, end)])
            self._set_slid.append(tabulation(by, slid))
        at_rest = [k * u for k, u in zip(self._k, held, strict=True)]
        self._set_end: Callable[[], None] = tabulation(sum(at_rest) * self._slope, self._shown)
        self._set_mean: Callable[[], None] = tabulation(
            self._stress_of(term.measure(at.q1)), self._shown
        )
        self._set_start: Callable[[], None] = tabulation(ufl.as_vector([end]), self._e0)

    def _slip(self, number: int, end: Expr) -> Expr:
        """z1 - z0 of a branch in a step that ends at the strain (1) `end`."""
        φ = self._s[number] / self._k[number]
        u = end - self._z[number][0]
        return ufl.max_value(u - φ, 0.0) - ufl.max_value(-u - φ, 0.0)

    def _held(self, number: int, end: Expr) -> Expr:
        """e - z of a branch at the end of that step, within ± s/k."""
        return end - self._z[number][0] - self._slip(number, end)

    def _set_stresses(self, strain: Expr, start: Expr) -> None:
        end = ufl.variable(strain)
        self.S = self._stress_of(end)
        self.D = ufl.diff(self.S, end)
        self.linear_stress = self.S + ufl.dot(self.D, self.measure - strain)

    def _stress_of(self, end: Expr) -> Expr:
        """The stress (3,) [N/m] of a step that ends at the strain (3,) `end`: the mean of (3), or
        that of its end."""
        e1 = ufl.dot(self._slope, end)
        total: Any = 0.0
        for number, k in enumerate(self._k):
            if not self._rule.conserves:
                total += k * self._held(number, e1)
                continue
            φ = self._s[number] / k
            u0 = self._e0[0] - self._z[number][0]
            u1 = e1 - self._z[number][0]
            # What is cut off at ±φ: the part above -φ less that above φ.
            above = mean_of_positive_part(u0 - φ, u1 - φ)
            total += k * (mean_of_positive_part(u0 + φ, u1 + φ) - above - φ)
        return total * self._slope

    def _loss(self, change: Expr) -> Expr:
        end = ufl.dot(self._slope, self.measure)
        # In a search z is that of the equilibrium before, and each pseudo-step adds to what slid.
        return sum(
            s * (abs(self._slip(number, end)) - abs(self._slip(number, self._e0[0])))
            for number, s in enumerate(self._s)
        )

    def begin_step(self, h: float) -> None:
        self._put_history()

    def _put_history(self) -> None:
        """Give the history variables to the forms."""
        for values, z in zip(self.history, self._z, strict=True):
            self._put(values, z)

    def commit(self) -> None:
        """Let z follow the strain at the end of a step in time, and that of the initial state."""
        if not self._has_begun and self.term.relaxed:
            self._set_start()
            for values in self.history:
                values[:] = self._values_of(self._e0)
        if self.in_step:
            self._put_history()
            self._set_mean()
            self.mean[:] = self._values_of(self._shown)
        is_step_in_time = self.in_step and not self._rule.is_static
        if is_step_in_time or not self._has_begun:
            self._has_begun = True
            self.slide()
        self._set_start()

    def slide(self) -> None:
        """Let z follow the strain of the accepted state."""
        self._put_history()
        for values, slid, set_slid in zip(self.history, self._slid, self._set_slid, strict=True):
            set_slid()
            values += self._values_of(slid)
        self._put_history()

    def show_end(self) -> None:
        self._put_history()
        self._set_end()

    def energy(self) -> float:
        self._put_history()
        return float(fem.assemble_scalar(self._energy))
