"""Directions, and linear combinations of ports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array, Attached, Ground, Port, Vector


def unit(direction: Vector | Array) -> Array:
    """The vector (3,) of length one in a direction."""
    n = np.asarray(direction, dtype=float)
    return n / np.linalg.norm(n)


def combine(weights: Sequence[float], ports: Sequence[Attached]) -> Attached:
    """Σ weights[k] ports[k], of ports of one body or of the ground."""
    if all(isinstance(p, Ground) for p in ports):
        x, y, z = np.asarray(weights) @ np.array([p.initial() for p in ports])
        return Ground((float(x), float(y), float(z)))
    parts = [(w, p) for w, p in zip(weights, ports, strict=True) if isinstance(p, Port)]
    body = parts[0][1].body
    check(
        len(parts) == len(ports) and all(p.body is body for _, p in parts),
        "Only ports of one body can be combined.",
    )
    return Port(
        body,
        tuple(n for _, p in parts for n in p.nodes),
        weights=tuple(w * each for w, p in parts for each in p.weights),
        vectors=tuple(v for _, p in parts for v in p.vectors or (0,) * len(p.nodes)),
    )
