"""The base of fold maps: fold lines on a mesh, creases, and a film that starts folded."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gossamer_fx.build.fold.fold_lines import FoldLine, find_lines
from gossamer_fx.build.fold.folded import Folded
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices, Vector
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.connectors.crease import MOUNTAIN, VALLEY, Crease

# Misfit of a film and its fold map, over the size of the film, that counts as round-off.
FIT = 1e-6


@dataclass(frozen=True)
class FoldMap(ABC):
    """An isometric map of a flat film in the plane z = 0 to a folded one.

    Two sheets may lie on each other, as in a tube that is pressed flat.  The mesh then has the
    groups "top" and "bottom", and `side` is 1 on the upper sheet, -1 on the lower one and 0 where
    they are joined; the map keeps the sheets apart.

    A film with folds is made in this order: mark the fold lines on the mesh, make the film, give
    the scene the folded start and the creases.

    Example:
        >>> folds = gx.fold.Zigzag(length=1.0, panels=2, angle=1.4)
        >>> marked = gx.Membrane(folds.mark(mesh), film.law)
        >>> creases = folds.creases(marked, stiffness=1e-3)
        >>> scene = gx.Scene(marked, folds.start(marked), *creases)
    """

    # Name in messages
    called: ClassVar[str]

    @abstractmethod
    def place(self, X: Array, side: Array) -> Array:
        """Folded positions (n, 3) [m].

        Args:
            X: points (n, 3) of the flat film [m].
            side: 1 on the upper sheet, -1 on the lower one, else 0, (n,).
        """

    @abstractmethod
    def pressed(self) -> FoldMap:
        """The same folds without any distance of layers: this map is isometric to round-off."""

    def ajar(self) -> FoldMap:
        """The same folds with no fold shut, so that mountains and valleys can be distinguished."""
        return self

    def label(self, X: Array) -> Indices:
        """Number of the fold (n,) at points X (n, 3) [m] of fold lines; 0 if folds have no
        numbers."""
        return np.zeros(len(X), dtype=np.int32)

    def film_sizes(self) -> tuple[float, ...]:
        """Sizes [m] along x, then y, of the film for which the map is; of none if every film
        fits."""
        return ()

    def check_fits(self, low: Array, high: Array) -> None:
        """Check that the map is for a film of this extent.

        Args:
            low, high: smallest and largest coordinates (3,) [m] of the flat film on all ranks.

        Raises:
            InputError: the film has other `film_sizes`, or does not begin at the origin.
        """
        for axis, size in enumerate(self.film_sizes()):
            name = "xy"[axis]
            misfit = max(abs(float(low[axis])), abs(float(high[axis]) - size))
            self._check(
                misfit <= FIT * size,
                f"it is for a film from {name} = 0 to {size:.6g} m, but the mesh reaches from "
                f"{low[axis]:.6g} to "
                f"{high[axis]:.6g} m; give the map the size of the film, and mesh the film from "
                f"{name} = 0 on.",
            )

    def lines(self, mesh: Mesh) -> list[FoldLine]:
        """The fold lines as edges of a mesh, with their angles.  Collective.

        Raises:
            InputError: a triangle lies on both sides of a fold line.
        """
        return find_lines(self, mesh)

    def mark(self, mesh: Mesh) -> Mesh:
        """Return the mesh with its fold lines as additional groups of curves.  Collective.

        Their names are "fold 1" and so on, or "valley" and "mountain" for maps without numbered
        folds; on two sheets "fold 1 top" and "fold 1 bottom".  A valley is folded towards the
        normal of the film.  If valleys have several angles, "valley 1" is the sharpest.

        Args:
            mesh: of the flat film, in the plane z = 0; it is not changed.

        Raises:
            InputError: the mesh has no plane triangles of order 1, is not flat, does not fit the
                map, or has a triangle on both sides of a fold line.
        """
        fold_lines = {line.name: (1, line.edges) for line in self.lines(mesh)}
        return replace(mesh, groups=mesh.groups | fold_lines)

    def start(
        self, film: Membrane, origin: Vector = (0.0, 0.0, 0.0), turn: Vector = (0.0, 0.0, 0.0)
    ) -> Folded:
        """The item of a scene with which the film starts folded.

        Args:
            film: on a mesh for which the map is made.
            origin: position of the origin of the folded shape [m].
            turn: rotation vector [rad] about that point.

        Raises:
            InputError: origin or turn is not three finite numbers.
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
        """Return a `Crease`, a rotational spring along edges, for every group that `mark` has made.

        Creases start folded, and have their rest angle as in this map.  Collective.

        Args:
            film: on a mesh that `mark` returned; of a `Plate` the groups are also its hinges.
            stiffness: moment per length and angle [N m/m/rad].
            set_angle_ratio: rest angle over the angle of the fold [-], 0 to 1; 0 is flat at rest.
            yield_angle: deviation from the rest angle [rad] beyond which that changes, see
                `Crease`; None: never.

        Raises:
            InputError: the mesh does not have the groups, the ratio is out of its range, or
                `Crease` refuses an argument.
        """
        check(
            0 <= set_angle_ratio <= 1,
            f"{self.called}: set_angle_ratio is {set_angle_ratio!r}; give a number from 0 (flat at "
            "rest) to 1.",
        )
        lines = self.lines(film.mesh)
        for line in lines:
            check(
                line.name in film.mesh.groups,
                f"{self.called}: the mesh of '{film.name}' has no group '{line.name}'; make the "
                "film on mark(mesh).",
            )
        creases = []
        for line in lines:
            # A fold that is shut has an angle near ±π: the crease has to know from which side it
            # comes.
            initial_fold = VALLEY if line.angle > 0 else MOUNTAIN
            crease = Crease(
                film,
                line.name,
                stiffness=stiffness,
                rest_angle=set_angle_ratio * line.angle,
                yield_angle=yield_angle,
                initial_fold=initial_fold,
                name=f"{film.name} {line.name}",
            )
            creases.append(crease)
        return creases

    def _check(self, condition: bool, message: str) -> None:
        """Check a condition; the message starts with the name of the map."""
        check(condition, f"{self.called}: {message}")

    def _check_positive(self, *lengths: str) -> None:
        """Check that lengths, given by the names of the map's arguments, are positive numbers."""
        for what in lengths:
            value = getattr(self, what)
            self._check(
                math.isfinite(value) and value > 0,
                f"{what} is {value!r} m; give a positive number.",
            )

    def _check_not_negative(self, *lengths: str) -> None:
        """Check that lengths, given by the names of the map's arguments, are zero or positive."""
        for what in lengths:
            value = getattr(self, what)
            self._check(
                math.isfinite(value) and value >= 0,
                f"{what} is {value!r} m; give zero or a positive number.",
            )
