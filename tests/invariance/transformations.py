"""Ways to describe one scene again: turned, moved, in other units, in another order, on another
mesh numbering, cut into two, on other ranks.

The scenes of `kinds.py` are written once, in SI units and where they are.  A `Description` converts
every number, vector, point, function and mesh of them, and converts results back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import entities_to_geometry
from hypothesis import strategies as st
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.line import line

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
PointFunction = Callable[[Array], Array]


class Units(NamedTuple):
    """Units of length [m], mass [kg] and time [s]."""

    length: float
    mass: float
    time: float


UNITS = {
    "SI": Units(1.0, 1.0, 1.0),
    "mm": Units(1e-3, 1.0, 1.0),
    "t-mm-s": Units(1e-3, 1e3, 1.0),
    "µm": Units(1e-6, 1.0, 1.0),
}

# Powers of length, mass and time of the units in which the scenes are written.
DIMENSIONS = {
    "1": (0, 0, 0),
    "m": (1, 0, 0),
    "m²": (2, 0, 0),
    "m³": (3, 0, 0),
    "1/m": (-1, 0, 0),
    "s": (0, 0, 1),
    "1/s": (0, 0, -1),
    "m/s": (1, 0, -1),
    "m/s²": (1, 0, -2),
    "m²/s²": (2, 0, -2),
    "m³/s²": (3, 0, -2),
    "kg": (0, 1, 0),
    "kg/m": (-1, 1, 0),
    "kg/m³": (-3, 1, 0),
    "kg/s": (0, 1, -1),
    "kg m/s": (1, 1, -1),
    "kg m²": (2, 1, 0),
    "N": (1, 1, -2),
    "N/m": (0, 1, -2),
    "N m": (2, 1, -2),
    "N m s": (2, 1, -1),
    "J": (2, 1, -2),
    "Pa": (-1, 1, -2),
}


@dataclass(frozen=True)
class Transformation:
    """What a description changes; by default nothing.

    Attributes:
        turn: rotation vector [rad].
        shift: [m], after the turn.
        units: a name in `UNITS`.
        order: seed of the order of the parts; 0: as they are written.
        numbering: seed of the numbers of nodes and triangles; 0: as they are made.
        is_split: whether films and cables are cut into two that are tied.
    """

    turn: Vector = (0.0, 0.0, 0.0)
    shift: Vector = (0.0, 0.0, 0.0)
    units: str = "SI"
    order: int = 0
    numbering: int = 0
    is_split: bool = False

    def without(self, left_out: Sequence[str]) -> Transformation:
        """The transformation less those, by their names in `SINGLE`, that a scene leaves out."""
        same = Transformation()
        names = {FIELDS[name] for name in left_out}
        return replace(self, **{name: getattr(same, name) for name in names})


SAME = Transformation()

# Each transformation by itself.  The shift is of the size of the scenes: their round-off grows with
# the distance from the origin.
SINGLE = {
    "turned": Transformation(turn=(0.5, -1.1, 0.8)),
    "moved": Transformation(shift=(1.3, -0.7, 2.1)),
    "mm": Transformation(units="mm"),
    "t-mm-s": Transformation(units="t-mm-s"),
    "µm": Transformation(units="µm"),
    "order": Transformation(order=1),
    "renumbered": Transformation(numbering=1),
    "split": Transformation(is_split=True),
}
FIELDS = {
    "turned": "turn",
    "moved": "shift",
    "mm": "units",
    "t-mm-s": "units",
    "µm": "units",
    "order": "order",
    "renumbered": "numbering",
    "split": "is_split",
}
ALL_AT_ONCE = Transformation(
    turn=(0.5, -1.1, 0.8),
    shift=(1.3, -0.7, 2.1),
    units="t-mm-s",
    order=1,
    numbering=1,
    is_split=True,
)


def transformations() -> st.SearchStrategy[Transformation]:
    """Any transformation but the one that changes nothing, to which a failure shrinks."""
    angles = st.floats(-3.0, 3.0)
    lengths = st.floats(-3.0, 3.0)
    seeds = st.integers(0, 5)
    any_at_all = st.builds(
        Transformation,
        turn=st.tuples(angles, angles, angles),
        shift=st.tuples(lengths, lengths, lengths),
        units=st.sampled_from(list(UNITS)),
        order=seeds,
        numbering=seeds,
        is_split=st.booleans(),
    )
    return any_at_all.filter(lambda transformation: transformation != SAME)


@dataclass(frozen=True)
class Patch:
    """A mesh as arrays: points (n, 3) [m], triangles (m, 3), and nodes of groups, (1,) of a point
    or (k, 2) of the edges of a curve."""

    points: Array
    triangles: npt.NDArray[np.int64]
    groups: dict[str, npt.NDArray[np.int64]]

    @classmethod
    def of(cls, mesh: gx.Mesh) -> Patch:
        """The arrays of a mesh on one rank."""
        domain = mesh.domain
        groups = {}
        for name, (dim, entities) in mesh.groups.items():
            # The surface "film" is made with the mesh.
            if dim < 2:
                domain.topology.create_connectivity(dim, 2)
                nodes = entities_to_geometry(domain, dim, entities).astype(np.int64)
                groups[name] = nodes if dim else nodes.ravel()
        triangles = geometry_nodes(domain).astype(np.int64)
        return cls(domain.geometry.x.copy(), triangles, groups)

    def placed(self, moved: Callable[[Array], Array]) -> Patch:
        """The mesh with points moved by a function of points (3, n) that returns (3, n)."""
        return replace(self, points=moved(self.points.T).T)

    def seen(self, count: int = 6) -> Patch:
        """The mesh with some of its nodes as groups "seen 0", "seen 1" and so on."""
        used = np.unique(self.triangles)
        nodes = used[np.linspace(0, len(used) - 1, count).round().astype(int)]
        groups = {f"seen {k}": np.array([node]) for k, node in enumerate(nodes)}
        return replace(self, groups=self.groups | groups)

    def renumbered(self, seed: int) -> Patch:
        """The mesh with other numbers of nodes and triangles; 0: the same ones."""
        if seed == 0:
            return self
        random = np.random.default_rng(seed)
        order = random.permutation(len(self.points))
        new = np.argsort(order)
        triangles = new[random.permutation(self.triangles)]
        # The first corner, too, whereas the side of the normal stays.
        triangles = np.array([np.roll(corners, random.integers(3)) for corners in triangles])
        groups = {name: new[nodes] for name, nodes in self.groups.items()}
        return Patch(self.points[order], triangles, groups)

    def halves(self) -> tuple[Patch, Patch]:
        """The mesh cut along edges, across its longest side; the group "cut" is the line between
        the halves in both."""
        extent = np.ptp(self.points, axis=0)
        axis = int(extent.argmax())
        centre = self.points[self.triangles].mean(axis=1)[:, axis]
        is_first = centre < (self.points[:, axis].max() + self.points[:, axis].min()) / 2
        edges = [_sides(self.triangles[is_first]), _sides(self.triangles[~is_first])]
        cut = np.array(sorted(edges[0] & edges[1]))
        halves = [self._part(self.triangles[mask], cut) for mask in (is_first, ~is_first)]
        return halves[0], halves[1]

    def _part(self, triangles: npt.NDArray[np.int64], cut: npt.NDArray[np.int64]) -> Patch:
        """The mesh of some of the triangles, with what they have of the groups."""
        nodes = np.unique(triangles)
        new = np.full(len(self.points), -1)
        new[nodes] = np.arange(len(nodes))
        sides = _sides(triangles)
        groups = {}
        for name, members in (self.groups | {"cut": cut}).items():
            if members.ndim == 1:
                kept = members[new[members] >= 0]
            else:
                kept = np.array([edge for edge in members if tuple(sorted(edge)) in sides])
            if len(kept):
                groups[name] = new[kept]
        return Patch(self.points[nodes], new[triangles], groups)


def _sides(triangles: npt.NDArray[np.int64]) -> set[tuple[int, int]]:
    """The sides of triangles (n, 3), the smaller node first."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return {(int(a), int(b)) for a, b in sides}


@dataclass(frozen=True)
class Pieces:
    """A film or cable, whole or as two bodies that are tied.

    Attributes:
        bodies: one or two.
        parts: of the scene: the bodies and their tie.
        ports: named points of the meshes, each of one of the bodies that have it.
    """

    bodies: list[Any]
    parts: list[Any]
    ports: dict[str, gx.Port]

    @property
    def whole(self) -> Any:
        """The body, of a scene that leaves cutting out."""
        (body,) = self.bodies
        return body

    def having(self, group: str) -> list[Any]:
        """The bodies with a group."""
        return [body for body in self.bodies if group in body.mesh.groups]


class Description:
    """A scene as a transformation describes it, on the ranks of a communicator.

    Args:
        transformation: what is changed.
        comm: ranks of the bodies.
    """

    def __init__(self, transformation: Transformation, comm: MPI.Intracomm) -> None:
        self.transformation = transformation
        self.comm = comm
        self.units = UNITS[transformation.units]
        self.rotation: Array = Rotation.from_rotvec(transformation.turn).as_matrix()
        self._shift = np.array(transformation.shift)

    # ---- from SI units and the written place -----------------------------------------------------

    def __call__(self, value: float, unit: str) -> float:
        """A number of a unit."""
        return value / self._size(unit)

    def _size(self, unit: str) -> float:
        length, mass, time = DIMENSIONS[unit]
        return self.units.length**length * self.units.mass**mass * self.units.time**time

    def vector(self, v: Sequence[float], unit: str = "1") -> Vector:
        """A direction, velocity, force or axis (3,)."""
        x, y, z = self.rotation @ np.array(v, dtype=float) / self._size(unit)
        return float(x), float(y), float(z)

    def point(self, X: Sequence[float]) -> Vector:
        """A point (3,) [m]."""
        x, y, z = self.points(np.array(X, dtype=float)[:, None])[:, 0]
        return float(x), float(y), float(z)

    def points(self, X: Array) -> Array:
        """Points (3, n) [m]."""
        return (self.rotation @ X + self._shift[:, None]) / self.units.length

    def field(self, function: PointFunction | None, unit: str) -> PointFunction | None:
        """A function of points (3, n) [m] that returns vectors (3, n) of a unit."""
        if function is None:
            return None
        return lambda x: self.rotation @ function(self._written(x)) / self._size(unit)

    def field_in_time(
        self, function: Callable[[Array, float], Array], unit: str
    ) -> Callable[[Array, float], Array]:
        """The same for a function of points and the time [s]."""
        return lambda x, t: (
            self.rotation @ function(self._written(x), t * self.units.time) / self._size(unit)
        )

    def scalar_in_time(
        self, function: Callable[[Array, float], Array]
    ) -> Callable[[Array, float], Array]:
        """A function of points [m] and the time [s] that returns numbers (n,) without dimension, or
        temperatures."""
        return lambda x, t: function(self._written(x), t * self.units.time)

    def tensor(self, T: Array, unit: str) -> Array:
        """A tensor (3, 3)."""
        return self.rotation @ T @ self.rotation.T / self._size(unit)

    def law(self, kind: type[Any], **numbers: Any) -> Any:
        """A film law: moduli, density and thickness are converted, other numbers have no unit."""
        units = {"density": "kg/m³", "thickness": "m"}
        units |= dict.fromkeys(("E", "E1", "E2", "G12"), "Pa")
        return kind(
            **{
                name: self(value, units[name]) if name in units else value
                for name, value in numbers.items()
            }
        )

    # ---- bodies ----------------------------------------------------------------------------------

    def film(
        self,
        patch: Patch,
        law: Any,
        name: str = "film",
        displacement: PointFunction | None = None,
        velocity: PointFunction | None = None,
        kind: type[Any] = gx.Membrane,
        **options: Any,
    ) -> Pieces:
        """A film or plate on a mesh.  What is given as functions is in SI units."""
        seen = patch.seen()
        halves = seen.halves() if self.transformation.is_split else (seen,)
        bodies = []
        for half, suffix in zip(halves, ("", ", second half"), strict=False):
            body = kind(
                self.mesh(half),
                law,
                name=f"{name}{suffix}",
                displacement=self.field(displacement, "m"),
                velocity=self.field(velocity, "m/s"),
                **options,
            )
            bodies.append(body)
        ties = []
        if len(bodies) > 1:
            ties.append(gx.Tie(bodies[0], bodies[1], group_a="cut", group_b="cut"))
        ports = {}
        for body in bodies:
            points = sorted(name for name, (dim, _) in body.mesh.groups.items() if dim == 0)
            ports |= {name: body.port(name) for name in points}
        return Pieces(bodies, [*bodies, *ties], ports)

    def cable(
        self, points: Sequence[Sequence[float]], elements: int, law: Any, name: str, **options: Any
    ) -> Pieces:
        """A cable through three points, which is cut at the second one; its ports are "0", "1" and
        "2"."""
        if not self.transformation.is_split:
            whole = gx.Cable(self.line(points, elements), law, name=name, **options)
            return Pieces([whole], [whole], {str(k): whole.port(f"point {k}") for k in range(3)})
        first = gx.Cable(self.line(points[:2], elements), law, name=name, **options)
        second = gx.Cable(
            self.line(points[1:], elements), law, name=f"{name}, second half", **options
        )
        ends = [first.port("start"), first.port("end"), second.port("end")]
        joint = gx.constraints.BallJoint(ends[1], second.port("start"), name=f"{name} joint")
        named = {str(k): port for k, port in enumerate(ends)}
        return Pieces([first, second], [first, second, joint], named)

    def mesh(self, patch: Patch) -> gx.Mesh:
        """The mesh of a film."""
        made = patch.renumbered(self.transformation.numbering).placed(self.points)
        return mesh_of_arrays(self.comm, lambda: (made.points, made.triangles, made.groups))

    def line(self, points: Sequence[Sequence[float]], elements: int | Sequence[int]) -> gx.Mesh:
        """The mesh of a cable or beam through points [m]."""
        return line(self.comm, [self.point(point) for point in points], elements)

    def rigid_body(
        self, mass: float, inertia: Sequence[float], name: str, **options: Any
    ) -> gx.RigidBody:
        """A rigid body, with its axes along those of the written space; options in SI units."""
        return gx.RigidBody(
            self(mass, "kg"),
            [self(moment, "kg m²") for moment in inertia],
            position=self.point(options.get("position", (0.0, 0.0, 0.0))),
            attitude=self.rotation,
            velocity=self.vector(options.get("velocity", (0.0, 0.0, 0.0)), "m/s"),
            spin=self.vector(options.get("spin", (0.0, 0.0, 0.0)), "1/s"),
            comm=self.comm,
            name=name,
        )

    def point_mass(self, mass: float, position: Vector, velocity: Vector, name: str) -> Any:
        """A point mass, from numbers in SI units."""
        return gx.PointMass(
            self(mass, "kg"),
            self.point(position),
            velocity=self.vector(velocity, "m/s"),
            comm=self.comm,
            name=name,
        )

    def in_order(self, parts: Sequence[Any]) -> list[Any]:
        """The parts of a scene in the order of the transformation."""
        if self.transformation.order == 0:
            return list(parts)
        order = np.random.default_rng(self.transformation.order).permutation(len(parts))
        return [parts[k] for k in order]

    # ---- back to SI units and the written place --------------------------------------------------

    def _written(self, x: Array) -> Array:
        """Points (3, n) [m] of points (3, n) of the description."""
        return self.rotation.T @ (x * self.units.length - self._shift[:, None])

    def written_point(self, x: Array) -> Array:
        """The point (3,) [m] of a point of the description."""
        return self._written(x[:, None])[:, 0]

    def written_vector(self, v: Array, unit: str) -> Array:
        """The vector (3,) of one of the description."""
        return self.rotation.T @ v * self._size(unit)

    def written(self, value: float, unit: str) -> float:
        """The number in SI units of one of the description."""
        return value * self._size(unit)
