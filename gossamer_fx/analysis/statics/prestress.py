"""Prestress that was asked for, compared with the stress that is left in an equilibrium.

An initial stress or tension is that in the shape of the mesh.  Supports and booms that give way
take a part of it back, and loads change it.  In each cell the stress S that is reached is measured
along the initial stress S0:

    ratio = S·S0 / S0·S0

For film under the same stress in all directions this is the mean of both principal stresses over
that which was asked for; for film that is stressed in one direction the stress in this direction;
for a cable or beam its tension.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.axial_force import tension
from gossamer_fx.records.fields.body_shape import BodyShape
from gossamer_fx.records.fields.units import scaled
from gossamer_fx.solve.system.system import System

# Share of the prestress below which a warning says that it was given back.  Loads that a structure
# is made for change the stress by less.
SMALLEST_SHARE = 0.9

# Initial stress of a cell over the largest one, below which the cell has none: round-off.
NO_STRESS = 1e-9

# Mean of the initial stresses over the mean of their magnitudes, below which tension and
# compression cancel, so that a mean says nothing.
MIXED_SIGNS = 0.5

# Parts that the representation of a result names; of more only the one with the smallest share.
MAX_NAMED_PARTS = 3

# Strain at which the tension of a part without prestress counts: few films bear more.
LIKELY_STRAIN = 1e-2


@check_arguments
@dataclass(frozen=True)
class ReachedPrestress:
    """The prestress of a film, cable or beam: asked for, and reached in an equilibrium.

    Means are those over the area or the natural length that has an initial stress; the least and
    the largest value are those of its cells.

    Attributes:
        unit: "Pa" for films, "N" for cables and beams.
        asked: mean of the initial stress or tension; negative for compression.
        mean: of the remaining stress in the direction of the initial stress, or of the tension.
        least: least value of a cell.
        largest: largest value of a cell.

    Example:
        >>> film = gx.Membrane(mesh, law, initial_stress=2e5)
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
        >>> result = gx.Equilibrium(gx.Scene(film, *edges)).find()
        >>> print(result.prestress["film"])
        200 kPa asked for, 200 kPa reached (100 %; 200 kPa to 200 kPa)
    """

    unit: str
    asked: float
    mean: float
    least: float
    largest: float

    @property
    def ratio(self) -> float:
        """The remaining mean over the one that was asked for."""
        return self.mean / self.asked

    def __str__(self) -> str:
        """Both values, their ratio and the range in one line."""
        return (
            f"{self._words(self.asked)} asked for, {self._words(self.mean)} reached "
            f"({100 * self.ratio:.3g} %; {self._words(self.least)} to {self._words(self.largest)})"
        )

    def short(self) -> str:
        """Both means in few words, for a list of parts, e.g. "43.2 kPa of 50 kPa"."""
        return f"{self._words(self.mean)} of {self._words(self.asked)}"

    def _words(self, value: float) -> str:
        """A value with its unit, e.g. "43.2 kPa"; the prefix is that of the value asked for."""
        factor, prefix = scaled(abs(self.asked))
        return f"{value / factor:.3g} {prefix}{self.unit}"


class PrestressOfScene:
    """Compares the prestress of all items of a scene with the accepted state."""

    def __init__(self, system: System) -> None:
        """Compile the comparison for each part with prestress; none for other parts.
        Collective."""
        self._parts: dict[str, _PrestressOfPart] = {}
        for body in system.unknowns.bodies:
            if isinstance(body, MeshBody) and _asked_stress(body.full) is not None:
                self._parts[body.name] = _PrestressOfPart(system, body)

    def tensions(self) -> dict[str, float]:
        """The mean tension that was asked for by the names of parts: of films [N/m], of cables and
        beams [N]; the same on every rank."""
        return {name: part.tension for name, part in self._parts.items()}

    def reached(self) -> dict[str, ReachedPrestress]:
        """The prestress by the names of parts, the same on every rank.  Collective."""
        found = {}
        for name, part in self._parts.items():
            reached = part.reached()
            if reached is not None:
                found[name] = reached
        return found


class _PrestressOfPart:
    """The comparison of one film, cable or beam."""

    def __init__(self, system: System, body: MeshBody) -> None:
        self._comm = system.comm
        self._shape = BodyShape(system, body)
        part: Any = self._shape.body
        self._unit = "N"
        # A film has a tension per width.
        thickness = 1.0
        if isinstance(part, Membrane):
            self._unit = "Pa"
            thickness = part.constants.thickness
        mesh = part.space.mesh
        self._cells = mesh.topology.index_map(mesh.topology.dim).size_local
        cellwise = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
        v = ufl.TestFunction(cellwise)
        asked = _asked_stress(part)
        assert asked is not None
        reached = _reached_stress(self._shape)
        # Integrals over each cell: size, S0 and S0·S0, which are constant, and S·S0.
        densities = (v, _principal(asked) * v, _product(asked, asked) * v)
        self._initial_integrals = []
        for density in densities:
            self._initial_integrals.append(self._assembled(compile_form(density * part.dx)))
        self._product_form = compile_form(_product(reached, asked) * v * part.dx)
        tension = self._assembled(compile_form(thickness * _principal(asked) * v * part.dx))
        own_sums = np.array([tension.sum(), self._initial_integrals[0].sum()])
        total, size = self._comm.allreduce(own_sums)
        self.tension = float(total / size)

    def reached(self) -> ReachedPrestress | None:
        """The comparison in the accepted state; None if tension and compression cancel in the
        initial stress.  Collective."""
        self._shape.update()
        size, asked_integral, asked_square = self._initial_integrals
        product = self._assembled(self._product_form)
        asked = asked_integral / size
        largest_asked = float(np.abs(asked).max(initial=0.0))
        largest_asked = self._comm.allreduce(largest_asked, op=MPI.MAX)
        # Prestress by groups leaves out cells, which must not lower the means.
        has_stress = np.abs(asked) > NO_STRESS * largest_asked
        # The principal value of no stress is not exactly zero.
        has_stress &= asked_square > 0
        size = size[has_stress]
        asked = asked[has_stress]
        values = asked * product[has_stress] / asked_square[has_stress]
        own_sums = np.array([size.sum(), asked @ size, np.abs(asked) @ size, values @ size])
        total, asked_sum, magnitude_sum, sum_of_values = self._comm.allreduce(own_sums)
        if abs(asked_sum) <= MIXED_SIGNS * magnitude_sum:
            return None
        least = self._comm.allreduce(float(values.min(initial=np.inf)), op=MPI.MIN)
        largest = self._comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
        return ReachedPrestress(
            unit=self._unit,
            asked=float(asked_sum / total),
            mean=float(sum_of_values / total),
            least=least,
            largest=largest,
        )

    def _assembled(self, form: fem.Form) -> Array:
        """Integrals (n,) of a form over each of the n cells that this rank owns.  Collective."""
        vector = fem.assemble_vector(form)
        vector.scatter_reverse(la.InsertMode.add)
        return np.asarray(vector.array[: self._cells]).copy()


def likely_tensions(system: System) -> dict[str, float]:
    """The mean tension of each film [N/m], cable and beam [N] that is strained by a hundredth along
    its first direction, by their names; the same on every rank.  Collective."""
    tensions = {}
    for body in system.unknowns.bodies:
        if not isinstance(body, MeshBody):
            continue
        part: Any = body.full
        mesh = part.space.mesh
        strain = np.zeros(part.measure(fem.Function(part.space)).ufl_shape)
        strain[0] = LIKELY_STRAIN
        stress = energy_gradient(part.density, fem.Constant(mesh, strain))
        densities = (stress[0], constant(mesh, 1.0))
        own_sums = [fem.assemble_scalar(compile_form(one * part.dx)) for one in densities]
        total, size = system.comm.allreduce(np.array(own_sums))
        tensions[body.name] = float(total / size)
    return tensions


def lost_prestress_words(found: dict[str, ReachedPrestress]) -> str:
    """A warning of the parts that have lost more than a tenth of their prestress, of which it names
    `MAX_NAMED_PARTS`; empty if there are none."""
    lost = {name: one for name, one in found.items() if one.ratio < SMALLEST_SHARE}
    if not lost:
        return ""
    # The part that has lost most comes first.
    names = sorted(lost, key=lambda name: lost[name].ratio)
    words = []
    for name in names[:MAX_NAMED_PARTS]:
        words.append(f"'{name}' has {lost[name].short()} ({100 * lost[name].ratio:.3g} %)")
    if len(names) > MAX_NAMED_PARTS:
        words.append(f"and {len(names) - MAX_NAMED_PARTS} more below {100 * SMALLEST_SHARE:.0f} %")
    remedy = "support it more stiffly, or ask for more"
    if any(one.unit == "Pa" for one in lost.values()):
        remedy += "; a straight free edge of a film bears no stress, an arc with a cord does"
    return (
        "The prestress that was asked for is not reached, "
        f"as supports give way, or loads or heat relieve it: {', '.join(words)}; {remedy}."
    )


def _asked_stress(body: Any) -> Any:
    """The initial stress [Pa] of a film (3,) or tension [N] of a line (1,); None without
    prestress."""
    if isinstance(body, Membrane):
        if body.initial_strain is None:
            return None
        return _film_stress(body, body.initial_strain)
    if isinstance(body, Curve):
        force = body.initial_force
        if force is not None:
            return ufl.as_vector([force])
    return None


def _reached_stress(shape: BodyShape) -> Expr:
    """The stress [Pa] of a film (3,) or tension [N] of a line (1,) in the accepted state."""
    body = shape.body
    if isinstance(body, Membrane):
        return _film_stress(body, shape.elastic_strain())
    return ufl.as_vector([tension(shape)])


def _film_stress(film: Any, e: Expr) -> Expr:
    """Second Piola-Kirchhoff stress (S11, S22, S12) [Pa] of a film at a strain (3,)."""
    return energy_gradient(film.density, e) / film.constants.thickness


def _product(a: Expr, b: Expr) -> Expr:
    """The product A:B of two stresses, whose shear counts twice."""
    if a.ufl_shape == (1,):
        return a[0] * b[0]
    return a[0] * b[0] + a[1] * b[1] + 2 * a[2] * b[2]


def _principal(stress: Expr) -> Expr:
    """The principal value of the larger magnitude; of a line its tension."""
    if stress.ufl_shape == (1,):
        return stress[0]
    mean, radius = half_trace_and_radius(ufl.as_vector([stress[0], stress[1], 2 * stress[2]]))
    return ufl.conditional(ufl.ge(mean, 0), mean + radius, mean - radius)
