"""What all folds have in common: fold lines on a mesh, creases, and a film that starts folded."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from dolfinx import fem

from gossamer_fx.build.fold.fold_lines import FoldLine
from gossamer_fx.core.algebra.rotations import rotation_of
from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.core.model.state import InitialCondition, InitialState
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.connectors.crease import MOUNTAIN, VALLEY, Crease

Length = Annotated[float, positive("m")]
Gap = Annotated[float, not_negative("m")]

# Misfit of a film and its folds, over the size of the film, that counts as round-off.
FIT = 1e-6


class Folding(ABC):
    """Folds of a film.

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
    def positions(self, film: Membrane) -> Array:
        """Folded positions (n, 3) [m] of this rank's nodes of a film; `InputError` if the film is
        of another size.  Collective."""

    @abstractmethod
    def lines(self, mesh: Mesh) -> list[FoldLine]:
        """The fold lines as edges of a mesh, with their angles; `InputError` if they are not edges
        of it.  Collective."""

    @check_arguments
    def mark(self, mesh: Mesh) -> Mesh:
        """Return the mesh with its fold lines as additional groups of curves.  Collective.

        Their names are "fold 1" and so on, or "valley" and "mountain" where folds have no
        numbers; on two sheets "fold 1 top" and "fold 1 bottom".  A valley is folded towards the
        normal of the film.  If valleys have several angles, "valley 1" is the sharpest.

        Args:
            mesh: of the film without folds, for fold maps in the plane z = 0; it is not changed.

        Raises:
            InputError: the mesh has no plane triangles of order 1, is not flat, does not fit the
                folds, or has a triangle on both sides of a fold line.
        """
        fold_lines = {line.name: (1, line.edges) for line in self.lines(mesh)}
        return replace(mesh, groups=mesh.groups | fold_lines)

    @check_arguments
    def start(
        self, film: Membrane, origin: Vector = (0.0, 0.0, 0.0), turn: Vector = (0.0, 0.0, 0.0)
    ) -> Folded:
        """The item of a scene with which the film starts folded.

        Args:
            film: on a mesh for which the folds are made.
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

        Creases start folded, and have their rest angle as in these folds.  Collective.

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
            initial_fold: Literal[1, -1] = VALLEY if line.angle > 0 else MOUNTAIN
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
        """Check a condition; the message starts with the name of the folds."""
        check(condition, f"{self.called}: {message}")


@dataclass(frozen=True, eq=False)
class Folded(InitialCondition):
    """Initial positions of a film by folds, turned by a rotation vector [rad] about the origin of
    the folded shape, which is moved to `origin` [m]; velocities do not change.  `Folding.start`
    makes it.

    Ports, joints, clamped edges, tethers, contact and probes start with the folded film.
    """

    film: Membrane
    folds: Folding
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
        """Return the folded positions (n, 3) [m] of this rank's nodes of the film.  Collective.
        Folds for a film of another size, or that give positions that are not finite, raise
        `InputError` on all ranks."""
        folded = self.folds.positions(self.film)
        count = self.film.block.index_map.size_local
        check_on_all(
            self.film.comm,
            folded.shape == (count, 3) and bool(np.isfinite(folded).all()),
            f"'{self.name}': the folds give positions that are not finite; "
            "make them for the mesh of this film.",
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
