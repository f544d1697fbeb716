"""Probes of films: areas by state, accuracy of the surface, largest stress against its limit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from dolfinx import la
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import Direction, check_arguments, positive
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.mesh.linear_pieces import linear_pieces
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.best_surface import (
    Z_AXIS,
    Quantity,
    Samples,
    Surface,
    best_surface,
    cells_of,
    surface_slopes,
)
from gossamer_fx.records.fields.body_shape import At
from gossamer_fx.records.fields.fields import FieldFunctions
from gossamer_fx.records.fields.film_states import STATES, AreaFractions
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem, StateView

# What `SurfaceError` returns of a `BestSurface`, and its unit
SURFACE_UNITS: dict[Quantity, str] = {
    "rms": "m",
    "peak_to_valley": "m",
    "tilt": "rad",
    "radius": "m",
    "focal_length": "m",
}

# The field of each measure of a stress
Measure = Literal["principal", "von Mises"]
MEASURES = {"principal": "stress1", "von Mises": "von_mises_stress"}


@check_arguments
@dataclass(frozen=True)
class StressPeak:
    """The largest stress of a film.

    Attributes:
        stress: Cauchy stress [Pa], force over present thickness and length, as the fields `stress1`
            and `von_mises_stress`.
        point: where it is, (3,) [m] on the stress-free shape.
        ratio: of the stress to the limit that was given; None without one.

    Example:
        >>> equilibrium = gx.Equilibrium(gx.Scene(film))
        >>> peak = gx.analysis.largest_stress(equilibrium, film, limit=69e6)
        >>> abs(peak.ratio) < 1e-9, len(peak.point)
        (True, 3)
    """

    stress: float
    point: tuple[float, float, float]
    ratio: float | None = None


@check_arguments
def largest_stress(
    state: HasSystem,
    film: Membrane,
    *,
    limit: Annotated[float, positive("Pa")] | None = None,
    group: str = "",
    at: At = "mean",
    measure: Measure = "principal",
) -> StressPeak:
    """Find the largest stress of a film: force over its present thickness and length (Cauchy).
    Collective.

    At corners and point loads the stress of the continuum has no bound, and the largest one grows
    as the mesh is refined: leave them out by a group.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        film: a film of its scene.
        limit: what the material bears [Pa], e.g. `gx.presets.films.KAPTON_HN.yield_stress`.
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".
        measure: "principal", the larger principal stress, or "von Mises".

    Raises:
        InputError: the film is not in the scene, the group has no cells, or the limit is not
            positive.

    Example:
        >>> from gossamer_fx.presets.films import KAPTON_HN
        >>> pulled = gx.Membrane(mesh, law, displacement=lambda X: 1e-3 * X)
        >>> equilibrium = gx.Equilibrium(gx.Scene(pulled))
        >>> peak = gx.analysis.largest_stress(equilibrium, pulled, limit=KAPTON_HN.yield_stress)
        >>> f"{peak.stress / 1e6:.2f} MPa, {peak.ratio:.1%} of the limit"
        '3.79 MPa, 5.5% of the limit'
    """
    return StressSearch(film, group, at, measure)(state.system, limit)


class StressSearch:
    """Finds the largest stress of a film; its expression is compiled once a system."""

    def __init__(self, film: Membrane, group: str, at: At, measure: Measure) -> None:
        cells_of(film, group)  # refuses a group that the mesh does not have
        self._film = film
        self._group = group
        self._fields = ForSystem(
            lambda system: FieldFunctions(system, film, [MEASURES[measure]], at=at)
        )

    def __call__(self, system: System, limit: float | None) -> StressPeak:
        """The largest stress in the state of a system.  Collective."""
        cells = cells_of(self._film, self._group)
        count = system.comm.allreduce(len(cells))
        check_on_all(
            system.comm,
            count > 0,
            f"The group '{self._group}' of '{self._film.name}' has no triangles.",
        )
        fields = self._fields(system)
        fields.update()
        function = fields.functions[0]
        nodes = cell_nodes(function.function_space)[cells].ravel()
        values = function.x.array[nodes]
        largest = -math.inf
        point = np.zeros(3)
        if len(values):
            highest = int(np.argmax(values))
            largest = float(values[highest])
            point = function.function_space.tabulate_dof_coordinates()[nodes[highest]]
        # Of equal stresses, that of the lowest rank.
        stress, rank = system.comm.allreduce((largest, system.comm.rank), op=MPI.MAXLOC)
        x, y, z = system.comm.bcast(point, root=rank)
        ratio = stress / limit if limit else None
        return StressPeak(stress, (float(x), float(y), float(z)), ratio)


class _FilmArea:
    """What probes of the area of a film in a state share."""

    def __init__(
        self,
        body: Membrane,
        state: Literal["slack", "wrinkled", "taut"],
        *,
        group: str = "",
        at: At = "mean",
    ) -> None:
        cells_of(body, group)  # refuses a group that the mesh does not have
        self.state = state
        self._areas = AreaFractions([body], at, group)


@check_arguments
class AreaFraction(_FilmArea):
    """Share of a film's reference area that is slack, wrinkled or taut.

    A part that is taut over half of the last step counts by half.

    Args:
        body: the film.
        state: "slack", "wrinkled" or "taut".
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".

    Raises:
        InputError: the state is unknown; when called: the group has no cells.

    Example:
        >>> wrinkled = gx.probes.AreaFraction(film, "wrinkled")
    """

    def __call__(self, run: StateView) -> float:
        """The share in the state of a run, 0 to 1."""
        return float(self._areas(run.system)[STATES[self.state]])


@check_arguments
class StateArea(_FilmArea):
    """Reference area [m²] of a film that is slack, wrinkled or taut; arguments as `AreaFraction`.

    Args:
        body: the film.
        state: "slack", "wrinkled" or "taut".
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".

    Raises:
        InputError: the state is unknown; when called: the group has no cells.

    Example:
        >>> taut = gx.probes.StateArea(film, "taut", group="film")
        >>> round(taut(gx.Equilibrium(gx.Scene(film))), 12)
        1.0
    """

    unit = "m²"

    def __call__(self, run: StateView) -> float:
        """The area [m²] in the state of a run."""
        return float(self._areas.areas(run.system)[STATES[self.state]])


@check_arguments
class SurfaceError(Objective):
    """How far a film is from the plane, paraboloid or sphere that fits it best; see
    `gx.analysis.best_surface`.  All quantities at the end of a step have derivatives, e.g. for
    `gx.analysis.gradient`: by the positions of the nodes and by the areas that weight them.

    Args:
        film: the film.
        surface: "plane", "paraboloid" or "sphere".
        quantity: "rms", "peak_to_valley", "radius" or "focal_length" [m], or "tilt" [rad].  Of a
            flat film the radius and focal length are infinite, which a table refuses: record their
            inverse, `lambda run: 1 / focal_length(run)`.
        group: of cells of the film's mesh; empty: the whole film.
        axis: the designed axis.
        at: "end" of the last step, or "mean": the film in the middle of the step.

    Raises:
        InputError: another quantity; when called: what `best_surface` refuses.

    Example:
        >>> flatness = gx.probes.SurfaceError(film, "plane")
        >>> flatness(gx.Equilibrium(gx.Scene(film))) < 1e-15
        True
    """

    def __init__(
        self,
        film: Membrane,
        surface: Surface = "plane",
        *,
        quantity: Quantity = "rms",
        group: str = "",
        axis: Direction = Z_AXIS,
        at: At = "end",
    ) -> None:
        cells_of(film, group)  # refuses a group that the mesh does not have
        self.film = film
        self.surface: Surface = surface
        self.quantity: Quantity = quantity
        self.group = group
        self.axis = axis
        self.at: At = at
        self.unit = SURFACE_UNITS[quantity]

    def __call__(self, run: StateView) -> float:
        """The quantity in the state of a run."""
        found = best_surface(
            run,
            self.film,
            surface=self.surface,
            group=self.group,
            axis=self.axis,
            at=self.at,
        )
        return float(getattr(found, self.quantity))

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative by the positions; `InputError` where there is none, as of the error of
        a perfect surface."""
        check(
            self.at == "end",
            f'SurfaceError: the {self.quantity} at the "mean" has no derivative; take the "end".',
        )
        film = self.film
        samples = Samples.of(system, film, self.group, self.at)
        slopes = surface_slopes(samples, self.surface, self.quantity, self.axis)
        nodes = linear_pieces(film.full.space.dofmap.list[cells_of(film, self.group)], 2)
        dofs = film.space.dofmap
        b = la.vector(dofs.index_map, dofs.index_map_bs)
        b.array[:] = 0
        np.add.at(b.array.reshape(-1, 3), nodes.ravel(), slopes)
        b.scatter_reverse(la.InsertMode.add)
        with by_position as values:
            owned = system.unknowns.block(film).owned
            system.unknowns.coordinates[film].add_forces(b.array, values[owned])


@check_arguments
class LargestStress:
    """Largest Cauchy stress [Pa] in a film, or its ratio to the strength of the material; see
    `gx.analysis.largest_stress`.

    Args:
        film: the film.
        limit: [Pa], e.g. `KAPTON_HN.yield_stress`; with it the probe returns the ratio.
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".
        measure: "principal", the larger principal stress, or "von Mises".

    Raises:
        InputError: a limit that is not positive; when called: the group has no cells.

    Example:
        >>> stress = gx.probes.LargestStress(film, limit=69e6)
        >>> abs(stress(gx.Equilibrium(gx.Scene(film)))) < 1e-9
        True
    """

    def __init__(
        self,
        film: Membrane,
        *,
        limit: Annotated[float, positive("Pa")] | None = None,
        group: str = "",
        at: At = "mean",
        measure: Measure = "principal",
    ) -> None:
        self.limit = limit
        self.unit = "Pa" if limit is None else "1"
        self._search = StressSearch(film, group, at, measure)

    def __call__(self, run: StateView) -> float:
        """The stress [Pa], or its ratio to the limit, in the state of a run."""
        stress = self._search(run.system, self.limit).stress
        return stress / self.limit if self.limit else stress
