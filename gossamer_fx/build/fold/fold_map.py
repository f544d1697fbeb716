"""The base of fold maps: isometric maps of a flat film to a folded one."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from gossamer_fx.build.fold.fold_lines import (
    SHEETS,
    FoldLine,
    find_lines,
    has_two_sheets,
    pressed_positions,
)
from gossamer_fx.build.fold.folding import FIT, Folding
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane


@dataclass(frozen=True)
class FoldMap(Folding):
    """An isometric map of a flat film in the plane z = 0 to a folded one.

    Two sheets may lie on each other, as in a tube that is pressed flat.  The mesh then has the
    groups "top" and "bottom", and `side` is 1 on the upper sheet, -1 on the lower one and 0 where
    they are joined; the map keeps the sheets apart.
    """

    @abstractmethod
    def place(self, X: Array, side: Array) -> Array:
        """Folded positions (n, 3) [m] of points X (n, 3) [m] of the flat film; `side` (n,) is 1 on
        the upper sheet, -1 on the lower one, else 0."""

    @abstractmethod
    def pressed(self) -> FoldMap:
        """The same folds without any distance of layers or sheets: this map is isometric to
        round-off."""

    def ajar(self) -> FoldMap:
        """The same folds with no fold shut, so that mountains and valleys can be distinguished."""
        return self

    def label(self, X: Array) -> Indices:
        """Number of the fold (n,) at points X (n, 3) [m] of fold lines; 0 if folds have no
        numbers."""
        return np.zeros(len(X), dtype=np.int32)

    def film_length(self) -> float | None:
        """Length [m] along x of the film for which the map is; None if every film fits."""
        return None

    def check_fits(self, low: Array, high: Array) -> None:
        """Raise `InputError` unless the map is for a flat film with these smallest and largest
        coordinates (3,) [m] on all ranks: of its `film_length`, and beginning at x = 0."""
        length = self.film_length()
        if length is None:
            return
        misfit = max(abs(float(low[0])), abs(float(high[0]) - length))
        self._check(
            misfit <= FIT * length,
            f"it is for a film from x = 0 to {length:.6g} m, "
            f"but the mesh reaches from {low[0]:.6g} to {high[0]:.6g} m; "
            "give the map the size of the film, and mesh the film from x = 0 on.",
        )

    def lines(self, mesh: Mesh) -> list[FoldLine]:
        return find_lines(self, mesh)

    def positions(self, film: Membrane) -> Array:
        # A mesh without the fold lines would begin with strains instead of folds.
        pressed_positions(self, film.mesh)
        owned = film.block.index_map.size_local
        X = film.space.tabulate_dof_coordinates()[:owned]
        return self.place(X, _sides(film)[:owned])


def _sides(film: Membrane) -> Array:
    """Return the sheet of each local node (n,) of a film: 1 upper, -1 lower, 0 where both are
    joined, and everywhere on a film without the groups "top" and "bottom"."""
    index_map = film.block.index_map
    side = np.zeros(index_map.size_local + index_map.num_ghosts)
    if has_two_sheets(film.mesh):
        top, bottom = SHEETS
        # Nodes of both sheets add up to zero.
        side[film.nodes(top)] += 1.0
        side[film.nodes(bottom)] -= 1.0
    return side
