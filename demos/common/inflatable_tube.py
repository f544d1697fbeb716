"""Inflatable tubes of compartments, folded or flat, in one call."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.properties import Property
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.constraints.fixed import Fixed
from gossamer_fx.mechanics.gas.ideal_gas import IdealGas
from gossamer_fx.mechanics.gas.orifice import Orifice
from gossamer_fx.mechanics.gas.ring import Ring
from gossamer_fx.mechanics.gas.volumes import Ambient, Chamber, Tank
from gossamer_fx.mechanics.materials.film import FilmLaw

if TYPE_CHECKING:
    from gossamer_fx.build.fold.fold_map import Folded, FoldMap
    from gossamer_fx.mechanics.connectors.crease import Crease
    from gossamer_fx.mechanics.constraints.rigid_region import RigidRegion
    from gossamer_fx.mechanics.contact.contact import Contact
    from gossamer_fx.mechanics.contact.obstacles import Obstacle


@check_arguments
class InflatableTube:
    """A closed tube of film with gas in compartments: an assembly of film, chambers, passages and
    supports.

    Attributes that were not asked for are None or empty.  In a scene the tube brings all of them.

    Args:
        mesh: of the film, with the groups of `gossamer_fx.meshes.tube.flat_tube`: if there are
            several compartments, "compartment 1" and so on and "ring 1" and so on.
        law: of the film.
        properties: numbers of the law that differ along the tube, see `Membrane`.
        gas: in it.
        pressure: of the gas at the start [Pa].
        temperature: of the gas at the start [K].
        dead_volume: of each compartment [m³], see `Chamber`.
        discharge_coefficient: of the passages, see `Orifice`.
        laminar: relative difference of pressures below which passages are laminar, see `Orifice`.
        outside: gas outside; default vacuum.
        clamp: group of the mesh that is fixed; None: the tube is free.
        caps: what ends of the tube are fixed to, by the group of the end: a rigid body, e.g. a
            satellite, or the mass [kg] of a bar along the flat end, which is made.
        rod_width: side of the square section of such bars [m].
        folds: map with which the tube starts folded; default flat.
        origin: position of the folded shape [m], see `FoldMap.start`.
        turn: its rotation vector [rad].
        crease_stiffness: of creases at the fold lines [N m/m/rad]; zero: none.
        set_angle_ratio: rest angle of creases over the angle of their folds, 0 to 1.
        yield_angle: of creases [rad], see `Crease`; None: elastic.
        contact_distance: activation distance of contact of the film with itself [m]; zero: no
            contact.
        contact_stiffness: its stiffness [N/m³]; None: from closing speeds, see `Contact`.
            Gradients of runs need a number.
        obstacles: solids that the film touches, too.
        name: for messages and outputs; the items have names that begin with it.

    Attributes:
        film: the membrane.
        rings: `Ring` of each passage.
        chambers: one for each compartment, from the inlet.
        passages: orifices as wide as the deformed rings: a tube chokes where it is folded.
        clamp: support of the inlet.
        caps: a `RigidRegion` for each end with a cap.
        start, creases, contact: initial shape, creases and contact.

    Raises:
        InputError: obstacles without contact, creases without folds, a cap that is neither a rigid
            body nor a positive mass, or what the items refuse.

    Example:
        >>> from gossamer_fx.meshes.tube import flat_tube
        >>> law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6)
        >>> mesh = flat_tube(comm, 0.25, 0.03, 6, compartments=3)
        >>> tube = gx.assemblies.InflatableTube(mesh, law, gas=air)
        >>> supply = gx.Tank(2e-6, gas=air, pressure=1.5e6, temperature=293.0, name="supply")
        >>> scene = gx.Scene(tube, tube.inlet(supply, area=1e-7))
        >>> len(tube.chambers)
        3
    """

    def __init__(
        self,
        mesh: Mesh,
        law: FilmLaw,
        *,
        gas: IdealGas,
        properties: Mapping[str, Property] | None = None,
        pressure: float = 1.0,
        temperature: float = 293.0,
        dead_volume: float = 1e-6,
        discharge_coefficient: float = 0.8,
        laminar: float = 1e-3,
        outside: Ambient | None = None,
        clamp: str | None = "inlet",
        caps: Mapping[str, float | RigidBody] | None = None,
        rod_width: Annotated[float, positive("m")] = 2e-3,
        folds: FoldMap | None = None,
        origin: Vector = (0.0, 0.0, 0.0),
        turn: Vector = (0.0, 0.0, 0.0),
        crease_stiffness: Annotated[float, not_negative("N m/m/rad")] = 0.0,
        set_angle_ratio: float = 1.0,
        yield_angle: float | None = None,
        contact_distance: Annotated[float, not_negative("m")] = 0.0,
        contact_stiffness: float | None = None,
        obstacles: tuple[Obstacle, ...] = (),
        name: str = "tube",
    ) -> None:
        """Check the arguments, and make the film, chambers, passages and supports of a tube.
        Collective."""
        who = f"InflatableTube '{name}'"
        check(
            contact_distance > 0 or not obstacles,
            f"{who}: it touches obstacles only with contact; give its distance.",
        )
        check(
            crease_stiffness == 0 or folds is not None,
            f"{who}: creases are at fold lines; give the folds.",
        )
        self.name = name
        self._discharge = discharge_coefficient
        self._gas = gas
        # Creases are groups of edges, so that the mesh is marked before the film is made.
        if folds is not None and crease_stiffness:
            mesh = folds.mark(mesh)
        self.film = Membrane(mesh, law, properties=properties, name=f"{name} film")
        # A mesh without such groups is one chamber.
        count = sum(1 for group in mesh.groups if group.startswith("compartment ")) or 1
        self.rings = [Ring(self.film, f"ring {i}") for i in range(1, count)]
        self.chambers = [
            Chamber(
                self.film,
                gas=gas,
                pressure=pressure,
                temperature=temperature,
                dead_volume=dead_volume,
                # A single chamber is bounded by the whole film.
                surface=(f"compartment {i + 1}",) if count > 1 else (),
                # Each compartment is closed by the rings at its ends; the first and the last one
                # have one.
                rings=tuple(self.rings[max(i - 1, 0) : i + 1]),
                outside=outside,
                name=f"{name} {i + 1}",
            )
            for i in range(count)
        ]
        # Passages are as wide as the deformed rings, so that they close where the tube is folded.
        self.passages = [
            Orifice(
                self.chambers[i],
                self.chambers[i + 1],
                area=ring,
                discharge_coefficient=discharge_coefficient,
                laminar=laminar,
                name=f"{name} passage {i + 1}",
            )
            for i, ring in enumerate(self.rings)
        ]
        self.clamp = Fixed(self.film, clamp) if clamp is not None else None
        self.start: Folded | None = (
            folds.start(self.film, origin, turn) if folds is not None else None
        )
        check(
            caps is None or isinstance(caps, Mapping),
            f"{who}: caps is {caps!r}; give a dictionary by groups of ends.",
        )
        # After `start`, since a bar lies along the end of the folded tube.
        self.caps = [self._cap(end, what, rod_width) for end, what in (caps or {}).items()]
        self.creases: list[Crease] = (
            list(
                folds.creases(
                    self.film,
                    stiffness=crease_stiffness,
                    set_angle_ratio=set_angle_ratio,
                    yield_angle=yield_angle,
                )
            )
            if folds and crease_stiffness
            else []
        )
        check(
            contact_stiffness is None or contact_distance > 0,
            f"{who}: contact_stiffness is given, but there is no contact; give contact_distance, "
            "too.",
        )
        self.contact: Contact | None = None
        if contact_distance:
            self.contact = self._contact(contact_distance, contact_stiffness, obstacles)

    def _cap(self, end: str, what: float | RigidBody, bar: float) -> RigidRegion:
        """Make the rigid region that fixes the nodes of one end to a rigid body, or to a bar of the
        mass `what` [kg] that is made along the end, with a square section of side `bar` [m].
        Collective."""
        # Imported here: a tube without caps does not load it.
        from gossamer_fx.mechanics.constraints.rigid_region import RigidRegion

        known = isinstance(what, RigidBody) or (
            isinstance(what, int | float) and math.isfinite(what) and what > 0
        )
        check(
            known,
            f"InflatableTube '{self.name}': the cap of '{end}' is {what!r}; "
            "give a rigid body, or a positive mass in kg.",
        )
        body = what if isinstance(what, RigidBody) else self._bar(end, float(what), bar)
        return RigidRegion(self.film, end, rigid_body=body, name=f"{self.name} {end} cap")

    def _bar(self, end: str, mass: float, side: float) -> RigidBody:
        """Make a rigid bar of a mass [kg] along the nodes of an end, where the tube starts: its
        first axis along their line, its centre at their mean, its length their extent, its square
        section of a side [m].  Collective."""
        index_map = self.film.block.index_map
        comm = self.film.comm
        nodes = self.film.nodes(end)
        x = (
            self.film.initial_state()[0].reshape(-1, 3)
            if self.start is None
            else self.start.positions()
        )
        # Owned nodes only, so that shared ones do not count twice in the mean.
        own = x[nodes[nodes < index_map.size_local]]
        x = np.concatenate(comm.allgather(own))
        middle = x.mean(axis=0)
        # Of the singular vectors of points on a line the first is along it.
        along = np.linalg.svd(x - middle)[2]
        length = float(np.ptp((x - middle) @ along[0]))
        # Moments of inertia [kg m²] of a cuboid about its own axis and across it.
        axis = mass * side**2 / 6
        across = mass * (length**2 + side**2) / 12
        # Singular vectors may be left-handed; an attitude is a rotation.
        attitude = along.T * np.sign(np.linalg.det(along))
        return RigidBody(
            mass,
            (axis, across, across),
            position=tuple(middle),
            attitude=attitude,
            comm=comm,
            name=f"{self.name} {end} bar",
        )

    def _contact(
        self, distance: float, stiffness: float | None, obstacles: tuple[Obstacle, ...]
    ) -> Contact:
        """Make the contact of the film with itself and with obstacles, with an activation distance
        [m] and a stiffness [N/m³], None for that of closing speeds.  Collective."""
        # Imported here: a tube without contact does not load it.
        from gossamer_fx.mechanics.contact.contact import Contact

        return Contact(
            self.film,
            *obstacles,
            distance=distance,
            stiffness=stiffness,
            name=f"{self.name} contact",
        )

    @check_arguments
    def inlet(self, source: Tank | Ambient, area: float | Callable[[float], float]) -> Orifice:
        """The valve from a tank or reservoir into the first compartment, with an opening [m²] that
        is a number or a function of time [s]."""
        return Orifice(
            source,
            self.chambers[0],
            area=area,
            discharge_coefficient=self._discharge,
            name=f"{self.name} inlet",
        )

    @check_arguments
    def vent(self, outside: Ambient, area: float | Callable[[float], float]) -> Orifice:
        """The hole from the last compartment to the surroundings, with an opening [m²] that is a
        number or a function of time [s]."""
        return Orifice(
            self.chambers[-1],
            outside,
            area=area,
            discharge_coefficient=self._discharge,
            name=f"{self.name} vent",
        )

    def terms(self, start: State) -> Iterable[Term]:
        return ()  # its parts have all of them

    def requires(self) -> Iterable[Any]:
        yield from (self.film, *self.chambers, *self.passages)
        yield from (part for part in (self.clamp, self.start, self.contact) if part is not None)
        yield from (*self.caps, *self.creases)
