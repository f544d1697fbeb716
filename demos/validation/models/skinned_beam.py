"""A clamped beam of large rotation, rigid ribs on it and a film stretched over the ribs: the
deflection and twist of its tip under a weight that hangs there.

The spar is one shear-deformable beam from rib to rib, each with the stiffness of its part. A rib is
a rigid body with the mass of its part.  The skin is a film that bears no compression, whose nodes
on a rib move with it; between ribs it is free.  Its section is the aerofoil NACA 00xx.

Upper bound.  A skin that never goes slack adds E t ∮z² ds to the bending stiffness, with the height
z of the section's contour.  The tension that it is mounted with decides how much of it is slack.

Axes: x from root to tip, y from the leading edge backwards, z upwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check
from gossamer_fx.meshes.arrays import cell_corners, mesh_of_arrays, triangles_of
from gossamer_fx.meshes.line import line

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"bay_cells": "1", "chord_cells": "1"}

# Cells of the skin from the leading to the trailing edge, on each side, and between two ribs.
CHORD_CELLS = 10
QUICK_CHORD_CELLS = 5
BAY_CELLS = 2
QUICK_BAY_CELLS = 1

# Elements of the beam between two ribs.
BEAM_CELLS = 2

# Half the thickness of an aerofoil NACA 00xx over the chord and five times the relative thickness:
# coefficients of √x, x, x², x³ and x⁴; the last one closes the trailing edge.
NACA = (0.2969, -0.1260, -0.3516, 0.2843, -0.1036)

# Mass per length [kg/m] and rotary inertia per length [kg m] of the beam: they only pace the
# pseudo-time, as the weight is that of the ribs.
LINE_DENSITY = 0.5
ROTARY = 1e-5
# Radius of gyration [m] of a rib: no result depends on it.
GYRATION = 0.02

# Density of the film [kg/m³]: its weight, 0.2 % of that of the wing, does not count.
SKIN_DENSITY = 1400.0

# The axial stiffness is so large that inner forces have a round-off of 3e-6 of a weight.
SEARCH = gx.analysis.Continuation(tolerance=1e-5)


@dataclass(frozen=True)
class Wing:
    """The wing in SI units.

    Attributes:
        stations: distances (n + 1,) of the ribs from the root [m]; the first one is clamped.
        bending, torsion: EI and GJ (n,) [N m²] of the spar between them.
        in_plane: EI [N m²] of the spar in the plane of the wing.
        axial, shear: EA and GA [N].
        masses: (n,) [kg] of the ribs but the first.
        chord: [m].
        axis: distance of the spar's axis from the leading edge over the chord.
        relative_thickness: of the aerofoil.
        skin: law of the film; None: no skin.
        skin_strain: strain along the span with which it is mounted.
    """

    stations: Array
    bending: Array
    torsion: Array
    in_plane: float
    axial: float
    shear: float
    masses: Array
    chord: float
    axis: float
    relative_thickness: float
    skin: gx.TensionField | None
    skin_strain: float

    def contour(self, cells: int) -> Array:
        """Points (2 cells, 2) [m] of the aerofoil, y and z, from the leading edge over the upper
        side to the trailing edge and back."""
        # Even angles of a circle over the chord: small cells at the leading edge, which is round.
        x = (1 - np.cos(np.linspace(0.0, np.pi, cells + 1))) / 2
        powers = (np.sqrt(x), x, x**2, x**3, x**4)
        half = 5 * self.relative_thickness * sum(a * p for a, p in zip(NACA, powers, strict=True))
        upper = self.chord * np.column_stack([x, half])
        lower = upper[-2:0:-1] * (1, -1)
        return np.vstack([upper, lower])


def skin_mesh(comm: MPI.Intracomm, wing: Wing, around: int, along: int) -> gx.Mesh:
    """The skin: `around` cells on each side, `along` cells between two ribs; its section at rib k
    is the group "rib k"."""

    def arrays() -> tuple[Array, Array, dict[str, Array]]:
        contour = wing.contour(around)
        count = len(wing.stations)
        cells = np.arange(along * (count - 1) + 1) / along
        x = np.interp(cells, np.arange(count), wing.stations)
        ids = np.arange(len(x) * len(contour)).reshape(len(x), -1)
        points = np.column_stack([np.repeat(x, len(contour)), np.tile(contour, (len(x), 1))])
        # The contour is closed.
        ring = np.column_stack([ids, ids[:, 0]])
        a, b, c, d = cell_corners(ring)
        # Diagonals of one direction only would make the section twist when it is bent.
        row, column = np.indices(a.shape)
        rises = (row + column) % 2 == 0
        first = triangles_of(a, b, np.where(rises, c, d))
        second = triangles_of(np.where(rises, a, b), c, d)
        ribs = {
            f"rib {k}": np.column_stack([ring[along * k, :-1], ring[along * k, 1:]])
            for k in range(count)
        }
        return points, np.vstack([first, second]), ribs

    return mesh_of_arrays(comm, arrays)


class LoadedWing:
    """The equilibria of a wing with a weight at its tip.

    Args:
        wing: the wing.
        comm: its ranks.
        arm: distance of the weight behind the leading edge [m].
        gravity: [m/s²].
        around, along: cells of the skin, see `skin_mesh`.
    """

    def __init__(
        self,
        wing: Wing,
        comm: MPI.Intracomm,
        arm: float,
        gravity: float,
        around: int,
        along: int,
    ) -> None:
        y = wing.axis * wing.chord
        items: list[object] = []
        ribs: list[gx.RigidBody] = []
        for k, mass in enumerate(wing.masses):
            start, end = ((float(x), y, 0.0) for x in wing.stations[k : k + 2])
            spar = gx.Beam(
                line(comm, [start, end], BEAM_CELLS),
                gx.sections.Section(
                    EA=wing.axial,
                    GA2=wing.shear,
                    GA3=wing.shear,
                    EI2=float(wing.bending[k]),
                    EI3=wing.in_plane,
                    GJ=float(wing.torsion[k]),
                    line_density=LINE_DENSITY,
                    rotary2=ROTARY,
                    rotary3=ROTARY,
                ),
                name=f"spar {k + 1}",
            )
            if k == 0:
                items.append(gx.Fixed(spar, "start", rotation=True))
            else:
                root = spar.frame("start")
                items.append(gx.constraints.FixedJoint(root, ribs[-1].frame(), name=f"root {k}"))
            inertia = mass * GYRATION**2
            rib = gx.RigidBody(
                float(mass), (inertia,) * 3, position=end, comm=comm, name=f"rib {k + 1}"
            )
            tip = spar.frame("end")
            items += [
                spar,
                rib,
                gx.constraints.FixedJoint(tip, rib.frame(), name=f"tip {k + 1}"),
                gx.Gravity(rib, (0.0, 0.0, -gravity)),
            ]
            ribs.append(rib)
        if wing.skin is not None:
            items += self._skin(wing, comm, ribs, around, along)
        x = float(wing.stations[-1])

        def weight(mass: float) -> tuple[float, float, float]:
            return 0.0, 0.0, -gravity * mass

        hook = ribs[-1].port_at((x, arm, 0.0))
        items.append(gx.loads.Force(hook, weight, name="weight"))
        self._search = gx.Equilibrium(gx.Scene(*items), SEARCH)  # type: ignore[arg-type]
        self._tip = ribs[-1].port()
        self._edges = [ribs[-1].port_at((x, edge, 0.0)) for edge in (0.0, wing.chord)]
        self._chord = wing.chord
        self.effort = Effort()
        self.unknowns = self._search.system.unknowns.numbering.size

    @staticmethod
    def _skin(
        wing: Wing, comm: MPI.Intracomm, ribs: list[gx.RigidBody], around: int, along: int
    ) -> list[object]:
        along_span = np.zeros((3, 3))
        along_span[0, 0] = wing.skin_strain
        film = gx.Membrane(
            skin_mesh(comm, wing, around, along),
            wing.skin,
            initial_strain=along_span if wing.skin_strain else None,
            name="skin",
        )
        regions = [
            gx.RigidRegion(film, f"rib {k}", rigid_body=rib) for k, rib in enumerate(ribs, start=1)
        ]
        return [film, gx.Fixed(film, "rib 0"), *regions]

    def under(self, mass: float) -> tuple[float, float]:
        """Height of the tip [m] and its twist [rad], trailing edge downwards, under a mass [kg]."""
        self.effort.add(self._search.find(at=mass))
        state = self._search.system.unknowns.state
        height = float(state.vector(self._tip)[2])
        front, back = (float(state.vector(port)[2]) for port in self._edges)
        return height, math.asin((front - back) / self._chord)


def sweep(loaded: LoadedWing, masses: Array) -> tuple[Array, Array]:
    """Deflection [m] from the sag under the wing's weight, and twist [rad], of each mass."""
    found = np.array([loaded.under(float(mass)) for mass in masses])
    return found[0, 0] - found[:, 0], found[:, 1] - found[0, 1]


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Deflection over the span and twist of the tip against the mass; with a skin also the
    deflection over the one without it."""
    bare = bare_wing(inputs)
    wing = bare
    if inputs.word("skin", ("yes", "no")) == "yes":
        wing = replace(
            bare,
            skin=gx.TensionField(
                E=inputs.number("skin_modulus", "Pa", above=0),
                nu=inputs.number("skin_poisson", "1"),
                density=SKIN_DENSITY,
                thickness=inputs.number("skin_thickness", "m", above=0),
            ),
            skin_strain=inputs.number("skin_strain", "1"),
        )
    masses = inputs.numbers("tip_masses", "kg")
    check(
        len(masses) > 1 and masses[0] == 0 and bool((np.diff(masses) > 0).all()),
        f"{inputs.where}: tip_masses is {masses.tolist()} kg; give rising masses from zero.",
    )
    around = QUICK_CHORD_CELLS if quick else CHORD_CELLS
    along = QUICK_BAY_CELLS if quick else BAY_CELLS
    # Another mesh, for a study of its influence.
    if "chord_cells" in inputs:
        around = inputs.whole("chord_cells", least=3)
    if "bay_cells" in inputs:
        along = inputs.whole("bay_cells")
    arm = inputs.number("arm", "m")
    gravity = inputs.number("gravity", "m/s2", above=0)
    loaded = LoadedWing(wing, comm, arm, gravity, around, along)
    deflection, twist = sweep(loaded, masses)
    span = float(wing.stations[-1])
    quantities = {
        "deflection": Predicted(deflection / span, masses),
        "twist": Predicted(twist, masses),
    }
    effort = loaded.effort
    if wing.skin is not None:
        ratio_at = inputs.numbers("ratio_at", "kg")
        without = LoadedWing(bare, comm, arm, gravity, around, along)
        compared, _ = sweep(without, np.append(0.0, ratio_at))
        ratio = np.interp(ratio_at, masses, deflection) / compared[1:]
        quantities["deflection over the one without skin"] = Predicted(ratio)
        effort.iterations += without.effort.iterations
        effort.seconds += without.effort.seconds
    details = {
        "unknowns": float(loaded.unknowns),
        "iterations": float(effort.iterations),
        "seconds": effort.seconds,
    }
    return Prediction(quantities, details)


def bare_wing(inputs: Inputs) -> Wing:
    """The wing without skin."""
    bending = inputs.numbers("bending", "N m2")
    count = len(bending)
    spacing = inputs.number("rib_spacing", "m", above=0)
    span = inputs.number("span", "m", above=(count - 1) * spacing)
    return Wing(
        stations=np.append(spacing * np.arange(count), span),
        bending=bending,
        torsion=_as_many(inputs, "torsion", "N m2", count),
        in_plane=inputs.number("in_plane", "N m2", above=0),
        axial=inputs.number("axial", "N", above=0),
        shear=inputs.number("shear", "N", above=0),
        masses=_as_many(inputs, "masses", "kg", count),
        chord=inputs.number("chord", "m", above=0),
        axis=inputs.number("axis", "1"),
        relative_thickness=inputs.number("relative_thickness", "1", above=0),
        skin=None,
        skin_strain=0.0,
    )


def _as_many(inputs: Inputs, name: str, unit: str, count: int) -> Array:
    """As many numbers as the spar has parts."""
    found = inputs.numbers(name, unit)
    check(
        len(found) == count,
        f"{inputs.where}: {name} has {len(found)} numbers; give {count}, as many as of bending.",
    )
    return found
