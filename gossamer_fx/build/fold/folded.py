"""An initial condition: a film that starts folded by a fold map."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from gossamer_fx.build.fold.fold_lines import SHEETS, Map, has_two_sheets
from gossamer_fx.core.algebra.rotations import rotations
from gossamer_fx.core.checks.errors import check, check_on_all, is_vector
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import InitialState
from gossamer_fx.mechanics.bodies.membrane import Membrane


@dataclass(frozen=True, eq=False)
class Folded:
    """Initial positions of a film by a fold map; velocities do not change.  `FoldMap.start` makes
    it.

    Ports, joints, tethers, contact and probes start with the folded film.

    Args:
        film: the film.
        folds: the map.
        origin: position of the origin of the folded shape [m].
        turn: rotation vector [rad] about that point.
        name: in messages.

    Raises:
        InputError: origin or turn is not three finite numbers, or positions are not finite.
    """

    film: Membrane
    folds: Map
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    name: str = "folded"

    def __post_init__(self) -> None:
        """Check the arguments, which the class describes; raises `InputError`."""
        for what, value in (("origin", self.origin), ("turn", self.turn)):
            check(
                is_vector(value),
                f"Folded '{self.name}': {what} is {value!r}; give three finite numbers.",
            )

    def requires(self) -> Iterable[Any]:
        yield self.film

    def initialise(self, start: InitialState) -> None:
        start.place(self.film, self.positions())

    def positions(self) -> Array:
        """Return the folded positions (n, 3) [m] of this rank's nodes of the film.  Collective.

        X (n, 3) [m] are the nodes on the flat film, R (3, 3) is the rotation by `turn`.

        Raises:
            InputError: on all ranks, if the map is for a film of another size, or gives positions
                that are not finite.
        """
        owned = self.film.block.index_map.size_local
        X = self.film.space.tabulate_dof_coordinates()[:owned]
        self.folds.check_fits(*box(self.film.comm, X))
        folded = self.folds.place(X, self._sides()[:owned])
        check_on_all(
            self.film.comm,
            folded.shape == X.shape and bool(np.isfinite(folded).all()),
            f"'{self.name}': the fold map gives positions that are not finite; make it for the "
            "mesh of this film.",
        )
        R = _rotation(np.asarray(self.turn, dtype=float))
        placed: Array = folded @ R.T + np.asarray(self.origin, dtype=float)
        return placed

    def strain_energy(self) -> float:
        """Return the elastic energy ∫ ψ(E) dA [J] of the film in the folded start.  Collective.

        It is zero but for round-off and for what keeps layers apart.

        Raises:
            InputError: the map is for a film of another size, or gives positions that are not
                finite.
        """
        film = self.film
        x = fem.Function(film.space)
        owned = 3 * film.block.index_map.size_local
        x.x.array[:owned] = self.positions().ravel()
        x.x.scatter_forward()
        energy = compile_form(film.density(film.measure(x)) * film.dx)
        own = float(np.real(fem.assemble_scalar(energy)))
        return float(film.comm.allreduce(own))

    def _sides(self) -> Array:
        """Return the sheet of each local node (n,): 1 upper, -1 lower, 0 where both are joined.

        It is 0 everywhere on a film without the groups "top" and "bottom".
        """
        index_map = self.film.block.index_map
        side = np.zeros(index_map.size_local + index_map.num_ghosts)
        if has_two_sheets(self.film.mesh):
            top, bottom = SHEETS
            # Nodes of both sheets add up to zero.
            side[self.film.nodes(top)] += 1.0
            side[self.film.nodes(bottom)] -= 1.0
        return side


def _rotation(turn: Array) -> Array:
    """The rotation (3, 3) by a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    # A rotation by nothing has no axis.
    if angle == 0:
        return np.eye(3)
    return rotations(turn / angle, angle)
