"""The sail of IKAROS from the roll to the square: both stages of its deployment in one scene.

Four trapezoids of film are folded to strips and wound round the hub; 16 tethers hold their inner
edges, masses of 0.5 kg their tips, of which 1.9 m stand out at the start.  Rods on a ring guide the
roll.  In stage 1 the tension of the free arms turns the ring against a brake, and arms are unwound
as it turns.  At the `release` the ring is drawn down along the hub and the tethers are paid out.
Stage 2 ends with the open sail; the demo `ikaros` starts it from the cross. Layers, hub and rods
are in contact; there are no external loads.

If all bodies rotate as one, the spin is ω = L/(I + J), with the moments of inertia I of the hub and
J of the present shape of the sail.  The flight took days for stage 1 and was close to that.  If it
takes seconds, as here, the arms lag behind the hub, swing ahead of it and back, and stop it
gradually, like the cords of a yo-yo.  With a weak brake they lag so far that their tension is less
than the centrifugal force on the roll, and the film leaves the rods before the arms are out
(`brake=10.0`).

Where the values come from:
    sail, hub, tethers, film
                         as in the demo `ikaros`, here with a roll that begins at the hub's 0.84 m
                         and grows inwards
    25 rpm before stage 1
                         project's blog, item 894; docs/measured.md compares the spin with the
                         flight's
    ring, rods, brake, damping
                         chosen; the flight had four guides, and a roll without slack

    ./gossamer demo ikaros_stages                     # half an hour
    ./gossamer run demos/sails/ikaros_stages.py brake=10.0 release=6.0 until=14.0 \\
        --output out/stages
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import deployment_case, print_figures, run_case, smooth
from demos.common.figures import finish, new_figure, save
from demos.common.rotation_guides import RotationGuides
from demos.common.spinning import (
    RPM,
    drum,
    plot_spins,
    radii_of_tips,
    spin_figures,
    spin_probes,
)
from demos.sails.ikaros import (
    FLIGHT,
    HUB_HEIGHT,
    HUB_INERTIA,
    MAX_ITERATIONS,
    TETHER,
    UNITS,
    arm_inertia,
    hub_body,
    plot_radii,
    rows,
    sail,
    square_inertia,
    tapes,
    tethers,
    tip_masses,
    tip_ports,
)
from demos.sails.ikaros_arms import FLIGHT as STAGE_1
from demos.sails.ikaros_arms import START, ring_probes
from gossamer_fx.extend import Array

TITLE = "IKAROS, from the roll to the square"
VIEW = gx.plot.View(azimuth=0.3, elevation=math.radians(50), zoom=True)
RING = 2.0  # mass of the ring with its rods [kg]
ROD = 0.03  # radius of a rod [m]
HEIGHT = 0.9  # of a rod [m]
RODS = 16  # number of rods
# To release the sail the ring is drawn down along the hub by this distance [m] in this time [s].
DRAWN = 1.0
IN = 0.5
OUT = 1.92  # length of the tips that stand out at the start [m]
GAP = 1.5e-3  # between the layers [m]


def folded(pitch: float, gap: float = GAP, out: float = OUT) -> gx.fold.Ikaros:
    """The strips, wound round the hub."""
    inner, outer, bends = rows(pitch)
    free = round(out / pitch)
    return gx.fold.Ikaros(
        n=4, inner=inner, outer=outer, pitch=pitch, bends=bends, hub_gap=gap, wound=True, out=free
    )


def roll_radius(pitch: float) -> float:
    """Of the corners of the outermost layer [m]."""
    return pitch / 2 / math.sin(math.pi / 8 / rows(pitch)[2])


def build(
    comm: MPI.Comm,
    pitch: float = 0.64,
    refine: int = 1,
    rpm: float = START,
    brake: float = 30.0,
    release: float = 16.0,
    contact: float = 1e-3,
    gap: float = GAP,
    out: float = OUT,
    rods: int = RODS,
    damping: float = 2e-3,
    tape: float = 0.0,
    until: float = 24.0,
    dt: float = 2e-3,
    largest: float = 1e-2,
    growth: float = 1.1,
    iterations: int = 10,
) -> gx.Case:
    """The sail on the hub, held by the rods.

    Args:
        pitch, refine, contact, gap, damping, tape, largest, growth: as in the demo `ikaros`.
        brake: of the ring [N m s/rad].
        release: when the ring begins to be drawn down [s].
        out: length of the tips that stand out at the start [m].
        rods: their number, a multiple of 4.
    """
    folds = folded(pitch, gap, out)
    _, outer, bends = rows(pitch)
    film = sail(comm, pitch, folds.mark, refine=refine)
    hub = hub_body(comm)
    guides = _guides(hub, folds, contact, brake, release, rods)
    radius = folds.radius * math.cos(math.pi / 8 / bends) - 2 * contact
    surface = drum(hub, radius, -HUB_HEIGHT / 2, HUB_HEIGHT / 2)
    touching = gx.Contact(film, surface, *guides.rods, distance=contact)
    items: list[object] = [film, folds.start(film), hub, guides, touching]
    items += _tethers(film, hub, pitch, radius, folds, release)
    items += tip_masses(film)
    items += tapes(film, pitch, tape, refine)
    items += [
        gx.Damping(film, stiffness_factor=damping, name="film damping"),
        gx.RigidMotion(spin=(0.0, 0.0, rpm * RPM)),
    ]
    middle = film.port_at((0.0, -outer * pitch, 0.0))
    probes = {
        **spin_probes(hub, film, tip_ports(film), "rpm"),
        **ring_probes(hub, guides),
        "middle [m]": gx.probes.PolarPosition(middle, hub.frame(), quantity="radius"),
        "penetrations": gx.probes.Penetrations(touching),
    }
    control = gx.StepControl(target_iterations=iterations, max_step=largest, max_factor=growth)
    return deployment_case(
        items, TITLE, probes, until, control, dt, max_iterations=MAX_ITERATIONS, frames=120
    )


def _tethers(
    film: gx.Membrane,
    hub: gx.RigidBody,
    pitch: float,
    radius: float,
    folds: gx.fold.Ikaros,
    release: float,
) -> list[gx.connectors.Tether]:
    """Those of the open sail, short in stage 1, then paid out: inner edges are held on the hub, at
    their height there.

    Held at another height the roll slides along the hub, out of the rods.
    """
    bundle = tethers(film, hub, pitch, radius, height=-pitch / 2)
    found = []
    for k, ((edge, rim), whole) in enumerate(zip(bundle.ends, bundle.lengths, strict=True)):
        wound = folds.place(edge.initial()[None], np.zeros(1))[0]
        short = float(np.linalg.norm(wound - rim.initial()))

        def length(t: float, short: float = short, whole: float = whole) -> float:
            return short + max(whole - short, 0.0) * smooth((t - release) / IN)

        found.append(
            gx.connectors.Tether(edge, rim, length=length, stiffness=TETHER, name=f"tether {k}")
        )
    return found


def _guides(
    hub: gx.RigidBody,
    folds: gx.fold.Ikaros,
    contact: float,
    brake: float,
    release: float,
    count: int,
) -> RotationGuides:
    """Rods that touch the roll almost, those of them that let out an arm in the corner where it
    stands out."""
    away = ROD + 1.2 * contact
    axis = roll_radius(folds.pitch) + away
    arm = math.pi / 4 * ((folds.outer - folds.out) / folds.bends - 2)
    first = arm - (folds.hub_gap * (2 * folds.out + 1) + away + contact) / axis

    return RotationGuides(
        hub,
        count,
        radius=axis,
        rod_radius=ROD,
        height=HEIGHT,
        mass=RING,
        brake_damping=brake,
        first_angle=first,
        drawn=lambda t: DRAWN * smooth((t - release) / IN),
        reel_depth=1.2 * DRAWN,
    )


def as_one(radius: Array, momentum: float, pitch: float) -> Array:
    """Spin [rad/s] of hub, ring, wound strips and arms whose tips are at a radius (n,) [m], if all
    turn as one.

    The roll, of which layers lie on the sides of a polygon, counts where the middle of them has its
    mean square.
    """
    inner, outer, bends = rows(pitch)
    half_edges = (outer * pitch, inner * pitch)
    ring = RING * (roll_radius(pitch) + ROD) ** 2
    cos = math.cos(math.pi / 8 / bends)
    R = (folded(pitch).radius + roll_radius(pitch)) / 2 * math.sqrt((1 + 2 * cos**2) / 3)
    inertia = [arm_inertia(max(r - R, 0.0), HUB_INERTIA[2] + ring, half_edges, R) for r in radius]
    return momentum / np.array(inertia)


def main(
    output: str | Path | None = None,
    until: float = 24.0,
    release: float = 16.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Deploy the sail; `given` are arguments of `build`.  With `output`, a folder: a recording and
    pictures.

    Returns the figures of `spin_figures`; at the release the radius of the tips [m], the spin of
    the hub, and the spin if all turned as one [rpm]; the spin of the closed form at the end [rpm].
    """
    case = build(comm, until=until, release=release, **given)  # type: ignore[arg-type]
    stage2 = [release + part * (until - release) for part in (0.0, 0.15, 0.3, 0.6, 0.8, 1.0)]
    looks = [part * release for part in (0.0, 0.15, 0.3, 0.5, 0.65, 0.8)] + stage2
    fractions = [t / until for t in looks if t <= until]
    run, series = run_case(case, output, "ikaros_stages", fractions, VIEW)
    pitch = float(given.get("pitch", 0.64))  # type: ignore[arg-type]
    radius = radii_of_tips(series).mean(axis=0)
    momentum = float(run.first.angular_momentum[2])
    if output is not None and comm.rank == 0:
        draw(series, momentum, pitch, release, Path(output) / "ikaros_stages_spin.png")
    inertia = HUB_INERTIA[2] + RING * (roll_radius(pitch) + ROD) ** 2 + square_inertia(pitch)
    k = min(int(np.searchsorted(series.time, release)), len(radius) - 1)
    return {
        **spin_figures(run, series),
        "released_radius": float(radius[k]),
        "released_spin": float(series["spin of the hub [rpm]"][k]),
        "released_as_one": float(as_one(radius[k : k + 1], momentum, pitch)[0] / RPM),
        "spin_in_the_end": momentum / inertia / RPM,
    }


def draw(series: gx.Series, momentum: float, pitch: float, release: float, path: Path) -> None:
    """Spins and radius over the time, the spin of the hub over the length of arms out, and the
    values of the flight."""
    figure = new_figure(12.0, 3.8)
    left, middle, right = figure.subplots(1, 3)
    plot_spins(left, series.time, series, "rpm")
    open_spin = FLIGHT["open (16 June 2010)"][1]
    left.axhline(open_spin, linestyle=":", color="black")
    left.annotate("flight, open", (0.0, open_spin), ha="left", va="bottom")
    plot_radii(middle, series)
    arms_out = radii_of_tips(series).mean(axis=0) - roll_radius(pitch)
    plot_spins(right, arms_out, series, "rpm", upto=release)
    out = np.linspace(0.0, max(float(arms_out[series.time <= release].max()), 0.1), 60)
    rigid = as_one(roll_radius(pitch) + out, momentum, pitch) / RPM
    right.plot(out, rigid, "--", color="black", label="if all turned as one")
    for length, rpm in STAGE_1:
        right.plot(length, rpm, "o", color="black")
    finish(left, "t [s]", "spin [rpm]")
    finish(right, "length of the arms that is out in stage 1 [m]", "spin [rpm]; dots: flight")
    for axes in (left, middle):
        axes.axvline(release, color="black", linewidth=0.6)
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/ikaros_stages"), UNITS)
