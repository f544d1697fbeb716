"""`gx.analysis.fit` and `fit_runs`: closed forms, uncertainty against repeated measurements,
refusals."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.disc import quarter_disc

ANCHORS = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def hanging(lengths: tuple[float, float, float]) -> tuple[gx.Equilibrium, list[gx.probes.Position]]:
    """A mass on three ropes, and its coordinates."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0))
    ends = [(mass.port(), gx.Ground(anchor)) for anchor in ANCHORS]
    ropes = gx.connectors.RopeBundle(ends, stiffness=500.0, lengths=lengths)
    scene = gx.Scene(ropes, gx.Gravity(mass))
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-12))
    return equilibrium, [gx.probes.Position(mass.port(), axis) for axis in "xyz"]


@pytest.mark.mpi
def test_lengths_are_found_again_from_what_they_give(comm):
    lengths = (1.25, 1.35, 1.3)
    equilibrium, results = hanging(lengths)
    equilibrium.find()
    measured = [result(equilibrium) for result in results]
    start, results = hanging((1.3, 1.3, 1.3))
    found = gx.analysis.fit(
        start, of=results, measured=measured, by=["ropes.lengths"], uncertainty=1e-3
    )
    assert found.parameters["ropes.lengths"] == pytest.approx(lengths, rel=1e-8)
    # As many numbers as results: no residual is left to judge the model by.
    assert found.scatter == 0.0
    assert np.abs(found.residuals).max() < 1e-4


def test_the_standard_deviation_is_that_of_repeated_measurements(comm):
    """Of 60 measurements with random errors; the estimate of a standard deviation is known to 9
    %."""
    exact, results = hanging((1.3, 1.3, 1.3))
    exact.find()
    values = np.array([result(exact) for result in results])
    random = np.random.default_rng(7)
    error = 1e-4
    fitted = []
    scatters = []
    for _ in range(60):
        again, results = hanging((1.3, 1.3, 1.3))
        found = gx.analysis.fit(
            again,
            of=results,
            measured=values + error * random.standard_normal(3),
            by=["ropes.stiffness"],
            uncertainty=error,
        )
        fitted.append(found.parameters["ropes.stiffness"][0])
        scatters.append(found.scatter**2)
    # The last covariance without the scatter of the last measurement.
    deviation = found.errors["ropes.stiffness"][0] / max(1.0, found.scatter)
    assert np.std(fitted) == pytest.approx(deviation, rel=0.3)
    # The mean square of the residuals over the degrees of freedom is one, here to 13 % (one sigma).
    assert np.mean(scatters) == pytest.approx(1.0, abs=0.4)


def test_a_pressure_and_a_thickness_of_a_film_are_told_apart(comm):
    """A spring pulls the middle, so that the two heights depend on pressure and thickness in
    different ways."""

    def build(pressure: float, thickness: float):
        film = gx.Membrane(
            quarter_disc(comm, 6, 0.1),
            gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=thickness),
        )
        held = [
            gx.Fixed(film, "rim"),
            gx.Fixed(film, "x axis", components=(1,)),
            gx.Fixed(film, "y axis", components=(0,)),
        ]
        tip = gx.connectors.Spring(
            film.port("centre"), gx.Ground((0.0, 0.0, 0.1)), stiffness=20.0, length=0.1
        )
        scene = gx.Scene(film, *held, tip, gx.Pressure(film, pressure))
        ports = [film.port("centre"), film.port_at((0.05, 0.0, 0.0))]
        results = [gx.probes.Position(port, "z") for port in ports]
        return gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-11)), results

    shown, results = build(150.0, 30e-6)
    shown.find()
    measured = [result(shown) for result in results]
    start, results = build(100.0, 25e-6)
    found = gx.analysis.fit(
        start,
        of=results,
        measured=measured,
        by=["pressure.pressure", "film.thickness"],
        uncertainty=1e-6,
        bounds={"film.thickness": (1e-5, 1e-4)},
    )
    assert found.parameters["pressure.pressure"] == pytest.approx([150.0], rel=1e-6)
    assert found.parameters["film.thickness"] == pytest.approx([30e-6], rel=1e-6)
    # The covariance is in the units of the parameters.
    deviations = np.sqrt(np.diag(found.covariance))
    assert deviations[0] == pytest.approx(found.errors["pressure.pressure"][0])
    assert deviations[1] == pytest.approx(found.errors["film.thickness"][0])


def test_a_fit_has_the_loads_of_the_equilibrium(comm):
    """A pull of 10 N/s is 20 N after 2 s, where a spring of 100 N/m is 0.2 m longer."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=comm)
    spring = gx.connectors.Spring(
        mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=100.0, length=1.0, name="spring"
    )
    pull = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -10.0 * t))
    equilibrium = gx.Equilibrium(gx.Scene(spring, pull))
    equilibrium.find(at=2.0)
    height = gx.probes.Position(mass.port(), "z")
    found = gx.analysis.fit(equilibrium, of=[height], measured=[-1.5], by=["spring.length"])
    assert equilibrium.time == 2.0
    assert found.parameters["spring.length"] == pytest.approx([1.3], rel=1e-8)


def line(values: dict[str, np.ndarray]) -> list[gx.analysis.Gradient]:
    """Three points of a straight line a + b x, with their derivatives."""
    a = float(values["line.a"][0])
    b = float(values["line.b"][0])
    found = []
    for x in (0.0, 1.0, 2.0):
        by_a = gx.analysis.Derivative("line.a", "1", np.array([1.0]), None)
        by_b = gx.analysis.Derivative("line.b", "1", np.array([x]), None)
        found.append(gx.analysis.Gradient(a + b * x, "1", (by_a, by_b)))
    return found


def test_a_straight_line_has_the_covariance_of_the_textbook(comm):
    """Through (0, 0), (1, 1), (2, 3): a = -1/6, b = 3/2, C = σ² [[5, -3], [-3, 3]]/6, s² = 1/(6
    σ²)."""
    found = gx.analysis.fit_runs(
        line, {"line.a": 1.0, "line.b": 2.0}, measured=[0.0, 1.0, 3.0], uncertainty=2.0
    )
    assert found.parameters["line.a"] == pytest.approx([-1 / 6])
    assert found.parameters["line.b"] == pytest.approx([3 / 2])
    assert found.scatter == pytest.approx((1 / 6) ** 0.5 / 2)
    assert found.covariance == pytest.approx(4.0 / 6 * np.array([[5.0, -3.0], [-3.0, 3.0]]))


def test_what_cannot_be_fitted_is_refused(comm):
    start = {"line.a": 1.0, "line.b": 2.0}
    with pytest.raises(gx.InputError, match="returned 3 gradients; 2 values"):
        gx.analysis.fit_runs(line, start, measured=[0.0, 1.0])
    with pytest.raises(
        gx.InputError,
        match=r"the gradient has no derivative 'line\.c'; its derivatives are: line\.a, line\.b\.",
    ):
        gx.analysis.fit_runs(line, start | {"line.c": 0.0}, measured=[0.0, 1.0, 2.0])
    with pytest.raises(gx.InputError, match=r"uncertainty is 0\.0"):
        gx.analysis.fit_runs(line, start, measured=[0.0, 1.0, 2.0], uncertainty=0.0)
    equilibrium, results = hanging((1.3, 1.3, 1.3))
    with pytest.raises(gx.InputError, match="3 numbers are fitted to 2 results"):
        gx.analysis.fit(equilibrium, of=results[:2], measured=[0.0, 1.0], by=["ropes.lengths"])
    with pytest.raises(gx.InputError, match="there are 3 results and 2 measured values"):
        gx.analysis.fit(equilibrium, of=results, measured=[0.0, 1.0], by=["ropes.lengths"])
    with pytest.raises(gx.InputError, match="of is \\[\\], of length 0"):
        gx.analysis.fit(equilibrium, of=[], measured=[], by=["ropes.lengths"])


def test_parameters_that_results_do_not_determine_are_refused(comm):
    def same(values):
        """Both numbers act alike."""
        total = float(values["line.a"][0] + values["line.b"][0])
        one = np.array([1.0])
        slopes = tuple(
            gx.analysis.Derivative(name, "1", one, None) for name in ("line.a", "line.b")
        )
        return [gx.analysis.Gradient(total, "1", slopes)] * 3

    start = {"line.a": 1.0, "line.b": 2.0}
    # The second is met exactly, where SciPy's step divides by zero.
    for measured in ([0.0, 1.0, 2.0], [1.0, 1.0, 1.0]):
        with pytest.raises(gx.InputError, match=r"do not determine line\.a, line\.b"):
            gx.analysis.fit_runs(same, start, measured=measured)


@pytest.mark.mpi
def test_a_field_on_several_ranks_needs_a_basis(comm):
    if comm.size == 1:
        pytest.skip("on one rank every number is known")
    film = gx.Membrane(
        quarter_disc(MPI.COMM_WORLD, 6, 0.1),
        gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6),
        properties={"thickness": lambda x: np.full(x.shape[1], 25e-6)},
    )
    held = [
        gx.Fixed(film, "rim"),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    ]
    scene = gx.Scene(film, *held, gx.Pressure(film, 100.0))
    volume = gx.analysis.EnclosedVolume(film)
    with pytest.raises(gx.InputError, match="give a basis, or use one rank"):
        gx.analysis.fit(gx.Equilibrium(scene), of=[volume], measured=[1.0], by=["film.thickness"])
