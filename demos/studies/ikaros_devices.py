"""IKAROS as built: how the steady shape and the spin depend on tapes, devices and creases.

Every row is an equilibrium of the demo `ikaros_devices` that differs from the sail "as built" in
one thing.  What follows from its shape: flatness, slack tethers, the spin that is left of that of
the flat sail, and the windmill torque of sunlight.  In flight the sail was flat and taut, some
tethers were slack at the normal spin, and the torque was -2.7e-5 N m (docs/measured.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

from demos.orbit.windmill import FLIGHT
from demos.sails.ikaros_devices import Build, figures, steady
from demos.studies.engine.study import Claim, Study
from gossamer_fx.extend import Result

AS_BUILT = "as built"
# What differs from the sail as built.
BUILDS = {
    AS_BUILT: Build(),
    "neither bending nor tapes": Build(bends=False, tape=0.0),
    "no bending": Build(bends=False),
    "no tapes": Build(tape=0.0),
    "tapes / 10": Build(tape=75.0),
    "tapes × 10": Build(tape=7500.0),
    "flat devices": Build(curvature=0.0),
    "curvature × 4": Build(curvature=2.0),
    "curvature × 4, other devices": Build(curvature=2.0, seed=2),
    "curvature × 4, all alike": Build(curvature=2.0, spread=0.0),
    "devices × 2 thick": Build(device=65e-6),
    "no creases": Build(crease=0.0),
    "creases × 10": Build(crease=1e-5),
    "half the cells": Build(refine=2),
}


# Torque [N m] below which the picture shows none: sails with mirror planes have the round-off of
# zero.
SMALLEST_TORQUE = 1e-11

# Torque [N m] that is recorded as none, a thousandth of what is claimed of such sails: its digits
# are those of a processor.
ROUND_OFF = 1e-15


def problem(comm: MPI.Comm, build: str, rpm: float) -> Mapping[str, float]:
    """The figures of one steady spin."""
    found = dict(figures(steady(comm, BUILDS[build], rpm)))
    if abs(found["torque"]) < ROUND_OFF:
        found["torque"] = 0.0
    return found


def draw(results: list[Result], path: Path) -> None:
    """Flatness, windmill torque and spin of every build, as bars; one colour for each spin."""
    from demos.common.figures import BLUE, GREEN, GREY, RED, new_figure, save

    figure = new_figure(width=11.0, height=5.2)
    axes = figure.subplots(1, 3, sharey=True)
    names = list(dict.fromkeys(str(result.values["build"]) for result in results))
    spins = sorted({float(result.values["rpm"]) for result in results})
    colours = [BLUE, RED, GREEN, GREY]
    height = 0.8 / len(spins)
    panels = (
        ("rms height", "rms height over the mean plane [mm]", False),
        ("torque", "|windmill torque| [N m]", True),
        ("spin change", "|change of the spin|, relative", True),
    )
    for panel, (name, label, is_logarithmic) in zip(axes, panels, strict=True):
        for k, spin in enumerate(spins):
            done = [r for r in results if float(r.values["rpm"]) == spin and not r.failed]
            rows = [names.index(str(r.values["build"])) + (k + 0.5) * height - 0.4 for r in done]
            values = [abs(r.numbers[name]) for r in done]
            panel.barh(rows, values, height=height, color=colours[k % 4], label=f"{spin:g} rpm")
        panel.set_xlabel(label)
        panel.grid(axis="x", alpha=0.3)
        if is_logarithmic:
            panel.set_xscale("log")
        if name == "torque":
            panel.set_xlim(left=SMALLEST_TORQUE)
    axes[1].axvline(abs(FLIGHT), color="black", linestyle=":")
    axes[1].annotate("flight ", (abs(FLIGHT), -0.45), ha="right", va="top", fontsize=8)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    axes[0].legend(frameon=False)
    figure.suptitle("IKAROS as built: the steady sail in sunlight")
    save(figure, path)


STUDY = Study(
    "ikaros_devices",
    "IKAROS as built: sensitivity of shape and spin to tapes, devices and creases",
    problem,
    {"rpm": [1.0, 2.5], "build": list(BUILDS)},
    lambda case: case["rpm"],
    quick={"rpm": [2.5], "build": ["neither bending nor tapes", "no bending"]},
    shows=("warp", "spin change"),
    claims=(
        # Of the table of docs/findings.md.
        Claim("rms height", 2.15, 2.28, {"rpm": 1.0, "build": "as built"}),
        Claim("rms height", 0.505, 0.536, {"rpm": 2.5, "build": "as built"}),
        Claim("rms height", 2.0, 2.1, {"rpm": 1.0, "build": "flat devices"}),
        Claim("rms height", 2.78, 2.94, {"rpm": 1.0, "build": "curvature × 4"}),
        Claim("rms height", 3.46, 3.66, {"rpm": 1.0, "build": "devices × 2 thick"}),
        # Without bending, and with flat devices, nothing drives a windmill.
        Claim("torque", -1e-12, 1e-12, {"build": "no bending"}),
        Claim("torque", -1e-12, 1e-12, {"build": "flat devices"}),
        Claim("torque", -9e-9, -6.5e-9, {"rpm": 1.0, "build": "as built"}),
        Claim("torque", 4e-7, 5e-7, {"rpm": 1.0, "build": "curvature × 4, other devices"}),
    ),
    columns=(
        "rms height, warp, rms tilt, taut, slack tethers, J, spin change, torque, iterations, "
        "residual, unknowns, seconds"
    ),
    # Where the film is slack there may be no equilibrium within the iterations.
    may_fail=True,
    draw=draw,
)
