"""Likely causes why an equilibrium was not found, from what the scene contains, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import attach
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.mesh.enclosed_volume import Enclosed, enclosed_by
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.loads.pressure import Pressure
from gossamer_fx.solve.system.system import System

# Residual stiffness below which the wrinkles of a film of order 2 have no equilibrium on many
# meshes.
SOFT_RESIDUAL_STIFFNESS = 1e-2

# Temperature of a gas over that of its start, below which it has expanded into a volume that it
# does not fill.
COOLED = 0.95

# Sum of the loads over the sum of their magnitudes, below which they balance each other.
BALANCED = 1e-6


@dataclass(frozen=True)
class PressedFilm:
    """A pressure of the scene, and what the stress-free shape of its film encloses."""

    pressure: Pressure
    enclosed: Enclosed


@dataclass(frozen=True)
class CollapsingPressure:
    """A pressure that presses a film together: the cause and the remedy in words, and whether the
    normals of the film point inwards."""

    words: str
    is_inwards: bool


def remedies(
    system: System, chambers: Mapping[str, Any], pressed_films: Iterable[PressedFilm]
) -> str:
    """Sentences about likely causes, in the state that was reached last, and what to do; empty if
    none is known.  Collective."""
    found = [
        *_unsupported(system),
        *(pressure.words for pressure in collapsing_pressures(pressed_films, system.unknowns.time)),
        *_gas_that_cooled(chambers),
        *_open_films(system, pressed_films),
        *_soft_films(system),
    ]
    if not system.equations.active_sets:
        found.append(
            "If the load has a limit, or the scene snaps through: gx.analysis.path follows its "
            "equilibria by the arc length."
        )
    return "".join(f"  {sentence}" for sentence in found)


def _unsupported(system: System) -> Iterator[str]:
    """Yield a sentence if no coordinate of the scene is held, it has no constraints or obstacles,
    and its loads do not balance each other.  Collective."""
    held = system.comm.allreduce(len(system.unknowns.supports.held))
    if held or system.equations.constraints is not None:
        return
    # What lies on an obstacle is supported by contact.
    if any(getattr(item, "obstacles", ()) for item in system.unknowns.items):
        return
    size = 3 * len(system.unknowns.position_marks)
    forces = system.equations.external_forces().array_r[:size].reshape(-1, 3)
    of_positions = forces * system.unknowns.position_marks[:, None]
    sums = np.append(of_positions.sum(axis=0), np.abs(of_positions).sum())
    total: Array = system.comm.allreduce(sums, op=MPI.SUM)
    if np.linalg.norm(total[:3]) > BALANCED * total[3]:
        yield (
            "Nothing in the scene is supported, and its loads do not balance each other: "
            "hold it by gx.Fixed."
        )


def measure_pressed_films(system: System) -> list[PressedFilm]:
    """Measure what the films under a pressure of the scene enclose.  Collective."""
    found = []
    for item in system.unknowns.items:
        if isinstance(item, Pressure):
            mesh = item.body.mesh
            found.append(PressedFilm(item, enclosed_by(mesh.domain, mesh.edges)))
    return found


def collapsing_pressures(
    pressed_films: Iterable[PressedFilm], at: float
) -> Iterator[CollapsingPressure]:
    """Yield the pressures at a time [s] that press films with an inside together.  Collective."""
    for pressed in pressed_films:
        item = pressed.pressure
        enclosed = pressed.enclosed
        film = item.body
        pressure = _pressure_at(item, at)
        if not enclosed.has_inside or enclosed.volume * pressure >= 0:
            continue
        kind = "closed film"
        if enclosed.rims:
            kind = "film with small open rims"
        # A negative pressure on normals that point outwards may be meant: suction.
        is_inwards = enclosed.volume < 0
        if is_inwards:
            cause = "the normals of its mesh point inwards"
            remedy = (
                "turn all its triangles (orient=True when the mesh is made or read, "
                "or model.mesh.reverse() of gmsh), or change the sign of the pressure"
            )
        else:
            cause = "the pressure is negative and the normals of its mesh point outwards"
            remedy = "change the sign of the pressure"
        words = (
            f"'{item.name}' presses the {kind} '{film.name}' together, "
            f"as {cause} (mesh.enclosed_volume() is {enclosed.volume:.3g} m³): {remedy}."
        )
        yield CollapsingPressure(words, is_inwards)


def _open_films(system: System, pressed_films: Iterable[PressedFilm]) -> Iterator[str]:
    """Yield a sentence for each film under a pressure that is open, and free along a part of its
    rim: a pressure that follows it has no potential there, and turns it over.  Collective."""
    # What is sewn or tied may be closed there.
    is_tied = _tied_unknowns(system)
    for pressed in pressed_films:
        film = pressed.pressure.body
        domain = film.mesh.domain
        topology = domain.topology
        topology.create_connectivity(1, 2)
        facets = exterior_facet_indices(topology)
        dofs = fem.locate_dofs_topological(film.space, 1, facets)
        owned = dofs[dofs < film.space.dofmap.index_map.size_local]
        is_held = np.zeros(system.unknowns.numbering.size_local, dtype=bool)
        is_held[system.unknowns.supports.held] = True
        is_held |= is_tied
        first = system.unknowns.block(film).owned.start
        rim = is_held[first + 3 * owned[:, None] + np.arange(3)]
        counts = np.array([len(rim), (~rim.any(axis=1)).sum()])
        nodes, free = system.comm.allreduce(counts).tolist()
        if nodes and free:
            yield (
                f"Nothing closes the open film '{film.name}' against '{pressed.pressure.name}': "
                f"{free} of {nodes} nodes of its rim are free; hold the rim by gx.Fixed, or close "
                "the film by a Seam, a Tie or a mesh without a rim."
            )


def _tied_unknowns(system: System) -> npt.NDArray[np.bool_]:
    """Which of this rank's unknowns constraints tie to others.  Collective."""
    marks = system.unknowns.q0.duplicate()
    marks.set(0.0)
    if system.equations.constraints is not None:
        for tuples in system.equations.constraints.tied_ports():
            for ports in tuples:
                unknowns, weights, _ = attach(
                    system.unknowns.numbering, system.unknowns.bodies, ports
                )
                shares = abs(weights).sum(axis=0)
                marks.setValues(unknowns, shares, addv=PETSc.InsertMode.ADD_VALUES)
    marks.assemble()
    is_tied = marks.array_r[: system.unknowns.numbering.size_local] > 0
    marks.destroy()
    return is_tied


def _pressure_at(item: Pressure, at: float) -> float:
    """A pressure at a time [s], [Pa], the same on all ranks."""
    value = item.pressure
    if not callable(value):
        return value
    source = f"Pressure '{item.name}' at t = {at:.6g} s"
    return float(ask_numbers(item.body.comm, source, lambda: value(at)))


def _gas_that_cooled(chambers: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each chamber whose gas has expanded so far that it does not fill it."""
    for name, state in chambers.items():
        before = state.chamber.initial_temperature
        if state.temperature < COOLED * before:
            yield (
                f"The gas of '{name}' expands adiabatically and has cooled from {before:.0f} K to "
                f"{state.temperature:.0f} K, so that it does not fill the film: "
                'give Equilibrium(..., gas="isothermal"), gas="held pressure", or more gas.'
            )


def _soft_films(system: System) -> Iterator[str]:
    """Yield a sentence for each film of order 2 whose wrinkles have almost no stiffness."""
    for body in system.unknowns.bodies:
        if not isinstance(body, Membrane) or body.order == 1 or body.law.quadratic:
            continue
        stiffness = getattr(body.law, "residual_stiffness", None)
        if stiffness is not None and stiffness < SOFT_RESIDUAL_STIFFNESS:
            yield (
                f"'{body.name}' is of order 2 and resists compression by {stiffness:.0e} of its "
                "stiffness only: take order=1 with a finer mesh.  (More residual_stiffness finds "
                "an equilibrium, but of other wrinkles: heights of single points then differ.)"
            )
