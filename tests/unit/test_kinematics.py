"""Measures of the film: quadratic, invariant under rigid motions, exact for homogeneous
deformations."""

from __future__ import annotations

import math

import numpy as np
import pytest
import ufl
from dolfinx import fem

from gossamer_fx import Linear, Membrane
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.kinematics import area_vector, tension
from gossamer_fx.extend import InitialState
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere

LAW = Linear(E=1.0, nu=0.3, density=1.0, thickness=1.0)
SURFACES = {
    "flat": lambda comm: sheet(comm, 3, 4, 2.0, 1.0),
    "airbag": lambda comm: airbag(comm, 1.0, 4),
    "faceted sphere": lambda comm: sphere(comm, 1.0, 10),
    "curved sphere": lambda comm: sphere(comm, 1.0, 10, order=2),
}
every_film = pytest.mark.parametrize(
    "surface, order", [(s, o) for s in SURFACES for o in (1, 2) if (s, o) != ("curved sphere", 1)]
)


def rotation(axis=(1.0, 2.0, -0.5), angle=2.3):
    """Return a rotation matrix, by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    A = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * A + (1 - math.cos(angle)) * A @ A


def moved(film, motion):
    """Return the positions that a function of the undeformed points (3, n) gives."""
    x = fem.Function(film.space)
    x.interpolate(motion)
    return x


def strains(film, x):
    """Strains (n, 3) at points inside the cells of this rank."""
    domain = film.mesh.domain
    points = np.array([[0.2, 0.3], [0.5, 0.1], [0.1, 0.8]])
    cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    return evaluate(fem.Expression(film.measure(x), points), domain, cells).reshape(-1, 3)


def integral(film, expression, degree=8):
    """Return the integral over the undeformed film, on all ranks."""
    form = fem.form(expression * film.dx(metadata={"quadrature_degree": degree}))
    return film.comm.allreduce(fem.assemble_scalar(form))


@every_film
def test_rigid_motion_gives_no_strain(comm, surface, order):
    film = Membrane(SURFACES[surface](comm), LAW, order=order)
    R = rotation()
    shift = np.array([[3.0], [-1.0], [0.5]])
    x = moved(film, lambda X: R @ X + shift)
    assert abs(strains(film, x)).max() <= 1e-13


@every_film
def test_strain_of_a_homogeneous_deformation(comm, surface, order):
    """E = ½(FᵀF - I) has the invariants of Bᵀ½(GᵀG - I)B for x = GX, whatever frame B of the
    surface is chosen."""
    film = Membrane(SURFACES[surface](comm), LAW, order=order)
    G = np.array([[1.2, 0.3, -0.1], [0.05, 0.9, 0.2], [-0.3, 0.1, 1.1]])
    E = film.measure(moved(film, lambda X: G @ X))
    green_strain = (G.T @ G - np.eye(3)) / 2
    normal = ufl.CellNormal(film.mesh.domain)
    projection = ufl.Identity(3) - ufl.outer(normal, normal)
    exact = projection * ufl.as_matrix(green_strain.tolist()) * projection
    trace = E[0] + E[1]
    squared_norm = E[0] ** 2 + E[1] ** 2 + E[2] ** 2 / 2
    assert integral(film, (trace - ufl.tr(exact)) ** 2) <= 1e-25
    assert integral(film, (squared_norm - ufl.inner(exact, exact)) ** 2) <= 1e-25


@every_film
def test_strain_is_quadratic_in_the_positions(comm, surface, order):
    """De(q_mid)·(q1 - q0) = e1 - e0 for any two configurations, on which the conservation of energy
    rests."""
    film = Membrane(SURFACES[surface](comm), LAW, order=order)
    q0 = moved(film, lambda X: np.sin(3 * X) + X)
    q1 = moved(film, lambda X: 2 * X[[1, 2, 0]] - X**2)
    mid = fem.Function(film.space)
    mid.x.array[:] = (q0.x.array + q1.x.array) / 2
    Δq = fem.Function(film.space)
    Δq.x.array[:] = q1.x.array - q0.x.array
    De = ufl.derivative(film.measure(mid), mid, Δq)
    domain = film.mesh.domain
    cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    point = np.array([[0.2, 0.3]])
    change = evaluate(fem.Expression(De, point), domain, cells)
    exact_change = film.measure(q1) - film.measure(q0)
    difference = evaluate(fem.Expression(exact_change, point), domain, cells)
    assert abs(change - difference).max() <= 1e-12 * abs(difference).max()


@pytest.mark.mpi
def test_area_vector_of_a_sphere(comm):
    """∮n dA = 0; ⅓∮x·n dA = V and ∮|n| dA = A follow a homogeneous expansion."""
    film = Membrane(sphere(comm, 1.0, 24, order=2), LAW, order=2)
    x = moved(film, lambda X: 1.5 * X + 0.7)
    n = area_vector(film.deformation(x))
    for component in range(3):
        assert abs(integral(film, n[component])) <= 1e-12
    assert integral(film, ufl.dot(x, n) / 3) == pytest.approx(4 / 3 * math.pi * 1.5**3, rel=3e-4)
    assert integral(film, ufl.sqrt(ufl.dot(n, n))) == pytest.approx(4 * math.pi * 1.5**2, rel=2e-4)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_mass_and_initial_state(comm, order):
    """Initial functions are met, and the kinetic energy is that of the exact mass for a rigid
    velocity."""
    law = Linear(E=1.0, nu=0.3, density=1400.0, thickness=1e-3)

    def lift(X):
        return np.vstack([0 * X[0], 0 * X[0], 0.5 + X[0]])

    film = Membrane(
        sheet(comm, 3, 4, 2.0, 1.0),
        law,
        order=order,
        displacement=lift,
        velocity=lambda X: np.full_like(X, 3.0),
    )
    x, v = (state.reshape(-1, 3) for state in film.initial_state())
    X = film.space.tabulate_dof_coordinates()[: len(x)]
    assert abs(x - X - lift(X.T).T).max() <= 1e-14
    assert abs(v - 3.0).max() == 0
    function = moved(film, lambda X: np.full_like(X, 3.0))
    kinetic, *_ = film.terms(InitialState([film], film.comm))
    energy = comm.allreduce(fem.assemble_scalar(fem.form(0.5 * kinetic.mass(function, function))))
    assert energy == pytest.approx(0.5 * 1400.0 * 1e-3 * 2.0 * 27.0, rel=1e-12)


def test_tension_is_the_positive_part_of_a_stress():
    """Against eigenvalues, of stresses of all signs and of an isotropic one."""
    random = np.random.default_rng(3)
    for S in [*random.normal(size=(20, 3)), (2.0, 2.0, 0.0), (-1.0, -1.0, 0.0), (0.0, 0.0, 0.0)]:
        values, axes = np.linalg.eigh([[S[0], S[2]], [S[2], S[1]]])
        exact = axes @ np.diag(np.maximum(values, 0)) @ axes.T
        stress = ufl.as_vector([ufl.as_ufl(float(s)) for s in S])
        found = [float(component) for component in tension(stress)]
        expected = [exact[0, 0], exact[1, 1], exact[0, 1]]
        assert found == pytest.approx(expected, abs=1e-12)
