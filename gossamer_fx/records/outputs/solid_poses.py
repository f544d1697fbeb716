"""Positions and orientations of the solids of a scene, for pictures and recordings."""

from __future__ import annotations

from typing import Any

import numpy as np

from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView

# Origin and axes of a solid that is not moved, (4, 3).
REST = np.vstack([np.zeros(3), np.eye(3)])


def solids_of(system: System) -> list[Solid]:
    """The solids of all terms of a scene, e.g. rigid bodies and obstacles."""
    solids: list[Solid] = []
    for compiled in system.shown:
        solids += compiled.solids()
    return solids


def pose_of(solid: Solid, system: System) -> Array:
    """Origin [m] and axes [-] of a solid in the accepted state, (4, 3); the same on every rank.

    A solid is a rigid shape in pictures: on a rigid body, with a prescribed motion, or at rest.
    Its axes are the rows 1 to 3; those of a solid that is not on a body are the coordinate axes.

    Collective: all ranks call it.
    """
    if solid.on is not None:
        # One rank has the body's only node, and all others an empty array.
        own = system.state[solid.on].coordinates().copy()
        poses = np.concatenate(system.comm.allgather(own))
        return np.asarray(poses[0])
    origin: Array = np.zeros(3)
    if solid.motion is not None:
        origin = np.asarray(solid.motion(system.time), dtype=float)
    return np.vstack([REST[:1] + origin, REST[1:]])


def placed(X: Array, pose: Array) -> Array:
    """Positions in space (n, 3) [m] of points X of a solid with a pose (4, 3)."""
    return pose[0] + X @ pose[1:]


def moves(solid: Solid) -> bool:
    """Whether a solid is on a body, or has a prescribed motion."""
    return solid.on is not None or solid.motion is not None


def as_data(solid: Solid) -> dict[str, Any]:
    """The shape of a solid as lists, for JSON: points [m] to six digits, triangles, lines.

    Args:
        solid: a rigid shape that pictures show, with points X (n, 3) [m].
    """
    points = []
    for point in solid.X:
        # Six digits are enough for pictures, and keep the file short.
        points.append([float(f"{x:.6g}") for x in point])
    return {
        "X": points,
        "triangles": solid.triangles.tolist(),
        "lines": solid.lines.tolist(),
        "moves": moves(solid),
    }


class PoseComponent:
    """A component of a solid's pose, its origin and axes, as a probe.

    Args:
        index: of the component in the pose (4, 3), row by row.
    """

    def __init__(self, solid: Solid, index: int) -> None:
        self._solid = solid
        self._index = index

    def __call__(self, run: StateView) -> float:
        """The component in the state of a run."""
        pose = pose_of(self._solid, run.system)
        return float(pose.ravel()[self._index])
