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

from gossamer_fx.bodies.beam import Beam
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.mesh.quality import corner_points, sizes
from gossamer_fx.system.system import System

Displacements = Mapping[str, npt.NDArray[np.complex128]]

# Compression over the load π² EI/L² from which a beam may have buckled: that of a cantilever.
CANTILEVER_SHARE = 0.25

# Residual stiffness of films above which the advice is to lower it.
SMALL_RESIDUAL_STIFFNESS = 1e-4


def advice(system: System, displacements: Displacements) -> str:
    """Sentences about what has buckled and what to change.  Collective.

    Args:
        system: in the state of the equilibrium.
        displacements: of the mode that grows fastest, at this rank's nodes (n, 3), by the names of
            the bodies.
    """
    sentences = [
        "A small disturbance leads to another equilibrium.",
        *_moved_most(system, displacements),
        *_compressed_beams(system),
        *_stiff_films(system, displacements),
    ]
    return " ".join(sentences)


def _moved_most(system: System, displacements: Displacements) -> Iterator[str]:
    """The body that the mode moves farthest; nothing for a scene of one body."""
    largest = _largest(system, displacements)
    if len(largest) > 1:
        yield f"The fastest mode moves '{max(largest, key=lambda name: largest[name])}' most."


def _largest(system: System, displacements: Displacements) -> dict[str, float]:
    """Largest displacement of each body over all ranks, by name."""
    found = {}
    for name, values in displacements.items():
        own = float(np.abs(values).max(initial=0.0))
        found[name] = system.comm.allreduce(own, op=MPI.MAX)
    return found


def _compressed_beams(system: System) -> Iterator[str]:
    """Beams whose compression may buckle them."""
    names = []
    for body in system.bodies:
        if not isinstance(body, Beam):
            continue
        length = system.comm.allreduce(float(sizes(corner_points(body.space.mesh)).sum()))
        stiffness = min(body.section.EI2, body.section.EI3)
        pinned_load = math.pi**2 * stiffness / length**2
        compression = -_mean_tension(system, body, length)
        if compression >= CANTILEVER_SHARE * pinned_load:
            names.append(body.name)
            yield (
                f"Beam '{body.name}' bears a compression of {compression:.3g} N; it buckles at "
                f"{pinned_load:.3g} N between hinges, and at a quarter of that as a cantilever."
            )
    if names:
        yield (
            "Reduce what compresses it: cables that allow for the deflection of its tip (a larger "
            "length), softer springs, a lower initial_stress of the film; or give it a stiffer "
            "section. A finer mesh does not help."
        )


def _mean_tension(system: System, beam: Beam, length: float) -> float:
    """Mean of EA ε along a beam of a length [m], [N]; ε is small in a beam that buckles."""
    q = fem.Function(beam.space)
    system.fields[beam].take(q, system.q0.array_r[system.block(beam).owned])
    tension = beam.constants.EA * beam.measure(q)[0] * beam.mass_dx
    own = float(fem.assemble_scalar(compile_form(tension)))
    return system.comm.allreduce(own) / length


def _stiff_films(system: System, displacements: Displacements) -> Iterator[str]:
    """Films that move and whose resistance to compression lets them buckle like plates."""
    largest = _largest(system, displacements)
    most = max(largest.values(), default=0.0)
    for body in system.bodies:
        if not isinstance(body, Membrane) or body.bends or largest.get(body.name, 0.0) < most:
            continue
        share = f"{getattr(body.law, 'residual_stiffness', 0.0):.0e} of its"
        is_stiff = getattr(body.law, "residual_stiffness", 0.0) > SMALL_RESIDUAL_STIFFNESS
        # A law whose energy is quadratic makes no difference between tension and compression.
        if body.law.quadratic:
            share = "its full"
            is_stiff = True
        if is_stiff:
            yield (
                f"Film '{body.name}' resists compression with {share} stiffness but has no bending "
                "stiffness, so that it buckles: take a law with a residual_stiffness of "
                f"{SMALL_RESIDUAL_STIFFNESS:g} or less, or stretch the film more."
            )
