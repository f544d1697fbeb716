"""Solids of a run that are drawn and recorded: where their frames are."""

from __future__ import annotations

from typing import Any

import numpy as np

from gossamer_fx.drawing.solids import Solid
from gossamer_fx.model.body import Array
from gossamer_fx.model.roles import Drawable, playing
from gossamer_fx.probes.run import Run
from gossamer_fx.system.system import System

REST = np.vstack([np.zeros(3), np.eye(3)])  # origin and axes of what stays


def solids_of(system: System) -> list[Solid]:
    """What the terms of a scene bring."""
    return [solid for kind in playing(Drawable, system.compiled) for solid in kind.solids()]


def frame_of(solid: Solid, system: System) -> Array:
    """Origin [m] and axes (4, 3) of a solid in the accepted state; collective, the same on every rank."""
    if solid.on is not None:
        return np.concatenate(system.comm.allgather(system.state[solid.on].coordinates().copy()))[0]
    origin = (
        np.zeros(3) if solid.motion is None else np.asarray(solid.motion(system.time), dtype=float)
    )
    return np.vstack([REST[:1] + origin, REST[1:]])


def placed(X: Array, frame: Array) -> Array:
    """Points (n, 3) in space of those in a frame (4, 3)."""
    return frame[0] + X @ frame[1:]


def moves(solid: Solid) -> bool:
    return solid.on is not None or solid.motion is not None


def as_data(solid: Solid) -> dict[str, Any]:
    """For a file."""
    X = [[float(f"{x:.6g}") for x in point] for point in solid.X]
    return {
        "X": X,
        "triangles": solid.triangles.tolist(),
        "lines": solid.lines.tolist(),
        "moves": moves(solid),
    }


class FramePart:
    """A number of a solid's frame, as a probe."""

    def __init__(self, solid: Solid, part: int) -> None:
        self._solid, self._part = solid, part

    def __call__(self, run: Run) -> float:
        return float(frame_of(self._solid, run.system).ravel()[self._part])
