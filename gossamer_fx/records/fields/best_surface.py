"""The plane, paraboloid or sphere that fits a deformed film best: how accurate a surface is.

Sought are the parameters p of the surface with the least mean square distance of the film,

    rms² = Σ w_i d_i(p)² / Σ w_i,

over the nodes i of the film.  The weight w_i is a third of the areas of the deformed triangles at
the node; cells of order 2 are four triangles.  So nodes on a paraboloid have the distance zero,
though the triangles between them have not.

Distances are those across the surface.  With the coordinates x, y, z of a paraboloid's own axes, c
= 1/(4 f) and ρ² = x² + y²,

    plane       d = n·(x - x̄)
    sphere      d = |x - m| - R
    paraboloid  d = (z - c ρ²)/sqrt(1 + 4 c² ρ²)

of which the last one is right to first order of d/f.  The plane follows from the moments of the
film.  The others are found by Gauss and Newton's method: a rank adds what its nodes contribute to
the normal equations JᵀWJ Δp = -JᵀWd, at most 6 × 6, and no rank gathers a field.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rotations import rotations
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check, check_on_all
from gossamer_fx.core.mesh.linear_pieces import linear_pieces
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.core.model.state import HasSystem, State
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.body_shape import At

Surface = Literal["plane", "paraboloid", "sphere"]

Z_AXIS = (0.0, 0.0, 1.0)

# Ratio of principal moments below which the film is a line or a plane: its width over its length,
# or its height over its width, is below 1e-7.
DEGENERATE = 1e-14

# Newton's method ends where a step moves the surface by less than this share of the film's size,
# some ten times its round-off.
SMALLEST_STEP = 1e-14
MAX_ITERATIONS = 100
# Singular values of the normal equations, relative to the largest, that count as zero: distances
# from a shallow paraboloid hardly tell a turn from a shift, and round-off would decide.
NEGLIGIBLE = 1e-13


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
    radius: float

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
    axis: Vector = Z_AXIS,
    at: At = "end",
) -> BestSurface:
    """Find the plane, paraboloid or sphere that fits the deformed film best.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        film: a film of its scene.
        surface: "plane", "paraboloid" or "sphere".
        group: of cells of the film's mesh; empty: the whole film.
        axis: the designed axis, in either sense, from which the tilt is measured; the search for a
            paraboloid begins with it.  Where the focal length is above some thirty times the size
            of the film, a tilt cannot be told from a shift, and this axis stays.
        at: "end" of the last step, or "mean": the film in the middle of the step, where what
            alternates from step to step is left out.

    Raises:
        InputError: the film is not in the scene, the group has no cells, the axis is zero, the
            film has shrunk to a line or a point, or no paraboloid was found from this axis.

    Example:
        >>> bowl = gx.Membrane(
        ...     mesh, law, displacement=lambda X: np.vstack([0 * X[:2], X[0] ** 2 + X[1] ** 2])
        ... )
        >>> equilibrium = gx.Equilibrium(gx.Scene(bowl))
        >>> fit = gx.analysis.best_surface(equilibrium, bowl, surface="paraboloid")
        >>> round(fit.focal_length, 9), fit.rms < 1e-12
        (0.25, True)
    """
    samples = Samples.of(state, film, group, at)
    return fit_surface(samples, surface, axis)


@dataclass(frozen=True)
class Samples:
    """Points (n, 3) [m] of this rank on a surface and the areas (n,) [m²] for which they stand."""

    comm: MPI.Intracomm
    points: Array
    weights: Array

    @classmethod
    def of(cls, state: HasSystem, film: Membrane, group: str, at: At) -> Samples:
        """The corners of the triangles that this rank owns in a film, or in a group of its cells;
        a node occurs once for each of its triangles.  Collective."""
        system = state.system
        cells = cells_of(film, group)
        positions = system.state[film].local_positions()
        if at == "mean":
            before = State(system.bodies, system.comm, system.previous, system.v0)
            positions = (positions + before[film].local_positions()) / 2
        corners = positions[linear_pieces(film.full.space.dofmap.list[cells], 2)]
        sides = corners[:, 1:] - corners[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
        return cls(system.comm, corners.reshape(-1, 3), np.repeat(areas / 3, 3))

    def sum(self, values: Array) -> Array:
        """Sum of weights times values (n, ...) over the points of all ranks.  Collective."""
        own: Array = np.tensordot(self.weights, values, axes=1)
        total: Array = self.comm.allreduce(own)
        return total


def cells_of(film: Membrane, group: str) -> Array:
    """Numbers (n,) of the cells that this rank owns in a film, or in a group of its mesh."""
    # The cells of a reduced film are those of the film that was reduced.
    mesh = film.full.mesh
    owned = mesh.domain.topology.index_map(2).size_local
    if not group:
        return np.arange(owned)
    dimension, cells = mesh.group(group)
    kind = ("points", "curves", "triangles")[dimension]
    check(
        dimension == 2,
        f"The group '{group}' of '{film.name}' has no film: it is made of {kind}; "
        "give a group of triangles.",
    )
    return cells[cells < owned]


def fit_surface(samples: Samples, surface: Surface, axis: Vector = Z_AXIS) -> BestSurface:
    """The best surface of points; see `best_surface`.  Collective."""
    designed = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(designed))
    check(length > 0, "best_surface: the axis is zero; give the designed axis.")
    designed = designed / length
    area = float(samples.sum(np.ones(len(samples.points))))
    check_on_all(samples.comm, area > 0, "best_surface: the film has no area; it is a line.")
    centroid = samples.sum(samples.points) / area
    offsets = samples.points - centroid
    moments = samples.sum(offsets[:, :, None] * offsets[:, None, :]) / area
    squares, directions = np.linalg.eigh(moments)
    check_on_all(
        samples.comm,
        squares[1] > DEGENERATE * squares[2],
        "best_surface: the points lie on a line, on which no surface is best; give a film with "
        "a width.",
    )
    size = math.sqrt(float(squares.sum()))
    # Lengths over the size of the film, from its centroid, make the equations well scaled.
    scaled = Samples(samples.comm, offsets / size, samples.weights / area)
    is_flat = squares[0] <= DEGENERATE * squares[1]
    if surface == "plane" or is_flat:
        found = _Fitted(np.zeros(3), directions[:, 0], math.inf, scaled.points @ directions[:, 0])
    elif surface == "sphere":
        found = _sphere(scaled)
    else:
        found = _paraboloid(scaled, designed)

    direction = found.axis
    # A plane has no side: its normal is taken near the designed axis.
    if math.isinf(found.radius) and direction @ designed < 0:
        direction = -direction
    across = float(np.linalg.norm(np.cross(direction, designed)))
    distances = size * found.distances
    highest = samples.comm.allreduce(float(distances.max(initial=-np.inf)), op=MPI.MAX)
    lowest = samples.comm.allreduce(float(distances.min(initial=np.inf)), op=MPI.MIN)
    x, y, z = centroid + size * found.point
    return BestSurface(
        rms=math.sqrt(float(samples.sum(distances**2)) / area),
        peak_to_valley=highest - lowest,
        area=area,
        point=(float(x), float(y), float(z)),
        axis=(float(direction[0]), float(direction[1]), float(direction[2])),
        tilt=math.atan2(across, abs(float(direction @ designed))),
        radius=size * found.radius,
    )


@dataclass(frozen=True)
class _Fitted:
    """A surface in scaled coordinates, and the distances (n,) of this rank's points from it."""

    point: Array
    axis: Array
    radius: float
    distances: Array


def _sphere(samples: Samples) -> _Fitted:
    """The best sphere of scaled points."""
    x = samples.points
    # |x|² = 2 m·x + R² - |m|² is linear in m and the constant: a start near the best sphere.
    columns = np.column_stack([2 * x, np.ones(len(x))])
    normal = samples.sum(columns[:, :, None] * columns[:, None, :])
    right = samples.sum(columns * (x**2).sum(axis=1)[:, None])
    start = np.linalg.lstsq(normal, right, rcond=NEGLIGIBLE)[0]
    centre = start[:3]
    radius = math.sqrt(start[3] + float(centre @ centre))

    def distances_and_slopes() -> tuple[Array, Array]:
        away = x - centre
        distance = np.linalg.norm(away, axis=1)
        return distance - radius, np.column_stack([-away / distance[:, None], -np.ones(len(x))])

    def move(step: Array) -> None:
        nonlocal centre, radius
        centre = centre + step[:3]
        radius += float(step[3])

    distances = _least_squares(samples, distances_and_slopes, move, "sphere")
    # The centroid of the film is the origin.
    outwards = -centre / (float(np.linalg.norm(centre)) or 1.0)
    return _Fitted(centre, outwards, radius, distances)


def _paraboloid(samples: Samples, designed: Array) -> _Fitted:
    """The best paraboloid of scaled points, from the designed axis (3,) on."""
    # Rows are the paraboloid's own axes, the last one along its axis.
    third = np.eye(3)[np.argmin(np.abs(designed))]
    first = np.cross(designed, third)
    first /= np.linalg.norm(first)
    axes = np.array([first, np.cross(designed, first), designed])
    x, y, z = (samples.points @ axes.T).T
    # z = k + a x + b y + c (x² + y²) is linear in its numbers: a start near the best paraboloid.
    columns = np.column_stack([np.ones(len(x)), x, y, x**2 + y**2])
    normal = samples.sum(columns[:, :, None] * columns[:, None, :])
    k, a, b, c = np.linalg.lstsq(normal, samples.sum(columns * z[:, None]), rcond=NEGLIGIBLE)[0]
    check_on_all(
        samples.comm,
        bool(abs(c) > NEGLIGIBLE),
        "best_surface: the film does not curve along this axis; give the axis of the paraboloid.",
    )
    vertex = axes.T @ np.array([-a / (2 * c), -b / (2 * c), k - (a**2 + b**2) / (4 * c)])

    def distances_and_slopes() -> tuple[Array, Array]:
        own = (samples.points - vertex) @ axes.T
        squared_radius = (own[:, :2] ** 2).sum(axis=1)
        height = own[:, 2] - c * squared_radius
        slope = np.sqrt(1 + 4 * c**2 * squared_radius)
        # ∂d/∂(own coordinates), of the height and of the factor in front of it.
        by_point = np.column_stack([-2 * c * own[:, :2], np.ones(len(own))]) / slope[:, None]
        by_point[:, :2] -= (height * 4 * c**2 / slope**3)[:, None] * own[:, :2]
        by_curvature = -squared_radius / slope - height * 4 * c * squared_radius / slope**3
        # A turn δθ of the paraboloid moves points by -δθ × x in its own axes.
        by_turn = -np.cross(own, by_point)[:, :2]
        return height / slope, np.column_stack([-by_point, by_turn, by_curvature])

    def move(step: Array) -> None:
        nonlocal axes, vertex, c
        vertex = vertex + axes.T @ step[:3]
        turn = np.array([step[3], step[4], 0.0])
        angle = float(np.linalg.norm(turn))
        # A rotation by nothing has no axis.
        if angle > 0:
            axes = rotations(turn / angle, -angle) @ axes
        c += float(step[5])

    distances = _least_squares(samples, distances_and_slopes, move, "paraboloid")
    axis = math.copysign(1.0, c) * axes[2]
    return _Fitted(vertex, axis, float(1 / (2 * abs(c))), distances)


def _least_squares(
    samples: Samples,
    distances_and_slopes: Callable[[], tuple[Array, Array]],
    move: Callable[[Array], None],
    surface: str,
) -> Array:
    """Move a surface until the mean square of the distances is least; returns the distances (n,).

    Args:
        distances_and_slopes: distances (n,) of the points of this rank and their derivatives (n, p)
            by the p parameters of the surface.
        move: changes the parameters by a step (p,).
    """
    for _ in range(MAX_ITERATIONS):
        distances, slopes = distances_and_slopes()
        normal = samples.sum(slopes[:, :, None] * slopes[:, None, :])
        right = samples.sum(slopes * distances[:, None])
        step = -np.linalg.lstsq(normal, right, rcond=NEGLIGIBLE)[0]
        # How far the step moves the surface, as root of the mean square.
        moved = math.sqrt(max(float(step @ normal @ step), 0.0))
        if not math.isfinite(moved):
            break
        move(step)
        if moved <= SMALLEST_STEP:
            return distances_and_slopes()[0]
    raise InputError(
        f"best_surface: no {surface} was found in {MAX_ITERATIONS} iterations; give its axis, or "
        "ask for the plane."
    )
