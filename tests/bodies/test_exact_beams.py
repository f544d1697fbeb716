"""Thick beams: the discrete derivative of the strain, and the balance of a damped one.

`test_peers` compares beams in large rotations with other programs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.kinematics import beam_strain, beam_strain_change
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.line import line

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("turn", [0.1, 0.4])
def test_discrete_derivative_is_exact_and_objective(turn: float) -> None:
    """De(q0, q1)[q1 - q0] = e(q1) - e(q0), and De[ω × ½(q0 + q1)] = 0, at Gauss points between
    nodes whose directors are orthonormal; the larger turns are beyond `NORMALISED`."""
    domain = line(COMM, [(0, 0, 0), (1, 0, 0)], 1).domain
    space = fem.functionspace(domain, ("Lagrange", 2, (9,)))
    random = np.random.default_rng(5)
    q0, q1, step, turned = (fem.Function(space) for _ in range(4))
    ω = np.array([0.3, -1.2, 0.7])
    for q in (q0, q1):
        rows = q.x.array.reshape(-1, 3, 3)
        small = turn * random.standard_normal((len(rows), 3, 3))
        # The last two columns of an orthogonal matrix near the unit matrix
        directors = np.linalg.qr(np.eye(3) + small)[0]
        directors *= np.sign(np.einsum("nii->ni", directors))[:, None]
        rows[:, 0] = random.standard_normal((len(rows), 3))
        rows[:, 1:] = directors[:, :, 1:].transpose(0, 2, 1)
    step.x.array[:] = q1.x.array - q0.x.array
    mean = (q0.x.array + q1.x.array).reshape(-1, 3) / 2
    turned.x.array[:] = np.cross(ω, mean).ravel()

    def values(expression: Any) -> Array:
        cells = np.arange(len(space.dofmap.list), dtype=np.int32)
        points = np.array([[0.21], [0.79]])
        compiled = fem.Expression(expression, points)
        return evaluate(compiled, domain, cells)

    change = values(beam_strain(q1) - beam_strain(q0))
    assert np.abs(change).max(initial=1.0) > 0.1
    assert values(beam_strain_change(q0, q1, step)) == pytest.approx(change, abs=1e-13)
    assert values(beam_strain_change(q0, q1, turned)) == pytest.approx(0 * change, abs=1e-13)


def test_a_thick_damped_beam_keeps_its_balance() -> None:
    """Kelvin-Voigt damping in a thrown thick arc: what it loses is what the balance misses, and
    both momenta stay, over 100 steps."""
    thick = gx.sections.rectangle(0.2, 0.1, E=1e6, nu=0.3, density=1000.0)
    angles = np.linspace(0, np.pi / 2, 5)
    arc = np.column_stack([np.sin(angles), 0 * angles, 1 - np.cos(angles)])

    def thrown(x: Array) -> Array:
        return np.asarray(np.cross([6.0, 12.0, 9.0], x.T).T)

    beam = gx.Beam(line(COMM, arc.tolist(), 1), thick, normal=(0, 1, 0), velocity=thrown)
    scene = gx.Scene(beam, gx.Damping(beam, stiffness_factor=1e-3))
    run = gx.Simulation(scene, gx.Midpoint(dt=2e-3))
    run.run(until=0.2)
    scale = np.linalg.norm(run.first.angular_momentum)
    assert run.totals.angular_momentum == pytest.approx(
        run.first.angular_momentum, abs=1e-11 * scale
    )
    assert abs(run.energy_error) < 1e-11
    assert run.totals.dissipated > 1e-3 * run.first.kinetic
