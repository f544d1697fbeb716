"""When is one pressure right?  Tubes of one and more compartments against the one-dimensional gas.

A compartment has one pressure and no velocity: waves and the inertia of the gas are left out.

    shock tube    two halves at 1 and 0.1 bar without a wall between them (G. A. Sod, J. Comput.
                  Phys. 27 (1978) 1), against the exact solution of the Riemann problem
    inlet β       a closed tube at 0.1 bar fills from a reservoir of 1 bar through an inlet of β
                  times its cross section, against Euler's equations: finite volumes of second order
                  (HLL fluxes, van Leer's limiter), themselves checked by the shock tube

Compartments are joined by openings of the whole cross section A.  By hand: the first wave in a tube
has the pressure ρ a u = ṁ a/A ≈ 0.81 β p for a choked inlet, and a tube of one pressure lacks that;
each opening takes the dynamic pressure of its flow, which a smooth tube keeps, so that a chain of
n compartments resists n times: refinement does not lead to the smooth tube.
"""

from __future__ import annotations

import functools
import itertools
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study
from gossamer_fx.extend import Array, Result, isentropic_flow

AIR = gx.IdealGas(gamma=1.4, R=287.0, name="air")
GAMMA = AIR.gamma
LENGTH = 1.0  # m
AREA = 1e-3  # m²
HIGH = 1e5  # Pa
LOW = 1e4  # Pa
# Sod's densities are 1 and 0.125 kg/m³; his time is 0.2 L/√(p/ρ).
DENSITIES = (1.0, 0.125)
SOD_TIME = 0.2 * LENGTH / math.sqrt(HIGH)
WARM = 300.0  # temperature of the reservoir and of the tube at the start [K]
# Time in which sound passes the tube [s]
PASSAGE = LENGTH / math.sqrt(GAMMA * AIR.R * WARM)
COURANT = 0.5
# Inlet over cross section, and cells of the finite volumes: slow fillings need many steps.
INLETS = {"inlet 1": (1.0, 400), "inlet 0.1": (0.1, 100), "inlet 0.01": (0.01, 40)}
SHOCK_TUBE = "shock tube"
SOD_CELLS = 400
COMPARTMENTS = [1, 4, 16]
# End of a filling in units of L/(β a), and how its time is divided.
UNTIL = 3.0
SAMPLES = 60
STEPS_OF_A_SAMPLE = 5

# Density [kg/m³], velocity [m/s] and pressure [Pa]
State = tuple[float, float, float]


# ---- the exact Riemann problem -------------------------------------------------------------------


def wave_velocity(p: float, density: float, pressure: float) -> float:
    """Change of the velocity [m/s] across a wave from a state into one of the pressure p: a shock,
    or a rarefaction (Toro, Riemann Solvers, 3rd ed., eqs. 4.6 and 4.7)."""
    if p > pressure:
        slope = 2 / ((GAMMA + 1) * density)
        return (p - pressure) * math.sqrt(slope / (p + (GAMMA - 1) / (GAMMA + 1) * pressure))
    sound = math.sqrt(GAMMA * pressure / density)
    return 2 * sound / (GAMMA - 1) * ((p / pressure) ** ((GAMMA - 1) / (2 * GAMMA)) - 1)


def sod_pressure(x: Array, t: float) -> Array:
    """Pressure [Pa] of Sod's tube at x [m]: rarefaction to the left, shock to the right."""

    def mismatch(p: float) -> float:
        left = wave_velocity(p, DENSITIES[0], HIGH)
        return left + wave_velocity(p, DENSITIES[1], LOW)

    between = float(brentq(mismatch, LOW, HIGH, xtol=1e-9 * LOW))
    sound = math.sqrt(GAMMA * HIGH / DENSITIES[0])
    speed = (x - LENGTH / 2) / t
    within = 2 / (GAMMA + 1) - (GAMMA - 1) / (GAMMA + 1) * speed / sound
    fan = HIGH * np.clip(within, 0.0, 1.0) ** (2 * GAMMA / (GAMMA - 1))
    ratio = between / LOW
    factor = (GAMMA + 1) / (2 * GAMMA) * ratio + (GAMMA - 1) / (2 * GAMMA)
    shock = math.sqrt(GAMMA * LOW / DENSITIES[1] * factor)
    return np.where(speed < shock, np.maximum(fan, between), LOW)


# ---- finite volumes ------------------------------------------------------------------------------


def primitive(U: Array) -> Array:
    """Density, velocity and pressure (3, n) from densities of mass, momentum and energy (3, n)."""
    velocity = U[1] / U[0]
    return np.stack([U[0], velocity, (GAMMA - 1) * (U[2] - U[1] * velocity / 2)])


def conserved(W: Array) -> Array:
    """The reverse of `primitive`."""
    return np.stack([W[0], W[0] * W[1], W[2] / (GAMMA - 1) + W[0] * W[1] ** 2 / 2])


def physical_flux(W: Array) -> Array:
    """Flux of mass, momentum and energy (3, n)."""
    total = GAMMA / (GAMMA - 1) * W[2] + W[0] * W[1] ** 2 / 2
    return np.stack([W[0] * W[1], W[0] * W[1] ** 2 + W[2], W[1] * total])


def hll_flux(left: Array, right: Array) -> Array:
    """Flux between two states (3, n) (Harten, Lax and van Leer 1983)."""
    sounds = [np.sqrt(GAMMA * W[2] / W[0]) for W in (left, right)]
    slowest = np.minimum(left[1] - sounds[0], right[1] - sounds[1]).clip(max=0.0)
    fastest = np.maximum(left[1] + sounds[0], right[1] + sounds[1]).clip(min=0.0)
    jump = slowest * fastest * (conserved(right) - conserved(left))
    sum_of_fluxes = fastest * physical_flux(left) - slowest * physical_flux(right)
    return np.asarray((sum_of_fluxes + jump) / (fastest - slowest))


def inlet_flux(ratio: float, inside: State) -> Array:
    """Flux (3,) at the inlet from the reservoir into the state of the first cell.

    Gas flows by the law of `gx.Orifice`, mixes over the cross section at the pressure behind the
    inlet, and this pressure and velocity are connected to the cell by a wave.
    """
    density, velocity, pressure = inside
    h0 = AIR.cp * WARM
    choked = HIGH * (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))

    def mixed(p: float) -> tuple[float, float]:
        """Mass flux [kg/(m² s)] and velocity of the gas from the reservoir at the pressure p."""
        G = ratio * float(isentropic_flow(AIR, HIGH, WARM, p, 1e-9).real)
        if G == 0:
            return 0.0, 0.0
        share = AIR.cp * p / (AIR.R * G)
        # The root of h0 = c_p T + u²/2 with T = p u/(R G), without cancellation
        return G, 2 * h0 / (share + math.sqrt(share**2 + 2 * h0))

    def behind(p: float) -> tuple[float, float]:
        """Density and velocity of the gas of the cell behind its wave."""
        at_p = density * (p / pressure) ** (1 / GAMMA)
        return at_p, velocity + wave_velocity(p, density, pressure)

    def leaving(p: float) -> float:
        """Flux towards the reservoir by the state behind the wave, less that by the law."""
        at_p, u = behind(p)
        T = p / (at_p * AIR.R)
        T_total = T + u**2 / (2 * AIR.cp)
        p_total = p * (T_total / T) ** (GAMMA / (GAMMA - 1))
        by_law = 0.0
        if p_total > HIGH:
            by_law = ratio * float(isentropic_flow(AIR, p_total, T_total, HIGH, 1e-9).real)
        return -at_p * u - by_law

    if behind(HIGH)[1] >= 0:
        # At this pressure the mixed gas has the speed of sound; below it the gas in the tube
        # expands by itself.
        lowest = ratio * choked
        p = lowest
        if mixed(lowest)[1] > behind(lowest)[1]:
            p = float(brentq(lambda p: mixed(p)[1] - behind(p)[1], lowest, HIGH, xtol=1e-3))
        G, u = mixed(p)
        return np.array([G, p + G * u, G * h0])
    p = float(brentq(leaving, HIGH, 20 * HIGH, xtol=1e-3)) if ratio < 1 else HIGH
    at_p, u = behind(p)
    return physical_flux(np.array([[at_p], [u], [p]]))[:, 0]


def euler_pressures(U: Array, times: Array, inlet: Callable[[State], Array] | None) -> Array:
    """Pressures (times, cells) [Pa] in a tube from densities of mass, momentum and energy (3,
    cells) [SI]; both ends are walls, or the left one is an inlet."""
    cell = LENGTH / U.shape[1]

    def rate(U: Array) -> Array:
        W = primitive(U)
        # A mirrored cell beyond each end, for the slopes
        mirror = np.array([[1.0], [-1.0], [1.0]])
        steps = np.diff(np.hstack([mirror * W[:, :1], W, mirror * W[:, -1:]]))
        product = steps[:, :-1] * steps[:, 1:]
        sums = steps[:, :-1] + steps[:, 1:]
        # Half of van Leer's slope, the harmonic mean of both; zero at an extremum
        slope = np.zeros_like(product)
        np.divide(product, sums, out=slope, where=product > 0)
        # A wall has mirrored states on both sides: no mass or energy passes it.
        left = np.hstack([mirror * (W[:, :1] - slope[:, :1]), W + slope])
        right = np.hstack([W - slope, mirror * (W[:, -1:] + slope[:, -1:])])
        flux = hll_flux(left, right)
        if inlet is not None:
            density, velocity, pressure = right[:, 0].tolist()
            flux[:, 0] = inlet((density, velocity, pressure))
        return -np.diff(flux) / cell

    found = []
    t = 0.0
    for sample in times:
        while t < sample:
            W = primitive(U)
            fastest = float(np.max(np.abs(W[1]) + np.sqrt(GAMMA * W[2] / W[0])))
            h = min(COURANT * cell / fastest, sample - t)
            # Heun's method
            first = U + h * rate(U)
            U = (U + first + h * rate(first)) / 2
            t = sample if h == sample - t else t + h
        found.append(primitive(U)[2])
    return np.array(found)


# ---- references ----------------------------------------------------------------------------------


@functools.cache
def reference(tube: str) -> tuple[Array, Array]:
    """Times [s] of samples, and pressures (times, cells) [Pa] of the one-dimensional gas."""
    if tube == SHOCK_TUBE:
        return np.array([SOD_TIME]), sod_pressure(centres(SOD_CELLS), SOD_TIME)[None]
    ratio, cells = INLETS[tube]
    times = np.linspace(0, UNTIL, SAMPLES + 1)[1:] * PASSAGE / ratio
    density = LOW / (AIR.R * WARM)
    U = conserved(np.outer([density, 0.0, LOW], np.ones(cells)))
    return times, euler_pressures(U, times, functools.partial(inlet_flux, ratio))


def centres(cells: int) -> Array:
    """Their positions x [m]."""
    return (np.arange(cells) + 0.5) / cells * LENGTH


def finite_volume_error(cells: int) -> float:
    """Mean error of the finite volumes in the shock tube, over the high pressure."""
    x = centres(cells)
    is_left = x < LENGTH / 2
    W = np.stack([np.where(is_left, *DENSITIES), 0 * x, np.where(is_left, HIGH, LOW)])
    found = euler_pressures(conserved(W), np.array([SOD_TIME]), None)[0]
    return float(np.abs(found - sod_pressure(x, SOD_TIME)).mean()) / HIGH


# ---- compartments --------------------------------------------------------------------------------


def chain(tube: str, n: int) -> gx.Scene:
    """The tube as n compartments."""
    tanks = []
    for k in range(n):
        pressure = LOW
        temperature = WARM
        if tube == SHOCK_TUBE:
            # One compartment has the mass and energy of both halves.
            left = min(max(n / 2 - k, 0.0), 1.0)
            pressure = left * HIGH + (1 - left) * LOW
            density = left * DENSITIES[0] + (1 - left) * DENSITIES[1]
            temperature = pressure / (AIR.R * density)
        tank = gx.Tank(
            AREA * LENGTH / n, gas=AIR, pressure=pressure, temperature=temperature, name=f"{k}"
        )
        tanks.append(tank)
    openings = [
        gx.Orifice(first, second, area=AREA, name=f"joint {second.name}")
        for first, second in itertools.pairwise(tanks)
    ]
    if tube in INLETS:
        supply = gx.gas.Ambient(HIGH, WARM, name="reservoir")
        area = INLETS[tube][0] * AREA
        openings.append(gx.Orifice(supply, tanks[0], area=area, name="inlet"))
    return gx.Scene(*tanks, *openings)


def problem(comm: MPI.Comm, tube: str, compartments: int) -> dict[str, float]:
    """Run one tube, and compare its pressures with those of the one-dimensional gas."""
    times, exact = reference(tube)
    # Sod's tube has one sample.
    steps = STEPS_OF_A_SAMPLE if len(times) > 1 else SAMPLES
    run = gx.Simulation(chain(tube, compartments), gx.Midpoint(dt=float(times[0]) / steps))
    start = time.process_time()
    found = []
    for sample in times:
        run.run(until=float(sample))
        found.append([state.pressure for state in run.chambers.values()])
    seconds = time.process_time() - start
    pressures = np.array(found)
    cells = exact.shape[1]
    at_cells = pressures[:, np.arange(cells) * compartments // cells]
    difference = float(np.abs(at_cells - exact).mean(axis=1).max()) / HIGH
    numbers = {"seconds": seconds, "difference": difference, "energy_error": abs(run.energy_error)}
    if tube == SHOCK_TUBE:
        reference_error = finite_volume_error(SOD_CELLS)
        return numbers | {"difference/β": difference, "reference_error": reference_error}
    filled = time_to_fill(times, pressures.mean(axis=1))
    exactly = time_to_fill(times, exact.mean(axis=1))
    return numbers | {
        "difference/β": difference / INLETS[tube][0],
        "t90 a/L": filled / PASSAGE,
        "1-D t90 a/L": exactly / PASSAGE,
        "t90/1-D": filled / exactly,
    }


def time_to_fill(times: Array, mean: Array) -> float:
    """Time [s] at which the mean pressure [Pa] has passed 90 % of its way to the reservoir's; NaN
    if it has not."""
    aim = LOW + 0.9 * (HIGH - LOW)
    return float(np.interp(aim, mean, times, right=math.nan))


def draw(results: list[Result], path: Path) -> None:
    """The one-dimensional gas at the closed end, and what compartments leave of it."""
    from demos.common.figures import BLUE, GREEN, GREY, RED, finish, new_figure, save

    figure = new_figure(10.5, 3.6)
    end, difference, filling = figure.subplots(1, 3)
    colours = {SHOCK_TUBE: GREY, **dict(zip(INLETS, (RED, BLUE, GREEN), strict=True))}
    for tube, colour in colours.items():
        curve = [result for result in results if result.values["tube"] == tube]
        if not curve:
            continue
        curve = sorted(curve, key=lambda result: result.values["compartments"])
        n = [result.values["compartments"] for result in curve]
        error = [result.numbers["difference"] for result in curve]
        difference.loglog(n, error, "o-", color=colour, label=tube)
        if tube == SHOCK_TUBE:
            continue
        times, exact = reference(tube)
        share = times * INLETS[tube][0] / PASSAGE
        end.plot(share, exact[:, -1] / HIGH, color=colour, label=tube)
        late = [result.numbers.get("t90/1-D", math.nan) for result in curve]
        filling.semilogx(n, late, "o-", color=colour, label=tube)
    finish(end, "time β a/L", "pressure at the closed end, 1-D [bar]")
    difference.set_ylim(3e-4, 2)
    finish(difference, "compartments", "largest mean difference from 1-D [bar]", loc="lower left")
    finish(filling, "compartments", "time to 90 % over that of 1-D")
    for axes in (difference, filling):
        axes.set_xticks(COMPARTMENTS, [str(n) for n in COMPARTMENTS])
        axes.minorticks_off()
    save(figure, path)


STUDY = Study(
    "one_pressure",
    "Tubes of compartments against the one-dimensional gas",
    problem,
    # One pressure comes last: it is what is judged.
    {"tube": [SHOCK_TUBE, *INLETS], "compartments": COMPARTMENTS[::-1]},
    lambda case: 1 / case["compartments"],
    (Measure("difference/β", 0.0, 1.0),),
    quick={"tube": [SHOCK_TUBE, "inlet 1"], "compartments": [4, 1]},
    shows=("t90/1-D", "reference_error"),
    limits={"energy_error": 1e-12, "reference_error": 2e-3},
    columns="difference, t90 a/L, 1-D t90 a/L, t90/1-D, reference_error, energy_error, seconds",
    draw=draw,
)
