"""Bending stiffness of a deployed tube: an equilibrium under pressure, and one with a small force
at the tip.

A straight tube of inflated radius r and film of thickness t, taut on its whole circumference, has
the bending stiffness

    EI = E t π r³,    r = r0 (1 + (1 - ν/2) p r0/(E t)),

with Young's modulus, since the hoop stress is that of the pressure p.  The tube is clamped at its
flat end, and the force F acts in the plane of that end, where the film cannot turn.  The moment at
a section is F times its distance from the tip, whatever the pressure: the force of the pressure on
the tip balances that of the wall.  So

    EI y''(x) = F (L - x)

holds away from the flat ends, also if shear makes y' larger by a constant; EI follows from a
least-squares fit of the deflection of the sections in between.  There must be enough of them: with
diameters of 30 mm, 8 and 12 cells give EI within 1.2 % of the closed form on a tube of 250 mm, but
0.75 and 0.40 N m² for 0.67 on one of 160 mm, of which 40 mm are left.

A short tube is described by the stiffness F/y(L) of its tip.  It is that of the flat end, at which
the tube turns like at a hinge whose moment comes from the pressure: 6 N/m at 160 mm, where a
cantilever of the stiffness EI has 490 N/m.  It is 19 % less with 12 cells than with 8; the ratio of
two designs changes by 1.4 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.manufacturing import Specimen, UnevenZigzag, move_rows, stations
from gossamer_fx.extend import Array, IsotropicFilm
from gossamer_fx.meshes.tube import flat_tube

# Tip force over that at which the film begins to wrinkle, p π r³/2 over the length (Stein &
# Hedgepeth, NASA TN D-813).
FORCE_RATIO = 0.1
# Distance [diameters] from both flat ends of the sections that are fitted.
END_DIAMETERS = 2.0
# Decimals [m] to which the nodes of a section have one coordinate.
DECIMALS = 9


def straight_stiffness(law: IsotropicFilm, diameter: float, pressure: float) -> float:
    """EI [N m²] of a straight tube of a diameter [m] without pressure, under a pressure [Pa]."""
    radius = diameter / 2
    film = law.E * law.thickness
    inflated = radius * (1 + (1 - law.nu / 2) * pressure * radius / film)
    return film * math.pi * inflated**3


def tip_stiffness(
    law: IsotropicFilm, length: float, diameter: float, pressure: float, sides: int = 0
) -> float:
    """Stiffness k [N/m] of the tip across a straight tube with round, rigid ends, under a pressure
    [Pa]: a beam with shear, 1/k = L³/(3 EI) + L/(G π r t + p π r²).

    Args:
        law: of the film.
        length, diameter: of the tube without pressure [m].
        sides: of a regular polygon of the same circumference in place of the circle; 0: the circle.

    The pressure stiffens the tube against shear: W. B. Fichter, A theory for inflated thin-wall
    cylindrical beams, NASA TN D-3466 (1966).
    """
    bending = straight_stiffness(law, diameter, pressure)
    radius = diameter / 2
    if sides:
        # Second moment of area of the thin polygon over that of the circle.
        side = math.pi * diameter / sides
        inner = side / (2 * math.tan(math.pi / sides))
        of_polygon = sides * side / 2 * (inner**2 + side**2 / 12)
        bending *= of_polygon / (math.pi * radius**3)
    inflated = radius * (1 + (1 - law.nu / 2) * pressure * radius / (law.E * law.thickness))
    of_film = law.E / (2 * (1 + law.nu)) * math.pi * inflated * law.thickness
    shear = of_film + pressure * math.pi * inflated**2
    return 1 / (length**3 / (3 * bending) + length / shear)


@dataclass(frozen=True)
class BentTube:
    """A tube under a force at its tip, by its sections from the inlet to the tip.

    Attributes:
        x: positions along the tube (n,) [m].
        deflection: displacements of the sections by the force (n,) [m].
        force: at the tip [N].
        diameter: of the specimen [m].
    """

    x: Array
    deflection: Array
    force: float
    diameter: float

    @property
    def bending_stiffness(self) -> float:
        """EI [N m²], of the sections away from the flat ends."""
        margin = END_DIAMETERS * self.diameter
        middle = (self.x > margin) & (self.x < self.x[-1] - margin)
        return _fitted_stiffness(
            self.x[middle], self.deflection[middle], self.force, float(self.x[-1])
        )

    @property
    def tip_stiffness(self) -> float:
        """Force over the deflection of the tip [N/m]."""
        return self.force / float(self.deflection[-1])


def bent_tube(
    comm: MPI.Comm,
    law: IsotropicFilm,
    length: float,
    diameter: float,
    pressure: float,
    specimen: Specimen,
    cells: int = 8,
    creases: dict[str, float] | None = None,
    angle: float = 1.4,
) -> BentTube:
    """Bend a deployed tube.

    Args:
        law: of the film, as drawn.
        length, diameter: of the tube, as drawn [m].
        pressure: of the gas in it [Pa].
        specimen: its manufacturing errors.
        cells: edges of triangles across the flat tube.
        creases: "stiffness" [N m/m/rad] and other arguments of creases at its folds; None: no
            creases.
        angle: of the panels when the tube was folded [rad], from which the rest angle of the
            creases follows.

    Raises:
        NoEquilibrium: the tube has none, as with a pressure that does not fill it.
    """
    panels = len(specimen.thickness_ratios)
    diameter *= specimen.diameter_ratio
    ends = stations(length, panels, specimen.fold_shifts)
    mesh = flat_tube(comm, length, diameter, cells, compartments=panels)
    mesh = move_rows(mesh, length, ends)
    folds = UnevenZigzag(
        length=length,
        panels=panels,
        angle=angle,
        shifts=specimen.fold_shifts,
        angle_errors=specimen.angle_errors,
    )
    if creases is not None:
        mesh = folds.mark(mesh)
    thickness = {
        f"compartment {i}": law.thickness * ratio
        for i, ratio in enumerate(specimen.thickness_ratios, start=1)
    }

    def opened(X: Array, side: float) -> Array:
        """Displacement (3, n) [m] of one strip to a round tube with flat ends."""
        radius = diameter / 2
        from_end = np.minimum(X[0], length - X[0])
        share = np.clip(from_end / diameter, 0.0, 1.0)
        around = X[1] / radius
        y = share * (radius * np.sin(around) - X[1])
        z = side * share * radius * np.cos(around)
        return np.stack([0 * X[0], y, z])

    film = gx.Membrane(
        mesh,
        law,
        properties={"thickness": thickness},
        # Strips that coincide have no volume, so that the pressure would do no work at first.
        displacement={
            "top": lambda X: opened(X, 1.0),
            "bottom": lambda X: opened(X, -1.0),
        },
    )
    limit = pressure * math.pi * (diameter / 2) ** 3 / 2
    force = FORCE_RATIO * limit / length
    width = math.pi * diameter / 2
    items: list[object] = [
        film,
        gx.Fixed(film, "inlet"),
        # The flat end is a hinge across the force: nothing else keeps the tube from turning about
        # it.
        gx.Fixed(film, "tip", components=(2,)),
        gx.Pressure(film, pressure),
        gx.loads.EdgeLoad(film, "tip", force=lambda t: (0.0, t * force / width, 0.0)),
    ]
    if creases is not None:
        items += folds.creases(film, **creases)  # type: ignore[arg-type]
    equilibrium = gx.Equilibrium(gx.Scene(*items))
    sections = []
    # Time is the share of the force.
    for share in (0.0, 1.0):
        equilibrium.find(at=share)
        sections.append(_axis(film, equilibrium))
    x, straight = sections[0]
    _, bent = sections[1]
    return BentTube(x, bent - straight, force, diameter)


def _axis(film: gx.Membrane, equilibrium: gx.Equilibrium) -> tuple[Array, Array]:
    """Means of x and of y (n,) [m] of the nodes of each section, from the inlet to the tip."""
    positions = equilibrium.system.unknowns.state[film].local_positions()
    owned = film.block.index_map.size_local
    flat = film.space.tabulate_dof_coordinates()[:owned]
    parts = film.comm.allgather((flat[:, 0], positions[:owned]))
    flat_x = np.concatenate([part[0] for part in parts])
    where = np.concatenate([part[1] for part in parts])
    _, row = np.unique(flat_x.round(DECIMALS), return_inverse=True)
    count = np.bincount(row)
    x: Array = np.bincount(row, where[:, 0]) / count
    y: Array = np.bincount(row, where[:, 1]) / count
    return x, y


def _fitted_stiffness(x: Array, y: Array, force: float, length: float) -> float:
    """EI [N m²] of the deflections y (n,) [m] of sections at x (n,) [m] by a force [N] at the
    length [m]."""
    # y = a + b x + F/EI (L x²/2 - x³/6): a and b are the deflection and slope of the rest of the
    # tube.
    shape = length * x**2 / 2 - x**3 / 6
    columns = np.stack([np.ones_like(x), x / length, shape / length**3], axis=1)
    found = np.linalg.lstsq(columns, y, rcond=None)[0]
    return force * length**3 / float(found[2])
