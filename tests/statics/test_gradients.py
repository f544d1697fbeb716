"""Gradients of equilibria: each kind of parameter against central differences, and exact cases."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.design import sail_thickness
from demos.studies.crease import folded
from gossamer_fx.analysis.sensitivity.static import StaticGradients
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, crossed_sheet
from gossamer_fx.meshes.tube_section import cylinder
from tests.small_scenes import at_rest

SIDE = 0.5  # m
WRINKLING = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-2)
LINEAR = gx.Linear(2.5e9, 0.3, density=1400.0, thickness=25e-6)
# Relative changes of a parameter for differences; the best of them is compared.
CHANGES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
# Best agreement over several sizes of the difference.
AGREEMENT = 1e-6


def sail(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.analysis.Integral]]:
    """A film that is sheared so far that part of it wrinkles, under pressure and gravity."""

    def sheared(X):
        # Shear of 0.4 % against stretches of 0.1 %: about half of the film wrinkles.
        return np.vstack(
            [
                1e-3 * X[0] + 4e-3 * X[1],
                8e-4 * X[1],
                5e-3 * np.sin(np.pi * X[0] / SIDE) * np.sin(np.pi * X[1] / SIDE),
            ]
        )

    film = gx.Membrane(
        crossed_sheet(comm, 4, 4, SIDE, SIDE),
        WRINKLING,
        displacement=sheared,
        # Not constant, so that a derivative by a uniform factor would fail.
        properties={"thickness": lambda x: 25e-6 * (1 + 0.2 * np.sin(9 * x[0]))},
    )
    scene = gx.Scene(
        gx.Pressure(film, 20.0), gx.Gravity(film), *(gx.Fixed(film, edge) for edge in EDGES)
    )
    energy = gx.analysis.Integral(film, lambda q: film.density(film.measure(q)) * film.dx, unit="J")
    return scene, [gx.analysis.EnclosedVolume(film), energy]


def fabric(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.analysis.Integral]]:
    """Orthotropic film that is sheared so far that part of it wrinkles, under gravity."""

    def sheared(X):
        return np.vstack([1e-3 * X[0] + 4e-3 * X[1], 8e-4 * X[1], 0 * X[0]])

    law = gx.Orthotropic(
        4e9,
        1e9,
        0.3,
        0.5e9,
        density=1420.0,
        thickness=25e-6,
        direction=(1.0, 0.3, 0.0),
        residual_stiffness=1e-2,
    )
    film = gx.Membrane(crossed_sheet(comm, 3, 3, SIDE, SIDE), law, displacement=sheared)
    scene = gx.Scene(gx.Pressure(film, 20.0), *(gx.Fixed(film, edge) for edge in EDGES))
    return scene, [gx.analysis.EnclosedVolume(film)]


def cushion(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.analysis.Integral]]:
    """A quarter of an airbag of elements of order 2, whose rim slides inwards in its plane."""
    law = gx.Miyazaki(588e6, 0.4, density=1000.0, thickness=6e-4, residual_stiffness=1e-2)
    film = gx.Membrane(crossed_sheet(comm, 3, 3, 0.42, 0.42), law, order=2)
    held = [
        gx.Fixed(film, "top", components=(2,)),
        gx.Fixed(film, "right", components=(2,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "left", components=(0,)),
    ]
    scene = gx.Scene(gx.Pressure(film, 5000.0), *held)
    return scene, [gx.analysis.EnclosedVolume(film)]


def net(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.probes.Position]]:
    """A cable, ropes, springs and a force on a mass in the middle."""
    mass = gx.PointMass(0.5, (0.0, 0.0, -1.0), name="mass")
    cable = gx.Cable(line(comm, [(-1, 0, 0), (0, 0, -1)], 4), gx.CableLaw(200.0, 0.05))
    ends = [(mass.port(), gx.Ground((1.0, 0.3, 0.0))), (mass.port(), gx.Ground((0.2, -1.0, 0.0)))]
    scene = gx.Scene(
        gx.Gravity(mass),
        gx.Gravity(cable),
        gx.Fixed(cable, "start"),
        gx.constraints.BallJoint(cable.port("end"), mass.port()),
        gx.connectors.RopeBundle(ends, stiffness=80.0, lengths=[1.2, 1.1]),
        gx.connectors.Spring(mass.port(), gx.Ground((0.0, 0.0, -2.0)), stiffness=30.0, length=0.8),
        gx.loads.Force(mass.port(), (0.5, 0.2, -1.0)),
    )
    return scene, [gx.probes.Position(mass.port(), "x"), gx.probes.Position(mass.port(), "z")]


def strip(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.analysis.Integral]]:
    """A creased strip pulled at its ends."""
    law = gx.Linear(
        E=2.5e9,
        nu=0.3,
        density=1400.0,
        # 100 degrees: far from flat, where the crease has no moment.
        thickness=50e-6,
    )
    mesh = creased_strip(comm, 4, 1, 0.05, 0.01)
    angle = math.radians(100.0)
    plate = gx.Plate(mesh, law, hinges=["crease"], displacement=folded(angle), name="strip")
    scene = gx.Scene(
        plate,
        gx.connectors.Crease(plate, "crease", stiffness=2e-3, rest_angle=angle, name="fold"),
        gx.Fixed(plate, "crease"),
        gx.loads.EdgeLoad(plate, "left", force=(-0.05, 0.0, 0.0), name="left pull"),
        gx.loads.EdgeLoad(plate, "right", force=(0.05, 0.0, 0.0), name="right pull"),
    )
    return scene, [gx.analysis.Integral(plate, lambda q: q[2] * plate.dx, unit="m³")]


def pendulum(comm: MPI.Intracomm) -> tuple[gx.Scene, list[gx.probes.Position]]:
    """A rigid body on a hinge with a torsion spring, which gravity bends."""
    body = gx.RigidBody(0.5, (0.01, 0.02, 0.02), position=(0.3, 0.0, 0.0), name="arm")
    y = (0.0, 1.0, 0.0)
    hinge = body.frame((-0.3, 0.0, 0.0))
    scene = gx.Scene(
        gx.constraints.RevoluteJoint(gx.ground_frame(), hinge, axis=y),
        gx.connectors.TorsionSpring(
            gx.ground_frame(),
            hinge,
            axis=y,
            stiffness=2.0,
            rest_angle=-0.3,
            name="spiral",
        ),
        gx.Gravity(body),
        gx.loads.Force(body.port((0.3, 0.0, 0.0)), (0.0, 0.0, -1.0), name="push"),
    )
    return scene, [gx.probes.Position(body.port((0.3, 0.0, 0.0)), "z")]


# A scene with results, and the parameters by which they have gradients.
CASES = {
    "wrinkled sail": (
        sail,
        "film.thickness, film.E, film.nu, film.residual_stiffness, film.shape, pressure.pressure, "
        "gravity of film.g",
    ),
    "fabric": (fabric, "film.E1, film.E2, film.nu12, film.G12, film.thickness, film.shape"),
    "cushion": (cushion, "film.shape, film.E, pressure.pressure"),
    "net": (
        net,
        "ropes.lengths, ropes.stiffness, spring.length, spring.stiffness, force.force, cable.EA, "
        "cable.line_density, cable.shape, gravity of cable.g",
    ),
    "creased strip": (
        strip,
        "fold.stiffness, fold.rest_angle, strip.thickness, strip.E, right pull.force",
    ),
    "pendulum": (pendulum, "spiral.stiffness, spiral.rest_angle_change, push.force"),
}


def square(comm: MPI.Intracomm, law, displacement, cells=2, **more) -> tuple[gx.Membrane, list]:
    """A square film of 1 m, and the supports of its edges."""
    mesh = crossed_sheet(comm, cells, cells, 1.0, 1.0)
    film = gx.Membrane(mesh, law, displacement=displacement, **more)
    return film, [gx.Fixed(film, edge) for edge in EDGES]


def stretched(X):
    return 1e-3 * X


def direction(variable, seed: int) -> np.ndarray:
    """A change of a variable; of a field a smooth one, the same on any number of ranks."""
    function = variable.function(variable.get())
    if function is None:
        # Random for a few numbers, smooth for a field.
        return np.random.default_rng(seed).normal(size=len(variable.get()))
    space = function.function_space
    size = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    x, y = space.tabulate_dof_coordinates()[:owned, :2].T
    waves = [np.sin(7 * x + 3 * y), np.cos(5 * x - 2 * y), np.sin(4 * x + 6 * y)]
    return np.column_stack(waves[:size]).ravel()


def check_against_differences(
    equilibrium, names, results, changes, begin=lambda: None, agreement=AGREEMENT
) -> None:
    """Compare gradients of results at an equilibrium with central differences.

    Args:
        changes: relative changes of a parameter, of which the best is compared: truncation falls
            and round-off grows with smaller ones.
        begin: called before each search.
        agreement: of the best difference.
    """
    comm = equilibrium.system.comm
    equilibrium.find()
    gradients = StaticGradients(equilibrium, names)
    gradients.factorise()
    found = [gradients.of(result) for result in results]

    def at(variable, values) -> np.ndarray:
        variable.set(values)
        begin()
        equilibrium.system.parameters_changed()
        equilibrium.find()
        return np.array([result(equilibrium) for result in results])

    for k, variable in enumerate(gradients.variables):
        values = variable.get()
        change = direction(variable, k)
        size = comm.allreduce(np.abs(values).max(initial=0.0), op=MPI.MAX) or 1.0
        exact = np.array([gradient[variable.name].along(change) for gradient in found])
        errors = []
        for δ in changes:
            step = δ * size
            difference = at(variable, values + step * change) - at(variable, values - step * change)
            errors.append(np.abs(difference / (2 * step) / exact - 1))
        at(variable, values)
        assert np.min(errors, axis=0).max() < agreement, (variable.name, exact, errors)


@pytest.mark.mpi(3)
@pytest.mark.parametrize("case", CASES)
def test_gradients_agree_with_differences(comm, case):
    make, names = CASES[case]
    scene, results = make(comm)
    # The equilibrium must be more exact than the differences.
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-11))
    equilibrium.find()
    start = equilibrium.system.unknowns.q0.copy()

    def begin() -> None:
        start.copy(equilibrium.system.unknowns.q0)

    check_against_differences(equilibrium, names.split(", "), results, CHANGES, begin)


def test_energy_of_a_loaded_spring(comm):
    """ψ = F²/(2k): dψ/dF = F/k, dψ/dk = -F²/(2k²) and, as the force does not change, dψ/dL = 0."""
    force = 3.0
    k = 50.0
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0))
    spring = gx.connectors.Spring(mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=k, length=1.0)
    scene = gx.Scene(spring, gx.loads.Force(mass.port(), (0.0, 0.0, -force)))
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-13))
    equilibrium.find()
    names = ["force.force", "spring.stiffness", "spring.length"]
    found = gx.analysis.gradient(equilibrium, of=gx.analysis.Energy(), by=names)
    # ψ = F²/2k.
    assert found.value == pytest.approx(force**2 / (2 * k))
    assert found.unit == "J"
    assert found["force.force"].values == pytest.approx([0.0, 0.0, -force / k], abs=1e-12)
    assert found["spring.stiffness"].values == pytest.approx([-(force**2) / (2 * k**2)])
    assert found["spring.stiffness"].unit == "J/(N/m)"
    assert found["spring.length"].values == pytest.approx([0.0], abs=1e-10)


def test_energy_of_a_film_by_its_thickness_and_shape(comm):
    """A taut square held at its edges: W = E t ε²/(1-ν) A with ε of the stress-free size; exact
    derivatives."""
    E = LINEAR.E
    nu = LINEAR.nu
    t = LINEAR.thickness
    stretch = 1e-3
    film, held = square(comm, LINEAR, stretched)
    equilibrium = at_rest(film, *held)
    found = gx.analysis.gradient(
        equilibrium,
        of=gx.analysis.Energy(),
        by=["film.thickness", "film.shape"],
    )
    green = stretch + stretch**2 / 2
    energy = E * t / (1 - nu) * green**2
    assert found.value == pytest.approx(energy)
    assert found["film.thickness"].values == pytest.approx([energy / t])
    # The stress-free square grows to the size 1 + s, and the held rim stays: the stretch is (1 +
    # ε)/(1 + s). W = C A ((1 + ε)²/(1 + s)² - 1)²/4, A = (1 + s)²; dW/ds at s = 0 follows. Biaxial
    # stiffness per stretch, E t/(1 - ν).
    C = E * t / (1 - nu)
    exact = 2 * energy - 2 * C * green * (1 + stretch) ** 2
    shape = found["film.shape"]
    nodes = shape.function.function_space.tabulate_dof_coordinates()
    assert shape.along(nodes[: len(shape.values) // 3].ravel()) == pytest.approx(exact)
    assert shape.unit == "J/m"


def test_a_functional_of_the_user_gives_what_the_probe_gives(comm):
    scene, (_, probe) = net(comm)
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    mass = next(body for body in equilibrium.system.unknowns.bodies if body.name == "mass")
    height = gx.analysis.Functional(
        lambda run: float(run.system.unknowns.state[mass].positions()[0, 2]),
        lambda run: {mass: np.array([0.0, 0.0, 1.0])},
        unit="m",
    )
    names = ["ropes.lengths", "spring.stiffness"]
    own = gx.analysis.gradient(equilibrium, of=height, by=names)
    known = gx.analysis.gradient(equilibrium, of=probe, by=names)
    for name in names:
        # The same adjoint solution.
        assert own[name].values == pytest.approx(known[name].values, rel=1e-12)


@pytest.mark.mpi
def test_frequencies_of_a_wrinkled_sheet_agree_with_differences(comm):
    """The lowest modes of a sheared sheet, by thickness, E, density and the stress-free shape."""
    film, held = square(
        comm,
        WRINKLING,
        lambda X: np.vstack([1e-3 * X[0] + 2e-3 * X[1] * X[0], 8e-4 * X[1], 0 * X[0]]),
        cells=4,
        properties={"thickness": lambda x: np.full(x.shape[1], 25e-6)},
    )
    equilibrium = at_rest(film, *held, search=gx.analysis.Continuation(tolerance=1e-12))
    names = ["film.thickness", "film.E", "film.density", "film.shape"]
    modes = [gx.analysis.Frequency(equilibrium, number=k) for k in (0, 3)]
    check_against_differences(equilibrium, names, modes, CHANGES[1:])


def test_a_frequency_that_two_modes_share_is_refused(comm):
    film, held = square(comm, LINEAR, stretched, cells=4)
    equilibrium = at_rest(film, *held)
    with pytest.raises(gx.InputError, match="modes 1 and 2 have the same frequency"):
        gx.analysis.gradient(
            equilibrium,
            of=gx.analysis.Frequency(equilibrium, number=1),
            by=["film.E"],
        )


def hanging(comm: MPI.Intracomm) -> tuple[gx.Equilibrium, gx.analysis.Functional]:
    """A mass on two ropes, and the squared distance of it from (0.1, 0, -1)."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0))
    ends = [
        (mass.port(), gx.Ground((1.0, 0.0, 0.0))),
        (mass.port(), gx.Ground((-1.0, 0.0, 0.0))),
        (mass.port(), gx.Ground((0.0, 1.0, 0.0))),
    ]
    ropes = gx.connectors.RopeBundle(ends, stiffness=500.0, lengths=[1.3, 1.3, 1.3])
    equilibrium = gx.Equilibrium(
        gx.Scene(ropes, gx.Gravity(mass)), gx.analysis.Continuation(tolerance=1e-12)
    )
    # Not above the middle of the anchors, so that all three lengths must change.
    wanted = np.array([0.1, 0.1, -1.0])

    def away(run) -> np.ndarray:
        return run.system.unknowns.state.vector(mass.port()) - wanted

    distance = gx.analysis.Functional(
        lambda run: float(away(run) @ away(run)),
        lambda run: {mass: 2 * away(run)},
        unit="m²",
    )
    return equilibrium, distance


def test_a_minimisation_finds_the_lengths_of_ropes(comm):
    """Three lengths place a mass: the least distance is zero, and the ropes then balance its
    weight."""
    equilibrium, distance = hanging(comm)
    found = gx.analysis.minimise(
        equilibrium,
        of=distance,
        by=["ropes.lengths"],
        tolerance=1e-15,
        iterations=200,
    )
    assert found.converged
    # Distance squared [m²]; at the start it is above 1e-3.
    assert found.value < 1e-12
    assert found.values[0] > 1e-3
    anchors = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]])
    arms = np.array([0.1, 0.1, -1.0]) - anchors
    stretched = np.linalg.norm(arms, axis=1)
    tensions = 500.0 * (stretched - found.parameters["ropes.lengths"])
    force = -(tensions / stretched) @ arms
    # Weight of 1 kg.
    assert force == pytest.approx([0.0, 0.0, 9.80665], abs=1e-3)


def test_a_minimisation_keeps_bounds_and_limits_and_goes_on(comm):
    equilibrium, distance = hanging(comm)

    def minimised():
        return gx.analysis.minimise(
            equilibrium,
            of=distance,
            by=["ropes.lengths"],
            # The unbounded solution is outside of these bounds.
            bounds={"ropes.lengths": (1.25, 1.35)},
        )

    bounded = minimised()
    lengths = bounded.parameters["ropes.lengths"]
    assert lengths.min() >= 1.25 - 1e-12
    assert lengths.max() <= 1.35 + 1e-12
    # A search that is continued does not get worse.
    assert minimised().values[0] <= bounded.value * (1 + 1e-6)
    third, distance = hanging(comm)
    limit = gx.analysis.Limit(gx.analysis.Energy(), high=0.1)
    limited = gx.analysis.minimise(
        third,
        of=distance,
        by=["ropes.lengths"],
        bounds={"ropes.lengths": (1.25, 1.4)},
        limits=[limit],
        tolerance=1e-12,
    )
    # Constraints hold to their tolerance.
    assert gx.analysis.Energy()(third) <= 0.1 * (1 + 1e-6)
    assert limited.value < limited.values[0]


REFUSED: dict[str, tuple[Callable[[gx.Membrane], list], list[str], str]] = {
    "no such item": (lambda film: [], ["sail.thickness"], "no item 'sail'"),
    "no such parameter": (lambda film: [], ["film.colour"], "no parameter 'colour'"),
    "no dot": (lambda film: [], ["thickness"], "item.parameter"),
    "a pressure in time": (
        lambda film: [gx.Pressure(film, lambda t: 1.0)],
        ["pressure.pressure"],
        "'pressure' has no parameter 'pressure'",
    ),
    "contact without a given stiffness": (
        lambda film: [
            gx.Contact(film, gx.contact.Plane(point=(0, 0, -1), normal=(0, 0, 1)), distance=1e-3)
        ],
        ["film.thickness"],
        "'contact' derives its stiffness",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_has_no_gradient_is_refused_by_name(comm, what):
    more, names, words = REFUSED[what]
    film, held = square(comm, LINEAR, stretched)
    equilibrium = at_rest(film, *held, *more(film))
    with pytest.raises(gx.InputError, match=words):
        gx.analysis.gradient(equilibrium, of=gx.analysis.EnclosedVolume(film), by=names)


def test_the_demo_removes_most_of_the_wrinkles_at_equal_mass(comm):
    if comm.size > 1:
        pytest.skip("fields are varied on one rank")
    found = sail_thickness.main(cells=6, iterations=15, comm=comm)
    # A tenth of the wrinkling of the even sail, as the demo says.
    assert found["wrinkling over that of the even sail"] < 0.1
    assert found["mass over that of the even sail"] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("law", ["penalty", "barrier"])
def test_a_film_on_a_floor_sinks_with_its_weight(comm, law):
    """K d b'(z/d) + ρ t g = 0 of a film at the height z, so that dz/dt = -ρ g/(K b''(z/d)).

    b = (1 - x)²/2 of the penalty, (1 - x)³/(4x) of the barrier.
    """
    distance = 1e-3
    stiffness = 1e6
    density = 1400.0
    thickness = 1e-4
    film = gx.Membrane(
        crossed_sheet(comm, 2, 2, 0.1, 0.1),
        gx.Linear(1e9, 0.3, density=density, thickness=thickness),
        displacement=lambda X: 0 * X + np.array([[0.0], [0.0], [2 * distance]]),
    )
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    contact = gx.Contact(film, floor, distance=distance, stiffness=stiffness, law=law)
    # Nothing but contact holds the height.
    held = [gx.Fixed(film, edge, components=(0, 1)) for edge in EDGES]
    equilibrium = at_rest(contact, gx.Gravity(film), *held)
    height = gx.analysis.Integral(film, lambda q: q[2] / 0.01 * film.dx, unit="m")
    found = gx.analysis.gradient(
        equilibrium, of=height, by=["film.thickness", "film.density", "gravity of film.g"]
    )
    x = found.value / distance
    curvature = 1.0
    if law == "barrier":
        curvature = (1 - x**3) / (2 * x**3)
    g = 9.80665
    compliance = g / (stiffness * curvature)
    assert found["film.thickness"].values[0] == pytest.approx(-density * compliance, rel=1e-6)
    assert found["film.density"].values[0] == pytest.approx(-thickness * compliance, rel=1e-6)
    by_g = found["gravity of film.g"].values[2]
    assert by_g == pytest.approx(density * thickness * compliance / g, rel=1e-6)


def test_a_pressed_tube_has_the_gradients_of_differences(comm):
    """A tube between two planes, whose contact grows with the load: by its thickness and its
    pressure."""
    thickness = 1e-4
    pressure = 1000.0

    def pressed(change: dict[str, float]) -> tuple[gx.Equilibrium, gx.analysis.Integral]:
        law = gx.Linear(1e7, 0.3, density=1000.0, thickness=change.get("tube.thickness", thickness))
        tube = gx.Membrane(cylinder(comm, 0.05, 0.02, 16, 1), law, name="tube")
        planes = [
            gx.contact.Plane(
                point=(0, 0, side * 0.0515),
                normal=(0, 0, -side),
                motion=lambda t, side=side: (0.0, 0.0, -side * 5e-3 * t),
                name=f"plane {side}",
            )
            for side in (-1, 1)
        ]
        contact = gx.Contact(tube, *planes, distance=1e-3, stiffness=5e7, law="penalty")
        load = gx.Pressure(tube, change.get("pressure.pressure", pressure))
        held = [gx.Fixed(tube, rim, components=(0,)) for rim in ("first rim", "last rim")]
        held += [gx.Fixed(tube, line, components=(1,)) for line in ("top", "bottom")]
        equilibrium = gx.Equilibrium(gx.Scene(contact, load, *held))
        for k in range(5):
            equilibrium.find(at=k / 4)
        size = gx.analysis.Integral(tube, lambda q: q[2] ** 2 * tube.dx, unit="m⁴")
        return equilibrium, size

    equilibrium, size = pressed({})
    names = {"tube.thickness": thickness, "pressure.pressure": pressure}
    found = gx.analysis.gradient(equilibrium, of=size, by=list(names))
    assert equilibrium.system.balance.totals().stored["contact"] > 0
    for name, value in names.items():
        errors = []
        for δ in CHANGES[1:4]:
            sizes = []
            for sign in (-1, 1):
                other, of = pressed({name: value * (1 + sign * δ)})
                sizes.append(of(other))
            difference = (sizes[1] - sizes[0]) / (2 * δ * value)
            errors.append(abs(found[name].values[0] / difference - 1))
        assert min(errors) < AGREEMENT, (name, errors)
