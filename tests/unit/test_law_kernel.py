"""The compiled law kernel: the choice of strains against equation (5) in NumPy, and against a law
with one state."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import InitialState
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage
from gossamer_fx.mechanics.terms.element_energies import quadrature_element
from gossamer_fx.mechanics.terms.law_kernel import (
    FRUITFUL_ERROR_RATIO,
    MAX_FRUITLESS_CHOICES,
    STRAIN_CHOICE_STIFFNESS,
    STRAIN_CHOICE_TRIGGER,
    PointLaw,
    PointValues,
    law_functions,
)
from gossamer_fx.meshes.sheet import sheet

THICKNESS = {"thickness": lambda X: np.where(X[0] > 0.5, 3e-4, 1e-4)}


def law_at_points(permuted: bool) -> tuple[PointLaw, PointValues]:
    """A wrinkling law of uneven thickness at the points of a sheet of order 2."""
    law = gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-2)
    film = gx.Membrane(sheet(MPI.COMM_SELF, 4, 4), law, order=2, properties=THICKNESS)
    _, energy = film.terms(InitialState([film], film.comm))
    mesh = film.space.mesh
    Q = fem.functionspace(mesh, quadrature_element(mesh, film.dx.metadata(), (3,)))
    functions = law_functions(energy, PathAverage(), fem.Function(Q), fem.Function(Q))
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    points = Q.dofmap.list.shape[1]
    q = len(cells) * points
    rng = np.random.default_rng(3)
    rows = np.arange(q, dtype=np.int32)
    if permuted:
        rng.shuffle(rows)
    values = PointValues(
        start=1e-2 * rng.standard_normal((q, 3)),
        strain=1e-2 * rng.standard_normal((q, 3)),
        response=np.zeros((q, 12)),
        rows=rows.reshape(len(cells), points),
    )
    return PointLaw(functions, values, cells, may_choose=True), values


def split(response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return response[:, :3].copy(), response[:, 3:].reshape(-1, 3, 3).copy()


def test_the_rows_of_points_may_have_any_order() -> None:
    law, values = law_at_points(permuted=False)
    other, shuffled = law_at_points(permuted=True)
    order = shuffled.rows.ravel()
    shuffled.start[order] = values.start
    shuffled.strain[order] = values.strain
    law.respond()
    other.respond()
    assert np.array_equal(shuffled.response[order], values.response)
    densities = np.zeros((2, len(order)))
    law.density_in(densities[0])()
    other.density_in(densities[1])()
    assert np.array_equal(densities[1][order], densities[0])


@pytest.mark.parametrize("permuted", [False, True])
def test_strains_are_chosen_by_equation_5(permuted: bool) -> None:
    law, values = law_at_points(permuted)
    rng = np.random.default_rng(4)
    law.linearise(lambda: values.strain, first_guess=values.strain.copy)
    chosen = 0
    last_error = np.full(len(values.strain), np.inf)
    fruitless = np.zeros(len(values.strain), dtype=int)
    alternating = 1e-2 * rng.standard_normal(values.strain.shape)
    for iteration in range(MAX_FRUITLESS_CHOICES + 1):
        S, D = split(values.response)
        # Films that alternate between taut and slack: the error does not fall.
        linear = (-1) ** iteration * alternating
        change = linear - values.strain
        forecast = S + np.einsum("qij,qj->qi", D, change)
        stiffness = D.diagonal(axis1=1, axis2=2).max(axis=1)
        # the response at the linearised strain, by a kernel that may not choose
        values.strain[:] = linear
        law.respond()
        S, D_new = split(values.response)
        values.strain[:] = linear - change
        values.response[:, :3] = forecast - np.einsum("qij,qj->qi", D, change)
        values.response[:, 3:] = D.reshape(-1, 9)
        law.linearise(lambda here=linear: here, first_guess=values.strain.copy)

        k = STRAIN_CHOICE_STIFFNESS * np.maximum(
            stiffness, D_new.diagonal(axis1=1, axis2=2).max(axis=1)
        )
        error = abs(S - forecast).max(axis=1)
        is_far = error > STRAIN_CHOICE_TRIGGER * np.maximum(abs(S), abs(forecast)).max(axis=1)
        fruitless += is_far & (error > FRUITFUL_ERROR_RATIO * last_error)
        last_error = np.where(is_far, error, np.inf)
        is_chosen = is_far & (fruitless < MAX_FRUITLESS_CHOICES)
        K = D_new + k[:, None, None] * np.eye(3)
        step = np.linalg.solve(K, (forecast - S)[..., None])[..., 0]
        length = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
        allowed = np.linalg.norm(change, axis=1) / length
        expected = linear + np.where(is_chosen, np.minimum(1, allowed), 0)[:, None] * step
        assert np.allclose(values.strain, expected, rtol=1e-9, atol=1e-14)
        chosen += is_chosen.sum()
    assert chosen > 50
    assert (fruitless >= MAX_FRUITLESS_CHOICES).any()
