"""A film that starts folded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from gossamer_fx.algebra.rotations import rotations
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check, check_on_all, is_vector
from gossamer_fx.fold.fold_lines import SHEETS, Map
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.model.body import Array
from gossamer_fx.model.state import InitialState


@dataclass(frozen=True, eq=False)
class Folded:
    """Places a film as a fold map says; `FoldMap.start` makes it.  Its velocities stay.

    Ports, joints, tethers, contact and probes see the folded film.

    Raises:
        InputError: an origin or a rotation vector that is not three numbers; positions that are not finite.
    """

    film: Membrane
    folds: Map
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    name: str = "folded"

    def __post_init__(self) -> None:
        for what in ("origin", "turn"):
            value = getattr(self, what)
            check(
                is_vector(value),
                f"Folded '{self.name}': {what} is {value!r}; give three finite numbers.",
            )

    def requires(self) -> Iterable[Any]:
        yield self.film

    def initialise(self, start: InitialState) -> None:
        start.place(self.film, self.positions())

    def positions(self) -> Array:
        """Places (n, 3) [m] of this rank's nodes."""
        index_map = self.film.block.index_map
        n = index_map.size_local
        X = self.film.space.tabulate_dof_coordinates()[:n]
        x = self.folds.place(X, self._sides()[:n])
        check_on_all(
            self.film.comm,
            x.shape == X.shape and bool(np.isfinite(x).all()),
            f"'{self.name}': the fold map gives positions that are not finite; make it for the mesh of this film.",
        )
        placed: Array = x @ _rotation(np.asarray(self.turn, dtype=float)).T + np.asarray(
            self.origin, dtype=float
        )
        return placed

    def strain_energy(self) -> float:
        """∫ W(E) dA [J] of the start: zero but for what keeps layers apart, and round-off.  Collective."""
        film = self.film
        x = fem.Function(film.space)
        x.x.array[: 3 * film.block.index_map.size_local] = self.positions().ravel()
        x.x.scatter_forward()
        energy = compile_form(film.density(film.measure(x)) * film.dx)
        return float(film.comm.allreduce(float(np.real(fem.assemble_scalar(energy)))))

    def _sides(self) -> Array:
        """1 on the upper sheet, -1 on the lower one, 0 where they are joined, at local nodes (n,)."""
        index_map, mesh = self.film.block.index_map, self.film.mesh
        side = np.zeros(index_map.size_local + index_map.num_ghosts)
        if all(mesh.groups.get(name, (0,))[0] == 2 for name in SHEETS):
            for sign, name in zip((1.0, -1.0), SHEETS, strict=True):
                side[self.film.nodes(name)] += sign
        return side


def _rotation(turn: Array) -> Array:
    """The rotation (3, 3) by a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    if angle == 0:
        return np.eye(3)
    return rotations(turn / angle, angle)
