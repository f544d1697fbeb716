"""The plane, paraboloid or sphere that fits a deformed film best: how accurate a surface is.

Sought are the parameters p of the surface with the least mean square distance of the film,

    rms² = Σ w_i d_i(p)² / Σ w_i,

over the nodes i of the film.  The weight w_i is a third of the areas of the deformed triangles at
the node; cells of order 2 are four triangles.  So nodes on a paraboloid have the distance zero,
though the triangles between them have not.

Distances are those across the surface.  In coordinates (x, y, h) about the centroid of the film,
with h along an axis, a surface has the distances

    paraboloid  d = (h - k - a x - b y - c (x² + y²))/|(a + 2 c x, b + 2 c y, 1)|
    sphere      d = e/(1 + sqrt(1 - κ e)),  e = 2 g - κ (x² + y² + g²),  g = h - k               (1)

with c = 1/(4 f) and κ = 1/R; both are planes without curvature.  The first one is right to first
order of d/f, the second one is |x - m| - R without its round-off for large radii.  The plane
follows from the moments of the film.  The others, of which the axis turns, are found by Levenberg
and Marquardt's method from the polynomial that fits the heights best: a rank adds what its nodes
contribute to the normal equations JᵀWJ Δp = -JᵀWd, at most 6 × 6, and no rank gathers a field.  No
step increases the mean square.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal
from weakref import WeakSet

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rotations import perpendicular_pair, rotation_of
from gossamer_fx.core.checks.arguments import Direction, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.mesh.linear_pieces import linear_pieces
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.core.model.state import HasSystem, State
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.body_shape import At
from gossamer_fx.solve.system.system import System

Surface = Literal["plane", "paraboloid", "sphere"]

# What is asked of the best surface, by the names of `BestSurface`.
Quantity = Literal["rms", "peak_to_valley", "tilt", "radius", "focal_length"]

Z_AXIS = (0.0, 0.0, 1.0)

# Ratio of principal moments below which the film is a line or a plane: its width over its length,
# or its height over its width, is below 1e-7.
DEGENERATE = 1e-14

# The search ends where a step moves the surface by less than this share of the film's size, some
# ten times its round-off, or lowers the mean square by less than this share.
SMALLEST_STEP = 1e-14
SMALLEST_DECREASE = 1e-15
MAX_ITERATIONS = 200
# Root mean square over the size of the film, below which the film lies on the surface.
FLAT = 1e-12
# Factors of the diagonal of the normal equations that is added to them: at the start, and where no
# step lowers the mean square any more.
FIRST_DAMPING = 1e-3
LAST_DAMPING = 1e6
# Singular values of the normal equations, relative to the largest, that count as zero: distances
# from a shallow paraboloid hardly tell a turn of its axis from a slope a.
NEGLIGIBLE = 1e-13

# Tilt [rad] of a paraboloid, above which the film is hardly one about the designed axis.
USUAL_TILT = math.pi / 4

# Largest last step, over the size: a longer one is not that of a surface that is nearly found.
LARGEST_POLISH = 1e-3

# Change of the surface over its size in differences, whose error is of fourth order.
DIFFERENCE_STEP = 1e-3


LOG = logging.getLogger("gossamer_fx")

# Films whose tilt was warned of: a probe asks at each record.
_WARNED: WeakSet[Membrane] = WeakSet()


@check_arguments
@dataclass(frozen=True)
class BestSurface:
    """The plane, paraboloid or sphere that fits a film best.

    Attributes:
        rms: root mean square of the distances from it [m], by area.
        peak_to_valley: largest less smallest distance of a node [m].
        area: of the deformed film [m²].
        point: centroid of the film for a plane, vertex of a paraboloid, centre of a sphere, (3,)
            [m].
        axis: unit vector (3,): normal of a plane, axis of a paraboloid from its vertex to its
            focus, direction from the centre of a sphere to the centroid of the film.
        tilt: angle [rad] between this axis and the one that was asked for, 0 to π/2.
        radius: radius of the sphere [m], or radius of curvature 2 f at the vertex of a paraboloid;
            infinite for a plane.

    Example:
        >>> equilibrium = gx.Equilibrium(gx.Scene(film))
        >>> plane = gx.analysis.best_surface(equilibrium, film)
        >>> plane.rms < 1e-15, round(plane.area, 6), plane.tilt
        (True, 1.0, 0.0)
    """

    rms: float
    peak_to_valley: float
    area: float
    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    tilt: float
    radius: float = math.inf

    @property
    def focal_length(self) -> float:
        """Half of the radius of curvature [m]: of a paraboloid its focal length f, of a spherical
        mirror that of rays near the axis."""
        return self.radius / 2


@check_arguments
def best_surface(
    state: HasSystem,
    film: Membrane,
    *,
    surface: Surface = "plane",
    group: str = "",
    axis: Direction = Z_AXIS,
    at: At = "end",
) -> BestSurface:
    """Find the plane, paraboloid or sphere that fits the deformed film best.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        film: a film of its scene.
        surface: "plane", "paraboloid" or "sphere".
        group: of cells of the film's mesh; empty: the whole film.
        axis: the designed axis, in either sense, from which the tilt is measured; the search for a
            paraboloid begins with it and with the normal of the film.
        at: "end" of the last step, or "mean": the film in the middle of the step, where what
            alternates from step to step is left out.

    Raises:
        InputError: the film is not in the scene, the group has no cells, the axis is zero, or the
            film has shrunk to a line or a point.

    Example:
        >>> bowl = gx.Membrane(
        ...     mesh, law, displacement=lambda X: np.vstack([0 * X[:2], X[0] ** 2 + X[1] ** 2])
        ... )
        >>> equilibrium = gx.Equilibrium(gx.Scene(bowl))
        >>> fit = gx.analysis.best_surface(equilibrium, bowl, surface="paraboloid")
        >>> round(fit.focal_length, 9), fit.rms < 1e-12
        (0.25, True)
    """
    samples = Samples.of(state.system, film, group, at)
    found = fit_surface(samples, surface, axis)
    if surface == "paraboloid" and found.tilt > USUAL_TILT and film not in _WARNED:
        _WARNED.add(film)
        if state.system.comm.rank == 0:
            LOG.warning(
                "best_surface: the axis of the paraboloid that fits '%s' best is %.0f° from the "
                "one asked for, as of a saddle or of a film with waves: its focal length may jump "
                "from one fit to another; give surface='plane', or the designed axis.",
                film.name,
                math.degrees(found.tilt),
            )
    return found


@dataclass(frozen=True)
class Samples:
    """Points (n, 3) [m] of this rank on a surface and the areas (n,) [m²] for which they stand."""

    comm: MPI.Intracomm
    points: Array
    weights: Array

    @classmethod
    def of(cls, system: System, film: Membrane, group: str, at: At) -> Samples:
        """The corners of the triangles that this rank owns in a film, or in a group of its cells;
        a node occurs once for each of its triangles.  Collective."""
        cells = cells_of(film, group)
        positions = system.unknowns.state[film].local_positions()
        if at == "mean":
            before = State(
                system.unknowns.bodies, system.comm, system.unknowns.previous, system.unknowns.v0
            )
            positions = (positions + before[film].local_positions()) / 2
        corners = positions[linear_pieces(film.full.space.dofmap.list[cells], 2)]
        sides = corners[:, 1:] - corners[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
        return cls(system.comm, corners.reshape(-1, 3), np.repeat(areas / 3, 3))

    def sum(self, values: Array) -> Array:
        """Sum of weights times values (n, ...) over the points of all ranks.  Collective."""
        own: Array = np.tensordot(self.weights, values, axes=1)
        return self.comm.allreduce(own)


def cells_of(film: Membrane, group: str) -> Array:
    """Numbers (n,) of the cells that this rank owns in a film, or in a group of its mesh."""
    # The cells of a reduced film are those of the film that was reduced.
    mesh = film.full.mesh
    owned = mesh.domain.topology.index_map(2).size_local
    if not group:
        return np.arange(owned)
    dimension, cells = mesh.group(group, f"'{film.name}'")
    kind = ("points", "curves", "triangles")[dimension]
    check(
        dimension == 2,
        f"The group '{group}' of '{film.name}' has no film: it is made of {kind}; "
        "give a group of triangles.",
    )
    return cells[cells < owned]


def fit_surface(samples: Samples, surface: Surface, axis: Vector = Z_AXIS) -> BestSurface:
    """The best surface of points; see `best_surface`.  Collective.

    Args:
        axis: the designed axis, in either sense and of any length.
    """
    best = _best(samples, surface, axis)
    scaled, size, designed = best.scaled, best.size, best.designed
    distances, _, _ = best.distances_of(scaled.points, best.shape)
    point, direction, radius = best.shape.description(surface)
    # A plane has no side: its normal is taken near the designed axis.
    if math.isinf(radius) and direction @ designed < 0:
        direction = -direction
    highest = samples.comm.allreduce(float(distances.max(initial=-np.inf)), op=MPI.MAX)
    lowest = samples.comm.allreduce(float(distances.min(initial=np.inf)), op=MPI.MIN)
    x, y, z = best.centroid + size * point
    return BestSurface(
        rms=size * math.sqrt(float(scaled.sum(distances**2))),
        peak_to_valley=size * (highest - lowest),
        area=best.area,
        point=(float(x), float(y), float(z)),
        axis=(float(direction[0]), float(direction[1]), float(direction[2])),
        tilt=_tilt(best.shape, designed),
        radius=size * radius,
    )


def surface_slopes(
    samples: Samples, surface: Surface, quantity: Quantity, axis: Vector = Z_AXIS
) -> Array:
    """Derivatives (n, 3) of a quantity of the best surface by the points of this rank, three for
    each triangle, which change its area, too; [1], of the tilt [rad/m].  Collective.

    The surface is the best one: with its numbers θ and the distances d,

        F(θ, x) = Σ w d ∂d/∂θ = 0,    dJ/dx = ∂J/∂x + λ·∂F/∂x,    (∂F/∂θ)ᵀ λ = -∂J/∂θ           (2)

    The rms J has ∂J/∂θ = 0.  Second derivatives of d are differences of fourth order.
    """
    best = _best(samples, surface, axis)
    distances, by_point, _ = best.distances_of(best.scaled.points, best.shape)
    by_world = by_point @ best.shape.axes
    rms = math.sqrt(float(best.scaled.sum(distances**2)))
    check(
        rms > FLAT or quantity in ("radius", "focal_length", "tilt"),
        "SurfaceError: the film lies on the surface, where its error has no derivative; start from "
        "another shape.",
    )
    if quantity == "rms":
        # With W the area: ∂rms = Σ (w d ∂d + (d² - rms²) ∂w/2)/(rms W), w a third of an area.
        of_points = (best.scaled.weights * distances)[:, None] * by_world
        of_weights = (distances**2 - rms**2) / 2
        found: Array = (of_points + best.weight_slopes(samples, of_weights)) / rms
        return found
    by_x, by_numbers = _explicit_slopes(
        best, samples, surface, quantity, distances=distances, by_world=by_world
    )
    adjoint = -np.linalg.lstsq(_curvature(best), by_numbers, rcond=NEGLIGIBLE)[0]
    turned = _slopes(best, best.shape) @ adjoint
    by_x = by_x + best.scaled.weights[:, None] * (
        by_world * turned[:, None] + distances[:, None] * _change_of_normals(best, adjoint)
    )
    by_x += best.weight_slopes(samples, distances * turned)
    return by_x / best.size if quantity == "tilt" else by_x


def _explicit_slopes(
    best: _Best,
    samples: Samples,
    surface: Surface,
    quantity: Quantity,
    *,
    distances: Array,
    by_world: Array,
) -> tuple[Array, Array]:
    """∂J/∂x (n, 3) and ∂J/∂θ (m,) of a quantity over the size, see (2); of the tilt itself.
    Collective."""
    comm = best.scaled.comm
    by_x = np.zeros_like(by_world)
    if quantity == "peak_to_valley":
        slopes = _slopes(best, best.shape)
        by_numbers = np.zeros(slopes.shape[1])
        for sign, place in ((1.0, MPI.MAXLOC), (-1.0, MPI.MINLOC)):
            own = -sign * math.inf
            at = 0
            if len(distances):
                at = int(np.argmax(sign * distances))
                own = float(distances[at])
            _, rank = comm.allreduce((own, comm.rank), op=place)
            if comm.rank == rank:
                by_x[at] += sign * by_world[at]
                by_numbers += sign * slopes[at]
        return by_x, comm.allreduce(by_numbers)
    _, _, radius = best.shape.description(surface)
    if quantity == "tilt":
        tilt = _tilt(best.shape, best.designed)
        check(
            tilt > FLAT,
            "SurfaceError: the film is not tilted, where its tilt has no derivative; start from "
            "another shape.",
        )
        change = lambda step: np.array(_tilt(best.shape.moved(step), best.designed))  # noqa: E731
        number = len(_force(best, best.shape))
        if surface == "sphere":
            # Its axis ends in the centroid of the film, which moves with the points.
            centre, _, _ = best.shape.description(surface)
            of_centroid = lambda move: np.array(  # noqa: E731
                _angle(move - centre, best.designed)
            )
            by_centroid = np.array([_difference(of_centroid, unit) for unit in np.eye(3)])
            by_x = by_x + best.scaled.weights[:, None] * by_centroid
            by_x += best.weight_slopes(samples, best.scaled.points @ by_centroid)
        return by_x, np.array([_difference(change, unit) for unit in np.eye(number)])
    check(
        math.isfinite(radius),
        f"SurfaceError: the film has no curvature, so that its {quantity} has no derivative; start "
        "from another shape, or take the rms.",
    )
    curvature = float(best.shape.numbers[-1])
    by_numbers = np.zeros(2 + len(best.shape.numbers))
    by_numbers[-1] = -radius / curvature
    if quantity == "focal_length":
        by_numbers /= 2
    return by_x, by_numbers


def _tilt(shape: _Shape, designed: Array) -> float:
    """Angle [rad] between the axis of a surface and the designed one, 0 to π/2."""
    return _angle(shape.axes[2], designed)


def _angle(direction: Array, designed: Array) -> float:
    """Angle [rad] between the lines along two vectors, 0 to π/2."""
    across = float(np.linalg.norm(np.cross(direction, designed)))
    return math.atan2(across, abs(float(direction @ designed)))


def _slopes(best: _Best, shape: _Shape) -> Array:
    """∂d/∂θ (n, m) of the points by two turns and the numbers of a surface."""
    points = best.scaled.points
    _, by_point, by_numbers = best.distances_of(points, shape)
    return _by_surface(points, shape, by_point, by_numbers)


def _curvature(best: _Best) -> Array:
    """∂F/∂θ (m, m) of (2).  Collective."""

    number = len(_force(best, best.shape))
    forces = lambda step: _force(best, best.shape.moved(step))  # noqa: E731
    return np.array([_difference(forces, unit) for unit in np.eye(number)])


def _force(best: _Best, shape: _Shape) -> Array:
    """F (m,) of (2) at a surface near the best one.  Collective."""
    distances, _, _ = best.distances_of(best.scaled.points, shape)
    return best.scaled.sum(_slopes(best, shape) * distances[:, None])


def _change_of_normals(best: _Best, direction: Array) -> Array:
    """Derivative (n, 3) of ∂d/∂x along a change (m,) of the surface."""

    def normals(step: Array) -> Array:
        shape = best.shape.moved(step)
        _, by_point, _ = best.distances_of(best.scaled.points, shape)
        found: Array = by_point @ shape.axes
        return found

    return _difference(normals, direction)


def _difference(function: Callable[[Array], Array], direction: Array) -> Array:
    """Derivative of a function at zero along a direction, by a difference of fourth order."""
    length = float(np.linalg.norm(direction))
    if length == 0:
        return np.zeros_like(function(direction))
    step = DIFFERENCE_STEP / length * direction
    near = function(step) - function(-step)
    far = function(2 * step) - function(-2 * step)
    found: Array = (8 * near - far) * length / (12 * DIFFERENCE_STEP)
    return found


@dataclass(frozen=True)
class _Best:
    """The best surface in coordinates about the centroid of the points over their size.

    Attributes:
        centroid: of the points (3,) [m].
        size: root of their mean square distance from it [m].
        area: for which they stand [m²].
        designed: unit vector of the designed axis (3,).
        scaled: the points over the size, with weights of the sum one.
        shape: the surface.
        distances_of: of points and a surface.
    """

    centroid: Array
    size: float
    area: float
    designed: Array
    scaled: Samples
    shape: _Shape
    distances_of: _Distances

    def weight_slopes(self, samples: Samples, values: Array) -> Array:
        """Derivative (n, 3) of Σ w v, times the size, by the points that change areas; v (n,)."""
        corners = samples.points.reshape(-1, 3, 3)
        opposite = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # A weight is a third of the area of its triangle.
        of_triangles = values.reshape(-1, 3).sum(axis=1) / 3
        slopes = np.cross(opposite, normals[:, None]) / 2 * of_triangles[:, None, None]
        return slopes.reshape(-1, 3) * self.size / self.area


def _best(samples: Samples, surface: Surface, axis: Vector) -> _Best:
    """The best surface of points, see `fit_surface`.  Collective."""
    designed = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(designed))
    designed = designed / length
    on_a_line = (
        "best_surface: the points lie on a line, on which no surface is best; give a film with a "
        "width."
    )
    area = float(samples.sum(np.ones(len(samples.points))))
    check(area > 0, on_a_line)
    centroid = samples.sum(samples.points) / area
    offsets = samples.points - centroid
    moments = samples.sum(offsets[:, :, None] * offsets[:, None, :]) / area
    squares, directions = np.linalg.eigh(moments)
    check(squares[1] > DEGENERATE * squares[2], on_a_line)
    size = math.sqrt(float(squares.sum()))
    # Lengths over the size of the film, from its centroid, make the equations well scaled.
    scaled = Samples(samples.comm, offsets / size, samples.weights / area)
    normal = directions[:, 0]
    shape = _Shape(_axes_along(normal), np.zeros(2))
    distances_of: _Distances = _from_plane
    if surface != "plane" and squares[0] > DEGENERATE * squares[1]:
        distances_of = {"sphere": _from_sphere, "paraboloid": _from_paraboloid}[surface]
        minima = [
            _least_squares(scaled, _start(scaled, start_axis, surface), distances_of)
            # From a wrong axis the search may end in another minimum.  The designed one is that of
            # a part next to the vertex, the normal that of a shallow dish.
            for start_axis in (designed, normal)
        ]
        shape = min(minima, key=lambda one: one.mean_square(scaled, distances_of))
    best = _Best(centroid, size, area, designed, scaled, shape, distances_of)
    if distances_of is _from_plane:
        return best
    # The mean square hardly depends on the last half of the digits of the surface, on which its
    # radius and its derivatives do: one step of Newton's method finds them.
    step = -np.linalg.lstsq(_curvature(best), _force(best, shape), rcond=NEGLIGIBLE)[0]
    polished = shape.moved(step)
    is_near = float(np.linalg.norm(step)) < LARGEST_POLISH
    return replace(best, shape=polished) if is_near else best


# Of points (n, 3) and a surface: distances (n,), and their derivatives by the coordinates of the
# points in its axes (n, 3) and by its numbers (n, m)
_Distances = Callable[[Array, "_Shape"], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class _Shape:
    """A surface in scaled coordinates, see (1): its axes (3, 3) as rows, the last one that of h,
    and its numbers, (k, a, b, c) of a paraboloid or (k, κ) of a sphere."""

    axes: Array
    numbers: Array

    def moved(self, step: Array) -> _Shape:
        """The surface after a turn (2,) about its first two axes and changes of its numbers."""
        turn = np.array([step[0], step[1], 0.0])
        # A plane has no numbers that move.
        numbers = self.numbers.copy()
        numbers[: len(step) - 2] += step[2:]
        return _Shape(rotation_of(-turn) @ self.axes, numbers)

    def description(self, surface: Surface) -> tuple[Array, Array, float]:
        """Vertex of a paraboloid or centre of a sphere (3,), its axis (3,), and its radius of
        curvature, see `BestSurface`; without curvature the centroid and the normal."""
        direction = self.axes[2]
        curvature = float(self.numbers[-1])
        if curvature == 0:
            return np.zeros(3), direction, math.inf
        if surface == "sphere":
            centre = direction * (self.numbers[0] + 1 / curvature)
            # The centroid of the film is the origin.
            outwards = -centre / (float(np.linalg.norm(centre)) or 1.0)
            return centre, outwards, 1 / abs(curvature)
        k, a, b, c = self.numbers
        vertex = np.array([-a / (2 * c), -b / (2 * c), k - (a**2 + b**2) / (4 * c)])
        return self.axes.T @ vertex, math.copysign(1.0, c) * direction, 1 / (2 * abs(curvature))

    def mean_square(self, samples: Samples, distances_of: _Distances) -> float:
        """Mean square of the distances of points.  Collective."""
        distances, _, _ = distances_of(samples.points, self)
        return float(samples.sum(distances**2))


def _from_plane(points: Array, shape: _Shape) -> tuple[Array, Array, Array]:
    """Distances of n points from the plane through the origin, see `_Distances`."""
    by_point = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    return points @ shape.axes[2], by_point, np.zeros((len(points), 0))


def _from_paraboloid(points: Array, shape: _Shape) -> tuple[Array, Array, Array]:
    """Distances (1) of n points from a paraboloid, and their derivatives, see `_Distances`."""
    k, a, b, c = shape.numbers
    x, y, h = shape.axes @ points.T
    height = h - k - a * x - b * y - c * (x**2 + y**2)
    slope_x = a + 2 * c * x
    slope_y = b + 2 * c * y
    length = np.sqrt(1 + slope_x**2 + slope_y**2)
    # d = height/length, hence ∂d = ∂height/length - stretch (slope·∂slope).
    stretch = height / length**3
    by_point = np.column_stack(
        [
            -slope_x / length - stretch * slope_x * 2 * c,
            -slope_y / length - stretch * slope_y * 2 * c,
            1 / length,
        ]
    )
    by_numbers = np.column_stack(
        [
            -1 / length,
            -x / length - stretch * slope_x,
            -y / length - stretch * slope_y,
            -(x**2 + y**2) / length - stretch * 2 * (slope_x * x + slope_y * y),
        ]
    )
    return height / length, by_point, by_numbers


def _from_sphere(points: Array, shape: _Shape) -> tuple[Array, Array, Array]:
    """Distances (1) of n points from a sphere, and their derivatives, see `_Distances`."""
    k, curvature = shape.numbers
    own = points @ shape.axes.T - np.array([0.0, 0.0, k])
    squared_distance = (own**2).sum(axis=1)
    numerator = 2 * own[:, 2] - curvature * squared_distance
    # Distance from the centre over the radius; not zero, where its direction is not defined.
    ratio = np.sqrt(np.maximum(1 - curvature * numerator, np.finfo(float).tiny))
    distances = numerator / (1 + ratio)
    by_point = (np.array([0.0, 0.0, 1.0]) - curvature * own) / ratio[:, None]
    ratio_by_curvature = (curvature * squared_distance - own[:, 2]) / ratio
    by_curvature = -(squared_distance + distances * ratio_by_curvature) / (1 + ratio)
    return distances, by_point, np.column_stack([-by_point[:, 2], by_curvature])


def _by_surface(points: Array, shape: _Shape, by_point: Array, by_numbers: Array) -> Array:
    """Derivatives (n, m) of distances by two turns and the numbers of a surface."""
    # A turn δθ of the surface moves points by -δθ × x in its axes.
    by_turn = -np.cross(points @ shape.axes.T, by_point)[:, :2]
    return np.column_stack([by_turn, by_numbers])


def _axes_along(axis: Array) -> Array:
    """Right-handed orthonormal axes (3, 3) as rows, the last one a unit vector (3,)."""
    return np.array([*perpendicular_pair(axis), axis])


def _start(samples: Samples, axis: Array, surface: Surface) -> _Shape:
    """The surface with an axis (3,) whose heights fit those of the points best.  Collective."""
    axes = _axes_along(axis)
    x, y, h = axes @ samples.points.T
    columns = np.column_stack([np.ones(len(x)), x, y, x**2 + y**2])
    # The normal equations of the polynomial k + a x + b y + c (x² + y²).
    matrix = samples.sum(columns[:, :, None] * columns[:, None, :])
    right = samples.sum(columns * h[:, None])
    k, a, b, c = np.linalg.lstsq(matrix, right, rcond=NEGLIGIBLE)[0]
    if surface == "paraboloid":
        return _Shape(axes, np.array([k, a, b, c]))
    # A sphere has no slopes at the centroid: its axis is normal there.
    slope = math.sqrt(1 + a**2 + b**2)
    tilted = axes.T @ np.array([-a, -b, 1.0]) / slope
    return _Shape(_axes_along(tilted), np.array([k / slope, 2 * c / slope**3]))


def _least_squares(samples: Samples, start: _Shape, distances_of: _Distances) -> _Shape:
    """The surface near a start with the least mean square of the distances.  Collective."""
    shape = start
    mean_square = shape.mean_square(samples, distances_of)
    damping = FIRST_DAMPING
    for _ in range(MAX_ITERATIONS):
        distances, by_point, by_numbers = distances_of(samples.points, shape)
        slopes = _by_surface(samples.points, shape, by_point, by_numbers)
        matrix = samples.sum(slopes[:, :, None] * slopes[:, None, :])
        right = samples.sum(slopes * distances[:, None])
        damped = matrix + damping * np.diag(np.diag(matrix))
        step = -np.linalg.lstsq(damped, right, rcond=NEGLIGIBLE)[0]
        trial = shape.moved(step)
        lowered = trial.mean_square(samples, distances_of)
        # Written so that NaN does not count as a decrease.
        if not lowered < mean_square:
            damping *= 10
            if damping > LAST_DAMPING:
                break
            continue
        decrease = mean_square - lowered
        shape = trial
        mean_square = lowered
        damping /= 10
        # How far the step moved the surface, as root of the mean square.
        moved = math.sqrt(max(float(step @ matrix @ step), 0.0))
        if moved <= SMALLEST_STEP or decrease <= SMALLEST_DECREASE * mean_square:
            break
    return shape
