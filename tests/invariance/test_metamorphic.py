"""What must not change a result, over all kinds of scenes: a body that touches nothing; flags and
stability in each description; orders are those that docstrings name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from gossamer_fx.analysis.vibration import natural_modes
from gossamer_fx.meshes.sheet import sheet
from tests.invariance.kinds import KINDS, Kind
from tests.invariance.test_invariance import in_each_kind, written
from tests.invariance.transformations import ALL_AT_ONCE, SAME, SINGLE, Description

AT_REST = [kind for kind in KINDS if kind.dt == 0]
at_rest_kinds = pytest.mark.parametrize("kind", AT_REST, ids=lambda kind: kind.name)

TIGHT = gx.Tolerances(relative=1e-13)


def with_a_stranger(kind: Kind) -> list[object]:
    """A point mass of 10 t that rests far from the scene, on springs to the ground."""
    far = (1e3, 2e3, 0.0)
    stranger = gx.PointMass(1e4, far, name="stranger")
    springs = [
        gx.connectors.AxialSpring(
            stranger.port(), 1e5, direction=tuple(axis), origin=far, name=f"stranger {k}"
        )
        for k, axis in enumerate(np.eye(3))
    ]
    return [stranger, *springs]


@in_each_kind
def test_a_body_that_touches_nothing_changes_nothing(kind: Kind) -> None:
    if kind.name in ("orbit", "reduced film"):
        pytest.skip("every body flies along, or is recorded")
    at = Description(SAME, MPI.COMM_SELF)
    made = kind.make(at)
    items = [*at.in_order(made.parts), *with_a_stranger(kind)]
    if kind.dt == 0:
        equilibrium = gx.Equilibrium(gx.Scene(*items))
        equilibrium.find(progress=False)
        system = equilibrium.system
    else:
        run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=kind.dt, tolerances=TIGHT))
        run.run(until=kind.dt * kind.steps)
        system = run.system
    alone = written(kind)
    for k, name in enumerate(sorted(made.ports)):
        port = made.ports[name]
        moved = system.unknowns.state.vector(port) - system.unknowns.initial.vector(port)
        size = np.abs(alone.displacements).max() or 1.0
        # The far coordinates have a larger round-off.
        assert np.abs(moved - alone.displacements[k]).max() < 1e3 * kind.tolerance * size


def flags(kind: Kind, transformation: object) -> tuple[object, ...]:
    """What an equilibrium says of itself."""
    at = Description(transformation, MPI.COMM_SELF)
    found = gx.Equilibrium(gx.Scene(*at.in_order(kind.make(at).parts))).find(progress=False)
    return found.regular, found.unstable, len(found.free), len(found.slack)


@at_rest_kinds
@pytest.mark.parametrize("name", [*SINGLE, "all at once"])
def test_flags_and_stability_do_not_depend_on_the_description(kind: Kind, name: str) -> None:
    transformation = ALL_AT_ONCE if name == "all at once" else SINGLE[name]
    if name in kind.left_out:
        pytest.skip(kind.left_out[name])
    transformation = transformation.without(kind.left_out)
    *found, unstable, free, slack = flags(kind, transformation)
    *as_written, as_written_unstable, free_as_written, slack_as_written = flags(kind, SAME)
    assert (found, free, slack) == (as_written, free_as_written, slack_as_written)
    assert unstable == as_written_unstable


# The order in dt that the docstring of each stepper names.
ORDERS = {
    "Midpoint": (lambda dt: gx.Midpoint(dt, tolerances=TIGHT), 2),
    "Midpoint, EndPoint": (
        lambda dt: gx.Midpoint(dt, rule=gx.steppers.EndPoint(), tolerances=TIGHT),
        1,
    ),
    "VariationalMidpoint": (lambda dt: gx.steppers.VariationalMidpoint(dt, tolerances=TIGHT), 2),
    "GeneralizedAlpha": (lambda dt: gx.GeneralizedAlpha(dt, tolerances=TIGHT), 2),
    "GeneralizedAlpha, 0": (
        lambda dt: gx.GeneralizedAlpha(dt, spectral_radius=0.0, tolerances=TIGHT),
        2,
    ),
}


def pendulum_end(stepper: object, damping: float) -> np.ndarray:
    """Where a mass on a spring and a damper is after half a second."""
    mass = gx.PointMass(1.0, (1.0, 0.0, 0.2), name="mass")
    top = gx.Ground((0.0, 0.0, 0.0))
    items: list[object] = [
        gx.connectors.Spring(mass.port(), top, stiffness=60.0, length=0.9),
        gx.Gravity(mass),
    ]
    if damping:
        items.append(gx.connectors.Damper(mass.port(), top, damping=damping))
    run = gx.Simulation(gx.Scene(*items), stepper)
    run.run(until=0.5)
    return np.array(run.system.unknowns.state.vector(mass.port()))


def exact_end(damping: float) -> np.ndarray:
    """The same by another program."""

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:3], y[3:]
        length = float(np.linalg.norm(x))
        along = x / length
        pull = 60.0 * (length - 0.9) + damping * float(along @ v)
        return np.concatenate([v, -pull * along + [0.0, 0.0, -9.80665]])

    start = np.array([1.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    return solve_ivp(rates, (0, 0.5), start, rtol=1e-11, atol=1e-13).y[:3, -1]


@pytest.mark.parametrize(
    ("name", "damping", "order"),
    [
        *((name, 0.0, order) for name, (_, order) in ORDERS.items()),
        ("Midpoint", 2.0, 2),
        ("VariationalMidpoint", 2.0, 2),
        # Its docstring says so.
        ("GeneralizedAlpha", 2.0, 1),
    ],
)
def test_steppers_have_the_order_that_they_name(name: str, damping: float, order: int) -> None:
    make = ORDERS[name][0]
    exact = exact_end(damping)
    errors = [
        float(np.linalg.norm(pendulum_end(make(0.5 / count), damping) - exact))
        for count in (40, 80, 160)
    ]
    rates = [math.log2(errors[k] / errors[k + 1]) for k in range(2)]
    assert rates == pytest.approx([order, order], abs=0.25)


@pytest.mark.mpi
def test_the_stability_of_a_closed_film_of_tied_halves_is_known(comm) -> None:
    """The pressure on each half has an unsymmetric stiffness at the cut."""
    (tube,) = (kind for kind in AT_REST if kind.name == "inflated tube")
    at = Description(SINGLE["split"], comm)
    equilibrium = gx.Equilibrium(gx.Scene(*at.in_order(tube.make(at).parts)))
    assert equilibrium.find(progress=False).unstable == 0


def test_the_stability_of_a_film_under_a_pressure_without_potential_is_not_known(comm) -> None:
    """A sheet with a free edge that is tied to another one: the cut does not close it."""
    film = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    whole = {"displacement": lambda X: 1e-3 * np.vstack([X[0], X[1], 0 * X[0]])}
    left = gx.Membrane(sheet(comm, 3, 3, 0.1, 0.1), film, name="left", **whole)
    right = gx.Membrane(
        sheet(comm, 3, 3, 0.1, 0.1),
        film,
        name="right",
        displacement=lambda X: np.vstack([0.1 + 1e-3 * (0.1 + X[0]), 1e-3 * X[1], 0 * X[0]]),
    )
    items = [
        gx.Tie(left, right, group_a="right", group_b="left"),
        gx.Fixed(left, "left"),
        gx.Fixed(right, "right"),
        gx.Pressure(left, 100.0),
        gx.Pressure(right, 100.0, name="on the right"),
    ]
    assert gx.Equilibrium(gx.Scene(*items)).find(progress=False).unstable == -1


def test_modes_of_tied_film_that_a_search_has_not_found_are_searched_again(
    comm, monkeypatch
) -> None:
    """The stiffness is symmetric only in the motions that the ties allow, so that it was not
    counted."""
    (tube,) = (kind for kind in AT_REST if kind.name == "inflated tube")
    at = Description(SINGLE["split"], comm)
    equilibrium = gx.Equilibrium(gx.Scene(*at.in_order(tube.make(at).parts)))
    equilibrium.find(progress=False)
    expected = [mode.frequency for mode in gx.analysis.modes(equilibrium, 3)]
    search = natural_modes._search
    searches = []

    def forgetful(operator, count: int, shift: float):
        """Leave the lowest mode out, at first."""
        searches.append(count)
        if len(searches) > 1:
            return search(operator, count, shift)
        found = sorted(search(operator, count + 1, shift), key=lambda mode: mode.frequency)
        return iter(found[1:])

    monkeypatch.setattr(natural_modes, "_search", forgetful)
    found = [mode.frequency for mode in gx.analysis.modes(equilibrium, 3)]
    assert len(searches) > 1
    assert found == pytest.approx(expected, rel=1e-6)
