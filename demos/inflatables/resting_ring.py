"""An inflated ring lies on the ground: how far does it flatten under its own weight?

A torus of coated fabric, blown up by a fan to a few pascals above the air around it, rests on a
floor by contact.  Where the film lies flat, the floor pushes with the pressure of the gas.  So the
mean contact pressure times the area of contact is the weight, and a softer ring rests on a wider
strip.  The program finds the equilibrium at three pressures, writes a folder, a picture and a
report of each, as `run` does of runs.

The ring may slide and turn on the floor without resistance: `result.free` names these three
motions.

Where the values come from:
    fabric     of the stiffness of a coated nylon fabric: 400 MPa, 0.3 mm, 300 g/m²
    size       chosen: 1 m across the centre line, a tube of 0.3 m
    pressures  chosen: 30, 50 and 100 Pa above an atmosphere

    ./gossamer demo resting_ring
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREEN, RED, draw_film, finish, new_figure, save, triangles
from gossamer_fx.extend import Array
from gossamer_fx.presets.gases import AIR

RADIUS = 0.5  # of the centre line [m]
TUBE_RADIUS = 0.15  # m
ATMOSPHERE = 101325.0  # Pa
TEMPERATURE = 293.0  # K
OVERPRESSURES = (30.0, 50.0, 100.0)  # Pa
DISTANCE = 2e-3  # activation distance of contact [m], far less than an edge of the mesh
GRAVITY = 9.81  # m/s²
FABRIC = gx.Miyazaki(E=4e8, nu=0.3, density=1000.0, thickness=3e-4, residual_stiffness=1e-3)


def torus(comm: MPI.Intracomm, size: float) -> gx.Mesh:
    """A ring just above the plane z = 0, of triangles of a size [m]."""

    def build(model: Any) -> None:
        import gmsh

        # At the start the lowest points are within reach of the floor, but do not touch it.
        model.occ.addTorus(0, 0, TUBE_RADIUS + 0.5 * DISTANCE, RADIUS, TUBE_RADIUS)
        model.occ.synchronize()
        surfaces = [tag for _, tag in model.getEntities(2)]
        model.addPhysicalGroup(2, surfaces, name="ring")
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        model.mesh.generate(2)

    # Normals that point outwards, whatever side gmsh has chosen.
    return gx.gmsh_mesh(build, comm, orient=True)


class Ring:
    """The scene at one overpressure [Pa], and the search for its equilibrium."""

    def __init__(self, comm: MPI.Intracomm, overpressure: float, size: float) -> None:
        self.film = gx.Membrane(torus(comm, size), FABRIC, name="ring")
        outside = gx.gas.Ambient(ATMOSPHERE, TEMPERATURE)
        gas = gx.Chamber(
            self.film,
            gas=AIR,
            pressure=ATMOSPHERE + overpressure,
            temperature=TEMPERATURE,
            outside=outside,
        )
        self.floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1), name="floor")
        self.contact = gx.Contact(self.film, self.floor, distance=DISTANCE)
        weight: Any = gx.Gravity(self.film, (0.0, 0.0, -GRAVITY))
        scene = gx.Scene(self.film, gas, self.contact, weight)
        # The fan holds the pressure, whatever the volume.
        self.statics = gx.Equilibrium(scene, gas="held pressure")

    def recording(self, folder: Path, title: str) -> gx.Recording:
        """Fields of the film with the pressure of contact, and the force and the least gap of
        contact."""
        fields = {"ring": ["displacement", "stress1", "state", "contact_pressure"]}
        probes: dict[str, Any] = {
            "push of the floor [N]": gx.probes.ContactForce(self.contact, self.film, axis="z"),
            "least gap [m]": gx.probes.ContactGap(self.contact),
        }
        return gx.Recording(folder, fields, probes=probes, title=title, overwrite=True)

    def radii_and_heights(self) -> tuple[Array, Array]:
        """Distances of this rank's nodes from the axis, and their heights above the floor [m]."""
        x = gx.fields.positions(self.statics, self.film)
        return np.hypot(x[:, 0], x[:, 1]), x[:, 2]

    def floor_pressure(self) -> float:
        """Median [Pa] of the contact pressure, of nodes that bear more than half of the largest.
        Collective."""
        _, pressure = gx.fields.field_values(self.statics, self.film, field="contact_pressure")
        everywhere = np.concatenate(self.film.comm.allgather(pressure))
        return float(np.median(everywhere[everywhere > 0.5 * everywhere.max()]))


def draw(rings: dict[str, Ring], path: Path) -> None:
    """The softest ring, and cross-sections of all."""
    figure = new_figure(10.0, 4.0)
    layout = figure.add_gridspec(1, 2, width_ratios=(1, 1))
    softest = next(iter(rings.values()))
    axes: Any = figure.add_subplot(layout[0], projection="3d")
    draw_film(axes, triangles(softest.statics.system, softest.film), view=(24.0, -60.0))
    half_size = RADIUS + TUBE_RADIUS
    axes.set(xlim=(-half_size, half_size), ylim=(-half_size, half_size), zlim=(0, 0.6 * half_size))
    axes.set_box_aspect((2, 2, 0.6), zoom=1.25)
    section = figure.add_subplot(layout[1])
    for (name, ring), colour in zip(rings.items(), (RED, GREEN, BLUE), strict=True):
        radii, heights = ring.radii_and_heights()
        section.plot(radii, heights, ".", color=colour, markersize=3, label=name)
    section.axhline(0.0, color="black", linewidth=1)
    section.set(aspect="equal")
    finish(section, "distance from the axis [m]", "height [m]", loc="center", markerscale=3)
    save(figure, path)


def main(
    output: str | Path | None = None, size: float = 0.04, comm: MPI.Intracomm = MPI.COMM_SELF
) -> dict[str, float]:
    """Push and pressure of the floor, and height, over their expected values at each pressure.

    Args:
        output: a folder: a recording and a report of each ring, and a picture.
        size: of the triangles [m].
        comm: one rank for the picture.
    """
    results = {}
    rings = {}
    weight = GRAVITY * FABRIC.density * FABRIC.thickness * 4 * math.pi**2 * RADIUS * TUBE_RADIUS
    for overpressure in OVERPRESSURES:
        name = f"{overpressure:g} Pa"
        ring = Ring(comm, overpressure, size)
        found = ring.statics.find()
        push = gx.probes.ContactForce(ring.contact, ring.film, axis="z")(ring.statics)
        _, heights = ring.radii_and_heights()
        height = comm.allreduce(float(heights.max(initial=0.0)), MPI.MAX)
        results[f"push/weight, {name}"] = push / weight
        results[f"floor pressure/overpressure, {name}"] = ring.floor_pressure() / overpressure
        results[f"height/diameter, {name}"] = height / (2 * TUBE_RADIUS)
        results[f"free motions, {name}"] = len(found.free)
        rings[name] = ring
        if output is not None:
            folder = Path(output) / f"ring_{overpressure:g}_Pa"
            gx.outputs.record(ring.statics, [ring.recording(folder, f"Ring at {name}")])
            if comm.rank == 0:
                gx.write_report(gx.plot.RunReader(folder), folder / "report.html")
    if output is not None and comm.rank == 0:
        draw(rings, Path(output) / "resting_ring.png")
    return results


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/resting_ring"))
