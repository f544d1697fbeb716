"""Impacts on stops: penalty contact of rigid bodies, and bars on a wall and on each other.

Sources:
    rigid bodies on a linear spring    half an oscillation of the reduced mass: π √(m/k), V √(m/k)
    elastic bars    Saint-Venant's waves of the speed c = √(E/ρ): W. Goldsmith, Impact (1960),
                    chapter 3; K. L. Johnson,
        Contact Mechanics (1985), § 11.1, doi:10.1017/CBO9781139171731
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line

# Energy and momenta are compared with 1e-12, so Newton's method must be more exact.
TIGHT = gx.Tolerances(relative=1e-13)
RADIUS = 0.1
STIFFNESS = 1e4


def collision(offset: float, dt: float) -> gx.Simulation:
    """A ball of 1 kg at 2 m/s towards one of 3 kg at rest, with a gap of 1 mm; centres `offset` off
    the line."""
    first = gx.RigidBody(
        1.0,
        np.full(3, 0.004),
        position=(-2 * RADIUS - 1e-3, 0, 0),
        velocity=(2, 0, 0),
        name="first",
    )
    second = gx.RigidBody(
        3.0,
        np.full(3, 0.012),
        position=(0, offset, 0),
        spin=(0, 0, 3),
        name="second",
    )
    stop = gx.connectors.Stop(first.port(), second.port(), length=2 * RADIUS, stiffness=STIFFNESS)
    return gx.Simulation(gx.Scene(stop), gx.Midpoint(dt=dt, tolerances=TIGHT))


def rates(run: gx.Simulation) -> np.ndarray:
    """Velocities of the centres, (2, 3)."""
    return run.system.unknowns.v0.array_r[:24].reshape(2, 4, 3)[:, 0].copy()


def test_central_impact_of_two_bodies() -> None:
    """Contact π√(m/k), penetration V√(m/k), m = m1 m2/(m1 + m2), then -1 and 1 m/s: 1 %."""
    run = collision(0.0, 2e-4)
    gaps = []
    touching = 0
    while run.time < 0.05:
        run.run(until=run.time + 2e-4)
        x = run.system.unknowns.q0.array_r[:24].reshape(2, 4, 3)[:, 0]
        gaps.append(float(np.linalg.norm(x[1] - x[0])) - 2 * RADIUS)
        touching += gaps[-1] < 0
    # Half a period of the reduced mass on the stop: π√(0.75 kg / 1e4 N/m).
    assert touching * 2e-4 == pytest.approx(0.02720699, rel=1e-2)
    # Largest penetration: V√(m/k) with V = 2 m/s.
    assert -min(gaps) == pytest.approx(0.01732051, rel=1e-2)
    # Elastic impact of 1 kg at 2 m/s on 3 kg: momentum and energy give -1 and 1 m/s.
    assert rates(run)[:, 0] == pytest.approx([-1.0, 1.0], rel=1e-2)
    assert abs(run.energy_error) < 1e-12
    error = np.abs(run.totals.momentum - run.first.momentum).max()
    assert error < 1e-12 * 2.0


def test_oblique_impact_conserves() -> None:
    """Energy, momentum and angular momentum over an impact off the line of the centres, which
    deflects both."""
    run = collision(0.12, 5e-4)
    run.run(until=0.06)
    # The impact must deflect, or angular momentum would be conserved trivially.
    assert abs(rates(run)[0, 1]) > 0.3
    assert abs(run.energy_error) < 1e-12
    error = np.abs(run.totals.momentum - run.first.momentum).max()
    assert error < 1e-12 * 2.0
    error = np.abs(run.totals.angular_momentum - run.first.angular_momentum).max()
    assert error < 1e-12


# bars of 0.5 m: E [Pa], ρ [kg/m³], length [m], section [m²], elements, speed of sound, stop as
# stiff as an element
E = 2.3e9
ρ = 1400.0
L = 0.5
A = 1e-4
N = 50
# Small enough that the flight through it takes no noticeable time.
GAP = 1e-6
# Speed of longitudinal waves [m/s].
C = (E / ρ) ** 0.5
ELEMENT = E * A * N / L


def bar(start: float, speed: float, name: str = "bar") -> gx.Cable:
    """From x = `start` [m] in the direction of x, moving along it with `speed` [m/s]."""
    mesh = line(MPI.COMM_SELF, [(start, 0, 0), (start + L, 0, 0)], N)
    law = gx.CableLaw(E * A, ρ * A)
    return gx.Cable(
        mesh,
        law,
        velocity=lambda x: np.outer([speed, 0, 0], np.ones(x.shape[1])),
        name=name,
    )


def contact(run: gx.Simulation, overlaps: Callable[[], bool]) -> float:
    """Duration of the contact [s], in a run through three times the passage of a wave."""
    # Half the time in which a wave passes an element.
    dt = L / C / N / 2
    touching = []
    while run.time < 3 * L / C:
        run.run(until=run.time + dt)
        if overlaps():
            touching.append(run.time)
    return touching[-1] - touching[0]


def test_bar_on_a_wall() -> None:
    """2L/c in contact at the mean stress ρcV, then rebound with -V; V = 1 m/s."""
    hit = bar(0.0, -1.0)
    wall = gx.connectors.Stop(
        hit.port("start"),
        gx.Ground((-1 - GAP, 0, 0)),
        length=1.0,
        stiffness=ELEMENT,
    )
    run = gx.Simulation(gx.Scene(wall), gx.Midpoint(dt=L / C / N / 2))
    duration = contact(run, lambda: run.system.unknowns.q0.array_r[0] < -GAP)
    # 5 %: the mesh of 50 elements disperses the front of the wave over some elements.
    assert duration == pytest.approx(2 * L / C, rel=5e-2)
    impulse = run.totals.momentum[0] - run.first.momentum[0]
    # ρ c V with V = 1 m/s; the impulse over the area and the duration is the mean stress.
    assert impulse / A / duration == pytest.approx(ρ * C, rel=3e-2)
    assert run.totals.momentum[0] / (ρ * A * L) == pytest.approx(1.0, rel=3e-2)
    assert abs(run.energy_error) < 1e-8


def test_two_bars_exchange_their_velocities() -> None:
    """2L/c in contact at the mean stress ρcΔv/2, then the first rests; Δv = 2 m/s.

    The stop between the ends holds them apart, as a rod without mass would.  Momentum is kept to
    the round-off of the velocities, that of positions over the step of 4 µs.
    """
    rod = 0.1
    one = bar(-L - rod / 2, 2.0, "one")
    two = bar(rod / 2 + GAP, 0.0, "two")
    stop = gx.connectors.Stop(one.port("end"), two.port("start"), length=rod, stiffness=ELEMENT)
    run = gx.Simulation(gx.Scene(stop), gx.Midpoint(dt=L / C / N / 2, tolerances=TIGHT))
    ends = one.port("end"), two.port("start")

    def momenta() -> list[float]:
        p = run.system.unknowns.M * run.system.unknowns.v0
        return [float(p.array_r[run.system.unknowns.numbering.owned(k)][::3].sum()) for k in (0, 1)]

    def overlaps() -> bool:
        x = run.system.unknowns.state.vectors(ends)[:, 0]
        return bool(x[1] - x[0] < rod)

    duration = contact(run, overlaps)
    mass = ρ * A * L
    first, second = momenta()
    # 2L/c of this bar [s].
    assert duration == pytest.approx(7.801895e-4, rel=5e-2)
    # ρ c Δv/2 [Pa] with Δv = 2 m/s.
    assert second / A / duration == pytest.approx(1.794436e6, rel=3e-2)
    assert second / mass == pytest.approx(2.0, rel=3e-2)
    assert first / mass == pytest.approx(0.0, abs=3e-2 * 2.0)
    # what vibrates in the bars is what their centres do not have
    # A few per cent of the energy stay in the vibrations that the dispersed front leaves.
    assert (first**2 + second**2) / (2 * mass) == pytest.approx(run.first.kinetic, rel=5e-2)
    # The stop is stiff: its force is resolved to the default tolerance only.
    assert abs(run.energy_error) < 1e-8
    error = abs(run.totals.momentum[0] - run.first.momentum[0])
    assert error < 1e-10 * run.first.momentum[0]
