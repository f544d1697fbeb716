"""When is one pressure for the whole bag right?

While a bag is filled within the time T, gas flows through it, and flow needs differences of
pressure. In a tube of length L that is open inside and whose pressure rises as dp/dt = p/T, the gas
enters with the Mach number

    M = L/(γ c T)    and    Δp/p = γ M² = (L/(c T))²/γ

is the difference between the ends: c is the speed of sound in the tube, L/c the time that sound
takes through it.  With T = 10 L/c it is 0.7 %: one chamber is right.  With T = 2 L/c it is 18 %,
and below that sound waves matter, which need a solver of the flow.  A passage of the area a in a
section A loses ½ρu², with A/a times the velocity: Δp/p = γ/2 (M A/a)².  A tube that lies flat or
folded is such a passage.  Take compartments there, with rings (`gx.gas.Ring`) whose deformed area
lets the gas pass.

    left    eight rigid compartments against Δp/p = γ/2 Σ M_k², M_k at the k-th passage, with a = A
    others  a flat tube, as one chamber and as eight compartments, filled within 100 and 5 times
    L/c:
            in the slow filling the pressures at both ends differ by less than 3 % at a tenth of T
            already; in the fast one the gas opens the tube from the inlet on, and one chamber is
            wrong

A passage that is as wide as the tube loses ½ρu² in the model, not in the tube: take compartments
where folds, rings or baffles narrow it.

Where the values come from:
    Δp                 momentum and mass balance of a tube, Bernoulli's equation behind a passage
    tube, gas          of the demo inflate_tube, half as long; filled to about 10 kPa by a choked
                       orifice

    ./gossamer demo uniform_pressure
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from gossamer_fx.extend import Array
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

LENGTH = 0.4  # m
DIAMETER = 0.058  # of the round tube [m]
SECTION = math.pi * DIAMETER**2 / 4
TEMPERATURE = 293.0  # K
PRESSURE = 1e4  # in the full tube, about [Pa]
# Time [s] of sound through the tube.
SOUND = LENGTH / math.sqrt(NITROGEN.gamma * NITROGEN.R * TEMPERATURE)
# 15 bar: the orifice is choked during all of the filling.
SUPPLY = gx.gas.Ambient(1.5e6, TEMPERATURE, name="reservoir")


def inlet_area(T: float) -> float:
    """Effective area [m²] of a choked orifice that fills the round tube to `PRESSURE` within T
    [s]."""
    γ = NITROGEN.gamma
    # γ R T₀ dm/dt = V dp/dt: the gas brings its enthalpy.
    mass_flow = PRESSURE * SECTION * LENGTH / (γ * NITROGEN.R * TEMPERATURE * T)
    # Mass flow of a choked orifice over C A p/√(R T).
    power = (γ + 1) / (2 * (γ - 1))
    choked = math.sqrt(γ) * (2 / (γ + 1)) ** power
    return mass_flow * math.sqrt(NITROGEN.R * TEMPERATURE) / (SUPPLY.pressure * choked)


def spread_of_rigid_tube(T: float, parts: int = 8) -> tuple[float, float]:
    """(p_first - p_last)/p of a round tube of equal compartments at the time T [s], and its closed
    form."""
    tanks = [
        gx.Tank(
            SECTION * LENGTH / parts,
            gas=NITROGEN,
            pressure=10.0,
            temperature=TEMPERATURE,
            name=f"compartment {k}",
        )
        for k in range(parts)
    ]
    passages = [
        gx.Orifice(a, b, area=SECTION, name=f"passage {a.name}") for a, b in pairwise(tanks)
    ]
    inlet = gx.Orifice(SUPPLY, tanks[0], area=inlet_area(T), name="inlet")
    # Two hundred steps resolve the growth of the pressure.
    run = gx.Simulation(gx.Scene(*tanks, inlet, *passages), gx.Midpoint(dt=T / 200))
    run.run(until=T)
    states = list(run.chambers.values())
    pressure = np.array([state.pressure for state in states])
    # Of the gas upstream of each passage: compression heats it above the temperature of the supply.
    temperature = np.array([state.temperature for state in states[:-1]])
    c = np.sqrt(NITROGEN.gamma * NITROGEN.R * temperature)
    # Each passage lets the gas of all compartments behind it pass: 7/8, 6/8, ... of the inflow.
    mach = LENGTH / (NITROGEN.gamma * c * T) * (1 - np.arange(1, parts) / parts)
    closed_form = NITROGEN.gamma / 2 * float((mach**2).sum())
    return float((pressure[0] - pressure[-1]) / pressure.mean()), closed_form


def build(
    comm: MPI.Intracomm, T: float, parts: int, cells: int = 6
) -> tuple[list[gx.Chamber], gx.Case]:
    """The flat tube of some compartments, filled within T [s]."""
    film = gx.Membrane(flat_tube(comm, LENGTH, DIAMETER, cells, parts), KAPTON_HN.law(25e-6))
    rings = [gx.gas.Ring(film, f"ring {k}") for k in range(1, parts)]
    chambers = []
    for k in range(parts):
        chamber = gx.Chamber(
            film,
            gas=NITROGEN,
            pressure=10.0,
            temperature=TEMPERATURE,
            # A flat tube encloses no volume, and a chamber of no volume has no pressure.
            dead_volume=1e-5 / parts,
            surface=(f"compartment {k + 1}",) if parts > 1 else (),
            # Ring k closes compartment k at its end, and opens the next one.
            rings=tuple(rings[max(k - 1, 0) : k + 1]),
            name=f"compartment {k + 1}",
        )
        chambers.append(chamber)
    openings = [gx.Orifice(SUPPLY, chambers[0], area=inlet_area(T), name="inlet")]
    openings += [
        gx.Orifice(chambers[k], chambers[k + 1], area=ring, name=f"passage {k}")
        for k, ring in enumerate(rings)
    ]
    # Damping of the opening film; it does not act on the gas.
    damping = gx.Damping(film, mass_factor=20.0, stiffness_factor=1e-6)
    scene = gx.Scene(film, *chambers, *openings, damping)
    return chambers, gx.Case(scene, gx.Midpoint(dt=T / 200), until=T, title="A flat tube")


def history(comm: MPI.Intracomm, T: float, parts: int, cells: int) -> dict[str, Array]:
    """Time over T, and pressures [Pa] at the inlet and at the tip."""
    chambers, case = build(comm, T, parts, cells)
    names = [chamber.name for chamber in chambers]

    series = gx.Series(
        {
            "inlet": lambda run: run.chamber(names[0]).pressure,
            "tip": lambda run: run.chamber(names[-1]).pressure,
        }
    )
    run = case.simulation([series])
    run.run(until=case.until)
    return {
        "time": np.array(series.time) / T,
        **{name: np.array(series[name]) for name in ("inlet", "tip")},
    }


def draw(
    rigid: dict[float, tuple[float, float]],
    films: dict[float, dict[int, dict[str, Array]]],
    path: Path,
) -> None:
    """Differences of pressure against T, and pressures in the flat tube against time."""
    figure = new_figure(10.5, 3.7)
    left, *others = figure.subplots(1, 1 + len(films))
    T = np.array(list(rigid))
    spread, closed_form = 100 * np.array(list(rigid.values())).T
    left.loglog(T, spread, "o", color=BLUE, label="rigid compartments")
    left.loglog(T, closed_form, color=BLUE, label="γ/2 Σ M²")
    finish(left, "filling time over L/c", "pressure first - last [%]")
    for axes, (ratio, by_parts) in zip(others, films.items(), strict=True):
        one, many = by_parts.values()
        for where, style in (("inlet", "-"), ("tip", "--")):
            label = f"compartments: {where}"
            axes.plot(many["time"], 1e-3 * many[where], style, color=BLUE, label=label)
        axes.plot(one["time"], 1e-3 * one["inlet"], color=RED, label="one chamber")
        axes.set(title=f"T = {ratio:g} L/c", ylim=(0, 14))
        finish(axes, "time over T", "pressure [kPa]", loc="lower right")
    save(figure, path)


def main(
    output: str | Path | None = None,
    cells: int = 6,
    parts: int = 8,
    ratios: tuple[float, ...] = (100.0, 5.0),
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> dict[str, float]:
    """Spread of pressure in a round tube over its closed form, and in the flat tube at T/10.

    Args:
        output: folder of the picture; None: none is drawn.
        cells: triangles across the flat tube.
        parts: compartments of the flat tube.
        ratios: times in which the flat tube is filled, over L/c.
        comm: ranks of the flat tube.
    """
    rigid = {ratio: spread_of_rigid_tube(ratio * SOUND) for ratio in (2.0, 5.0, 10.0, 20.0, 50.0)}
    films: dict[float, dict[int, dict[str, Array]]] = {}
    results = {}
    for ratio, (spread, closed_form) in rigid.items():
        results[f"round tube, T = {ratio:g} L/c: spread [%]"] = 100 * spread
        results[f"round tube, T = {ratio:g} L/c: over closed form"] = spread / closed_form
    for ratio in ratios:
        films[ratio] = {n: history(comm, ratio * SOUND, n, cells) for n in (1, parts)}
        many = films[ratio][parts]
        # At a tenth of the time the fast tube is still flat behind the first compartments.
        early = len(many["time"]) // 10
        difference = many["inlet"][early] - many["tip"][early]
        results[f"flat tube, T = {ratio:g} L/c: spread at T/10 [%]"] = float(
            100 * difference / many["inlet"][early]
        )
    if output is not None and comm.rank == 0:
        draw(rigid, films, Path(output) / "uniform_pressure.png")
    return results


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/uniform_pressure"))
