"""A folded inflatable tube with flat ends is deployed from a tank, with contact with itself and
choked flow at its folds: a problem of studies and benchmarks.  The demo `folded_tube` is one with
round ends, which becomes a stiff boom; this one is a hinge at its flat root.

The film is not damped unless that is asked for: then its vibration holds the folds open, and the
times at which they open are not determined (`docs/howto/damping.md`).  With `loss_factor=0.01` it
is damped as a polymer film may be.  The film is pressed flat and folded to a zigzag, or rolled up.
Each panel is a compartment, a separate chamber; gas passes to the next one through the deformed
ring of film between them, which a fold almost closes.  Layers are in contact.  The compartments
open one after the other, the tube unfolds and stiffens, and its tip is stopped abruptly when it is
straight.  The only external force is that of the clamp at the inlet, so the energy of film,
contact, creases and gas is constant.

Where the values come from:
    length 0.25, 0.8 m   the short and the long tube of the deployment tests in Miyazaki, KAKENHI
                         19360384 final report (2009), §4(4); their films, diameters and pressures
                         were not published
    diameter 30 mm       chosen, as are folds, tank and valve
    film                 polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa, 0.34,
                         1420 kg/m³
    tank                 chosen: 1 ml of nitrogen at 1.5 MPa and 293 K, which fills the tube to
                         about 9 kPa
    crease               0.02 N m/m/rad for creases with memory: B/L* with L* = 7 thicknesses; the
                         crease of Gori & Bosi (2022), doi:10.1016/j.eml.2022.101849, has 29, which
                         would be 0.005
    manufacturing        `SCATTER`, chosen; a `seed` draws the errors of one specimen, see
                         demos/common/manufacturing.py

It has 582 unknowns, and takes 16 s of CPU time to 20 ms.

    ./gossamer run demos/common/flat_rooted_tube.py loss_factor=0.01 --output out/flat_rooted
    ./gossamer report out/flat_rooted
    ./gossamer run demos/common/flat_rooted_tube.py start=roll
    ./gossamer run demos/common/flat_rooted_tube.py length=0.8 panels=5 tank=3.2e-6 until=0.1
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import (
    crease_figures,
    deployment_case,
    dissipation,
    first_time,
    fold_angles,
    run_case,
    run_figures,
    square_millimetres,
)
from demos.common.inflatable_tube import InflatableTube
from demos.common.manufacturing import (
    Scatter,
    Specimen,
    UnevenZigzag,
    draw_specimen,
    move_rows,
    stations,
)
from gossamer_fx.extend import Array, Folding, Probe
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import AIR, NITROGEN

TITLE = "A folded tube with flat ends, deployed from a tank"
VIEW = gx.plot.View(azimuth=math.radians(-30), elevation=math.radians(15), zoom=True)
# Manufacturing errors of a specimen: 1 mm and 2 degrees are those of folding by hand along a drawn
# line, 1 % of the diameter is 0.5 mm at the seams; makers of film state 5 to 10 % of the thickness
# as the tolerance.
SCATTER = Scatter(fold_position=1e-3, fold_angle=math.radians(2.0), diameter=0.01, thickness=0.04)
# The tip has arrived at this part of the length from the clamp.  The flat ends shorten a tube that
# is full by some 7 %.
ARRIVED = 0.9
# Half of the way: creases that are flat at rest act before it.
HALFWAY = 0.5
# Loss factor of a polymer film as studies take it, and the frequencies [Hz] within which it is
# constant; the mesh has none beyond.
LOSS_FACTOR = KAPTON_HN.loss_factor or 0.0
BAND = (1.0, 1e5)
OPEN = 0.5  # a ring counts as open at this part of the area of the round tube


def rows_of(length: float, diameter: float, cells: int, compartments: int) -> int:
    """Rows of edges across `flat_tube`, its ends not counted."""
    across = 2 * max(round(cells / 2), 1)
    along = 2 * max(round(across * length / compartments / (math.pi * diameter / 2) / 2), 1)
    return along * compartments - 1


def build(
    comm: MPI.Comm,
    length: float = 0.25,
    diameter: float = 0.03,
    cells: int = 4,
    panels: int = 3,
    start: str = "zigzag",
    angle_degrees: float = 80.0,
    lift: float = 1e-4,
    thickness: float = 25e-6,
    tank: float = 1e-6,
    pressure: float = 1.5e6,
    dead_volume: float = 0.2e-6,
    bore: float = 0.4e-3,
    rise: float = 5e-3,
    crease: float = 0.0,
    set_angle_ratio: float = 0.5,
    yield_angle: float = 0.0,
    seed: int = 0,
    damping: float = 0.0,
    loss_factor: float = 0.0,
    contact: float = 5e-4,
    contact_stiffness: float | None = None,
    residual_stiffness: float = 1e-6,
    gravity: float = 0.0,
    air: float = 0.0,
    drag: float = 1.2,
    residual: float = 1.0,
    until: float = 0.02,
    dt: float = 1e-4,
    iterations: int = 0,
) -> gx.Case:
    """The tube of `panels` compartments with `cells` cells across, folded, its tank and the valve.

    Args:
        start: "zigzag", with panels that rise by `angle_degrees`, or "roll".
        lift: half of the distance between the layers at the folds [m].
        thickness: of the film [m].
        tank, pressure: volume of the tank [m³] and its initial pressure [Pa].
        dead_volume: rigid volume of each compartment in addition to that of the film [m³].
        bore: diameter of the valve [m], which opens gradually.
        rise: time in which it opens [s]; 0: it is open at the start.
        crease: stiffness of creases with a rest angle [N m/m/rad]; 0: none.
        set_angle_ratio: rest angle of the creases over the angle of their folds, 0 to 1.
        yield_angle: of the creases [rad], see `gx.connectors.Crease`; 0: elastic.
        seed: of the manufacturing errors `SCATTER` of a specimen; 0: none.  A roll has those of
            diameter and thickness only.
        damping: viscosity of the film over its stiffness [s]; 0: none.
        loss_factor: of the film, the same over the `BAND` of frequencies; 0: none.
        contact: activation distance [m]; 0: no contact.
        contact_stiffness: [N/m³]; None: from closing speeds.  Gradients need a number.
        residual_stiffness: of the film, compressive over tensile.
        gravity: downwards, along -z [m/s²].
        air: pressure outside [Pa]; 0: vacuum.
        drag: drag coefficient in that air, at 293 K; 0: none.
        residual: initial pressure of the gas in the tube above that outside [Pa].
        until: end of the run [s].
        dt: first step [s]; the largest is twice as long.
        iterations: Newton iterations that the step control aims at; 0: 12 for the zigzag, and 10
            for the roll, which longer steps would press shut.
    """
    specimen = draw_specimen(seed, panels, SCATTER)
    diameter *= specimen.diameter_ratio
    width = math.pi * diameter / 2
    half = length / panels
    mesh = flat_tube(comm, length, diameter, cells, compartments=panels)
    folds: Folding
    if start == "zigzag":
        folds = UnevenZigzag(
            length=length,
            panels=panels,
            angle=math.radians(angle_degrees),
            width=width,
            opening=1e-3,
            lift=lift,
            shifts=specimen.fold_shifts,
            angle_errors=specimen.angle_errors,
        )
        # Folds are rows of edges, and compartments end at them.
        mesh = move_rows(mesh, length, stations(length, panels, specimen.fold_shifts))
    else:
        bends = rows_of(length, diameter, cells, panels)
        folds = gx.fold.Roll(
            length=length, bends=bends, radius=0.4 * half, pitch=4e-3, width=width, opening=lift
        )
    outside = gx.gas.Ambient(air) if air else None
    tube = InflatableTube(
        mesh,
        KAPTON_HN.law(thickness, residual_stiffness=residual_stiffness),
        properties=thickness_of(specimen, thickness),
        gas=NITROGEN,
        pressure=residual + air,
        dead_volume=dead_volume,
        outside=outside,
        folds=folds,
        crease_stiffness=crease,
        set_angle_ratio=set_angle_ratio,
        # Zero stands for creases that are elastic: arguments of the command line are numbers.
        yield_angle=yield_angle or None,
        contact_distance=contact,
        contact_stiffness=contact_stiffness,
    )
    source = gx.Tank(tank, gas=NITROGEN, pressure=pressure, temperature=293.0)
    whole = math.pi / 4 * bore**2
    valve = tube.inlet(source, whole)
    if rise:
        valve = tube.inlet(source, lambda t: whole * min(0.1 + t / rise, 1.0) ** 2)
    items: list[object] = [tube, valve]
    if damping:
        items.append(gx.Damping(tube.film, stiffness_factor=damping))
    if loss_factor:
        items.append(gx.loads.flat_damping(tube.film, loss_factor=loss_factor, band=BAND))
    if gravity:
        items.append(gx.Gravity(tube.film, (0.0, 0.0, -gravity)))
    if air and drag:
        density = air / (AIR.R * 293.0)
        items.append(gx.loads.AirDrag(tube.film, density, drag_coefficient=drag))
    probes: dict[str, Probe] = {
        f"p{i + 1} [Pa]": gx.probes.GasState(bag, "pressure") for i, bag in enumerate(tube.chambers)
    }
    probes |= {
        f"ring{i + 1} [mm2]": square_millimetres(gx.probes.RingArea(ring))
        for i, ring in enumerate(tube.rings)
    }
    tip = tube.film.port("tip right")
    probes |= {f"tip {axis} [m]": gx.probes.Position(tip, axis) for axis in "xyz"}
    probes["tip speed [m/s]"] = _speed([gx.probes.Velocity(tip, axis) for axis in "xyz"])
    if tube.contact is not None:
        probes["penetrations"] = gx.probes.Penetrations(tube.contact)
    probes |= fold_angles(tube.creases)
    control = gx.StepControl(
        target_iterations=iterations or (12 if start == "zigzag" else 10), max_step=2 * dt
    )
    return deployment_case(items, TITLE, probes, until, control, dt)


def thickness_of(specimen: Specimen, thickness: float) -> dict[str, dict[str, float]] | None:
    """Thickness [m] of each panel as the `properties` of a film; None if all are as thick as
    drawn."""
    ratios = specimen.thickness_ratios
    # A film without properties has one thickness in its compiled forms.
    if all(ratio == 1 for ratio in ratios):
        return None
    panels = {f"compartment {i}": thickness * ratio for i, ratio in enumerate(ratios, start=1)}
    return {"thickness": panels}


def _speed(components: list[gx.probes.Velocity]) -> Probe:
    return lambda run: math.hypot(*(v(run) for v in components))


def opening_times(time: Array, rings: list[Array], diameter: float) -> list[float]:
    """When each ring [mm²] first is half as wide as the round tube [s]; infinite for one that does
    not open."""
    circle = 1e6 * math.pi * diameter**2 / 4
    return [first_time(time, area, OPEN * circle) for area in rings]


def main(
    output: str | Path | None = None,
    until: float = 0.02,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Deploy the tube; `given` are arguments of `build`.  With `output`, a folder: a recording and
    a picture.

    Returns the figures of `run_figures` and `dissipation`, mass_error (of the gas, relative),
    opening times of the rings [ms], pressures at the end [Pa], the largest speed [m/s] of the tip,
    its distance from the clamp at the end and its largest one [m], the times [s] at which that
    first is `HALFWAY` and `ARRIVED` of the length, and with creases the figures of
    `crease_figures`.
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    parts = (0.0, 0.08, 0.2, 0.35, 0.6, 1.0)
    run, series = run_case(case, output, "flat_rooted_tube", parts, VIEW)
    names = list(case.probes)
    rings = [series[name] for name in names if name.startswith("ring")]
    diameter = float(given.get("diameter", 0.03))  # type: ignore[arg-type]
    opened = opening_times(series.time, rings, diameter)
    ends = {
        name.split()[0]: float(series[name][-1])
        for name in names
        if name.startswith("p") and "[Pa]" in name
    }
    # The tube lies in the plane of x and z; its inlet is at the origin.
    distance = np.hypot(series["tip x [m]"], series["tip z [m]"])
    length = float(given.get("length", 0.25))  # type: ignore[arg-type]
    return {
        **run_figures(run, series),
        "mass_error": abs(run.mass_error),
        "tip_speed": float(series["tip speed [m/s]"].max()),
        "tip_distance": float(distance[-1]),
        "farthest": float(distance.max()),
        "halfway": first_time(series.time, distance, HALFWAY * length),
        "arrived": first_time(series.time, distance, ARRIVED * length),
        **{f"opening_{i + 1}_ms": 1e3 * t for i, t in enumerate(opened)},
        **{f"pressure_{name[1:]}": p for name, p in ends.items()},
        **crease_figures(run, series, case),
        **dissipation(run),
    }
