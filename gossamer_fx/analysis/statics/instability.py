"""Advice for an equilibrium that is not stable: which body buckles, and what bears compression.

A compressed beam buckles at N = π² EI/(β L)², with β = 1 between hinges, 2 for a cantilever with a
force of constant direction at its tip, ½ between clamps (Timoshenko and Gere, Theory of Elastic
Stability, 2nd ed., 1961, sections 2.1 and 2.2).  The advice compares the mean compression of each
beam with the load for β = 1; supports of real beams are between the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.mesh.quality import corner_points, sizes
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.film_states import AreaFractions
from gossamer_fx.solve.system.system import System

Displacements = Mapping[str, npt.NDArray[np.complex128]]

# Compression over the load π² EI/L² from which a beam may have buckled: that of a cantilever.
CANTILEVER_SHARE = 0.25

# Residual stiffness that is recommended in place of a law that resists compression fully.
SMALL_RESIDUAL_STIFFNESS = 1e-4


def advice(system: System, displacements: Displacements) -> str:
    """Sentences about what has buckled and what to change.  Collective.

    Args:
        system: in the state of the equilibrium.
        displacements: of the mode that grows fastest, at this rank's nodes (n, 3), by the names of
            the bodies.
    """
    sentences = ["A small disturbance leads to another equilibrium."]
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
            _, _, taut = AreaFractions([body])(system)
            share = 1 - taut
            yield (
                f"Film '{body.name}' is not taut on {100 * share:.0f} % of its area. There it "
                f"resists compression with {stiffness:.0e} of its stiffness but has no bending "
                "stiffness, so that it buckles: stretch it more, let its free edges be arcs with "
                f"cords, or take a smaller residual_stiffness than {stiffness:.0e}."
            )


def loaded_beams(system: System) -> Iterator[str]:
    """Deflection and compression of each beam, and what to change if these are large."""
    beams = [body for body in system.bodies if isinstance(body, Beam)]
    if not beams:
        return
    is_buckling = False
    for beam in beams:
        length = system.comm.allreduce(float(sizes(corner_points(beam.space.mesh)).sum()))
        stiffness = min(beam.section.EI2, beam.section.EI3)
        pinned_load = math.pi**2 * stiffness / length**2
        compression = -_mean_tension(system, beam, length)
        is_buckling |= compression >= CANTILEVER_SHARE * pinned_load
        yield (
            f"Beam '{beam.name}' is deflected by up to {_deflection(system, beam):.3g} m and bears "
            f"a compression of {compression:.3g} N; it buckles at {pinned_load:.3g} N between "
            "hinges, and at a quarter of that as a cantilever."
        )
    if is_buckling:
        yield (
            "Reduce the compression: softer springs, a larger length of the cables, a lower "
            "initial_stress of the film; or take a stiffer section. A finer mesh does not help."
        )
    elif any(isinstance(body, Membrane) for body in system.bodies):
        yield (
            "If the deflection of the beams slackens the film, allow for it in the length of the "
            "cables, take softer springs that are stretched more, or a stiffer section. A finer "
            "mesh does not help."
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
