"""What all fold maps have in common: fold lines on a mesh, creases, and the start of a scene."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.connectors.crease import MOUNTAIN, VALLEY, Crease
from gossamer_fx.fold.fold_lines import FoldLine, find_lines
from gossamer_fx.fold.folded import Folded
from gossamer_fx.mesh.mesh import Mesh
from gossamer_fx.model.body import Array, Indices, Vector


@dataclass(frozen=True)
class FoldMap(ABC):
    """An isometric map of a flat film, given in z = 0, to a folded one.

    Where two sheets lie on each other, as in a tube that is pressed flat, `side` is 1 on the upper one, -1 on the lower
    one and 0 where they are joined: the map keeps them apart.  Sheets are told by the groups "top" and "bottom" of the
    mesh.

    A film with folds is made in this order:

        folds = gx.fold.Zigzag(length=0.8, panels=5, angle=1.4)
        film = gx.Membrane(folds.mark(mesh), law)
        scene = gx.Scene(film, folds.start(film), *folds.creases(film, stiffness=1e-3))
    """

    called: ClassVar[str]  # what users call it, in messages

    @abstractmethod
    def place(self, X: Array, side: Array) -> Array:
        """Folded positions (n, 3) [m] of points X (n, 3) of the flat film on sheets `side` (n,)."""

    @abstractmethod
    def pressed(self) -> FoldMap:
        """The same folds with layers that lie on each other: this one is isometric."""

    def ajar(self) -> FoldMap:
        """The same folds, none of them shut: it tells mountain from valley."""
        return self

    def label(self, X: Array) -> Indices:
        """Number of the fold at points X (n, 3) of its lines; 0 where folds have no numbers."""
        return np.zeros(len(X), dtype=np.int32)

    def lines(self, mesh: Mesh) -> list[FoldLine]:
        """The fold lines as edges of a mesh, with their angles; collective.

        Raises:
            InputError: triangles that lie on both sides of a fold line.
        """
        return find_lines(self, mesh)

    def mark(self, mesh: Mesh) -> Mesh:
        """The mesh with its fold lines as groups: "fold 1" and so on, or "valley" and "mountain".

        On two sheets "fold 1 top" and "fold 1 bottom".  A valley is folded towards the normal of the film.  Where folds
        of one sense have several angles, "valley 1" is the sharpest.

        Raises:
            InputError: triangles that lie on both sides of a fold line.
        """
        return replace(
            mesh, groups=mesh.groups | {line.name: (1, line.edges) for line in self.lines(mesh)}
        )

    def start(
        self, film: Membrane, origin: Vector = (0.0, 0.0, 0.0), turn: Vector = (0.0, 0.0, 0.0)
    ) -> Folded:
        """The item of a scene with which the film starts folded.

        Args:
            film: on a mesh for which the map is made.
            origin: where the origin of the folded shape comes to lie [m].
            turn: rotation vector [rad] about that point.
        """
        return Folded(film, self, tuple(origin), tuple(turn), f"{film.name} folded")

    def creases(
        self,
        film: Membrane,
        *,
        stiffness: float,
        set_angle_ratio: float = 1.0,
        yield_angle: float | None = None,
    ) -> Sequence[Crease]:
        """A `Crease` for every group of `mark`, with branch and rest angle of this map.

        Args:
            film: on a mesh that was marked; of a `Plate` the groups are also its hinges.
            stiffness: k [N m/m/rad], moment per length and angle.
            set_angle_ratio: rest angle over the angle of the fold, 0 to 1: 0 is flat at rest.
            yield_angle: [rad], as of `Crease`.

        Raises:
            InputError: a mesh without the groups, a share that is not between 0 and 1, and what `Crease` raises.
        """
        check(
            0 <= set_angle_ratio <= 1,
            f"{self.called}: set_angle_ratio is {set_angle_ratio!r}; give a number from 0 (flat at rest) to 1.",
        )
        lines = self.lines(film.mesh)
        for line in lines:
            check(
                line.name in film.mesh.groups,
                f"{self.called}: the mesh of '{film.name}' has no group '{line.name}'; make the film on mark(mesh).",
            )
        return [
            Crease(
                film,
                line.name,
                stiffness=stiffness,
                rest_angle=set_angle_ratio * line.angle,
                yield_angle=yield_angle,
                initial_fold=VALLEY if line.angle > 0 else MOUNTAIN,
                name=f"{film.name} {line.name}",
            )
            for line in lines
        ]

    def _check(self, condition: bool, message: str) -> None:
        check(condition, f"{self.called}: {message}")

    def _check_positive(self, *lengths: str) -> None:
        for what in lengths:
            value = getattr(self, what)
            self._check(
                math.isfinite(value) and value > 0,
                f"{what} is {value!r} m; give a positive number.",
            )

    def _check_not_negative(self, *lengths: str) -> None:
        for what in lengths:
            value = getattr(self, what)
            self._check(
                math.isfinite(value) and value >= 0,
                f"{what} is {value!r} m; give zero or a positive number.",
            )
