"""`gx.analysis.minimise` and `minimise_runs`: SciPy and PETSc, fields, bases and runs, on 1 and 2
ranks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.meshes.disc import quarter_disc

THICKNESS = 25e-6  # m
RADIUS = 0.1  # m
BOUNDS = {"film.thickness": (0.9 * THICKNESS, 1.1 * THICKNESS)}


def blown_up(
    comm: MPI.Intracomm, rise: float = 0.0
) -> tuple[gx.Membrane, gx.Equilibrium, gx.analysis.Integral]:
    """A quarter of a disc under pressure with a field of thickness, and what it is to minimise.

    The result is the mean square of the deflection, and of the distance of the thickness from a
    given one, so that there is one minimum.  The stress-free shape is a bowl of a rise [m].
    """
    mesh = quarter_disc(comm, 6, RADIUS)
    x = mesh.domain.geometry.x
    x[:, 2] = rise * (1 - (x[:, 0] ** 2 + x[:, 1] ** 2) / RADIUS**2)
    film = gx.Membrane(
        mesh,
        gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=THICKNESS, residual_stiffness=1e-3),
        properties={"thickness": lambda x: np.full(x.shape[1], THICKNESS)},
    )
    held = [
        gx.Fixed(film, "rim"),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    ]
    scene = gx.Scene(film, *held, gx.Pressure(film, 100.0))
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-11))

    def form(q):
        excess = film.constants.thickness / THICKNESS - 1
        return ((q[2] / 3e-3) ** 2 + excess**2) / RADIUS**2 * film.dx

    return film, equilibrium, gx.analysis.Integral(film, form)


def by_midpoint(film: gx.Membrane, values: np.ndarray) -> np.ndarray:
    """Values of the cells of all ranks, in an order that no partition changes."""
    domain = film.mesh.domain
    own = domain.topology.index_map(2).size_local
    corners = domain.geometry.x[geometry_nodes(domain)[:own]]
    middle = corners.mean(axis=1).round(9)
    parts = film.comm.allgather(np.column_stack([middle, values]))
    rows = np.concatenate(parts)
    return rows[np.lexsort(rows[:, :3].T), 3]


@pytest.fixture(scope="module")
def by_scipy() -> tuple[float, np.ndarray]:
    """The minimum that SciPy finds on one rank: its value and the thicknesses."""
    film, equilibrium, result = blown_up(MPI.COMM_SELF)
    found = gx.analysis.minimise(
        equilibrium, of=result, by=["film.thickness"], bounds=BOUNDS, tolerance=1e-14
    )
    assert found.message.startswith("CONVERGENCE")
    return found.value, by_midpoint(film, found.parameters["film.thickness"])


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["blmvm", "bqnls"])
def test_petsc_finds_the_minimum_of_scipy_for_a_field_on_all_ranks(comm, by_scipy, method):
    film, equilibrium, result = blown_up(comm)
    found = gx.analysis.minimise(
        equilibrium,
        of=result,
        by=["film.thickness"],
        bounds=BOUNDS,
        method=method,
        tolerance=1e-14,
        iterations=200,
    )
    value, thicknesses = by_scipy
    assert found.converged, found.message
    assert found.value == pytest.approx(value, rel=1e-9)
    assert found.values[0] > 1.02 * value
    here = by_midpoint(film, found.parameters["film.thickness"])
    assert here == pytest.approx(thicknesses, rel=1e-4)
    # Some cells are at their bound, so that bounds are tested, too.
    at_bound = here > BOUNDS["film.thickness"][1] * (1 - 1e-9)
    assert 0 < at_bound.sum() < len(here)


@pytest.mark.mpi
def test_a_field_on_several_ranks_is_minimised_without_a_method(comm, by_scipy):
    _, equilibrium, result = blown_up(comm)
    found = gx.analysis.minimise(
        equilibrium, of=result, by=["film.thickness"], bounds=BOUNDS, tolerance=1e-12
    )
    assert found.value == pytest.approx(by_scipy[0], rel=1e-7)


@pytest.mark.mpi
def test_numbers_and_fields_are_minimised_together(comm):
    """A pressure, which all ranks share, and a thickness: with a free pressure the deflection
    vanishes."""
    _, equilibrium, result = blown_up(comm)
    found = gx.analysis.minimise(
        equilibrium,
        of=result,
        by=["pressure.pressure", "film.thickness"],
        bounds={"pressure.pressure": (20.0, 200.0)},
        method="blmvm",
        tolerance=1e-13,
    )
    assert found.parameters["pressure.pressure"] == pytest.approx([20.0], rel=1e-9)
    pressures = comm.allgather(found.parameters["pressure.pressure"][0])
    assert len(set(pressures)) == 1


@pytest.mark.mpi
def test_a_field_with_an_even_basis_is_one_number(comm):
    """A basis of one constant column gives the minimum that the number of the law has."""
    film, equilibrium, result = blown_up(comm)
    count = film.constants.thickness.function_space.dofmap.index_map.size_local
    by_basis = gx.analysis.minimise(
        equilibrium,
        of=result,
        by=["film.thickness"],
        basis={"film.thickness": np.full((count, 1), THICKNESS)},
        tolerance=1e-14,
    )
    values = by_basis.parameters["film.thickness"]
    amount = float(by_basis.amounts["film.thickness"][0])
    assert values == pytest.approx(THICKNESS * (1 + amount), rel=1e-12)
    # The slope with respect to the amount vanishes: the result of both neighbours is larger.
    variable = film.constants.thickness.x
    for change in (-1e-3, 1e-3):
        variable.array[:] = THICKNESS * (1 + amount + change)
        equilibrium.system.parameters_changed()
        equilibrium.find()
        assert result(equilibrium) > by_basis.value


@pytest.mark.mpi
def test_a_search_for_a_field_goes_on_on_all_ranks(comm):
    _, equilibrium, result = blown_up(comm)
    asked = {
        "of": result,
        "by": ["film.thickness"],
        "bounds": BOUNDS,
        "method": "blmvm",
    }
    first = gx.analysis.minimise(equilibrium, iterations=3, **asked)
    assert not first.converged
    second = gx.analysis.minimise(equilibrium, **asked)
    assert second.values[0] == pytest.approx(first.values[-1], rel=1e-9)
    assert second.value <= first.value


STEPS = 20
LENGTH = 0.9  # m


def swing(values: dict[str, np.ndarray]) -> gx.analysis.Gradient:
    """Height after a second of a mass on a spring, which starts 0.1 m below its rest, and its
    gradient."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), name="mass")
    spring = gx.connectors.Spring(
        mass.port(),
        gx.Ground((0.0, 0.0, 0.0)),
        stiffness=float(values["spring.stiffness"][0]),
        length=LENGTH,
    )
    run = gx.Simulation(gx.Scene(spring), gx.Midpoint(dt=1 / STEPS))
    tape = gx.analysis.RunTape(run)
    run.run(until=1.0)
    height = gx.probes.Position(mass.port(), "z")
    return gx.analysis.gradient(tape, of=height, by=["spring.stiffness"])


@pytest.mark.mpi
@pytest.mark.parametrize("method", [None, "blmvm"])
def test_a_run_is_minimised_to_the_closed_form(comm, method):
    """The mass is lowest after a whole oscillation; the rule turns by φ with tan(φ/2) = ω h/2 in a
    step."""
    found = gx.analysis.minimise_runs(
        swing,
        {"spring.stiffness": 30.0},
        bounds={"spring.stiffness": (20.0, 60.0)},
        method=method,
        tolerance=1e-14,
        comm=comm,
    )
    ω = 2 * STEPS * math.tan(math.pi / STEPS)
    assert found.value == pytest.approx(-1.0, abs=1e-10)
    assert found.parameters["spring.stiffness"] == pytest.approx([ω**2], rel=1e-4)


@pytest.mark.parametrize("method", ["L-BFGS-B", "blmvm"])
def test_a_result_that_is_zero_at_the_start_is_minimised(comm, method):
    """x² - 1 from x = 1."""

    def parabola(values):
        x = values["line.x"]
        slope = gx.analysis.Derivative("line.x", "1", 2 * x, None)
        return gx.analysis.Gradient(float(x[0] ** 2 - 1), "1", (slope,))

    found = gx.analysis.minimise_runs(parabola, {"line.x": 1.0}, method=method)
    assert found.value == pytest.approx(-1.0, abs=1e-12)


def test_a_limit_of_what_is_zero_at_the_start(comm):
    """A spring that is let out by 0.3 m at most hangs 0.3 m lower."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.1), comm=comm)
    top = gx.Ground((0.0, 0.0, 0.0))
    spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
    scene = gx.Scene(spring, gx.Gravity(mass, (0.0, 0.0, -10.0)))
    found = gx.analysis.minimise(
        gx.Equilibrium(scene),
        of=gx.probes.Position(mass.port(), "z"),
        by=["spring.length"],
        limits=[gx.analysis.Limit(gx.probes.Displacement(mass.port(), "z"), low=-0.3)],
    )
    assert found.converged
    assert found.value == pytest.approx(-1.4, abs=1e-8)


def test_what_runs_do_not_give_is_refused(comm):
    with pytest.raises(gx.InputError, match="evaluate returned a float"):
        gx.analysis.minimise_runs(lambda values: 1.0, {"spring.stiffness": 30.0})
    with pytest.raises(
        gx.InputError,
        match=r"the gradient has no derivative 'spring\.length'",
    ):
        gx.analysis.minimise_runs(
            swing, {"spring.stiffness": 30.0, "spring.length": 1.0}, iterations=1
        )
    with pytest.raises(gx.InputError, match="has 2 values and its derivative has 1"):
        gx.analysis.minimise_runs(swing, {"spring.stiffness": [30.0, 31.0]})
    with pytest.raises(gx.InputError, match=r"start is \{\}, of length 0"):
        gx.analysis.minimise_runs(swing, {})


@pytest.mark.mpi
def test_what_a_method_cannot_do_is_refused(comm):
    film, equilibrium, result = blown_up(comm)
    asked = {"of": result, "by": ["film.thickness"]}
    mass = gx.analysis.Integral(film, lambda q: film.constants.thickness * film.dx, unit="m³")
    limits = [gx.analysis.Limit(mass, high=1.0)]
    with pytest.raises(gx.InputError, match="kind StateArea; give a result with derivatives"):
        gx.analysis.Limit(gx.probes.StateArea(film, "slack"), high=1.0)
    with pytest.raises(gx.InputError, match="'blmvm' takes no limits"):
        gx.analysis.minimise(equilibrium, limits=limits, method="blmvm", **asked)
    with pytest.raises(
        gx.InputError,
        match=r"by, for the basis, has no name 'film\.E'; its names are: film\.thickness\.",
    ):
        gx.analysis.minimise(equilibrium, basis={"film.E": [[1.0]]}, **asked)
    with pytest.raises(
        gx.InputError, match=r"the basis of 'film.thickness' has the shape \(1, 1\)"
    ):
        gx.analysis.minimise(equilibrium, basis={"film.thickness": [[1.0]]}, **asked)
    # Arrays of bounds that are wrong on the last rank only are refused on all.
    cells = film.mesh.domain.topology.index_map(2).size_local
    is_last = comm.rank == comm.size - 1
    thickest = np.full(cells, THICKNESS)
    thinnest = thickest * (1 + 0.1 * is_last)
    with pytest.raises(gx.InputError, match="give the smaller one first"):
        gx.analysis.minimise(
            equilibrium, bounds={"film.thickness": (thinnest, thickest)}, method="blmvm", **asked
        )
    longer = np.full(cells + is_last, THICKNESS)
    with pytest.raises(gx.InputError, match=r"a bound of 'film.thickness' has the shape"):
        gx.analysis.minimise(
            equilibrium, bounds={"film.thickness": (0.0, longer)}, method="blmvm", **asked
        )
    if comm.size > 1:
        with pytest.raises(gx.InputError, match="distributed over 2 ranks; use method='blmvm'"):
            gx.analysis.minimise(equilibrium, method="L-BFGS-B", **asked)
        with pytest.raises(gx.InputError, match="distributed over 2 ranks"):
            gx.analysis.minimise(equilibrium, limits=limits, **asked)


def test_a_stress_free_shape_is_found_by_amounts_of_its_changes(comm):
    """A film that is blown up to a wanted height: its shape moves along z by one amount."""
    rise = 5e-4
    film, equilibrium, _ = blown_up(comm, rise)
    wanted = gx.analysis.Integral(
        film, lambda q: (q[2] - 5e-3 * (1 - (q[0] ** 2 + q[1] ** 2) / RADIUS**2)) ** 2 * film.dx
    )
    x = film.mesh.domain.geometry.x
    equilibrium.find()
    node_of = np.zeros(film.block.index_map.size_local, dtype=int)
    node_of[film.space.dofmap.list.ravel()] = geometry_nodes(film.mesh.domain).ravel()
    bowl = np.zeros((len(node_of), 3))
    bowl[:, 2] = 1e-3 * (1 - (x[node_of, :2] ** 2).sum(axis=1) / RADIUS**2)
    found = gx.analysis.minimise(
        equilibrium,
        of=wanted,
        by=["film.shape"],
        basis={"film.shape": bowl.reshape(-1, 1)},
        tolerance=1e-12,
    )
    assert found.converged
    assert found.value < 0.05 * found.values[0]
    height = rise + 1e-3 * found.amounts["film.shape"][0]
    assert film.mesh.domain.geometry.x[:, 2].max() == pytest.approx(height, rel=1e-9)
