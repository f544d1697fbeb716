"""Forces from outside are the change of the momenta: those of supports, joints and connectors on
the ground, of loads, and of obstacles, in each kind of scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.core.algebra.point_measures import translation_weight
from gossamer_fx.core.model.body import Ground
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint
from gossamer_fx.mechanics.terms.rows import CompiledRows
from gossamer_fx.mechanics.terms.supports import Support
from gossamer_fx.meshes.sheet import crossed_sheet
from gossamer_fx.records.fields.reactions import GroundForce
from tests.invariance.kinds import FILM, KINDS, Kind, Made, constant, of_film, patch
from tests.invariance.transformations import SAME, Description
from tests.small_scenes import at_rest

# The momenta of a scene in orbit contain those of its frame, which no load moves.
FRAMES = {"orbit"}


def held_by_connectors(at: Description) -> Made:
    """A sheet that is thrown, with weight, wind and one of each connector to the ground."""
    law = at.law(gx.Linear, **FILM)
    film = at.film(patch(crossed_sheet, 2, 2), law, velocity=constant(0.5, 0.1, 2.0))
    [body] = film.bodies
    corners = [body.port(name) for name in ("bottom left", "bottom right", "top left", "top right")]
    below = [gx.Ground(port.initial() + np.array((0.1, 0.0, -0.5))) for port in corners]
    connect = gx.connectors
    spring = connect.Spring(corners[0], below[0], stiffness=50.0, length=0.4, name="spring")
    rope = connect.Rope(below[1], corners[1], stiffness=80.0, length=0.3, damping=0.5)
    damper = connect.Damper(corners[2], below[2], damping=0.3, name="damper")
    tether = connect.Tether(
        corners[3], below[3], stiffness=60.0, length=lambda t: 0.4 + t, name="tether"
    )
    axial = connect.AxialSpring(corners[0], 30.0, direction=(1.0, 1.0, 0.0), name="axial")
    stop = connect.Stop(corners[1], gx.Ground((1.2, 0.1, 0.0)), stiffness=40.0, length=0.5)
    weight = gx.Gravity(body, (0.0, 0.0, -9.81))
    return of_film(film, spring, rope, damper, tether, axial, stop, weight)


def turned(at: Description) -> Made:
    """A film on a prescribed motion along an edge, in flight."""

    def motion(X: np.ndarray, t: float) -> np.ndarray:
        return np.vstack([0 * X[0], 3 * t + 0 * X[0], 0 * X[0] - 20 * t**2])

    film = at.film(patch(crossed_sheet, 2, 2), at.law(gx.Linear, **FILM))
    return of_film(film, *(gx.Fixed(body, "left", motion=motion) for body in film.bodies))


OWN = (
    Kind("held by connectors", held_by_connectors, 1e-3, 3, 1e-9),
    Kind("moved along an edge", turned, 1e-3, 3, 1e-9),
)

TIGHT = gx.Tolerances(relative=1e-13)


def on_ground(terms: Any) -> bool:
    """Whether terms of an item join bodies to the ground."""
    for term in terms:
        if isinstance(term, Support):
            return True
        if isinstance(term, PointConstraint) or issubclass(term.compiler, CompiledRows):
            ports = [port for ports in term.measure.ports for port in ports]
            # A spring along a direction has the ground in its measure alone.
            alone = any(
                len(one) == 1 and translation_weight(one[0]) != 0 for one in term.measure.ports
            )
            if alone or any(isinstance(port, Ground) for port in ports):
                return True
    return False


def outer_forces(state: Any, made: Made) -> tuple[np.ndarray, np.ndarray, bool]:
    """Sum of the forces and moments (2, 3) from outside in the last step; the largest of them, for
    its scale; and whether there are obstacles, whose moment is not known."""
    parts = []
    for each in state.system.unknowns.items_with_terms:
        if on_ground(each.terms) and each.item not in state.system.unknowns.bodies:
            parts.append(np.array(GroundForce(state.system, each.item)()))
    parts += list(state.system.balance.resultants().values())
    contacts = [part for part in made.parts if isinstance(part, gx.Contact)]
    touched = [(contact, obstacle) for contact in contacts for obstacle in contact.obstacles]
    for contact, obstacle in touched:
        push = [gx.probes.ContactForce(contact, obstacle, axis=axis)(state) for axis in "xyz"]
        parts.append(np.array([np.negative(push), np.zeros(3)]))
    rows = np.array([np.zeros((2, 3)), *parts])
    return rows.sum(axis=0), np.abs(rows).max(axis=(0, 2)), bool(touched)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "kind", [kind for kind in (*KINDS, *OWN) if kind.name not in FRAMES], ids=lambda kind: kind.name
)
def test_forces_from_outside_are_the_change_of_the_momenta(comm, kind):
    made = kind.make(Description(SAME, comm))
    if kind.dt == 0:
        statics = at_rest(*made.parts)
        total, largest, _ = outer_forces(statics, made)
        assert np.abs(total[0]).max() <= 1e-6 * max(largest[0], 1e-4)
        assert np.abs(total[1]).max() <= 1e-6 * max(largest[1], 1e-4)
        return
    run = gx.Simulation(gx.Scene(*made.parts), gx.Midpoint(dt=kind.dt, tolerances=TIGHT))
    for _ in range(min(kind.steps, 3)):
        before = run.totals
        run.run(until=run.time + kind.dt)
    after = run.totals
    total, largest, has_obstacles = outer_forces(run, made)
    for k, name in enumerate(("momentum", "angular_momentum")):
        if has_obstacles and name == "angular_momentum":
            continue
        start, end = getattr(before, name), getattr(after, name)
        change = (end - start) / kind.dt
        # Round-off of the momenta, over the step.
        scale = max(largest[k], np.abs([start, end]).max() / kind.dt * 1e-3, 1e-4)
        assert total[k] == pytest.approx(change, abs=1e-7 * scale), name
