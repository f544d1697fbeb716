"""Items that hold gas: chambers and tanks, whose state changes, and boundaries, whose state is
constant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import exactly_one
from gossamer_fx.mechanics.bodies.edge_lines import SewnEdges
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.contract import (
    USUAL_PRESSURE,
    USUAL_TEMPERATURE,
    Gas,
    Holder,
    Volume,
)
from gossamer_fx.mechanics.gas.enclosure import Enclosure, FilmEnclosure
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.ring import Ring
from gossamer_fx.mechanics.terms.scalar_unknowns import BringsScalarUnknowns

# Absolute.  Zero is refused because an empty chamber has no mass, and so no temperature.
Pressure = Annotated[float, positive("Pa")]
Temperature = Annotated[float, positive("K")]


@check_arguments
@dataclass(frozen=True, eq=False)
class Ambient(Holder, BringsScalarUnknowns):
    """The surroundings or a supply of gas: constant pressure, by default a vacuum, and constant
    temperature.

    Mass and energy that it gives count as supplied in the energy balance.

    Args:
        pressure: absolute pressure [Pa], ≥ 0.
        temperature: [K], > 0; of gas that flows in from it.
        gas: the gas or mixture that it supplies; None for that of the scene, if it has one species.
        name: in messages.

    Raises:
        InputError: the pressure is negative or the temperature is not a positive number.

    Example:
        >>> vent = gx.Orifice(tank, gx.gas.Ambient(), area=1e-6)
        >>> supply = gx.gas.Ambient(2e5, 300.0, name="supply")
        >>> inlet = gx.Orifice(supply, tank, area=1e-6, name="inlet")
    """

    pressure: Annotated[float, not_negative("Pa")] = 0.0
    temperature: Temperature = 300.0
    _: KW_ONLY
    gas: Gas | None = None
    name: str = "ambient"
    scalar_unknowns = GasNetwork


@check_arguments(exactly_one("enclosure", "volume"))
class Chamber(Volume):
    """A volume of well mixed ideal gas that a closed film, a piston or rigid walls enclose.

    Mass and energy balance of the chamber:

        dm/dt = Σ Y ṁ                                  for each species
        dU/dt = Σ h ṁ - p dV/dt + heat,      p V = T Σ m R,      U = Σ m u(T)

    ṁ are the mass flows [kg/s] of the openings that lead into it, Y and h mass fraction and
    enthalpy [J/kg] of the end from which the gas comes; h = c_p T for constant specific heats.

    Args:
        enclosure: the closed film that bounds it, several films that are sewn together, or a
            `Piston`; None for a rigid chamber.
        gas: the gas at the start, an `IdealGas`, a `PolynomialGas` or a `Mixture`.
        pressure: initial absolute pressure [Pa], > 0.
        temperature: initial temperature [K], > 0.
        dead_volume: rigid volume [m³] that is added to the enclosed one (pipes, a valve); > 0 if
            the enclosure is flat at the start.
        volume: volume [m³] of a rigid chamber, > 0; None with an enclosure.
        surface: names of the groups of triangles that bound the chamber; empty for the whole film.
        rings: closed lines of film edges where no film closes the chamber.  Gas passes there only
            if an `Orifice` has the ring as its area.
        seams: those that close the film or films; they join the scene with the chamber.  Let the
            gas in when they are closed: gas in an open gap pushes, but does not leave.
        outside: what acts on the outer side of the film; None for a vacuum.
        name: in messages, outputs and `run.chamber(name)`.

    Raises:
        InputError: a quantity is out of its range, enclosure and volume are both given or both
            missing, or surface, rings and seams are given without a film.

    Example:
        >>> bag = gx.Chamber(
        ...     film, gas=air, pressure=100.0, temperature=300.0, dead_volume=1e-6, name="bag"
        ... )
    """

    scalar_unknowns = GasNetwork

    USUAL: ClassVar = {
        "initial_temperature": USUAL_TEMPERATURE,
        "initial_pressure": USUAL_PRESSURE,
        "fixed_volume": (0.0, 1e6, "m³", "is it in litres or mm³?"),
    }

    def __init__(
        self,
        enclosure: Membrane | Sequence[Membrane] | Enclosure | None = None,
        *,
        gas: Gas,
        pressure: Pressure,
        temperature: Temperature,
        # Zero is allowed: a film that encloses a volume at the start needs no dead volume.
        dead_volume: Annotated[float, not_negative("m³")] = 0.0,
        volume: Annotated[float, positive("m³")] | None = None,
        surface: tuple[str, ...] = (),
        rings: tuple[Ring, ...] = (),
        seams: Sequence[SewnEdges] = (),
        outside: Ambient | None = None,
        name: str = "chamber",
    ) -> None:
        self.name = name
        self.gas = gas
        self.outside = outside
        self.initial_pressure = pressure
        self.initial_temperature = temperature
        self.fixed_volume = dead_volume if volume is None else volume
        check(
            isinstance(enclosure, Membrane) or not (surface or rings),
            f"Chamber '{name}': surface and rings belong to a film; "
            "give one as enclosure, or leave them out.",
        )
        self.seams = tuple(seams)
        self.enclosure = _enclosure(enclosure, surface, rings, self.seams, name)

    def requires(self) -> Iterable[Any]:
        if self.enclosure is not None:
            yield from self.enclosure.requires()
        if self.outside is not None:
            yield self.outside


@check_arguments
class Tank(Chamber):
    """A rigid chamber, e.g. a bottle that blows down.

    Args:
        volume: [m³], > 0.
        gas: the gas at the start, an `IdealGas`, a `PolynomialGas` or a `Mixture`.
        pressure: initial absolute pressure [Pa], > 0.
        temperature: initial temperature [K], > 0.
        name: in messages, outputs and `run.chamber(name)`.

    Raises:
        InputError: a quantity is not a positive number.

    Example:
        >>> bottle = gx.Tank(1e-3, gas=air, pressure=2e5, temperature=300.0, name="bottle")
    """

    def __init__(
        self,
        volume: Annotated[float, positive("m³")],
        *,
        gas: Gas,
        pressure: Pressure,
        temperature: Temperature,
        name: str = "tank",
    ) -> None:
        super().__init__(
            gas=gas,
            pressure=pressure,
            temperature=temperature,
            volume=volume,
            name=name,
        )


def _enclosure(
    enclosure: Membrane | Sequence[Membrane] | Enclosure | None,
    surface: tuple[str, ...],
    rings: tuple[Ring, ...],
    seams: tuple[SewnEdges, ...],
    chamber: str,
) -> Enclosure | None:
    """Make the enclosure of a chamber from a film, several films that are sewn, or another
    enclosure such as a piston; None if its walls are rigid.  `InputError`: seams are given with
    surface, rings, or without films; several films without seams; a ring is on another film."""
    if isinstance(enclosure, Membrane) and not seams:
        return FilmEnclosure(enclosure, surface, rings, chamber)
    if isinstance(enclosure, Membrane | Sequence):
        # Imported here: a scene without seams does not load them.
        from gossamer_fx.mechanics.gas.sewn import SewnEnclosure

        check(
            not (surface or rings),
            f"Chamber '{chamber}': seams are given together with surface or rings; "
            "sew all of the film, or leave them out.",
        )
        films = (enclosure,) if isinstance(enclosure, Membrane) else tuple(enclosure)
        return SewnEnclosure(films, seams, chamber)
    check(
        not seams,
        f"Chamber '{chamber}': seams belong to films; "
        "give them as enclosure, or leave the seams out.",
    )
    return enclosure
