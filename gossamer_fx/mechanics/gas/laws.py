"""The laws of a gas network: heats of gases, flows through openings, heat through walls, and the
weights of a step, as functions of named numbers for `core.laws`.

The numbers of an opening or gas are those of its fields that are real numbers, and those of its
tables.  They are arguments of its law, so that two openings of a kind share one compiled function;
what else its methods read becomes part of the code.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.laws.law import Law, compile_law
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.mechanics.gas.contract import CompiledWall, DynamicOpening, Gas, Opening
from gossamer_fx.mechanics.gas.mixture import Blend
from gossamer_fx.mechanics.gas.tables import LinearTable

# Coefficient of the second term of (5) of `gas.balance`.  It keeps 1 - θ below a quarter of
# Ψ*²/(2z²) ≈ 0.05/z².
DAMPING_COEFFICIENT = 40


def numbers_of(item: Any) -> list[float]:
    """The numbers of an item of a scene, in the order of `with_numbers`."""
    found: list[float] = []
    for value in _values(item).values():
        found += _numbers_in(value)
    return found


def _numbers_in(value: float | LinearTable) -> list[float]:
    """A number, or those of a table."""
    if isinstance(value, LinearTable):
        return [number for point in value.points for number in point]
    return [value]


def position_of(opening: Opening, name: str) -> int:
    """Where a number of an opening stands in `numbers_of`.  `InputError`: it is not a number among
    its fields."""
    first = 0
    for field, value in _values(opening).items():
        if field == name:
            return first
        first += len(_numbers_in(value))
    value = getattr(opening, name, None)
    raise InputError(
        f"{type(opening).__name__} '{opening.name}': its '{name}' is {value!r}; "
        "make it a field of the dataclass, and give a number."
    )


def with_numbers(item: Any, numbers: Iterator[Number]) -> Any:
    """A copy of an item with other numbers, of which symbols are some."""
    values = _values(item)
    if not values:
        return item
    same = object.__new__(type(item))
    for name, value in vars(item).items():
        # What was computed from the numbers is computed again.
        if not isinstance(getattr(type(item), name, None), cached_property):
            object.__setattr__(same, name, value)
    for name, value in values.items():
        if isinstance(value, LinearTable):
            table = object.__new__(LinearTable)
            table.points = tuple((next(numbers), next(numbers)) for _ in value.points)
            object.__setattr__(same, name, table)
        else:
            object.__setattr__(same, name, next(numbers))
    return same


def _values(item: Any) -> dict[str, Any]:
    """Real numbers and tables among the fields of an item."""
    if not is_dataclass(item):
        return {}
    # What gradients and states are of may be given as a whole number.
    named: set[str] = set()
    if isinstance(item, Opening):
        named = {*item.parameters, *_variables(item)}
    values = {}
    for field in fields(item):
        value = getattr(item, field.name, None)
        if field.name in named and isinstance(value, int):
            value = float(value)
        if isinstance(value, float | LinearTable):
            values[field.name] = value
    return values


def _variables(opening: Opening) -> list[str]:
    """Names of the state variables of an opening."""
    return list(opening.variables) if isinstance(opening, DynamicOpening) else []


class GasAtEnd(Gas):
    """The gas at one end of an opening as its law sees it, of numbers of any kind: R, γ and mass
    fractions are arguments of the law."""

    def __init__(
        self, species: Sequence[Gas], state: Sequence[Number], fractions: Sequence[Number]
    ) -> None:
        """Of a state: pressure [Pa], temperature [K], R [J/(kg K)], γ; and fractions of species."""
        _, self._temperature, self.R, self._ratio = state
        self.name = species[0].name
        self._species = tuple(species)
        self.fractions = fractions

    @property
    def species(self) -> tuple[Gas, ...]:
        return self._species

    @property
    def constant_heat_ratio(self) -> None:
        """It may change with the temperature."""
        return

    def heat_ratio(self, T: Number) -> Number:
        """γ, at the temperature of the end an argument of the law."""
        is_constant = len(self._species) == 1 and self._species[0].constant_heat_ratio is not None
        if T is self._temperature or is_constant:
            return self._ratio
        return self._blend.heat_ratio(T)

    def heat_capacity(self, T: Number) -> Number:
        return self.R / (self.heat_ratio(T) - 1)

    def energy(self, T: Number) -> Number:
        return self._blend.energy(T)

    def enthalpy(self, T: Number) -> Number:
        return self._blend.enthalpy(T)

    @property
    def _blend(self) -> Blend:
        return Blend(self._species, self.fractions, self.name)


class FlowLaw:
    """The mass flow through an opening, and the rates of its state variables, as a law: of p, T, R,
    γ and mass fractions at both ends, its effective area and its numbers.

    Attributes:
        end_count: number of arguments for one end.
        numbers: of the opening.
        variable_names, variables: of its state variables, and where they are in the arguments.
        start_values: of the state variables at the start of a run.
        parameters: its numbers by which gradients are derived.
    """

    def __init__(self, opening: Opening, species: Sequence[Gas]) -> None:
        self._opening = opening
        self._species = list(species)
        self.end_count = 4 + len(self._species)
        self.numbers = numbers_of(opening)
        ends = []
        for side in "ab":
            shares = [f"Y_{side}{number}" for number in range(len(self._species))]
            ends += [f"p_{side}", f"T_{side}", f"R_{side}", f"gamma_{side}", *shares]
        self._ends = ends
        self._names = [*ends, "area", *(f"number_{i}" for i in range(len(self.numbers)))]
        first = 2 * self.end_count + 1
        self.variable_names = _variables(opening)
        positions = [position_of(opening, name) for name in self.variable_names]
        self.variables = [first + position for position in positions]
        self.start_values = [self.numbers[position] for position in positions]
        self.parameters = list(opening.parameters)
        self._by_parameters = [
            self._names[first + position_of(opening, name)] for name in self.parameters
        ]

    @property
    def output_count(self) -> int:
        """The flow and the rates."""
        return 1 + len(self.variables)

    def __call__(self, *arguments: Number) -> list[Number]:
        """Mass flow [kg/s] from the first to the second end, and rates."""
        count = self.end_count
        a = arguments[:count]
        b = arguments[count : 2 * count]
        area = arguments[2 * count]
        opening = with_numbers(self._opening, iter(arguments[2 * count + 1 :]))
        gases = (
            GasAtEnd(self._species, a[:4], a[4:]),
            GasAtEnd(self._species, b[:4], b[4:]),
        )
        p = (a[0], b[0])
        T = (a[1], b[1])
        outputs = [opening.flow(gases, area, p, T)]
        if isinstance(opening, DynamicOpening):
            rates = opening.rates(p, T)
            check(
                set(rates) == set(self.variable_names),
                f"{type(opening).__name__} '{opening.name}': its rates are of {sorted(rates)}; "
                f"return one for each of its state variables {sorted(self.variable_names)}.",
            )
            outputs += [rates[name] for name in self.variable_names]
        return outputs

    def compile(self, by_count: int, comm: MPI.Intracomm) -> Law:
        """Flow and rates with derivatives by the first properties of both ends, and by state
        variables.  Collective."""
        second = self.end_count
        by = [*self._ends[:by_count], *self._ends[second : second + by_count]]
        by += [self._names[number] for number in self.variables]
        return compile_law(
            self, by=by, comm=comm, names=self._names, output_count=self.output_count
        )

    def compile_slopes(self, comm: MPI.Intracomm) -> Law:
        """Flow, rates and derivatives of the flow by both pressures, with derivatives by all
        properties of both ends, the area, state variables and parameters.  Collective."""
        by = [*self._ends, "area", *(self._names[number] for number in self.variables)]
        by += self._by_parameters
        return compile_law(
            self,
            by=by,
            comm=comm,
            names=self._names,
            output_count=self.output_count,
            slopes_by=("p_a", "p_b"),
        )


def heat_law(gas: Gas, comm: MPI.Intracomm) -> tuple[Law, list[float]]:
    """Energy u [J/kg] and c_v [J/(kg K)] of a species as a law of its temperature [K] and its
    numbers, which are returned, too.  Collective."""
    numbers = numbers_of(gas)

    def heat(T: Number, *given: Number) -> tuple[Number, Number]:
        same = with_numbers(gas, iter(given))
        return same.energy(T), same.heat_capacity(T)

    names = ["T", *(f"number_{i}" for i in range(len(numbers)))]
    return compile_law(heat, by=["T"], comm=comm, names=names, output_count=2), numbers


def wall_law(wall: CompiledWall, comm: MPI.Intracomm) -> Law:
    """Heat [W] to a chamber and conductance [W/K] of a wall as a law of the temperatures of gas and
    wall [K] and the size of the wall.  Collective."""

    def heat(T: Number, outside: Number, size: Number) -> tuple[Number, Number]:
        conductance = size * wall.coefficient(T, outside)
        return conductance * (outside - T), conductance

    return compile_law(heat, by=("T", "outside", "size"), comm=comm, output_count=2)


def flow_weight(relaxation: Number, equalisation: Number) -> Number:
    """The weight θ of the end of a step in flows, (4) and (5) of `gas.balance`, for ζ and z: of the
    length of the step over the time in which the pressure relaxes, ζ ≥ 0, and over that in which
    pressures equalise."""
    # Both terms of (4) grow as 1/ζ; below 1e-3 the series is exact to 1e-12 and does not cancel.
    if relaxation < 1e-3:
        fitted = 0.5 + relaxation / 12
    else:
        fitted = -1 / np.expm1(-relaxation) - 1 / relaxation
    damping = DAMPING_COEFFICIENT * equalisation**4 / (1 + equalisation**2)
    return 1 - 1 / (1 / (1 - fitted) + damping)
