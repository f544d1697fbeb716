"""Vectors attached to bodies: their values at the start, and linear combinations of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from gossamer_fx.checks.errors import check
from gossamer_fx.model.terms import Array, Attached, Body, Ground, Port, Vector


def unit(direction: Vector | Array) -> Array:
    """The vector (3,) of length one in a direction."""
    n = np.asarray(direction, dtype=float)
    return n / np.linalg.norm(n)


def initial(port: Attached) -> Array:
    """The attached vector (3,) in the body's own initial state."""
    if isinstance(port, Ground):
        return np.array(port.vector, dtype=float)
    return combined(port, port.body.initial_state()[0])


# owned coordinates of bodies, by their identity, where those of a scene that is being compiled are not their own
_STARTS: ContextVar[Mapping[int, Array]] = ContextVar("starts")


@contextmanager
def starting_from(coordinates: Mapping[int, Array]) -> Iterator[None]:
    """While a scene is compiled: where its initial conditions place bodies, owned coordinates by `id` of the body."""
    token = _STARTS.set(coordinates)
    try:
        yield
    finally:
        _STARTS.reset(token)


def at_start(port: Attached) -> Array:
    """The attached vector (3,) where the scene that is being compiled starts; else as the body has it by itself."""
    starts = _STARTS.get(None)
    if starts and isinstance(port, Port) and id(port.body) in starts:
        return combined(port, starts[id(port.body)])
    return initial(port)


def coordinates_at_start(body: Body) -> Array:
    """Owned coordinates of a body where the scene that is being compiled starts; else its own."""
    starts = _STARTS.get(None)
    return starts[id(body)] if starts and id(body) in starts else body.initial_state()[0]


def initial_rate(port: Attached) -> Array:
    """Its rate (3,) at the start, as the body has it by itself."""
    return np.zeros(3) if isinstance(port, Ground) else combined(port, port.body.initial_state()[1])


def combined(port: Port, values: Array) -> Array:
    """The combination of vectors (3,) that a port is, of the owned `values` of its body; the same on every rank."""
    body, block = port.body, port.body.block
    start, end = block.index_map.local_range
    nodes, weights = np.array(port.nodes), np.array(port.weights)
    vectors = np.array(port.vectors or (0,) * len(nodes))
    mine = (nodes >= start) & (nodes < end)
    terms = values.reshape(-1, block.size // 3, 3)[nodes[mine] - start, vectors[mine]]
    return np.asarray(body.comm.allreduce(weights[mine] @ terms))


def combine(weights: Sequence[float], ports: Sequence[Attached]) -> Attached:
    """Σ weights[k] ports[k], of ports of one body or of the ground."""
    if all(isinstance(p, Ground) for p in ports):
        x, y, z = np.asarray(weights) @ np.array([initial(p) for p in ports])
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
