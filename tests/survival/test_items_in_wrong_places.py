"""Every public item in every argument that takes an item: taken where it belongs, else refused."""

from __future__ import annotations

import functools
import inspect
import re
import typing
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import gossamer_fx as gx
from gossamer_fx.core.checks.arguments import Kind, kind_of, resolved
from gossamer_fx.presets.gases import NITROGEN
from tests.unit.public_calls import make_inputs, valid_calls

BODIES = {"Beam", "Cable", "Membrane", "Plate", "PointMass", "RigidBody"}
MESH_BODIES = {"Beam", "Cable", "Membrane", "Plate"}
OPENINGS = {
    "Orifice",
    "gas.Blower",
    "gas.Inflator",
    "gas.Pipe",
    "gas.PorousFilm",
    "gas.Regulator",
    "gas.Sublimation",
    "gas.Valve",
}

# What an argument takes that asks for an item by the members that it needs, and not by its class.
TAKEN = {
    "Body": BODIES,
    "MeshBody": MESH_BODIES,
    "DrawnAsLines": {
        "connectors.Rope",
        "connectors.RopeBundle",
        "connectors.Spring",
        "connectors.Tape",
        "connectors.Tether",
    },
    "Enclosure": {"gas.Piston"},
    "Fluid": {"loads.StandardAtmosphere", "loads.UniformFluid"},
    "Gas": {"IdealGas", "gas.Mixture", "gas.PolynomialGas"},
    "Holder": {"gas.Ambient"},
    "Opening": OPENINGS,
    "SewnEdges": {"Seam"},
    "Stepper": {"GeneralizedAlpha", "Midpoint", "steppers.VariationalMidpoint"},
    "Volume": {"Chamber", "Tank"},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """An object of each public class that has a valid call, by its name."""
    folder = tmp_path_factory.mktemp("made")
    found = {}
    for name, given in valid_calls(folder, make_inputs(folder)).items():
        kind = functools.reduce(getattr, name.split("."), gx)
        if inspect.isclass(kind):
            # Some need an installed package.
            with suppress(gx.InputError):
                found[name] = kind(**given)
    return found


def classes_in(hint: Any) -> Iterator[type]:
    """The classes of this project that an annotation names."""
    if isinstance(hint, typing.TypeAliasType):
        yield from classes_in(hint.__value__)
    elif inspect.isclass(hint) and hint.__module__.startswith("gossamer_fx"):
        yield hint
    for argument in typing.get_args(hint):
        if not isinstance(argument, str | int):
            yield from classes_in(argument)


def item_arguments(folder: Path) -> Iterator[tuple[str, Kind, str, list[type]]]:
    """Name of each public call, the check of one of its arguments that takes items, the name of the
    argument, and the classes that it names."""
    for name in sorted(valid_calls(folder, make_inputs(folder))):
        function = functools.reduce(getattr, name.split("."), gx)
        checked = inspect.unwrap(function.__init__ if inspect.isclass(function) else function)
        for argument in inspect.signature(checked).parameters:
            if argument in ("self", "cls"):
                continue
            try:
                hint = resolved(checked, argument)
                kind = kind_of(hint)
            except (TypeError, NameError, KeyError):
                continue
            classes = list(classes_in(hint))
            if classes and kind is not None:
                yield name, kind, argument, classes


def is_meant(name: str, item: Any, classes: list[type]) -> bool:
    """Whether an argument that names some classes is to take an item."""
    for kind in classes:
        if getattr(kind, "_is_protocol", False) or kind.__name__ in TAKEN:
            if kind.__name__ not in TAKEN or name in TAKEN[kind.__name__]:
                return True
        elif isinstance(item, kind):
            return True
    return False


def test_an_item_in_a_wrong_place_is_refused(made: dict[str, Any], tmp_path: Path) -> None:
    """By the check of arguments, before anything is done with it."""
    tried = 0
    taken = []
    for name, kind, argument, classes in item_arguments(tmp_path):
        for other, item in made.items():
            # Where a function of the user is taken, so is what can be called like one, as probes.
            is_function = callable(item) and kind.accepts(len)
            if is_meant(other, item, classes) or is_function:
                continue
            tried += 1
            if kind.accepts(item):
                taken.append(f"{name}({argument}={other})")
    assert not taken, taken
    assert tried > 5000


@pytest.mark.parametrize("end", ["a", "b"])
def test_an_opening_at_the_end_of_an_opening_is_refused_by_name(end: str) -> None:
    """Powder has a pressure, a temperature and a gas, as a reservoir; the bottle was meant."""
    bottle = gx.Tank(1e-3, gas=NITROGEN, pressure=2e5, temperature=293.0)
    powder = gx.gas.Sublimation(bottle, gas=NITROGEN, pressure=1e3, temperature=300.0, area=1e-4)
    ends = {"a": bottle, "b": bottle} | {end: powder}
    with pytest.raises(gx.InputError, match=f"Orifice: {end} is of the kind Sublimation"):
        gx.Orifice(**ends, area=1e-6)


def test_what_has_no_joint_force_names_what_has_one() -> None:
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), name="mass")
    ground = gx.Ground((0.0, 0.0, 0.0))
    rope = gx.connectors.Rope(mass.port(), ground, length=1.0, stiffness=1e3, name="rope")
    damper = gx.connectors.Damper(mass.port(), ground, damping=1.0, name="damper")
    other = gx.constraints.BallJoint(mass.port(), ground, name="other")
    equilibrium = gx.Equilibrium(gx.Scene(rope, damper, gx.Gravity(mass)))
    equilibrium.find()
    for item, words in (
        (rope, "'rope' is a Rope, which pulls along its line; ask for its gx.probes.Tension"),
        (damper, "'damper' is a Damper, which holds nothing exactly"),
        (other, "'other' is not a joint of this scene"),
    ):
        with pytest.raises(gx.InputError, match=words):
            gx.probes.JointForce(item, "z")(equilibrium)
    with pytest.raises(gx.InputError, match=r"'mass' is a PointMass, a body and not a .* a Rope"):
        gx.probes.Reaction(mass, "z")(equilibrium)


def test_a_load_is_asked_for_by_its_own_probe() -> None:
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), name="mass")
    joint = gx.constraints.BallJoint(mass.port(), gx.Ground((0.0, 0.0, -1.0)), name="hook")
    weight = gx.Gravity(mass, (0.0, 0.0, -9.81))
    equilibrium = gx.Equilibrium(gx.Scene(joint, weight))
    equilibrium.find()
    words = r"a load and not a .*; ask for its force by gx.probes.LoadResultant\((.*)\)\.$"
    with pytest.raises(gx.InputError, match=words) as error:
        equilibrium.reaction(weight)
    # What the message proposes is right.
    proposal = re.search(r"gx\.probes\.LoadResultant\(.*\)", str(error.value))
    assert proposal is not None
    assert eval(proposal[0])(equilibrium) == pytest.approx(-9.81)
    wrong = gx.probes.LoadResultant((0, 0, 0), "weight", action="force", axis="z")
    with pytest.raises(gx.InputError, match="its loads, which are: 'gravity of mass'"):
        wrong(equilibrium)


def test_the_force_of_a_joint_in_a_hold_down_is_that_of_the_hold_down() -> None:
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    joint = gx.constraints.FixedJoint(body.frame(), gx.ground_frame((0.0, 0.0, 0.0)), name="clamp")
    clamp = gx.constraints.HoldDown(joint)
    equilibrium = gx.Equilibrium(gx.Scene(clamp, gx.Gravity(body)))
    equilibrium.find()
    assert abs(gx.probes.JointForce(clamp, "z")(equilibrium)) == pytest.approx(9.81, rel=1e-3)
    with pytest.raises(gx.InputError, match="'clamp' is held by a HoldDown"):
        gx.probes.JointForce(joint, "z")(equilibrium)
