"""Gradients of modes at the quadrature points of a film's strains."""

from __future__ import annotations

import basix
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.model.terms import Array, Indices


def points_and_areas(film: Membrane) -> tuple[Array, Array]:
    """Quadrature points (p, 2) of the reference triangle, and the reference area dA (cells, p) of each in own cells."""
    degree = film.dx.metadata()["quadrature_degree"]
    rule = basix.make_quadrature(basix.CellType.triangle, degree)
    points, weights = (np.asarray(part, dtype=np.float64) for part in rule)
    cells = own_cells(film)
    J = compile_expression(ufl.JacobianDeterminant(film.space.mesh), points)
    return points, abs(evaluate(J, film.space.mesh, cells).reshape(len(cells), len(points))) * weights


def own_cells(film: Membrane) -> Indices:
    """The cells that this rank owns."""
    return np.arange(film.space.mesh.topology.index_map(2).size_local, dtype=np.int32)


def mode_gradients(film: Membrane, φ: Array, points: Array) -> Array:
    """∂φ_i/∂X_a (2, cells, p, r) in own cells of modes φ (n, r) at the owned and ghost nodes, in the film's frame."""
    cells, r = own_cells(film), φ.shape[1]
    x = fem.Function(film.space)
    F = compile_expression(film.deformation(x), points)
    found = np.empty((2, len(cells), len(points), r))
    padded = np.zeros((len(φ), 3 * -(-r // 3)))
    padded[:, :r] = φ
    for first in range(0, r, 3):  # three modes at once, as components of one motion
        x.x.array[:] = padded[:, first : first + 3].ravel()
        values = evaluate(F, film.space.mesh, cells).reshape(len(cells), len(points), 3, 2)
        count = min(3, r - first)
        found[..., first : first + count] = np.moveaxis(values[:, :, :count], 3, 0)
    return found
