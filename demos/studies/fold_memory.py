"""When the memory of folds hinders a deployment, and when it helps: creases of a spinning disc and
of a folded tube.

A fold of the angle θ0 that has a rest angle θr = s θ0 drives the film to this angle.  With the
stiffness k per length, opening it takes the work

    W = ½ k θ0² (2 s - 1)        per length,

so that an elastic crease gives energy for s < 1/2 and takes it for s > 1/2; at s = 1/2 it gives
until the fold is half open, and takes as much after that.  A plastic crease with the yield angle φ
has the moment k φ at most, and takes

    W = k φ (θ0 - φ/2)           per length,    s = 1, φ < θ0.

The measure of the memory is the energy of all folds over that which drives the deployment,

    Π = Σ ½ k θ0² L / H,

with the kinetic energy at the start (disc), or pressure times volume of the tank (tube), as H.

A case is a sail, "disc" or "tube", with arguments of the demo `spin_deployment` or the scene
demos/common/flat_rooted_tube.py; without arguments it has no creases, and its film has a loss
factor of 0.01.  The disc is open when the mean radius of its tips is `spin_deployment.OPEN` of that
of the flat disc, the tube when its tip is `flat_rooted_tube.ARRIVED` of its length from the clamp.
"Halfway" is the time at which the tip is `flat_rooted_tube.HALFWAY` of the length from the clamp.
Against the case without creases the memory

    prevents        if the sail is not open at the end,
    hinders         if it is open later by more than `VISIBLE`,
    helps           if it is open sooner by more than `VISIBLE`,
    has no effect   otherwise.

Folded film moves chaotically: some cases are computed again with the spin or the lift of the layers
changed by 1e-9 of itself times the number "nudge".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

from demos.common import flat_rooted_tube
from demos.sails import spin_deployment
from demos.studies.engine.deployments import LEDGER, NUDGE, arguments
from demos.studies.engine.study import Study
from gossamer_fx.extend import Result

# Arguments of the demos that cases change by a nudge, and their values.
REV = 8.0
LIFT = 1e-4
# The tube of the study is shorter than that of the demo and has one fold; its tank is smaller in
# proportion [m, m³].
TUBE = {"length": 0.16, "panels": 2, "tank": 0.64e-6}
# Sides of the hub: the disc of the demo has six, and takes three times the CPU time.
SIDES = 4
# Ends of the runs [s]; without creases the disc is open after 0.16 s, the tube after 0.014 s.
# A tube that is filled from a tank of a tenth of the pressure is open after 0.030 s.
ENDS = {"disc": 0.24, "tube": 0.02}
SLOW_END = 0.05
# A valve of 0.15 mm has a seventh of the flow: half of the length takes 34 ms, 0.9 of it 130.
SMALL_VALVE = "bore=0.00015 dt=0.0002"
SMALL_VALVE_END = 0.15
# Pressures of the tank [Pa]: that of the demo, and one for which real creases matter.
FULL = 1.5e6
LOW = 1.5e5

# Smallest relative difference of opening times that counts; nudged starts differ by less.
VISIBLE = 0.05
EFFECTS = ("prevents", "hinders", "has no effect", "helps")

# Yield angle of plastic creases [rad]: 20 degrees.
YIELD_ANGLE = "0.35"
# Stiffness of creases [N m/m/rad] over three decades.  The memory Π of the disc is 115 times as
# large.
DISC = [
    f"disc crease={k} set_angle_ratio={ratio}"
    for k, ratios in {
        "0.0002": ("0", "1"),
        "0.002": ("0", "0.5", "1"),
        "0.02": ("0.5", "1"),
    }.items()
    for ratio in ratios
]
PLASTIC_DISC = [
    f"disc crease={k} set_angle_ratio=1 yield_angle={YIELD_ANGLE}" for k in ("0.002", "0.02")
]
# At a quarter of the spin Π is 16 times as large: creases of 2e-4 N m/m/rad, which film of 7.5 µm
# has, store a third of the kinetic energy.
SLOW_DISC = [
    "disc rev=2",
    "disc rev=2 crease=0.0002 set_angle_ratio=0",
    "disc rev=2 crease=0.0002 set_angle_ratio=1",
    "disc rev=2 crease=0.002 set_angle_ratio=0",
    "disc rev=2 crease=0.002 set_angle_ratio=1",
]
# Π of the tube is 0.4 times the stiffness at full pressure.  Creases of more than 0.2 N m/m/rad
# snap in steps of microseconds: a larger Π is that of less pressure.
TUBE_CASES = [
    "tube",
    "tube loss_factor=0",
    "tube crease=0.2 set_angle_ratio=1 yield_angle=0.35",
    f"tube pressure={LOW:g}",
    f"tube pressure={LOW:g} loss_factor=0",
    f"tube pressure={LOW:g} crease=0.02 set_angle_ratio=0",
    f"tube pressure={LOW:g} crease=0.02 set_angle_ratio=1",
    f"tube pressure={LOW:g} crease=0.2 set_angle_ratio=0",
    f"tube pressure={LOW:g} crease=0.2 set_angle_ratio=1",
]
# Gas that flows slowly leaves the creases more time.
SMALL_VALVE_CASES = [
    f"tube pressure={LOW:g} {SMALL_VALVE}",
    f"tube pressure={LOW:g} {SMALL_VALVE} crease=0.005 set_angle_ratio=0",
    f"tube pressure={LOW:g} {SMALL_VALVE} crease=0.02 set_angle_ratio=0",
]
# Film that loses as much as polymer films do: far less than a damping time of 0.1 ms.
LOSS_FACTOR = f"damping=0 loss_factor={flat_rooted_tube.LOSS_FACTOR:g}"
LITTLE_DAMPING = [
    f"disc {LOSS_FACTOR}",
    f"disc {LOSS_FACTOR} crease=0.002 set_angle_ratio=1",
    f"disc {LOSS_FACTOR} crease=0.02 set_angle_ratio=0.5",
    f"disc {LOSS_FACTOR} crease=0.02 set_angle_ratio=1",
    f"disc rev=2 {LOSS_FACTOR}",
    f"disc rev=2 {LOSS_FACTOR} crease=0.0002 set_angle_ratio=0",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=0",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=1",
]
# Starts that are nudged, and the accuracy of mesh and step.
REPEATED = (
    f"disc {LOSS_FACTOR} nudge=1",
    f"disc {LOSS_FACTOR} crease=0.002 set_angle_ratio=1 nudge=1",
    f"disc {LOSS_FACTOR} crease=0.02 set_angle_ratio=0.5 nudge=1",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=0 nudge=1",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=0 nudge=2",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=0 nudge=-1",
    f"disc rev=2 {LOSS_FACTOR} crease=0.002 set_angle_ratio=1 nudge=1",
    "disc nudge=1",
    "disc crease=0.002 set_angle_ratio=1 nudge=1",
    "disc rev=2 nudge=1",
    "disc rev=2 crease=0.0002 set_angle_ratio=0 nudge=1",
    "disc rev=2 crease=0.0002 set_angle_ratio=0 nudge=2",
    f"tube pressure={LOW:g} nudge=1",
    f"tube pressure={LOW:g} {SMALL_VALVE} nudge=1",
    f"tube pressure={LOW:g} {SMALL_VALVE} crease=0.005 set_angle_ratio=0 nudge=1",
    f"tube pressure={LOW:g} {SMALL_VALVE} crease=0.005 set_angle_ratio=0 nudge=2",
)
ACCURACY = (
    "disc largest=0.0005",
    "disc rev=2 cells=2",
    "disc rev=2 crease=0.0002 set_angle_ratio=0 cells=2",
    "disc rev=2 crease=0.002 set_angle_ratio=0 cells=2",
    "disc rev=2 cells=3",
    "disc rev=2 crease=0.0002 set_angle_ratio=0 cells=3",
)
ALL = [
    "disc",
    *DISC,
    *PLASTIC_DISC,
    *SLOW_DISC,
    *TUBE_CASES,
    *SMALL_VALVE_CASES,
    *LITTLE_DAMPING,
    *REPEATED,
    *ACCURACY,
]


def deploy(comm: MPI.Comm, sail: str, until: float, **given: float) -> dict[str, float]:
    """What `main` of a demo returns, with the memory, the time [s] of the opening, and the size at
    the end.

    The size is the mean radius of the tips over that of the flat disc, or the distance of the tip
    over the length.
    """
    factor = 1 + NUDGE * given.pop("nudge", 0.0)
    if sail == "disc":
        disc = {"n": SIDES, "rev": REV} | given
        disc["rev"] *= factor
        found = spin_deployment.main(until=until, comm=comm, **disc)
        driving = found["energy"] - found.get("crease_start", 0.0)
        opened = found["opened"]
        size = found["largest_radius"] / 0.5
    else:
        usual = {"pressure": FULL, "loss_factor": flat_rooted_tube.LOSS_FACTOR}
        found = flat_rooted_tube.main(
            until=until, comm=comm, lift=factor * LIFT, **TUBE, **(usual | given)
        )
        driving = given.get("pressure", FULL) * TUBE["tank"]
        opened = found["arrived"]
        size = found["tip_distance"] / TUBE["length"]
    memory = found.get("fold_energy", 0.0) / driving
    return {**found, "memory": memory, "opened": opened, "size": size}


# Sails without creases that were deployed in this process.
_WITHOUT: dict[tuple[object, ...], dict[str, float]] = {}


def reference(comm: MPI.Comm, sail: str, until: float, **drive: float) -> dict[str, float]:
    """What `deploy` returns of the sail without creases, driven alike; computed once."""
    key = (sail, until, comm.size, *drive.items())
    if key not in _WITHOUT:
        _WITHOUT[key] = deploy(comm, sail, until, **drive)
    return _WITHOUT[key]


def effect(opened: float, without: float) -> float:
    """Index in `EFFECTS` of a time of opening [s] against that without creases; nan if that is not
    open."""
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
    """Deploy a sail with creases; returns the figures of `deploy`, the delay against none, and the
    effect."""
    sail, *_ = case.split()
    given = arguments(case)
    # What drives the sail, and how it is computed, is that of the sail without creases, too.
    creases = ("crease", "set_angle_ratio", "yield_angle", "nudge")
    others = {name: value for name, value in given.items() if name not in creases}
    end = ENDS[sail]
    if given.get("pressure") == LOW:
        end = SLOW_END
    if "bore" in given:
        end = SMALL_VALVE_END
    # A disc without creases opens after the same number of revolutions, however fast it spins.
    end *= REV / given.get("rev", REV)
    if until is not None:
        end = until
    without = reference(comm, sail, end, **others)
    found = without if given == others else deploy(comm, sail, end, **given)
    delay = math.nan
    if math.isfinite(without["opened"]):
        delay = found["opened"] / without["opened"] - 1
    return {**found, "delay": delay, "effect": effect(found["opened"], without["opened"])}


def draw(results: list[Result], path: Path) -> None:
    """Delay of the opening, and size at the end, over the memory Π of the folds."""
    from demos.common.figures import BLUE, GREEN, GREY, RED, new_figure, save

    kinds = {
        "set_angle_ratio=0": ("flat at rest", GREEN),
        "set_angle_ratio=0.5": ("rest at half of the fold angle", BLUE),
        "set_angle_ratio=1": ("rest in the fold", RED),
        "yield_angle": ("rest in the fold, yields at 20°", GREY),
    }
    # A sail of which nothing was computed has no panels.
    sails = [sail for sail in ENDS if any(_is_drawn(r, sail) for r in results)]
    figure = new_figure(width=2.0 + 4.2 * len(sails), height=6.6)
    axes = figure.subplots(2, len(sails), sharex="col", squeeze=False)
    titles = {
        "disc": "Disc of film (dashed: a quarter of the spin)",
        "tube": "Folded tube (dashed: a tenth of the pressure)",
    }
    size_labels = {
        "disc": "largest radius of the tips / flat disc",
        "tube": "distance of the tip at the end / length",
    }
    for column, sail in enumerate(sails):
        delays, sizes = axes[:, column]
        done = [r for r in results if _is_drawn(r, sail)]
        # Without an opening of the sail without creases there is no delay.
        all_delays = [r.numbers.get("delay", math.nan) for r in done]
        finite = [delay for delay in all_delays if math.isfinite(delay)]
        # Sails that do not open are drawn above all delays.
        never = 1.25 * max([2 * VISIBLE, *finite])
        for low, style in ((False, "-"), (True, "--")):
            for kind, (name, colour) in kinds.items():
                # The legend has one entry for both pressures.
                label = "" if low else name
                rows = [r for r in done if _kind(r) == kind and _is_slow(r) == low]
                rows.sort(key=lambda r: r.numbers["memory"])
                memory = [r.numbers["memory"] for r in rows]
                delay = [min(r.numbers.get("delay", math.nan), never) for r in rows]
                line = {"color": colour, "linestyle": style}
                delays.plot(memory, [100 * y for y in delay], **line)
                for x, y in zip(memory, delay, strict=True):
                    marker = "x" if y == never else "o"
                    delays.plot(x, 100 * y, marker, color=colour)
                size = [r.numbers["size"] for r in rows]
                sizes.plot(memory, size, marker="o", label=label, **line)
            for r in done:
                if not _kind(r) and _is_slow(r) == low:
                    sizes.axhline(
                        r.numbers["size"],
                        color="black",
                        linewidth=0.9,
                        linestyle=style,
                        label="" if low else "no creases",
                    )
        delays.axhspan(-100 * VISIBLE, 100 * VISIBLE, color=GREY, alpha=0.15)
        delays.annotate("×  does not open", (0.02, 0.04), xycoords="axes fraction")
        delays.set_title(titles[sail], fontsize=10)
        delays.set_ylabel("opens later than without creases [%]")
        sizes.set_ylabel(size_labels[sail])
        sizes.set_xscale("log")
        sizes.set_xlabel("Π, energy of the folds over that which drives")
        for panel in (delays, sizes):
            panel.grid(alpha=0.3)
    handles, labels = axes[1, 0].get_legend_handles_labels()
    # Three entries do not fit below the panels of one sail.
    columns = 1 + len(sails)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
    save(figure, path)


def _is_drawn(result: Result, sail: str) -> bool:
    """Whether a result is one of a sail that the picture shows: not a nudged start, another mesh or
    step."""
    case = str(result.values["case"])
    others = ("nudge", "cells", "dt", "largest", "n=6", "damping=0")
    is_other = any(word in case for word in others)
    return case.startswith(sail) and not result.failed and not is_other


def _is_slow(result: Result) -> bool:
    """Whether a tube is filled from a tank of little pressure, or a disc spins slowly."""
    case = str(result.values["case"])
    return "pressure" in case or "rev" in case


def _kind(result: Result) -> str:
    """The word of a case that tells its creases; empty without creases."""
    case = str(result.values["case"])
    if "yield_angle" in case:
        return "yield_angle"
    return next((word for word in case.split() if word.startswith("set_angle_ratio")), "")


STUDY = Study(
    "fold_memory",
    "Memory of folds: when it hinders a deployment, and when it helps",
    problem,
    {"case": ALL},
    lambda case: 1.0,
    quick={
        "case": [
            "disc crease=0.002 set_angle_ratio=1",
            "tube crease=0.02 set_angle_ratio=1 yield_angle=0.35",
        ]
    },
    quick_options={"until": 2e-3},
    shows=("memory", "halfway", "effect"),
    quick_shows=("memory", "crease_angle", "crease_loss"),
    not_repeatable={
        "nutation": "nothing is tilted: round-off",
        "nutation_at_start": "nothing is tilted: round-off",
        "imbalance": "nothing is uneven: in the quick form it is round-off",
    },
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=(
        "memory, effect, opened, halfway, delay, size, crease_angle, crease_start, crease_end, "
        f"crease_loss, {LEDGER}"
    ),
    may_fail=True,
    draw=draw,
)
