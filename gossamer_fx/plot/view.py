"""What a picture of a scene shows: films and solids as triangles, cables and beams as lines, other bodies as dots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import la

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.fields.body_shape import BodyShape
from gossamer_fx.fields.fields import film_state
from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.mesh.quality import area_vectors
from gossamer_fx.model.body import Array, MeshBody, is_on_mesh
from gossamer_fx.outputs.solid_frames import frame_of, placed, solids_of
from gossamer_fx.plot.groups import groups_of
from gossamer_fx.system.system import System

Integers = npt.NDArray[np.int64]

# triangles between the nodes of a cell, by the order of its film
TRIANGLES = {1: [[0, 1, 2]], 2: [[0, 5, 4], [5, 1, 3], [4, 3, 2], [5, 3, 4]]}
_NODES = {1: [[0, 0], [1, 0], [0, 1]], 2: [[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0, 0.5], [0.5, 0]]}

SOLID = -1  # kind of the triangles of solids
_CREASE = 0.6  # cosine of the angle between neighbours beyond which an edge is drawn sharp


@dataclass(frozen=True)
class Shape:
    """What this rank shows at one time: points [m] in space.

    corners (n, 3, 3) of triangles, normals (n, 3, 3) at the corners, kinds (n,) which colour they have (the state of
    the film, its group, or SOLID), lines (m, 2, 3), dots (k, 3)
    """

    time: float
    corners: Array
    normals: Array
    kinds: Integers
    lines: Array
    dots: Array

    @property
    def points(self) -> Array:
        """All of them (p, 3)."""
        return np.concatenate(
            [part.reshape(-1, 3) for part in (self.corners, self.lines, self.dots)]
        )


class Renderer:
    """The bodies of a system, ready to be looked at: films by their state, or by their `groups`."""

    def __init__(self, system: System, by_group: bool = False) -> None:
        self._system = system
        films = [body for body in system.bodies if isinstance(body, Membrane)]
        parts: Sequence[Integers | None] = [None] * len(films)
        self.groups: list[str] = []
        if by_group:
            self.groups, parts = groups_of(films)
        self._films = [
            _Film(BodyShape(system.state, film), part)
            for film, part in zip(films, parts, strict=True)
        ]
        curves = [b for b in system.bodies if is_on_mesh(b) and not isinstance(b, Membrane)]
        self._curves = [(system.fields[b].q0, _polylines(b)) for b in curves]
        self._solids = solids_of(system)
        self._dots = [b for b in system.bodies if not is_on_mesh(b)]

    def shape(self) -> Shape:
        """The accepted state; every rank must look at it, to know the normals at its border."""
        films = [film.snapshot() for film in self._films]
        lines = [
            _positions(q.x.array, q.function_space.dofmap.bs)[ends] for q, ends in self._curves
        ]
        dots = []
        for body in self._dots:
            dots.append(self._system.state[body].positions())
        for solid in self._solids:
            x = placed(solid.X, frame_of(solid, self._system))
            if self._system.comm.rank == 0:
                lines += [x[solid.lines]] if not len(solid.triangles) else []
                films.append(of_solid(x, solid.triangles))
        corners, normals, states = zip(*films, strict=True) if films else ((), (), ())
        return Shape(
            self._system.time,
            np.concatenate([np.zeros((0, 3, 3)), *corners]),
            np.concatenate([np.zeros((0, 3, 3)), *normals]),
            np.concatenate([np.zeros(0, dtype=np.int64), *states]),
            np.concatenate([np.zeros((0, 2, 3)), *lines]),
            np.concatenate([np.zeros((0, 3)), *dots]),
        )


class _Film:
    """A film's triangles, straight between nodes, and their states, or the given kinds of cells."""

    def __init__(self, shape: BodyShape, of_cells: Integers | None) -> None:
        film: Membrane = shape.body
        self._shape, x = shape, shape.q
        pieces = np.array(TRIANGLES[film.order])
        middles = np.array(_NODES[film.order], dtype=float)[pieces].mean(axis=1)
        self._cells = np.arange(film.mesh.domain.topology.index_map(2).size_local, dtype=np.int32)
        self._triangles = (
            cell_nodes(film.space)[self._cells].astype(np.int64)[:, pieces].reshape(-1, 3)
        )
        self._kinds = None if of_cells is None else np.repeat(of_cells, len(pieces))
        self._state = compile_expression(film_state(film, x), middles) if of_cells is None else None
        self._film, self._x = film, x

    def snapshot(self) -> tuple[Array, Array, Integers]:
        """Corners, normals, kinds."""
        self._shape.update()
        corners = _positions(self._x.x.array, 3)[self._triangles]
        if self._kinds is not None:
            return corners, self._normals(corners), self._kinds
        assert self._state is not None
        states = evaluate(self._state, self._film.mesh.domain, self._cells).ravel()
        return corners, self._normals(corners), np.rint(states).astype(np.int64)

    def _normals(self, corners: Array) -> Array:
        """Unit normals at the corners: the mean of the triangles around, or the triangle's own where they differ."""
        area = area_vectors(corners)
        sums = la.vector(self._film.block.index_map, 3)
        np.add.at(sums.array.reshape(-1, 3), self._triangles.ravel(), np.repeat(area, 3, axis=0))
        sums.scatter_reverse(la.InsertMode.add)
        sums.scatter_forward()
        return smooth(area, sums.array.reshape(-1, 3)[self._triangles])


def of_solid(x: Array, triangles: npt.NDArray[np.integer]) -> tuple[Array, Array, Integers]:
    """Corners, normals and kinds of a solid with points x (n, 3)."""
    corners = x[triangles]
    area = area_vectors(corners)
    sums = np.zeros_like(x)
    np.add.at(sums, triangles.ravel(), np.repeat(area, 3, axis=0))
    return corners, smooth(area, sums[triangles]), np.full(len(triangles), SOLID, dtype=np.int64)


def smooth(area: Array, sums: Array) -> Array:
    """Normals (n, 3, 3) at corners: of the area vectors summed around them, or the triangle's own where they differ."""
    own, mean = np.repeat(unit(area)[:, None], 3, axis=1), unit(sums)
    alike = (own * mean).sum(axis=2, keepdims=True) > _CREASE
    normals: Array = np.where(alike, mean, own)
    return normals


def _positions(values: Array, size: int) -> Array:
    """Positions (n, 3) of nodes with `size` numbers each: their first vector."""
    return values.reshape(-1, size)[:, :3]


def _polylines(body: MeshBody) -> Integers:
    """Nodes (m, 2) at the ends of straight pieces of a curve's cells; inner nodes follow the ends in a cell's list."""
    mesh, dofmap = body.space.mesh, body.space.dofmap
    nodes = dofmap.list[: mesh.topology.index_map(mesh.topology.dim).size_local].astype(np.int64)
    along = np.concatenate([nodes[:, :1], nodes[:, 2:], nodes[:, 1:2]], axis=1)
    pieces: Integers = np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2)
    return pieces


def unit(vectors: npt.NDArray) -> Array:
    """Vectors (..., 3) of length one; those of no length stay."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    result: Array = vectors / np.where(length > 0, length, 1.0)
    return result
