"""An inflated braided torus with cords that is pulled in by radial cables, started from its measured shape.

At each of N stations two cables pull from the top and the bottom of the section to pulleys further in.
Their forces are prescribed, those that were measured; they act along the line from the section to the
pulley.  Vertical supports carry the section at some angles.

Wall: an orthotropic film that bears no compression.  Fibres at ±β with the shear stiffness G and a
small further stiffness E_L along the tube give, per width,

    A11 = G cot²β + E_L,    A12 = A66 = G,    A22 = G tan²β                                       (1)

Two axial cords are bonded to the wall; after inflation each has F_c.  The stretches of the wall are those
of a straight tube, see `braided_tube`.

The shape of the torus under the first, small cable forces was measured.  The stress-free shape is
corrected until the computed shape under these forces is the measured one: with c the centre line from
which the stress-free film is made, x(c) that of the equilibrium, x_m the measured one,

    c ← c + x_m - x(c)                                                                            (2)

The rest is prediction: the mean radius and the Fourier amplitudes of the centre line under larger
forces, or under another pressure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.braided_tube import (
    AREAL_MASS,
    CORD_MASS,
    LARGEST_STRAIN,
    THICKNESS,
    Tube,
)
from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Port
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_constraints import PointConstraint
from gossamer_fx.terms.point_loads import PointLoad

# Cells along the torus and around its section, of order 2.
CELLS_ALONG = 64
CELLS_AROUND = 12
QUICK_CELLS_ALONG = 32
QUICK_CELLS_AROUND = 6

# Corrections (2) of the stress-free shape.
CORRECTIONS = 3
QUICK_CORRECTIONS = 1

# Increments of the cable forces, or of the pressure.
INCREMENTS = 8
QUICK_INCREMENTS = 4

# Fourier components of the centre line that are compared.
WAVES = (3, 4, 5)

Ring = tuple[Port, ...]


@dataclass(frozen=True)
class Torus:
    """The torus in SI units.

    Attributes:
        tube: the straight tube of the same section, wall and cords.
        shape_angle: of the measured points of the centre line [rad].
        shape_radius, shape_height: of these points [m].
        station_angles, support_angles: [rad].
        pulleys: radius and height of the pulleys (2, 2) of the lower and the upper cables [m].
        cable_forces: (m, 2 N) [N] in the course of the test: lower cables by station, then upper ones.
    """

    tube: Tube
    shape_angle: Array
    shape_radius: Array
    shape_height: Array
    station_angles: Array
    support_angles: Array
    pulleys: Array
    cable_forces: Array

    @staticmethod
    def read(inputs: Inputs) -> Torus:
        """The torus of a case file."""
        β = inputs.number("braid_angle", "rad", above=0)
        G = inputs.number("shear_stiffness", "N/m", above=0)
        E_L = inputs.number("axial_stiffness", "N/m", above=0)
        tangent_squared = math.tan(β) ** 2
        radius = inputs.number("minor_diameter", "m", above=0) / 2
        pressure = inputs.number("pressure", "Pa", above=0)
        tube = Tube(
            half_span=1.0,
            lever=0.0,
            load_at=0.0,
            radius=radius,
            pressure=pressure,
            stiffnesses=(G / tangent_squared + E_L, G, G * tangent_squared, G),
            cord_angles=np.mod(inputs.numbers("cord_angles", "rad"), 2 * math.pi),
            cord_force=inputs.number("cord_force", "N", above=0),
            cord_strain=inputs.numbers("cord_table_strain", "1"),
            cord_table=inputs.numbers("cord_table_force", "N"),
            cord_compression=inputs.number("cord_compression", "N", above=0),
            deflection=0.0,
        )
        shape = inputs.table("shape", "m", 2)
        count = len(shape)
        stations = inputs.numbers("station_angles", "rad")
        forces = inputs.table("cable_forces", "N", 2 * len(stations))
        between = (tube.cord_angles - tube.cord_angles[0]) / (math.pi / 3)
        check(
            bool(np.allclose(between, np.rint(between), atol=1e-9)),
            f"{inputs.where}: cord_angles differ by other angles than multiples of 60 degrees; give those.",
        )
        check(
            count >= 16 and len(forces) >= 2,
            f"{inputs.where}: shape has {count} points and cable_forces {len(forces)} rows; give 16 points, "
            "evenly spaced from the angle 0, and two rows at least.",
        )
        return Torus(
            tube=tube,
            shape_angle=np.arange(count) * 2 * math.pi / count,
            shape_radius=shape[:, 0],
            shape_height=shape[:, 1],
            station_angles=stations,
            support_angles=inputs.numbers("support_angles", "rad"),
            pulleys=inputs.table("pulleys", "m", 2),
            cable_forces=forces,
        )

    def measured_line(self, angle: Array) -> Array:
        """Radius and height (n, 2) [m] of the measured centre line at angles (n,)."""
        period = 2 * math.pi
        radius = np.interp(angle, self.shape_angle, self.shape_radius, period=period)
        height = np.interp(angle, self.shape_angle, self.shape_height, period=period)
        return np.column_stack([radius, height])


# ---- mesh ------------------------------------------------------------------------------------------


def section_angles(torus: Torus, around: int) -> Array:
    """Angles (2 around,) [rad] of the nodes of a section from its top outwards, the first at a cord."""
    return torus.tube.cord_angles[0] + np.arange(2 * around) * math.pi / around


def surface(line: Array, radius: float, φ: Array) -> Array:
    """Points (n, m, 3) of a tube around a centre line (n, 2) of radii and heights.

    The sections are in planes through the z axis; their angles φ (m,) are from the top outwards.
    """
    θ = np.arange(len(line)) * 2 * math.pi / len(line)
    out = line[:, :1] + radius * np.sin(φ)
    up = line[:, 1:] + radius * np.cos(φ)
    return np.stack([out * np.cos(θ)[:, None], out * np.sin(θ)[:, None], up], axis=-1)


def torus_mesh(comm: MPI.Intracomm, points: Array, cord_columns: list[int]) -> gx.Mesh:
    """Curved triangles of order 2 between points (2 n, 2 m, 3) of a torus, of n × m pairs of cells.

    Groups: "film", and "cord 0", "cord 1", ... along the torus at the given even columns.
    """
    along, around = points.shape[:2]
    number = np.arange(along * around).reshape(along, around)

    def node(i: int, k: int) -> int:
        return int(number[i % along, k % around]) + 1

    def build(model: Any) -> None:
        film = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, film, range(1, along * around + 1), points.ravel())
        triangles = []
        for i in range(0, along, 2):
            for k in range(0, around, 2):
                # Corners, then the middles of the edges between them, with normals outwards.
                triangles += [node(i, k), node(i + 2, k), node(i + 2, k + 2)]
                triangles += [node(i + 1, k), node(i + 2, k + 1), node(i + 1, k + 1)]
                triangles += [node(i, k), node(i + 2, k + 2), node(i, k + 2)]
                triangles += [node(i + 1, k + 1), node(i + 1, k + 2), node(i, k + 1)]
        six_node_triangle = 9
        model.mesh.addElementsByType(film, six_node_triangle, [], triangles)
        model.addPhysicalGroup(2, [film], name="film")
        three_node_line = 8
        for j, k in enumerate(cord_columns):
            cord = model.addDiscreteEntity(1)
            edges = []
            for i in range(0, along, 2):
                edges += [node(i, k), node(i + 2, k), node(i + 1, k)]
            model.mesh.addElementsByType(cord, three_node_line, [], edges)
            model.addPhysicalGroup(1, [cord], name=f"cord {j}")

    return gx.gmsh_mesh(build, comm)


# ---- parts of the scene ----------------------------------------------------------------------------


class Tension:
    """A force of given size on a point, towards a fixed pulley, in the course of the loading.

    It plays `terms.point_loads.PointForce`: F = T n with n the unit vector from the point X to the pulley,
    and dF/dX = -T/ℓ (1 - n nᵀ), ℓ their distance.
    """

    depends_on_position_only = True

    def __init__(self, pulley: Array, size: Callable[[float], float]) -> None:
        self._pulley = pulley
        self._size = size
        self._now = 0.0

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Take the size of the time at which forces act."""
        self._now = self._size(t + lag)

    def force(self, X: Array) -> Array:
        """The force (3,) [N]."""
        arm = self._pulley - X
        return self._now * arm / np.linalg.norm(arm)

    def tangent(self, X: Array) -> Array:
        """Its derivative (3, 3) [N/m]."""
        arm = self._pulley - X
        length = np.linalg.norm(arm)
        n = arm / length
        return -self._now / length * (np.eye(3) - np.outer(n, n))


class Cables:
    """All cables; the time is the row of the table of their forces."""

    def __init__(self, torus: Torus, ends: list[Port], pulleys: list[Array]) -> None:
        self.name = "cables"
        self._ends = ends
        self._pulleys = pulleys
        self._forces = torus.cable_forces

    def requires(self) -> Iterable[Any]:
        """The film."""
        yield self._ends[0].body

    def terms(self, start: State) -> Iterable[Term]:
        """A load for each cable."""
        rows = np.arange(len(self._forces))
        for i, (end, pulley) in enumerate(zip(self._ends, self._pulleys, strict=True)):
            column = self._forces[:, i]

            def size(t: float, column: Array = column) -> float:
                return float(np.interp(t, rows, column))

            yield PointLoad(f"cable {i + 1}", (end,), Tension(pulley, size))


class Supports:
    """Sections whose mean height is fixed."""

    def __init__(self, sections: list[Port]) -> None:
        self.name = "supports"
        self._sections = sections

    def requires(self) -> Iterable[Any]:
        """The film."""
        yield self._sections[0].body

    def terms(self, start: State) -> Iterable[Term]:
        """z - z_start = 0 for each section."""
        up = np.eye(3)[[2]]
        for i, section in enumerate(self._sections):
            height = float(start.vector(section)[2])
            measure = PointMeasure([(section,)], np.zeros((1, 3, 3)), up, np.array([-height]))
            yield PointConstraint(f"support {i + 1}", measure)


def combined(parts: list[tuple[float, Port]]) -> Port:
    """A linear combination of ports of one body."""
    nodes: list[int] = []
    weights: list[float] = []
    for factor, port in parts:
        nodes += port.nodes
        weights += [factor * weight for weight in port.weights]
    return Port(parts[0][1].body, tuple(nodes), weights=tuple(weights))


# ---- the model -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Model:
    """A scene, and the means (2 n,) of its sections."""

    search: gx.Equilibrium
    sections: tuple[Port, ...]

    def line(self) -> Array:
        """Radius and height (2 n, 2) [m] of the centre line."""
        state = self.search.system.state
        centres = np.array([state.vector(section) for section in self.sections])
        return np.column_stack([np.hypot(centres[:, 0], centres[:, 1]), centres[:, 2]])


def build(
    torus: Torus,
    comm: MPI.Intracomm,
    line: Array,
    around: int,
    pressure: Callable[[float], float] | float,
) -> Model:
    """The torus inflated around a centre line (2 n, 2), with its cables.

    Args:
        torus: the torus.
        comm: the communicator.
        line: radius and height of the centre line of the inflated film.
        around: cells around the section.
        pressure: [Pa], or as a function of time.
    """
    tube = torus.tube
    λ_L, λ_H = tube.stretches()
    φ = section_angles(torus, around)
    stress_free = surface(line / λ_L, tube.radius / λ_H, φ)
    inflated = surface(line, tube.radius, φ)
    columns = [round((angle - φ[0]) * around / math.pi) for angle in tube.cord_angles]
    mesh = torus_mesh(comm, stress_free, columns)
    A11, A12, A22, A66 = tube.stiffnesses
    law = gx.Orthotropic.from_stiffnesses(
        A11,
        A12,
        A22,
        A66,
        thickness=THICKNESS,
        density=AREAL_MASS / THICKNESS,
        direction=gx.materials.AroundAxis((0.0, 0.0, 1.0)),
    )
    numbering = Numbering(stress_free)
    displacements = (inflated - stress_free).reshape(-1, 3)

    def inflate(X: Array) -> Array:
        return displacements[numbering.of(X)].T

    film = gx.Membrane(mesh, law, order=2, displacement=inflate, name="wall")
    factor = λ_L / (1 + tube.cord_strain_after_inflation())
    strain = np.concatenate([[-LARGEST_STRAIN, 0.0], tube.cord_strain])
    force = np.concatenate([[-LARGEST_STRAIN * tube.cord_compression, 0.0], tube.cord_table])
    cord_law = gx.TabulatedCable(strain, force, line_density=CORD_MASS)
    cords = [
        gx.connectors.Tape.along_edges(
            film, cord_law, edges=f"cord {j}", length_factor=factor, name=f"cord {j}"
        )
        for j in range(len(columns))
    ]
    nodes = numbering.global_nodes(film)
    means = tuple(_mean(film, row, np.ones(len(row))) for row in nodes)
    ends, pulleys = _cable_ends(torus, film, nodes, np.cos(φ))
    supports = [means[_row(angle, len(means))] for angle in torus.support_angles]
    scene = gx.Scene(
        film,
        gx.Pressure(film, pressure),
        *cords,
        Cables(torus, ends, pulleys),
        Supports(supports),
    )
    return Model(gx.Equilibrium(scene), means)


class Numbering:
    """Which point of the regular surface (n, m, 3) a node of the film is."""

    def __init__(self, points: Array) -> None:
        from scipy.spatial import cKDTree

        self._shape = points.shape[:2]
        self._tree = cKDTree(points.reshape(-1, 3))

    def of(self, X: Array) -> Array:
        """Numbers (k,) of points (3, k)."""
        _, found = self._tree.query(X.T)
        return found

    def global_nodes(self, film: gx.Membrane) -> Array:
        """Global numbers (n, m) of the nodes of the film, on every rank.  Collective."""
        index_map = film.block.index_map
        owned = np.arange(index_map.size_local, dtype=np.int32)
        X = film.space.tabulate_dof_coordinates()[owned]
        mine = (self.of(X.T), index_map.local_to_global(owned))
        table = np.zeros(self._shape[0] * self._shape[1], dtype=np.int64)
        # A few thousand numbers: sections and cables of a torus are spread over all ranks.
        for numbers, nodes in film.comm.allgather(mine):
            table[numbers] = nodes
        return table.reshape(self._shape)


def _mean(film: gx.Membrane, nodes: Array, weights: Array) -> Port:
    """A weighted mean of nodes of global numbers."""
    normed = tuple(map(float, weights / weights.sum()))
    return Port(film, tuple(int(node) for node in nodes), weights=normed)


def _row(angle: float, count: int) -> int:
    """The section next to an angle [rad]."""
    return round(angle * count / (2 * math.pi)) % count


def _cable_ends(
    torus: Torus, film: gx.Membrane, nodes: Array, cosine: Array
) -> tuple[list[Port], list[Array]]:
    """Points at which cables pull, and their pulleys: lower cables by station, then upper ones.

    A strap around the section takes the force of a cable to the film.  It is spread over the section
    with the weights 1 ± 2 cos φ, whose resultant acts at the bottom or the top, and along the torus over
    the rows next to the station with the weights 1/4, 1/2, 1/4.
    """
    count = len(nodes)
    ends: list[Port] = []
    pulleys: list[Array] = []
    for side, (radius, height) in zip((-1.0, 1.0), torus.pulleys, strict=True):
        weights = 1 + 2 * side * cosine
        for angle in torus.station_angles:
            row = _row(angle, count)
            neighbours = ((0.25, row - 1), (0.5, row), (0.25, row + 1))
            parts = [(f, _mean(film, nodes[i % count], weights)) for f, i in neighbours]
            ends.append(combined(parts))
            pulleys.append(
                np.array([radius * math.cos(angle), radius * math.sin(angle), height])
            )
    return ends, pulleys


def corrected(torus: Torus, comm: MPI.Intracomm, quick: bool) -> tuple[Array, float]:
    """The centre line of the inflated film for which (2) holds, and the largest remaining difference [m]."""
    along = QUICK_CELLS_ALONG if quick else CELLS_ALONG
    around = QUICK_CELLS_AROUND if quick else CELLS_AROUND
    angle = np.arange(2 * along) * math.pi / along
    target = torus.measured_line(angle)
    line = target.copy()
    for _ in range(QUICK_CORRECTIONS if quick else CORRECTIONS):
        model = build(torus, comm, line, around, torus.tube.pressure)
        model.search.find(at=0.0)
        line = line + target - model.line()
    return line, float(np.abs(target - model.line()).max())


def amplitudes(line: Array) -> Array:
    """Fourier amplitudes [m] of the radius of a centre line."""
    spectrum = 2 * np.abs(np.fft.rfft(line[:, 0])) / len(line)
    return spectrum[list(WAVES)]


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Change of the mean radius and waves under the cables, or the growth of the radius with the pressure.

    With the input "second_pressure" the pressure goes to that, under the first forces of the cables.
    """
    torus = Torus.read(inputs)
    around = QUICK_CELLS_AROUND if quick else CELLS_AROUND
    increments = QUICK_INCREMENTS if quick else INCREMENTS
    line, remaining = corrected(torus, comm, quick)
    if "second_pressure" in inputs:
        return _inflate_further(torus, inputs, comm, line, around, increments)
    model = build(torus, comm, line, around, torus.tube.pressure)
    totals = torus.cable_forces.sum(axis=1)
    wanted = np.array([0.25, 0.5, 0.75, 1.0]) * totals.max()
    path = np.union1d(np.linspace(totals[0], totals.max(), increments + 1), wanted)
    radii = []
    iterations = 0
    seconds = 0.0
    for total in path:
        found = model.search.find(at=float(np.interp(total, totals, np.arange(len(totals)))))
        iterations += found.iterations
        seconds += found.seconds
        radii.append(model.line()[:, 0].mean())
    changes = np.interp(wanted, path, radii) - radii[0]
    quantities = {
        "change of mean radius": Predicted(changes),
        "waves at the largest load": Predicted(amplitudes(model.line())),
    }
    details = {
        "unknowns": float(model.search.system.numbering.size),
        "iterations": float(iterations),
        "seconds": seconds,
        "shape_difference": remaining,
    }
    return Prediction(quantities, details)


def _inflate_further(
    torus: Torus,
    inputs: Inputs,
    comm: MPI.Intracomm,
    line: Array,
    around: int,
    increments: int,
) -> Prediction:
    """The growth of the mean radius from one pressure to another."""
    first = torus.tube.pressure
    second = inputs.number("second_pressure", "Pa", above=first)
    # Its time is the fraction of the way; the cables stay at their first row.
    model = build(torus, comm, line, around, lambda t: first - t * (second - first))
    model.search.find(at=0.0)
    before = model.line()[:, 0].mean()
    for k in range(1, increments + 1):
        # Negative times: the rows of the cables begin at zero.
        model.search.find(at=-k / increments)
    growth = model.line()[:, 0].mean() - before
    return Prediction({"growth of the mean radius": Predicted(growth)})
