"""Advice for scenes whose equilibrium was not found or is not stable: likely causes, from what the
scene contains.

A compressed beam buckles at N = π² EI/(β L)², with β = 1 between hinges, 2 for a cantilever with a
force of constant direction at its tip, ½ between clamps (Timoshenko and Gere, Theory of Elastic
Stability, 2nd ed., 1961, sections 2.1 and 2.2).  The advice compares the mean compression of each
beam with the load for β = 1; supports of real beams are between the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.mesh.enclosed_volume import Enclosed, enclosed_by
from gossamer_fx.core.mesh.quality import corner_points, sizes
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.loads.pressure import Pressure
from gossamer_fx.solve.system.system import System

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.beam import Beam

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
        *(pressure.words for pressure in collapsing_pressures(pressed_films, system.time)),
        *_gas_that_cooled(chambers),
        *_soft_films(system),
    ]
    return "".join(f"  {sentence}" for sentence in found)


def _unsupported(system: System) -> Iterator[str]:
    """Loads that do not balance each other, on a scene in which no coordinate is held."""
    held = system.comm.allreduce(len(system.supports.held))
    if held or system.constraints is not None:
        return
    # What lies on an obstacle is supported by contact.
    if any(getattr(item, "obstacles", ()) for item in system.items):
        return
    size = 3 * len(system.position_marks)
    forces = system.external_forces().array_r[:size].reshape(-1, 3)
    of_positions = forces * system.position_marks[:, None]
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
    for item in system.items:
        if isinstance(item, Pressure):
            mesh = item.body.mesh
            found.append(PressedFilm(item, enclosed_by(mesh.domain, mesh.edges)))
    return found


def collapsing_pressures(
    pressed_films: Iterable[PressedFilm], at: float
) -> Iterator[CollapsingPressure]:
    """Pressures at a time [s] that press films with an inside together.  Collective."""
    for pressed in pressed_films:
        item = pressed.pressure
        enclosed = pressed.enclosed
        film = item.body
        pressure = _value(item, at)
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


def _value(item: Pressure, at: float) -> float:
    """A pressure at a time [s], [Pa], the same on all ranks."""
    value = item.pressure
    if not callable(value):
        return value
    source = f"Pressure '{item.name}' at t = {at:.6g} s"
    return float(ask_numbers(item.body.comm, source, lambda: value(at)))


def _gas_that_cooled(chambers: Mapping[str, Any]) -> Iterator[str]:
    """Chambers whose gas has expanded so far that it does not fill them."""
    for name, state in chambers.items():
        before = state.chamber.initial_temperature
        if state.temperature < COOLED * before:
            yield (
                f"The gas of '{name}' expands adiabatically and has cooled from {before:.0f} K to "
                f"{state.temperature:.0f} K, so that it does not fill the film: "
                'give Equilibrium(..., gas="isothermal"), gas="held pressure", or more gas.'
            )


def _soft_films(system: System) -> Iterator[str]:
    """Films of order 2 whose wrinkles have almost no stiffness."""
    for body in system.bodies:
        if not isinstance(body, Membrane) or body.order == 1 or body.law.quadratic:
            continue
        stiffness = getattr(body.law, "residual_stiffness", None)
        if stiffness is not None and stiffness < SOFT_RESIDUAL_STIFFNESS:
            yield (
                f"'{body.name}' is of order 2 and resists compression by {stiffness:.0e} of its "
                "stiffness only: take order=1 with a finer mesh, or "
                f"residual_stiffness={SOFT_RESIDUAL_STIFFNESS:g}."
            )


# ---- equilibria that are not stable --------------------------------------------------------------

Displacements = Mapping[str, npt.NDArray[np.complex128]]

# Residual stiffness that is recommended in place of a law that resists compression fully.
SMALL_RESIDUAL_STIFFNESS = 1e-4


def advice(system: System, displacements: Displacements) -> str:
    """Sentences about what has buckled, in the state of the equilibrium, from the displacements (n,
    3) of the mode that grows fastest, by the names of bodies.  Collective."""
    sentences = []
    largest = {}
    for name, values in displacements.items():
        own = float(np.abs(values).max(initial=0.0))
        largest[name] = system.comm.allreduce(own, op=MPI.MAX)
    if len(largest) > 1:
        moved_most = max(largest, key=lambda name: largest[name])
        sentences.append(f"The fastest mode moves '{moved_most}' most.")
    sentences += _compressed_films(system, largest)
    sentences += loaded_beams(system)
    return " ".join(sentences)


def _compressed_films(system: System, largest: Mapping[str, float]) -> Iterator[str]:
    """Films that resist compression, and which the mode moves as far as anything."""
    most = max(largest.values(), default=0.0)
    for body in system.bodies:
        if not isinstance(body, Membrane) or body.bends or largest.get(body.name, 0.0) < most:
            continue
        stiffness = getattr(body.law, "residual_stiffness", 0.0)
        # A law whose energy is quadratic makes no difference between tension and compression.
        if body.law.quadratic:
            yield (
                f"Film '{body.name}' resists compression with its full stiffness but has no "
                "bending stiffness, so that it buckles: take a law with a residual_stiffness of "
                f"{SMALL_RESIDUAL_STIFFNESS:g} or less, or stretch the film more."
            )
        elif stiffness > 0:
            # Imported here: few equilibria need it.
            from gossamer_fx.records.fields.film_states import AreaFractions

            _, _, taut = AreaFractions([body])(system)
            yield (
                f"Film '{body.name}' is not taut on {100 * (1 - taut):.0f} % of its area, where it "
                f"resists compression with {stiffness:.0e} of its stiffness but has no bending "
                "stiffness, so that it buckles: stretch it more, or take a smaller "
                "residual_stiffness."
            )


def loaded_beams(system: System) -> Iterator[str]:
    """Deflection and compression of each beam, and what to change if these are large."""
    from gossamer_fx.mechanics.bodies.beam import Beam

    beams = [body for body in system.bodies if isinstance(body, Beam)]
    for beam in beams:
        length = system.comm.allreduce(float(sizes(corner_points(beam.space.mesh)).sum()))
        stiffness = min(beam.section.EI2, beam.section.EI3)
        pinned_load = math.pi**2 * stiffness / length**2
        compression = -_mean_tension(system, beam, length)
        yield (
            f"Beam '{beam.name}' is deflected by up to {_deflection(system, beam):.3g} m "
            f"and bears a compression of {compression:.3g} N; "
            f"it buckles at {pinned_load:.3g} N between hinges, "
            "and at a quarter of that as a cantilever."
        )
    if beams:
        yield (
            "If beams give way, take a stiffer section, softer springs, "
            "or a larger length of the cables."
        )


def _deflection(system: System, beam: Beam) -> float:
    """Largest displacement of a beam from its mesh [m]."""
    mesh_positions = beam.space.tabulate_dof_coordinates()[: beam.block.index_map.size_local]
    moved = system.state[beam].positions() - mesh_positions
    own = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    return system.comm.allreduce(own, op=MPI.MAX)


def _mean_tension(system: System, beam: Beam, length: float) -> float:
    """Mean of EA ε along a beam of a length [m], [N]; ε is small in a beam that buckles."""
    q = fem.Function(beam.space)
    system.coordinates[beam].take(q, system.q0.array_r[system.block(beam).owned])
    tension = beam.constants.EA * beam.measure(q)[0] * beam.mass_dx
    own = float(fem.assemble_scalar(compile_form(tension)))
    return system.comm.allreduce(own) / length
