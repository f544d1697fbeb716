"""Ties: edges of films that are connected, cables along edges of films."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.bodies.beam import Beam
from gossamer_fx.bodies.meshed import Meshed
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.constraints.joint import COINCIDE, coincidence
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.model.body import Array, Port, is_on_mesh
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term

NODE = 1e-9  # part of a segment from its end that counts as its end


@check_arguments
@dataclass(frozen=True, eq=False)
class Tie:
    """A tie: the nodes of a line of one film or cable stay where they are at the start on a line of another.

        x_k - (1 - s) x_i - s x_j = 0   for every node k of the first, between nodes i and j of the second

    Meshes may differ: tie the finer line to the coarser one.  Three films on a line: tie two of them to
    the third.  Multipliers do no work and keep both momenta.  Matching lines are found where the scene
    starts, also of a folded film, as long as no other part of the second line is at the same point.
    `Contact` takes what is tied as connected.

    Args:
        a: a film or cable, whose nodes are tied.
        b: a film or cable, or the same one.
        group_a: name of a curve (of a cable also of points) of the mesh of `a`; None: all of a cable.
        group_b: name of a curve of the mesh of `b`; None: all of a cable.
        name: name in messages and output.

    Raises:
        InputError: beams (join their ends by joints), a film without a group, a line tied to itself;
            when the scene is compiled: nodes that are not on the other line.

    Example:
        >>> hem = gx.Cable(curve, gx.CableLaw(1e4, 0.01), name="hem")
        >>> gx.Tie(hem, film, group_b="bottom").name
        'hem/all tied to film/bottom'
    """

    a: Meshed
    b: Meshed
    _: KW_ONLY
    group_a: str | None = None
    group_b: str | None = None
    name: str = ""

    def __post_init__(self) -> None:
        for body, group in ((self.a, self.group_a), (self.b, self.group_b)):
            check(
                not isinstance(body, Beam) and is_on_mesh(body),
                f"Tie: '{body.name}' is not a film or cable; join others by joints.",
            )
            check(
                group is not None or body.space.mesh.topology.dim == 1,
                f"Tie: of the film '{body.name}' one line is tied; name a curve of its mesh.",
            )
        check(
            self.a is not self.b or self.group_a != self.group_b,
            f"Tie: '{self.group_a}' of '{self.a.name}' is tied to itself; name another line.",
        )
        if not self.name:
            words = [
                f"{body.name}/{group or 'all'}"
                for body, group in ((self.a, self.group_a), (self.b, self.group_b))
            ]
            object.__setattr__(self, "name", " tied to ".join(words))
        if self.group_a is not None:
            self.a.mesh.group(self.group_a)
        if self.group_b is not None:
            self.b.mesh.curve(self.group_b, f"'{self.name}'")

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    def terms(self, start: State) -> Iterable[Term]:
        yield coincidence(self.name, *self._places(start))

    def _places(self, start: State) -> list[tuple[Port, Port]]:
        """Of this rank's nodes: each, and where it is on the other line."""
        comm, index_map = self.a.comm, self.a.block.index_map
        nodes = (
            np.arange(index_map.size_local) if self.group_a is None else self.a.nodes(self.group_a)
        )
        own = np.asarray(nodes[nodes < index_map.size_local], dtype=np.int32)
        x = start[self.a].positions()[own]
        ends, at = self._segments(start)
        check(
            len(ends) > 0,
            f"'{self.name}': the group '{self.group_b}' has no edges; name a line of '{self.b.name}'.",
        )
        count = comm.allreduce(len(own))
        check(
            count > 0,
            f"'{self.name}': the group '{self.group_a}' has no nodes; name a line of '{self.a.name}'.",
        )
        which, s, distance = _nearest(x, at)
        far = comm.allreduce(float(distance.max(initial=0.0)), op=MPI.MAX)
        check_on_all(
            comm,
            far <= COINCIDE,
            f"'{self.name}': nodes of the first are up to {far:.3g} m away from the second line at the start; let them "
            "lie on it.",
        )
        numbers = index_map.local_to_global(own)
        return [
            (Port(self.a, (int(node),)), _between(self.b, ends[i], float(t)))
            for node, i, t in zip(numbers, which, s, strict=True)
        ]

    def _segments(self, start: State) -> tuple[npt.NDArray[np.int64], Array]:
        """The second line, on every rank: global nodes (n, 2) of its pieces, and their end points (n, 2, 3)."""
        body, space = self.b, self.b.space
        mesh = space.mesh
        if mesh.topology.dim == 2:
            edges = body.mesh.curve(str(self.group_b), self.name)
            local = body.mesh.edges.nodes(space, edges[edges < body.mesh.edges.owned])
        else:
            own = mesh.topology.index_map(1).size_local
            cells = (
                np.arange(own) if self.group_b is None else body.mesh.curve(self.group_b, self.name)
            )
            local = cell_nodes(space)[cells[cells < own]]
            local = local if local.shape[1] == 2 else local[:, [0, 2, 1]]
        pieces = np.concatenate([local[:, k : k + 2] for k in range(local.shape[1] - 1)])
        numbers = body.block.index_map.local_to_global(pieces.ravel().astype(np.int32)).reshape(
            -1, 2
        )
        parts = body.comm.allgather(
            (numbers, start[body].local_positions()[pieces].reshape(-1, 2, 3))
        )
        return np.concatenate([n for n, _ in parts]), np.concatenate([x for _, x in parts])


def _nearest(x: Array, segments: Array) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """Of points (n, 3) the nearest of segments (m, 2, 3), the position on it between 0 and 1, and the distance [m]."""
    a, d = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.einsum("mc,mc->m", d, d)
    found, places, distances = np.zeros(len(x), dtype=np.intp), np.zeros(len(x)), np.zeros(len(x))
    for k, p in enumerate(x):
        s = np.clip(np.einsum("mc,mc->m", p - a, d) / square, 0, 1)
        r = np.linalg.norm(a + s[:, None] * d - p, axis=1)
        i = int(r.argmin())
        found[k], places[k], distances[k] = i, s[i], r[i]
    return found, places, distances


def _between(body: Meshed, ends: npt.NDArray[np.int64], s: float) -> Port:
    """The point at s between two nodes; a node, if it is one."""
    if s < NODE or s > 1 - NODE:
        return Port(body, (int(ends[0] if s < NODE else ends[1]),))
    return Port(body, (int(ends[0]), int(ends[1])), weights=(1 - s, s))
