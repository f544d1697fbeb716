"""Several equilibria of a scene under the same loads, by searches from disturbed starts.

Problem.  A structure that snaps through, wrinkled film and a kite have several equilibria, and a
search finds the one that its start leads to.

Idea.  Repeat the search from starts that are moved by smooth random displacements

    u(X) = a Σ_j d_j cos(2π k_j·(X - X0)/L + φ_j),                                              (1)

with an amplitude a, random directions d_j, wave vectors k_j of up to three waves over the extent L
of the scene, and phases φ_j.  Noise from node to node would smooth itself out in the first
pseudo-step.

Two results are the same equilibrium if no free point is farther apart than a fraction of the
extent.  Where something moves freely, positions are not unique, and stored energies are compared.

Limit.  Nothing says that all equilibria were found.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.statics.result import EquilibriumResult
from gossamer_fx.core.checks.arguments import Range, check_arguments, collective, positive
from gossamer_fx.core.checks.errors import NoEquilibrium
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.steppers.history import MOTION, History, SavedState

LOG = logging.getLogger("gossamer_fx")

# Distance of points over the extent of the scene, and difference of stored energies over the larger
# one, from which on two equilibria differ.
SAME_PLACE = 1e-4
SAME_ENERGY = 1e-6

# Waves of (1), and most of them over the extent.
WAVES = 6
MOST_WAVES = 3.0

# Amplitude of a disturbance over the largest one.
SMALLEST_AMPLITUDE = 0.2


@check_arguments
@dataclass(frozen=True, repr=False)
class EquilibriumFound:
    """One of several equilibria.

    Attributes:
        result: as of `Equilibrium.find`: whether it is regular and stable.
        stored: sum of the stored energies [J].
        starts: numbers of the starts that led to it; 0 is the one that was not disturbed.
        distance: largest distance [m] of a point from where the first equilibrium has it.
        state: the complete state, see `take`.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> (hanging,) = gx.analysis.equilibria(
        ...     gx.Equilibrium(gx.Scene(weight, spring)), starts=2
        ... )
        >>> hanging.starts
        (0, 1)
    """

    result: EquilibriumResult
    stored: float
    starts: tuple[int, ...]
    distance: float
    state: SavedState

    def take(self, equilibrium: Equilibrium) -> None:
        """Give the scene of the search this equilibrium, for probes, pictures and as the start of
        further searches.  Collective."""
        History(equilibrium.system).restore(self.state)
        equilibrium.take_over(self.state.time)
        equilibrium.result = self.result

    def __repr__(self) -> str:
        return (
            f"<EquilibriumFound: stored {self.stored:.6g} J, {self.result.summary()}, from "
            f"{len(self.starts)} starts, {self.distance:.3g} m from the first>"
        )


@check_arguments
@collective
def equilibria(
    equilibrium: Equilibrium,
    *,
    starts: Annotated[int, Range(1)] = 8,
    perturbation: Annotated[float, positive()] = 0.05,
    at: float = 0.0,
    seed: Annotated[int, Range(0)] = 0,
) -> list[EquilibriumFound]:
    """Search for equilibria from several disturbed starts, and list those that differ, that of the
    undisturbed start first and then by their stored energy.

    The scene has the state of the first one then.  Nothing says that these are all.  Searches that
    find nothing are left out, and a warning has their number; a scene with friction or creases
    that yield has the history of the start in each of them.

    Args:
        equilibrium: its present state is the undisturbed start.
        starts: number of searches.
        perturbation: largest move of a free point in a disturbed start, over the extent of the
            scene.
        at: time of loads and prescribed positions [s].
        seed: of the random numbers: the same starts for the same number, on as many ranks.

    Returns:
        The equilibria that differ.

    Raises:
        NoEquilibrium: no search has found one.

    Example:
        >>> mass = gx.PointMass(0.01, (0.0, 0.0, 0.2))
        >>> bars = [
        ...     gx.connectors.Spring(
        ...         mass.port(), gx.Ground(at), stiffness=1e3, length=1.02, name=f"bar {k}"
        ...     )
        ...     for k, at in enumerate([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)])
        ... ]
        >>> found = gx.analysis.equilibria(
        ...     gx.Equilibrium(gx.Scene(*bars)), starts=8, perturbation=3.0
        ... )
        >>> sum(one.result.unstable == 0 for one in found)
        2
    """
    system = equilibrium.system
    history = History(system)
    start = history.save(MOTION)
    found: list[EquilibriumFound] = []
    failures: list[str] = []
    for number in range(starts):
        history.restore(start)
        equilibrium.take_over(start.time)
        if number:
            _disturb(history, start, _disturbance(equilibrium, perturbation, seed + number), at)
        try:
            result = equilibrium.find(at=at, progress=False)
        except NoEquilibrium as reason:
            failures.append(str(reason))
            continue
        stored = sum(result.totals.stored.values())
        here = EquilibriumFound(result, stored, (number,), 0.0, history.save())
        for k, other in enumerate(found):
            if _are_same(equilibrium, other, here):
                found[k] = replace(other, starts=(*other.starts, number))
                break
        else:
            if found:
                here = replace(here, distance=_distance(equilibrium, found[0], here))
            found.append(here)
    if not found:
        raise NoEquilibrium(f"equilibria: none of {starts} searches has found one; {failures[-1]}")
    if failures and equilibrium.comm.rank == 0:
        LOG.warning(
            "equilibria: %d of %d searches have found nothing, the last one as follows; give a "
            "smaller perturbation than %g, or more iterations.  %s",
            len(failures),
            starts,
            perturbation,
            failures[-1],
        )
    found[0].take(equilibrium)
    return [found[0], *sorted(found[1:], key=lambda one: one.stored)]


def _disturb(history: History, start: SavedState, change: Array, at: float) -> None:
    """Move the unknowns of this rank from a start, which is the present state, by a change (n,);
    the loads of time `at` [s] do work on the way, which counts as supplied, so that each
    equilibrium has the work from the start of all.  Collective."""
    system = history.system
    moved = start.moved_by(change)
    for compiled in system.equations.compiled:
        compiled.begin_step(at)
    end = system.unknowns.q0.copy()
    end.array[:] = moved.vectors["coordinates"]
    system.equations.set_end(end)
    end.destroy()
    work = sum(compiled.supplied() for compiled in system.equations.compiled)
    history.restore(moved)
    system.balance.supplied_energy += work


def _disturbance(equilibrium: Equilibrium, perturbation: float, seed: int) -> Array:
    """The displacement (1) of this rank's unknowns (n,), zero at fixed coordinates, directors and
    multipliers; the same function on every rank.  Collective."""
    system = equilibrium.system
    generator = np.random.default_rng(seed)
    extent = system.unknowns.initial.extent()
    directions = generator.standard_normal((WAVES, 3))
    waves = generator.uniform(-MOST_WAVES, MOST_WAVES, (WAVES, 3))
    phases = generator.uniform(0, 2 * np.pi, WAVES)
    moved = np.zeros(system.unknowns.numbering.size_local)
    for body in system.unknowns.bodies:
        owned = system.unknowns.block(body).owned
        vectors = system.unknowns.q0.array_r[owned].reshape(-1, body.block.size // 3, 3)
        angles = 2 * np.pi * vectors[:, 0] @ waves.T / (extent or 1.0) + phases
        of_body = np.zeros_like(vectors)
        of_body[:, 0] = np.cos(angles) @ directions
        moved[owned] = of_body.ravel()
    moved[system.unknowns.supports.held] = 0.0
    largest = equilibrium.comm.allreduce(float(np.abs(moved).max(initial=0.0)), op=MPI.MAX)
    # Not all starts are equally far away.
    amplitude = perturbation * generator.uniform(SMALLEST_AMPLITUDE, 1.0)
    return amplitude * extent * moved / (largest or 1.0)


def _are_same(
    equilibrium: Equilibrium,
    one: EquilibriumFound,
    other: EquilibriumFound,
) -> bool:
    """Whether two searches have found the same equilibrium.  Collective."""
    if one.result.free or other.result.free:
        difference = abs(one.stored - other.stored)
        return difference <= SAME_ENERGY * max(abs(one.stored), abs(other.stored))
    distance = _distance(equilibrium, one, other)
    return distance <= SAME_PLACE * equilibrium.system.unknowns.initial.extent()


def _distance(equilibrium: Equilibrium, one: EquilibriumFound, other: EquilibriumFound) -> float:
    """Largest difference [m] of a coordinate of a position between two equilibria.  Collective."""
    system = equilibrium.system
    marks = system.unknowns.position_marks
    difference = other.state.vectors["coordinates"] - one.state.vectors["coordinates"]
    changes = np.abs(difference)[: 3 * len(marks)].reshape(-1, 3) * marks[:, None]
    return float(system.comm.allreduce(float(changes.max(initial=0.0)), op=MPI.MAX))
