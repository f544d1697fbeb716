"""A folded inflatable tube deploys from a tank to a straight, stiff boom with round, rigid ends.

The film is pressed flat between two stubs and folded to a zigzag; its root is a clamped disc, and
its tip carries a plate.  Panels and stubs are compartments; gas passes from one to the next through
the deformed ring of film between them, which a fold almost closes.  Layers are in contact.  The
film is damped as measured or assumed for such films, so that it is soon taut.  The only external
force is that of the clamp, so that the energy of film, contact, plate and gas, and what is lost,
are constant together.

At its end the run becomes the start of a search for equilibrium, whose stiffness at the tip is that
of the boom.

Where the values come from:
    length 0.25 m        the short tube of the deployment tests in Miyazaki, KAKENHI 19360384 final
                         report (2009), §4(4); its film, diameter and pressure were not published
    diameter 30 mm       chosen, as are folds, stubs, tank, valve and the plate of 0.5 g
    film                 polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa, 0.34,
                         1420 kg/m³
    damping              a loss factor of 0.01 at all frequencies from 1 Hz to 100 kHz, beyond the
                         highest mode of the mesh; assumed, see `gossamer_fx.presets.films`.  With
                         `loss_factor=0 damping=1e-6` a damping time [s] instead
    tank                 chosen: 1 ml of nitrogen at 1.5 MPa and 293 K, which fills the tube to
                         about 9 kPa

Half-way, arrival, tip speed and stiffness are determined to some per cent by mesh, step, start and
damping; the opening times of the rings, and how the boom swings after its arrival, are not: see the
study `boom` for all of their ranges.

    ./gossamer demo folded_tube
    ./gossamer run demos/inflatables/folded_tube.py cells=6 --output out/folded_tube
    ./gossamer report out/folded_tube
    ./gossamer study boom
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import (
    UNITS,
    deployment_case,
    dissipation,
    print_figures,
    run_case,
    run_figures,
    square_millimetres,
)
from demos.common.inflatable_tube import InflatableTube
from demos.common.tube_bending import tip_stiffness
from gossamer_fx.extend import Array, Probe, on_rank_zero, read_results
from gossamer_fx.meshes.round_tube import round_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import AIR, NITROGEN

TITLE = "A folded tube deploys from a tank to a stiff boom"
VIEW = gx.plot.View(azimuth=math.radians(-25), elevation=math.radians(15))
UNTIL = 0.25  # [s]
# Frequencies [Hz] within which the loss factor of the film is constant.  The highest mode of a mesh
# of 4 to 8 cells has 90 to 190 kHz.
BAND = (1.0, 1e5)
# The tip has arrived at this part of the length from the clamp.
ARRIVED = 0.9
HALFWAY = 0.5
RESIDUAL_PRESSURE = 1.0  # of the gas in the folded tube above that outside [Pa]
OPEN = 0.5  # a ring counts as open at this part of the area of the round tube
# Time [s] over which the largest swing of the tip is taken, longer than a period.
SWING_TIME = 0.05
# Fractions of the run at which the picture shows the tube.
PICTURES = (0.0, 0.02, 0.06, 0.12, 0.18, 1.0)


# States of the recording, and the end of the animation [s].
FRAMES = 160
ANIMATED_UNTIL = 0.12


def build(
    comm: MPI.Comm,
    length: float = 0.25,
    diameter: float = 0.03,
    cells: int = 4,
    panels: int = 2,
    stub: float = 0.045,
    angle_degrees: float = 80.0,
    thickness: float = 25e-6,
    plate: float = 5e-4,
    tank: float = 1e-6,
    pressure: float = 1.5e6,
    dead_volume: float = 0.2e-6,
    bore: float = 2e-4,
    rise: float = 5e-3,
    loss_factor: float = KAPTON_HN.loss_factor or 0.0,
    damping: float = 0.0,
    tension_only: bool = True,
    residual_stiffness: float = 1e-6,
    contact: float = 5e-4,
    contact_stiffness: float | None = None,
    nudge: float = 0.0,
    glider: float = 0.0,
    air: float = 0.0,
    drag: float = 1.2,
    gravity: float = 0.0,
    supply: float = 0.0,
    until: float = UNTIL,
    dt: float = 1e-4,
    iterations: int = 12,
) -> gx.Case:
    """The tube with `cells` cells on half of its circumference, folded, its plate, tank and valve.

    Args:
        length, diameter, panels, stub: of the tube [m], see `gx.fold.TubeZigzag`.
        angle_degrees: by which panels rise [deg].
        thickness: of the film [m].
        plate: mass of the disc at the tip [kg].
        tank, pressure: volume of the tank [m³] and its initial pressure [Pa].
        dead_volume: rigid volume of each compartment in addition to that of the film [m³].
        bore: diameter of the valve [m], which opens gradually.
        rise: time in which it opens [s].
        loss_factor: of the film, the same for all frequencies of `BAND`; 0: none.
        damping: viscosity of the film over its stiffness [s], in addition; 0: none.
        tension_only: whether the damping acts where film is taut only, see
            `gx.loads.Viscoelasticity`.
        residual_stiffness: compressive over tensile stiffness of the film.
        contact: activation distance [m].
        contact_stiffness: [N/m³]; None: from closing speeds.
        nudge: relative change of the pressure of the tank or supply, to see what is chaotic.
        glider: mass of the glider on a straight track that carries the plate [kg]; 0: the plate is
            free.
        air: pressure of the air outside [Pa]; 0: vacuum.
        drag: drag coefficient of the film in that air, at 293 K.
        gravity: acceleration along -z, across the track [m/s²].
        supply: pressure above that outside [Pa] of a large reservoir in place of the tank; 0: the
            tank.
        until: end of the run [s].
        dt: first step [s]; the largest is eight times as long.
        iterations: Newton iterations that the step control aims at.
    """
    sizes: dict[str, Any] = {
        "length": length,
        "diameter": diameter,
        "cells": cells,
        "panels": panels,
        "stub": stub,
    }
    folds = gx.fold.TubeZigzag(**sizes, angle=math.radians(angle_degrees))
    # A disc: half of the moment of inertia about its axis is that about its diameters.
    inertia = plate * diameter**2 / 16
    disc = gx.RigidBody(
        plate + glider,
        (2 * inertia, inertia, inertia),
        position=folds.tip,
        name="end plate",
        comm=comm,
    )
    tube = InflatableTube(
        round_tube(comm, **sizes),
        KAPTON_HN.law(thickness, residual_stiffness=residual_stiffness),
        gas=NITROGEN,
        pressure=RESIDUAL_PRESSURE + air,
        dead_volume=dead_volume,
        outside=gx.gas.Ambient(air) if air else None,
        caps={"tip": disc},
        folds=folds,
        contact_distance=contact,
        contact_stiffness=contact_stiffness,
    )
    source: gx.Tank | gx.gas.Ambient
    if supply:
        supplied = air + supply * (1 + nudge)
        source = gx.gas.Ambient(supplied, temperature=293.0, name="supply")
    else:
        source = gx.Tank(tank, gas=NITROGEN, pressure=pressure * (1 + nudge), temperature=293.0)
    whole = math.pi / 4 * bore**2
    valve = tube.inlet(source, lambda t: whole * min(0.1 + t / rise, 1.0) ** 2)
    items: list[object] = [tube, valve]
    if glider:
        # The rail carries the glider: the plate moves along the axis of the tube and does not turn.
        rail = gx.constraints.PrismaticJoint(
            gx.ground_frame(), disc.frame(), axis=(1.0, 0.0, 0.0), name="track"
        )
        items.append(rail)
    if air and drag:
        items.append(gx.loads.AirDrag(tube.film, air / (AIR.R * 293.0), drag_coefficient=drag))
    if gravity:
        items.append(gx.Gravity(tube.film, (0.0, 0.0, -gravity)))
    if loss_factor:
        items.append(
            gx.loads.flat_damping(
                tube.film, loss_factor=loss_factor, band=BAND, tension_only=tension_only
            )
        )
    if damping:
        items.append(
            gx.Damping(
                tube.film, stiffness_factor=damping, tension_only=tension_only, name="viscosity"
            )
        )
    control = gx.StepControl(target_iterations=iterations, max_step=8 * dt)
    return deployment_case(items, TITLE, probes_of(tube), until, control, dt, frames=FRAMES)


def probes_of(tube: InflatableTube) -> dict[str, Probe]:
    """Pressures, areas of the rings, motion of the tip, and penetrations."""
    probes: dict[str, Probe] = {
        f"p{i + 1} [Pa]": gx.probes.GasState(bag, "pressure") for i, bag in enumerate(tube.chambers)
    }
    probes |= {
        f"ring{i + 1} [mm2]": square_millimetres(gx.probes.RingArea(ring))
        for i, ring in enumerate(tube.rings)
    }
    tip = plate_of(tube).port()
    probes |= {f"tip {axis} [m]": gx.probes.Position(tip, axis) for axis in "xyz"}
    velocity = [gx.probes.Velocity(tip, axis) for axis in "xyz"]
    probes["tip speed [m/s]"] = lambda run: math.hypot(*(v(run) for v in velocity))
    assert tube.contact is not None
    probes["penetrations"] = gx.probes.Penetrations(tube.contact)
    return probes


def plate_of(tube: InflatableTube) -> gx.RigidBody:
    """The disc at the tip."""
    return tube.caps[0].rigid_body


def folds_of(tube: InflatableTube) -> gx.fold.TubeZigzag:
    """The folds with which the tube starts."""
    assert tube.start is not None and isinstance(tube.start.folds, gx.fold.TubeZigzag)
    return tube.start.folds


def tube_of(case: gx.Case) -> InflatableTube:
    """The tube of a case of `build`."""
    return next(item for item in case.scene.items if isinstance(item, InflatableTube))


def stiffness_of_tip(run: gx.Simulation, tube: InflatableTube, pressure: float) -> list[float]:
    """Stiffness of the tip [N/m] across the boom, along y and z, in the equilibrium under a
    pressure [Pa] that is found from the end of a run.  Collective."""
    scene = gx.Scene(
        tube.film,
        tube.clamp,
        plate_of(tube),
        *tube.caps,
        gx.Pressure(tube.film, pressure),
        gx.StartFrom(run.system),
    )
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    tip = plate_of(tube).port()
    directions = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [gx.analysis.point_stiffness(equilibrium, tip, direction=d) for d in directions]


def crossing(time: Array, values: Array, limit: float) -> float:
    """First time [s] at which values reach a limit, between records; infinite if they never do."""
    reached = np.flatnonzero(values >= limit)
    if not len(reached):
        return math.inf
    k = int(reached[0])
    if k == 0:
        return float(time[0])
    share = (limit - values[k - 1]) / (values[k] - values[k - 1])
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def deployment_figures(
    run: gx.Simulation, series: gx.Series, tube: InflatableTube, length: float, diameter: float
) -> dict[str, float]:
    """What a deployment is judged by.

    Returns:
        halfway, arrived: when the tip first is at these parts of the length from the clamp.
        tip speed: the largest one.
        pressure: at the end, the mean of the compartments.
        swing, swing before: largest distance of the tip from the axis in the last `SWING_TIME`, and
            in that before, in per cent of the length.
        ring 1 and so on: when it first is half as wide as the round tube.
    """
    time = np.asarray(series.time)
    distance = series["tip x [m]"]
    circle = 1e6 * math.pi * diameter**2 / 4
    off_axis = 100 * np.hypot(series["tip y [m]"], series["tip z [m]"]) / length
    last = time > time[-1] - SWING_TIME
    before = ~last & (time > time[-1] - 2 * SWING_TIME)
    pressures = [run.chamber(bag.name).pressure for bag in tube.chambers]
    figures = {
        "halfway [ms]": 1e3 * crossing(time, distance, HALFWAY * length),
        "arrived [ms]": 1e3 * crossing(time, distance, ARRIVED * length),
        "tip speed [m/s]": float(series["tip speed [m/s]"].max()),
        "pressure [Pa]": float(np.mean(pressures)),
        "swing [%]": float(off_axis[last].max()),
        "swing before [%]": float(off_axis[before].max(initial=0.0)),
    }
    for k in range(1, len(tube.rings) + 1):
        opened = crossing(time, series[f"ring{k} [mm2]"], OPEN * circle)
        figures[f"ring {k} [ms]"] = 1e3 * opened
    return figures


def main(
    output: str | Path | None = None,
    until: float = UNTIL,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Deploy the tube; `given` are arguments of `build`.  With `output`, a folder: a recording, a
    picture and an animation.

    Returns the figures of `deployment_figures`, the stiffness of the tip along y and z, that of
    the closed forms for the circle and for the polygon of the mesh, mass_error (of the gas,
    relative), and the figures of `run_figures` and `dissipation`.
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    tube = tube_of(case)
    run, series = run_case(case, output, "folded_tube", PICTURES, VIEW)
    if output is not None:
        folder = Path(output)
        on_rank_zero(comm, lambda: animate(folder))
    folds = folds_of(tube)
    figures = deployment_figures(run, series, tube, folds.length, folds.diameter)
    pressure = figures["pressure [Pa]"]
    along_y, along_z = stiffness_of_tip(run, tube, pressure)
    beam = partial(tip_stiffness, tube.film.law, folds.length, folds.diameter, pressure)
    return {
        **figures,
        "stiffness along y [N/m]": along_y,
        "stiffness along z [N/m]": along_z,
        "stiffness, circle [N/m]": beam(),
        "stiffness, polygon [N/m]": beam(sides=folds.sides),
        **run_figures(run, series),
        "mass_error": abs(run.mass_error),
        **dissipation(run),
    }


def animate(folder: Path) -> None:
    """Write the animation of the deployment of a recorded run, without the swing that follows."""
    gx.plot.animate(
        gx.plot.RunReader(folder),
        "state",
        path=folder / "folded_tube.gif",
        seconds=5.0,
        until=ANIMATED_UNTIL,
        pixels=640,
        view=VIEW,
    )


def stored_verdicts() -> dict[str, str]:
    """What the stored study `boom` says of each quantity: determined to so much, or its range."""
    # Imported here: the study runs this demo.
    from demos.studies.boom import STUDY

    stored = Path(__file__).parents[1] / "studies" / "results" / f"{STUDY.name}.json"
    found = STUDY.spread(read_results(stored, STUDY.name))
    return {name: str(found.verdict(name)) for name in STUDY.expected}


if __name__ == "__main__":
    folder = Path("out/folded_tube")
    print_figures(main(output=folder), UNITS)
    if MPI.COMM_WORLD.rank == 0:
        print("over meshes, steps, starts, contact and damping (./gossamer study boom):")
        for name, verdict in stored_verdicts().items():
            print(f"{name:48} {verdict}")
        gx.write_report(gx.plot.RunReader(folder), folder / "report.html")
        print(f"report written to {folder / 'report.html'}, for a browser")
