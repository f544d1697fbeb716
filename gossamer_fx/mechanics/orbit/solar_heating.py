"""Temperature of a film in sunlight, and its heat balance.

Each triangle has one temperature T.  Per area of the stress-free film

    C dT/dt = α_lit S |a·u| + ε_f q F_f + ε_b q F_b + ... - (ε_f + ε_b) σ |a| (T⁴ - T_space⁴)    (1)

with the flux S of sunlight along u, eclipse included, the area vector a of the deformed triangle
over its stress-free area, and the absorptivity of the face that is lit; F are view factors of both
faces to the central body, which sends infrared and reflected sunlight (`orbit.film_heat`).

The temperatures are advanced once at the beginning of a step of the motion, with the fluxes at its
middle: the orbit there is known, and the shape is extrapolated as q0 + ½ h v0.  That is of order 2
in the step. The film then moves under the thermal strain of its temperatures; nothing goes back but
its shape.

Heat has its own balance (`HeatBalance`): the heat of a film is 1e8 times its elastic energy, and
would hide the errors of the mechanical one.  The heat that thermal expansion turns into work is not
taken from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.model.item import Item
from gossamer_fx.extend import (
    Array,
    Assembly,
    Body,
    CompiledTerms,
    Compiler,
    HasSystem,
    HistoryVariables,
    Indices,
    MeshBody,
    Range,
    Shown,
    State,
    Term,
    area_vector,
    cell_nodes,
    check,
    check_arguments,
    compile_expression,
    compile_form,
    not_negative,
    positive,
    thermal_strain_of,
)
from gossamer_fx.mechanics.bodies.membrane import FullFilm
from gossamer_fx.mechanics.bodies.properties import cells_of_group
from gossamer_fx.mechanics.orbit.film_heat import STEFAN_BOLTZMANN, advance, substeps, view_factor
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.optics import Share
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.mechanics.orbit.shadow_map import ShadowMap
from gossamer_fx.mechanics.orbit.sky import AU
from gossamer_fx.mechanics.orbit.solar_pressure import Pixels

# Speed of light [m/s], exact: the flux of sunlight over its pressure.
LIGHT_SPEED = 299792458.0

# The middle of a reference triangle.
MIDDLE = np.array([[1 / 3, 1 / 3]])

# No film is hotter than the largest temperature, and the fourth power of larger numbers
# overflows.
Temperature = Annotated[float, Range(0.0, 1e5, unit="K")]

# Temperature of the sky [K].
SPACE_TEMPERATURE = 2.7


@check_arguments
@dataclass(frozen=True)
class HeatBalance:
    """Heat of a film at one time of a run; see `SolarHeating.balance`.

    Attributes:
        time: [s].
        stored: ∫ C T dA [J].
        stored_first: the same at the start of the run.
        absorbed: heat [J] that was absorbed since then.
        emitted: heat [J] that was emitted.
        lowest: temperature [K] of the coldest triangle.
        highest: of the hottest one.
        mean: over the heat capacity.

    Example:
        >>> from gossamer_fx.mechanics.orbit.solar_heating import HeatBalance
        >>> HeatBalance(1.0, 110.0, 100.0, 15.0, 5.0, 290.0, 310.0, 300.0).error
        0.0
    """

    time: float
    stored: float
    stored_first: float
    absorbed: float
    emitted: float
    lowest: float
    highest: float
    mean: float

    @property
    def error(self) -> float:
        """Closing error of the balance, over the largest of its heats."""
        missing = self.stored - self.stored_first - self.absorbed + self.emitted
        largest = max(self.stored, self.stored_first, self.absorbed, self.emitted)
        return missing / largest if largest else 0.0


@check_arguments
@dataclass(frozen=True)
class ThermalProperties:
    """What a film does with heat: capacity, absorptivity and emissivity.

    Args:
        heat_capacity: C, per area [J/(m² K)]: specific heat times density times thickness.
        absorptivity: share of sunlight that is absorbed, 0 to 1: one number, or those of front and
            back. It is 1 - reflectivity of `Optics`.
        emissivity: in the infrared, 0 to 1: one number, or those of front and back.

    Raises:
        InputError: a value out of its range.

    Example:
        >>> aluminised = gx.orbit.ThermalProperties(11.0, absorptivity=0.1, emissivity=(0.03, 0.5))
        >>> aluminised.emissivities
        (0.03, 0.5)
    """

    heat_capacity: Annotated[float, positive("J/(m² K)")]
    _: KW_ONLY
    absorptivity: Share | tuple[Share, Share]
    emissivity: Share | tuple[Share, Share]

    def __post_init__(self) -> None:
        check(
            sum(self.emissivities) > 0 or sum(self.absorptivities) == 0,
            "ThermalProperties: the film absorbs and does not radiate; give a positive emissivity.",
        )

    @property
    def absorptivities(self) -> tuple[float, float]:
        """Absorptivities of front and back."""
        return _of_faces(self.absorptivity)

    @property
    def emissivities(self) -> tuple[float, float]:
        """Emissivities of front and back."""
        return _of_faces(self.emissivity)


@check_arguments
class SolarHeating(Item):
    """Temperature of the triangles of a film in orbit, heated by sunlight and cooled by radiation.

    The module describes the equation and its solution.  A film with thermal expansion expands by
    these temperatures; one without only has them, as field "temperature".  The mesh normal points
    to the front.

    Args:
        film: a membrane or plate; a plate has one temperature across its thickness.
        orbit: the orbit of the scene, which tells sunlight and eclipse.
        properties: of the film.
        groups: other properties, by the names of groups of its triangles.
        initial_temperature: [K]; default that of the film's thermal expansion.
        space_temperature: of the sky [K].
        infrared: flux that the central body radiates [W/m²] at its surface; of the Earth 237.
        albedo: share of sunlight that the central body reflects, 0 to 1; of the Earth 0.3.  Where
            the film flies, the ground below it counts as lit like a diffuse sphere.
        shadow_pixels: as of `SolarPressure`: shadow of the film on itself; 0: none.
        name: for messages; default from the film.

    Raises:
        InputError: a value out of its range; a temperature that the film has as a function of time.

    Example:
        >>> aluminised = gx.orbit.ThermalProperties(11.0, absorptivity=0.1, emissivity=(0.03, 0.5))
        >>> heating = gx.orbit.SolarHeating(film, orbit, aluminised, initial_temperature=250.0)
        >>> heating.name
        'heating of film'
    """

    def __init__(
        self,
        film: FullFilm,
        orbit: Orbit,
        properties: ThermalProperties,
        *,
        groups: Mapping[str, ThermalProperties] | None = None,
        initial_temperature: Temperature | None = None,
        space_temperature: Temperature = SPACE_TEMPERATURE,
        infrared: Annotated[float, not_negative("W/m²")] = 0.0,
        albedo: Share = 0.0,
        shadow_pixels: Pixels = 0,
        name: str = "",
    ) -> None:
        self.film = film
        self.orbit = orbit
        self.properties = properties
        self.groups = dict(groups or {})
        self.initial_temperature = initial_temperature
        self.space_temperature = space_temperature
        self.infrared = infrared
        self.albedo = albedo
        self.shadow_pixels = shadow_pixels
        self.name = name or f"heating of {film.name}"
        check(
            initial_temperature is not None or film.thermal is not None,
            f"'{self.name}': the temperature at the start is not known; "
            "give initial_temperature in K.",
        )
        # Weak keys: an item does not keep the compiled scenes of earlier runs in memory.
        self._temperatures: WeakKeyDictionary[Assembly, FilmTemperatures] = WeakKeyDictionary()

    def requires(self) -> Iterable[Any]:
        yield self.film
        yield self.orbit

    def terms(self, start: State) -> Iterable[Term]:
        yield HeatedFilm(self.name, self)

    @check_arguments
    def balance(self, run: HasSystem) -> HeatBalance:
        """The heat balance of a run in its present state.  Collective."""
        unknowns = run.system.unknowns
        check_in_scene(f"'{self.name}'", unknowns in self._temperatures)
        return self._temperatures[unknowns].balance()


def _of_faces(value: float | tuple[float, float]) -> tuple[float, float]:
    """The values of front and back."""
    values = np.broadcast_to(np.asarray(value, dtype=float), (2,))
    return float(values[0]), float(values[1])


class FilmTemperatures:
    """The temperatures of one film in one compiled scene: T (n,) [K] of the triangles that this
    rank owns, of the accepted state, and `T_before` of that before the last step."""

    def __init__(self, heating: SolarHeating, system: Assembly) -> None:
        """Take the initial temperatures and the stress-free areas [m²], and compile the area
        vectors.  Collective."""
        self.heating = heating
        self.film = film = heating.film
        self._system = system
        mesh = film.space.mesh
        cells = mesh.topology.index_map(2)
        self._owned = cells.size_local
        scalars = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
        of_cells = cell_nodes(scalars)[: self._owned, 0]
        areas = fem.assemble_vector(compile_form(ufl.TestFunction(scalars) * ufl.dx))
        self._areas = areas.array[of_cells].copy()
        self._take_properties()
        self._x = fem.Function(film.space)
        vectors = fem.functionspace(mesh, ("Discontinuous Lagrange", 0, (3,)))
        self._area_vectors = fem.Function(vectors)
        self._vector_of_cell = cell_nodes(vectors)[: self._owned, 0]
        # Stretched triangles of order 2 have the area vector of their middle.
        self._area_expression = compile_expression(area_vector(film.deformation(self._x)), MIDDLE)
        self._shades: ShadowMap | None = None
        if heating.shadow_pixels:
            self._shades = ShadowMap(film, heating.shadow_pixels)
        # None for a film without thermal expansion.
        self._strain = thermal_strain_of(system, film)
        self.T: Array = self._initial()
        self.T_before = self.T.copy()
        # Heat [J] since the start, and stored at the start, this rank's shares.
        self._heat_absorbed = 0.0
        self._heat_emitted = 0.0
        self._first = self._stored()
        # Of a step that is not accepted yet: temperatures, and heat [J] absorbed and emitted.
        self._pending: tuple[Array, float, float] | None = None
        if self._strain is not None:
            self._strain.is_heated = True
            self._expand(self.T)
            self._strain.commit()

    def _take_properties(self) -> None:
        """Set the heat capacities `_C` (n,) [J/(m² K)] and, for front and back, `_absorptivities`
        and `_emissivities` (n, 2) of the triangles that this rank owns."""
        heating = self.heating
        table = np.zeros((self._owned, 5))

        def row(properties: ThermalProperties) -> list[float]:
            """Heat capacity, then absorptivities and emissivities, front and back each."""
            faces = (*properties.absorptivities, *properties.emissivities)
            return [properties.heat_capacity, *faces]

        table[:] = row(heating.properties)
        for group, properties in heating.groups.items():
            cells = cells_of_group(self.film.mesh, group, f"'{heating.name}'")
            table[cells[cells < self._owned]] = row(properties)
        self._C = table[:, 0]
        self._absorptivities = table[:, 1:3]
        self._emissivities = table[:, 3:5]

    def _initial(self) -> Array:
        """The temperatures (n,) [K] of this rank's triangles at the start: the item's
        `initial_temperature`, or the mean over the nodes of each triangle of the film's thermal
        expansion.  `InputError`: that has a temperature that is a function of time."""
        heating = self.heating
        strain = self._strain
        if strain is not None:
            check(
                not strain.in_time,
                f"'{heating.name}' computes the temperature of '{self.film.name}', "
                "whose thermal expansion has a function for it; "
                "give a number there, the temperature at the start.",
            )
        if heating.initial_temperature is not None:
            return np.full(self._owned, float(heating.initial_temperature))
        assert strain is not None  # as the item has checked
        nodes = cell_nodes(strain.start_temperature.function_space)[: self._owned]
        return strain.start_temperature.x.array[nodes].mean(axis=1)

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self) -> None:
        """Advance the temperatures over the step `system.h` [s], with the heat [J] absorbed and
        emitted in it; `commit` accepts them.  The film takes the thermal strain of its new
        temperatures.  Collective."""
        system = self._system
        flight = self.heating.orbit.flight(system)
        flight.prepare(system)
        # C dT/dt = A - B T⁴: A [W/m²] absorbed flux, B [W/(m² K⁴)] emission coefficient, C [J/(m²
        # K)] heat capacity, T [K] temperature, each (n,) for this rank's triangles.
        A, B = self._fluxes(flight)
        C = self._C
        h = system.h
        # The number of sub-steps must not depend on the partition of the mesh.
        count = system.comm.allreduce(substeps(self.T, h, C, A, B), op=MPI.MAX)
        T, emitted = advance(self.T, h, C, A, B, count=count)
        self._pending = (T, h * float(A @ self._areas), float(emitted @ self._areas))
        self._expand(T)

    def commit(self) -> None:
        """Accept the step that `begin_step` has computed; nothing if there is none."""
        if self._pending is None:
            return
        T, absorbed, emitted = self._pending
        # In place: a restart writes to these arrays.
        self.T_before[:] = self.T
        self.T[:] = T
        if not self._system.rule.is_static:
            # The pseudo-time of a search for rest is none in which heat flows.
            self._heat_absorbed += absorbed
            self._heat_emitted += emitted
        self._pending = None

    def take_time(self, t: float) -> None:
        """Drop a step that was not accepted; the film has the thermal strain of a time t [s] again,
        the present one or that before the last step."""
        self._pending = None
        is_before = t < self._system.time
        self._expand(self.T_before if is_before else self.T)

    def _expand(self, T: Array) -> None:
        """Give the film the thermal strain of temperatures T (n,) [K] at the end of the step;
        nothing for a film without thermal expansion."""
        if self._strain is None:
            return
        function = self._strain.end_temperature
        nodes = cell_nodes(function.function_space)[: self._owned]
        function.x.array[nodes] = T[:, None]
        function.x.scatter_forward()

    def _fluxes(self, flight: Flight) -> tuple[Array, Array]:
        """Absorbed flux A (n,) [W/m²] and emission coefficient B (n,) [W/(m² K⁴)] of the heat
        equation C dT/dt = A - B T⁴, per stress-free area of this rank's triangles.  Collective.

        u (3,) is the unit vector along the sunlight; a (n, 3) are the area vectors in the middle of
        the step over the stress-free areas [-], and the stretch is their length.
        """
        heating = self.heating
        u, pressure = flight.light()
        a = self._middle_area_vectors()
        stretch = np.linalg.norm(a, axis=1)
        towards_light = -(a @ u)
        front, back = self._absorptivities.T
        absorbing = np.where(towards_light > 0, front, back)
        sunlight = LIGHT_SPEED * pressure * np.abs(towards_light) * absorbing
        if self._shades is not None:
            self._shades.update(self._system, u)
            sunlight *= self._shades.lit.x.array[: self._owned]
        B = STEFAN_BOLTZMANN * self._emissivities.sum(axis=1) * stretch
        A: Array = sunlight + B * heating.space_temperature**4
        if heating.infrared > 0 or heating.albedo > 0:
            A += self._from_central_body(flight, a, stretch)
        return A, B

    def _from_central_body(self, flight: Flight, a: Array, stretch: Array) -> Array:
        """Absorbed flux (n,) [W/m²] of infrared and reflected sunlight of the central body, per
        stress-free area, summed over both faces of each triangle; a (n, 3) and the stretch (n,) are
        those of `_fluxes`."""
        heating = self.heating
        around = flight.around
        distance = float(np.linalg.norm(flight.R))
        outward = flight.R / distance
        height = max(distance / around.radius, 1.0)
        # Triangles without area absorb nothing, whatever their normal is.
        cosines = -(a @ outward) / np.where(stretch > 0, stretch, 1.0)
        of_front = view_factor(cosines, height)
        of_back = view_factor(-cosines, height)
        sun = around.sun(flight.time)
        # Distance from the Sun [m]; AU below is the astronomical unit [m].
        way = float(np.linalg.norm(sun - flight.R))
        # Sunlight at the ground below, also while the film is in the shadow.
        reflected = 0.0
        if np.any(sun):
            zenith_cosine = max(float(outward @ sun) / float(np.linalg.norm(sun)), 0.0)
            solar_flux = LIGHT_SPEED * around.pressure * (AU / way) ** 2
            reflected = heating.albedo * solar_flux * zenith_cosine
        of_faces = np.column_stack([of_front, of_back])
        absorbed = self._absorptivities * reflected + self._emissivities * heating.infrared
        return stretch * (absorbed * of_faces).sum(axis=1)

    def _middle_area_vectors(self) -> Array:
        """Area vectors (n, 3) [-] of this rank's triangles at q0 + ½ h v0, over their stress-free
        areas.  Collective."""
        of_film = self._system.state[self.film]
        middle = of_film.coordinates() + self._system.h / 2 * of_film.rates()
        self.film.reconstruct(self._x, middle.ravel())
        self._area_vectors.interpolate(self._area_expression)
        return self._area_vectors.x.array.reshape(-1, 3)[self._vector_of_cell]

    # ---- the heat balance ------------------------------------------------------------------------

    def _stored(self) -> float:
        """∫ C T dA [J], this rank's share."""
        return float((self._C * self.T) @ self._areas)

    def sums(self) -> Array:
        """Absorbed, emitted and first stored heat [J] (3,), of all ranks.  Collective."""
        own = np.array([self._heat_absorbed, self._heat_emitted, self._first])
        return self._system.comm.allreduce(own)

    def set_sums(self, sums: Sequence[float]) -> None:
        """Restore what `sums` returned."""
        # Rank 0 has the sums of all ranks, so that they count once.
        share = float(self._system.comm.rank == 0)
        absorbed, emitted, first = sums
        self._heat_absorbed = share * absorbed
        self._heat_emitted = share * emitted
        self._first = share * first

    def balance(self) -> HeatBalance:
        """The heat balance of the accepted state, of all triangles; the same on every rank.
        Collective."""
        comm = self._system.comm
        sums = self.sums()
        own = np.array([self._stored(), float(self._C @ self._areas)])
        # Heat [J] and heat capacity [J/K] of all triangles; T below: temperatures [K] of this
        # rank's.
        stored, capacity = comm.allreduce(own).tolist()
        extremes = np.array([self.T.max(initial=-np.inf), -self.T.min(initial=np.inf)])
        comm.Allreduce(MPI.IN_PLACE, extremes, op=MPI.MAX)
        return HeatBalance(
            time=self._system.time,
            stored=stored,
            stored_first=float(sums[2]),
            absorbed=float(sums[0]),
            emitted=float(sums[1]),
            lowest=float(-extremes[1]),
            highest=float(extremes[0]),
            mean=stored / capacity,
        )


class HeatedFilms(HistoryVariables, Shown, CompiledTerms["HeatedFilm"]):
    """All `HeatedFilm` terms of a scene."""

    def __init__(self, terms: Sequence[HeatedFilm], system: Assembly) -> None:
        """Make the temperatures of each heated film; `InputError` if one is heated twice.
        Collective."""
        self._films: list[FilmTemperatures] = []
        for term in terms:
            heating = term.heating
            check(
                all(other.film is not heating.film for other in self._films),
                f"'{heating.name}': the film '{heating.film.name}' is heated twice; "
                "leave one of both out.",
            )
            temperatures = FilmTemperatures(heating, system)
            heating._temperatures[system] = temperatures
            self._films.append(temperatures)

    def begin_step(self, t: float) -> None:
        for one in self._films:
            one.begin_step()

    def commit(self) -> None:
        for one in self._films:
            one.commit()

    def take_time(self, t: float) -> None:
        for one in self._films:
            one.take_time(t)

    def get_history(self) -> dict[str, Any]:
        """Absorbed, emitted and first stored heat [J] of each film.  Collective."""
        return {"heats": [one.sums().tolist() for one in self._films]}

    def shape_history(self) -> dict[str, Any]:
        # The heat of a run that starts from these temperatures counts from its start.
        return {"heats": [[0.0, 0.0, one.balance().stored] for one in self._films]}

    def set_history(self, state: dict[str, Any]) -> None:
        for one, sums in zip(self._films, state["heats"], strict=True):
            one.set_sums(sums)

    def cell_history(self) -> dict[str, tuple[MeshBody, Array]]:
        """The temperatures [K] of the films, and those before the last step."""
        found: dict[str, tuple[MeshBody, Array]] = {}
        for k, one in enumerate(self._films):
            found[f"temperature {k}"] = (one.film, one.T)
            found[f"temperature before {k}"] = (one.film, one.T_before)
        return found

    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        """Numbers and temperatures [K] of this rank's triangles of a heated film, for the field
        "temperature"; None for other fields and bodies."""
        if field != "temperature":
            return None
        for one in self._films:
            if one.film is body:
                return np.arange(len(one.T), dtype=np.int32), one.T
        return None


@dataclass(frozen=True, eq=False)
class HeatedFilm:
    """The temperatures of a film that is heated."""

    name: str
    heating: SolarHeating
    compiler: ClassVar[Compiler] = HeatedFilms
