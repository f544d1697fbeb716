"""How do I fold paper so that it remembers the crease?

Give a `Crease` a `yield_angle` φ.  Its moment per length is k (θ - θr); where |θ - θr| would exceed
φ, the rest angle θr follows the fold angle θ, and the work is dissipated: a hinge that is elastic
up to the moment k φ and plastic from there.  Folded from flat to θ_max and let go, the sheet stays
at

    θr = θ_max - φ,   dissipated per length  k φ θr

On a `Plate` the line of the crease is also one of its `hinges`: the panels bend elastically, and
the crease alone carries the moment between them.  Here a thread draws the ends of a strip of paper
together until θ = 125°, then slackens: the strip stays folded by 100°, and angle and loss are as
above to 1e-6.  The rest angle is part of the state: it is in checkpoints, and `StartFrom` keeps it.

What it does not know: real paper goes on opening for hours (a logarithm of time) and weakens with
each fold.  Measure k and θr with your film: `identify_crease` of
`demos.common.crease_identification`.

Where the values come from:
    model, stiffness   k = B/L*, L* of 10 to 100 thicknesses, here 100: Lechenault, Thiria &
                       Adda-Bedia (2014), doi:10.1103/PhysRevLett.112.244301
    paper              office paper: 0.1 mm, 80 g/m², about 3 GPa
    yield angle        chosen: 25°

    ./gossamer demo paper_crease
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from gossamer_fx.extend import Array
from gossamer_fx.meshes.creased_strip import creased_strip

PANEL = 0.02  # length of a panel [m]
WIDTH = 0.03  # m
PAPER = gx.Linear(E=3e9, nu=0.3, density=800.0, thickness=1e-4)
BENDING = PAPER.E * PAPER.thickness**3 / 12 / (1 - PAPER.nu**2)  # N m
STIFFNESS = BENDING / (100 * PAPER.thickness)  # of the crease [N m/m/rad]
YIELD_ANGLE = math.radians(25.0)
# Angle between the panels and the line of their ends, at the start and when the thread is shortest.
SLIGHTLY = math.radians(10.0)
FOLDED = math.radians(80.0)


@dataclass(frozen=True)
class Paper:
    """A strip of paper, its crease, and the search for its equilibria."""

    plate: gx.Plate
    crease: gx.connectors.Crease
    statics: gx.Equilibrium

    def angle(self) -> float:
        """Angle of the fold [rad], zero if flat."""
        return float(gx.probes.FoldAngle(self.crease).of(self.statics.system))

    def side_view(self) -> Array:
        """Positions (2, n) [m] along the strip, its crease at the origin and its ends up."""
        X = self.plate.space.tabulate_dof_coordinates()
        x = self.statics.system.unknowns.state[self.plate].local_positions()
        rim = np.flatnonzero(np.isclose(X[:, 1], 0.0))
        rim = rim[np.argsort(X[rim, 0])]
        points = x[rim][:, [0, 2]]
        points -= points[len(points) // 2]
        # Nothing keeps the strip from turning about its crease.
        up = points[0] + points[-1]
        up /= np.linalg.norm(up)
        right = np.array([up[1], -up[0]])
        return np.stack([points @ right, points @ up])


def thread_length(t: float) -> float:
    """Length [m] of the thread: shortest at t = 1, slack again from t = 2 on."""
    share = min(t, 2.0 - t)
    if share <= 0 and t > 1:
        return 2 * PANEL
    return 2 * PANEL * math.cos(SLIGHTLY + (FOLDED - SLIGHTLY) * share)


def build(comm: MPI.Intracomm, cells: int = 6) -> Paper:
    """The strip, slightly bent so that it folds to one side, and the thread between its ends."""
    c = math.cos(SLIGHTLY)
    s = math.sin(SLIGHTLY)
    plate = gx.Plate(
        creased_strip(comm, cells, 2, PANEL, WIDTH),
        PAPER,
        hinges=["crease"],
        displacement=lambda X: np.stack([(c - 1) * X[0], 0 * X[1], s * abs(X[0])]),
    )
    crease = gx.connectors.Crease(plate, "crease", stiffness=STIFFNESS, yield_angle=YIELD_ANGLE)
    left = plate.port_at((-PANEL, WIDTH / 2, 0.0))
    right = plate.port_at((PANEL, WIDTH / 2, 0.0))
    thread = gx.connectors.Tether(left, right, stiffness=1e3, length=thread_length)
    hold = gx.Fixed(plate, "crease")
    return Paper(plate, crease, gx.Equilibrium(gx.Scene(plate, crease, thread, hold)))


def draw(angles: Array, moments: Array, views: dict[str, Array], path: Path) -> None:
    """The strip from its side, and moment of the crease against its angle."""
    figure = new_figure()
    side, plot = figure.subplots(1, 2)
    for (name, view), colour in zip(views.items(), (GREY, RED, BLUE), strict=True):
        side.plot(*(1e3 * view), color=colour, linewidth=2.5, label=name)
    side.set(aspect="equal", ylim=(-2, 28))
    finish(side, "mm", "mm", ncols=3, loc="upper center")
    elastic_plastic = np.degrees([0.0, YIELD_ANGLE, angles.max(), angles.max() - YIELD_ANGLE])
    limit = 1e3 * STIFFNESS * YIELD_ANGLE
    plot.plot(elastic_plastic, [0, limit, limit, 0], color=GREY, label="closed form")
    plot.plot(np.degrees(angles), 1e3 * moments, "o", color=RED, markersize=4, label="plate")
    finish(plot, "angle of the fold [°]", "moment of the crease [mN m/m]")
    save(figure, path)


def main(
    output: str | Path | None = None, steps: int = 10, comm: MPI.Intracomm = MPI.COMM_SELF
) -> dict[str, float]:
    """Fold and let go in `steps` equilibria each; angles, and loss over its closed form; picture in
    `output`."""
    paper = build(comm)
    angles = []
    moments = []
    views = {}
    for t in np.linspace(0.0, 2.0, 2 * steps + 1):
        found = paper.statics.find(at=float(t))
        angles.append(paper.angle())
        # The energy of the crease is ½ W m²/k.
        stored = found.totals.stored["crease"]
        moments.append(math.sqrt(2 * stored * STIFFNESS / WIDTH))
        name = {0.0: "before", 1.0: "folded", 2.0: "let go"}.get(float(t))
        if name is not None and comm.size == 1:
            views[name] = paper.side_view()
    if output is not None and views:
        draw(np.array(angles), np.array(moments), views, Path(output) / "paper_crease.png")
    remembered = angles[-1]
    loss = STIFFNESS * YIELD_ANGLE * remembered * WIDTH
    return {
        "largest angle [deg]": math.degrees(max(angles)),
        "angle that stays [deg]": math.degrees(remembered),
        "angle that stays over largest less yield angle": remembered / (max(angles) - YIELD_ANGLE),
        "loss over closed form": found.totals.losses["crease"] / loss,
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/paper_crease"))
