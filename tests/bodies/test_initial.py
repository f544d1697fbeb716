"""Initial conditions of whole scenes: rigid spin, and the equilibrium of a steady spin."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import at_rest

COMM = MPI.COMM_WORLD
SPIN = (0.0, 0.0, 5.0)


def dumbbell() -> tuple[gx.Beam, gx.RigidBody, gx.PointMass, list]:
    """A soft beam between a rigid body and a point mass."""
    beam = gx.Beam(
        line(COMM, [(-1, 0, 0), (1, 0, 0)], 4),
        gx.sections.solid_circle(0.01, E=1e7, nu=0.3, density=1000.0),
    )
    hub = gx.RigidBody(0.5, (0.01, 0.01, 0.01), position=(-1, 0, 0), name="hub")
    tip = gx.PointMass(0.5, (1, 0, 0), name="tip")
    joints = [
        gx.constraints.FixedJoint(hub.frame(), beam.frame("start")),
        gx.constraints.BallJoint(tip.port(), beam.port("end")),
    ]
    return beam, hub, tip, joints


@pytest.mark.mpi
def test_spin_of_a_whole_scene_has_the_momenta_of_a_rigid_body() -> None:
    """P = m (v + Ω × (c - c0)), L = P-moment + I Ω of beam, body and mass."""
    beam, hub, tip, joints = dumbbell()
    motion = gx.RigidMotion(spin=SPIN, velocity=(1.0, 2.0, 3.0), centre=(0.0, 1.0, 0.0))
    run = gx.Simulation(gx.Scene(beam, hub, tip, *joints, motion), gx.Midpoint(dt=1e-3))
    mass = 1.0 + beam.section.line_density * 2
    # v + Ω × (c - c0): the centre of mass is at the origin, 1 m below `centre` in y.
    velocity = np.array([1.0, 2.0, 3.0]) + np.cross(SPIN, (0, -1.0, 0))
    inertia = (
        2 * 0.5 + 0.01 + beam.section.line_density * 2**3 / 12 + 2 * 2 * beam.section.rotary2 / 2
    )
    assert run.first.momentum == pytest.approx(mass * velocity, rel=1e-12)
    # The beam's directors are unit vectors to 1e-12, and enter with their rotary inertia.
    assert run.first.angular_momentum[2] == pytest.approx(inertia * 5.0, rel=1e-10)


def test_steady_spin_stays_steady() -> None:
    """Started from its equilibrium under centrifugal force, the length of the spinning dumbbell is
    constant."""
    beam, hub, tip, joints = dumbbell()
    bodies = (beam, hub, tip)
    balance = at_rest(*bodies, *joints, *(gx.loads.Centrifugal(b, SPIN) for b in bodies))
    start = gx.StartFrom(balance.system)
    run = gx.Simulation(
        gx.Scene(*bodies, *joints, start, gx.RigidMotion(spin=SPIN)),
        gx.Midpoint(dt=5e-3, tolerances=gx.Tolerances(relative=1e-12)),
    )

    def length() -> float:
        owned = (
            run.system.unknowns.q0.array_r[run.system.unknowns.numbering.owned(k)] for k in (1, 2)
        )
        x, y = (q[:3] for q in owned)
        return float(np.linalg.norm(x - y))

    stretched = length()
    # Centrifugal force stretches the soft beam by more than 3 mm.
    assert stretched > 2.003
    for t in (0.1, 0.25, 0.5):
        run.run(until=t)
        # Midpoint rule and equilibrium discretise the same strain, so that only h² errors separate
        # them.
        assert length() == pytest.approx(stretched, rel=1e-4)
    assert run.totals.kinetic == pytest.approx(run.first.kinetic, rel=1e-4)


@pytest.mark.mpi
def test_a_function_of_the_start_is_asked_once() -> None:
    """So that joints, which measure their length at the start, see the film that is moved: it may
    be a random one."""
    random = np.random.default_rng(3)
    asked = []

    def rough(x: np.ndarray) -> np.ndarray:
        asked.append(len(x))
        return 1e-3 * random.standard_normal(x.shape)

    film = gx.Membrane(
        sheet(COMM, 4, 4),
        gx.Linear(1e9, 0.3, density=1e3, thickness=1e-4),
        displacement=rough,
    )
    places = [(x, 0.5, 0.0) for x in (0.25, 0.5, 0.75)]
    gx.Scene(
        *(
            gx.constraints.Link(film.port_at(x), gx.Ground((0.0, 0.0, 1.0)), name=f"link {x}")
            for x in places
        )
    ).compile()
    # A second call would return other random numbers.
    assert len(asked) == 1
