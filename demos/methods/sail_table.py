"""How do I get a table of force and torque of a deformed sail against attitude, for an orbit code?

Find the equilibrium of the film under the light of each attitude, and write the resultant of the
light: force and torque about the centre of the sail, in its axes, at 1 astronomical unit.

    u = (sin α cos β, sin α sin β, -cos α)     direction of the light; α is the cone angle, β the
                                               clock angle

Light of pressure P on a triangle of the area vector a exerts the force of `gx.orbit.Optics` (C. R.
McInnes, Solar Sailing, 1999, section 2.6).  An equilibrium contains no orbit: its light is
`gx.orbit.Sunlight`, of a given direction and pressure.  In flight use `gx.orbit.SolarPressure`,
which also knows distance, shadow and motion.

Two checks are printed: the forces at the frame balance the light to 1e-8, and the light on the flat
sail is McInnes' formula.  The sagging sail has 3 % less force in full light than the flat one,
whose table is that of an orbit code with a rigid plate; and in oblique light it has a torque, 1.7
mN m at α = 40°, that turns it away from the Sun, where the flat one has none: the centre of
curvature is on the sunny side.  As the shape follows the load, the table holds for one distance
from the Sun.

Where the values come from:
    film               2.5 µm; optics `gossamer_fx.mechanics.orbit.optics.JPL_SAIL`
    shape              chosen: a frame of 20 m × 20 m, 1 % smaller than the film
    modulus            chosen: 1 MPa instead of 2.5 GPa, so that Newton's method converges; strains
                       are a ten-thousandth then, small against the slack, and a fifth of it changes
                       Fz by 0.1 %

    ./gossamer demo sail_table
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import (
    BLUE,
    RED,
    area_vectors,
    draw_film,
    finish,
    new_figure,
    save,
    triangles,
)
from gossamer_fx.extend import Array
from gossamer_fx.meshes.sheet import EDGES, crossed_sheet
from gossamer_fx.orbit.optics import JPL_SAIL, PRESSURE, Arrays, light_force

# Side of the frame, and its centre, about which the torque acts.
SIDE = 20.0  # m
CENTRE = (SIDE / 2, SIDE / 2, 0.0)
SLACK = 0.01  # share by which the corners are too near
# Light cannot stretch the film: it only takes out its slack.  See the top for the modulus.
FILM = gx.Miyazaki(E=1e6, nu=0.34, density=1420.0, thickness=2.5e-6, residual_stiffness=1e-4)
COLUMNS = "cone [deg],clock [deg],Fx [N],Fy [N],Fz [N],Tx [N m],Ty [N m],Tz [N m]"


def light_direction(cone: float, clock: float) -> Array:
    """Unit vector along the light, in the axes of the sail; angles in [°]."""
    α, β = np.radians((cone, clock))
    return np.array([np.sin(α) * np.cos(β), np.sin(α) * np.sin(β), -np.cos(α)])


def build(comm: MPI.Intracomm, directions: Array, cells: int = 10) -> gx.Equilibrium:
    """A slack square in a square frame, in the light from each of the directions (n, 3)."""

    def slack(X: Array) -> Array:
        from_centre = X[:2] - SIDE / 2
        dome = np.cos(np.pi * from_centre / SIDE).prod(axis=0)
        # The sag of an arc whose chord is shorter by the slack.
        depth = SIDE * np.sqrt(3 * SLACK / 8)
        return np.vstack([-SLACK * from_centre, -depth * dome])

    mesh = crossed_sheet(comm, cells, cells, SIDE, SIDE)
    # One support for all edges, so that one reaction balances the light.
    mesh.groups["frame"] = (1, np.concatenate([mesh.groups[edge][1] for edge in EDGES]))
    film = gx.Membrane(mesh, FILM, displacement=slack)
    frame = gx.Fixed(film, "frame", name="frame")
    # The light moves the film by its own width in about two minutes.
    search = gx.analysis.Continuation(first_step=20.0)
    # `find(at=k)` takes direction k.
    light = gx.orbit.Sunlight(film, direction=lambda k: directions[round(k)], optics=JPL_SAIL)
    return gx.Equilibrium(gx.Scene(film, light, frame), search)


def light_on(corners: Array, u: Array) -> Array:
    """Force [N] and torque [N m] about the centre, (6,), of light along u on triangles (n, 3,
    3)."""
    front = JPL_SAIL.coefficients()
    back = JPL_SAIL.coefficients(back=True)
    # All triangles at once: `Arrays` has scalar products of rows.
    force = PRESSURE * light_force(area_vectors(corners), u, front, back, Arrays)
    arm = corners.mean(axis=1) - CENTRE
    return np.append(force.sum(axis=0), np.cross(arm, force).sum(axis=0))


@dataclass(frozen=True)
class Table:
    """Loads at each of n attitudes.

    Attributes:
        attitudes: cone and clock angles (n, 2) [°].
        deformed: force [N] and torque [N m] (n, 6) on the sail.
        flat: the same on the flat sail.
        imbalance: largest force of light and frame together, over that of the light.
        shape: triangles (m, 3, 3) [m] of the sail in the first attitude.
    """

    attitudes: Array
    deformed: Array
    flat: Array
    imbalance: float
    shape: Array

    def write(self, path: Path) -> None:
        """Write the loads on the deformed sail as CSV, with units in the header."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS.split(","))
            for attitude, load in zip(self.attitudes, self.deformed, strict=True):
                writer.writerow([*(f"{a:g}" for a in attitude), *(f"{x:.6e}" for x in load)])


def make_table(attitudes: Array, cells: int = 10) -> Table:
    """Find the sail in each attitude (n, 2) [°], on one rank."""
    directions = np.array([light_direction(*attitude) for attitude in attitudes])
    sail = build(MPI.COMM_SELF, directions, cells)
    film = next(item for item in sail.scene.items if isinstance(item, gx.Membrane))
    frame = next(item for item in sail.scene.items if isinstance(item, gx.Fixed))
    # The flat sail is the deformed one, projected to its plane.
    flat = triangles(sail.system, film) * np.array([1.0, 1.0, 0.0])
    shapes = []
    deformed = []
    imbalance = []
    for k, u in enumerate(directions):
        # From the shape in the attitude before: one search takes few iterations.
        sail.find(at=k)
        shapes.append(triangles(sail.system, film))
        deformed.append(light_on(shapes[-1], u))
        held, _ = sail.reaction(frame)
        light = deformed[-1][:3]
        imbalance.append(np.linalg.norm(light + held) / np.linalg.norm(light))
    return Table(
        attitudes,
        deformed=np.array(deformed),
        flat=np.array([light_on(flat, u) for u in directions]),
        imbalance=float(max(imbalance)),
        shape=shapes[0],
    )


def formula(u: Array) -> Array:
    """Force [N] on the flat sail by McInnes' formula: its front is lit, its normal away from the
    light is -z."""
    # The light comes from the front, along -z at a cone angle of zero.
    cosine = -u[2]
    mirrored, both, along = JPL_SAIL.coefficients()
    area = (SIDE * (1 - SLACK)) ** 2
    away = np.array([0.0, 0.0, -1.0])
    return PRESSURE * area * cosine * ((mirrored * cosine + both) * away + along * u)


def draw(table: Table, path: Path) -> None:
    """The sail in full light, and force and torque against the cone angle in the plane of x and
    z."""
    figure = new_figure(10.5, 3.6)
    sail = figure.add_subplot(1, 3, 1, projection="3d")
    draw_film(sail, table.shape, view=(6.0, -70.0))
    # Attitudes in the plane of x and z.
    in_plane = table.attitudes[:, 1] == 0
    cone = table.attitudes[in_plane, 0]
    panels = {
        "force [mN]": ((0, "$F_x$", BLUE), (2, "$F_z$", RED)),
        "torque [mN m]": ((4, "$T_y$", BLUE),),
    }
    for number, (label, curves) in enumerate(panels.items(), start=2):
        axes = figure.add_subplot(1, 3, number)
        for column, name, colour in curves:
            deformed = 1e3 * table.deformed[in_plane, column]
            axes.plot(cone, deformed, "o-", color=colour, label=name)
            flat = 1e3 * table.flat[in_plane, column]
            axes.plot(cone, flat, "--", color=colour, label=f"{name}, flat sail")
        finish(axes, "cone angle [°]", label)
    save(figure, path)


def main(output: str | Path | None = None, cells: int = 10, step: int = 10) -> dict[str, float]:
    """Make the table for cone angles up to 80° in steps of `step` [°]; with `output`, CSV and
    picture there."""
    cones = range(0, 81, step)
    # Four clock angles show the symmetry of the square.
    attitudes = np.array(
        [(cone, clock) for clock in (0, 30, 60, 90) for cone in cones], dtype=float
    )
    table = make_table(attitudes, cells)
    if output is not None:
        table.write(Path(output) / "sail_table.csv")
        draw(table, Path(output) / "sail_table.png")
    exact = np.array([formula(light_direction(*attitude)) for attitude in attitudes])
    at_40 = (attitudes == (40.0, 0.0)).all(axis=1).argmax()
    return {
        "imbalance with the frame": table.imbalance,
        "flat sail over McInnes, less 1": float(
            abs(table.flat[:, :3] - exact).max() / -exact[0, 2]
        ),
        "Fz in full light, deformed over flat": table.deformed[0, 2] / table.flat[0, 2],
        "Ty at 40° [N m]": table.deformed[at_40, 4],
        "Ty at 40° of the flat sail [N m]": table.flat[at_40, 4],
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/sail_table"))
