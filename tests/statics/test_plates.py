"""Plates at rest: closed forms, thin limits, and the invariance of their forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import tape_spring, wrinkled_plate
from demos.studies.plate import buckled, curl, elastica, frequencies, pressed, roll_up
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import cell_axes, green_lagrange, surface_gradient
from gossamer_fx.core.forms.tied_strain import tied_strain
from gossamer_fx.mechanics.bodies.properties import cellwise
from gossamer_fx.meshes.plates import irregular_sheet
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.records.fields.fields import FieldFunctions
from tests.small_scenes import at_rest, rolled

WORLD = MPI.COMM_WORLD
LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-3)
FOIL = gx.Linear(E=3.5e9, nu=0.31, density=1420.0, thickness=1e-4)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("thickness", [1e-2, 1e-5])
def test_a_cantilever_bends_as_the_elastica_however_thin(comm, thickness):
    # From a thick to a very thin strip: no locking.
    assert elastica(comm, 16, thickness)["error"] < 4e-3


def test_strips_curl_roll_up_and_buckle_as_they_should(comm):
    # Errors of meshes of this size; the studies show their convergence.
    assert curl(comm, 16, math.pi / 2)["error"] < 2e-3
    assert roll_up(comm, 16)["error"] < 1e-3
    assert buckled(comm, 8, 60)["error"] < 1e-2


def test_a_clamped_disc_and_a_free_square_are_as_stiff_as_they_should_be():
    assert pressed(WORLD, 10, 20.0)["error"] < 1e-2
    assert frequencies(WORLD, 12, "square", "free")["error"] < 2e-2


def test_two_halves_of_a_symmetric_plate_are_one():
    """A strip clamped at both ends, and its half with a plane of symmetry."""
    rises = []
    for length, right in ((0.4, None), (0.2, (1.0, 0.0, 0.0))):
        plate = gx.Plate(sheet(WORLD, round(40 * length), 2, length, 0.1), LAW)
        end = (0, 1, 2) if right is None else (0,)
        clamps = (
            gx.Fixed(plate, "left", rotation=True),
            gx.Fixed(plate, "right", rotation=True, components=end, direction=right),
        )
        equilibrium = at_rest(plate, *clamps, gx.Pressure(plate, 20.0))
        rises.append(equilibrium.system.unknowns.q0.array_r[2::3].max())
    # The half has another mesh at its plane of symmetry.
    assert rises[1] == pytest.approx(rises[0], rel=1e-2)


def test_a_hinge_transmits_no_moment():
    """A strip that hangs over at a hinge: the part beyond it turns freely, and only membrane forces
    hold it."""
    plate = gx.Plate(irregular_sheet(WORLD, 6, 2, 0.3, 0.1), LAW, hinges=("middle",))
    clamp = gx.Fixed(plate, "left", rotation=True)
    load = gx.loads.EdgeLoad(plate, "right", force=(0.0, 0.0, 0.05))
    equilibrium = at_rest(plate, clamp, load)
    x = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)
    middle = x[plate.nodes("middle")].mean(axis=0)
    right = x[plate.nodes("right")].mean(axis=0)
    # The hinge is 0.15 m from the clamp; the part beyond hangs straight.
    assert middle[0] == pytest.approx(0.15, abs=2e-3)
    assert right == pytest.approx(middle + np.array([0, 0, 0.15]), abs=2e-3)


def test_small_strains_in_the_plane_are_those_of_the_film():
    """So nothing in the plane is without stiffness: strains linear in a cell are not changed by the
    ties."""
    domain = irregular_sheet(WORLD, 3, 3, 1.0, 1.0).domain
    V = fem.functionspace(domain, ("Lagrange", 2, (3,)))
    X = fem.Function(V)
    u = fem.Function(V)
    B = cell_axes(domain)
    X.interpolate(lambda p: p)
    u.x.array[:] = np.random.default_rng(1).standard_normal(len(u.x.array))
    tied = ufl.derivative(tied_strain(domain, X, B), X, u)
    plain = ufl.derivative(green_lagrange(surface_gradient(X, B)), X, u)
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
    size = fem.assemble_scalar(compile_form(ufl.dot(plain, plain) * dx))
    measured = fem.assemble_scalar(compile_form(ufl.dot(tied - plain, tied - plain) * dx))
    # The sum of squares, so that 1e-20 is round-off.
    assert measured < 1e-20 * size


def test_the_energy_of_a_cylinder_is_that_of_its_curvature():
    """½ D κ² per area, of positions that are those of a cylinder of radius 1/κ, wherever it is
    turned."""
    κ = 2.0
    errors = []
    Q, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))

    def rolled_and_turned(X):
        return Q @ (X + rolled(κ)(X)) - X

    for n in (8, 16):
        mesh = irregular_sheet(WORLD, n, n // 4, 1.0, 0.25)
        plate = gx.Plate(mesh, LAW, displacement=rolled_and_turned)
        energy = gx.Scene(plate).compile().balance.totals().stored["plate bending"]
        errors.append(abs(energy / (LAW.E * LAW.thickness**3 / 12 / 0.91 * κ**2 * 0.25 / 2) - 1))
    # As for the cylinder of an orthotropic plate.
    assert errors[1] < 5e-3 and errors[1] < errors[0] / 2


def test_a_sheared_plate_comes_to_rest_in_wrinkles(comm):
    """From a start that is nearly flat, against large compressive stress: to four fifths of its
    energy."""
    length = 0.1
    height = 0.05
    δ = 1e-3

    def rough(X):
        # 1 % of the wrinkles that come, and of another wave length.
        w = 1e-5 * np.sin(math.pi * X[1] / height) * np.sin(500 * (X[0] - 0.8 * X[1]))
        return np.stack([δ * X[1] / height, 0 * w, w])

    plate = gx.Plate(sheet(comm, 14, 7, length, height), FOIL, displacement=rough)
    moved = gx.Fixed(plate, "top", motion=lambda X, t: np.stack([δ + 0 * X[0], 0 * X[0], 0 * X[0]]))
    scene = gx.Scene(plate, gx.Fixed(plate, "bottom"), moved)
    search = gx.analysis.Continuation(
        first_step=1e-4,
        inner_tolerance=0.3,
        fast_iterations=20,
        max_iterations=40,
        tolerance=1e-3,
    )
    equilibrium = gx.Equilibrium(scene, search)
    plane = equilibrium.totals.stored["plate"]
    found = equilibrium.find()
    # Wrinkles release a fifth of the energy or more.
    assert sum(found.totals.stored.values()) < 0.8 * plane
    z = equilibrium.system.unknowns.q0.array_r[2::3]
    # And they are far deeper than their seed.
    assert comm.allreduce(float(z.max(initial=0.0)), op=MPI.MAX) > 10 * 1e-5


@pytest.mark.slow
def test_a_sheared_film_has_the_wrinkles_of_the_theory(comm):
    """Half wavelength and amplitude of Wong & Pellegrino (2006), and the force of a tension
    field."""
    found = wrinkled_plate.problem(comm, "theory", 5)
    # Theory of one wave length for the whole sheet: 15 and 20 % are what it can promise.
    assert found["λ/theory"] == pytest.approx(1, abs=0.15)
    assert found["a/theory"] == pytest.approx(1, abs=0.2)
    assert found["counted"] == pytest.approx(19, abs=3)
    assert found["force/film's"] == pytest.approx(1, abs=0.05)


@pytest.mark.slow
def test_a_tape_spring_folds_at_the_moment_of_the_theory(comm):
    """It resists until it snaps, and then with (1+ν) D α however far it is bent (Seffen &
    Pellegrino 1999)."""
    found = tape_spring.problem(comm, 8)
    # 5 % of the plateau, 15 % of the peak, which depends on the ends.
    assert found["plateau/(1+ν)Dα"] == pytest.approx(1, abs=0.05)
    assert found["peak/section's"] == pytest.approx(1, abs=0.15)


def test_properties_vary_by_group_or_by_place():
    """A sheet whose right half is ten times as heavy and twice as thick, said in two ways."""
    mesh = sheet(WORLD, 4, 4)
    heavy = lambda X: np.where(X[0] > 0.5, 1e4, 1e3)  # noqa: E731
    thick = lambda X: np.where(X[0] > 0.5, 2e-3, 1e-3)  # noqa: E731
    cells = np.flatnonzero(
        cellwise(mesh, lambda X: X[0] > 0.5, 0.0, (), "")._cpp_object.x.array > 0
    )
    mesh.groups["device"] = 2, cells.astype(np.int32)
    by_place = gx.Membrane(mesh, LAW, properties={"density": heavy, "thickness": thick})
    by_group = gx.Membrane(
        mesh,
        LAW,
        properties={"density": {"device": 1e4}, "thickness": {"device": 2e-3}},
    )
    for film in (by_place, by_group):
        run = gx.Simulation(
            gx.Scene(film, gx.RigidMotion(velocity=(1.0, 0.0, 0.0))), gx.Midpoint(dt=1e-3)
        )
        assert run.totals.momentum == pytest.approx([0.5 * 1.0 + 0.5 * 20.0, 0.0, 0.0], rel=1e-12)
    stretched = [
        gx.Scene(gx.Membrane(mesh, LAW, displacement=lambda X: 1e-3 * X, **given))
        .compile()
        .totals()
        .stored["film"]
        for given in (
            {},
            {"properties": {"thickness": thick}},
            {"properties": {"thickness": {"film": 2e-3}}},
        )
    ]
    # Mean of once and twice the thickness.
    assert stretched[1] == pytest.approx(1.5 * stretched[0], rel=1e-12)
    assert stretched[2] == pytest.approx(2 * stretched[0], rel=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: gx.Plate(sphere(WORLD, 0.3, 4), LAW), "curved"),
        (lambda m: gx.Plate(m, LAW, hinges=("film",)), "name curves"),
        (lambda m: gx.Plate(m, LAW, hinges=("no such",)), "has no group 'no such'"),
        (lambda m: gx.Plate(m, LAW, rest_curvature=((1.0, 2.0), (3.0, 4.0))), "give a tensor"),
        (
            lambda m: gx.Plate(m, LAW, rest_curvature={"left": np.eye(3)}),
            "has dimension 1; name a group of the cells",
        ),
        (lambda m: gx.Membrane(m, LAW, properties={"thickness": {"film": 0.0}}), "not above 0"),
        (lambda m: gx.Membrane(m, LAW, properties={"colour": {"film": 0.0}}), "choose from E, nu"),
        (
            lambda m: gx.Membrane(m, LAW, properties={"density": lambda X: X}),
            r"must return \('n',\)|must return",
        ),
        (
            lambda m: gx.Membrane(
                m,
                gx.Elastica(1e9, 0.3, density=1e3, thickness=1e-4, half_wavelength=0.1),
                properties={"thickness": {"film": 1e-3}},
            ),
            "derived",
        ),
        (
            lambda m: gx.Fixed(gx.Plate(m, LAW), "left", rotation=True, direction=(0.0, 0.0, 0.0)),
            "not all zero",
        ),
        (lambda m: gx.loads.EdgeMoment(gx.Plate(m, LAW), "left", moment=math.inf), "moment is inf"),
    ],
)
def test_bad_plates_are_refused_in_one_sentence(make, words):
    with pytest.raises(gx.InputError, match=words) as error:
        make(sheet(WORLD, 2, 2))
    assert "\n" not in str(error.value)


@pytest.mark.mpi
def test_curvature_and_moment_of_a_cylinder_are_fields(comm):
    """κ = 2/m along x, moments D κ and ν D κ; a rest curvature of as much leaves none."""
    κ = 2.0
    # D of ν = 0.3.
    D = LAW.E * LAW.thickness**3 / 12 / 0.91
    for rest, moment in ((None, D * κ), (np.diag((κ, 0.0, 0.0)), 0.0)):
        plate = gx.Plate(
            sheet(comm, 16, 4, 1.0, 0.25),
            LAW,
            displacement=rolled(κ),
            rest_curvature=rest,
        )
        fields = FieldFunctions(
            gx.Scene(plate).compile(), plate, ("curvature1", "curvature2", "moment1", "moment2")
        )
        fields.update()
        curvature1, curvature2, moment1, moment2 = (f.x.array for f in fields.functions)
        assert curvature1 == pytest.approx(κ, rel=1e-2)
        assert curvature2 == pytest.approx(0.0, abs=1e-2 * κ)
        assert moment1 == pytest.approx(moment, abs=1e-2 * D * κ)
        # ν D κ across.
        assert moment2 == pytest.approx(0.3 * moment, abs=1e-2 * D * κ)
    with pytest.raises(gx.InputError, match="has no field 'curvature1'"):
        film = gx.Membrane(sheet(comm, 2, 2), LAW)
        FieldFunctions(gx.Scene(film).compile(), film, ("curvature1",))
