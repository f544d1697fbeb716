"""A straight inflated braided tube with axial cords in four-point bending.

The tube has closed, rigid ends, each on a lever that points down from its axis and whose foot rolls
along x; two equal vertical loads lower it.  Wall: an orthotropic film that bears no compression,
with the stiffnesses of the inflated braid.  Cords: tabulated force against strain, bonded to the
wall along its whole length.  The pressure is constant.

The diameter D of the input is that of the inflated tube.  The stress-free tube is smaller: with the
stretches λ_L along and λ_H around it, E = (λ² - 1)/2 and S = A E,

    λ_L/λ_H S_L = (p π r² - Σ F_c)/(2π r),    λ_H/λ_L S_H = p r,    r = D/2                      (1)

are solved for both.  The cords get the natural length at which their force is F_c in this state.
It is the state in which the test begins, so that deflections are counted from it.

A quarter is modelled: half of the length (x ≥ 0) and of the section (y ≥ 0).  Films of order 2.
The ends keep the section that they have after inflation.  A load is a vertical dead load, uniform
on a band around the tube, so that the film is not crushed; the mean deflection of the band is
prescribed step by step, and the load is its reaction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from mpi4py import MPI
from scipy.optimize import fsolve

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import (
    Item,
    PointConstraint,
    PointMeasure,
    Port,
    State,
    Term,
    check,
    geometry_nodes,
)
from gossamer_fx.mechanics.bodies.rigid_body import RigidPiece
from gossamer_fx.meshes.arrays import cell_corners, mesh_of_arrays, polyline, triangles_of

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells_around": "1"}

# Cells over half of the section in the full and the quick form, unless the input "cells_around" is
# given.  With 18 of them results change by less than 0.2 %.
CELLS_AROUND = 12
QUICK_CELLS_AROUND = 6
# Length of a cell over its width.
CELL_ASPECT = 2.0

# Angle [rad] between lines of the mesh on which a cord may lie.
CORD_SPACING = math.pi / 6

# Width of a loaded band over the diameter of the tube.
BAND_WIDTH = 0.5

# Steps of the deflection of the bands [m].
STEP = 5e-3
QUICK_STEP = 20e-3

# Deflection [m] of midspan at which the initial stiffness is compared.
INITIAL_DEFLECTION = 0.01

# Mass per area [kg/m²] and per length [kg/m]: they only pace the pseudo-time of the equilibria.
AREAL_MASS = 0.4
CORD_MASS = 0.02
# Thickness [m] that splits stiffnesses per width into moduli; results do not depend on it.
THICKNESS = 1e-3

# Direction along the tube in each part of the mesh; the end is a plate in which none is special.
AXIAL = {"wall": (1.0, 0.0, 0.0), "band": (1.0, 0.0, 0.0), "cap": (0.0, 0.0, 1.0)}

# Cord tables end at a force; beyond it the last slope of the source holds.  Strain to which it is
# drawn.
LARGEST_STRAIN = 0.05


@dataclass(frozen=True)
class Tube:
    """The tube in SI units.

    Attributes:
        half_span: from midspan to a support, where the tube ends.
        lever: from the axis down to the foot of a support.
        load_at: distance of a load from midspan.
        radius: of the inflated tube.
        pressure: held.
        stiffnesses: A11, A12, A22, A66 of the wall [N/m]; 1 along, 2 around the tube.
        cord_angles: from the top [rad].
        cord_force: of each cord after inflation [N].
        cord_strain, cord_table: strain and force of a cord.
        cord_unloading: strain and force of a cord that unloads; None: as it is loaded.
        cord_unloading_rule: how this curve is brought to a reversal, see `TabulatedCable`.
        cord_compression: force per strain of a cord in compression [N].
        deflection: of midspan up to which the test is followed.
    """

    half_span: float
    lever: float
    load_at: float
    radius: float
    pressure: float
    stiffnesses: tuple[float, float, float, float]
    cord_angles: Array
    cord_force: float
    cord_strain: Array
    cord_table: Array
    cord_unloading: tuple[Array, Array] | None
    cord_unloading_rule: Literal["moved", "scaled"]
    cord_compression: float
    deflection: float

    @staticmethod
    def read(inputs: Inputs) -> Tube:
        """The tube of a case file."""
        names = ("A11", "A12", "A22", "A66")
        A11, A12, A22, A66 = (inputs.number(name, "N/m", above=0) for name in names)
        tube = Tube(
            half_span=inputs.number("half_span", "m", above=0),
            lever=inputs.number("lever", "m"),
            load_at=inputs.number("load_at", "m", above=0),
            radius=inputs.number("diameter", "m", above=0) / 2,
            pressure=inputs.number("pressure", "Pa", above=0),
            stiffnesses=(A11, A12, A22, A66),
            **cords_of(inputs),
            deflection=inputs.number("deflection", "m", above=0),
        )
        tube.check_angles(inputs.where)
        tube.check_cords(inputs.where)
        check(
            tube.deflection < tube.half_span,
            f"{inputs.where}: deflection is {tube.deflection:g} m; give one below half_span, "
            f"{tube.half_span:g} m.",
        )
        band_end = tube.load_at + BAND_WIDTH * tube.radius
        check(
            tube.radius < tube.load_at and band_end < tube.half_span,
            f"{inputs.where}: load_at is {tube.load_at:g} m; let it be beyond the radius and "
            "before the end of the tube.",
        )
        return tube

    def check_angles(self, where: str) -> None:
        """Check that cords are on lines of every mesh, and symmetric about the vertical plane."""
        lines = self.cord_angles / CORD_SPACING
        degrees = np.rad2deg(self.cord_angles).round(6).tolist()
        mirrored = np.mod(-self.cord_angles, 2 * math.pi)
        is_symmetric = np.allclose(
            np.sort(self.cord_angles),
            np.sort(mirrored),
            atol=1e-9,
        )
        check(
            bool(np.allclose(lines, np.rint(lines), atol=1e-9)) and is_symmetric,
            f"{where}: cord_angles are {degrees} degrees from the top; give multiples of 30 that "
            "are symmetric about the vertical plane.",
        )

    def check_cords(self, where: str) -> None:
        """Check the table of the cords, and that the wall bears a part of the pressure's axial
        force: film bears no compression."""
        strains = len(self.cord_strain)
        forces = len(self.cord_table)
        check(
            strains == forces > 1,
            f"{where}: cord_table_strain has {strains} values and cord_table_force {forces}; give "
            "as many, two at least.",
        )
        end_force = self.pressure * math.pi * self.radius**2
        check(
            len(self.cord_angles) * self.cord_force < end_force,
            f"{where}: cord_force is {self.cord_force:g} N for each of {len(self.cord_angles)} "
            "cords; the pressure "
            f"pulls with {end_force:.4g} N only, so give a smaller force.",
        )

    def stretches(self) -> tuple[float, float]:
        """λ_L and λ_H of the inflated tube, equations (1) of the module."""
        A11, A12, A22, _ = self.stiffnesses
        r = self.radius
        cords = len(self.cord_angles) * self.cord_force
        N_L = (self.pressure * math.pi * r**2 - cords) / (2 * math.pi * r)
        return inflated_stretches((A11, A12, A22), N_L, self.pressure * r)

    def wall(self, direction: Any) -> gx.Orthotropic:
        """The law of the wall, whose first axis is along the tube."""
        A11, A12, A22, A66 = self.stiffnesses
        return gx.Orthotropic.from_stiffnesses(
            A11,
            A12,
            A22,
            A66,
            thickness=THICKNESS,
            density=AREAL_MASS / THICKNESS,
            direction=direction,
        )

    def cord_law(self, share: float) -> gx.TabulatedCable:
        """The law of a share of a cord: one on the plane of symmetry counts half, two on one line
        are 2."""
        strain = np.concatenate([[-LARGEST_STRAIN, 0.0], self.cord_strain])
        force = np.concatenate([[-LARGEST_STRAIN * self.cord_compression, 0.0], self.cord_table])
        unloading = None
        if self.cord_unloading is not None:
            unloading_strain, unloading_force = self.cord_unloading
            unloading = np.append(0.0, unloading_strain), share * np.append(0.0, unloading_force)
        return gx.TabulatedCable(
            strain,
            share * force,
            line_density=CORD_MASS,
            unloading=unloading,
            unloading_rule=self.cord_unloading_rule,
        )

    def cord_strain_after_inflation(self) -> float:
        """The strain at which a cord has its force after inflation."""
        strain = np.concatenate([[0.0], self.cord_strain])
        force = np.concatenate([[0.0], self.cord_table])
        return float(np.interp(self.cord_force, force, strain))


def inflated_stretches(
    stiffnesses: tuple[float, float, float], N_L: float, N_H: float
) -> tuple[float, float]:
    """Stretches along and around a tube whose wall of stiffnesses A11, A12, A22 [N/m] bears the
    forces N_L and N_H per width [N/m] of the inflated tube."""
    A11, A12, A22 = stiffnesses

    def excess(stretches: Array) -> Array:
        λ_L, λ_H = stretches
        E_L = (λ_L**2 - 1) / 2
        E_H = (λ_H**2 - 1) / 2
        S_L = A11 * E_L + A12 * E_H
        S_H = A12 * E_L + A22 * E_H
        return np.array([λ_L / λ_H * S_L - N_L, λ_H / λ_L * S_H - N_H]) / N_H

    λ_L, λ_H = fsolve(excess, [1.0, 1.0], xtol=1e-13)
    return float(λ_L), float(λ_H)


def cords_of(inputs: Inputs) -> dict[str, Any]:
    """The cords of a case file, as `Tube` takes them."""
    unloading = None
    rule = "moved"
    if "cord_unloading_strain" in inputs:
        strain = inputs.numbers("cord_unloading_strain", "1")
        force = inputs.numbers("cord_unloading_force", "N")
        check(
            len(strain) == len(force) > 1,
            f"{inputs.where}: cord_unloading_strain has {len(strain)} values and "
            f"cord_unloading_force {len(force)}; give as many, two at least.",
        )
        unloading = strain, force
        rule = inputs.word("cord_unloading_rule", ("moved", "scaled"))
    return {
        "cord_angles": np.mod(inputs.numbers("cord_angles", "rad"), 2 * math.pi),
        "cord_force": inputs.number("cord_force", "N", above=0),
        "cord_strain": inputs.numbers("cord_table_strain", "1"),
        "cord_table": inputs.numbers("cord_table_force", "N"),
        "cord_unloading": unloading,
        "cord_unloading_rule": rule,
        "cord_compression": inputs.number("cord_compression", "N", above=0),
    }


# ---- mesh ----------------------------------------------------------------------------------------


def stations(tube: Tube, size: float) -> tuple[Array, tuple[int, int]]:
    """Positions [m] of the rings of nodes along the inflated tube, and numbers of those at the
    band's edges."""
    half_width = BAND_WIDTH * tube.radius
    corners = [0.0, tube.load_at - half_width, tube.load_at + half_width, tube.half_span]
    parts = []
    count = 0
    edges = []
    for begin, end in pairwise(corners):
        cells = max(round((end - begin) / size), 1)
        parts.append(np.linspace(begin, end, cells + 1)[:-1])
        count += cells
        edges.append(count)
    return np.concatenate([*parts, [tube.half_span]]), (edges[0], edges[1])


def inflation(radius: float, λ_L: float, λ_H: float, around: int) -> Callable[[Array], Array]:
    """The displacement from the stress-free prism of `half_tube_mesh` to the inflated circular
    tube.

    Args:
        radius: of the inflated tube [m].
        λ_L: stretch along the tube.
        λ_H: stretch around it.
        around: sides of half of the prism.

    Returns:
        A function of points (3, n); the proportions of the ends of the tube are constant.
    """
    side_angle = math.pi / around
    apothem = radius / λ_H * side_angle / 2 / math.tan(side_angle / 2)

    def inflate(X: Array) -> Array:
        angle = np.arctan2(X[1], X[2])
        from_middle = np.mod(angle, side_angle) - side_angle / 2
        # At the corners both ends of the interval are the same side of the polygon.
        prism_radius = apothem / np.cos(from_middle)
        scale = radius / prism_radius
        return np.vstack([(λ_L - 1) * X[0], (scale - 1) * X[1], (scale - 1) * X[2]])

    return inflate


def half_tube_mesh(
    comm: MPI.Intracomm, x: Array, radius: float, around: int, band: tuple[int, int]
) -> gx.Mesh:
    """Half of a prism (y ≥ 0) about the x axis with its end, flat triangles of order 1.

    Its section has `around` sides over half of it, of the perimeter of a circle of the given
    radius.

    Groups: "wall", "band", "cap"; "middle", the rim at x = 0; "lines", both lines in the plane y =
    0; "line 0" from the top to "line N" at the bottom.
    """
    rings = len(x)
    per_ring = around + 1
    angle = np.linspace(0.0, math.pi, per_ring)
    # The sides of a polygon of this radius have the length of the arcs.
    side_angle = math.pi / around
    polygon_radius = radius * side_angle / (2 * math.sin(side_angle / 2))
    points = np.zeros((rings, per_ring, 3))
    points[:, :, 0] = x[:, None]
    points[:, :, 1] = polygon_radius * np.sin(angle)
    points[:, :, 2] = polygon_radius * np.cos(angle)
    # Exactly in the plane of symmetry.
    points[:, [0, -1], 1] = 0.0
    centre = rings * per_ring
    coordinates = np.vstack([points.reshape(-1, 3), [[x[-1], 0.0, 0.0]]])
    number = np.arange(rings * per_ring).reshape(rings, per_ring)

    def arrays() -> tuple[Array, Array, dict[str, Array]]:
        begin, end = band
        last = number[-1]
        parts = {
            "wall": np.vstack([wall_triangles(number[: begin + 1]), wall_triangles(number[end:])]),
            "band": wall_triangles(number[begin : end + 1]),
            "cap": np.column_stack([np.full(around, centre), last[1:], last[:-1]]),
        }
        end_rim = polyline(np.array([last[0], centre, last[-1]]))
        lines = {f"line {k}": polyline(number[:, k]) for k in range(per_ring)}
        lines["middle"] = polyline(number[0])
        lines["plane"] = np.vstack([lines["line 0"], lines[f"line {around}"], end_rim])
        return coordinates, np.vstack(list(parts.values())), parts | lines

    return mesh_of_arrays(comm, arrays)


def wall_triangles(rings: Array) -> Array:
    """Triangles (m, 3) between rings of nodes (n, k), with normals outwards."""
    a, b, c, d = cell_corners(rings.T)
    return np.vstack([triangles_of(a, b, c), triangles_of(a, c, d)])


# ---- items of the scene --------------------------------------------------------------------------


class End(Item):
    """The rigid end of the half tube and its lever, which move in the plane y = 0.

    With the centre x_c of the end and the unit vector d that points up from it, every node of the
    end follows as

        x_k = x_c + Z_k d    in x and z,    y_k = Y_k,                                           (2)

    and the foot of the lever, x_c - lever d, stays at its height.  Without a lever the end is free.
    """

    def __init__(self, film: gx.Membrane, lever: float | None, start: Array) -> None:
        self.name = "end"
        self._film = film
        self._lever = lever
        self._piece = RigidPiece(
            "end plate", film, np.array([start, [0.0, 0.0, 1.0]]), np.zeros((2, 3))
        )
        self.centre = self._piece.port()

    def requires(self) -> Iterable[Any]:
        """The film and the piece."""
        yield self._film
        yield self._piece

    def terms(self, start: State) -> Iterable[Term]:
        """Constraints (2) in x and z, the plane of the motion, and the foot on its rail."""
        film = self._film
        piece = self._piece
        nodes = film.nodes("cap")
        own = nodes[nodes < film.block.index_map.size_local]
        heights = start[film].positions()[own, 2]
        numbers = film.block.index_map.local_to_global(own)
        pairs = []
        for node, height in zip(numbers, heights, strict=True):
            pairs.append((Port(film, (int(node),)), piece.port(float(height))))
        in_plane = np.eye(3)[[0, 2]]
        L = np.hstack([in_plane, -in_plane])
        yield PointConstraint(
            self.name,
            PointMeasure(
                pairs,
                np.zeros((2, 6, 6)),
                L,
                np.zeros(2),
            ),
        )
        for k, port in enumerate((piece.port(), *piece.directors)):
            yield held_component(f"{self.name} plane {k}", port, 1, 0.0)
        if self._lever is not None:
            yield held_component(f"{self.name} foot", piece.port(-self._lever), 2, -self._lever)


def held_component(
    name: str, port: Port, axis: int, value: float, closing: Callable[[float], float] | None = None
) -> PointConstraint:
    """The constraint that a component of a vector is a value; `closing` as of `PointConstraint`."""
    measure = PointMeasure([(port,)], np.zeros((1, 3, 3)), np.eye(3)[[axis]], np.array([-value]))
    return PointConstraint(name, measure, closing=closing)


class Lowered(Item):
    """A weighted mean of nodes that is lowered by t [m] at the time t; its reaction is the load.

    The force of the constraint is spread over the nodes by their weights.
    """

    def __init__(self, port: Port, height: float) -> None:
        self.name = "load"
        self._port = port
        self._height = height

    def requires(self) -> Iterable[Any]:
        """The body of the nodes."""
        yield self._port.body

    def terms(self, start: State) -> Iterable[Term]:
        """The constraint z - (height - 1) = 1 - t."""
        value = self._height - 1.0
        yield held_component(self.name, self._port, 2, value, closing=lambda t: 1.0 - t)


def mean_of(film: gx.Membrane, nodes: Array, weights: Array) -> Port:
    """The weighted mean of nodes of all ranks.  Collective.

    Args:
        film: of order 2.
        nodes: this rank's owned nodes, local numbers (n,).
        weights: (n,), of any sum.
    """
    numbers = film.block.index_map.local_to_global(nodes.astype(np.int32))
    parts = film.comm.allgather((numbers.tolist(), weights.tolist()))
    all_numbers = [number for part, _ in parts for number in part]
    all_weights = np.array([weight for _, part in parts for weight in part])
    normed = tuple(map(float, all_weights / all_weights.sum()))
    return Port(film, tuple(all_numbers), weights=normed)


def band_port(film: gx.Membrane) -> Port:
    """The mean over the area of the loaded band.

    A uniform load acts on the nodes at the middle of edges only: ∫N dA of a quadratic triangle is a
    third of its area there, and zero at its corners.
    """
    mesh = film.mesh.domain
    _, cells = film.mesh.group("band")
    shares = np.zeros(film.block.index_map.size_local + film.block.index_map.num_ghosts)
    own_cells = cells[cells < mesh.topology.index_map(2).size_local]
    for cell in own_cells:
        corners = mesh.geometry.x[geometry_nodes(mesh)[cell]]
        area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2
        shares[film.space.dofmap.cell_dofs(cell)[3:]] += area / 3
    # Ranks add their parts: a node that two of them share occurs twice.
    nodes = np.flatnonzero(shares)
    return mean_of(film, nodes, shares[nodes])


# ---- the test ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Model:
    """A scene and what is read from it."""

    scene: gx.Scene
    film: gx.Membrane
    load: Lowered
    middle: Port


def build(tube: Tube, comm: MPI.Intracomm, around: int) -> Model:
    """The scene of a quarter of the tube, inflated.

    Args:
        tube: the tube.
        comm: the communicator.
        around: cells over half of the section, a multiple of 6.
    """
    λ_L, λ_H = tube.stretches()
    x, band = stations(tube, CELL_ASPECT * math.pi * tube.radius / around)
    mesh = half_tube_mesh(
        comm,
        x / λ_L,
        tube.radius / λ_H,
        around,
        band,
    )
    inflate = inflation(tube.radius, λ_L, λ_H, around)
    film = gx.Membrane(
        mesh,
        tube.wall(AXIAL),
        order=2,
        displacement=inflate,
        name="wall",
    )
    cords = list(_cords(tube, film, around, λ_L))
    end = End(
        film,
        tube.lever,
        np.array([tube.half_span, 0.0, 0.0]),
    )
    load_port = band_port(film)
    load = Lowered(load_port, float(load_port.initial()[2]))
    scene = gx.Scene(
        film,
        gx.Pressure(film, tube.pressure),
        *cords,
        end,
        gx.Fixed(film, "middle", components=(0,)),
        gx.Fixed(film, "plane", components=(1,)),
        gx.Fixed(film, "cap", components=(1,)),
        load,
    )
    rim = film.nodes("middle")
    own = rim[rim < film.block.index_map.size_local]
    return Model(
        scene,
        film,
        load,
        mean_of(
            film,
            own,
            np.ones(len(own)),
        ),
    )


def _cords(tube: Tube, film: gx.Membrane, around: int, λ_L: float) -> Iterable[gx.connectors.Tape]:
    """The cords of the half tube, as bars along lines of the mesh."""
    factor = λ_L / (1 + tube.cord_strain_after_inflation())
    for angle in tube.cord_angles:
        line = round(angle * around / math.pi)
        if line > around:
            # In the other half; its mirror image is in this one.
            continue
        share = 1.0
        if line in (0, around):
            # In the plane of symmetry: the other half of the tube has the other half of the cord.
            share = 0.5
        cord = gx.connectors.Tape.along_edges(
            film, tube.cord_law(share), edges=f"line {line}", length_factor=factor
        )
        # The lengths are those of the cord; a wall that is woven otherwise does not change them.
        yield gx.connectors.Tape(
            film,
            cord.law,
            bars=cord.bars,
            lengths=cord.lengths,
            name=f"cord at {round(math.degrees(angle))} degrees",
        )


def bend(model: Model, tube: Tube, step: float) -> tuple[Array, Array, dict[str, float]]:
    """Lower the loads step by step.

    Returns:
        Deflections of midspan [m], total loads [N], and numbers of the solution.

    Raises:
        NoEquilibrium: with the reason.
    """
    search = gx.Equilibrium(model.scene)
    deflections: list[float] = []
    loads: list[float] = []
    effort = Effort()
    first_height = float(model.middle.initial()[2])
    lowered = 0.0
    while not deflections or deflections[-1] < tube.deflection:
        effort.add(search.find(at=lowered))
        height = float(search.system.unknowns.state.vector(model.middle)[2])
        deflections.append(first_height - height)
        # Two loads, and half of the section of each is modelled.
        loads.append(-4 * float(search.reaction(model.load)[0][2]))
        # Small steps up to the initial stiffness, in which the curve bends.
        lowered += step if deflections[-1] > INITIAL_DEFLECTION else min(step, STEP)
    details = {
        "unknowns": float(search.system.unknowns.numbering.size),
        "iterations": float(effort.iterations),
        "seconds": effort.seconds,
    }
    return np.array(deflections), np.array(loads), details


def force_ratio(braid_angle: float) -> float:
    """1 - 2 cot²β, to which the axial force of a cord after inflation is proportional; β [deg]."""
    return 1 - 2 / math.tan(math.radians(braid_angle)) ** 2


def _with_factors(values: Mapping[str, Any], factors: Mapping[str, float]) -> dict[str, Any]:
    """Inputs of which some are multiplied by factors."""
    found = dict(values)
    for name, factor in factors.items():
        found[name] = {**found[name], "value": found[name]["value"] * factor}
    return found


def with_pressure(values: Mapping[str, Any], pressure: float) -> dict[str, Any]:
    """The inputs with another pressure, to which the force of the cords is proportional."""
    ratio = pressure / values["pressure"]["value"]
    return _with_factors(values, {"pressure": ratio, "cord_force": ratio})


def with_diameter(values: Mapping[str, Any], diameter: float) -> dict[str, Any]:
    """The inputs with another diameter, to whose square the force of the cords is proportional."""
    ratio = diameter / values["diameter"]["value"]
    return _with_factors(values, {"diameter": ratio, "cord_force": ratio**2})


def with_braid_angle(values: Mapping[str, Any], braid_angle: float) -> dict[str, Any]:
    """The inputs with another braid angle β [deg].

    Of a braid with the modulus G = A12, A11 = G cot²β + E_L and A22 is proportional to tan²β; the
    force of a cord is F_c = p π r²/3 (1 - 2 cot²β).
    """
    old = values["braid_angle"]["value"]
    squared_tangents = [math.tan(math.radians(angle)) ** 2 for angle in (old, braid_angle)]
    change_of_A11 = values["A12"]["value"] * (1 / squared_tangents[1] - 1 / squared_tangents[0])
    factors = {
        "braid_angle": braid_angle / old,
        "A11": 1 + change_of_A11 / values["A11"]["value"],
        "A22": squared_tangents[1] / squared_tangents[0],
        "cord_force": force_ratio(braid_angle) / force_ratio(old),
    }
    return _with_factors(values, factors)


# Inputs that others follow from.
FOLLOWERS = {
    "pressure": with_pressure,
    "diameter": with_diameter,
    "braid_angle": with_braid_angle,
}


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """The total load [N] against the deflection of midspan [m], and the one at 10 mm."""
    tube = Tube.read(inputs)
    around = CELLS_AROUND
    step = STEP
    if quick:
        around = QUICK_CELLS_AROUND
        step = QUICK_STEP
    if "cells_around" in inputs:
        around = inputs.whole("cells_around", least=6)
        check(
            around % 6 == 0,
            f"{inputs.where}: cells_around is {around}; give a multiple of 6, for lines every 30 "
            "degrees.",
        )
    model = build(tube, comm, around)
    deflections, loads, details = bend(model, tube, step)
    initial = float(np.interp(INITIAL_DEFLECTION, deflections, loads))
    quantities = {
        "load": Predicted(loads, deflections),
        "load at 10 mm": Predicted(initial),
    }
    return Prediction(quantities, details)
