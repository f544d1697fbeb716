"""A cable law from a table of measured forces against strains.

Problem.  The force of a braided or laid rope is measured in a test, as points (strain, force).  An
energy-conserving step needs the potential of this force, and its average along the path of a step,
which may pass several corners of the table.

Idea.  With x = λ - 1 the engineering strain, the piecewise linear force through the points is a sum
of forces that act on one side of a corner only,

    N(x) = Σ_i c_i s_i ⟨s_i (x - x_i)⟩,    ⟨y⟩ = max(y, 0),                                   (1)

where c_i is the change of slope at the corner x_i; s_i = 1 for x_i >= 0, and -1 for the corners
in compression.  Its potential is piecewise quadratic,

    W(x) = Σ_i ½ c_i ⟨s_i (x - x_i)⟩²,                                                        (2)

and its average from x0 to x1 follows term by term from that of ⟨y⟩, which has a closed form
(`terms.rows`).  The strain measure of the step is ε = ½(λ² - 1).  Since Δε = ½(λ0 + λ1)
Δx, the stress with S Δε = ΔW is the averaged force over the mean of both stretches,

    S = N_mean / (½(λ0 + λ1)).                                                                (3)

Nothing is divided by a small difference.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.core.checks.arguments import (
    NOT_FALLING,
    RISING,
    Column,
    Curve,
    at_least,
    check_arguments,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import Piece, mean_of_positive_part
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.cable import (
    BarLaw,
    LineDensity,
    engineering_strain,
)
from gossamer_fx.mechanics.bodies.piecewise_force import Corners, corners_of

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.cord_hysteresis import Hysteresis

# Force at zero strain, as a fraction of the largest force, that counts as zero.
ZERO_FORCE = 1e-9

# Force of an unloading curve over its largest one below which a cord counts as slack: measured
# curves end in a long toe of nearly no force, from which cycles would gain energy.
SLACK_FORCE = 2e-3


@check_arguments(as_many("strain", "force"))
@dataclass(frozen=True)
class TabulatedCable(BarLaw):
    """A bar whose force is piecewise linear between measured points (strain, force).

    Its force N(x) depends on the engineering strain x = λ - 1, the change of length over the
    natural length.  The stored energy per natural length is W = ∫ N dx, piecewise quadratic, and is
    integrated exactly also where a step passes corners of the table.

    Beyond its last point the table goes on with its last slope.  In compression a table that begins
    at zero strain bears nothing; one with negative strains goes on with its first slope.

    With `unloading` it is the law of a tape with hysteresis: below the largest strain so far the
    force follows the unloading curve, moved so that its end is where the loading curve was left,
    down to zero force.  What a cycle loses is dissipated by the name of the tape.  The module
    `cord_hysteresis` has equations, sources and limits.

    Args:
        strain: engineering strains, rising, above -1; zero lies among or between them.
        force: [N], as many; not falling, zero at zero strain, positive in tension.
        line_density: mass per natural length [kg/m], positive.
        unloading: strains and forces of the unloading curve, two columns as `strain` and `force`
            from zero on, where forces below 0.2 % of the largest count as slack; default: that of
            loading, without a loss.
        unloading_rule: "moved" as above, or "scaled": the whole unloading curve is scaled in both
            axes, from the origin, to where the loading curve was left.  Then the slope after a
            reversal depends on the force there, and a fixed part of the strain is not recovered.

    Raises:
        InputError: columns of different length, fewer than two points, strains that do not rise,
            forces that fall, a force at zero strain, unloading that would gain energy.

    Example:
        A rope that stiffens beyond 2 % and bears no compression:

        >>> rope = gx.TabulatedCable([0.0, 0.02, 0.05], [0.0, 100.0, 700.0], line_density=0.01)
        >>> rope.force_at(np.array([-0.01, 0.01, 0.03])).tolist()
        [0.0, 50.0, 300.0]
    """

    strain: Annotated[Column, at_least(2), RISING]
    force: Annotated[Column, NOT_FALLING]
    _: KW_ONLY
    line_density: LineDensity
    unloading: Curve | None = None
    unloading_rule: Literal["moved", "scaled"] = "moved"

    def __post_init__(self) -> None:
        strain = np.asarray(self.strain, dtype=float)
        force = np.asarray(self.force, dtype=float)
        _check_table(strain, force)
        object.__setattr__(self, "strain", tuple(strain.tolist()))
        object.__setattr__(self, "force", tuple(force.tolist()))
        if self.unloading is not None:
            strain, force = (np.asarray(column, dtype=float) for column in self.unloading)
            _check_table(strain, force)
            columns = tuple(strain.tolist()), tuple(force.tolist())
            object.__setattr__(self, "unloading", columns)
            check(
                strain[0] == 0,
                f"TabulatedCable: the unloading curve begins at the strain {strain[0]:g}; "
                "begin it at zero, where it has no force.",
            )
            self.hysteresis.check_losses(self.strain[-1])

    @property
    def has_history(self) -> bool:
        """Whether the force depends on the strains of the past."""
        return self.unloading is not None

    @cached_property
    def hysteresis(self) -> Hysteresis:
        """The law with its unloading curve, which must have been given."""
        # Imported here: a scene without hysteresis does not load it.
        from gossamer_fx.mechanics.bodies.cord_hysteresis import (
            hysteresis_of,
            scaled_hysteresis_of,
        )

        assert self.unloading is not None
        strain, force = (np.asarray(column) for column in self.unloading)
        # The last point that counts as slack is where the curve begins.
        slack = int(np.flatnonzero(force <= SLACK_FORCE * force[-1])[-1])
        start = float(strain[slack])
        strain = strain[slack:] - start
        force = np.append(0.0, force[slack + 1 :])
        unloading = corners_of(strain, force)
        if self.unloading_rule == "scaled":
            return scaled_hysteresis_of(self.corners, unloading, float(strain[-1]), start)
        return hysteresis_of(self.corners, unloading, float(strain[-1]))

    @property
    def EA(self) -> float:
        """Axial stiffness [N] at zero strain in tension; stiffness damping uses it."""
        tension = self.corners.of_side(1)
        at_zero = np.asarray(tension.strains) == 0
        return float(np.sum(tension.slope_changes, where=at_zero))

    @cached_property
    def corners(self) -> Corners:
        """The corners of the force, equation (1) of the module."""
        return corners_of(np.asarray(self.strain), np.asarray(self.force))

    @check_arguments
    def force_at(self, strain: Array) -> Array:
        """Force [N] at engineering strains, an array of any shape."""
        return self.corners.force(np.asarray(strain, dtype=float))

    def constants(self, mesh: DolfinxMesh) -> SimpleNamespace:
        """The corners as constants of a mesh: another table of as many corners compiles nothing."""
        corners = self.corners
        return SimpleNamespace(
            line_density=constant(mesh, self.line_density),
            EA=constant(mesh, self.EA),
            strains=fem.Constant(mesh, corners.strains),
            slope_changes=fem.Constant(mesh, corners.slope_changes),
        )

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy [J/m] of the Green-Lagrange strain e = (ε,), equation (2) of the module."""
        x = engineering_strain(e)
        total = ufl.as_ufl(0.0)
        # A sum over corners, not a search of the segment: UFL has no branches with a table.
        for i, side in enumerate(self.corners.sides):
            beyond = ufl.max_value(float(side) * (x - c.strains[i]), 0.0)
            total += c.slope_changes[i] / 2 * beyond**2
        return total

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """One piece, the whole path, whose average (3) is exact."""
        return [Piece(0.0, 1.0, lambda ea, eb: self._mean_stress(ea, eb, c))]

    def _mean_stress(self, e0: Expr, e1: Expr, c: Any) -> Expr:
        """Mean stress S (1,) [N] of a step, equation (3) of the module, from the Green-Lagrange
        strains e0 and e1 (1,) at its ends."""
        # Engineering strains x0 and x1; s is the side, 1 or -1, of zero strain of a corner.
        x0 = engineering_strain(e0)
        x1 = engineering_strain(e1)
        # Sides are part of the kernel, as there are two of them; strains and slopes are constants.
        force = ufl.as_ufl(0.0)
        for i, side in enumerate(self.corners.sides):
            s = float(side)
            mean = mean_of_positive_part(s * (x0 - c.strains[i]), s * (x1 - c.strains[i]))
            force += c.slope_changes[i] * s * mean
        # Δε = λ_mean Δλ: a force along λ is divided by it to be a stress along ε.
        mean_stretch = 1 + (x0 + x1) / 2
        return ufl.as_vector([force / mean_stretch])


def _check_table(strain: Array, force: Array) -> None:
    """Raise `InputError` unless measured points are a force law: two or more engineering strains
    (n,), rising from at most zero and above -1 to a positive one, and forces [N] (n,) that do not
    fall, are zero at zero strain and positive from there on."""
    check(
        strain[0] > -1 and strain[0] <= 0 < strain[-1],
        f"TabulatedCable: the strains go from {strain[0]:g} to {strain[-1]:g}; "
        "begin at zero or between -1 and zero, and end in tension.",
    )
    at_rest = float(np.interp(0.0, strain, force))
    largest = float(np.abs(force).max())
    check(
        largest > 0 and abs(at_rest) <= ZERO_FORCE * largest,
        f"TabulatedCable: the force at zero strain is {at_rest:g} N and the largest {largest:g} N; "
        "give zero there, "
        "and a force elsewhere.",
    )
    zero = int(np.searchsorted(strain, 0.0, side="right"))
    check(
        force[zero] > 0,
        f"TabulatedCable: the force is zero up to the strain {strain[zero]:g}; "
        "begin to pull at zero strain (a longer cable has its slack in its mesh).",
    )


def _first(found: npt.NDArray[np.intp]) -> int:
    """The first of some indices, counted from one; zero if there is none, as messages are also
    formatted where nothing is wrong."""
    return int(found[0]) + 1 if len(found) else 0
