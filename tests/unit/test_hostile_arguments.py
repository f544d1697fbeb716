"""Every argument of every public class is replaced by hostile values, and what is made is run.

A call or a run may take a value, or refuse it in one sentence; it never ends in a traceback, and it
never accepts a value that is not a real number.  Then two arguments at a time have random values.
The default tests take some of the values; all of them, about four minutes:

    ./gossamer python -m pytest -m slow -s tests/unit/test_hostile_arguments.py
"""

from __future__ import annotations

import inspect
import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.control.feedback import Actuator
from gossamer_fx.mechanics.gas.contract import Gas
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.scene.scene import Item
from tests.sentences import is_sentence
from tests.small_scenes import WRINKLING
from tests.unit.public_calls import make_inputs, valid_calls

pytestmark = pytest.mark.skipif(
    MPI.COMM_WORLD.size > 1, reason="each rank would make the same small scenes"
)

REFUSED = (gx.InputError, gx.StepFailure, gx.NoEquilibrium, gx.OutputFailure)

# Longest sentence [characters] that refuses a value.
LONGEST_SENTENCE = 600


# Arguments that name a group of the mesh, and names of none.
GROUPS = ("group", "edges", "edge_a", "edge_b", "group_a", "group_b")
NO_GROUPS = {word: word for word in ("nowhere", "left ", "Left")}

# Words are good names, and values that are compared with others have separate tests.
NOT_REPLACED = ("name", "title", "comm", "path", "folder")

# These act on scenes or recordings that they are given, for minutes; the last is a result.
NOT_CALLED = ("Simulation", "Equilibrium", "Case", "plot.RunReader", "fields.LineValues")

# The scene of the valid call is refused or does not converge: only what is made is tried.
REFUSED_AS_THEY_ARE = {"StartFrom", "gas.Ambient"}


def fail(*given: Any) -> Any:
    raise ZeroDivisionError("of the user")


# Values that are not real numbers, and functions that do not return any: none may be accepted as
# numbers.
NOT_REAL: dict[str, Any] = {
    "nan": math.nan,
    "complex": 1j,
    "NumPy's complex": np.complex128(1 + 1j),
    "a vector with nan": (math.nan, 0.0, 0.0),
    "a complex vector": np.full(3, 1j),
    "a complex matrix": 1j * np.eye(3),
    "words": ["a", "b", "c"],
    "a mixture": (1.0, "a", None),
    "an object": object(),
}
NOT_REAL_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "raises": fail,
    "takes no argument": lambda: 1.0,
    "returns a word": lambda *given: "abc",
    "returns words": lambda *given: ["a", "b", "c"],
    "returns an array of words": lambda *given: np.array([["a"] * 3] * 3),
    "returns None": lambda *given: None,
    "returns an object": lambda *given: object(),
    "returns a dict": lambda *given: {},
    "returns nan": lambda *given: math.nan,
    "returns complex": lambda *given: 1j,
    "returns a complex vector": lambda *given: np.full(3, 1j),
    "returns infinity": lambda *given: (math.inf,) * 3,
    "returns nan at points": lambda at, *more: np.nan * np.asarray(at, dtype=float),
    "returns complex at points": lambda at, *more: 1j * np.asarray(at, dtype=float),
    "returns seven numbers": lambda *given: np.ones(7),
    "returns two components at points": lambda at, *more: np.asarray(at, dtype=float)[:2],
}

# Values that may make sense somewhere.
UNUSUAL: dict[str, Any] = {
    "a word": "abc",
    "no word": "",
    "infinity": math.inf,
    "-1": -1.0,
    "0": 0.0,
    "1e300": 1e300,
    "1e100": 1e100,
    "1e-300": 1e-300,
    "1e-100": 1e-100,
    "10**9": 10**9,
    "10**400": 10**400,
    "None": None,
    "True": True,
    "two numbers": [1.0, 2.0],
    "huge numbers": (1e300,) * 3,
    "large numbers": (1e100,) * 3,
    "tiny numbers": (1e-300,) * 3,
    "zeros": (0.0,) * 3,
    "a matrix": np.eye(3),
    "nothing": [],
    "no dict": {},
    "a dict of words": {"a": "b"},
}
UNUSUAL_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "returns huge numbers": lambda *given: (1e300,) * 3,
    "returns huge numbers at points": lambda at, *more: 1e300 + 0 * np.asarray(at, dtype=float),
}


def sheet_film(height: float = 0.0) -> gx.Membrane:
    def lift(X: np.ndarray) -> np.ndarray:
        return 0 * X + [[0.0], [0.0], [height]]

    return gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), WRINKLING, displacement=lift)


def calls_of_classes(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the valid calls of all public classes, with those that the list of calls leaves
    out."""
    calls = {
        name: call
        for name, call in valid_calls(folder, make_inputs(folder)).items()
        if inspect.isclass(attrgetter(name)(gx)) and name not in NOT_CALLED
    }
    calls["Contact"] = {
        "distance": 1e-3,
        "stiffness": 1e6,
        "law": "barrier",
        "friction": 0.3,
        "slip_velocity": 1e-3,
        "radius": {"film": 1e-4},
    }
    calls["StartFrom"] = {"system": gx.Scene(sheet_film()).compile()}
    return calls


def make(name: str, call: dict[str, Any]) -> Any:
    """Return what a call makes; contact needs bodies, which it takes without names."""
    kind = attrgetter(name)(gx)
    if name == "Contact":
        floor = gx.contact.Plane(point=(0.0, 0.0, -5e-4), normal=(0.0, 0.0, 1.0))
        return kind(sheet_film(), floor, **call)
    return kind(**call)


def run(made: Any) -> bool:
    """Make two steps of a scene with what was made, if it is a part of scenes; whether it is."""
    others: list[Any] = [gx.PointMass(1.0, name="ballast")]
    if isinstance(made, Obstacle):
        made = gx.Contact(sheet_film(height=3.0), made, distance=1e-3)
    if isinstance(made, Actuator):
        command = np.full(made.commands, 1e-3)
        made = gx.control.Feedback(
            [lambda run: 0.0], lambda t, values: command, [made], period=1e-4
        )
    events = [made] if isinstance(made, gx.At | gx.When) else []
    # A gas has a name, as items have.
    if not events and (not isinstance(made, Item) or isinstance(made, Gas)):
        return False
    items = [] if events else [made]
    scene = gx.Scene(*items, *others)
    simulation = gx.Simulation(scene, gx.Midpoint(dt=1e-4), events=events, halvings=1)
    simulation.run(until=2e-4)
    assert math.isfinite(simulation.totals.energy)
    return True


def hostile_calls(folder: Path) -> Iterator[tuple[str, bool, Callable[[], bool]]]:
    """Return what is replaced by what, whether nobody may take it, and what tries it."""
    for name, call in sorted(calls_of_classes(folder).items()):
        for argument, parameter in inspect.signature(attrgetter(name)(gx)).parameters.items():
            if argument in NOT_REPLACED or parameter.kind is parameter.VAR_POSITIONAL:
                continue
            usual = call.get(argument, parameter.default)
            takes_functions = callable(usual) or any(
                word in str(parameter.annotation) for word in ("Callable", "Function", "Motion")
            )
            values = [(what, value, True) for what, value in NOT_REAL.items()]
            values += [(what, value, False) for what, value in UNUSUAL.items()]
            if argument in GROUPS:
                values += [(what, value, True) for what, value in NO_GROUPS.items()]
            if takes_functions:
                values += [(what, value, True) for what, value in NOT_REAL_FUNCTIONS.items()]
                values += [(what, value, False) for what, value in UNUSUAL_FUNCTIONS.items()]
            for what, value, is_not_real in values:

                def act(
                    name: str = name,
                    given: dict[str, Any] = call | {argument: value},
                    is_function: bool = callable(value),
                ) -> bool:
                    # Only functions of items of a scene are called here.
                    return run(make(name, given)) or not is_function

                yield f"{name}({argument}: {what})", is_not_real, act


def outcome(act: Callable[[], bool], is_not_real: bool) -> tuple[str, str]:
    """Return "taken", "sentence", or what is wrong, and the words."""
    try:
        is_tried = act()
    except REFUSED as error:
        words = str(error)
        return "sentence" if is_sentence(words, LONGEST_SENTENCE) else "no sentence", words
    except Exception as error:
        return "traceback", f"{type(error).__name__}: {error}"
    return "taken in silence" if is_not_real and is_tried else "taken", ""


def test_usual_values_are_taken(tmp_path: Path) -> None:
    """Else hostile ones could be refused for another reason."""
    refused = {
        name
        for name, call in calls_of_classes(tmp_path).items()
        if outcome(lambda name=name, call=call: run(make(name, call)), False)[0] != "taken"
    }
    assert refused == REFUSED_AS_THEY_ARE


@pytest.mark.parametrize("every", [67, pytest.param(1, marks=pytest.mark.slow)])
def test_hostile_values_are_taken_or_refused_in_a_sentence(tmp_path: Path, every: int) -> None:
    counts: Counter[str] = Counter()
    wrong = []
    for what, is_not_real, act in islice(hostile_calls(tmp_path), 0, None, every):
        kind, words = outcome(act, is_not_real)
        counts[kind] += 1
        if kind not in ("taken", "sentence"):
            wrong.append(f"{kind}: {what}: {words}")
    logging.getLogger("gossamer_fx").handlers.clear()
    print(f"{counts.total()} hostile values: {dict(counts)}")
    assert not wrong, "\n".join(wrong)
    assert counts.total() >= (10_000 if every == 1 else 150)


ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -1.0, 1e-300, 1e300, 1e-12, 1e12]),
    st.none(),
    st.text(max_size=3),
    st.tuples(st.floats(), st.floats(), st.floats()),
)


@pytest.mark.parametrize("examples", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_values_of_two_arguments_are_taken_or_refused_in_a_sentence(
    tmp_path: Path, examples: int
) -> None:
    calls = calls_of_classes(tmp_path)

    @settings(max_examples=examples, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(st.data())
    def check(data: st.DataObject) -> None:
        # Some have no arguments.
        name = data.draw(st.sampled_from(sorted(one for one, given in calls.items() if given)))
        call = calls[name]
        numbers = [one for one, value in call.items() if isinstance(value, int | float | tuple)]
        pairs = st.dictionaries(
            st.sampled_from(numbers or sorted(call)), ANY, min_size=1, max_size=2
        )
        kind, words = outcome(lambda: run(make(name, call | data.draw(pairs))), False)
        assert kind in ("taken", "sentence"), f"{name}: {words}"

    check()
