"""A leading edge inflatable kite that hangs upside down by its bridle, under loads at its tips or its middle.

The tubes are shear-deformable beams, the canopy is a film that bears no compression, and the lines of
the bridle are ropes.  A line over a pulley has one tension: k (l_a + l_b - L) of both parts together.

Stiffness of a tube of radius r under the pressure p.  The fits of inflated cantilevers of 1 m,
F = A (1 - exp(-n v/A)) with A(r, p) and n(r, p), give the bending stiffness EI = n_s/3 with the secant n_s at the
load p π r³/2 of the first wrinkle, which predicts these cantilevers (case `inflated_cantilever`).
With E t = EI/(π r³): EA = 2π r E t, GA = π r E t/2.6, GJ = 2π r³ E t/2.6.  Beyond the first wrinkle, at the
curvature κ_w = p/(2 E t), EI is the secant M(κ)/κ of Stein and Hedgepeth's solution,

    sin θ + (π - θ) cos θ = π κ_w/κ,    M = E t κ r³ (π - θ + ½ sin 2θ),

and found by iteration over equilibria.

Weight: the canopy has a density per area; the remainder of the total is spread evenly over the surface of
the tubes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.meshes.line import line
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.one_sided import one_sided_average, one_sided_energy
from gossamer_fx.terms.point_energies import PointStoredEnergy

GRAVITY = 9.81  # [m/s²], along z

# Canopy: cells from the leading to the trailing edge.
CHORD_CELLS = 6

# Mass [kg] of a knot of the bridle: it only paces the pseudo-time.
KNOT_MASS = 0.02

# Constants of the fits by J. Breukels (2011), for r in m and p in bar.
FIT_LOAD = (6582.82, -272.43, 40852.38, 14.31)
FIT_SLOPE = (271865251.42, 215.93, 14021.79, -589.05)
BAR = 1e5

# Share by which the secant stiffness of a tube is replaced in an iteration, their number, and the change
# at which they end.
RELAXATION = 0.7
MAX_ITERATIONS = 4
STIFFNESS_TOLERANCE = 0.03
SMALLEST_SHARE = 0.05

SEARCH = gx.analysis.Continuation(
    first_step=5e-3, tolerance=1e-5, total_iterations=4000, max_iterations=40, fast_iterations=15
)


def wall_stiffness(radius: float, pressure: float) -> float:
    """E t [N/m] of a tube, by the secant of the fit at the load of the first wrinkle."""
    p = pressure / BAR
    C1, C2, C3, C4 = FIT_LOAD
    C5, C6, C7, C8 = FIT_SLOPE
    largest = (C1 * radius + C2) * p**2 + C3 * radius**3 + C4
    slope = (C5 * radius**5 + C6) * p + C7 * radius + C8
    first_wrinkle = pressure * math.pi * radius**3 / 2
    deflection = -largest / slope * math.log(1 - first_wrinkle / largest)
    return first_wrinkle / deflection / (3 * math.pi * radius**3)


def bending_share(curvature: float, radius: float, pressure: float, stiffness: float) -> float:
    """M/(E t π r³ κ) of a tube at a curvature κ [1/m]."""
    first = pressure / (2 * stiffness)
    ratio = curvature / first
    if ratio <= 1:
        return 1.0
    θ = brentq(lambda a: math.sin(a) + (math.pi - a) * math.cos(a) - math.pi / ratio, 0.0, math.pi)
    return max((math.pi - θ + math.sin(2 * θ) / 2) / math.pi, SMALLEST_SHARE)


@dataclass
class Tube:
    """One beam of the kite.

    Attributes:
        nodes: of the geometry, in order.
        radius: [m].
        share: of the bending stiffness without wrinkles.
        beam: of the scene that was built last.
    """

    nodes: tuple[int, ...]
    radius: float
    share: float = 1.0
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

    @staticmethod
    def read(inputs: Inputs) -> Kite:
        """The kite of a case file."""
        points = {int(row[0]): row[1:] for row in _mixed(inputs, "nodes", 4)}
        leading = [
            Tube((int(i), int(j)), float(d) / 2)
            for i, j, d in _mixed(inputs, "leading_edge", 3).tolist()
        ]
        segments: dict[int, list[list[float]]] = {}
        for row in _mixed(inputs, "struts", 5).tolist():
            segments.setdefault(int(row[0]), []).append(row)
        struts = []
        for rows in segments.values():
            nodes = (int(rows[0][1]), *(int(row[2]) for row in rows))
            struts.append(Tube(nodes, (rows[0][3] + rows[0][4]) / 4))
        modulus = inputs.number("line_modulus", "Pa", above=0)
        ropes = []
        for i, j, length, diameter in _mixed(inputs, "lines", 4).tolist():
            stiffness = modulus * math.pi * diameter**2 / 4
            ropes.append((int(i), int(j), length, stiffness))
        pulley_lines = []
        for i, pulley, j, length, diameter in _mixed(inputs, "pulley_lines", 5).tolist():
            stiffness = modulus * math.pi * diameter**2 / 4
            pulley_lines.append((int(i), int(pulley), int(j), length, stiffness))
        loaded = inputs.numbers("loaded_nodes", "1")
        # For a sensitivity: the bending stiffness of tubes over that of the fits.
        bending_factor = 1.0
        if "bending_factor" in inputs:
            bending_factor = inputs.number("bending_factor", "1", above=0)
        return Kite(
            points=points,
            leading=leading,
            struts=struts,
            ropes=ropes,
            pulley_lines=pulley_lines,
            fixed=frozenset(int(node) for node in inputs.numbers("fixed_nodes", "1")),
            pressure=inputs.number("pressure", "Pa", above=0),
            canopy_density=inputs.number("canopy_density", "kg/m2", above=0),
            canopy_stiffness=inputs.number("canopy_stiffness", "N/m", above=0),
            mass=inputs.number("mass", "kg", above=0),
            tip_load=inputs.number("tip_load", "kg"),
            point_load=inputs.number("point_load", "kg"),
            loaded=(int(loaded[0]), int(loaded[1]), int(loaded[2])),
            bending_factor=bending_factor,
        )

    @property
    def tubes(self) -> list[Tube]:
        """All tubes."""
        return [*self.leading, *self.struts]

    def length(self, tube: Tube) -> float:
        """Length of a tube [m]."""
        nodes = np.array([self.points[node] for node in tube.nodes])
        return float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())

    def tube_surface(self) -> float:
        """Surface of all tubes [m²]."""
        return sum(2 * math.pi * tube.radius * self.length(tube) for tube in self.tubes)


def _mixed(inputs: Inputs, name: str, columns: int) -> Array:
    """A table whose numbers are nodes and lengths [m]."""
    return inputs.table(name, "1", columns)


# ---- lines over pulleys ----------------------------------------------------------------------------


@dataclass(frozen=True)
class PulleyEnergy:
    """ψ = ½ k (l_a + l_b - L)² of the lengths l = √(2e) of both parts while they are taut, else none.

    The mean stresses S_i = k s/l_i, with the mean stretch s of the step and the mean length l_i of a
    part, do the work Δψ: Δe_i = l_i Δl_i.
    """

    k: float
    L: float

    def energy(self, e: Array) -> Array:
        """ψ (n,) [J] of the measures e (n, 2) [m²]."""
        return self.k * one_sided_energy(np.sqrt(2 * e).sum(axis=1) - self.L)

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """Mean stresses (n, 2) [N/m], and their derivatives by e1 (n, 2, 2)."""
        before = np.sqrt(2 * e0)
        after = np.sqrt(2 * e1)
        mean = (before + after) / 2
        stretch, slope = one_sided_average(before.sum(axis=1) - self.L, after.sum(axis=1) - self.L)
        S = self.k * stretch[:, None] / mean
        D = self.k * slope[:, None, None] / (mean[:, :, None] * after[:, None, :])
        own = S / (2 * mean * after)
        D -= own[:, :, None] * np.eye(2)
        return S, D


@dataclass(frozen=True, eq=False)
class PulleyLine:
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
        measure = PointMeasure([self.ports], np.array(blocks), np.zeros((2, 9)), np.zeros(2))
        yield PointStoredEnergy(self.name, measure, PulleyEnergy(self.stiffness, self.length))


# ---- the scene -------------------------------------------------------------------------------------


class Hanging:
    """The scene of a kite with the present shares of bending stiffness."""

    def __init__(self, kite: Kite, comm: MPI.Intracomm) -> None:
        self.kite = kite
        self._comm = comm
        self._ports: dict[int, Any] = {}
        self._items: list[Any] = []
        film, area = self._canopy()
        areal_mass = (kite.mass - area * kite.canopy_density) / kite.tube_surface()
        for k, tube in enumerate(kite.tubes):
            self._add_tube(tube, areal_mass, f"tube {k}")
        self._join_tubes()
        self._add_bridle()
        self._attach(film)
        for node, force in self._loads():
            self._items.append(
                gx.loads.Force(self._ports[node], tuple(force), name=f"load at {node}")
            )
        self._search = gx.Equilibrium(gx.Scene(*self._items), SEARCH)
        self.unknowns = self._search.system.numbering.size

    def find(self) -> tuple[int, float]:
        """Find the equilibrium; returns iterations and CPU seconds."""
        found = self._search.find()
        return found.iterations, found.seconds

    def position(self, node: int) -> Array:
        """Present position [m] of a node of the kite."""
        return np.asarray(self._search.system.state.vector(self._ports[node]))

    def curvature(self, tube: Tube) -> float:
        """Largest curvature [1/m] of a tube, from the turn of its sections between its ends."""
        assert tube.beam is not None
        ends = []
        for end in ("start", "end"):
            frame = tube.beam.frame(end)
            d2, d3 = self._search.system.state.vectors(frame.directors[-2:])
            ends.append(np.cross(d2, d3))
        first = [
            self.kite.points[tube.nodes[k + 1]] - self.kite.points[tube.nodes[k]] for k in (0, -2)
        ]
        before = _angle(first[0], first[1])
        return abs(_angle(ends[0], ends[1]) - before) / self.kite.length(tube)

    # ---- parts -------------------------------------------------------------------------------------

    def _section(self, tube: Tube, areal_mass: float) -> gx.sections.Section:
        Et = wall_stiffness(tube.radius, self.kite.pressure)
        r = tube.radius
        EI = self.kite.bending_factor * tube.share * math.pi * r**3 * Et
        line_density = 2 * math.pi * r * areal_mass
        return gx.sections.Section(
            EA=2 * math.pi * r * Et,
            GA2=math.pi * r * Et / 2.6,
            GA3=math.pi * r * Et / 2.6,
            EI2=EI,
            EI3=EI,
            GJ=2 * math.pi * r**3 * Et / 2.6,
            line_density=line_density,
            rotary2=line_density * r**2 / 2,
            rotary3=line_density * r**2 / 2,
        )

    def _add_tube(self, tube: Tube, areal_mass: float, name: str) -> None:
        points = [tuple(map(float, self.kite.points[node])) for node in tube.nodes]
        beam = gx.Beam(
            line(self._comm, points, 1),
            self._section(tube, areal_mass),
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
        used = {node for rope in kite.ropes for node in rope[:2]}
        used |= {node for over in kite.pulley_lines for node in over[:3]}
        for node in sorted(used):
            point = tuple(map(float, kite.points[node]))
            if node in kite.fixed:
                self._ports[node] = gx.Ground(point)
            elif node not in self._ports:
                knot = gx.PointMass(KNOT_MASS, point, comm=self._comm, name=f"knot {node}")
                self._ports[node] = knot.port()
        for k, (i, j, length, stiffness) in enumerate(kite.ropes):
            if {i, j} <= kite.fixed:
                continue
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
            self._items.append(PulleyLine(ports, stiffness / length, length, f"pulley line {k}"))

    def _ribs(self) -> list[tuple[Array, Tube | None]]:
        """Points of the canopy from the leading to the trailing edge, rib by rib, and the strut there."""
        struts = {tube.nodes[0]: tube for tube in self.kite.struts}
        nodes = [self.kite.leading[0].nodes[0], *(tube.nodes[1] for tube in self.kite.leading)]
        fractions = np.linspace(0.0, 1.0, CHORD_CELLS + 1)
        ribs = []
        for node in nodes:
            strut = struts.get(node)
            chain = (node, node + 1) if strut is None else strut.nodes
            corners = np.array([self.kite.points[one] for one in chain])
            along = np.concatenate(
                [[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
            )
            rib = [np.interp(fractions * along[-1], along, column) for column in corners.T]
            ribs.append((np.array(rib).T, strut))
        return ribs

    def _canopy(self) -> tuple[gx.Membrane, float]:
        """The film and its area."""
        grid = np.array([points for points, _ in self._ribs()])
        spans, rows, _ = grid.shape
        number = np.arange(spans * rows).reshape(spans, rows) + 1
        triangles = []
        for i in range(spans - 1):
            for k in range(rows - 1):
                a, b = number[i, k], number[i + 1, k]
                c, d = number[i + 1, k + 1], number[i, k + 1]
                triangles += [a, b, c, a, c, d] if (i + k) % 2 else [a, b, d, b, c, d]

        def build(model: Any) -> None:
            surface = model.addDiscreteEntity(2)
            model.mesh.addNodes(2, surface, number.ravel(), grid.ravel())
            model.mesh.addElementsByType(surface, 2, [], triangles)
            model.addPhysicalGroup(2, [surface], name="canopy")

        Et = self.kite.canopy_stiffness
        thickness = 1e-4
        law = gx.Miyazaki(
            E=Et / thickness,
            nu=0.3,
            density=self.kite.canopy_density / thickness,
            thickness=thickness,
            residual_stiffness=1e-5,
        )
        film = gx.Membrane(gx.gmsh_mesh(build, self._comm), law, name="canopy")
        self._items.append(gx.Gravity(film, (0.0, 0.0, GRAVITY)))
        corners = grid.reshape(-1, 3)[np.array(triangles).reshape(-1, 3) - 1]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return film, float(np.linalg.norm(normals, axis=1).sum() / 2)

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


def _angle(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Distances [m] between points of the trailing edge, of the tips, and from the middle to a tip."""
    kite = Kite.read(inputs)
    iterations = 0
    seconds = 0.0
    rounds = 1 if quick else MAX_ITERATIONS
    for _ in range(rounds):
        hanging = Hanging(kite, comm)
        found = hanging.find()
        iterations += found[0]
        seconds += found[1]
        change = 0.0
        for tube in kite.tubes:
            Et = wall_stiffness(tube.radius, kite.pressure)
            wanted = bending_share(hanging.curvature(tube), tube.radius, kite.pressure, Et)
            change = max(change, abs(wanted - tube.share))
            tube.share += RELAXATION * (wanted - tube.share)
        if change < STIFFNESS_TOLERANCE:
            break
    lengths = []
    for i, j, k, m in inputs.table("distances", "1", 4):
        left = np.linalg.norm(hanging.position(int(i)) - hanging.position(int(j)))
        right = np.linalg.norm(hanging.position(int(k)) - hanging.position(int(m)))
        lengths.append(float(left + right) / 2)
    details = {
        "unknowns": float(hanging.unknowns),
        "iterations": float(iterations),
        "seconds": seconds,
        "smallest share of stiffness": min(tube.share for tube in kite.tubes),
    }
    quantities = {
        "distance": Predicted(np.array(lengths)),
        # Between the tips, the last but one.
        "b": Predicted(lengths[-2]),
    }
    return Prediction(quantities, details)
