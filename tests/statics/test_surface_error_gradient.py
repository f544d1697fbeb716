"""The derivative of the surface error: by positions, and as a gradient of an equilibrium."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import crossed_sheet
from tests.small_scenes import at_rest

LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)


def bowl(X):
    """A dish that no surface of the search fits."""
    return np.vstack(
        [0 * X[:2], 0.3 * X[0] ** 2 + 0.1 * X[1] ** 2 + 0.05 * np.sin(5 * X[0] + X[1])]
    )


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("surface", ["plane", "paraboloid", "sphere"])
@pytest.mark.parametrize("quantity", ["rms", "peak_to_valley", "tilt", "radius", "focal_length"])
def test_derivative_by_positions(comm, surface, order, quantity):
    if surface == "plane" and quantity in ("radius", "focal_length"):
        pytest.skip("a plane has none")
    film = gx.Membrane(crossed_sheet(comm, 4, 3, 1.0, 0.7), LAW, order=order, displacement=bowl)
    equilibrium = gx.Equilibrium(gx.Scene(film))
    system = equilibrium.system
    error = gx.probes.SurfaceError(film, surface, quantity=quantity)
    q = system.unknowns.q0
    by_position, by_velocity, direction = (system.unknowns.numbering.vector() for _ in range(3))
    error.add_derivative(system, by_position, by_velocity)
    # The same direction on any number of ranks.
    x = q.array_r.reshape(-1, 3)
    direction.array[:] = np.column_stack(
        [np.sin(7 * x[:, 1]), x[:, 0] ** 2, np.cos(9 * x[:, 0] - x[:, 1])]
    ).ravel()
    values = []
    for sign in (1, -1):
        q.axpy(sign * 1e-6, direction)
        values.append(error(equilibrium))
        q.axpy(-sign * 1e-6, direction)
    assert by_position.dot(direction) == pytest.approx(np.diff(values)[0] / -2e-6, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("quantity", ["rms", "focal_length", "peak_to_valley"])
def test_gradient_of_an_equilibrium(comm, quantity):
    """By the pressure under a film: differences of equilibria."""

    def found(pressure):
        film = gx.Membrane(crossed_sheet(comm, 6, 6), LAW, name="film")
        rim = [gx.Fixed(film, edge, name=edge) for edge in ("left", "right", "bottom", "top")]
        load = gx.Pressure(film, pressure, name="load")
        return film, at_rest(*rim, load)

    film, equilibrium = found(500.0)
    error = gx.probes.SurfaceError(film, "paraboloid", quantity=quantity)
    by_pressure = gx.analysis.gradient(equilibrium, of=error, by=["load.pressure"])
    values = []
    for pressure in (500.5, 499.5):
        other, state = found(pressure)
        values.append(gx.probes.SurfaceError(other, "paraboloid", quantity=quantity)(state))
    assert float(np.sum(by_pressure["load.pressure"].values)) == pytest.approx(
        values[0] - values[1], rel=1e-4
    )


def test_what_has_no_derivative_is_refused(comm):
    flat = gx.Membrane(crossed_sheet(comm, 2, 2), LAW)
    system = gx.Equilibrium(gx.Scene(flat)).system
    vectors = [system.unknowns.numbering.vector() for _ in range(2)]
    with pytest.raises(gx.InputError, match="no derivative; start from another shape"):
        gx.probes.SurfaceError(flat).add_derivative(system, *vectors)
    with pytest.raises(gx.InputError, match="not tilted, where its tilt has no derivative"):
        gx.probes.SurfaceError(flat, quantity="tilt").add_derivative(system, *vectors)
    dish = gx.probes.SurfaceError(flat, "paraboloid", quantity="focal_length")
    with pytest.raises(gx.InputError, match="no curvature, so that its focal_length has no"):
        dish.add_derivative(system, *vectors)
    with pytest.raises(gx.InputError, match='at the "mean" has no derivative'):
        gx.probes.SurfaceError(flat, at="mean").add_derivative(system, *vectors)


@pytest.mark.mpi
def test_a_saddle_has_no_focal_length_to_trust(comm, caplog):
    """The paraboloid that fits it best lies on its side, which is said once."""
    film = gx.Membrane(
        crossed_sheet(comm, 4, 4),
        LAW,
        displacement=lambda X: np.vstack([0 * X[:2], (X[0] - 0.5) ** 2 - 0.8 * (X[1] - 0.5) ** 2]),
    )
    equilibrium = gx.Equilibrium(gx.Scene(film))
    focal = gx.probes.SurfaceError(film, "paraboloid", quantity="focal_length")
    for _ in range(2):
        focal(equilibrium)
    words = [one.message for one in caplog.records if "from the one asked for" in one.message]
    assert len(words) == (1 if comm.rank == 0 else 0)
