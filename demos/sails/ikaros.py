"""The sail of IKAROS opens: stage 2, from the cross of four arms to the square, and the steady spin
after it.

Four trapezoids of film are folded to strips, which stand out from the hub as a cross, two half
strips in each arm; 16 tethers hold their inner edges, masses of 0.5 kg their tips.  The guides of
the arms are removed at t = 0: the middles of the trapezoids move outwards, the tips are drawn
along, and the film opens.  Layers and hub are in contact. There are no external loads: the spin
falls as the moment of inertia grows,

    ω = ω0 (I + J0)/(I + J1)

with the moments of inertia I of the hub and J0, J1 of the sail folded and open, after the
oscillation between hub and sail has decayed.

Where the values come from:
    square 14.1 m, inner edge 3.2 m, 4 trapezoids of 3.5 kg with devices, 4 masses of 0.5 kg, hub of
    290 kg, φ1.6 m
                         JAXA's press kit and the project's blog; here the sail ends at whole rows
                         of folds
    7.4 rpm in the cross project's blog, item 550 (6 June 2010), of arms "a little over 5 m" out;
    docs/measured.md compares the spin with the flight's
    hub 85 kg m²         of a uniform cylinder 93; less, as docs/measured.md says
    tethers              1e4 N/m, chosen
    film                 polyimide of 7.5 µm, 3 GPa; devices are spread evenly
    reinforcing tapes    cables on the film, as in Miyazaki, KAKENHI 19360384 final report (2009),
                         fig. 7; their stiffness was not published: 25 µm × 10 mm of polyimide have
                         750 N
    damping              chosen: the flight's is not known; what depends on it,
                         `./gossamer study stage_2` says

    ./gossamer demo ikaros
    ./gossamer run demos/sails/ikaros.py until=8.0 --output out/ikaros
    ./gossamer report out/ikaros
    ./gossamer run demos/sails/ikaros.py pitch=0.32 until=8.0

The picture of the angular momentum by component is of `main("out/tilted", until=4.0, tilt=1.0,
largest=2e-2)`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import UNITS as deployment_units
from demos.common.deployment import deployment_case, first_time, print_figures, run_case
from demos.common.figures import finish, new_figure, save
from demos.common.spinning import (
    RPM,
    Disturbance,
    attitude_probes,
    drum,
    momentum_probes,
    plot_momentum,
    plot_spins,
    radii_of_tips,
    spin_figures,
    spin_probes,
)
from gossamer_fx.extend import Array, Probe
from gossamer_fx.meshes.sails import trapezoids

TITLE = "IKAROS, stage 2: from the cross to the square"
VIEW = gx.plot.View(azimuth=0.3, elevation=math.radians(50))
HALF = 7.05  # half of the side of the sail [m]
INNER = 1.6  # half of the side of its hole [m]
PETALS = 14.0  # mass of the four trapezoids with their devices [kg]
TIP = 0.5  # mass at each tip [kg]
HUB_MASS = 290.0  # kg
HUB_INERTIA = (70.0, 70.0, 85.0)  # kg m²
HUB_RADIUS = 0.79  # m
HUB_HEIGHT = 0.95  # m
FILM = {"E": 3e9, "nu": 0.34, "thickness": 7.5e-6}
TETHER = 1e4  # stiffness of a tether [N/m]
# Most steps of film that do not converge in as many iterations never do.
MAX_ITERATIONS = 25
# Mass of a reinforcing tape per length: 25 µm × 10 mm of polyimide [kg/m].
TAPE_LINE_DENSITY = 3.6e-4
BAND = (0.1, 1e4)  # frequencies within which a loss factor of the film is constant [Hz]
# The sail counts as open when the middles of its edges are at this radius.
OUT = 6.0  # m
ARM_END = 7.4  # spin in the cross [rpm]
# In flight: radius of the tips [m], if known, and spin [rpm].
FLIGHT = {
    "stage 1, arms 5 m out (6 June 2010)": (None, ARM_END),
    "open (16 June 2010)": (9.97, 2.5),
}


def rows(pitch: float) -> tuple[int, int, int]:
    """Rows of the inner and outer edge, and bends of a strip on the hub."""
    inner = int(INNER / pitch + 0.01)
    return (
        inner,
        round(HALF / pitch),
        max(1, min(round(math.pi / 4 * HUB_RADIUS / pitch), inner - 1)),
    )


def square_inertia(pitch: float) -> float:
    """J1 [kg m²] of the flat square with its tip masses."""
    inner, outer, _ = rows(pitch)
    a = outer * pitch
    b = inner * pitch
    return PETALS / (4 * (a**2 - b**2)) * 8 / 3 * (a**4 - b**4) + 4 * TIP * 2 * a**2


def build(
    comm: MPI.Comm,
    pitch: float = 0.64,
    refine: int = 1,
    rpm: float = ARM_END,
    hub_inertia: float = HUB_INERTIA[2],
    tilt: float = 0.0,
    offset: float = 0.0,
    stuck: float = 0.0,
    contact: float = 1.5e-3,
    gap: float = 2e-3,
    damping: float = 1e-4,
    tension_only: bool = False,
    loss_factor: float = 0.0,
    residual_stiffness: float = 1e-6,
    tether_damping: float = 0.0,
    friction: float = 0.0,
    crease: float = 0.0,
    tape: float = 0.0,
    until: float = 8.0,
    dt: float = 2e-3,
    largest: float = 1e-2,
    growth: float = 1.1,
    iterations: int = 10,
) -> gx.Case:
    """The sail in the cross, at the time of its release.

    Args:
        pitch: between folds [m]; 0.32 has as many as the sail of the flight has rows of devices.
        refine: cells between folds.
        rpm: spin at the start [rpm].
        hub_inertia: of the hub about its axis [kg m²]; those across it are `HUB_INERTIA`'s.
        tilt, offset, stuck: see `demos.common.spinning.Disturbance`; the guide of one trapezoid
            sticks.
        contact: activation distance [m]; 0: no contact.
        gap: between the layers [m].
        damping: viscosity of the film over its stiffness [s]; with `tension_only` none where it is
            slack.
        loss_factor: of the film, the same over the `BAND` of frequencies; 0: none.
        residual_stiffness: of the film, compressive over tensile.
        tether_damping: damping of a tether [N s/m].
        friction: coefficient of the film on itself and the hub.
        crease: stiffness of creases with a rest angle [N m/m/rad]; 0: none.
        tape: stiffness EA of the reinforcing tapes [N]; 0: no tapes.
        until: end of the run [s].
        dt, largest: first and largest step [s].
        growth: factor by which a step may be longer than the last one; steps that grow by half are
            rejected more often.
    """
    inner, outer, bends = rows(pitch)
    folds = gx.fold.Ikaros(
        n=4, inner=inner, outer=outer, pitch=pitch, bends=bends, gap=gap, hub_gap=gap, ramp=pitch
    )
    film = sail(comm, pitch, folds.mark, refine=refine, residual_stiffness=residual_stiffness)
    disturbance = Disturbance(tilt, offset, stuck)
    hub = hub_body(comm, position=disturbance.hub_position(), about_axis=hub_inertia)
    tips = tip_ports(film)
    items: list[object] = [film, folds.start(film), hub, *tip_masses(film)]
    radius = min(HUB_RADIUS, folds.radius * math.cos(math.pi / 8 / bends) - 2 * contact)
    items.append(tethers(film, hub, pitch, radius, tether_damping))
    strips = tapes(film, pitch, tape, refine)
    items += strips
    flat_middle = np.array([0.0, -outer * pitch, 0.0])
    middle = film.port_at(flat_middle)
    folded_middle = folds.place(flat_middle[None], np.ones(1))[0]
    items += disturbance.holding_tethers(hub, middle, folded_middle, TETHER)
    items.append(gx.RigidMotion(spin=disturbance.spin(rpm * RPM)))
    if damping:
        viscosity = gx.Damping(
            film, stiffness_factor=damping, tension_only=tension_only, name="film damping"
        )
        items.append(viscosity)
    if loss_factor:
        items.append(gx.loads.flat_damping(film, loss_factor=loss_factor, band=BAND))
    if crease:
        items += folds.creases(film, stiffness=crease, set_angle_ratio=0.5)
    axis = hub.frame_at((0.0, 0.0, 0.0))
    probes = {
        **spin_probes(hub, film, tips, "rpm"),
        "twist [rad]": gx.probes.PolarPosition(tips[0], axis, quantity="angle"),
        "middle [m]": gx.probes.PolarPosition(middle, axis, quantity="radius"),
        "largest stress [Pa]": gx.probes.LargestStress(film),
        "largest tension of tapes [N]": largest_tension(strips),
        **attitude_probes(hub, tips),
        **momentum_probes(hub),
    }
    if contact:
        touching = gx.Contact(
            film,
            drum(hub, radius, -HUB_HEIGHT / 2, HUB_HEIGHT / 2),
            distance=contact,
            friction=friction,
        )
        items.append(touching)
        probes["penetrations"] = gx.probes.Penetrations(touching, every=10)
    else:
        probes["penetrations"] = gx.probes.Crossings(film)
    control = gx.StepControl(target_iterations=iterations, max_step=largest, max_factor=growth)
    return deployment_case(items, TITLE, probes, until, control, dt, max_iterations=MAX_ITERATIONS)


def tapes(
    film: gx.Membrane, pitch: float, stiffness: float, refine: int = 1
) -> list[gx.connectors.Tape]:
    """Tapes along the outer and inner edge and along the four seams of the sail.

    Args:
        film: the sail, with `refine` cells between folds.
        pitch: between folds [m].
        stiffness: EA of a tape, which bears tension only [N]; 0: no tapes.
    """
    if not stiffness:
        return []
    law = gx.TensionOnly(EA=stiffness, line_density=TAPE_LINE_DENSITY)
    inner, outer, _ = rows(pitch)
    found = []

    def add(name: str, start: Array, end: Array, cells: int) -> None:
        """A tape from one point (2,) of the pattern [m] to another, over some folds."""
        points = [(*(pitch * start), 0.0), (*(pitch * end), 0.0)]
        tape = gx.connectors.Tape.through(
            film, law, points=points, bars_per_segment=cells * refine, name=name
        )
        found.append(tape)

    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for k, corner in enumerate(corners):
        following = corners[(k + 1) % 4]
        add(f"outer tape {k}", outer * corner, outer * following, 2 * outer)
        add(f"inner tape {k}", inner * corner, inner * following, 2 * inner)
        add(f"seam tape {k}", inner * corner, outer * corner, outer - inner)
    return found


def largest_tension(tapes: list[gx.connectors.Tape]) -> Probe:
    """The largest tension [N] in any of the tapes; 0 without tapes."""
    tensions = [gx.probes.Tension(tape, "largest") for tape in tapes]
    return lambda run: max((tension(run) for tension in tensions), default=0.0)


def hub_body(
    comm: MPI.Comm,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    about_axis: float = HUB_INERTIA[2],
    rpm: float = 0.0,
) -> gx.RigidBody:
    """The hub, with its moment of inertia about its axis [kg m²] and a spin [rpm]."""
    return gx.RigidBody(
        HUB_MASS,
        (*HUB_INERTIA[:2], about_axis),
        position=position,
        spin=(0.0, 0.0, rpm * RPM),
        name="hub",
        comm=comm,
    )


def tip_ports(film: gx.Membrane) -> list[gx.Port]:
    """The four corners of the sail."""
    return [film.port(f"tip {k}") for k in range(4)]


def tip_masses(film: gx.Membrane) -> list[gx.connectors.AttachedMass]:
    """The masses at the corners."""
    return [
        gx.connectors.AttachedMass(port, TIP, name=f"mass {k}")
        for k, port in enumerate(tip_ports(film))
    ]


def swinging(
    comm: MPI.Comm,
    search: gx.Equilibrium,
    pitch: float,
    rpm: float,
    extra: float,
    viscosity: float,
    tether_damping: float = 0.0,
    tape: float = 0.0,
) -> tuple[list[object], gx.Membrane, gx.RigidBody]:
    """The open sail that spins as a search of `steady` found it, its hub `extra` [rpm] faster.

    Args:
        comm: communicator of the mesh.
        search: of a free hub.
        pitch: between folds [m].
        rpm: spin of the sail [rpm].
        extra: spin of the hub in addition [rpm].
        viscosity: of the film over its stiffness [s]; 0: none.
        tether_damping: of a tether [N s/m].
        tape: stiffness EA of the reinforcing tapes [N]; 0: no tapes.
    """
    film = sail(comm, pitch)
    hub = hub_body(comm, rpm=extra)
    items: list[object] = [film, hub, *tip_masses(film), *tapes(film, pitch, tape)]
    items.append(tethers(film, hub, pitch, HUB_RADIUS, tether_damping))
    items += [gx.StartFrom(search.system), gx.RigidMotion(spin=(0.0, 0.0, rpm * RPM))]
    # Viscous damping of the film, proportional to its stiffness.
    if viscosity:
        items.append(gx.Damping(film, stiffness_factor=viscosity, name="film damping"))
    return items, film, hub


def sail(
    comm: MPI.Comm,
    pitch: float,
    mark: Callable[[gx.Mesh], gx.Mesh] = lambda mesh: mesh,
    displacement: Callable[[Array], Array] | None = None,
    refine: int = 1,
    residual_stiffness: float = 1e-6,
) -> gx.Membrane:
    """The four trapezoids with the mass of their devices."""
    inner, outer, _ = rows(pitch)
    density = PETALS / (4 * (outer**2 - inner**2) * pitch**2) / FILM["thickness"]
    law = gx.Miyazaki(**FILM, density=density, residual_stiffness=residual_stiffness)
    mesh = mark(trapezoids(comm, 4, inner, outer, pitch, refine))
    return gx.Membrane(mesh, law, name="sail", displacement=displacement)


def tethers(
    film: gx.Membrane,
    hub: gx.RigidBody,
    pitch: float,
    radius: float,
    damping: float = 0.0,
    height: float = 0.0,
) -> gx.connectors.RopeBundle:
    """Four tethers from each inner edge of the film to the hub, stress-free in the open sail.

    Args:
        film, hub: the bodies.
        pitch: between folds [m].
        radius, height: of the ends on the hub [m].
        damping: of a tether [N s/m].
    """
    inner = rows(pitch)[0]
    ends = []
    lengths = []
    for k in range(4):
        c = math.cos(math.pi / 2 * k)
        d = math.sin(math.pi / 2 * k)
        for i in (-2, -1, 0, 1) if inner < 4 else (-4, -2, 2, 4):
            edge_point = pitch * np.array([c * i + d * inner, d * i - c * inner, 0.0])
            distance = float(np.linalg.norm(edge_point))
            x, y, z = map(float, edge_point)
            rim = hub.port((x * radius / distance, y * radius / distance, height))
            ends.append((film.port_at((x, y, z)), rim))
            lengths.append(distance - radius)
    return gx.connectors.RopeBundle(
        ends, lengths=lengths, stiffness=TETHER, damping=damping, name="tethers"
    )


def steady(
    comm: MPI.Comm = MPI.COMM_WORLD,
    pitch: float = 0.64,
    rpm: float = 2.5,
    bent: float = 0.0,
    held: bool = True,
    tape: float = 0.0,
) -> tuple[gx.Equilibrium, float, float]:
    """The open sail that spins steadily; the tethers' stiffness against swinging [N m/rad] and the
    sail's J1 [kg m²].

    The search begins `bent` [m] out of the plane; the hub is `held` in turning axes, or free;
    `tape` is the stiffness EA of the reinforcing tapes [N].  As if the sail were rigid in its
    plane, tethers of length l with the tension T from the radius R on the hub to r on the sail have
    the stiffness k = Σ T R r/l, and the lowest modes are

        swing about the hub   ω² = k/J, with a free hub of inertia I: k (1/J + 1/I)
        tilt against the hub  ω² = Ω² + k/J
    """
    spin = (0.0, 0.0, rpm * RPM)

    def waves(X: Array) -> Array:
        return np.vstack([0 * X[:2], bent * np.sin(X[0]) * np.cos(1.3 * X[1])])

    film = sail(comm, pitch, displacement=waves if bent else None)
    hub = hub_body(comm)
    ropes = tethers(film, hub, pitch, HUB_RADIUS)
    support: object = gx.loads.Centrifugal(hub, spin)
    if held:
        support = gx.constraints.FixedJoint(hub.frame(), gx.ground_frame())
    items = [*tip_masses(film), *tapes(film, pitch, tape), ropes]
    items += [gx.loads.Centrifugal(film, spin), support]
    search = gx.Equilibrium(gx.Scene(film, hub, *items))  # type: ignore[arg-type]
    search.find()
    stiffness = 0.0
    for pair, length in zip(ropes.ends, ropes.lengths, strict=True):
        a, b = search.system.unknowns.state.vectors(pair)
        distance = float(np.linalg.norm(a - b))
        tension = TETHER * max(distance - length, 0.0)
        stiffness += tension * float(np.linalg.norm(a) * np.linalg.norm(b)) / distance
    return search, stiffness, square_inertia(pitch)


def arm_inertia(
    out: float,
    hub: float = HUB_INERTIA[2],
    half_edges: tuple[float, float] = (7.0, 1.6),
    radius: float = 0.8,
    parts: int = 4000,
) -> float:
    """Moment of inertia [kg m²] of hub, wound strips and arms of which the length `out` [m] stands
    out from the hub.

    A half strip has the masses of `half_strip`; its wound part lies at the radius of the hub.
    """
    s, mass = half_strip(PETALS, half_edges, parts)
    r = radius + np.clip(s - (half_edges[0] - out), 0.0, None)
    return float(hub + mass @ r**2 + 4 * TIP * (radius + out) ** 2)


def half_strip(
    mass: float, half_edges: tuple[float, float], parts: int = 4000
) -> tuple[Array, Array]:
    """Distances s (parts,) [m] from the middle of a folded trapezoid, and masses (parts,) [kg] of a
    half strip there, together `mass`.

    With the half edges (a, b) it has the mass ρ (a - max(s, b)) ds at the distance s.
    """
    a, b = half_edges
    # Midpoint rule along the half strip.
    s = (np.arange(parts) + 0.5) / parts * a
    density = 2 * mass / (a**2 - b**2) * (a - np.maximum(s, b))
    return s, density * a / parts


def main(
    output: str | Path | None = None,
    until: float = 8.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Open the sail; `given` are arguments of `build`.  With `output`, a folder: a recording and
    pictures.

    Returns the figures of `spin_figures`, the spin of the closed form at the end [rpm], the time at
    which the middles of the edges are 6 m out [s], the energy that is still to be dissipated before
    hub and sail spin as one [J], and the largest stress of the film [Pa] and tension of a tape [N]
    of the run.
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    parts = (0.0, 0.06, 0.12, 0.2, 0.28, 0.4, 0.55, 0.7, 0.85, 1.0)
    run, series = run_case(case, output, "ikaros", parts, VIEW)
    if output is not None and comm.rank == 0:
        draw(series, Path(output) / "ikaros_spin.png")
        figure = new_figure(12.0, 3.8)
        plot_momentum(figure.subplots(1, 3), series)
        save(figure, Path(output) / "ikaros_momentum.png", TITLE)
    hub_inertia = float(given.get("hub_inertia", HUB_INERTIA[2]))  # type: ignore[arg-type]
    inertia = hub_inertia + square_inertia(float(given.get("pitch", 0.64)))  # type: ignore[arg-type]
    steady = float(run.first.angular_momentum[2]) / inertia
    return {
        **spin_figures(run, series),
        "spin_in_the_end": steady / RPM,
        "opened": first_time(series.time, series["middle [m]"], OUT),
        "to_be_lost": run.totals.energy - inertia * steady**2 / 2,
        "largest_stress": float(series["largest stress [Pa]"].max()),
        "tape_tension": float(series["largest tension of tapes [N]"].max()),
    }


def draw(series: gx.Series, path: Path) -> None:
    """Spins and radius over the time, the spin over the radius, and the values of the flight."""
    figure = new_figure(12.0, 3.8)
    left, middle, right = figure.subplots(1, 3)
    radius = radii_of_tips(series).mean(axis=0)
    plot_spins(left, series.time, series, "rpm")
    plot_spins(right, radius, series, "rpm")
    for label, (where, rpm) in FLIGHT.items():
        left.axhline(rpm, linestyle=":", color="black")
        end = (series.time[-1], rpm)
        left.annotate(f"flight: {label}", end, ha="right", va="bottom", fontsize=7)
        if where is not None:
            right.plot(where, rpm, "o", color="black")
    plot_radii(middle, series)
    finish(left, "t [s]", "spin [rpm]")
    finish(right, "radius of the tips [m]", "spin [rpm]")
    save(figure, path, TITLE)


def plot_radii(axes: Any, series: gx.Series) -> None:
    """Radii of the tips and of the middles of the edges over the time."""
    axes.plot(series.time, radii_of_tips(series).mean(axis=0), color="black", label="tips")
    edges = series["middle [m]"]
    axes.plot(series.time, edges, "--", color="black", label="middles of the edges")
    finish(axes, "t [s]", "radius [m]")


# Units of the figures of the stages.
UNITS = deployment_units | {
    **dict.fromkeys(("spin", "released_spin", "released_as_one"), "rpm"),
    "largest_stress": "Pa",
    "tape_tension": "N",
}

if __name__ == "__main__":
    print_figures(main(output="out/ikaros"), UNITS)
