"""A rigid vessel that empties or fills through an orifice, with heat from its wall.

The gas is ideal and well mixed.  The wall has one temperature T_w.  It takes heat from the gas by
free convection (McAdams, Heat Transmission, 1954, of upright plates), and gives it to the
surroundings by a constant coefficient:

    Q = h A (T_w - T),   h L/k = max(0.59 Ra^(1/4), 0.13 Ra^(1/3)),
    Ra = g |T_w - T|/T_f L³ ρ² c_p/(μ k)                                                        (1)

with the height L of the vessel: its length if it stands, its diameter if it lies.  The properties
of the gas are those at the mean temperature T_f of gas and wall, with powers of the temperature for
its viscosity μ and conductivity k.  h and T_w are those at the start of each step.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import CompiledWall, GasNetwork, Wall

G = 9.81
# Steps of the quick form over those of the full one.
QUICK_FACTOR = 4


@dataclass(frozen=True)
class Substance:
    """A gas.

    Attributes:
        gas: its law.
        viscosity: μ [Pa s] at 300 K.
        conductivity: k [W/(m K)] at 300 K.
        power: of the temperature to which both are proportional.
    """

    gas: gx.IdealGas
    viscosity: float
    conductivity: float
    power: float


# Viscosities and conductivities: Kays & Crawford, Convective Heat and Mass Transfer, appendix A.
SUBSTANCES = {
    "air": Substance(gx.IdealGas(gamma=1.4, R=287.05), 1.846e-5, 0.0263, 0.75),
    "hydrogen": Substance(gx.IdealGas(gamma=1.405, R=4124.0), 8.96e-6, 0.183, 0.7),
}


@dataclass(eq=False)
class StoringWall(Wall):
    """A wall that stores heat.

    Attributes:
        chamber: what it encloses.
        temperature: T_w [K] at the start of the next step.
        conductance: h A [W/K] of the next step.
        name: in messages.
    """

    chamber: gx.Tank
    temperature: float
    conductance: float = 0.0
    name: str = "wall"
    scalar_unknowns = GasNetwork

    def requires(self) -> Iterable[Any]:
        yield self.chamber

    def compile(self, geometry: Any) -> CompiledWall:
        """Temperature and conductance that are set before each step."""
        return CompiledWall(lambda h: (self.temperature, self.conductance))


@dataclass(frozen=True)
class Vessel:
    """Sizes of a round vessel with flat ends and its wall, in SI units.

    Attributes:
        length: inside.
        diameter: inside.
        height: L of (1).
        heat_capacity: of the wall [J/K].
    """

    length: float
    diameter: float
    height: float
    heat_capacity: float

    @classmethod
    def read(cls, inputs: Inputs) -> Vessel:
        """The inputs of a test."""
        length = inputs.number("length", "m", above=0)
        diameter = inputs.number("diameter", "m", above=0)
        wall = inputs.number("wall_thickness", "m", above=0)
        outside = math.pi / 4 * (diameter + 2 * wall) ** 2 * (length + 2 * wall)
        inside = math.pi / 4 * diameter**2 * length
        stands = inputs.word("orientation", ("vertical", "horizontal")) == "vertical"
        per_volume = inputs.number("wall_density", "kg/m3", above=0) * inputs.number(
            "wall_heat_capacity", "J/(kg K)", above=0
        )
        return cls(
            length=length,
            diameter=diameter,
            height=length if stands else diameter,
            heat_capacity=(outside - inside) * per_volume,
        )

    @property
    def volume(self) -> float:
        return math.pi / 4 * self.diameter**2 * self.length

    @property
    def area(self) -> float:
        """Of the inside of the wall [m²]."""
        return math.pi * self.diameter * (self.length + self.diameter / 2)


def convection(
    substance: Substance, height: float, pressure: float, temperature: float, wall: float
) -> float:
    """h [W/(m² K)] of (1).

    Args:
        substance: the gas.
        height: L [m].
        pressure: of the gas [Pa].
        temperature: T of the gas [K].
        wall: T_w [K].
    """
    film = (temperature + wall) / 2
    factor = (film / 300.0) ** substance.power
    viscosity = substance.viscosity * factor
    conductivity = substance.conductivity * factor
    density = pressure / (substance.gas.R * film)
    rayleigh = (G * abs(wall - temperature) / film * height**3 * density**2 * substance.gas.cp) / (
        viscosity * conductivity
    )
    nusselt = max(0.59 * rayleigh**0.25, 0.13 * rayleigh ** (1 / 3))
    return nusselt * conductivity / height


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Absolute pressure [Pa] and temperature [K] against time [s]."""
    begun = time.process_time()
    vessel = Vessel.read(inputs)
    substance = SUBSTANCES[inputs.word("gas", tuple(SUBSTANCES))]
    start = inputs.number("start_temperature", "K", above=0)
    outside = inputs.number("outside_temperature", "K", above=0)
    outer = inputs.number("outer_coefficient", "W/(m2 K)")
    # A factor of h, by which the uncertainty of (1) is stated.
    factor = inputs.number("convection_factor", "1")
    step = inputs.number("step", "s", above=0) * (QUICK_FACTOR if quick else 1)
    start_pressure = inputs.number("start_pressure", "Pa", above=0)
    tank = gx.Tank(
        vessel.volume,
        gas=substance.gas,
        pressure=start_pressure,
        temperature=start,
        name="vessel",
    )
    wall = StoringWall(tank, start)
    ambient = gx.gas.Ambient(inputs.number("outside_pressure", "Pa", above=0), outside)
    diameter = inputs.number("orifice_diameter", "m", above=0)
    orifice = gx.Orifice(
        tank,
        ambient,
        area=math.pi / 4 * diameter**2,
        discharge_coefficient=inputs.number("discharge_coefficient", "1", above=0),
    )
    run = gx.Simulation(gx.Scene(tank, wall, orifice), gx.Midpoint(dt=step))
    times = [0.0]
    pressures = [start_pressure]
    temperatures = [start]
    steps = math.ceil(inputs.number("duration", "s", above=0) / step)
    for number in range(1, steps + 1):
        gas = temperatures[-1]
        coefficient = factor * convection(
            substance, vessel.height, pressures[-1], gas, wall.temperature
        )
        wall.conductance = coefficient * vessel.area
        run.run(until=number * step)
        state = run.chamber("vessel")
        gain = wall.conductance * (state.temperature - wall.temperature)
        gain += outer * vessel.area * (outside - wall.temperature)
        wall.temperature += step * gain / vessel.heat_capacity
        times.append(number * step)
        pressures.append(state.pressure)
        temperatures.append(state.temperature)
    t = np.array(times)
    quantities = {
        "pressure": Predicted(np.array(pressures), t),
        "temperature": Predicted(np.array(temperatures), t),
    }
    details = {
        "temperature of the wall at the end [K]": wall.temperature,
        "energy error": run.energy_error,
        "steps": float(steps),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)
