"""When the memory of folds hinders a deployment, and when it helps: creases of a spinning disc and of a folded tube.

A fold of the angle θ0 that has a rest angle θr = s θ0 drives the film to this angle.  With the stiffness k per length,
opening it takes the work

    W = ½ k θ0² (2 s - 1)        per length,

so that an elastic crease gives energy for s < 1/2 and takes it for s > 1/2; at s = 1/2 it gives in the first half of the
way what it takes in the second one.  A plastic crease with the yield angle φ has the moment k φ at most, and takes

    W = k φ (θ0 - φ/2)           per length,    s = 1, φ < θ0.

The measure of the memory is the energy of all folds over that which drives the deployment,

    Π = Σ ½ k θ0² L / H,

with the kinetic energy at the start (disc), or pressure times volume of the tank (tube), as H.

A case is a sail, "disc" or "tube", with arguments of `demos/spin_deployment.py` or `demos/folded_tube.py`; without
arguments it has no creases.  The disc is open when the mean radius of its tips is `spin_deployment.OPEN` of that of the
flat disc, the tube when its tip is `folded_tube.ARRIVED` of its length from the clamp.  Against the case without
creases the memory

    prevents        if the sail is not open at the end,
    hinders         if it is open later by more than `VISIBLE`,
    helps           if it is open sooner by more than `VISIBLE`,
    has no effect   otherwise.

Folded film moves chaotically: some cases are computed again with the spin or the lift of the layers changed by 1e-9 of
itself times the number "nudge".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

from demos import folded_tube, spin_deployment
from demos.studies.engine.deployments import LEDGER, NUDGE
from demos.studies.engine.study import Result, Study

# Arguments of the demos that cases change by a nudge, and their values.
REV = 8.0
LIFT = 1e-4
# Ends of the runs [s]; without creases the disc is open after 0.15 s, the tube after 0.025 s.
ENDS = {"disc": 0.24, "tube": 0.035}
# Pressure [Pa] times volume [m³] of the tank of the tube.
TANK_ENERGY = 1.5e6 * 1e-6

# Smallest relative difference of opening times that counts; nudged starts differ by less.
VISIBLE = 0.05
EFFECTS = ("prevents", "hinders", "has no effect", "helps")

# Stiffness of creases [N m/m/rad].  The memory Π is 160 k of the disc and 0.5 k of the tube.
STIFFNESS = {"disc": ("0.0002", "0.002", "0.02"), "tube": ("0.02", "0.2", "2", "20")}
RATIOS = ("0", "0.5", "1")
# Yield angle of plastic creases [rad]: 20 degrees.
YIELD_ANGLE = "0.35"
ELASTIC = [
    f"{sail} crease={k} set_angle_ratio={ratio}"
    for sail, values in STIFFNESS.items()
    for k in values
    for ratio in RATIOS
    # A tube with a rest angle of half of the fold's is the case of the demo: one is enough.
    if sail == "disc" or ratio != "0.5" or k == "2"
]
PLASTIC = [
    f"{sail} crease={k} set_angle_ratio=1 yield_angle={YIELD_ANGLE}"
    for sail, values in STIFFNESS.items()
    for k in values[-2:]
]
# Starts that are nudged, and the accuracy of mesh and step.
REPEATED = (
    "tube nudge=1",
    "tube nudge=2",
    "tube crease=2 set_angle_ratio=1 nudge=1",
    "tube crease=2 set_angle_ratio=1 nudge=2",
    "disc nudge=1",
    "disc crease=0.002 set_angle_ratio=1 nudge=1",
)
ACCURACY = ("tube cells=6", "tube dt=5e-05")


def arguments(case: str) -> dict[str, float]:
    """Arguments of the demo that a case names."""
    given = dict(word.split("=") for word in case.split() if "=" in word)
    return {name: int(text) if name == "cells" else float(text) for name, text in given.items()}


def deploy(comm: MPI.Comm, sail: str, until: float, **given: float) -> dict[str, float]:
    """What `main` of a demo returns, with the memory, the time [s] of the opening, and the size at the end.

    The size is the mean radius of the tips over that of the flat disc, or the distance of the tip over the length.
    """
    factor = 1 + NUDGE * given.pop("nudge", 0.0)
    if sail == "disc":
        found = spin_deployment.main(until=until, comm=comm, rev=factor * REV, **given)
        driving = found["energy"] - found.get("crease_start", 0.0)
        opened = found["opened"]
        size = found["largest_radius"] / 0.5
    else:
        found = folded_tube.main(until=until, comm=comm, lift=factor * LIFT, **given)
        driving = TANK_ENERGY
        opened = found["arrived"]
        size = found["tip_distance"] / 0.25
    memory = found.get("fold_energy", 0.0) / driving
    return {**found, "memory": memory, "opened": opened, "size": size}


# Sails without creases that were deployed in this process, by sail, end of the run and number of ranks.
_WITHOUT: dict[tuple[str, float, int], dict[str, float]] = {}


def reference(comm: MPI.Comm, sail: str, until: float) -> dict[str, float]:
    """What `deploy` returns of the sail without creases; computed once."""
    key = (sail, until, comm.size)
    if key not in _WITHOUT:
        _WITHOUT[key] = deploy(comm, sail, until)
    return _WITHOUT[key]


def effect(opened: float, without: float) -> float:
    """Index in `EFFECTS` of a time of opening [s] against that without creases; nan if that is not open."""
    if not math.isfinite(without):
        return math.nan
    if not math.isfinite(opened):
        return EFFECTS.index("prevents")
    if opened > (1 + VISIBLE) * without:
        return EFFECTS.index("hinders")
    if opened < (1 - VISIBLE) * without:
        return EFFECTS.index("helps")
    return EFFECTS.index("has no effect")


def problem(comm: MPI.Comm, case: str, until: float | None = None) -> Mapping[str, float]:
    """Deploy a sail with creases; returns the figures of `deploy`, the delay against none, and the effect."""
    sail, *_ = case.split()
    end = ENDS[sail] if until is None else until
    without = reference(comm, sail, end)
    given = arguments(case)
    found = deploy(comm, sail, end, **given) if given else without
    delay = math.nan
    if math.isfinite(without["opened"]):
        delay = found["opened"] / without["opened"] - 1
    return {**found, "delay": delay, "effect": effect(found["opened"], without["opened"])}


def draw(results: list[Result], path: Path) -> None:
    """Delay of the opening, and size at the end, over the memory Π of the folds."""
    from demos.common.figures import BLUE, GREEN, GREY, RED, new_figure, save

    kinds = {
        "flat at rest": ("set_angle_ratio=0", GREEN),
        "rest at half of the fold angle": ("set_angle_ratio=0.5", BLUE),
        "rest in the fold": ("set_angle_ratio=1", RED),
        "plastic, folded by 20° more than it yields": ("yield_angle", GREY),
    }
    figure = new_figure(width=10.0, height=6.4)
    axes = figure.subplots(2, 2, sharex="col")
    titles = {"disc": "disc of film, deployed by its spin", "tube": "folded tube, deployed by gas"}
    for column, sail in enumerate(ENDS):
        delays, sizes = axes[:, column]
        done = [r for r in results if str(r.case["case"]).startswith(sail) and not r.failed]
        finite = [r.values["delay"] for r in done if math.isfinite(r.values["delay"])]
        # Sails that do not open are drawn above all delays.
        never = 1.25 * max([2 * VISIBLE, *finite])
        for label, (word, colour) in kinds.items():
            rows = [r for r in done if _kind(str(r.case["case"])) == word]
            memory = [r.values["memory"] for r in rows]
            delay = [min(r.values["delay"], never) for r in rows]
            for x, y in zip(memory, delay, strict=True):
                marker = "x" if y == never else "o"
                delays.plot(x, 100 * y, marker, color=colour)
            delays.plot(memory, [100 * y for y in delay], "-", color=colour, alpha=0.5)
            sizes.plot(memory, [r.values["size"] for r in rows], "o-", color=colour, label=label)
        delays.axhspan(-100 * VISIBLE, 100 * VISIBLE, color=GREY, alpha=0.15)
        delays.annotate(
            "× does not open",
            (0.02, 0.98),
            xycoords="axes fraction",
            va="top",
        )
        delays.set_title(titles[sail])
        for r in done:
            # The sail without creases, and its nudged starts, have no memory.
            if r.values["memory"] == 0 and "cells" not in str(r.case["case"]):
                sizes.axhline(r.values["size"], color="black", linewidth=0.8, linestyle=":")
        sizes.set_xscale("log")
        sizes.set_xlabel("Π: energy of the folds over that which drives")
        for panel in (delays, sizes):
            panel.grid(alpha=0.3)
    axes[0, 0].set_ylabel("opens later than without creases by [%]")
    axes[1, 0].set_ylabel("largest mean radius of the tips / radius")
    axes[1, 1].set_ylabel("distance of the tip at the end / length")
    handles, labels = axes[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    save(figure, path)


def _kind(case: str) -> str:
    """The word of a case by which the picture tells creases apart; empty without creases."""
    if "yield_angle" in case:
        return "yield_angle"
    return next((word for word in case.split() if word.startswith("set_angle_ratio")), "")


STUDY = Study(
    "fold_memory",
    "Memory of folds: when it hinders a deployment, and when it helps",
    problem,
    {"case": ["disc", *ELASTIC, *PLASTIC, "tube", *REPEATED, *ACCURACY]},
    lambda case: 1.0,
    quick={
        "case": [
            "disc crease=0.002 set_angle_ratio=1",
            "tube crease=2 set_angle_ratio=1 yield_angle=0.35",
        ]
    },
    quick_options={"until": 2e-3},
    columns=(
        "memory",
        "effect",
        "opened",
        "delay",
        "size",
        "crease_angle",
        "crease_start",
        "crease_end",
        "crease_loss",
        *LEDGER,
    ),
    may_fail=True,
    draw=draw,
)
