"""Rest angle and stiffness of a crease, from a folded strip that hangs under weights.

The experiment with which the crease model of solar sails was fitted (Miyazaki, final report of
grant 19360384, 2009, fig. 6): a folded strip of film carries a weight; the angle of its fold and
its length are measured before and after. Here a fine plate with a known crease stands for the
strip, and errors of half a degree and 0.2 mm for what a ruler misses.  `identify_crease` finds rest
angle and stiffness, and how well they are known, by hinge and elastica.

    ./gossamer demo crease_identification
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.studies.crease import folded
from gossamer_fx.analysis.design.crease_identification import GRAVITY
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.creased_strip import creased_strip

LENGTH = 0.05  # of a panel [m]
WIDTH = 0.015  # of a panel [m]
LAW = gx.Linear(E=3.0e9, nu=0.3, density=1420.0, thickness=50e-6)  # polyimide
# The values that are to be identified: rest angle [rad] and stiffness [N m/m/rad].
REST = math.radians(105.0)
STIFFNESS = 3e-3
WEIGHTS = (0.0, 2e-4, 5e-4, 1e-3, 2e-3, 4e-3)  # at the end of the strip [N]
# Standard deviations of the measured angle [rad] and distance [m].
ANGLE_ERROR = math.radians(0.5)
DISTANCE_ERROR = 2e-4
# a strip whose width is large compared with √(radius × thickness) bends as a wide plate does
STRIP = gx.analysis.HangingStrip(
    LENGTH,
    WIDTH,
    bending_stiffness=LAW.E * LAW.thickness**3 / 12 / (1 - LAW.nu**2),
    area_density=LAW.density * LAW.thickness,
)


@dataclass(frozen=True)
class Hanging:
    """A strip under a weight [N]: angle of its crease [rad], distance of its ends, side view of its
    rim (2, n) [m]."""

    weight: float
    angle: float
    distance: float
    shape: Array


def hang(weight: float, cells: int = 16) -> Hanging:
    """The equilibrium of the plate; down is x, and the left end turns freely."""
    plate = gx.Plate(
        creased_strip(MPI.COMM_SELF, cells, 3, LENGTH, WIDTH),
        LAW,
        hinges=["crease"],
        displacement=folded(REST),
    )
    crease = gx.connectors.Crease(plate, "crease", stiffness=STIFFNESS, rest_angle=REST)
    items = [plate, crease, gx.Fixed(plate, "left"), gx.Gravity(plate, (GRAVITY, 0.0, 0.0))]
    if weight:
        items.append(gx.loads.EdgeLoad(plate, "right", force=(weight / WIDTH, 0.0, 0.0)))
    search = gx.Equilibrium(gx.Scene(*items))
    search.find()
    X = plate.space.tabulate_dof_coordinates()
    x = search.system.q0.array_r.reshape(-1, 3)
    rim = np.flatnonzero(np.isclose(X[:, 1], 0.0))
    rim = rim[np.argsort(X[rim, 0])]
    ends = [x[plate.nodes(side)].mean(axis=0) for side in ("left", "right")]
    distance = float(np.linalg.norm(ends[1] - ends[0]))
    return Hanging(
        weight,
        gx.probes.FoldAngle(crease).of(search.system),
        distance,
        (x[rim] - ends[0])[:, [2, 0]].T,
    )


def experiment(cells: int = 16, seed: int = 0) -> tuple[list[Hanging], Array, Array]:
    """The strip under all weights, and angles [rad] and distances [m] as they are measured."""
    random = np.random.default_rng(seed)
    strips = [hang(weight, cells) for weight in WEIGHTS]
    angles = np.array([s.angle for s in strips]) + ANGLE_ERROR * random.normal(size=len(strips))
    distances = np.array([s.distance for s in strips]) + DISTANCE_ERROR * random.normal(
        size=len(strips)
    )
    return strips, angles, distances


def draw(
    strips: list[Hanging],
    angles: Array,
    distances: Array,
    found: gx.analysis.IdentifiedCrease,
    path: Path,
) -> None:
    """Side views of the strip; angle and distance over weight, measured and by the crease that was
    found."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(
        figsize=(11, 4.2),
        dpi=100,
        facecolor="white",
        layout="constrained",
    )
    side, left, right = figure.subplots(1, 3, width_ratios=[0.6, 1, 1])
    for k, strip in enumerate(strips):
        shade = 0.15 + 0.75 * k / len(strips)
        side.plot(
            *(1e3 * strip.shape), color=(shade, 0.35, 1 - shade), label=f"{1e3 * strip.weight:g} mN"
        )
    side.invert_yaxis()
    side.set(aspect="equal", xlabel="mm", ylabel="down [mm]", title="The hanging strip")
    side.set_xlim(-20, 75)
    side.legend(
        fontsize=8,
        frameon=False,
        title="weight",
        title_fontsize=8,
        loc="upper right",
    )
    curve = max(WEIGHTS) * np.linspace(0, 1, 30) ** 2
    states = np.array(
        [STRIP.equilibrium(found.rest_angle, found.stiffness, float(w)) for w in curve]
    )
    scales = ((left, 180 / math.pi, angles, ANGLE_ERROR, "angle of the crease [°]"),)
    scales += ((right, 1e3, distances, DISTANCE_ERROR, "distance of the ends [mm]"),)
    for i, (axes, scale, values, error, label) in enumerate(scales):
        axes.plot(
            1e3 * curve,
            scale * states[:, i],
            color=(0.1, 0.35, 0.7),
            label="identified",
        )
        for factor, style in ((10, "--"), (0.1, ":")):
            other = [
                STRIP.equilibrium(found.rest_angle, factor * found.stiffness, float(w))[i]
                for w in curve
            ]
            axes.plot(
                1e3 * curve,
                scale * np.array(other),
                style,
                color="grey",
                label=f"stiffness × {factor:g}",
            )
        axes.errorbar(
            1e3 * np.array(WEIGHTS),
            scale * values,
            yerr=scale * error,
            fmt="o",
            color=(0.8, 0.2, 0.1),
            label="measured",
        )
        axes.set(xlabel="weight [mN]", ylabel=label)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, frameon=False)
    figure.suptitle(
        f"rest angle {math.degrees(found.rest_angle):.1f}° ± "
        f"{math.degrees(found.rest_angle_error):.1f}°, stiffness "
        f"({1e3 * found.stiffness:.2f} ± {1e3 * found.stiffness_error:.2f}) mN m/(m rad);  "
        f"in the plate {math.degrees(REST):.1f}°, {1e3 * STIFFNESS:.2f}",
        fontsize=11,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(str(path))


def main(output: str | Path | None = None, cells: int = 16, seed: int = 0) -> dict[str, float]:
    """What was found, over what the plate has; errors over their standard deviations; a picture in
    `output`.

    "angle × 10" and "angle / 10": how far the angle under the largest weight [°] would be off with
    a stiffness ten times as large or small.
    """
    strips, angles, distances = experiment(cells, seed)
    found = gx.analysis.identify_crease(
        STRIP,
        WEIGHTS,
        angles=angles,
        distances=distances,
        angle_uncertainty=ANGLE_ERROR,
        distance_uncertainty=DISTANCE_ERROR,
    )
    if output is not None:
        draw(strips, angles, distances, found, Path(output) / "crease_identification.png")
    at = [
        STRIP.equilibrium(found.rest_angle, factor * found.stiffness, max(WEIGHTS))[0]
        for factor in (1, 10, 0.1)
    ]
    return {
        "rest angle [deg]": math.degrees(found.rest_angle),
        "its standard deviation [deg]": math.degrees(found.rest_angle_error),
        "rest angle error/deviation": (found.rest_angle - REST) / found.rest_angle_error,
        "stiffness [N m/m/rad]": found.stiffness,
        "its standard deviation [N m/m/rad]": found.stiffness_error,
        "stiffness error/deviation": (found.stiffness - STIFFNESS) / found.stiffness_error,
        "misfit": found.misfit,
        "angle × 10 [deg]": math.degrees(at[1] - at[0]),
        "angle / 10 [deg]": math.degrees(at[2] - at[0]),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/crease_identification"))
