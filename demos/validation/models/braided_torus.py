"""An inflated braided torus with cords that is pulled in by radial cables, started from its
measured shape.

At each of N stations two cables pull from the top and the bottom of the section to pulleys further
in. All are shortened by the same amount until their forces add up to the measured load.  Vertical
supports carry the section at some angles.

Prescribed forces would not do.  A ring of this bending stiffness buckles under forces that stay the
same at a small part of the measured load; the cables hold it.  In the measured shapes the
components n and 8 - n grow so that their sum at the eight stations stays: the cables are stiff
compared with the torus.

Wall: an orthotropic film that bears no compression.  Fibres at ±β with the shear stiffness G and a
small further stiffness E_L along the tube give, per width,

    A11 = G cot²β + E_L,    A12 = A66 = G,    A22 = G tan²β                                      (1)

Axial cords are bonded to the wall at any angles of the section; after inflation each has F_c, from
which it loses force on its unloading curve while the torus is pulled in (`TabulatedCable`; the
curve is "moved" or "scaled" to where F_c was reached). The stretches of the wall are those of a
straight tube, see `braided_tube`.

The shape of the torus under the first, small cable forces was measured.  The stress-free shape is
corrected until the computed shape under these forces is the measured one: with c the radius of the
centre line from which the stress-free film is made, r(c) that of the equilibrium, r_m the measured
one,

    c ← c + r_m - r(c)                                                                           (2)

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
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.braided_tube import Tube, cords_of, held_component
from gossamer_fx.extend import Item, PointForce, PointLoad, Port, State, Term, check, combine

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells_along": "1", "cells_around": "1", "second_pressure": "Pa"}

# Cells along the torus and around its section, of order 2, unless the inputs "cells_along" and
# "cells_around" are given.
CELLS = (96, 12)
QUICK_CELLS = (16, 6)

# Corrections (2) of the stress-free shape.
CORRECTIONS = 2
QUICK_CORRECTIONS = 1

# Increments of the shortening of the cables [m], the largest shortening, and increments of the
# pressure.
INCREMENT = 2e-3
QUICK_INCREMENT = 3e-3
LARGEST_SHORTENING = 0.2
PRESSURE_INCREMENTS = 6

# Parts of the largest load at which the mean radius is compared.
LOAD_FRACTIONS = (0.25, 0.5, 0.75, 1.0)

# Fourier components of the centre line that are compared.
WAVES = (3, 4, 5)

# Least angle [rad] between cords that are not on one line: so that cells are not slivers.
LEAST_ARC = math.radians(5) - 1e-9

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
        first_forces: (2 N,) [N] with which the shape was measured: lower cables by station, then
            upper ones.
        cable_stiffness: of each cable [N/m].
        largest_load: sum of the forces of all cables [N].
        cells: along the torus and around its section; None: as the form has them.
    """

    tube: Tube
    shape_angle: Array
    shape_radius: Array
    shape_height: Array
    station_angles: Array
    support_angles: Array
    pulleys: Array
    first_forces: Array
    cable_stiffness: float
    largest_load: float
    cells: tuple[int, int] | None

    @staticmethod
    def read(inputs: Inputs) -> Torus:
        """The torus of a case file."""
        β = inputs.number("braid_angle", "rad", above=0)
        check(
            β < math.pi / 2,
            f"{inputs.where}: braid_angle is {math.degrees(β):g} degrees from the axis; give one "
            "below 90.",
        )
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
            **cords_of(inputs),
            deflection=0.0,
        )
        tube.check_cords(inputs.where)
        shape = inputs.table("shape", "m", 2)
        count = len(shape)
        stations = inputs.numbers("station_angles", "rad")
        forces = inputs.numbers("first_forces", "N")
        # Cells around the section go from cord to cord.
        check(
            bool((arcs_between(tube.cord_angles)[1] > LEAST_ARC).all()),
            f"{inputs.where}: cord_angles are {np.rad2deg(tube.cord_angles).round(6).tolist()} "
            "degrees; give equal ones, or such that are 5 degrees apart.",
        )
        check(
            count >= 16 and len(forces) == 2 * len(stations),
            f"{inputs.where}: shape has {count} points and first_forces {len(forces)} numbers; "
            "give 16 points "
            f"at least, evenly spaced from the angle 0, and {2 * len(stations)} forces.",
        )
        pulleys = inputs.table("pulleys", "m", 2)
        largest_load = inputs.number("largest_load", "N", above=0)
        check(
            len(pulleys) == 2,
            f"{inputs.where}: pulleys has {len(pulleys)} rows; give radius and height of the lower "
            "and of the upper ones.",
        )
        check(
            largest_load > forces.sum(),
            f"{inputs.where}: largest_load is {largest_load:g} N; give one above the sum of "
            f"first_forces, {forces.sum():.4g} N.",
        )
        # Of the full or the quick form, unless the case has its own.
        cells = None
        if "cells_along" in inputs or "cells_around" in inputs:
            cells = inputs.whole("cells_along"), inputs.whole("cells_around")
            check(
                cells[0] % 16 == 0 and cells[1] >= 6,
                f"{inputs.where}: cells_along is {cells[0]} and cells_around {cells[1]}; give a "
                "multiple of 16, so that stations are on lines of the mesh, and 6 or more.",
            )
        return Torus(
            tube=tube,
            shape_angle=np.arange(count) * 2 * math.pi / count,
            shape_radius=shape[:, 0],
            shape_height=shape[:, 1],
            station_angles=stations,
            support_angles=inputs.numbers("support_angles", "rad"),
            pulleys=pulleys,
            first_forces=forces,
            cable_stiffness=inputs.number("cable_stiffness", "N/m", above=0),
            largest_load=largest_load,
            cells=cells,
        )

    def measured_line(self, angle: Array) -> Array:
        """Radius and height (n, 2) [m] of the measured centre line at angles (n,)."""
        # The line is closed: between the last measured point and the first one, too.
        period = 2 * math.pi
        radius = np.interp(
            angle,
            self.shape_angle,
            self.shape_radius,
            period=period,
        )
        height = np.interp(
            angle,
            self.shape_angle,
            self.shape_height,
            period=period,
        )
        return np.column_stack([radius, height])


# ---- mesh ----------------------------------------------------------------------------------------


def arcs_between(cord_angles: Array) -> tuple[Array, Array]:
    """Different angles (n,) of cords [rad], rising, and the arcs (n,) from each to the next one."""
    angles = np.unique(cord_angles.round(9))
    return angles, np.diff(angles, append=angles[0] + 2 * math.pi)


def section_angles(torus: Torus, around: int) -> Array:
    """Angles (2 n,) [rad] of the nodes of a section of n cells from its top outwards, the first at
    a cord.  Cells of nearly equal size go from cord to cord, about `around` of them in all."""
    angles = []
    for angle, arc in zip(*arcs_between(torus.tube.cord_angles), strict=True):
        cells = max(round(around * arc / (2 * math.pi)), 1)
        angles.append(angle + arc * np.arange(2 * cells) / (2 * cells))
    return np.concatenate(angles)


def section_parts(φ: Array) -> Array:
    """Parts (n,) of the perimeter, as an angle [rad], for which the nodes at φ (n,) stand."""
    after = np.diff(φ, append=φ[0] + 2 * math.pi)
    return (after + np.roll(after, 1)) / 2


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
        # Both directions are closed, and gmsh counts from 1.
        return int(number[i % along, k % around]) + 1

    def build(model: Any) -> None:
        film = model.addDiscreteEntity(2)
        model.mesh.addNodes(
            2,
            film,
            range(1, along * around + 1),
            points.ravel(),
        )
        triangles = []
        for i in range(0, along, 2):
            for k in range(0, around, 2):
                # Corners, then the middles of the edges between them, with normals outwards.
                triangles += [node(i, k), node(i + 2, k + 2), node(i + 2, k)]
                triangles += [node(i + 1, k + 1), node(i + 2, k + 1), node(i + 1, k)]
                triangles += [node(i, k), node(i, k + 2), node(i + 2, k + 2)]
                triangles += [node(i, k + 1), node(i + 1, k + 2), node(i + 1, k + 1)]
        # Kinds of elements in gmsh's numbering, this one and that of lines below.
        six_node_triangle = 9
        model.mesh.addElementsByType(
            film,
            six_node_triangle,
            [],
            triangles,
        )
        model.addPhysicalGroup(2, [film], name="film")
        three_node_line = 8
        for j, k in enumerate(cord_columns):
            cord = model.addDiscreteEntity(1)
            edges = []
            for i in range(0, along, 2):
                edges += [node(i, k), node(i + 2, k), node(i + 1, k)]
            model.mesh.addElementsByType(
                cord,
                three_node_line,
                [],
                edges,
            )
            model.addPhysicalGroup(1, [cord], name=f"cord {j}")

    return gx.gmsh_mesh(build, comm)


# ---- items of the scene --------------------------------------------------------------------------


class Cable(PointForce):
    """A cable from a point of the torus over a fixed pulley to an end that is drawn in by t [m].

    With the length ℓ from the point X to the pulley, and
    n the direction there, the force on the point is F = T n,

        T = T_0 + k (t + ℓ - ℓ_0),    dF/dX = -T/ℓ (1 - n nᵀ) - k n nᵀ                           (3)

    Until `hold` is called it is T_0 whatever the length.
    """

    depends_on_position_only = True

    def __init__(self, end: Port, pulley: Array, first_force: float, stiffness: float) -> None:
        self.end = end
        self._pulley = pulley
        self._first_force = first_force
        self._stiffness = stiffness
        self._first_length: float | None = None
        self._drawn = 0.0

    def hold(self, X: Array) -> None:
        """From now on the cable has its stiffness; its force is T_0 where the point is now."""
        self._first_length = float(np.linalg.norm(self._pulley - X))

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Take the shortening of the time at which forces act."""
        self._drawn = t + lag

    def tension(self, X: Array) -> float:
        """T [N]; a cable does not push."""
        if self._first_length is None:
            return self._first_force
        length = float(np.linalg.norm(self._pulley - X))
        shortening = self._drawn + length - self._first_length
        # Slack: the point came nearer to the pulley than the cable was drawn in.
        return max(self._first_force + self._stiffness * shortening, 0.0)

    def force(self, X: Array) -> Array:
        """The force (3,) [N]."""
        arm = self._pulley - X
        return self.tension(X) * arm / np.linalg.norm(arm)

    def tangent(self, X: Array) -> Array:
        """Its derivative (3, 3) [N/m]."""
        arm = self._pulley - X
        length = np.linalg.norm(arm)
        n = arm / length
        along = np.outer(n, n)
        tension = self.tension(X)
        # The first term turns the force with the cable, the second one stretches it.
        derivative = -tension / length * (np.eye(3) - along)
        if self._first_length is not None and tension > 0:
            derivative -= self._stiffness * along
        return derivative


class Cables(Item):
    """All cables as loads; the time is the shortening [m]."""

    def __init__(self, cables: list[Cable]) -> None:
        self.name = "cables"
        self._cables = cables

    def requires(self) -> Iterable[Any]:
        """The film."""
        yield self._cables[0].end.body

    def terms(self, start: State) -> Iterable[Term]:
        """A load for each cable."""
        for i, cable in enumerate(self._cables):
            yield PointLoad(
                f"cable {i + 1}",
                (cable.end,),
                cable,
            )


class Supports(Item):
    """Sections whose mean height is fixed."""

    def __init__(self, sections: list[Port]) -> None:
        self.name = "supports"
        self._sections = sections

    def requires(self) -> Iterable[Any]:
        """The film."""
        yield self._sections[0].body

    def terms(self, start: State) -> Iterable[Term]:
        """z - z_start = 0 for each section."""
        for i, section in enumerate(self._sections):
            height = float(start.vector(section)[2])
            yield held_component(f"support {i + 1}", section, 2, height)


# ---- the model -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Model:
    """The search for equilibria, the means (2 n,) of the sections, and the cables."""

    search: gx.Equilibrium
    sections: tuple[Port, ...]
    cables: list[Cable]

    def line(self) -> Array:
        """Radius and height (2 n, 2) [m] of the centre line."""
        state = self.search.system.unknowns.state
        centres = np.array([state.vector(section) for section in self.sections])
        return np.column_stack([np.hypot(centres[:, 0], centres[:, 1]), centres[:, 2]])

    def load(self) -> float:
        """Sum of the forces of all cables [N]."""
        state = self.search.system.unknowns.state
        return sum(cable.tension(state.vector(cable.end)) for cable in self.cables)

    def hold_cables(self) -> None:
        """Give the cables their stiffness at the present state."""
        state = self.search.system.unknowns.state
        for cable in self.cables:
            cable.hold(state.vector(cable.end))


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
    # The inflated film has the given line; the stretches of the wall lead to that without stress.
    stress_free = surface(line / λ_L, tube.radius / λ_H, φ)
    inflated = surface(line, tube.radius, φ)
    lines, _ = arcs_between(tube.cord_angles)
    columns = [int(np.argmin(np.abs(φ - angle))) for angle in lines]
    mesh = torus_mesh(comm, stress_free, columns)
    law = tube.wall(gx.materials.AroundAxis((0.0, 0.0, 1.0)))
    numbering = Numbering(stress_free)
    displacements = (inflated - stress_free).reshape(-1, 3)

    def inflate(X: Array) -> Array:
        return displacements[numbering.of(X)].T

    film = gx.Membrane(
        mesh,
        law,
        order=2,
        displacement=inflate,
        name="wall",
    )
    # Cords have their force F_c after inflation, when their edges are longer by λ_L.
    factor = λ_L / (1 + tube.cord_strain_after_inflation())
    cords = []
    for j, line_angle in enumerate(lines):
        count = int(np.isclose(tube.cord_angles, line_angle, atol=1e-8).sum())
        law_of_line = tube.cord_law(float(count))
        name = f"cord {j}"
        cords.append(
            gx.connectors.Tape.along_edges(
                film, law_of_line, edges=name, length_factor=factor, name=name
            )
        )
    nodes = numbering.global_nodes(film)
    parts = section_parts(φ)
    means = tuple(_mean(film, row, parts) for row in nodes)
    cables = _cables(torus, film, nodes, φ)
    supports = [means[_row(angle, len(means))] for angle in torus.support_angles]
    scene = gx.Scene(
        film,
        gx.Pressure(film, pressure),
        *cords,
        Cables(cables),
        Supports(supports),
    )
    return Model(gx.Equilibrium(scene), means, cables)


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
        # By position: dolfinx numbers nodes in another order than the surface.
        mine = (self.of(X.T), index_map.local_to_global(owned))
        table = np.zeros(self._shape[0] * self._shape[1], dtype=np.int64)
        # A few thousand numbers: sections and cables of a torus are spread over all ranks.
        for numbers, nodes in film.comm.allgather(mine):
            table[numbers] = nodes
        return table.reshape(self._shape)


def _mean(film: gx.Membrane, nodes: Array, weights: Array) -> Port:
    """A weighted mean of nodes of global numbers."""
    normed = tuple(map(float, weights / weights.sum()))
    return Port(
        film,
        tuple(int(node) for node in nodes),
        weights=normed,
    )


def _row(angle: float, count: int) -> int:
    """The section next to an angle [rad]."""
    return round(angle * count / (2 * math.pi)) % count


def _cables(torus: Torus, film: gx.Membrane, nodes: Array, φ: Array) -> list[Cable]:
    """Lower cables by station, then upper ones.

    A strap around the section takes the force of a cable to the film.  It is spread over the
    section with the weights 1 ± 2 cos φ, whose resultant acts at the bottom or the top, and along
    the torus over a minor radius to each side, falling linearly to zero: a force on a line would
    dent film of any mesh the deeper, the finer it is.
    """
    count = len(nodes)
    spacing = 2 * math.pi / count * torus.shape_radius.mean()
    reach = math.ceil(torus.tube.radius / spacing)
    offsets = np.arange(-reach, reach + 1)
    shares = np.maximum(1 - np.abs(offsets) * spacing / torus.tube.radius, 0.0)
    offsets = offsets[shares > 0]
    shares = shares[shares > 0] / shares.sum()
    cables: list[Cable] = []
    for side, (radius, height) in zip((-1.0, 1.0), torus.pulleys, strict=True):
        weights = section_parts(φ) * (1 + 2 * side * np.cos(φ))
        for angle in torus.station_angles:
            row = _row(angle, count)
            rings = [_mean(film, nodes[(row + k) % count], weights) for k in offsets]
            end = combine(shares.tolist(), rings)
            pulley = np.array([radius * math.cos(angle), radius * math.sin(angle), height])
            first_force = float(torus.first_forces[len(cables)])
            cables.append(Cable(end, pulley, first_force, torus.cable_stiffness))
    return cables


def corrected(
    torus: Torus, comm: MPI.Intracomm, cells: tuple[int, int], corrections: int
) -> tuple[Array, float]:
    """The centre line of the inflated film after some corrections (2).

    Returns:
        The line, and the largest difference [m] before the last correction.
    """
    along, around = cells
    angle = np.arange(2 * along) * math.pi / along
    target = torus.measured_line(angle)
    line = target.copy()
    remaining = math.inf
    for _ in range(corrections):
        model = build(
            torus,
            comm,
            line,
            around,
            torus.tube.pressure,
        )
        # At time zero cables have their first forces, with which the shape was measured.
        model.search.find(at=0.0)
        difference = (target - model.line())[:, 0]
        remaining = float(np.abs(difference).max())
        # Heights are those of the measurement: the supports hold them.
        line[:, 0] += difference
    return line, remaining


def amplitudes(radius: Array) -> Array:
    """Fourier amplitudes [m] of the radius (n,) of a centre line."""
    spectrum = 2 * np.abs(np.fft.rfft(radius)) / len(radius)
    return spectrum[list(WAVES)]


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Change of the mean radius and waves under the cables, or the growth of the radius with the
    pressure.

    With the input "second_pressure" the pressure goes to that, under the first forces of the
    cables.
    """
    torus = Torus.read(inputs)
    cells = CELLS
    corrections = CORRECTIONS
    increment = INCREMENT
    if quick:
        cells = QUICK_CELLS
        corrections = QUICK_CORRECTIONS
        increment = QUICK_INCREMENT
    if torus.cells is not None:
        cells = torus.cells
    line, remaining = corrected(
        torus,
        comm,
        cells,
        corrections,
    )
    if "second_pressure" in inputs:
        return _inflate_further(
            torus,
            inputs,
            comm,
            line,
            cells[1],
        )
    model = build(
        torus,
        comm,
        line,
        cells[1],
        torus.tube.pressure,
    )
    search = model.search
    effort = Effort()
    effort.add(search.find(at=0.0))
    # From here on the cables are drawn in: forces that stay the same would buckle the ring.
    model.hold_cables()
    loads = [model.load()]
    radii = [model.line()[:, 0]]
    shortening = 0.0
    while loads[-1] < torus.largest_load and shortening < LARGEST_SHORTENING:
        shortening += increment
        effort.add(search.find(at=shortening))
        loads.append(model.load())
        radii.append(model.line()[:, 0])
    wanted = torus.largest_load * np.array(LOAD_FRACTIONS)
    means = [radius.mean() for radius in radii]
    # A load that was not reached has no prediction.
    changes = np.interp(wanted, loads, means, right=math.nan) - means[0]
    # The shape at the largest load lies between the last two states.
    part = (torus.largest_load - loads[-2]) / (loads[-1] - loads[-2])
    last = radii[-2] + part * (radii[-1] - radii[-2])
    quantities = {
        "change of mean radius": Predicted(changes),
        "waves at the largest load": Predicted(amplitudes(last)),
    }
    details = {
        "unknowns": float(search.system.unknowns.numbering.size),
        "iterations": float(effort.iterations),
        "seconds": effort.seconds,
        "shortening": shortening,
        "difference_before_the_last_correction": remaining,
    }
    return Prediction(quantities, details)


def _inflate_further(
    torus: Torus, inputs: Inputs, comm: MPI.Intracomm, line: Array, around: int
) -> Prediction:
    """The growth of the mean radius from one pressure to another, under the first forces of the
    cables."""
    first = torus.tube.pressure
    second = inputs.number(
        "second_pressure",
        "Pa",
        above=first,
    )
    model = build(
        torus,
        comm,
        line,
        around,
        lambda t: first + t * (second - first),
    )
    # The cables have their first forces throughout, whatever their length.
    model.search.find(at=0.0)
    before = model.line()[:, 0].mean()
    for k in range(1, PRESSURE_INCREMENTS + 1):
        model.search.find(at=k / PRESSURE_INCREMENTS)
    growth = model.line()[:, 0].mean() - before
    return Prediction({"growth of the mean radius": Predicted(growth)})
