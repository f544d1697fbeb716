"""The base of fold maps: fold lines on a mesh, creases, and a film that starts folded."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from dolfinx import fem

from gossamer_fx.build.fold.fold_lines import (
    SHEETS,
    FoldLine,
    Map,
    find_lines,
    has_two_sheets,
    pressed_positions,
)
from gossamer_fx.core.algebra.rotations import rotation_of
from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices, Vector
from gossamer_fx.core.model.state import InitialState
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.connectors.crease import MOUNTAIN, VALLEY, Crease

Length = Annotated[float, positive("m")]
Gap = Annotated[float, not_negative("m")]

# Misfit of a film and its fold map, over the size of the film, that counts as round-off.
FIT = 1e-6


@dataclass(frozen=True, eq=False)
class Folded:
    """Initial positions of a film by a fold map, turned by a rotation vector [rad] about the origin
    of the folded shape, which is moved to `origin` [m]; velocities do not change.  `FoldMap.start`
    makes it.

    Ports, joints, clamped edges, tethers, contact and probes start with the folded film.
    """

    film: Membrane
    folds: Map
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    name: str = "folded"

    def requires(self) -> Iterable[Any]:
        yield self.film

    def initialise(self, start: InitialState) -> None:
        """Set the folded positions; `InputError` if the film is not flat at the start otherwise.
        Collective."""
        film = self.film
        flat = film.space.tabulate_dof_coordinates()[: film.block.index_map.size_local]
        # A rank may have no nodes.
        size = float(np.abs(flat).max(initial=0.0))
        check_on_all(
            film.comm,
            bool(np.allclose(start[film].positions(), flat, rtol=0, atol=FIT * size)),
            f"'{self.name}': '{film.name}' has a displacement or another start, which the folds "
            "would replace; leave it out.",
        )
        start.place(self.film, self.positions(), as_made=True)

    def positions(self) -> Array:
        """Return the folded positions (n, 3) [m] of this rank's nodes of the film.  Collective.  A
        map for a film of another size, or one that gives positions that are not finite, raises
        `InputError` on all ranks."""
        owned = self.film.block.index_map.size_local
        X = self.film.space.tabulate_dof_coordinates()[:owned]
        # A mesh without the fold lines would begin with strains instead of folds.
        pressed_positions(self.folds, self.film.mesh)
        folded = self.folds.place(X, self._sides()[:owned])
        check_on_all(
            self.film.comm,
            folded.shape == X.shape and bool(np.isfinite(folded).all()),
            f"'{self.name}': the fold map gives positions that are not finite; "
            "make it for the mesh of this film.",
        )
        R = rotation_of(np.asarray(self.turn, dtype=float))
        return folded @ R.T + np.asarray(self.origin, dtype=float)

    def strain_energy(self) -> float:
        """Return the elastic energy ∫ ψ(E) dA [J] of the film in the folded start, zero but for
        round-off and for what keeps layers apart.  Collective."""
        film = self.film
        x = fem.Function(film.space)
        owned = 3 * film.block.index_map.size_local
        x.x.array[:owned] = self.positions().ravel()
        x.x.scatter_forward()
        energy = compile_form(film.density(film.measure(x)) * film.dx)
        own = float(np.real(fem.assemble_scalar(energy)))
        return float(film.comm.allreduce(own))

    def _sides(self) -> Array:
        """Return the sheet of each local node (n,): 1 upper, -1 lower, 0 where both are joined, and
        everywhere on a film without the groups "top" and "bottom"."""
        index_map = self.film.block.index_map
        side = np.zeros(index_map.size_local + index_map.num_ghosts)
        if has_two_sheets(self.film.mesh):
            top, bottom = SHEETS
            # Nodes of both sheets add up to zero.
            side[self.film.nodes(top)] += 1.0
            side[self.film.nodes(bottom)] -= 1.0
        return side


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
        """The fold lines as edges of a mesh, with their angles; `InputError` if a triangle lies on
        both sides of one.  Collective."""
        return find_lines(self, mesh)

    @check_arguments
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

    @check_arguments
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

    @check_arguments
    def creases(
        self,
        film: Membrane,
        *,
        stiffness: float,
        set_angle_ratio: Annotated[float, Range(0, 1)] = 1.0,
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
        lines = self.lines(film.mesh)
        for line in lines:
            check(
                line.name in film.mesh.groups,
                f"{self.called}: the mesh of '{film.name}' has no group '{line.name}'; "
                "make the film on mark(mesh).",
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
