"""The fold of a tape spring: its steady moment and its radius, in both senses of bending.

The tape is a plate on a flat mesh whose rest curvature makes it a circular arc across.  Its ends
retain their shape and are turned by φ each, without axial force; by symmetry a half is computed.
In opposite sense the centres of curvature along and across lie on different sides of the tape, in
equal sense on one.

A tape that is bent from its straight state snaps, and in equal sense it finds other folds than the
one that is sought.  So each search starts from a folded tape: a cylinder of the radius of the
section, a transition in which the curvature across grows, and a straight tape.  This is done at a
few turns, over which the fold grows by the length of one cell.  On a mesh the moment ripples with
that period: the steady moment is the mean M = ΔU/(2 Δφ) over it, with the stored energy U.

Theory: a fold that is a cylinder of the radius of the section, of angle α, has M = (1 + ν) D α in
opposite and (1 - ν) D α in equal sense.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx import Mesh
from gossamer_fx.extend import check
from gossamer_fx.meshes.arrays import cell_corners, mesh_of_arrays, polyline, triangles_of

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cell_of_fold": "1", "cells_across": "1"}

# Half of the length over the width of the tape: four widths beyond, ends do not change the moment.
HALF_LENGTH = 4.0

# Mesh: cells across, and length of a cell in the fold over the radius of the section, unless the
# inputs "cells_across" and "cell_of_fold" are given.
CELLS_ACROSS = 8
CELL_OF_FOLD = 0.13
QUICK_CELLS_ACROSS = 4
QUICK_CELL_OF_FOLD = 0.3
# Beyond the fold each cell is longer than the one before by this factor, up to a share of the
# width.
GROWTH = 1.15
LONGEST_CELL = 0.36
# Turn [rad] added to the fold's end within which the cells remain small: the transition bends most
# there.
MARGIN = 0.3

# First turn [rad] of an end.  The fold is then 1.4 radii long, several cells.
FIRST_TURN = math.radians(40.0)
# Turns within which the fold grows by a cell: their energies show whether one of them is of another
# fold.
STEPS = 4
# Length of the transition of the first guess over the radius.  Any from 2 to 4 leads to the same
# fold.
TRANSITION = 2.7
# Curvature [1/radius] below which the section of the first guess counts as flat.
FLAT = 1e-6

# Share of the fold's length in which its radius is measured: it ends in a transition.
MEASURED_SHARE = 0.6

# Axial force over D α/R that counts as zero, and secant iterations for the shift [m] of the end.
LITTLE_FORCE = 1e-2
MAX_SECANT_STEPS = 12
# Largest change of the shift in one of them, over the radius: against steps to another fold.
MAX_SHIFT = 0.15
# First guess of the axial stiffness of the folded tape over D α/R².
FIRST_STIFFNESS = 3.0

DENSITY = 7850.0  # [kg/m³]: it only paces the pseudo-time of the equilibria
SEARCH = gx.analysis.Continuation(
    first_step=1e-3, tolerance=1e-6, inner_tolerance=0.3, fast_iterations=15, max_iterations=40
)

# Sign of the turn by which the end of a tape whose edges point up goes down.
SENSES = {"opposite": 1.0, "equal": -1.0}


@dataclass(frozen=True)
class Tape:
    """A tape in SI units: radius and angle of the section, and a plate's law."""

    radius: float
    angle: float
    law: gx.Linear

    @property
    def width(self) -> float:
        """Length of the section along its arc [m]."""
        return self.radius * self.angle

    @property
    def length(self) -> float:
        """Half of the length of the tape [m]."""
        return HALF_LENGTH * self.width

    @property
    def bending_stiffness(self) -> float:
        """D [N m]."""
        return self.law.E * self.law.thickness**3 / 12 / (1 - self.law.nu**2)

    @property
    def moment_scale(self) -> float:
        """D α [N m]."""
        return self.bending_stiffness * self.angle

    @property
    def mean_height(self) -> float:
        """Height of the centre of the natural section above its lowest point [m]."""
        return _mean_height(self.radius, self.angle)

    def section(self, along_arc: Array, curvature: Array) -> tuple[Array, Array]:
        """Places (y, z) [m] of a section of this curvature [1/m], from its middle and its
        centre."""
        κ = np.maximum(curvature, FLAT / self.radius)
        y = np.sin(κ * along_arc) / κ
        z = (1 - np.cos(κ * along_arc)) / κ
        return y, z - _mean_height(1 / κ, κ * self.width)


def _mean_height(radius: Array | float, angle: Array | float) -> Array | float:
    half = np.asarray(angle) / 2
    return radius * (1 - np.sin(half) / half)


def cells_along(tape: Tape, cell: float, last_turn: float) -> Array:
    """Places [m] of the cells' ends along the half tape: small ones as far as the fold will
    reach."""
    end_of_fold = tape.radius * (last_turn + MARGIN)
    longest = LONGEST_CELL * tape.width
    places = [0.0]
    while places[-1] < tape.length:
        if places[-1] > end_of_fold:
            cell = min(GROWTH * cell, longest)
        places.append(places[-1] + cell)
    return np.array(places) * (tape.length / places[-1])


def graded_sheet(comm: MPI.Intracomm, places: Array, rows: int, width: float) -> Mesh:
    """A rectangle with columns of cells between `places` [m], each of two triangles with alternate
    diagonals.

    Groups: "film"; its ends "left" and "right".
    """

    def arrays() -> tuple[Array, Array, dict[str, Array]]:
        x, y = np.meshgrid(places, np.linspace(0.0, width, rows + 1))
        points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        nodes = np.arange(x.size).reshape(x.shape)
        a, b, c, d = cell_corners(nodes)
        row, column = np.indices(a.shape)
        # Diagonals of one direction only would make a fold lean.
        rises = (row + column) % 2 == 0
        first = triangles_of(a, b, np.where(rises, c, d))
        second = triangles_of(np.where(rises, a, b), c, d)
        ends = {"left": polyline(nodes[:, 0]), "right": polyline(nodes[:, -1])}
        return points, np.vstack([first, second]), ends

    return mesh_of_arrays(comm, arrays)


class FirstGuess:
    """A tape folded by a cylinder of the radius of its section; its end is at the height of a
    straight tape.

    Attributes:
        end: place x of the end's centre [m].
    """

    def __init__(self, tape: Tape, turn: float) -> None:
        self._tape = tape
        self._turn = turn
        x, z, _ = self._axis(np.array([tape.length]))
        self._end_height = float(z[0])
        self.end = float(x[0])

    def displacement(self, X: Array) -> Array:
        """Displacements (3, n) [m] of points of the flat mesh."""
        tape = self._tape
        x, z, slope = self._axis(X[0])
        begin = tape.radius * abs(self._turn)
        share = np.clip((X[0] - begin) / (TRANSITION * tape.radius), 0.0, 1.0)
        curvature = share**2 * (3 - 2 * share) / tape.radius
        y, above = tape.section(X[1] - tape.width / 2, curvature)
        height = tape.mean_height + z - self._end_height
        return np.stack(
            [
                x + above * np.sin(slope) - X[0],
                y + tape.width / 2 - X[1],
                height + above * np.cos(slope),
            ]
        )

    def _axis(self, s: Array) -> tuple[Array, Array, Array]:
        """Places x and z [m] and downward slope [rad] of the line of the sections' centres."""
        R = self._tape.radius
        size = abs(self._turn)
        sense = math.copysign(1.0, self._turn)
        angle = np.minimum(s / R, size)
        straight = np.maximum(s - R * size, 0.0)
        x = R * np.sin(angle) + straight * math.cos(size)
        down = R * (1 - np.cos(angle)) + straight * math.sin(size)
        return x, -sense * down, sense * angle


class FoldedTape:
    """The equilibrium of a folded half tape whose end is turned, without axial force.

    Each turn has its own search, from its own first guess.  A search that continued from another
    turn would begin with the end turned and the tape beyond the fold not: cells next to the end
    are then bent so sharply that the tape snaps there, to states of many times the energy.

    Args:
        tape: the tape.
        comm: its ranks.
        across: number of cells across.
        places: ends of the cells along the half tape [m], from `cells_along`.
        turn: turn φ of the end [rad]; negative in equal sense.
        extra_shift: axial displacement of the end [m] in addition to that of the first guess, as
            far as it is known.
        stiffness: guess of the axial stiffness of the folded tape [N/m].

    Attributes:
        extra_shift: the one without axial force [m], after `solve`.
        stiffness: the last secant of axial force over displacement [N/m].
        unknowns: their number.
        effort: of the searches so far.
    """

    def __init__(
        self,
        tape: Tape,
        comm: MPI.Intracomm,
        across: int,
        places: Array,
        turn: float,
        extra_shift: float,
        stiffness: float,
    ) -> None:
        guess = FirstGuess(tape, turn)
        shift_of_guess = guess.end - tape.length
        self.extra_shift = extra_shift
        self.stiffness = stiffness
        self._tape = tape
        self._turn = turn

        def turned(X: Array, φ: float) -> Array:
            natural = np.full_like(X[1], 1 / tape.radius)
            y, above = tape.section(X[1] - tape.width / 2, natural)
            return np.stack(
                [
                    shift_of_guess + self.extra_shift + above * math.sin(φ),
                    y + tape.width / 2 - X[1],
                    tape.mean_height + above * math.cos(φ),
                ]
            )

        def direction(X: Array, φ: float) -> Array:
            ones = np.ones_like(X[0])
            return np.stack([math.cos(φ) * ones, 0 * ones, -math.sin(φ) * ones])

        mesh = graded_sheet(comm, places, across, tape.width)
        self.plate = gx.Plate(
            mesh,
            tape.law,
            rest_curvature=np.diag((0.0, 1 / tape.radius, 0.0)),
            displacement=guess.displacement,
        )
        middle = gx.Fixed(
            self.plate,
            "left",
            rotation=True,
            components=(0,),
            direction=(1.0, 0.0, 0.0),
            name="middle",
        )
        self._end = gx.Fixed(
            self.plate, "right", rotation=True, direction=direction, motion=turned, name="end"
        )
        self._search = gx.Equilibrium(gx.Scene(self.plate, middle, self._end), SEARCH)
        self.unknowns = self._search.system.unknowns.numbering.size
        self.effort = Effort()

    def solve(self) -> float:
        """Shift the end until the axial force vanishes; returns the stored energy of both halves
        [J].

        Raises:
            NoEquilibrium: a search ends without one.
        """
        R = self._tape.radius
        little = LITTLE_FORCE * self._tape.moment_scale / R
        least_stiffness = 1e-3 * FIRST_STIFFNESS * self._tape.moment_scale / R**2
        force_before = math.nan
        step = 0.0
        for _ in range(MAX_SECANT_STEPS):
            # The time of the scene is the turn.
            found = self.effort.add(self._search.find(at=self._turn))
            force = float(self._search.reaction(self._end)[0][0])
            if math.isfinite(force_before) and force != force_before:
                secant = (force - force_before) / step
                # Where a fold jumps by a cell, a secant may be negative and lead away.
                if secant > least_stiffness:
                    self.stiffness = secant
            if abs(force) < little:
                break
            force_before = force
            step = float(np.clip(-force / self.stiffness, -MAX_SHIFT * R, MAX_SHIFT * R))
            self.extra_shift += step
        return 2 * float(sum(found.totals.stored.values()))

    def fold_radius(self) -> float:
        """Radius [m] of the circle nearest to the middle line of the tape within the fold."""
        space = self.plate.space
        x = gx.fields.positions(self._search, self.plate)
        X = space.tabulate_dof_coordinates()[: len(x)]
        on_middle = np.isclose(X[:, 1], self._tape.width / 2)
        in_fold = X[:, 0] <= MEASURED_SHARE * self._tape.radius * abs(self._turn)
        # A dozen points: all ranks have them.
        parts = space.mesh.comm.allgather(x[on_middle & in_fold][:, [0, 2]])
        points = np.concatenate(parts)
        # By symmetry the centre (0, c) is above or below the middle: x² + z² = 2 c z + (r² - c²).
        matrix = np.column_stack([2 * points[:, 1], np.ones(len(points))])
        c, rest = np.linalg.lstsq(matrix, (points**2).sum(axis=1))[0]
        return math.sqrt(rest + c**2)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Steady moment [N m] and radius of the fold [m]."""
    law = gx.Linear(
        E=inputs.number("E", "Pa", above=0),
        nu=inputs.number("poisson", "1"),
        density=DENSITY,
        thickness=inputs.number("thickness", "m", above=0),
    )
    tape = Tape(
        radius=inputs.number("radius", "m", above=0),
        angle=inputs.number("angle", "rad", above=0),
        law=law,
    )
    check(
        tape.angle < 2 * math.pi and law.thickness < tape.radius,
        f"{inputs.where}: angle is {math.degrees(tape.angle):g} degrees and thickness "
        f"{law.thickness:g} m at a radius "
        f"of {tape.radius:g} m; give an angle below 360 degrees and a thickness far below the "
        "radius.",
    )
    sense = inputs.word("sense", tuple(SENSES))
    cell = QUICK_CELL_OF_FOLD if quick else CELL_OF_FOLD
    across = QUICK_CELLS_ACROSS if quick else CELLS_ACROSS
    if "cells_across" in inputs:
        across = inputs.whole("cells_across", least=2)
        check(
            across % 2 == 0,
            f"{inputs.where}: cells_across is {across}; give an even number, for nodes on the "
            "middle line.",
        )
    if "cell_of_fold" in inputs:
        cell = inputs.number("cell_of_fold", "1", above=0)
    turns = SENSES[sense] * (FIRST_TURN + np.linspace(0.0, cell, STEPS + 1))

    places = cells_along(tape, cell * tape.radius, float(np.abs(turns).max()))
    extra_shift = 0.0
    stiffness = FIRST_STIFFNESS * tape.moment_scale / tape.radius**2
    energies = []
    radii = []
    details = {"unknowns": 0.0, "iterations": 0.0, "seconds": 0.0}
    for φ in turns:
        folded = FoldedTape(tape, comm, across, places, float(φ), extra_shift, stiffness)
        energies.append(folded.solve())
        radii.append(folded.fold_radius())
        # The next turn differs little in both.
        extra_shift = folded.extra_shift
        stiffness = folded.stiffness
        details["unknowns"] = float(folded.unknowns)
        details["iterations"] += folded.effort.iterations
        details["seconds"] += folded.effort.seconds
    # Each half turns by the change of φ.
    moment = (energies[-1] - energies[0]) / (2 * cell)
    quantities = {
        "steady moment": Predicted(moment),
        "radius of the fold": Predicted(float(np.mean(radii))),
    }
    return Prediction(quantities, details)
