"""Evaluation of compiled expressions at many strains: each cell of a mesh has one strain."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import FilmLaw, constants

CELLS = 2048  # of SQUARE
CENTRE = np.array([[1 / 3, 1 / 3]])
SQUARE = mesh.create_unit_square(MPI.COMM_SELF, 32, 32)
STRAINS = fem.functionspace(SQUARE, ("Discontinuous Lagrange", 0, (3,)))


class Samples:
    """`expression(e, ...)` of strain functions e = (E11, E22, 2 E12), evaluated at up to 2048
    strains at once."""

    def __init__(self, expression: Callable[..., Any], arguments: int = 1) -> None:
        self._strains = [fem.Function(STRAINS) for _ in range(arguments)]
        self._compiled = compile_expression(expression(*self._strains), CENTRE)

    def __call__(self, *strains: Array) -> Array:
        """Values (n, number of components) at strains (n, 3)."""
        n = len(strains[0])
        for function, values in zip(self._strains, strains, strict=True):
            function.x.array[: 3 * n] = np.ravel(values)
        return evaluate(self._compiled, SQUARE, np.arange(n, dtype=np.int32))


def random_strains(n: int, size: float, seed: int) -> Array:
    """Strains of every state: principal values in [-size, size] and any direction, as (E11, E22, 2
    E12)."""
    rng = np.random.default_rng(seed)
    principal = rng.uniform(-size, size, (n, 2))
    direction = rng.uniform(0, np.pi, n)
    return strain(principal[:, 0], principal[:, 1], direction)


def strain(γ1: Array, γ2: Array, φ: Array) -> Array:
    """The strains (n, 3) with principal values γ1, γ2, the first in direction φ."""
    c = np.cos(φ)
    s = np.sin(φ)
    E11 = γ1 * c**2 + γ2 * s**2
    E22 = γ1 * s**2 + γ2 * c**2
    E12 = (γ1 - γ2) * c * s
    return np.stack([E11, E22, 2 * E12], axis=-1)


@cache
def at_strains(law: FilmLaw, what: str) -> Samples:
    """Energy, stress (S11, S22, S12), tangent (row by row) or state of a law."""
    c = constants(law, SQUARE)

    def expression(e: Any) -> Any:
        e = ufl.variable(e)
        W = law.energy(e, c)
        S = ufl.diff(W, e)
        match what:
            case "energy":
                return W
            case "stress":
                return S
            case "tangent":
                tangent = ufl.diff(S, e)
                rows = [tangent[i, j] for i in range(3) for j in range(3)]
                return ufl.as_vector(rows)
        return law.state(e, c) * 1.0

    return Samples(expression)
