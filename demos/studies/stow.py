"""Bags that are stowed by tools and inflated again: is the inflated bag the one that was never
folded, and how small does it become?

A capped tube (0.4 m long, 0.1 m wide) and a flat airbag (0.2 m, on two meshes) are emptied,
pressed and folded once.  A torus (0.2 m, tube radius 0.04 m) and a balloon of eight gores (0.3 m
wide, 0.2 m high) are folded twice, across each other, and the balloon is then packed into a box.
All are let go, and inflated by 2 kPa in 0.2 s.  Their volume and potential at rest are compared
with those of the same bag that was inflated without being folded.  The film is 0.1 mm thick, of 0.1
GPa, and carries a millionth of its stiffness where it is slack.

Wanted: no layer has crossed another one after any step, energy 1e-10, and volume and potential of
the bag that was never folded to 1e-6.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.figures import area_vectors, flat_triangles
from demos.studies.engine.study import NOT_STABLE, Measure, Study
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.revolved import balloon, torus
from gossamer_fx.meshes.tube_section import capped_cylinder

FILM = gx.Miyazaki(E=1e8, nu=0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-6)
PRESSURE = 2000.0  # of the inflated bag [Pa]
RISE = 0.2  # in which it rises [s]
INFLATED = 0.5  # [s]
SUCTION = 20.0  # while it is stowed [Pa]
# Damping of the film while it is inflated.
MASS_DAMPING = 20.0
STIFFNESS_DAMPING = 1e-3
FLOATS = {"The equilibrium is not unique": "nothing holds the inflated bag, which may be anywhere"}
# What the flat airbag is opened by in its middle, over the spacing of its layers.
OPENING = 2.0

Fold = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Bag:
    """A bag and how it is stowed.

    Args:
        mesh: mesh(comm, cells), with `cells` times the edges of the coarsest one.
        spacing: of its layers [m] on the coarsest mesh; on finer ones it is this over `cells`.
        folds: a point [m] of each line, and the direction in which film is laid over it.
        box: in which it is packed in the end [m].
        half_width: of a flat bag, whose layers have to be opened [m].
    """

    mesh: Callable[[MPI.Intracomm, int], gx.Mesh]
    spacing: float
    folds: tuple[Fold, ...]
    box: tuple[float, float, float] | None = None
    half_width: float | None = None

    def film(self, comm: MPI.Intracomm, cells: int) -> gx.Membrane:
        """The bag as it was made, with layers that do not coincide."""
        mesh = self.mesh(comm, cells)
        half = self.half_width
        if half is None:
            return gx.Membrane(mesh, FILM, name="bag")

        def opened(side: float) -> Callable[[np.ndarray], np.ndarray]:
            def displacement(X: np.ndarray) -> np.ndarray:
                height = (1 - (X[0] / half) ** 2) * (1 - (X[1] / half) ** 2)
                return np.stack(
                    [0 * X[0], 0 * X[0], side * OPENING * self.spacing / cells * height]
                )

            return displacement

        sides = {"top": opened(1.0), "bottom": opened(-1.0)}
        return gx.Membrane(mesh, FILM, displacement=sides, name="bag")

    def stow(self, film: gx.Membrane, cells: int, folds: int) -> gx.fold.Stow:
        """The steps that stow it, with the first of its folds only."""
        stow = gx.fold.Stow(film, spacing=self.spacing / cells).evacuate(SUCTION).press()
        for point, towards in self.folds[:folds]:
            stow = stow.fold(point, towards)
        if self.box is not None and folds >= len(self.folds):
            stow = stow.pack(self.box)
        return stow


ACROSS_X: Fold = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
ACROSS_Y: Fold = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
BAGS = {
    "airbag": Bag(
        lambda comm, cells: airbag(comm, 0.2, 4 * cells), 3e-3, (ACROSS_X,), half_width=0.1
    ),
    "tube": Bag(
        lambda comm, cells: capped_cylinder(comm, 0.05, 0.4, 12 * cells, 16 * cells),
        5e-3,
        (((0.2, 0.0, 0.0), (1.0, 0.0, 0.0)),),
    ),
    "torus": Bag(
        lambda comm, cells: torus(comm, 0.2, 0.04, 32 * cells, 8 * cells),
        5e-3,
        (ACROSS_X, ACROSS_Y),
    ),
    "balloon": Bag(
        lambda comm, cells: balloon(comm, 0.15, 8, 3 * cells, height=0.2),
        4e-3,
        (ACROSS_X, ACROSS_Y),
        box=(0.2, 0.2, 0.04),
    ),
}


def simulation(scene: gx.Scene, first_step: float, longest_step: float) -> gx.Simulation:
    """A run whose steps grow where film hits nothing."""
    control = gx.StepControl(max_step=longest_step, max_factor=1.3)
    return gx.Simulation(scene, gx.Midpoint(dt=first_step), control=control)


def inflated(film: gx.Membrane, spacing: float, start: list[Any]) -> tuple[float, float, float]:
    """Volume [m³] and potential [J] at rest of a bag that is inflated, and the relative error of
    the energy on the way."""
    rising = gx.Pressure(film, lambda t: PRESSURE * min(t / RISE, 1.0))
    damping = gx.Damping(film, mass_factor=MASS_DAMPING, stiffness_factor=STIFFNESS_DAMPING)
    contact = gx.Contact(film, distance=spacing)
    run = simulation(gx.Scene(film, rising, damping, contact, *start), 1e-3, 1e-2)
    run.run(until=INFLATED)
    at_rest = gx.Scene(film, gx.Pressure(film, PRESSURE), gx.StartFrom(run.system))
    equilibrium = gx.Equilibrium(at_rest)
    result = equilibrium.find()
    volume = gx.analysis.EnclosedVolume(film)(equilibrium)
    potential = result.totals.stored["bag"] - PRESSURE * volume
    return volume, potential, abs(run.energy_error)


def problem(comm: MPI.Intracomm, bag: str, cells: int, folds: int = 2) -> dict[str, float]:
    """Stow a bag, let it go, and inflate it."""
    began = time.process_time()
    kind = BAGS[bag]
    spacing = kind.spacing / cells
    film = kind.film(comm, cells)
    stow = kind.stow(film, cells, folds)
    stowed_at = stow.end
    stow = stow.release()
    run = simulation(gx.Scene(film, stow), stow.first_step, stow.longest_step)
    crossings = 0.0
    slip = 0.0
    packed = 0.0
    stress = 0.0
    for end in stow.ends:
        run.run(until=end)
        crossings += gx.probes.Crossings(film)(run) + gx.probes.Penetrations(stow.contact)(run)
        slip = max(slip, stow.slip(run))
        if end == stowed_at:
            stress = gx.probes.LargestStress(film)(run)
            packed = float(np.prod(stow.box(run)))
    released = float(np.prod(stow.box(run)))
    of_stowing = time.process_time() - began
    areas = np.linalg.norm(area_vectors(flat_triangles(film)), axis=1)
    area = comm.allreduce(float(areas.sum()))
    again, potential_again, error_again = inflated(film, spacing, [gx.StartFrom(run.system)])
    volume, potential, error = inflated(film, spacing, [])
    return {
        "crossings": crossings,
        "energy": max(abs(run.energy_error), error, error_again),
        "volume": abs(again / volume - 1),
        "potential": abs(potential_again / potential - 1),
        "inflated over packed volume": volume / packed,
        "packed volume over layers": packed / (area * spacing),
        "spring-back": released / packed,
        "slip [mm]": 1e3 * slip,
        "largest stress [MPa]": 1e-6 * stress,
        "steps": run.step,
        "iterations": run.iterations / run.step,
        "rejected": run.substeps,
        "CPU of stowing": of_stowing,
        "seconds": time.process_time() - began,
    }


STUDY = Study(
    "stow",
    "Bags that are stowed and inflated again",
    problem,
    {"bag": list(BAGS), "cells": [1]},
    lambda case: 1 / case["cells"],
    (
        Measure("volume", 0.0, 1e-6),
        Measure("potential", 0.0, 1e-6),
    ),
    finer=[{"bag": "airbag", "cells": 2}],
    quick={"bag": ["airbag"]},
    quick_options={"folds": 0},
    limits={"energy": 1e-10, "crossings": 0},
    not_repeatable={
        "all": "folds and wrinkles of slack film move chaotically; errors have their tolerances"
    },
    expected_warnings=NOT_STABLE | FLOATS,
    columns="inflated over packed volume, packed volume over layers, spring-back, slip [mm], "
    "largest stress [MPa], steps, iterations, CPU of stowing",
)
