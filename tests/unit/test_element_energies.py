"""Terms with one measure share residual and tangent: equal to dolfinx's sum of separate forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from dolfinx import fem, la
from dolfinx.fem import petsc
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.discrete_gradient import AtRest, PathAverage, StressRule
from gossamer_fx.mechanics.terms.element_energies import ElementEnergies, ElementForms
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.system.system import System
from tests.small_scenes import LINEAR, MATERIAL

COMM = MPI.COMM_WORLD
WRINKLING = gx.Miyazaki(**MATERIAL, residual_stiffness=1e-2)
FABRIC = gx.Orthotropic(1e9, 1e8, 0.3, 5e7, direction=(1.0, 0.3, 0.0), density=1.0, thickness=1e-4)
TUBE = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)
AXIS = [(0, 0, 0), (1, 0, 0)]
HEAT = gx.materials.ThermalExpansion(1e-3, lambda X, t: 293.15 + 20 * X[0] + 1e3 * t)
BY_STIFFNESS = {"stiffness_factor": 1e-4}
BY_TENSION = {"stiffness_factor": 1e-4, "tension_only": True}
BY_BOTH = {"mass_factor": 3.0, "stiffness_factor": 1e-4}

# Relative round-off of sums in another order.
ROUND_OFF = 1e-13


Deformable = gx.Membrane | gx.Cable | gx.Beam


def coordinates(system: System, body: Deformable, seed: int) -> Array:
    """Displaced end coordinates of a body on this rank, the same motion on any number of ranks."""
    x = system.unknowns.q0.array_r[system.unknowns.block(body).owned].reshape(-1, 3)
    angles = x @ np.random.default_rng(seed).standard_normal((3, 3)) + seed
    return np.asarray((x + 1e-3 * np.sin(angles)).ravel())


def deformed(body: Deformable, damping: gx.Damping, rule: StressRule) -> System:
    """A compiled damped body, whose strains ê at the points are not those of its coordinates."""
    system = gx.Scene(body, damping).compile(rule)
    system.equations.begin_step(1e-3)
    end = system.unknowns.q0.copy()
    end.array[system.unknowns.block(body).owned] = coordinates(system, body, seed=1)
    system.equations.set_end(end)
    field = system.unknowns.coordinates[body]
    # Half of the geometric stiffness, so that the part of the tensile stresses counts at rest.
    field.γ.value = 0.5
    field.take(field.q1, coordinates(system, body, seed=2))
    return system


def energies_of(system: System) -> ElementEnergies:
    (found,) = [kind for kind in system.equations.compiled if isinstance(kind, ElementEnergies)]
    return found


def product(forms: Sequence[fem.Form], z: Array) -> Array:
    """The sum of bilinear forms times a vector z, by dolfinx's own assembly."""
    total = np.zeros(len(z))
    for form in forms:
        matrix = petsc.assemble_matrix(form)
        matrix.assemble()
        right, left = matrix.createVecs()
        right.array[:] = z
        matrix.mult(right, left)
        total += left.array_r
    return total


def forces(forms: Sequence[fem.Form], size: int) -> Array:
    """The sum of linear forms, this rank's part (size,)."""
    total = np.zeros(size)
    for form in forms:
        b = fem.assemble_vector(form)
        b.scatter_reverse(la.InsertMode.add)
        total += b.array[:size]
    return total


def assert_equal(found: Array, expected: Array) -> None:
    """The vectors of all ranks agree to round-off, and are not zero."""
    error, size = (
        COMM.allreduce(float(values @ values)) ** 0.5 for values in (found - expected, expected)
    )
    assert size > 0
    assert error < ROUND_OFF * size


BODIES: dict[str, Callable[[], Deformable]] = {
    "film": lambda: gx.Membrane(sheet(COMM, 4, 3), LINEAR),
    "wrinkling": lambda: gx.Membrane(sheet(COMM, 4, 3), WRINKLING, order=2),
    "fabric": lambda: gx.Membrane(sheet(COMM, 4, 3), FABRIC),
    "warm": lambda: gx.Membrane(sheet(COMM, 4, 3), WRINKLING, thermal=HEAT),
    "plate": lambda: gx.Plate(sheet(COMM, 4, 3), LINEAR),
    "cable": lambda: gx.Cable(line(COMM, AXIS, 8), gx.TensionOnly(1e4, 0.1), order=2),
    "beam": lambda: gx.Beam(line(COMM, AXIS, 8), TUBE),
}


@pytest.mark.mpi(2)
@pytest.mark.parametrize("rule", [PathAverage(), AtRest()], ids=["in time", "at rest"])
@pytest.mark.parametrize(
    ("name", "factors", "form_count"),
    [(name, BY_STIFFNESS, 1) for name in BODIES]
    + [
        ("film", BY_TENSION, 1),
        # The measure of mass damping is the position.
        ("warm", BY_BOTH, 2),
    ],
)
def test_shared_forms_are_the_sum_of_separate_ones(
    rule: StressRule, name: str, factors: dict, form_count: int
) -> None:
    body = BODIES[name]()
    system = deformed(body, gx.Damping(body, **factors), rule)
    energies = energies_of(system)
    shared = energies.tangent_forms(body)
    assert len(shared) == form_count
    separate = [
        ElementForms([element], system.unknowns.coordinates[body], rule)
        for element in energies.elements
    ]
    assert len(separate) > form_count

    # A beam has multipliers behind its coordinates.
    owned = system.unknowns.block(body).owned
    z = np.sin(1e3 * coordinates(system, body, seed=3))
    expected = product([forms.tangent for forms in separate], z)
    assert_equal(product(shared, z), expected)
    # The tangent of the system, which gossamer_fx assembles into its own matrix.
    A = system.unknowns.numbering.matrix()
    system.unknowns.coordinates[body].assemble(A, shared, system.unknowns.block(body))
    A.assemble()
    right, left = A.createVecs()
    right.array[owned] = z
    A.mult(right, left)
    assert_equal(left.array_r[owned], expected)

    r = system.unknowns.numbering.vector()
    energies.add_forces(r)
    assert_equal(r.array_r[owned], forces([forms.residual for forms in separate], len(z)))


def test_films_do_not_share_forms() -> None:
    """Their measures are equal functions of different coordinates."""
    films = [gx.Membrane(sheet(COMM, 2, 2), LINEAR, name=name) for name in ("left", "right")]
    dampings = [gx.Damping(film, **BY_STIFFNESS, name=f"of {film.name}") for film in films]
    system = gx.Scene(*films, *dampings).compile()
    for film in films:
        assert len(energies_of(system).tangent_forms(film)) == 1
