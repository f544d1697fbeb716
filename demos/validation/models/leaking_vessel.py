"""A rigid vessel that gas flows into at a measured rate, and out of through a leak.

Volume flows are those of a meter: at the pressure p_a and the temperature of the surroundings.  A
laminar leak lets C (p - p_a) out.  At constant temperature a vessel of volume V then decays by

    p - p_a = (p - p_a)_0 exp(-k t),    k = C p_a/V                                             (1)

C is that of one measured decay, which is an input.  An orifice instead, the input "leak", has
the same flow at the mean pressure of that decay.  A wall of large conductance holds the
temperature.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import Gas, GasNetwork, Opening, check

AIR = gx.IdealGas(gamma=1.4, R=287.05)

# Steps of the quick form over those of the full one.
QUICK_FACTOR = 10


@dataclass(frozen=True, eq=False)
class OwnOpening(Opening):
    """An opening from a to b, of which one is the chamber and one the surroundings."""

    a: gx.Chamber | gx.gas.Ambient
    b: gx.Chamber | gx.gas.Ambient
    scalar_unknowns = GasNetwork

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b


@dataclass(frozen=True, eq=False)
class Inflow(OwnOpening):
    """Flow from the surroundings, with their temperature, that is a function of time.

    Attributes:
        mass_flow: [kg/s] at a time [s].
        name: in messages.
    """

    mass_flow: Callable[[float], float]
    name: str = "inflow"

    def aperture(self, geometry: Any) -> Callable[[float, float], float]:
        """The mass flow [kg/s] of a step, instead of an area: it depends on nothing else."""
        return lambda h, t: self.mass_flow(t)

    def flow(
        self,
        gases: tuple[Gas, Gas],
        area: float,
        p: tuple[complex, complex],
        T: tuple[complex, complex],
    ) -> complex:
        """The mass flow [kg/s] that `aperture` gives."""
        return area


@dataclass(frozen=True, eq=False)
class LaminarLeak(OwnOpening):
    """Flow from the chamber that is proportional to the difference of pressures.

    Attributes:
        conductance: mass flow over the difference of pressures [kg/(s Pa)].
        name: in messages.
    """

    conductance: float
    name: str = "leak"

    def aperture(self, geometry: Any) -> Callable[[float, float], float]:
        """The conductance, instead of an area."""
        return lambda h, t: self.conductance

    def flow(
        self,
        gases: tuple[Gas, Gas],
        area: float,
        p: tuple[complex, complex],
        T: tuple[complex, complex],
    ) -> complex:
        """Mass flow [kg/s] from the chamber."""
        return area * (p[0] - p[1])


@dataclass(frozen=True)
class Air:
    """The surroundings, and the decay of a vessel by its leak, in SI units.

    Attributes:
        pressure: p_a.
        temperature: of the surroundings and of the wall.
        wall_conductance: by which the wall holds the temperature of the gas [W/K].
    """

    pressure: float
    temperature: float
    wall_conductance: float

    @classmethod
    def read(cls, inputs: Inputs) -> Air:
        """The inputs of a test."""
        return cls(
            pressure=inputs.number("ambient_pressure", "Pa", above=0),
            temperature=inputs.number("temperature", "K", above=0),
            wall_conductance=inputs.number("wall_conductance", "W/K"),
        )

    @property
    def density(self) -> float:
        """Of the gas at ambient conditions [kg/m³]."""
        return self.pressure / (AIR.R * self.temperature)

    def gauge_of(self, run: gx.Simulation) -> float:
        """Pressure [Pa] of the vessel over that of the surroundings, a probe."""
        return float(run.chamber("vessel").pressure - self.pressure)

    def ambient(self) -> gx.gas.Ambient:
        return gx.gas.Ambient(self.pressure, self.temperature)

    def wall(self, chamber: gx.Chamber) -> gx.gas.WallHeat:
        return gx.gas.WallHeat(chamber, self.wall_conductance, temperature=self.temperature)

    def inflow(
        self, ambient: gx.gas.Ambient, chamber: gx.Chamber, times: Array, flows: Array
    ) -> Inflow:
        """Volume flows (n,) [m³/s] of a meter at times (n,) [s], with straight lines in between."""
        return Inflow(
            ambient,
            chamber,
            mass_flow=lambda t: self.density * float(np.interp(t, times, flows)),
        )


def decay_rate(times: Array, pressures: Array) -> float:
    """k [1/s] of (1), the slope of the straight line through the logarithms of gauge pressures."""
    slope, _ = np.polyfit(times, np.log(pressures), 1)
    return -float(slope)


def leak_of(
    inputs: Inputs, air: Air, volume: float, chamber: gx.Chamber, ambient: gx.gas.Ambient
) -> LaminarLeak | gx.Orifice:
    """The leak by which the vessel of a volume [m³] has the known decay."""
    times = inputs.numbers("known_times", "s")
    pressures = inputs.numbers("known_pressures", "Pa")
    check(
        len(times) == len(pressures) > 1 and bool((pressures > 0).all()),
        f"{inputs.where}: give as many known_pressures as known_times, all above 0.",
    )
    # C of (1) times the density at which the meter reads flows.
    rate = decay_rate(times, pressures)
    conductance = rate * volume / air.pressure * air.density
    if inputs.word("leak", ("laminar", "orifice")) == "laminar":
        return LaminarLeak(chamber, ambient, conductance)
    mean = float(pressures.mean())
    unit = gx.Orifice(chamber, ambient, area=1.0)
    both_temperatures = (air.temperature, air.temperature)
    per_area = unit.flow((AIR, AIR), 1.0, (air.pressure + mean, air.pressure), both_temperatures)
    return gx.Orifice(chamber, ambient, area=conductance * mean / per_area.real, name="leak")


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Gauge pressure [Pa] against time [s], and its rate of decay [1/s]."""
    begun = time.process_time()
    air = Air.read(inputs)
    volume = inputs.number("volume", "m3", above=0)
    start = inputs.number("start_pressure", "Pa")
    duration = inputs.number("duration", "s", above=0)
    step = inputs.number("step", "s", above=0) * (QUICK_FACTOR if quick else 1)
    ambient = air.ambient()
    vessel = gx.Tank(
        volume,
        gas=AIR,
        pressure=air.pressure + start,
        temperature=air.temperature,
        name="vessel",
    )
    items = [air.wall(vessel), leak_of(inputs, air, volume, vessel, ambient)]
    if "inflow" in inputs:
        times = inputs.numbers("inflow_times", "s")
        items.append(air.inflow(ambient, vessel, times, inputs.numbers("inflow", "m3/s")))
    series = gx.Series({"pressure": air.gauge_of})
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=step), outputs=[series])
    run.run(until=math.ceil(duration / step) * step)
    t = series.time
    gauge = series["pressure"]
    quantities = {"pressure": Predicted(gauge, t)}
    if "inflow" not in inputs:
        quantities["rate of decay"] = Predicted(decay_rate(t, gauge))
    details = {
        "temperature at the end [K]": float(run.chamber("vessel").temperature),
        "energy error": run.energy_error,
        "steps": float(run.step),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)
