"""Sections of beams whose rotation is fixed or prescribed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gossamer_fx.core.algebra.rotations import cross_matrices, rotations
from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.checks.user_functions import ask_numbers, ask_points
from gossamer_fx.core.model.body import Array, Indices, Vector
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.terms.supports import Support

PointMotion = Callable[[Array, float], Array]

# 1 + cosine of two directions below which they are opposite: no rotation between them is the
# shortest.
OPPOSITE = 1e-6


@dataclass(frozen=True)
class SectionRotation:
    """How the sections at nodes of a beam move and turn: by the shortest rotation from their normal
    to `direction`, then about it by `twist`, see `Fixed`."""

    name: str
    beam: Beam
    nodes: Indices
    direction: Vector | PointMotion | None
    twist: float | Callable[[float], float]
    motion: PointMotion | None

    def support(self) -> Support:
        """The support of all coordinates of the sections, positions and directors."""
        size = self.beam.block.size
        # Directors too: three numbers of a position and six of two directors.
        dofs = (size * self.nodes[:, None] + np.arange(size)).ravel().astype(np.int32)
        is_still = self.direction is None and self.motion is None and self.twist == 0
        return Support(self.name, self.beam, dofs, None if is_still else self._path())

    def _path(self) -> Callable[[float], Array]:
        """Prescribed coordinates of the sections of a beam: a function of time [s] that returns
        positions [m] and two directors of the n nodes, (9 n,), node by node.  It is collective."""
        # X (3, n) [m] are the nodes of the stress-free shape.
        X = self.beam.space.tabulate_dof_coordinates()[self.nodes].T
        start = self.beam.stress_free(self.nodes)
        motion = self.motion

        def path(t: float) -> Array:
            # Coordinates (n, 3, 3) of the nodes: position and two directors as rows.
            q = start.copy()
            if motion is not None:
                what = f"Motion of '{self.name}' at t = {t:.6g} s"
                q[:, 0] += ask_points(self.beam.comm, what, lambda: motion(X, t), X.shape).T
            # From the stress-free section, not from the last step: errors do not add up.
            normals = np.cross(q[:, 1], q[:, 2])
            turns = self._rotations(X, normals, t)
            q[:, 1:] = np.einsum("nij,nkj->nki", turns, q[:, 1:])
            return q.ravel()

        return path

    def _rotations(self, X: Array, normals: Array, t: float) -> Array:
        """Rotations (n, 3, 3) at a time [s] of the sections with unit normals (n, 3) at nodes X (3,
        n) [m] of the stress-free shape.  Collective."""
        when = f"of '{self.name}' at t = {t:.6g} s"
        wanted = self._directions(X, normals, t, when)
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        # The check below refuses a length of zero, on all ranks at once.
        wanted = wanted / np.where(length > 0, length, 1.0)
        cosine = np.einsum("ni,ni->n", normals, wanted)
        check_on_all(
            self.beam.comm,
            bool((length > 0).all() and (cosine > OPPOSITE - 1).all()),
            f"The direction {when} is zero, or opposite to that of the section, "
            "so that no turn is the shortest; go there by a function of time.",
        )
        # Rodrigues' formula with sine and cosine taken from the two directions; v (n, 3, 3) is the
        # skew matrix of their cross product.
        v = cross_matrices(np.cross(normals, wanted))
        shortest = np.eye(3) + v + v @ v / (1 + cosine)[:, None, None]
        turned: Array = rotations(wanted, self._angle(t, when)) @ shortest
        return turned

    def _directions(
        self,
        X: Array,
        normals: Array,
        t: float,
        when: str,
    ) -> Array:
        """Directions (n, 3), of any length, that the unit normals (n, 3) of sections at nodes X (3,
        n) [m] of the stress-free shape are to have at a time [s].  Collective."""
        given = self.direction
        if given is None:
            return normals
        if callable(given):
            return ask_points(self.beam.comm, f"Direction {when}", lambda: given(X, t), X.shape).T
        return np.broadcast_to(np.asarray(given, dtype=float), normals.shape)

    def _angle(self, t: float, when: str) -> float:
        """The twist [rad] at time t [s]."""
        angle = self.twist
        if callable(angle):
            return float(ask_numbers(self.beam.comm, f"Twist {when}", lambda: angle(t)))
        return float(angle)
