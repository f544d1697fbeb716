"""Ties: edges of films that are connected, cables along edges of films."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, Port, is_on_mesh
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.constraints.joint import COINCIDE, coincidence

# Distance from the end of a segment, over its length, below which a point counts as the end.  A
# point on a node then depends on this node only.
NODE = 1e-9


@check_arguments
@dataclass(frozen=True, eq=False)
class Tie:
    """A tie: the nodes of a line of one film or cable stay where they are at the start on a line of
    another.

        x_k - (1 - s) x_i - s x_j = 0   for every node k of the first, between nodes i and j of the
                                        second

    Meshes may differ: tie the finer line to the coarser one.  Three films on a line: tie two of
    them to the third.  Multipliers do no work and keep both momenta.  Matching lines are found
    where the scene starts, also of a folded film, as long as no other part of the second line is at
    the same point. `Contact` takes what is tied as connected.

    Args:
        a: a film or cable, whose nodes are tied.
        b: a film or cable, or the same one.
        group_a: name of a curve (of a cable also of points) of the mesh of `a`; None: all of a
            cable.
        group_b: name of a curve of the mesh of `b`; None: all of a cable.
        name: name in messages and output.

    Raises:
        InputError: beams (join their ends by joints), a film without a group, a line tied to
            itself; when the scene is compiled: nodes that are not on the other line.

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
        sides = ((self.a, self.group_a), (self.b, self.group_b))
        for body, group in sides:
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
            words = [f"{body.name}/{group or 'all'}" for body, group in sides]
            object.__setattr__(self, "name", " tied to ".join(words))
        # Groups that do not exist are refused here, before a scene is compiled.
        if self.group_a is not None:
            self.a.mesh.group(self.group_a)
        if self.group_b is not None:
            self.b.mesh.curve(self.group_b, f"'{self.name}'")

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    def terms(self, start: State) -> Iterable[Term]:
        yield coincidence(self.name, *self._pairs(start))

    def _pairs(self, start: State) -> list[tuple[Port, Port]]:
        """This rank's nodes of the first line, each with its point of the second line, as ports.
        Collective."""
        comm = self.a.comm
        index_map = self.a.block.index_map
        nodes = np.arange(index_map.size_local)
        if self.group_a is not None:
            nodes = self.a.nodes(self.group_a)
        # Each node is tied on the rank that owns it.
        own = np.asarray(nodes[nodes < index_map.size_local], dtype=np.int32)
        x = start[self.a].positions()[own]
        ends, segments = self._segments(start)
        check(
            len(ends) > 0,
            f"'{self.name}': the group '{self.group_b}' has no edges; "
            f"name a line of '{self.b.name}'.",
        )
        count = comm.allreduce(len(own))
        check(
            count > 0,
            f"'{self.name}': the group '{self.group_a}' has no nodes; "
            f"name a line of '{self.a.name}'.",
        )
        which, fractions, distance = _nearest(x, segments)
        far = comm.allreduce(float(distance.max(initial=0.0)), op=MPI.MAX)
        check_on_all(
            comm,
            far <= COINCIDE * start.extent(),
            f"'{self.name}': "
            f"nodes of the first are up to {far:.3g} m away from the second line at the start; "
            "let them lie on it.",
        )
        numbers = index_map.local_to_global(own)
        pairs = []
        for node, segment, fraction in zip(numbers, which, fractions, strict=True):
            point = _between(self.b, ends[segment], float(fraction))
            pairs.append((Port(self.a, (int(node),)), point))
        return pairs

    def _segments(self, start: State) -> tuple[npt.NDArray[np.int64], Array]:
        """The straight pieces of the second line, on every rank: global nodes (n, 2) of their ends,
        and initial positions (n, 2, 3) [m].  Collective."""
        body = self.b
        space = body.space
        mesh = space.mesh
        if mesh.topology.dim == 2:
            edges = body.mesh.curve(str(self.group_b), self.name)
            local = body.mesh.edges.nodes(space, edges[edges < body.mesh.edges.owned])
        else:
            own = mesh.topology.index_map(1).size_local
            cells = np.arange(own)
            if self.group_b is not None:
                cells = body.mesh.curve(self.group_b, self.name)
            local = cell_nodes(space)[cells[cells < own]]
            # dolfinx has the middle of a quadratic line after its ends.
            if local.shape[1] == 3:
                local = local[:, [0, 2, 1]]
        # A quadratic edge is two straight pieces.
        pieces = np.concatenate([local[:, k : k + 2] for k in range(local.shape[1] - 1)])
        local_nodes = pieces.ravel().astype(np.int32)
        mine = body.block.index_map.local_to_global(local_nodes).reshape(-1, 2)
        x_mine = start[body].local_positions()[pieces].reshape(-1, 2, 3)
        # Lines are short compared with films: every rank may know all of the second one.
        parts = body.comm.allgather((mine, x_mine))
        nodes = np.concatenate([nodes_of_rank for nodes_of_rank, _ in parts])
        positions = np.concatenate([x_of_rank for _, x_of_rank in parts])
        return nodes, positions


def _nearest(x: Array, segments: Array) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """The nearest of the segments (m, 2, 3) [m] of each point x (n, 3) [m]: its index, the position
    on it from 0 to 1, and the distance [m], (n,) each."""
    # Starts a and differences d (m, 3) of the ends; s (m,): nearest position on each segment.
    a = segments[:, 0]
    d = segments[:, 1] - a
    squared_length = np.einsum("mc,mc->m", d, d)
    found = np.zeros(len(x), dtype=np.intp)
    fractions = np.zeros(len(x))
    distances = np.zeros(len(x))
    # Point by point: arrays over all pairs would need memory for n m of them.
    for k, point in enumerate(x):
        along = np.einsum("mc,mc->m", point - a, d)
        s = np.clip(along / squared_length, 0, 1)
        distance = np.linalg.norm(a + s[:, None] * d - point, axis=1)
        i = int(distance.argmin())
        found[k] = i
        fractions[k] = s[i]
        distances[k] = distance[i]
    return found, fractions, distances


def _between(body: Meshed, ends: npt.NDArray[np.int64], s: float) -> Port:
    """The point at s, from 0 to 1, between two global nodes (2,); the node itself at an end."""
    if s < NODE:
        return Port(body, (int(ends[0]),))
    if s > 1 - NODE:
        return Port(body, (int(ends[1]),))
    return Port(body, (int(ends[0]), int(ends[1])), weights=(1 - s, s))
