"""Nodes of beams and cables that are held with all their vectors, or turned."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.algebra.rotations import cross_matrices, rotations
from gossamer_fx.bodies.beam import Beam
from gossamer_fx.bodies.curve import Curve
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.checks.user_functions import ask_numbers, ask_points
from gossamer_fx.constraints.fixed import check_support
from gossamer_fx.model.body import Array, Indices, Vector
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.supports import Support

OPPOSITE = 1e-6  # 1 + cosine of two directions between which no turn is the shortest


@check_arguments
@dataclass(frozen=True, eq=False)
class Clamped:
    """A clamp: the nodes of a beam keep their position and directors, or move and turn as prescribed.

    A section with the normal n is turned by the shortest rotation from n to `direction`, then about it by
    `twist`; the work of what turns and moves it is booked as supplied.  A function of time should begin
    at the initial direction: where it does not, the section jumps in the first step.

    Args:
        body: a beam (or a cable, which has positions only).
        group: name of points or curves of its mesh.
        direction: normal of the sections, a vector or a function of the points (3, n) of the stress-free
            shape and the time [s] that returns (3, n); of any length.  None: as it starts.
        twist: angle [rad] about the direction, or a function of time [s].
        motion: displacement [m] of the points, as of `Prescribed`.  None: no displacement.
        name: name in messages and output.

    Raises:
        InputError: a group that is not of the mesh, a direction or twist of a cable, a direction of
            length zero, or opposite to the section's.

    Example:
        >>> gx.constraints.Clamped(beam, "start", twist=lambda t: 0.1 * t).name
        'beam/start clamped'
    """

    body: Curve
    group: str
    _: KW_ONLY
    direction: Vector | Callable[[Array, float], Array] | None = None
    twist: float | Callable[[float], float] = 0.0
    motion: Callable[[Array, float], Array] | None = None
    name: str = ""

    def __post_init__(self) -> None:
        check_support("Clamped", self.body, self.group, (0, 1, 2))
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} clamped")
        turns = self.direction is not None or callable(self.twist) or self.twist != 0
        check(
            not turns or isinstance(self.body, Beam),
            f"'{self.name}': a cable has no stiffness in bending, so no direction of it can be held; use a Beam, or "
            "leave direction and twist out.",
        )
        if self.direction is not None and not callable(self.direction):
            check(
                any(self.direction),
                f"'{self.name}': direction is {self.direction!r}; give three numbers, not all zero.",
            )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        size, nodes = self.body.block.size, self.body.nodes(self.group)
        dofs = (size * nodes[:, None] + np.arange(size)).ravel().astype(np.int32)
        still = (
            self.direction is None
            and self.motion is None
            and not callable(self.twist)
            and self.twist == 0
        )
        yield Support(self.name, self.body, dofs, None if still else self._path(nodes))

    def _path(self, nodes: Indices) -> Callable[[float], Array]:
        """Positions and directors (n, size), flattened, as a function of time."""
        comm, moved = self.body.comm, self.motion
        X = self.body.space.tabulate_dof_coordinates()[nodes].T
        start = self.body.stress_free(nodes) if isinstance(self.body, Beam) else X.T[:, None]

        def path(t: float) -> Array:
            q = start.copy()
            if moved is not None:
                q[:, 0] += ask_points(
                    comm, f"Motion of '{self.name}' at t = {t:.6g} s", lambda: moved(X, t), X.shape
                ).T
            if q.shape[1] > 1:
                n = np.cross(q[:, 1], q[:, 2])
                q[:, 1:] = np.einsum("nij,nkj->nki", self._turn(X, n, t), q[:, 1:])
            return q.ravel()

        return path

    def _turn(self, X: Array, n: Array, t: float) -> Array:
        """Rotations (n, 3, 3) of sections with the normals n (n, 3)."""
        comm, when = self.body.comm, f"of '{self.name}' at t = {t:.6g} s"
        given, angle = self.direction, self.twist
        φ = (
            float(ask_numbers(comm, f"Twist {when}", lambda: angle(t)))
            if callable(angle)
            else float(angle)
        )
        if given is None:
            m = n
        elif callable(given):
            m = ask_points(comm, f"Direction {when}", lambda: given(X, t), X.shape).T
        else:
            m = np.broadcast_to(np.asarray(given, dtype=float), n.shape)
        length = np.linalg.norm(m, axis=1, keepdims=True)
        m = m / np.where(length > 0, length, 1.0)
        cosine = np.einsum("ni,ni->n", n, m)
        check_on_all(
            comm,
            bool((length > 0).all() and (cosine > OPPOSITE - 1).all()),
            f"The direction {when} is zero, or opposite to that of the section, so that no turn is the shortest; go "
            "there by a function of time.",
        )
        v = cross_matrices(np.cross(n, m))
        shortest = np.eye(3) + v + v @ v / (1 + cosine)[:, None, None]
        turns: Array = rotations(m, φ) @ shortest
        return turns
