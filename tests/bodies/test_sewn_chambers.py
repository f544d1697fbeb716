"""Chambers of several films that are sewn together: volume, conservation, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import crossed_sheet

COMM = MPI.COMM_WORLD
FILM = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
AIR = gx.IdealGas(gamma=1.4, R=287.0)
EDGES = ("bottom", "right", "top", "left")
SIDE = 0.2


def bulged(height: float):
    """A displacement of a square that leaves its edges where they are."""

    def displacement(X: np.ndarray) -> np.ndarray:
        shape = np.sin(np.pi * X[0] / SIDE) * np.sin(np.pi * X[1] / SIDE)
        return np.vstack([0 * X[0], 0 * X[0], height * shape])

    return displacement


def two_squares(cells: tuple[int, int], order: int = 1, gap: float = 0.0, **more):
    """Two squares that bulge to both sides, their edges `gap` apart; normals of both point up."""
    films = []
    for name, n, side in (("top", cells[0], 1.0), ("bottom", cells[1], -1.0)):
        bulge = bulged(side * 0.03)
        films.append(
            gx.Membrane(
                crossed_sheet(COMM, n, n, SIDE, SIDE),
                FILM,
                order=order,
                name=name,
                displacement=lambda X, bulge=bulge, side=side: (
                    bulge(X) + np.array([[0], [0], [side * gap / 2]])
                ),
                **more,
            )
        )
    closing = (0.0, 0.01) if gap else None
    seams = [gx.Seam(films[0], edge, films[1], edge, closing=closing) for edge in EDGES]
    return films, seams


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("cells", "order"), [((4, 4), 1), ((3, 4), 1), ((2, 2), 2)])
def test_volume_and_conservation_of_a_pillow_of_two_films(
    cells: tuple[int, int], order: int
) -> None:
    """Energy and both momenta are kept to round-off, also where the meshes differ."""
    turn = {"velocity": lambda X: np.vstack([-3 * X[1], 3 * X[0], 2 * X[0]])}
    films, seams = two_squares(cells, order, **turn)
    bag = gx.Chamber(films, gas=AIR, pressure=500.0, temperature=300.0, seams=seams)
    run = gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=5e-4))
    # Two sheets with the volume h ∫∫ sin sin = h a² 4/π² each; the coarse mesh misses up to 10 %.
    exact = 2 * 0.03 * SIDE**2 * 4 / np.pi**2
    assert run.chamber("chamber").volume == pytest.approx(exact, rel=0.1)
    start = run.chamber("chamber").volume
    run.run(until=5e-3)
    # The pillow must breathe by more than 1 %, or gas does no work.
    assert abs(run.chamber("chamber").volume / start - 1) > 0.01
    assert abs(run.energy_error) < 1e-10
    scale = run.first.angular_momentum[2]
    assert run.totals.momentum == pytest.approx(run.first.momentum, abs=1e-9 * scale / SIDE)
    assert run.totals.angular_momentum == pytest.approx(
        run.first.angular_momentum, abs=1e-9 * scale
    )


def test_sewn_under_pressure() -> None:
    """While the seams close the strips bear the pressure too: energy and momentum are kept."""
    films, seams = two_squares((2, 3), gap=0.002)
    bag = gx.Chamber(films, gas=AIR, pressure=200.0, temperature=300.0, seams=seams)
    run = gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=1e-3))
    volume = run.chamber("chamber").volume
    # The gap is that of a box: side x side x gap more than the closed pillow.
    closed, none = two_squares((2, 3))
    of_closed = gx.Simulation(
        gx.Scene(gx.Chamber(closed, gas=AIR, pressure=200.0, temperature=300.0, seams=none)),
        gx.Midpoint(dt=1e-3),
    )
    assert volume == pytest.approx(of_closed.chamber("chamber").volume + SIDE**2 * 0.002, rel=1e-12)
    run.run(until=0.012)
    assert abs(run.energy_error) < 1e-10
    # It starts at rest, and seams pull with equal and opposite forces.
    assert np.abs(run.totals.momentum).max() < 1e-13


@pytest.mark.mpi
def test_tangent_of_an_open_seam_with_gas() -> None:
    """A δq + G δy against central differences of the residual, strips and gas included."""
    films, seams = two_squares((3, 4), gap=0.01)
    bag = gx.Chamber(films, gas=AIR, pressure=2e4, temperature=300.0, seams=seams)
    system = gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=1e-3)).system
    y0 = system.equations.begin_step(1e-3)
    system.equations.set_inertia(0.0)
    first = system.unknowns.q0.getOwnershipRange()[0]
    δ = system.unknowns.q0.duplicate()
    # A smooth change that depends on the global number only, so that it is the same on any ranks.
    δ.array[:] = 1e-2 * np.sin(1.3 * (first + np.arange(system.unknowns.numbering.size_local)))
    # Ties that follow from others have multipliers that stay zero.
    δ.array[system.unknowns.supports.held] = 0.0

    def residual(step: float):
        z = system.unknowns.q0.copy()
        z.axpy(step, δ)
        system.equations.set_end(z)
        r = z.duplicate()
        system.equations.residual(y0, r)
        return r

    # Central differences with 1e-5 × 1e-2: truncation and round-off are both below 1e-8.
    ε = 1e-5
    difference = residual(ε) - residual(-ε)
    difference.scale(1 / (2 * ε))
    residual(0.0)
    columns, rows, C = system.matrices.coupling()
    Hδ = [0.0 if row is None else COMM.allreduce(row @ δ.array_r) for row in rows]
    δy = np.linalg.solve(C, -np.array(Hδ))
    predicted = system.matrices.tangent() * δ
    for column, change in zip(columns, δy, strict=True):
        if column is not None:
            predicted.array[:] += change * column
    assert (predicted - difference).norm() < 1e-7 * difference.norm()


@pytest.mark.mpi
def test_pressure_is_shown_on_all_films() -> None:
    films, seams = two_squares((4, 4))
    bag = gx.Chamber(films, gas=AIR, pressure=500.0, temperature=300.0, seams=seams)
    run = gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=5e-4))
    for film in films:
        _, values = gx.fields.field_values(run, film, field="pressure")
        # The pressure that was given: the step has not begun.
        assert np.allclose(values, 500.0)


@pytest.mark.mpi
def test_open_and_foreign_edges_are_refused() -> None:
    films, seams = two_squares((2, 2))

    def scene(enclosure, seams) -> None:
        bag = gx.Chamber(enclosure, gas=AIR, pressure=500.0, temperature=300.0, seams=seams)
        gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=5e-4))

    with pytest.raises(gx.InputError, match="4 edges of 'top', 'bottom' are open"):
        scene(films, seams[:3])
    with pytest.raises(gx.InputError, match="is on 'bottom', which does not bound it"):
        scene(films[:1], seams)
    with pytest.raises(gx.InputError, match="without seams"):
        scene(films, ())
    with pytest.raises(gx.InputError, match="seams belong to films"):
        scene(gx.gas.Piston(films[0].port("bottom left"), 1.0, direction=(0, 0, 1)), seams)
