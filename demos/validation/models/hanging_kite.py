"""A leading edge inflatable kite that hangs upside down by its bridle, under loads at its tips or
its middle.

The tubes are shear-deformable beams, the canopy is a film that bears no compression, and the lines
of the bridle are ropes.  A line over a pulley has one tension: k (l_a + l_b - L) of both parts
together.

Stiffness of a tube of radius r under the pressure p.  Two series of tests on tubes of 1 m were
fitted by J. Breukels (2011).  Tubes that are twisted by the angle φ' per length bear the torque

    T = c₁ arctan(c₂ φ'),    c₁(r, p), c₂(r, p),                                                 (1)

whose secant is the torsional stiffness GJ = T/φ'.  The shear stiffness of the wall G t = c₁ c₂/(2π
r³) is that of the untwisted tube, and GA = π r G t.  Cantilevers of the deflection v bear the load
F = A (1 - exp(-n v/A)) with A(r, p) and n(r, p).  The secant n_s at the load p π r³/2 of the first
wrinkle predicts these cantilevers (case `inflated_cantilever`).  It contains the deflection by
shear, so that the bending stiffness follows from

    1/n_s = 1/(3 EI) + 1/GA.                                                                     (2)

With E t = EI/(π r³): EA = 2π r E t.  Beyond the first wrinkle, at the curvature κ_w = p/(2 E t), EI
is the secant M(κ)/κ of Stein and Hedgepeth's solution,

    sin θ + (π - θ) cos θ = π κ_w/κ,    M = E t κ r³ (π - θ + ½ sin 2θ).                         (3)

Both secants are found by iteration over equilibria.

Weight: the canopy has a density per area; the remainder of the total is spread evenly over the
surface of the tubes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.figures import area_vectors
from demos.common.searches import Effort
from demos.studies.bent_tube import wrinkled_angle
from demos.validation.engine.case import Array, Inputs, read_case
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import (
    Item,
    PointMeasure,
    Response,
    Rows,
    State,
    Term,
    check,
    one_sided_average,
    positive_part,
)
from gossamer_fx.meshes.arrays import cell_corners, mesh_of_arrays, triangles_of
from gossamer_fx.meshes.line import line

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"bending_factor": "1", "tip_rope": "m", "torsion_factor": "1"}

GRAVITY = 9.81  # [m/s²], along z

# Canopy: cells from the leading to the trailing edge.
CHORD_CELLS = 6

# Mass [kg] of a knot of the bridle: it only paces the pseudo-time.
KNOT_MASS = 0.02

# Constants of the fits by J. Breukels (2011), for r in m and p in bar: A and n of the cantilevers,
# c₁ and c₂ of the twisted tubes.
FIT_LOAD = (6582.82, -272.43, 40852.38, 14.31)
FIT_SLOPE = (271865251.42, 215.93, 14021.79, -589.05)
FIT_TORQUE = (1467.0, 40.908, -191.8, 47.406)
FIT_TWIST = (-17703.0, 358.05, 0.0918)
BAR = 1e5

# Share by which the secant stiffness of a tube is replaced in an iteration, their number, and the
# relative change at which they end.
RELAXATION = 0.7
MAX_ITERATIONS = 4
STIFFNESS_TOLERANCE = 0.03
SMALLEST_SHARE = 0.05

# A rope between the tips, for a sensitivity: its stiffness, and the steps in which it is shortened
# from a length at which it is slack.
ROPE_STIFFNESS = 500.0  # [N/m]
SLACK_ROPE = 8.0  # [m]
ROPE_STEP = 0.75  # [m]

SEARCH = gx.analysis.Continuation(
    first_step=5e-3, tolerance=1e-5, total_iterations=4000, max_iterations=40, fast_iterations=15
)


def torsion_law(radius: float, pressure: float) -> tuple[float, float]:
    """c₁ [N m] and c₂ [m] of the fit (1) of twisted tubes."""
    p = pressure / BAR
    C13, C14, C15, C16 = FIT_TORQUE
    C17, C18, C19 = FIT_TWIST
    torque = (C13 * radius + C14) * p + C15 * radius + C16
    per_twist = C17 * radius**4 * math.log(p) + C18 * radius**3 + C19
    return torque, per_twist


def torsional_stiffness(twist: float, radius: float, pressure: float) -> float:
    """GJ [N m²] of a tube at a twist [rad/m]."""
    torque, per_twist = torsion_law(radius, pressure)
    # atan(x)/x tends to 1; below this x it differs from it by less than 1e-9.
    x = max(abs(per_twist * twist), 1e-5)
    return torque * per_twist * math.atan(x) / x


def shear_stiffness(radius: float, pressure: float) -> float:
    """GA [N] of a tube that is not twisted."""
    return torsional_stiffness(0.0, radius, pressure) / (2 * radius**2)


def bending_law(radius: float, pressure: float) -> tuple[float, float]:
    """Largest load [N] and first slope [N/m] of the fit of cantilevers."""
    p = pressure / BAR
    C1, C2, C3, C4 = FIT_LOAD
    C5, C6, C7, C8 = FIT_SLOPE
    largest = (C1 * radius + C2) * p**2 + C3 * radius**3 + C4
    slope = (C5 * radius**5 + C6) * p + C7 * radius + C8
    return largest, slope


def wall_stiffness(radius: float, pressure: float) -> float:
    """E t [N/m] of a tube, by the secant of the fit at the load of the first wrinkle, equation
    (2)."""
    largest, slope = bending_law(radius, pressure)
    first_wrinkle = pressure * math.pi * radius**3 / 2
    deflection = -largest / slope * math.log(1 - first_wrinkle / largest)
    in_bending = deflection - first_wrinkle / shear_stiffness(radius, pressure)
    return first_wrinkle / in_bending / (3 * math.pi * radius**3)


def check_fits(radius: float, pressure: float, where: str) -> None:
    """Check that the fits, which are of tubes of 0.08 to 0.2 m, have a meaning for a tube.

    Raises:
        InputError: they have not.
    """
    largest, slope = bending_law(radius, pressure)
    torque, per_twist = torsion_law(radius, pressure)
    is_within = slope > 0 and torque > 0 and per_twist > 0
    is_within = is_within and largest > pressure * math.pi * radius**3 / 2
    if is_within:
        # Deflection by shear alone may not be more than the whole one.
        is_within = 0 < wall_stiffness(radius, pressure) < math.inf
    check(
        is_within,
        f"{where}: the fits of inflated tubes do not hold for a diameter of {2 * radius:g} m at "
        f"{pressure / BAR:g} bar; give tubes of 0.09 to 0.2 m and 0.1 to 0.6 bar.",
    )


def bending_share(curvature: float, pressure: float, stiffness: float) -> float:
    """M/(E t π r³ κ) of a tube at a curvature κ [1/m]."""
    first = pressure / (2 * stiffness)
    ratio = curvature / first
    if ratio <= 1:
        return 1.0
    # Equation (3) for the half angle over which the wall is slack.
    θ = wrinkled_angle(ratio)
    share = (math.pi - θ + math.sin(2 * θ) / 2) / math.pi
    # A tube that has collapsed would be a mechanism.
    return max(share, SMALLEST_SHARE)


@dataclass
class Tube:
    """One beam of the kite.

    Attributes:
        nodes: of the geometry, in order.
        radius: [m].
        share: of the bending stiffness without wrinkles.
        torsion: torsional stiffness over that of the untwisted tube.
        beam: of the scene that was built last.
    """

    nodes: tuple[int, ...]
    radius: float
    share: float = 1.0
    torsion: float = 1.0
    beam: gx.Beam | None = None


@dataclass(frozen=True)
class Kite:
    """The geometry in SI units; nodes are numbered as in the source."""

    points: Mapping[int, Array]
    leading: list[Tube]
    struts: list[Tube]
    ropes: list[tuple[int, int, float, float]]
    pulley_lines: list[tuple[int, int, int, float, float]]
    fixed: frozenset[int]
    pressure: float
    canopy_density: float
    canopy_stiffness: float
    mass: float
    tip_load: float
    point_load: float
    loaded: tuple[int, int, int]
    bending_factor: float
    torsion_factor: float
    tip_rope: float

    @staticmethod
    def read(inputs: Inputs) -> Kite:
        """The kite of a case file."""
        points = {}
        for row in inputs.table("nodes", "1", 4):
            points[int(row[0])] = row[1:]
        leading = []
        for i, j, diameter in inputs.table("leading_edge", "1", 3).tolist():
            leading.append(Tube((int(i), int(j)), diameter / 2))
        # A strut is one beam through all of its nodes, whose lines and canopy pull on it between
        # its ends.
        segments: dict[int, list[list[float]]] = {}
        for row in inputs.table("struts", "1", 5).tolist():
            segments.setdefault(int(row[0]), []).append(row)
        struts = []
        for rows in segments.values():
            first = int(rows[0][1])
            others = [int(row[2]) for row in rows]
            # The mean of both ends: a strut tapers by a quarter at most.
            mean_diameter = (rows[0][3] + rows[0][4]) / 2
            struts.append(Tube((first, *others), mean_diameter / 2))
        modulus = inputs.number("line_modulus", "Pa", above=0)
        ropes = []
        for i, j, length, diameter in inputs.table("lines", "1", 4).tolist():
            stiffness = modulus * math.pi * diameter**2 / 4
            ropes.append((int(i), int(j), length, stiffness))
        pulley_lines = []
        for i, pulley, j, length, diameter in inputs.table("pulley_lines", "1", 5).tolist():
            stiffness = modulus * math.pi * diameter**2 / 4
            pulley_lines.append((int(i), int(pulley), int(j), length, stiffness))
        loaded = inputs.numbers("loaded_nodes", "1")
        check(
            len(loaded) == 3,
            f"{inputs.where}: loaded_nodes has {len(loaded)} numbers; give those of both tips and "
            "of the middle.",
        )
        fixed = inputs.numbers("fixed_nodes", "1")
        used = {
            "loaded_nodes": loaded,
            "fixed_nodes": fixed,
            "distances": inputs.table("distances", "1", 4).ravel(),
            "leading_edge": np.ravel([tube.nodes for tube in leading]),
            "struts": np.concatenate([tube.nodes for tube in struts]),
            "lines": np.ravel([rope[:2] for rope in ropes]),
            "pulley_lines": np.ravel([over[:3] for over in pulley_lines]),
        }
        # A node with a typing error would otherwise end in an error of an index.
        for name, nodes in used.items():
            unknown = sorted({int(node) for node in nodes} - set(points))
            check(
                not unknown,
                f"{inputs.where}: {name} has the nodes {unknown}, which nodes does not list; add "
                "them.",
            )
        pressure = inputs.number("pressure", "Pa", above=0)
        for tube in (*leading, *struts):
            check_fits(tube.radius, pressure, inputs.where)
        return Kite(
            points=points,
            leading=leading,
            struts=struts,
            ropes=ropes,
            pulley_lines=pulley_lines,
            fixed=frozenset(int(node) for node in fixed),
            pressure=pressure,
            canopy_density=inputs.number("canopy_density", "kg/m2", above=0),
            canopy_stiffness=inputs.number("canopy_stiffness", "N/m", above=0),
            mass=inputs.number("mass", "kg", above=0),
            tip_load=inputs.number("tip_load", "kg"),
            point_load=inputs.number("point_load", "kg"),
            loaded=(int(loaded[0]), int(loaded[1]), int(loaded[2])),
            bending_factor=_factor(inputs, "bending_factor"),
            torsion_factor=_factor(inputs, "torsion_factor"),
            tip_rope=inputs.number("tip_rope", "m", above=0) if "tip_rope" in inputs else 0.0,
        )

    @property
    def tubes(self) -> list[Tube]:
        """All tubes."""
        return [*self.leading, *self.struts]

    def length(self, tube: Tube) -> float:
        """Length of a tube [m]."""
        corners = np.array([self.points[node] for node in tube.nodes])
        parts = np.diff(corners, axis=0)
        return float(np.linalg.norm(parts, axis=1).sum())

    def tube_surface(self) -> float:
        """Surface of all tubes [m²]."""
        return sum(2 * math.pi * tube.radius * self.length(tube) for tube in self.tubes)


def _factor(inputs: Inputs, name: str) -> float:
    """For a sensitivity: a stiffness of the tubes over that of the fits; 1 unless it is given."""
    if name in inputs:
        return inputs.number(name, "1", above=0)
    return 1.0


# ---- lines over pulleys --------------------------------------------------------------------------


def pulley(e0: Any, e1: Any, z0: Any, h: Any, numbers: Any) -> Response:
    """ψ = ½ k (l_a + l_b - L)² of the lengths l = √(2e) of both parts while they are taut, else
    none.

    The mean stresses S_i = k s/l_i, with the mean stretch s of the step and the mean length l_i of
    a part, do the work Δψ: Δe_i = l_i Δl_i.
    """
    before = [np.sqrt(2 * e) for e in e0]
    after = [np.sqrt(2 * e) for e in e1]
    y1 = sum(after) - numbers.L
    tension = numbers.k * one_sided_average(sum(before) - numbers.L, y1)
    stress = [2 * tension / (start + end) for start, end in zip(before, after, strict=True)]
    return Response(stress, energy=numbers.k * positive_part(y1) ** 2 / 2)


@dataclass(frozen=True, eq=False)
class PulleyLine(Item):
    """A line from `ports[0]` over a pulley without friction at `ports[1]` to `ports[2]`."""

    ports: tuple[Any, Any, Any]
    stiffness: float
    length: float
    name: str

    def requires(self) -> Iterable[Any]:
        """The bodies of the ports."""
        return [port.body for port in self.ports]

    def terms(self, start: State) -> Iterable[Term]:
        """The stored energy of the half squared lengths of both parts."""
        blocks = []
        for part in ([1.0, -1.0, 0.0], [0.0, -1.0, 1.0]):
            difference = np.kron([part], np.eye(3))
            blocks.append(difference.T @ difference)
        measure = PointMeasure(
            [self.ports],
            np.array(blocks),
            np.zeros((2, 9)),
            np.zeros(2),
        )
        yield Rows(self.name, measure, pulley, {"k": self.stiffness, "L": self.length})


# ---- the scene -----------------------------------------------------------------------------------


class Hanging:
    """The scene of a kite with the present shares of bending stiffness.

    Args:
        kite: its points, tubes and lines.
        inward: force [N] on each tip towards the other one at the time 0; it decreases to zero
            at 1 s.
    """

    def __init__(self, kite: Kite, comm: MPI.Intracomm, inward: float = 0.0) -> None:
        self.kite = kite
        self._comm = comm
        self._ports: dict[int, Any] = {}
        self._items: list[Any] = []
        film, area = self._canopy()
        canopy_mass = area * kite.canopy_density
        check(
            kite.mass > canopy_mass,
            f"mass is {kite.mass:g} kg, and the canopy has {canopy_mass:.3g} kg of it; give a "
            "larger mass or a "
            "smaller canopy_density.",
        )
        areal_mass = (kite.mass - canopy_mass) / kite.tube_surface()
        for k, tube in enumerate(kite.tubes):
            self._add_tube(tube, areal_mass, f"tube {k}")
        self._join_tubes()
        self._add_bridle()
        self._attach(film)
        for node, force in self._loads():
            self._items.append(
                gx.loads.Force(
                    self._ports[node],
                    tuple(force),
                    name=f"load at {node}",
                )
            )
        if inward:
            self._pull_tips(inward)
        if kite.tip_rope > 0:
            self._tie_tips()
        self._search = gx.Equilibrium(gx.Scene(*self._items), SEARCH)
        self.unknowns = self._search.system.unknowns.numbering.size

    def _pull_tips(self, inward: float) -> None:
        """Add the forces [N] that pull the tips together, which end at 1 s."""
        for tip, sign in zip(self.kite.loaded[:2], (-1.0, 1.0), strict=True):

            def force(t: float, sign: float = sign) -> tuple[float, float, float]:
                return (0.0, sign * inward * max(0.0, 1.0 - t), 0.0)

            self._items.append(gx.loads.Force(self._ports[tip], force, name=f"pull at {tip}"))

    def _tie_tips(self) -> None:
        """Add a rope between the tips: at the time t [s] it is t [m] long."""

        def length(t: float) -> float:
            # A scene begins at the time 0, where a rope has to have a length, too.
            return t if t > 0 else SLACK_ROPE

        tips = [self._ports[tip] for tip in self.kite.loaded[:2]]
        rope = gx.connectors.Tether(*tips, stiffness=ROPE_STIFFNESS, length=length, name="tip rope")
        self._items.append(rope)

    def find(self, at: float = 1.0) -> gx.analysis.EquilibriumResult:
        """Find the equilibrium under the loads of the time `at` [s]."""
        return self._search.find(at)

    def find_tied(self) -> gx.analysis.EquilibriumResult:
        """Find the equilibrium with the rope between the tips, if the kite has one: in steps, since
        the state that a sudden pull leads to may be another one."""
        last = self.kite.tip_rope
        if last == 0:
            return self.find()
        for length in np.arange(SLACK_ROPE, last, -ROPE_STEP):
            self.find(float(length))
        return self.find(last)

    def rope_force(self) -> float:
        """Force [N] of the rope between the tips; 0 if there is none."""
        stretch = self.distance(*self.kite.loaded[:2]) - self.kite.tip_rope
        return ROPE_STIFFNESS * max(stretch, 0.0) if self.kite.tip_rope > 0 else 0.0

    def position(self, node: int) -> Array:
        """Present position [m] of a node of the kite."""
        return np.asarray(self._search.system.unknowns.state.vector(self._ports[node]))

    def distance(self, first: int, second: int) -> float:
        """Present distance [m] between two nodes of the kite."""
        between = self.position(first) - self.position(second)
        return float(np.linalg.norm(between))

    def curvature(self, tube: Tube) -> float:
        """Mean curvature [1/m] of a tube, from the turn of its sections between its ends."""
        assert tube.beam is not None
        ends = []
        for end in ("start", "end"):
            frame = tube.beam.frame(end)
            d2, d3 = self._search.system.unknowns.state.vectors(frame.directors[-2:])
            ends.append(np.cross(d2, d3))
        # A strut of several parts is not straight from the beginning.
        corners = np.array([self.kite.points[node] for node in tube.nodes])
        parts = np.diff(corners, axis=0)
        angle_before = _angle(parts[0], parts[-1])
        angle = _angle(ends[0], ends[1])
        return abs(angle - angle_before) / self.kite.length(tube)

    def soften(self) -> float:
        """Let stiffnesses approach the secants at the present deformation; returns the largest
        change."""
        pressure = self.kite.pressure
        change = 0.0
        for tube in self.kite.tubes:
            r = tube.radius
            bending = bending_share(
                self.curvature(tube),
                pressure,
                wall_stiffness(r, pressure),
            )
            torsion = torsional_stiffness(
                self.twist(tube),
                r,
                pressure,
            )
            torsion /= torsional_stiffness(0.0, r, pressure)
            change = max(
                change,
                abs(bending - tube.share),
                abs(torsion - tube.torsion),
            )
            tube.share += RELAXATION * (bending - tube.share)
            tube.torsion += RELAXATION * (torsion - tube.torsion)
        return change

    def twist(self, tube: Tube) -> float:
        """Mean twist [rad/m] of a tube."""
        assert tube.beam is not None
        before = []
        after = []
        for end in ("start", "end"):
            directors = tube.beam.frame(end).directors[-2:]
            before.append(_axes(*(director.initial() for director in directors)))
            after.append(_axes(*self._search.system.unknowns.state.vectors(directors)))
        return twist_between(before, after) / self.kite.length(tube)

    # ---- parts -----------------------------------------------------------------------------------

    def _section(self, tube: Tube, areal_mass: float) -> gx.sections.Section:
        Et = wall_stiffness(tube.radius, self.kite.pressure)
        r = tube.radius
        EI = self.kite.bending_factor * tube.share * math.pi * r**3 * Et
        GA = shear_stiffness(r, self.kite.pressure)
        GJ = self.kite.torsion_factor * tube.torsion * 2 * r**2 * GA
        line_density = 2 * math.pi * r * areal_mass
        return gx.sections.Section(
            EA=2 * math.pi * r * Et,
            GA2=GA,
            GA3=GA,
            EI2=EI,
            EI3=EI,
            GJ=GJ,
            line_density=line_density,
            rotary2=line_density * r**2 / 2,
            rotary3=line_density * r**2 / 2,
        )

    def _add_tube(self, tube: Tube, areal_mass: float, name: str) -> None:
        points = [tuple(map(float, self.kite.points[node])) for node in tube.nodes]
        beam = gx.Beam(
            line(self._comm, points, 1),
            self._section(tube, areal_mass),
            # Along none of the tubes; sections are round, so that any other will do.
            normal=(0.31, 0.17, 1.0),
            name=name,
        )
        tube.beam = beam
        self._items.append(gx.Gravity(beam, (0.0, 0.0, GRAVITY)))
        for k, node in enumerate(tube.nodes):
            if node in self._ports:
                continue
            if k == 0:
                port = beam.port("start")
            elif k == len(tube.nodes) - 1:
                port = beam.port("end")
            else:
                port = beam.port_at(points[k])
            self._ports[node] = port

    def _join_tubes(self) -> None:
        """Rigid joints where tubes meet: along the leading edge, and of struts with it."""
        # Frames join rotations, too: the struts of a kite are sewn to its leading edge around the
        # whole section.
        ends: dict[int, Any] = {}
        for tube in self.kite.tubes:
            assert tube.beam is not None
            for node, end in ((tube.nodes[0], "start"), (tube.nodes[-1], "end")):
                frame = tube.beam.frame(end)
                if node in ends:
                    joint = gx.constraints.FixedJoint(
                        ends[node], frame, name=f"{tube.beam.name} {end}"
                    )
                    self._items.append(joint)
                else:
                    ends[node] = frame

    def _add_bridle(self) -> None:
        kite = self.kite
        used: set[int] = set()
        for rope in kite.ropes:
            used.update(rope[:2])
        for over in kite.pulley_lines:
            used.update(over[:3])
        for node in sorted(used):
            point = tuple(map(float, kite.points[node]))
            if node in kite.fixed:
                self._ports[node] = gx.Ground(point)
            elif node not in self._ports:
                knot = gx.PointMass(
                    KNOT_MASS,
                    point,
                    comm=self._comm,
                    name=f"knot {node}",
                )
                self._ports[node] = knot.port()
        for k, (i, j, length, stiffness) in enumerate(kite.ropes):
            if {i, j} <= kite.fixed:
                continue
            # The first end of a rope is of a body; the ground has no equations.
            pair = (self._ports[i], self._ports[j])
            if i in kite.fixed:
                pair = (self._ports[j], self._ports[i])
            self._items.append(
                gx.connectors.RopeBundle(
                    [pair],
                    stiffness=stiffness / length,
                    lengths=[length],
                    name=f"line {k}",
                )
            )

        for k, (i, pulley, j, length, stiffness) in enumerate(kite.pulley_lines):
            ports = (self._ports[i], self._ports[pulley], self._ports[j])
            self._items.append(
                PulleyLine(
                    ports,
                    stiffness / length,
                    length,
                    f"pulley line {k}",
                )
            )

    def _ribs(self) -> list[tuple[Array, Tube | None]]:
        """Points of the canopy from the leading to the trailing edge, rib by rib, and the strut
        there."""
        struts = {tube.nodes[0]: tube for tube in self.kite.struts}
        nodes = [self.kite.leading[0].nodes[0], *(tube.nodes[1] for tube in self.kite.leading)]
        fractions = np.linspace(0.0, 1.0, CHORD_CELLS + 1)
        ribs = []
        for node in nodes:
            strut = struts.get(node)
            # Without a strut a rib is a straight line; the source numbers its trailing edge next.
            chain: tuple[int, ...] = (node, node + 1)
            if strut is not None:
                chain = strut.nodes
            corners = np.array([self.kite.points[one] for one in chain])
            lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
            along = np.concatenate([[0.0], np.cumsum(lengths)])
            wanted = fractions * along[-1]
            columns = [np.interp(wanted, along, column) for column in corners.T]
            ribs.append((np.column_stack(columns), strut))
        return ribs

    def _canopy(self) -> tuple[gx.Membrane, float]:
        """The film and its area."""
        grid = np.array([points for points, _ in self._ribs()])
        spans, rows, _ = grid.shape
        points = grid.reshape(-1, 3)
        a, d, c, b = cell_corners(np.arange(spans * rows).reshape(spans, rows))
        # Diagonals alternate: of one direction only, they would stiffen the film in that one.
        is_odd = np.indices(a.shape).sum(axis=0) % 2 == 1
        first = triangles_of(a, b, np.where(is_odd, c, d))
        second = triangles_of(np.where(is_odd, a, b), c, d)
        triangles = np.vstack([first, second])
        Et = self.kite.canopy_stiffness
        thickness = 1e-4
        law = gx.Miyazaki(
            E=Et / thickness,
            nu=0.3,
            density=self.kite.canopy_density / thickness,
            thickness=thickness,
            residual_stiffness=1e-5,
        )
        film = gx.Membrane(
            mesh_of_arrays(self._comm, lambda: (points, triangles, {})),
            law,
            name="canopy",
        )
        self._items.append(gx.Gravity(film, (0.0, 0.0, GRAVITY)))
        areas = np.linalg.norm(area_vectors(points[triangles]), axis=1)
        return film, float(areas.sum())

    def _attach(self, film: gx.Membrane) -> None:
        """The canopy on the leading edge and on the struts; its own nodes on the trailing edge."""
        nodes = [self.kite.leading[0].nodes[0], *(tube.nodes[1] for tube in self.kite.leading)]
        for node, (points, strut) in zip(nodes, self._ribs(), strict=True):
            for k, point in enumerate(points):
                here = tuple(map(float, point))
                if k == 0:
                    target = self._ports[node]
                elif strut is not None and strut.beam is not None:
                    target = strut.beam.port_at(here)
                    if k == CHORD_CELLS:
                        target = self._ports[strut.nodes[-1]]
                else:
                    if k == CHORD_CELLS:
                        self._ports[node + 1] = film.port_at(here)
                    continue
                self._items.append(
                    gx.constraints.BallJoint(
                        film.port_at(here), target, name=f"canopy at {node}, {k}"
                    )
                )

    def _loads(self) -> list[tuple[int, Array]]:
        first, last, middle = self.kite.loaded
        tip = GRAVITY * self.kite.tip_load
        point = GRAVITY * self.kite.point_load
        loads = [
            (first, np.array([0.0, tip, 0.0])),
            (last, np.array([0.0, -tip, 0.0])),
            (middle, np.array([0.0, 0.0, point])),
        ]
        return [(node, force) for node, force in loads if np.abs(force).max() > 0]


def _axes(d2: Array, d3: Array) -> Array:
    """The axes (3, 3) of a section as columns, its normal first."""
    return np.column_stack([np.cross(d2, d3), d2, d3])


def twist_between(before: list[Array], after: list[Array]) -> float:
    """Turn [rad] of the end of a tube against its start, about its axis, since the initial state.

    Args:
        before: axes (3, 3) of the sections at the start and the end, as columns, in the initial
            state.
        after: in the present state.
    """
    turn = (before[0].T @ before[1]).T @ (after[0].T @ after[1])
    # The axial vector of a rotation by φ has the length sin φ; tubes turn by less than a right
    # angle.
    sine = (turn[2, 1] - turn[1, 2]) / 2
    return math.asin(float(np.clip(sine, -1.0, 1.0)))


def _angle(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Distances [m] between points of the trailing edge, of the tips, and from the middle to a
    tip."""
    kite = Kite.read(inputs)
    effort = Effort()
    rounds = 1 if quick else MAX_ITERATIONS
    for _ in range(rounds):
        hanging = Hanging(kite, comm)
        effort.add(hanging.find_tied())
        if hanging.soften() < STIFFNESS_TOLERANCE:
            break
    lengths = []
    for i, j, k, m in inputs.table("distances", "1", 4):
        left = hanging.distance(int(i), int(j))
        right = hanging.distance(int(k), int(m))
        lengths.append((left + right) / 2)
    details = {
        "unknowns": float(hanging.unknowns),
        "iterations": float(effort.iterations),
        "seconds": effort.seconds,
        "rope force": hanging.rope_force(),
        "smallest share of bending stiffness": min(tube.share for tube in kite.tubes),
        "smallest share of torsional stiffness": min(tube.torsion for tube in kite.tubes),
    }
    quantities = {
        "distance": Predicted(np.array(lengths)),
        # Between the tips, the last but one.
        "b": Predicted(lengths[-2]),
    }
    return Prediction(quantities, details)


def release_tips(inward: float = 49.05, case: str = "case 1") -> None:
    """Print two equilibria of a kite under the same loads, with stiffnesses of tubes that do not
    bend: without, and after its tips were pulled together by `inward` [N] each.  The equilibrium
    under the whole pull is not stable, and the last search, without it, may end without one: this
    is printed, too.

    Command: ./gossamer python -c "from demos.validation.models import hanging_kite as k;
        k.release_tips()"
    """
    cases = Path(__file__).parents[1] / "cases" / "hanging_kite.toml"
    (test,) = (test for test in read_case(cases, ["hanging_kite"]).tests if test.name == case)
    hanging = Hanging(Kite.read(test.inputs), MPI.COMM_WORLD, inward)
    tips = test.inputs.table("distances", "1", 4)[-2]
    for at in (1.0, 0.0, 0.5, 1.0):
        try:
            result = hanging.find(at)
        except gx.NoEquilibrium as failure:
            if MPI.COMM_WORLD.rank == 0:
                print(f"tips pulled by {inward * (1 - at):.4g} N: no equilibrium. {failure}")
            return
        stored = sum(result.totals.stored.values())
        span = hanging.distance(int(tips[0]), int(tips[1]))
        if MPI.COMM_WORLD.rank == 0:
            print(f"tips pulled by {inward * (1 - at):.4g} N: span {span:.4g} m, {stored:.5g} J")
