"""Ports and frames: their values at the start, and linear combinations of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gossamer_fx.errors import check
from gossamer_fx.parts import Array, Attached, Ground, Port, Vector


@dataclass(frozen=True, eq=False)
class Frame:
    """An oriented point of a body: `origin`, and two or three directors that stay orthonormal.

    Rigid bodies and the ground have three (d1, d2, d3); a beam has the two of its section (d2, d3).
    """

    origin: Attached
    directors: tuple[Attached, ...]


def ground_frame(point: Vector = (0.0, 0.0, 0.0)) -> Frame:
    """The axes of inertial space at a point [m]."""
    x, y, z = point
    return Frame(Ground((x, y, z)), (Ground((1, 0, 0)), Ground((0, 1, 0)), Ground((0, 0, 1))))


def initial(port: Attached) -> Array:
    """The attached vector (3,) at the start."""
    if isinstance(port, Ground):
        return np.array(port.vector, dtype=float)
    return _combined(port, port.body.initial_state()[0])


def initial_rate(port: Attached) -> Array:
    """Its rate (3,) at the start, as the body has it by itself."""
    return np.zeros(3) if isinstance(port, Ground) else _combined(port, port.body.initial_state()[1])


def _combined(port: Port, values: Array) -> Array:
    """The combination of vectors that a port is, of the owned `values` of its body; the same on every rank."""
    body, block = port.body, port.body.block
    start, end = block.index_map.local_range
    q = values.reshape(-1, block.size // 3, 3)
    vectors = port.vectors or (0,) * len(port.nodes)
    mine = [(node - start, v, w) for node, v, w in zip(port.nodes, vectors, port.weights, strict=True)]
    local = sum((w * q[i, v] for i, v, w in mine if 0 <= i < end - start), np.zeros(3))
    return np.asarray(body.comm.allreduce(local))


def combine(weights: Sequence[float], ports: Sequence[Attached]) -> Attached:
    """Σ weights[k] ports[k], of ports of one body or of the ground."""
    if all(isinstance(p, Ground) for p in ports):
        x, y, z = np.asarray(weights) @ np.array([initial(p) for p in ports])
        return Ground((float(x), float(y), float(z)))
    parts = [(w, p) for w, p in zip(weights, ports, strict=True) if isinstance(p, Port)]
    body = parts[0][1].body
    check(len(parts) == len(ports) and all(p.body is body for _, p in parts), "Only ports of one body can be combined.")
    return Port(
        body,
        tuple(n for _, p in parts for n in p.nodes),
        tuple(w * each for w, p in parts for each in p.weights),
        tuple(v for _, p in parts for v in p.vectors or (0,) * len(p.nodes)),
    )


def along(direction: Array, frame: Frame) -> Attached:
    """The vector fixed in a frame that is `direction` (3,) at the start.

    Raises:
        InputError: the frame has two directors and the direction is not in their plane.
    """
    check(
        lies_in(direction, frame),
        f"A frame has no direction {direction.tolist()} in the plane of its directors; give one with three directors.",
    )
    return combine([float(initial(d) @ direction) for d in frame.directors], frame.directors)


def lies_in(direction: Array, frame: Frame) -> bool:
    """Whether a direction (3,) is a combination of the directors of a frame at the start."""
    directors = np.array([initial(d) for d in frame.directors])
    return bool(np.allclose(directors @ direction @ directors, direction, atol=1e-9))
