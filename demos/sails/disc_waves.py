"""Travelling waves round a spinning disc of film whose start is not symmetric.

A flat disc on a hub with a constant rate is in equilibrium with its centrifugal forces; then a
sixth of it is struck across the film, as by an arm that is released late.  Waves run round the disc
with the spin and against it.  Of a film without bending stiffness (Lamb & Southwell, Proc. R. Soc.
Lond. A 99 (1921) 272; with a hub Eversman & Dodson, AIAA J. 7 (1969) 2010) the deflection w(r) cos
n θ has, with the stresses of the spin,

    (r σ_r w')' - n² σ_θ w/r + ω² ρ r w = 0,   w = 0 at the hub,   r σ_r w' → 0 at the rim

which `mode` solves.  As seen from the disc the waves run at ω/n forward and backward, in space at
Ω ± ω/n.  ω/Ω has no length in it: discs of 1 m and 2 m have the same.  The blow, a velocity that
grows linearly from hub to rim, gives each wave half of the amplitude that its part of the blow has
in the lowest mode of its number.

Where the values come from:
    diameter 1, 2 m      the spinning films of Miyazaki, KAKENHI 19360384 final report (2009),
                         §4(4), where travelling waves were seen (fig. 5)
    film, hub, spin      as in the demo `spin_deployment`, without masses at the rim
    blow                 chosen: 0.05 m/s at the rim, where the spin has 25 m/s.  The closed form
                         is for slopes whose squares are far below the strain of the spin, 1e-4;
                         with `blow=1.0` waves of n = 2 and 4 are 3 and 10 % faster

    ./gossamer demo disc_waves
    ./gossamer run demos/sails/disc_waves.py diameter=2.0 rev=4.0 --output out/waves
    ./gossamer report out/waves
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures, run_case
from demos.common.figures import finish, new_figure, save
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.disc import ring
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.records.outputs.output import Probe

TITLE = "Waves round a spinning disc of film"
HUB = 0.1  # radius of the hub over that of the disc
THICKNESS = 7.5e-6  # m
BLOW = 0.05  # velocity of the blow at the rim [m/s]
HALF_WIDTH = math.pi / 6  # of the part that is struck [rad]
POINTS = 24  # around the axis, of which heights are recorded
AT = 0.9  # their radius over that of the disc: points of the rim itself may be outside of the mesh
NUMBERS = (1, 2, 3, 4)  # of waves around the axis
# Parts of a radius in the closed form: frequencies change by less than 1e-4 with twice as many.
PARTS = 400


def struck(radius: Array, angle: Array) -> Array:
    """Velocity that the blow gives to points at a radius over that of the disc, and at an angle
    from the middle of the part that is struck, -π to π; over the largest one."""
    around = np.cos(math.pi / 2 * angle / HALF_WIDTH) ** 2
    along = (radius - HUB) / (1 - HUB)
    return np.where(np.abs(angle) < HALF_WIDTH, along * around, 0.0)


def mode(n: int, hub: float = HUB, nu: float = KAPTON_HN.nu) -> tuple[float, Array, Array]:
    """ω/Ω of the lowest mode with n nodal diameters, and its shape: radii over that of the disc,
    and deflections (PARTS + 1,).

    Linear elements along a radius; lengths in radii, stresses in ρ Ω² a².
    """
    r = np.linspace(hub, 1.0, PARTS + 1)
    h = r[1] - r[0]
    middle = (r[1:] + r[:-1]) / 2
    # The hub holds the film in its plane, and the rim is free: σ = A ± B/r² - ... r².
    against_hub = (1 - nu**2) * hub**2 / 8 + (1 + nu) * (3 + nu) / (8 * hub**2)
    A = against_hub / (1 - nu + (1 + nu) / hub**2)
    B = (3 + nu) / 8 - A
    radial = A + B / middle**2 - (3 + nu) / 8 * middle**2
    hoop = A - B / middle**2 - (1 + 3 * nu) / 8 * middle**2
    slopes = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h
    products = h / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    K = np.zeros((PARTS + 1, PARTS + 1))
    M = np.zeros_like(K)
    for k, radius in enumerate(middle):
        part = slice(k, k + 2)
        K[part, part] += radius * radial[k] * slopes + n**2 * hoop[k] / radius * products
        M[part, part] += radius * products

    from scipy.linalg import eigh

    squares, shapes = eigh(K[1:, 1:], M[1:, 1:], subset_by_index=[0, 0])
    return math.sqrt(squares[0]), r, np.concatenate([[0.0], shapes[:, 0]])


def amplitude(n: int, spin: float, blow: float) -> float:
    """Amplitude [m] of each of the two waves with the number n at the recorded points, for the spin
    [rad/s] and the velocity of the blow at the rim [m/s]."""
    ratio, r, shape = mode(n)
    angle = np.linspace(-HALF_WIDTH, HALF_WIDTH, 2001)
    around = np.trapezoid(struck(np.ones_like(angle), angle) * np.cos(n * angle), angle) / math.pi
    in_middle = struck(r, np.zeros_like(r))
    along = np.trapezoid(in_middle * shape * r, r) / np.trapezoid(shape**2 * r, r)
    return float(blow * around * along * np.interp(AT, r, shape) / (2 * ratio * spin))


def build(
    comm: MPI.Comm,
    diameter: float = 1.0,
    rev: float = 8.0,
    blow: float = BLOW,
    cells: int = 4,
    turns: float = 8.0,
    steps: int = 60,
) -> gx.Case:
    """The disc in its steady spin, at the time of the blow.

    Args:
        diameter: of the disc [m].
        rev: spin [1/s].
        blow: velocity of the blow at the rim [m/s].
        cells: of order 2 from hub to rim; six times as many around.
        turns: end of the run, in revolutions.
        steps: of a revolution.
    """
    a = diameter / 2
    spin = 2 * math.pi * rev
    along_axis = (0.0, 0.0, spin)

    def velocity(X: Array) -> Array:
        across = blow * struck(np.hypot(X[0], X[1]) / a, np.arctan2(X[1], X[0]))
        return np.stack([0 * X[0], 0 * X[0], across])

    mesh = ring(comm, HUB * a, a, cells, 6 * cells, 2)
    film = gx.Membrane(mesh, KAPTON_HN.law(THICKNESS), order=2, velocity=velocity, name="disc")
    hub = gx.RigidBody(0.1, (1e-4, 1e-4, 1e-4), name="hub", comm=comm)
    region = gx.RigidRegion(film, "hub", rigid_body=hub)
    held = gx.constraints.FixedJoint(hub.frame(), gx.ground_frame())
    steady = gx.Equilibrium(gx.Scene(film, region, held, gx.loads.Centrifugal(film, along_axis)))
    steady.find()
    items = [
        film,
        region,
        gx.StartFrom(steady.system),
        gx.RigidMotion(spin=along_axis),
        gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: spin * t),
    ]
    angles = 2 * math.pi / POINTS * np.arange(POINTS)
    points = [film.port_at((AT * a * math.cos(θ), AT * a * math.sin(θ), 0.0)) for θ in angles]
    probes: dict[str, Probe] = {
        f"height {k} [m]": gx.probes.Displacement(point, "z") for k, point in enumerate(points)
    }
    for n in NUMBERS:
        for part in ("cosine", "sine"):
            probes[f"{part} {n} [m]"] = gx.probes.Waves(points, hub.frame(), number=n, part=part)
    return gx.Case(
        gx.Scene(*items),
        gx.Midpoint(dt=1 / (rev * steps)),
        until=turns / rev,
        title=TITLE,
        probes=probes,
    )


def main(
    output: str | Path | None = None,
    diameter: float = 1.0,
    rev: float = 8.0,
    blow: float = BLOW,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: float,
) -> dict[str, float]:
    """Strike the disc; `given` are arguments of `build`.  With `output`, a folder: a picture.

    Returns for each number n of waves ω/Ω and the amplitude [mm] of the waves forward and backward,
    each next to its closed form, and the error of the energy balance.
    """
    case = build(comm, diameter, rev, blow, **given)  # type: ignore[arg-type]
    run, series = run_case(case)
    spin = 2 * math.pi * rev
    found: dict[str, float] = {}
    for n in NUMBERS:
        waves = gx.analysis.travelling_waves(
            series.time, series[f"cosine {n} [m]"], series[f"sine {n} [m]"]
        )
        found |= {
            f"n = {n}: ω/Ω, closed form": mode(n)[0],
            f"n = {n}: ω/Ω forward": waves.forward_frequency / spin,
            f"n = {n}: ω/Ω backward": waves.backward_frequency / spin,
            f"n = {n}: amplitude, closed form [mm]": 1e3 * amplitude(n, spin, blow),
            f"n = {n}: amplitude forward [mm]": 1e3 * waves.forward,
            f"n = {n}: amplitude backward [mm]": 1e3 * waves.backward,
        }
    if output is not None and comm.rank == 0:
        draw(series, found, rev, Path(output) / "disc_waves.png")
    return {**found, "energy_error": abs(run.energy_error), "steps": run.step}


def draw(series: gx.Series, found: dict[str, float], rev: float, path: Path) -> None:
    """Heights over angle and time in the first revolutions; speeds and amplitudes of the waves."""
    figure = new_figure(12.0, 4.2)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.6, 1.0, 1.0))
    heights = 1e3 * np.array([series[f"height {k} [m]"] for k in range(POINTS)])
    shown = series.time * rev <= 4.0
    # The circle is closed, with the struck part in the middle.
    order = np.arange(-POINTS // 2, POINTS // 2 + 1)
    limit = float(np.abs(heights).max())
    image = left.pcolormesh(
        360 / POINTS * order,
        series.time[shown] * rev,
        heights[order % POINTS][:, shown].T,
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        shading="gouraud",
    )
    figure.colorbar(image, ax=left, label="height [mm]")
    left.set(xlabel="angle round the disc, which turns [deg]", ylabel="revolutions")
    for sense, mark in (("closed form", "k-"), ("forward", "r^"), ("backward", "bv")):
        separator = ", " if sense == "closed form" else " "
        ratios = [found[f"n = {n}: ω/Ω{separator}{sense}"] for n in NUMBERS]
        sizes = [found[f"n = {n}: amplitude{separator}{sense} [mm]"] for n in NUMBERS]
        middle.plot(NUMBERS, np.divide(ratios, NUMBERS), mark, label=sense, mfc="none")
        right.plot(NUMBERS, sizes, mark, label=sense, mfc="none")
    for axes, label in ((middle, "speed of the wave, ω/(n Ω)"), (right, "amplitude [mm]")):
        axes.set_xticks(NUMBERS)
        axes.set_ylim(bottom=0.0)
        finish(axes, "number n of waves around", label)
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/disc_waves"))
