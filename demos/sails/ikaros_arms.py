"""The arms of IKAROS are let out: stage 1, from arms wound round the hub to the cross.

The four strips of folded film are wound round the hub, one and a quarter turns each, with a mass of
0.5 kg at the end. Rods on a ring guide them.  Their tension turns the ring against a brake, and the
arms are let out as it turns.  If this takes days, as in flight, hub, arms and masses rotate as one
body:

    ω = L/(I + J),    J = Σ (∫ λ R² ds of the wound part + ∫ λ r² dr of the free part + m r_tip²)

If it takes seconds, as here, the arms lag behind, stop the hub like the cords of a yo-yo, and turn
it backwards before they stand out; the curves show both.  The demo ends with the cross: the
undamped swings of the arms after it are not part of stage 1.  With a stronger brake the arms are
let out one by one.  An arm is a cable with the mass of its two half strips, wound in a spiral
between those of its neighbours.  Arms, hub and rods are in contact.  The demo `ikaros` is stage 2,
from the cross.

Where the values come from:
    3.5 kg a trapezoid with its devices, 0.5 kg at a tip, hub of 290 kg and 85 kg m², 25 rpm before
    stage 1
                         JAXA's press kit and the project's blog (item 894); inertia as in
                         the demo `ikaros`
    spin after it        docs/measured.md compares it with the flight's
    rods, brake          chosen: the flight took days, here the arms are out after six seconds

    ./gossamer demo ikaros_arms
    ./gossamer run demos/sails/ikaros_arms.py brake=30.0 until=8.0 --output out/arms
    ./gossamer report out/arms
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import deployment_case, print_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from demos.common.rotation_guides import RotationGuides
from demos.common.spinning import (
    RPM,
    drum,
    laid_along,
    radii_of_tips,
    spin_figures,
    spin_probes,
    turned,
)
from demos.sails.ikaros import HUB_HEIGHT, HUB_INERTIA, PETALS, TIP, UNITS, hub_body
from gossamer_fx.extend import Array, Output, Probe
from gossamer_fx.meshes.line import line

TITLE = "IKAROS, stage 1: arms are let out by guides"
VIEW = gx.plot.View(azimuth=0.3, elevation=math.radians(60))
START = 25.0  # spin before stage 1 [rpm]
ARM = 6.4  # length of an arm [m]
HUB_RADIUS = 0.8  # m
ARM_RADIUS = 4e-3  # m
CONTACT_DISTANCE = 5e-3  # m
ROD = 0.06  # radius of a rod [m]
EA = 2e4  # of an arm [N]
# The tension of the arms reduces their gap by some hundredths of the contact distance.
CONTACT_STIFFNESS = 4e8  # N/m³
# Distance of neighbouring turns: five per cent outside of contact.
LAYER = 2 * ARM_RADIUS + 1.05 * CONTACT_DISTANCE  # m
FREE = 2  # cells that stand out at the start
RING = 2.0  # mass of the ring with its rods [kg]
FLIGHT = ((0.0, 25.0), (5.2, 7.4))  # length of arms that stood out [m] and spin in flight [rpm]


def winding(cells: int) -> tuple[float, int]:
    """Angle of a cell on the hub, of which a quarter is a multiple, and number of wound cells."""
    step = math.pi / 2 / max(1, round(math.pi / 2 * HUB_RADIUS * cells / ARM))
    return step, cells - FREE


def wound(cells: int) -> tuple[Array, float]:
    """Corners (cells + 1, 2) of the first arm, from its knot outwards, and its exit from the roll
    [rad]."""
    step, count = winding(cells)
    angles = -step * np.arange(count + 1)
    radii = HUB_RADIUS + LAYER * (-angles) / (math.pi / 2)
    roll = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    outwards = np.array([math.cos(angles[-1]), math.sin(angles[-1])])
    free = roll[-1] + np.outer(np.arange(1, FREE + 1) * ARM / cells, outwards)
    return np.vstack([roll, free]), float(angles[-1])


def closed_form(tips: Array, momentum: float, cells: int) -> Array:
    """ω [rad/s] of hub, ring and arms that stand out radially, with their masses at the radii
    `tips` (n,) [m]."""
    step, count = winding(cells)
    φ = np.linspace(step * count, 0.0, 2000)  # wound angle [rad], falling
    radius = HUB_RADIUS + LAYER * φ / (math.pi / 2)
    ring = RING * (radius[0] + ROD) ** 2
    # Along the spiral, from the knot: length, and moment of inertia for a line density of one.
    length = HUB_RADIUS * φ + LAYER * φ**2 / math.pi
    on_hub = (radius**4 - HUB_RADIUS**4) * math.pi / (8 * LAYER)
    tip = radius + length[0] + FREE * ARM / cells - length
    standing = (tip**3 - radius**3) / 3
    inertia = HUB_INERTIA[2] + ring + 4 * (PETALS / 4 / ARM * (on_hub + standing) + TIP * tip**2)
    return np.asarray(momentum / np.interp(tips, tip, inertia))


def build(
    comm: MPI.Comm,
    cells: int = 24,
    rpm: float = START,
    brake: float = 20.0,
    damping: float = 2e-2,
    tape: float = 0.0,
    until: float = 6.4,
    dt: float = 5e-3,
    largest: float = 2e-2,
    iterations: int = 10,
) -> gx.Case:
    """Hub, ring and four arms of `cells` cells.

    Args:
        damping: of the arms' stretch [s].
        tape: stiffness EA of the reinforcing tapes [N].  An arm has those of the outer edges of its
            two half strips along it; the others run across it.
    """
    corners, angle = wound(cells)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    hub = hub_body(comm)
    step = winding(cells)[0]
    radius = HUB_RADIUS * math.cos(step / 2) - ARM_RADIUS - 1.05 * CONTACT_DISTANCE
    half = HUB_HEIGHT / 4
    # The axis of a rod is next to the free part of its arm, and outside of its roll.
    clearance = ROD + ARM_RADIUS + 1.1 * CONTACT_DISTANCE
    outwards = np.array([math.cos(angle), math.sin(angle)])
    sideways = np.array([-math.sin(angle), math.cos(angle)])
    exit_radius = float(np.linalg.norm(corners[-1 - FREE]))
    axis = outwards * (exit_radius + clearance) + sideways * clearance / math.cos(step / 2)
    guides = RotationGuides(
        hub,
        4,
        radius=float(np.linalg.norm(axis)),
        rod_radius=ROD,
        height=2 * half,
        mass=RING,
        brake_damping=brake,
        first_angle=math.atan2(axis[1], axis[0]),
    )
    items: list[object] = [hub, guides]
    arms: list[gx.Cable] = []
    law = gx.TensionOnly(EA=EA + 2 * tape, line_density=PETALS / 4 / ARM)
    for k in range(4):
        wound_arm = turned(corners, math.pi / 2 * k)
        arm = gx.Cable(
            line(comm, [(float(x), 0.0, 0.0) for x in along], 1),
            law,
            name=f"arm {k}",
            displacement=laid_along(wound_arm, along),
        )
        root = hub.port((float(wound_arm[0, 0]), float(wound_arm[0, 1]), 0.0))
        items += [arm, gx.constraints.BallJoint(arm.port("start"), root, name=f"knot {k}")]
        items += [gx.connectors.AttachedMass(arm.port("end"), TIP, name=f"mass {k}")]
        items.append(gx.Damping(arm, stiffness_factor=damping, name=f"damping {k}"))
        arms.append(arm)
    contact = gx.Contact(
        *arms,
        drum(hub, radius, -half, half),
        *guides.rods,
        distance=CONTACT_DISTANCE,
        stiffness=CONTACT_STIFFNESS,
        radius=dict.fromkeys((arm.name for arm in arms), ARM_RADIUS),
    )
    items += [contact, gx.RigidMotion(spin=(0.0, 0.0, rpm * RPM))]
    tips = [arm.port("end") for arm in arms]
    probes = {
        **spin_probes(hub, None, tips, "rpm"),
        **ring_probes(hub, guides),
        "swing [rad]": gx.probes.PolarPosition(tips[0], guides.ring.frame(), quantity="angle"),
        "penetrations": gx.probes.Penetrations(contact),
    }
    control = gx.StepControl(target_iterations=iterations, max_step=largest, max_factor=1.1)
    return deployment_case(items, TITLE, probes, until, control, dt, frames=60)


def ring_probes(hub: gx.RigidBody, guides: RotationGuides) -> dict[str, Probe]:
    """How fast the ring of the guides turns against the hub."""
    spin = gx.probes.AngularVelocity(hub.frame(), "z")
    ring = gx.probes.AngularVelocity(guides.ring.frame(), "z")
    return {"ring against hub [rad/s]": lambda run: ring(run) - spin(run)}


def main(
    output: str | Path | None = None,
    until: float = 6.4,
    cells: int = 24,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Let the arms out; `given` are arguments of `build`.  With `output`, a folder: a recording and
    a picture.

    Returns the figures of `spin_figures`, the spin of the hub at the end by the closed form [rpm],
    and the largest relative difference of both in the run.
    """
    case = build(comm, cells, until=until, **given)  # type: ignore[arg-type]
    series = gx.Series(case.probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    if output is not None:
        outputs.append(case.recording(Path(output), overwrite=True))
    run = case.simulation(outputs)
    arms = [body for body in run.system.unknowns.bodies if isinstance(body, gx.Cable)]
    looks = []
    for t in np.linspace(0.0, until, 6):
        if t > 0:
            run.run(until=float(t))
        looks.append((run.time, [gx.fields.positions(run, arm) for arm in arms]))
    radius = radii_of_tips(series).mean(axis=0)
    budget = closed_form(radius, float(run.first.angular_momentum[2]), cells) / RPM
    if output is not None and comm.rank == 0:
        draw(looks, series, budget, Path(output) / "ikaros_arms.png")
    spin = series["spin of the hub [rpm]"]
    return {
        **spin_figures(run, series),
        "budget": float(budget[-1]),
        "difference": float(np.abs(spin / budget - 1).max()),
    }


def draw(
    looks: list[tuple[float, list[Array]]], series: gx.Series, budget: Array, path: Path
) -> None:
    """The arms from above, and the spin over time and radius."""
    figure = new_figure(12.0, 6.0)
    above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.3))
    for axes, (t, arms) in zip(above.subplots(1, len(looks)), looks, strict=True):
        for arm in arms:
            axes.plot(arm[:, 0], arm[:, 1], color=BLUE, linewidth=1)
            axes.plot(*arm[-1, :2], "o", color="black", markersize=3)
        axes.set(xlim=(-8, 8), ylim=(-8, 8), aspect="equal", title=f"t = {t:.1f} s")
        axes.set(xticks=[], yticks=[])
    left, right = below.subplots(1, 2)
    out = radii_of_tips(series).mean(axis=0) - HUB_RADIUS
    for length, rpm in FLIGHT:
        right.plot(length, rpm, "o", color="black", label="flight" if length else None)
    for axes, x, label in ((left, series.time, "t [s]"), (right, out, "length of the arms [m]")):
        spin = series["spin of the hub [rpm]"]
        axes.plot(x, spin, color=RED, label="hub, computed")
        axes.plot(x, budget, "--", color=BLUE, label="if all turned as one")
        finish(axes, label, "spin [rpm]")
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/ikaros_arms"), UNITS | {"budget": "rpm"})
