"""Orthotropic plates: bending energy, moments and natural modes in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.bending import Bending, IsotropicBending, OrthotropicBending
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import cell_axes
from meshes.plates import irregular_sheet
from meshes.sheet import EDGES, sheet
from tests.small_scenes import at_rest, momentum_changes, rolled, run_until

WORLD = MPI.COMM_WORLD
# Pa: ten to one.
E1 = 10e9
E2 = 1e9
NU12 = 0.25
G12 = 0.6e9
NUMBERS = {"density": 1500.0, "thickness": 1e-3}


def law(angle: float = 0.0) -> gx.LinearOrthotropic:
    """A law whose first axis is at an angle to x."""
    direction = (math.cos(angle), math.sin(angle), 0.0)
    return gx.LinearOrthotropic(E1, E2, NU12, G12, direction=direction, **NUMBERS)


def stiffnesses() -> tuple[float, float, float, float]:
    """D11, D12, D22, D66 [N m] of a uniform plate."""
    factor = NUMBERS["thickness"] ** 3 / 12
    definite = 1 - NU12**2 * E2 / E1
    return (
        factor * E1 / definite,
        factor * NU12 * E2 / definite,
        factor * E2 / definite,
        factor * G12,
    )


def stiffness_along(angle: float, D=None) -> float:
    """Stiffness [N m] of bending to a cylinder along a direction at an angle to the first axis."""
    D11, D12, D22, D66 = D or stiffnesses()
    c = math.cos(angle)
    s = math.sin(angle)
    return D11 * c**4 + 2 * (D12 + 2 * D66) * c**2 * s**2 + D22 * s**4


# Numbers of unit size: E, ν, or E1, E2 ... and the angle of the first axis.
BENDING = [(IsotropicBending, (1.0, nu)) for nu in (0.0, 0.45)]
BENDING += [
    (OrthotropicBending, (50.0, 1.0, 1.0, 0.3, math.cos(angle), math.sin(angle)))
    for angle in (0.0, 0.4, 1.3)
]


@pytest.mark.parametrize(("kind", "numbers"), BENDING)
def test_the_bending_energy_is_never_negative_with_hardly_more_than_the_least_penalty(
    kind, numbers
):
    """The bound of the penalty, with the stiffness across each edge."""
    domain = irregular_sheet(MPI.COMM_SELF, 3, 3, 1.0, 0.2, seed=4).domain
    V = fem.functionspace(domain, ("Lagrange", 2, (3,)))
    x = ufl.TrialFunction(V)
    w = ufl.TestFunction(V)
    stiffness = kind(*(constant(domain, number) for number in numbers))
    # Just above the least penalty, 1.
    bending = Bending(domain, cell_axes(domain), stiffness, constant(domain, 1.001))
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 0})
    dS, ds = (ufl.Measure(kind, domain, metadata={"quadrature_degree": 2}) for kind in ("dS", "ds"))
    clamp = bending.clamp(x, w, ufl.FacetNormal(domain), ds)
    K = assemble_matrix(compile_form(bending.cells(x, w, dx) + bending.edges(x, w, dS) + clamp))
    K.assemble()
    values = np.linalg.eigvalsh(K.convert("dense").getDenseArray())
    # Eigenvalues that should be zero are round-off of the largest.
    assert values[0] > -1e-12 * values[-1]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 2])
@pytest.mark.parametrize("given", [None, (4.0, 0.5, 1.0, 0.7)], ids=["uniform", "laminate"])
def test_a_cylinder_has_the_energy_of_its_direction(comm, angle: float, given) -> None:
    """½ D_nn κ² per area, and the moment D_nn κ along the curved direction."""
    # 1/m: an arc of 2 rad.
    κ = 2.0
    errors = []
    for n in (8, 16):
        plate = gx.Plate(
            sheet(comm, n, n // 4, 1.0, 0.25),
            law(angle),
            bending=given,
            displacement=rolled(κ),
        )
        energy = gx.Scene(plate).compile().balance.totals().stored["plate bending"]
        errors.append(abs(energy / (stiffness_along(angle, given) * κ**2 / 2 * 0.25) - 1))
    # 0.5 % with 16 cells, and at least halved by refinement.
    assert errors[1] < 5e-3
    assert errors[1] < errors[0] / 2


@pytest.mark.parametrize("given", [None, (4.0, 0.5, 1.0, 0.7)], ids=["uniform", "laminate"])
def test_frequencies_of_a_simply_supported_plate(given) -> None:
    """ω² ρ t = π⁴ (D11 m⁴/a⁴ + 2 (D12 + 2 D66) m² n²/(a² b²) + D22 n⁴/b⁴)."""
    a = 1.0
    b = 0.6
    D11, D12, D22, D66 = given or stiffnesses()

    def frequencies(n: int) -> np.ndarray:
        plate = gx.Plate(sheet(MPI.COMM_SELF, 5 * n, 3 * n, a, b), law(), bending=given)
        supports = [gx.Fixed(plate, edge) for edge in EDGES]
        search = gx.analysis.Continuation(tolerance=1e-4)
        equilibrium = at_rest(plate, *supports, search=search)
        # The lowest four modes; higher ones need finer meshes.
        return np.array([mode.frequency for mode in gx.analysis.modes(equilibrium, 4)])

    mass = NUMBERS["density"] * NUMBERS["thickness"]
    squares = [
        D11 * (m / a) ** 4 + 2 * (D12 + 2 * D66) * (m * n / (a * b)) ** 2 + D22 * (n / b) ** 4
        for m in range(1, 6)
        for n in range(1, 6)
    ]
    exact = math.pi / 2 * np.sqrt(np.sort(squares)[:4] / mass)
    coarse = frequencies(3)
    fine = frequencies(6)
    # A third at least: nearly second order.
    assert (fine - exact < (coarse - exact) / 3).all()
    # The error falls with the square of the size of the cells.
    # Extrapolated from two meshes of second order.
    assert (4 * fine - coarse) / 3 == pytest.approx(exact, rel=7e-3)


def test_a_plate_without_moments_keeps_its_rest_curvature(comm) -> None:
    """Rolled to its rest curvature it has no energy and no moments, whatever its axes."""
    κ = 2.0
    plate = gx.Plate(
        sheet(comm, 16, 4, 1.0, 0.25),
        law(0.5),
        displacement=rolled(κ),
        rest_curvature=np.diag((κ, 0.0, 0.0)),
    )
    energy = gx.Scene(plate).compile().balance.totals().stored["plate bending"]
    # Half a per cent of the energy of a flat plate's bending.
    assert abs(energy) < 5e-3 * stiffness_along(0.5) * κ**2 / 2 * 0.25


def test_a_thrown_plate_keeps_energy_and_momenta(comm) -> None:
    def thrown(X: np.ndarray) -> np.ndarray:
        return np.vstack([-X[1], X[0], np.sin(np.pi * X[0]) * np.cos(np.pi * X[1])])

    plate = gx.Plate(sheet(comm, 4, 4), law(0.4), velocity=thrown)
    tolerances = gx.Tolerances(relative=1e-12)
    run = run_until(0.02, plate, dt=1e-3, tolerances=tolerances)
    # √(2 m T), 1.5 kg.
    scale = math.sqrt(2 * 1.5 * run.first.kinetic)
    assert abs(run.energy_error) <= 1e-11
    assert max(momentum_changes(run)) <= 1e-11 * scale


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda m: gx.Plate(
                m,
                gx.Linear(1e9, 0.3, density=1.0, thickness=1e-3),
                bending=(1.0, 0.0, 1.0, 1.0),
            ),
            "has no axes",
        ),
        (lambda m: gx.Plate(m, law(), bending=(1.0, 2.0, 1.0, 1.0)), "not positive definite"),
        (lambda m: gx.Plate(m, law(), bending=(1.0, 0.0, 1.0)), "bending"),
    ],
)
def test_bad_bending_stiffnesses_are_refused_in_one_sentence(make, words: str) -> None:
    with pytest.raises(gx.InputError, match=words) as error:
        make(sheet(WORLD, 2, 2))
    assert "\n" not in str(error.value)
