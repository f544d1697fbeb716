"""How do I start an inflatable folded, without initial tension?

Mesh the cutting pattern, not the folded figure.  The mesh is the stress-free shape of a film; where
the film is at the start is given apart, by a fold map or by `displacement`.  A map of `gx.fold` is
isometric: it changes no length, so the strain energy of the folded start is round-off,

    folds.start(film).strain_energy()           1e-27 J with `pressed()`, layers on each other

and the inflated bag has the size of its pattern, whatever the folds were.  Here a tube of two flat
sheets is folded to an accordion and inflated: its volume and its energy are those of the tube that
was inflated from flat, to round-off.  A mesh of a drawn folded figure has the lengths of the
drawing instead: wherever the drawing cheats, the inflated bag is too small or too large, for ever.

With `Contact` layers have to start apart, by `opening` (a pillow between folds) and `lift` (at the
folds).  These stretch the film a little: the energy grows as opening⁴.  With 1 mm it is 0.5 mJ
here, a third of what the inflated film has; with a tenth of a millimetre it is 5e-8 J, which nobody
sees.

Where the values come from:
    film               polyimide, Kapton HN 100: `gossamer_fx.presets.films`
    sizes, pressure    chosen: 0.24 m × 50 mm when round, 2 kPa

    ./gossamer demo folded_bag
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, draw_film, finish, new_figure, save, triangles
from gossamer_fx.extend import Array
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN

LENGTH = 0.24  # m
DIAMETER = 0.05  # of the round tube [m]
PANELS = 4
FILM = KAPTON_HN.law(25e-6, residual_stiffness=1e-4)


def accordion(opening: float = 1e-4) -> gx.fold.Zigzag:
    """Four panels that rise and fall by 70°, whose two sheets are apart by up to twice the opening
    [m]."""
    # The opening is half of the distance between the two sheets in the middle of a panel.
    return gx.fold.Zigzag(
        LENGTH,
        PANELS,
        angle=math.radians(70.0),
        width=math.pi * DIAMETER / 2,
        opening=opening,
    )


def build(comm: MPI.Intracomm, folded: bool = True, cells: int = 6) -> gx.Equilibrium:
    """The tube under 2 kPa, with `cells` cells across; its first guess is folded or flat."""
    film = gx.Membrane(flat_tube(comm, LENGTH, DIAMETER, cells, PANELS), FILM)
    items = [
        gx.Pressure(film, 2e3),
        gx.Fixed(film, "inlet"),
        # The tube does not turn about its inlet.
        gx.Fixed(film, "tip", components=(2,)),
    ]
    if folded:
        items.append(accordion().start(film))
    return gx.Equilibrium(gx.Scene(film, *items))


def start_energies(openings: Array, cells: int = 6) -> Array:
    """Strain energy [J] of the folded start for several openings [m]."""
    film = gx.Membrane(flat_tube(MPI.COMM_SELF, LENGTH, DIAMETER, cells, PANELS), FILM)
    return np.array([accordion(opening).start(film).strain_energy() for opening in openings])


def draw(shapes: dict[str, Array], openings: Array, energies: Array, path: Path) -> None:
    """The tube folded and inflated, and the energy of the start against the opening."""
    figure = new_figure(10.0, 3.6)
    layout = figure.add_gridspec(1, 3, width_ratios=(0.8, 1.3, 1.2))
    for place, (title, corners) in enumerate(shapes.items()):
        axes = figure.add_subplot(layout[place], projection="3d")
        draw_film(axes, corners, view=(22.0, -65.0))
        axes.set_title(title)
    plot = figure.add_subplot(layout[2])
    plot.loglog(1e3 * openings, energies, "o", color=BLUE, label="strain energy of the start")
    # The law opening⁴, through the last point.
    fourth = energies[-1] * (openings / openings[-1]) ** 4
    plot.loglog(1e3 * openings, fourth, color=GREY, label="opening$^4$")
    finish(plot, "opening [mm]", "energy [J]")
    save(figure, path)


def main(output: str | Path | None = None, cells: int = 6) -> dict[str, float]:
    """Energies of starts [J]; volume and energy of the inflated tube from folded over those from
    flat."""
    found = {}
    shapes = {}
    for folded in (False, True):
        search = build(MPI.COMM_SELF, folded, cells)
        film = next(item for item in search.scene.items if isinstance(item, gx.Membrane))
        start = triangles(search.system, film)
        energy = search.find().totals.stored[film.name]
        inflated = triangles(search.system, film)
        found[folded] = (gx.analysis.EnclosedVolume(film)(search), energy)
        shapes = {"folded": start, "inflated from there": inflated}
    # A decade: enough to see the fourth power.
    openings = np.array([1e-4, 2e-4, 5e-4, 1e-3])
    energies = start_energies(openings, cells)
    if output is not None:
        draw(shapes, openings, energies, Path(output) / "folded_bag.png")
    pressed = accordion().pressed().start(film).strain_energy()
    return {
        "energy of the pressed start [J]": pressed,
        "energy with an opening of 0.1 mm [J]": float(energies[0]),
        "energy with an opening of 1 mm [J]": float(energies[-1]),
        "energy inflated [J]": found[True][1],
        "volume, folded over flat start, less 1": found[True][0] / found[False][0] - 1,
        "energy, folded over flat start, less 1": found[True][1] / found[False][1] - 1,
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/folded_bag"))
