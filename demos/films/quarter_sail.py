"""Six modes of a quarter of a square sail between two booms, on four meshes: which mesh is good
enough?

A triangle of film has curved edges with cords in them, and three cables: from its right angle to
the hub, from its other corners to the tips of two booms.  Straight free edges bear no stress across
them, and their frequencies depend on the mesh.  Edges that are arcs of radius R with a cord of the
tension T = σ t R keep the film under the uniform stress σ, so that all six frequencies converge.

The cables pull in the direction of both cords together.  At the tip of a boom this is not along the
boom, which bends; the search for the equilibrium finds how far.

The triangles are curved (order 2), as the arcs are.  A polygon of straight sides would have the
force of the cords at its corners only, slack film between them, and further slow modes there.

Where the values come from:
    film              Kapton HN of 7.5 µm, the thickness of the film of IKAROS
    stress            chosen: 50 kPa
    booms             chosen: carbon tubes, 60 mm across, 0.5 mm thick, 100 GPa
    cords, cables     chosen: 50 kN per unit strain; 20 N/m

    ./gossamer demo quarter_sail
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.arcs import arc_mesh, arcs, corner_pulls, radii_of
from gossamer_fx.extend import Array
from gossamer_fx.meshes.line import line
from gossamer_fx.presets.films import KAPTON_HN

CORNERS = np.array([(0.3, 0.3, 0.0), (4.3, 0.3, 0.0), (0.3, 4.3, 0.0)])  # m
NAMES = ("root", "tip x", "tip y")
SAG = 0.06  # depth of the arcs over their chords
STRESS = 5e4  # Pa
THICKNESS = 7.5e-6  # m
CORD = gx.TensionOnly(EA=5e4, line_density=1e-3)
# Soft, so that the booms, which bend towards the sail, take back little of its stress
CABLE_STIFFNESS = 20.0  # N/m
BOOM = gx.sections.tube(0.03, 5e-4, E=100e9, nu=0.3, density=1600.0)
BOOM_CELLS = 8
MODES = 6
MESHES = (4, 8, 16, 32)  # cells along each edge
REFERENCE = 48


EDGES = arcs(CORNERS[:, :2], radii_of(CORNERS[:, :2], SAG))
# Of both cords on each corner (3, 3), which its cable balances [N].
PULLS = np.pad(corner_pulls(EDGES, STRESS * THICKNESS), ((0, 0), (0, 1)))


def triangle(comm: MPI.Intracomm, cells: int) -> gx.Mesh:
    """The sail of curved triangles, with its corners and edges as groups."""

    def generate(model: Any, curves: list[int], surface: int) -> None:
        for curve in curves:
            model.mesh.setTransfiniteCurve(curve, cells + 1)
        model.mesh.setTransfiniteSurface(surface)
        model.mesh.generate(2)
        model.mesh.setOrder(2)

    return arc_mesh(comm, EDGES, NAMES, generate)


def build(comm: MPI.Intracomm, cells: int) -> gx.Equilibrium:
    """The sail with its booms, before its equilibrium is found."""
    # Film that resists compression would buckle, and its equilibrium would not be stable.
    law = KAPTON_HN.law(THICKNESS, residual_stiffness=1e-4)
    sail = gx.Membrane(triangle(comm, cells), law, order=2, initial_stress=STRESS, name="sail")
    items: list[Any] = [sail]
    for number, arc in enumerate(EDGES):
        cord = gx.connectors.Tape.along_edges(
            sail,
            CORD,
            edges=f"edge {number}",
            # Shorter than the edge by the strain of its tension.
            length_factor=1 - STRESS * THICKNESS * arc.radius / CORD.EA,
            name=f"cord {number}",
        )
        items.append(cord)
    hub = (0.0, 0.0, 0.0)
    items.append(cable(sail, 0, gx.Ground(hub), np.array(hub)))
    for corner, axis in ((1, 0), (2, 1)):
        pull = PULLS[corner]
        # The tip lies on the axis of its boom, where the line of the cable meets it.
        across = 1 - axis
        tip = CORNERS[corner] - pull * CORNERS[corner][across] / pull[across]
        mesh = line(comm, [hub, tuple(tip)], BOOM_CELLS)
        boom = gx.Beam(mesh, BOOM, name=f"boom {'xy'[axis]}")
        items += [boom, gx.Fixed(boom, "start", rotation=True)]
        items.append(cable(sail, corner, boom.port("end"), tip))
    return gx.Equilibrium(gx.Scene(*items))


def cable(sail: gx.Membrane, corner: int, end: Any, at: Array) -> gx.connectors.Spring:
    """The cable from a corner to a port at a point, with the tension that balances the cords."""
    length = float(np.linalg.norm(at - CORNERS[corner]))
    tension = float(np.linalg.norm(PULLS[corner]))
    return gx.connectors.Spring(
        sail.port(NAMES[corner]),
        end,
        stiffness=CABLE_STIFFNESS,
        length=length - tension / CABLE_STIFFNESS,
        name=f"cable {NAMES[corner]}",
    )


def frequencies(comm: MPI.Intracomm, cells: int) -> dict[str, float]:
    """The lowest frequencies [Hz] by name."""
    sail = build(comm, cells)
    sail.find()
    found = gx.analysis.modes(sail, MODES)
    return {f"mode {k}": mode.frequency for k, mode in enumerate(found, start=1)}


def main(
    output: str | Path | None = None,
    meshes: tuple[int, ...] = MESHES,
    reference: int = REFERENCE,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> gx.analysis.Convergence:
    """Frequencies on several meshes, with errors against that of a finer one.

    Args:
        output: a folder: pictures of the errors and of the modes, an animation of the first one.
        meshes: cells along each edge.
        reference: cells of the mesh to which errors refer.
        comm: one rank for the pictures.
    """
    exact = frequencies(comm, reference)
    study = gx.analysis.convergence(
        lambda cells: frequencies(comm, cells), meshes=meshes, exact=exact
    )
    if output is not None:
        folder = Path(output)
        sail = build(comm, meshes[-1])
        sail.find()
        found = gx.analysis.modes(sail, MODES)
        recorded = gx.outputs.record_modes(sail, found, folder / "modes", overwrite=True)
        if comm.rank == 0:
            gx.plot.modes(recorded, folder / "quarter_sail.png")
            first = gx.plot.RunReader(recorded[0])
            gx.plot.animate(first, "mode_amplitude", path=folder / "first.gif", seconds=2.0)
            study.plot(folder / "errors.png")
    return study


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print(main(output="out/quarter_sail").table())
