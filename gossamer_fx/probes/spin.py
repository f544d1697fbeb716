"""Probes of what spins: the spin of a whole body, and where a point is about a turning axis."""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.bodies.frames import Frame
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array, Body, Port, is_body
from gossamer_fx.probes.points import AXES
from gossamer_fx.probes.run import Run

POLAR = ("radius", "angle")


@check_arguments
class MeanSpin:
    """Mean spin [rad/s] of a body about an axis through its centre of mass: ω = L/I.

    L is its angular momentum and I its moment of inertia about that axis, with the masses attached to it; a rigid
    motion has ω everywhere, a sail that lags behind its hub has less than that.

    Args:
        body: a film, plate, cable, beam or mass.
        axis: "x", "y" or "z".
    """

    def __init__(self, body: Body, axis: str = "z") -> None:
        check(is_body(body), f"MeanSpin: {body!r} is no body; give a film, plate, cable or beam.")
        check(
            axis in AXES, f"MeanSpin: there is no axis {axis!r}; its axes are: {', '.join(AXES)}."
        )
        self.body, self.axis = body, axis

    def __call__(self, run: Run) -> float:
        system, body = run.system, self.body
        k = (AXES[self.axis] + 1) % 3
        plane, size = [k, (k + 1) % 3], body.block.size
        owned = run.system.state[body].part

        def vectors(values: Array) -> Array:
            """Its vectors (n, 2) across the axis."""
            return values[owned].reshape(-1, 3)[:, plane]

        # the body alone: what else the mass matrix couples to it does not count
        alone, product = system.q0.duplicate(), system.q0.duplicate()
        found = []
        points = np.zeros((body.block.index_map.size_local * size // 3, 2))
        points[:: size // 3] = 1.0  # positions, not directors
        for what in (vectors(system.q0.array_r), vectors(system.v0.array_r), points):
            alone.set(0.0)
            with alone as values:
                values[owned].reshape(-1, 3)[:, plane] = what
            system.M.mult(alone, product)
            found.append((what, vectors(product.array_r).copy()))
        alone.destroy()
        product.destroy()
        (x, Mx), (_, Mv), (one, M1) = found
        sums = np.array(
            [
                (x * Mx).sum(),
                (x[:, 0] * Mv[:, 1] - x[:, 1] * Mv[:, 0]).sum(),
                *(one * M1).sum(axis=0),
                *(one * Mx).sum(axis=0),
                *(one * Mv).sum(axis=0),
            ]
        )
        sums = run.comm.allreduce(sums)
        inertia, momentum, (m, centre, way) = sums[0], sums[1], sums[2:].reshape(3, 2)
        inertia -= (centre**2 / m).sum()
        momentum -= (centre[0] * way[1] - centre[1] * way[0]) / m[0]
        return float(momentum / inertia) if inertia > 0 else 0.0


@check_arguments
class PolarPosition:
    """Where a point is about the third axis of a frame: its "radius" [m], or "angle" [rad] from the first axis.

    About a hub's frame the angle of a tip tells by how much the sail is twisted; it lies between -π and π.

    Args:
        port: a point of a body.
        frame: with three directors, of a body or of the ground.
        quantity: "radius" or "angle".
    """

    def __init__(self, port: Port, frame: Frame, *, quantity: str = "radius") -> None:
        check(
            quantity in POLAR,
            f"PolarPosition: there is no {quantity!r}; choose from {', '.join(POLAR)}.",
        )
        check(
            len(frame.directors) == 3,
            "PolarPosition: the frame has no third axis; give one with three directors.",
        )
        self.port, self.frame, self.quantity = port, frame, quantity

    def __call__(self, run: Run) -> float:
        ports = [self.port, self.frame.origin, *self.frame.directors]
        x, origin, *axes = run.system.state.vectors(ports)
        a, b, _ = (float((x - origin) @ d) for d in axes)
        return math.hypot(a, b) if self.quantity == "radius" else math.atan2(b, a)
