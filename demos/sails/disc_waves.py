"""Travelling waves round a spinning disc of film whose start is not symmetric.

Two starts.  A flat disc on a hub with a constant rate is in equilibrium with its centrifugal
forces; then a sixth of it is struck across the film.  Or ("folded") the disc of the demo
`spin_deployment` opens from its roll, with a hub off its axis and one tip that is released late.

Waves run round the disc with the spin and against it.  Of a film without bending stiffness (Lamb &
Southwell, Proc. R. Soc. Lond. A 99 (1921) 272; with a hub Eversman & Dodson, AIAA J. 7 (1969) 2010)
the deflection w(r) cos n θ has, with the stresses of the spin,

    (r σ_r w')' - n² σ_θ w/r + ω² ρ r w = 0,   w = 0 at the hub,   r σ_r w' → 0 at the rim

which `mode` solves; masses at the rim, spread around it, add inertia and radial stress there.  A
film that is slack around the axis has σ_θ = 0: its waves have one frequency, whatever n is, as
those of strings from hub to rim.  As seen from the disc the waves run at ω/n forward and backward,
in space at Ω ± ω/n.  ω/Ω has no length in it: discs of 1 m and 2 m have the same.  The blow, a
velocity that grows linearly from hub to rim, gives each wave half of the amplitude that its part of
the blow has in the lowest mode of its number.

Where the values come from:
    diameter 1, 2 m      the spinning films of Miyazaki, KAKENHI 19360384 final report (2009),
                         §4(4), where travelling waves were seen (fig. 5)
    film, hub, spin      as in the demo `spin_deployment`; the disc that is struck has no masses at
                         its rim
    blow                 chosen: 0.05 m/s at the rim, where the spin has 25 m/s.  The closed form
                         is for slopes whose squares are far below the strain of the spin, 1e-4;
                         with `blow=1.0` waves of n = 2 and 4 are 3 and 10 % faster
    folded start         chosen, of the disc of 1 m: 2 mm off the axis, a tip released after 20 ms;
                         air of 100 Pa.  Masses, times and rates of other discs are similar, with
                         the same speed of the tips

    ./gossamer demo disc_waves
    ./gossamer demo disc_waves folded 1.0
    ./gossamer run demos/sails/disc_waves.py diameter=2.0 rev=4.0 --output out/waves
    ./gossamer report out/waves
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.command_line import check_words, number
from demos.common.deployment import UNITS, print_figures, run_case
from demos.common.figures import finish, new_figure, save
from demos.common.spinning import RING_POINTS, heights_of_ring, ring_heights, spin_figures
from demos.sails import spin_deployment
from gossamer_fx.extend import Array, check
from gossamer_fx.meshes.disc import ring
from gossamer_fx.presets.films import KAPTON_HN

TITLE = "Waves round a spinning disc of film"
HUB = 0.1  # radius of the hub over that of the disc
THICKNESS = 7.5e-6  # m
BLOW = 0.05  # velocity of the blow at the rim [m/s]
HALF_WIDTH = math.pi / 6  # of the part that is struck [rad]
# Radius of the recorded points over that of the disc: the rim itself may be outside of the mesh.
AT = 0.9
NUMBERS = (1, 2, 3, 4)  # of waves around the axis
# Parts of a radius in the closed form: frequencies change by less than 1e-4 with twice as many.
PARTS = 400
# The disc that opens is a hexagon of film: its sides are nearer.
AT_OPENED = 0.7
AIR = 1.2e-3  # density at 100 Pa [kg/m³]

# Values for some numbers of waves, by quantity.
Curves = dict[str, list[float]]


def struck(radius: Array, angle: Array) -> Array:
    """Velocity that the blow gives to points at a radius over that of the disc, and at an angle
    from the middle of the part that is struck, -π to π; over the largest one."""
    around = np.cos(math.pi / 2 * angle / HALF_WIDTH) ** 2
    along = (radius - HUB) / (1 - HUB)
    return np.where(np.abs(angle) < HALF_WIDTH, along * around, 0.0)


def mode(
    n: int,
    hub: float = HUB,
    nu: float = KAPTON_HN.nu,
    rim: float = 0.0,
    slack: bool = False,
) -> tuple[float, Array, Array]:
    """ω/Ω of the lowest mode with n nodal diameters, and its shape: radii over that of the disc,
    and deflections (PARTS + 1,).

    Linear elements along a radius; lengths in radii, stresses in ρ Ω² a².

    Args:
        n: nodal diameters, 0 or more.
        hub: radius of the hub over that of the disc.
        nu: Poisson's ratio.
        rim: masses at the rim over that of a disc without a hole.
        slack: whether the film has no stress around the axis.
    """
    r = np.linspace(hub, 1.0, PARTS + 1)
    h = r[1] - r[0]
    middle = (r[1:] + r[:-1]) / 2
    squares = middle**2
    # Stress with which the film pulls the masses inwards.
    at_rim = rim / 2
    if slack:
        radial = (at_rim + (1 - middle**3) / 3) / middle
        hoop = np.zeros_like(middle)
    else:
        # σ = A ± B/r² - c r².  The hub holds the film in its plane, and A + B is given at the rim.
        c_radial = (3 + nu) / 8
        c_hoop = (1 + 3 * nu) / 8
        total = c_radial + at_rim
        of_spin = (1 - nu**2) * hub**4 / 8
        A = (of_spin + (1 + nu) * total) / ((1 - nu) * hub**2 + 1 + nu)
        B = total - A
        radial = A + B / squares - c_radial * squares
        hoop = A - B / squares - c_hoop * squares
    # Integrals over an element of products of its shape functions' slopes, and of their values.
    slopes = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h
    products = np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6
    K = np.zeros((PARTS + 1, PARTS + 1))
    M = np.zeros_like(K)
    for k, radius in enumerate(middle):
        part = slice(k, k + 2)
        along = radius * radial[k]
        around = n**2 * hoop[k] / radius
        K[part, part] += along * slopes
        K[part, part] += around * products
        M[part, part] += radius * products
    M[-1, -1] += at_rim

    from scipy.linalg import eigh

    # Without the node on the hub, which does not move.
    K = K[1:, 1:]
    M = M[1:, 1:]
    lowest = [0, 0]
    eigenvalue, shapes = eigh(K, M, subset_by_index=lowest)
    shape = np.insert(shapes[:, 0], 0, 0.0)
    return math.sqrt(eigenvalue[0]), r, shape


def frequencies(numbers: Sequence[int], **given: Any) -> list[float]:
    """ω/Ω of the lowest modes with some numbers of nodal diameters; `given` are arguments of
    `mode`."""
    return [mode(n, **given)[0] for n in numbers]


def amplitude(n: int, spin: float, blow: float) -> float:
    """Amplitude [m] of each of the two waves with the number n at the recorded points, for the spin
    [rad/s] and the velocity of the blow at the rim [m/s]."""
    ratio, r, shape = mode(n)
    angle = np.linspace(-HALF_WIDTH, HALF_WIDTH, 2001)
    blow_around = struck(np.ones_like(angle), angle)
    around = np.trapezoid(blow_around * np.cos(n * angle), angle) / math.pi
    blow_along = struck(r, np.zeros_like(r))
    mass = np.trapezoid(shape**2 * r, r)
    along = np.trapezoid(blow_along * shape * r, r) / mass
    recorded = np.interp(AT, r, shape)
    velocity = blow * around * along * recorded
    # Half of it runs in each sense.
    return float(velocity / (ratio * spin) / 2)


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
        radius = np.hypot(X[0], X[1]) / a
        angle = np.arctan2(X[1], X[0])
        still = np.zeros_like(angle)
        return np.stack([still, still, blow * struck(radius, angle)])

    inner = HUB * a
    around = 6 * cells
    mesh = ring(comm, inner, a, cells, around, 2)
    law = KAPTON_HN.law(THICKNESS)
    film = gx.Membrane(mesh, law, order=2, velocity=velocity, name="disc")
    inertia = (1e-4, 1e-4, 1e-4)
    hub = gx.RigidBody(0.1, inertia, name="hub", comm=comm)
    region = gx.RigidRegion(film, "hub", rigid_body=hub)
    held = gx.constraints.FixedJoint(hub.frame(), gx.ground_frame())
    centrifugal = gx.loads.Centrifugal(film, along_axis)
    steady = gx.Equilibrium(gx.Scene(film, region, held, centrifugal))
    steady.find()
    motor = gx.constraints.Driven(hub, along_axis, angle=lambda t: spin * t)
    items = [
        film,
        region,
        gx.StartFrom(steady.system),
        gx.RigidMotion(spin=along_axis),
        motor,
    ]
    return gx.Case(
        gx.Scene(*items),
        gx.Midpoint(dt=1 / (rev * steps)),
        until=turns / rev,
        title=TITLE,
        probes=ring_heights(film, AT * a),
    )


def separate(turned: Array, heights: Array, numbers: Sequence[int]) -> Curves:
    """ω/Ω and amplitudes of the strongest waves forward and backward.

    Args:
        turned: angles (n,) [rad] by which the disc has turned.
        heights: (points, n) [m].
        numbers: of waves around the axis.  With 0 an oscillation of the whole ring is the sum of
            two equal halves, one in each sense.
    """
    # As `gx.probes.Waves` has them: a - i b of each number.
    coefficients = 2 * np.fft.fft(heights, axis=0) / len(heights)
    # All points count for a mean, and half of the mean square for a cosine.
    coefficients[0] /= 2
    found = []
    for n in numbers:
        part = coefficients[n]
        # Angles for times: the spin of a disc that opens changes, ω/Ω much less.
        found.append(gx.analysis.travelling_waves(turned, part.real, -part.imag))
    return {
        "ω/Ω forward": [waves.forward_frequency for waves in found],
        "ω/Ω backward": [waves.backward_frequency for waves in found],
        "amplitude forward [mm]": [1e3 * waves.forward for waves in found],
        "amplitude backward [mm]": [1e3 * waves.backward for waves in found],
    }


def named(numbers: Sequence[int], curves: Curves) -> dict[str, float]:
    """The curves as figures with a name each."""
    found: dict[str, float] = {}
    for k, n in enumerate(numbers):
        found |= {f"n = {n}: {name}": curve[k] for name, curve in curves.items()}
    return found


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
    turned = spin * series.time
    heights = heights_of_ring(series)
    curves = {
        "ω/Ω closed form": frequencies(NUMBERS),
        "amplitude closed form [mm]": [1e3 * amplitude(n, spin, blow) for n in NUMBERS],
        **separate(turned, heights, NUMBERS),
    }
    if output is not None and comm.rank == 0:
        shown = turned <= 4 * 2 * math.pi
        path = Path(output) / "disc_waves.png"
        draw(turned[shown], heights[:, shown], NUMBERS, curves, path)
    found = named(NUMBERS, curves)
    return {**found, "energy_error": abs(run.energy_error), "steps": run.step}


def similar(diameter: float) -> dict[str, float]:
    """Arguments of `spin_deployment.build` for a disc of a diameter [m], with a start that is not
    symmetric."""
    return {
        "diameter": diameter,
        "rev": 8.0 / diameter,
        "tip": 2e-3 * diameter**2,
        "inertia": 1.25e-4 * diameter**4,
        "offset": 2e-3 * diameter,
        "stuck": 0.02 * diameter,
        "air": AIR,
        "damping": 1e-4 * diameter,
        "dt": 4e-4 * diameter,
        "largest": 4e-3 * diameter,
    }


def folded(
    output: str | Path | None = None,
    diameter: float = 1.0,
    until: float = 8.0,
    opened: float = 0.5,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: Any,
) -> dict[str, float]:
    """Open the disc from its roll, and separate the waves that it then has.  With `output`, a
    folder: a recording and pictures.

    Args:
        output: folder.
        diameter: of the disc [m].
        until: end of the run of a disc of 1 m [s]; of others in proportion to the diameter.
        opened: time from which waves are counted, in the same way; the film is straight before it.
        comm: the communicator.
        given: arguments of `spin_deployment.build`, which replace those of `similar`.

    Returns:
        figures of `spin_figures`, and for each number n of waves ω/Ω and the amplitude [mm] forward
        and backward, next to ω/Ω of the closed forms of a disc and of slack film.
    """
    numbers = (0, *NUMBERS)
    arguments = similar(diameter) | given
    end = until * diameter
    case = spin_deployment.build(comm, until=end, ring=AT_OPENED, **arguments)
    # Pictures are denser at first, where the roll opens fast.
    parts = (0.0, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
    run, series = run_case(case, output, "folded_disc", parts, spin_deployment.VIEW)
    counted = series.time >= opened * diameter
    time = series.time[counted]
    spin = series["spin of the sail [rad/s]"][counted]
    mean_spin = (spin[1:] + spin[:-1]) / 2
    turned = np.cumsum(mean_spin * np.diff(time))
    turned = np.insert(turned, 0, 0.0)
    heights = heights_of_ring(series)[:, counted]
    tips = 0.0
    for item in case.scene.items:
        if isinstance(item, gx.connectors.AttachedMass):
            tips += item.mass
    area = math.pi * diameter**2 / 4
    rim = tips / (KAPTON_HN.density * THICKNESS * area)
    curves = {
        "ω/Ω closed form": frequencies(numbers, rim=rim),
        "ω/Ω closed form, slack": frequencies(numbers, rim=rim, slack=True),
        **separate(turned, heights, numbers),
    }
    if output is not None and comm.rank == 0:
        path = Path(output) / "folded_waves.png"
        draw(turned, heights, numbers, curves, path)
    return {
        **spin_figures(run, series),
        "revolutions": turned[-1] / (2 * math.pi),
        **named(numbers, curves),
    }


def draw(turned: Array, heights: Array, numbers: Sequence[int], curves: Curves, path: Path) -> None:
    """Heights [m] over angle and turned angle [rad]; frequencies and amplitudes of the waves."""
    figure = new_figure(12.0, 4.2)
    widths = (1.6, 1.0, 1.0)
    left, middle, right = figure.subplots(1, 3, width_ratios=widths)
    # The circle is closed, with the first point in the middle.
    order = np.arange(-RING_POINTS // 2, RING_POINTS // 2 + 1)
    limit = 1e3 * float(np.abs(heights).max())
    angles = 360 / RING_POINTS * order
    revolutions = turned / (2 * math.pi)
    image = left.pcolormesh(
        angles,
        revolutions,
        1e3 * heights[order % RING_POINTS].T,
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        shading="gouraud",
    )
    figure.colorbar(image, ax=left, label="height [mm]")
    left.set(xlabel="angle round the disc, which turns [deg]", ylabel="revolutions")
    marks = {"forward": "r^", "backward": "bv", "closed form": "k-", "closed form, slack": "k:"}
    for name, curve in curves.items():
        axes = middle if name.startswith("ω/Ω") else right
        of = name.removeprefix("ω/Ω ").removeprefix("amplitude ").removesuffix(" [mm]")
        axes.plot(numbers, curve, marks[of], label=of, mfc="none")
    for axes, label in ((middle, "frequency of the wave, ω/Ω"), (right, "amplitude [mm]")):
        axes.set_xticks(numbers)
        axes.set_ylim(bottom=0.0)
        finish(axes, "number n of waves around", label)
    save(figure, path, TITLE)


if __name__ == "__main__":
    if sys.argv[1:2] == ["folded"]:
        numbers = [number(word) for word in sys.argv[2:]]
        check(
            len(numbers) <= 3,
            f"{len(numbers)} numbers are given; give at most three: DIAMETER UNTIL OPENED.",
        )
        print_figures(folded("out/folded_waves", *numbers), UNITS)
    else:
        check_words(sys.argv[1:], ["folded"])
        print_figures(main(output="out/disc_waves"))
