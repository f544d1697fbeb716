"""Advice for scenes whose equilibrium was not found: likely causes, from what the scene
contains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.loads.pressure import Pressure
from gossamer_fx.mesh.quality import area_vectors
from gossamer_fx.model.body import Array
from gossamer_fx.system.system import System

# Residual stiffness below which the wrinkles of a film of order 2 have no equilibrium on many
# meshes.
SOFT_RESIDUAL_STIFFNESS = 1e-2

# Temperature of a gas over that of its start, below which it has expanded into a volume that it
# does not fill.
COOLED = 0.95

# Sum of the loads over the sum of their magnitudes, below which they balance each other.
BALANCED = 1e-6

# Sum of the area vectors of a film over its area, below which it is closed.
CLOSED = 1e-9

# Volume of a closed film over the 3/2 power of its area, below which it is flat.
FLAT_VOLUME = 1e-6


def remedies(system: System, chambers: Mapping[str, Any]) -> str:
    """Sentences about likely causes and what to do; empty if none is known.  Collective.

    Args:
        system: the compiled scene, in the state that was reached last.
        chambers: states of its gas by name.
    """
    found = [
        *_unsupported(system),
        *_inward_pressures(system),
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
            "Nothing in the scene is supported, and its loads do not balance each other: hold it "
            "by gx.Fixed."
        )


def _inward_pressures(system: System) -> Iterator[str]:
    """Pressures on closed films whose normals point inwards, so that they collapse."""
    for item in system.items:
        if not isinstance(item, Pressure) or callable(item.pressure):
            continue
        volume = _enclosed_volume(system, item.body)
        if volume * item.pressure < 0:
            side = "outwards"
            if volume < 0:
                side = "inwards"
            yield (
                f"'{item.name}' presses the closed film '{item.body.name}' together, as the "
                "normals of its mesh "
                f"point {side}: change the sign of the pressure, or turn the "
                "normals (orient=True, or gmsh: model.mesh.reverse)."
            )


def _enclosed_volume(system: System, film: Membrane) -> float:
    """Volume [m³] that a film encloses at the start, negative if its normals point inwards; 0 if
    open or flat."""
    space = film.space
    owned = space.mesh.topology.index_map(2).size_local
    corners = space.tabulate_dof_coordinates()[cell_nodes(space)[:owned, :3]]
    vectors = area_vectors(corners)
    sums = np.concatenate(
        [
            vectors.sum(axis=0),
            [np.linalg.norm(vectors, axis=1).sum()],
            [np.einsum("ij,ij->", corners.mean(axis=1), vectors) / 3],
        ]
    )
    total: Array = system.comm.allreduce(sums, op=MPI.SUM)
    area = float(total[3])
    volume = float(total[4])
    is_closed = np.linalg.norm(total[:3]) < CLOSED * area
    if not is_closed or abs(volume) < FLAT_VOLUME * area**1.5:
        return 0.0
    return volume


def _gas_that_cooled(chambers: Mapping[str, Any]) -> Iterator[str]:
    """Chambers whose gas has expanded so far that it does not fill them."""
    for name, state in chambers.items():
        before = state.chamber.initial_temperature
        if state.temperature < COOLED * before:
            yield (
                f"The gas of '{name}' expands adiabatically and has cooled from {before:.0f} K to "
                f"{state.temperature:.0f} K, its pressure is {state.pressure:.4g} Pa: it does not "
                "fill the film.  "
                'Give Equilibrium(..., gas="isothermal") if it has time to warm up, '
                'gas="held pressure" if a blower '
                "holds its pressure, or more gas."
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
                "stiffness only: take "
                f"order=1 with a finer mesh, or residual_stiffness={SOFT_RESIDUAL_STIFFNESS:g}."
            )
