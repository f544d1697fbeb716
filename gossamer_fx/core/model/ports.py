"""Directions, and linear combinations of ports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Attached, Ground, Port, Vector


def unit(direction: Vector | Array) -> Array:
    """The vector (3,) of length one in a direction."""
    n = np.asarray(direction, dtype=float)
    return n / np.linalg.norm(n)


def combine(weights: Sequence[float], ports: Sequence[Attached]) -> Attached:
    """The linear combination Σ_k weights[k] ports[k] of ports of one body, or of the ground.

    A port is a vector attached to a body: a point [m] or a director [-].

    Args:
        weights: one dimensionless number for each port.
        ports: all of one body, or all of the ground.

    Raises:
        InputError: the ports are of several bodies, or of a body and of the ground.
        ValueError: there are not as many weights as ports.
    """
    if all(isinstance(port, Ground) for port in ports):
        vectors_of_ground = np.array([port.initial() for port in ports])
        x, y, z = np.asarray(weights) @ vectors_of_ground
        return Ground((float(x), float(y), float(z)))
    # The first one exists: not all are of the ground.
    body = next(port.body for port in ports if isinstance(port, Port))
    nodes: list[int] = []
    node_weights: list[float] = []
    vectors: list[int] = []
    for weight, port in zip(weights, ports, strict=True):
        is_of_body = isinstance(port, Port) and port.body is body
        check(is_of_body, "Only ports of one body can be combined.")
        assert isinstance(port, Port)
        nodes += port.nodes
        node_weights += [weight * each for each in port.weights]
        # A port without vectors means the positions of its nodes.
        vectors += port.vectors or (0,) * len(port.nodes)
    return Port(
        body,
        tuple(nodes),
        weights=tuple(node_weights),
        vectors=tuple(vectors),
    )
