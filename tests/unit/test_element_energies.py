"""Terms with one measure share residual and tangent: equal to dolfinx's sum of separate forms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from dolfinx import fem, la
from dolfinx.fem import petsc
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.materials.film import FilmLaw
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.model.body import Array
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import EndPoint, PathAverage, StressRule
from gossamer_fx.terms.element_energies import ElementEnergies, ElementForms

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
LINEAR = gx.Linear(**MATERIAL)
WRINKLING = gx.Miyazaki(**MATERIAL, residual_stiffness=1e-2)
HEAT = gx.materials.ThermalExpansion(1e-3, lambda X, t: 293.15 + 20 * X[0] + 1e3 * t)
BY_STIFFNESS = {"stiffness_factor": 1e-4}
BY_BOTH = {"mass_factor": 3.0, "stiffness_factor": 1e-4}

# Relative round-off of sums in another order.
ROUND_OFF = 1e-13


def positions(system: System, seed: int) -> Array:
    """Displaced end coordinates [m] of this rank, the same motion on any number of ranks."""
    x = system.q0.array_r.reshape(-1, 3)
    angles = x @ np.random.default_rng(seed).standard_normal((3, 3)) + seed
    return np.asarray((x + 1e-3 * np.sin(angles)).ravel())


def deformed(film: gx.Membrane, damping: gx.Damping, rule: StressRule) -> System:
    """A compiled damped film, whose strains ê at the points are not those of its coordinates."""
    system = gx.Scene(film, damping).compile(rule)
    system.begin_step(1e-3)
    end = system.numbering.vector()
    end.array[:] = positions(system, seed=1)
    system.set_end(end)
    field = system.fields[film]
    # Half of the geometric stiffness, so that the part of the tensile stresses counts at rest.
    field.γ.value = 0.5
    field.take(field.q1, positions(system, seed=2))
    return system


def energies_of(system: System) -> ElementEnergies:
    (found,) = [kind for kind in system.compiled if isinstance(kind, ElementEnergies)]
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
        MPI.COMM_WORLD.allreduce(float(values @ values)) ** 0.5
        for values in (found - expected, expected)
    )
    assert size > 0
    assert error < ROUND_OFF * size


@pytest.mark.mpi
@pytest.mark.parametrize("rule", [PathAverage(), EndPoint()], ids=["in time", "at rest"])
@pytest.mark.parametrize(
    ("law", "order", "thermal", "factors", "form_count"),
    [
        (LINEAR, 1, None, BY_STIFFNESS, 1),
        (WRINKLING, 2, None, BY_STIFFNESS, 1),
        (WRINKLING, 1, HEAT, {**BY_STIFFNESS, "tension_only": True}, 1),
        # The measure of mass damping is the position.
        (LINEAR, 1, HEAT, BY_BOTH, 2),
    ],
    ids=["linear", "wrinkling of order 2", "warm", "mass damping"],
)
def test_shared_forms_are_the_sum_of_separate_ones(
    comm: MPI.Intracomm,
    rule: StressRule,
    law: FilmLaw,
    order: int,
    thermal: object,
    factors: dict,
    form_count: int,
) -> None:
    film = gx.Membrane(sheet(comm, 4, 3), law, order=order, thermal=thermal)
    system = deformed(film, gx.Damping(film, **factors), rule)
    energies = energies_of(system)
    shared = energies.tangent_forms(film)
    assert len(shared) == form_count
    separate = [ElementForms([element], system.fields[film], rule) for element in energies.elements]
    assert len(separate) > form_count

    z = np.sin(1e3 * positions(system, seed=3))
    expected = product([forms.tangent for forms in separate], z)
    assert_equal(product(shared, z), expected)
    # The tangent of the system, which gossamer_fx assembles into its own matrix.
    A = system.numbering.matrix()
    system.fields[film].assemble(A, shared, system.block(film))
    A.assemble()
    right, left = A.createVecs()
    right.array[:] = z
    A.mult(right, left)
    assert_equal(left.array_r, expected)

    r = system.numbering.vector()
    energies.add_forces(r)
    assert_equal(r.array_r, forces([forms.residual for forms in separate], len(z)))


def test_films_do_not_share_forms(comm: MPI.Intracomm) -> None:
    """Their measures are equal functions of different coordinates."""
    films = [gx.Membrane(sheet(comm, 2, 2), LINEAR, name=name) for name in ("left", "right")]
    dampings = [gx.Damping(film, **BY_STIFFNESS, name=f"of {film.name}") for film in films]
    system = gx.Scene(*films, *dampings).compile()
    for film in films:
        assert len(energies_of(system).tangent_forms(film)) == 1
