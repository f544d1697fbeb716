"""Arguments of classes and functions are checked by their annotations before they act."""

from __future__ import annotations

import importlib
import inspect
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import pytest

import gossamer_fx as gx
from gossamer_fx.core.checks.arguments import (
    DISTINCT,
    NOT_ZERO,
    POSITIVE,
    RISING,
    Column,
    Count,
    Curve,
    Direction,
    Range,
    at_least,
    check_arguments,
    ends_in,
    kind_of,
    not_negative,
    positive,
    resolved,
)
from gossamer_fx.core.checks.lazy_names import public_names
from gossamer_fx.core.checks.relations import (
    Relation,
    as_many,
    at_most_one,
    below,
    both_or_none,
    different,
    each_once,
    exactly_one,
    only_with,
    rising,
    some,
)
from tests.survival.on_ranks import complete

ROOT = Path(gx.__file__).parents[1]


def constructors() -> dict[str, Callable[..., Any]]:
    """What is called by each public name: a function, or the `__init__` of a class."""
    found = {}
    for name in public_names():
        thing = attrgetter(name)(gx)
        if not (inspect.isclass(thing) and issubclass(thing, BaseException)):
            found[name] = thing.__init__ if inspect.isclass(thing) else thing
    return found


def test_every_public_name_checks_its_arguments() -> None:
    unchecked = [name for name, call in constructors().items() if not hasattr(call, "__wrapped__")]
    assert unchecked == []


def test_every_annotation_of_a_public_argument_can_be_tested() -> None:
    """None is `Any`, which would take everything."""
    tested = 0
    for name, call in constructors().items():
        function = inspect.unwrap(call)
        for argument in inspect.signature(function).parameters:
            if argument != "self":
                assert kind_of(resolved(function, argument)) is not None, f"{name}: {argument}"
                tested += 1
    assert tested > 450


def test_nothing_is_done_before_arguments_are_refused() -> None:
    written = []

    @check_arguments
    def write(number: float, name: str = "a") -> None:
        written.append(number)

    with pytest.raises(gx.InputError, match=r"^write: name is 3; give a word\.$"):
        write(1.0, name=3)  # type: ignore[arg-type]
    assert written == []
    write(1.0)
    assert written == [1.0]


def test_a_missing_name_is_named_also_after_any_number_of_arguments() -> None:
    """`gx.Contact(film)` lacks the distance, and may have bodies without a name."""

    @check_arguments
    def touch(*bodies: str, distance: float, order: Sequence[int] = ()) -> None:
        del bodies, distance, order

    with pytest.raises(gx.InputError, match=r"^touch: the argument 'distance' is missing; "):
        touch("film", "floor")  # type: ignore[call-arg]
    # One whole number is not what is wanted.
    with pytest.raises(gx.InputError, match=r"order is 2; give a list of whole numbers\.$"):
        touch("film", distance=1.0, order=2)  # type: ignore[arg-type]


def test_a_file_is_not_written_before_arguments_are_refused(tmp_path: Path) -> None:
    target = tmp_path / "log.txt"
    with pytest.raises(gx.InputError, match="quiet is 'no'"):
        gx.run.log_to(gx.PointMass(1.0).comm, target, quiet="no")  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_the_check_is_the_same_by_every_import_path() -> None:
    """In a new process, so that no other import came before."""
    code = (
        "from gossamer_fx.mechanics.connectors.spring import Rope\n"
        "import gossamer_fx as gx\n"
        "p, q = gx.PointMass(1.0).port(), gx.Ground((0.0, 0.0, 1.0))\n"
        "try:\n"
        "    Rope(p, q, stiffness=5.0, length=2.0, name=0.3)\n"
        "except gx.InputError as error:\n"
        "    print(error, Rope is gx.connectors.Rope)\n"
    )
    done = complete([sys.executable, "-c", code])
    assert done.stdout == "Rope: name is 0.3; give a word. True\n", done.stdout + done.stderr


@dataclass
class Point:
    x: float


Pair = tuple[float, float]
CASES: list[tuple[Any, Sequence[Any], Sequence[Any]]] = [
    (float, [1, 2.0, np.float32(1), np.int64(2)], [math.nan, math.inf, True, "1", None, [1.0]]),
    (int, [1, np.int32(3)], [1.0, True, "1"]),
    (bool, [True, np.True_], [0, 1, "yes"]),
    (str, ["", "a"], [b"a", 1]),
    (str | Path, ["a", Path("a")], ["a\0b", 3, None]),
    (float | None, [None, 1.0], ["None", math.nan]),
    (Pair, [(1, 2), [1.0, 2.0], np.ones(2)], [(1.0,), (1.0, "a"), "ab", 1.0, (1.0, math.nan)]),
    (Annotated[Sequence[float], Count(3)], [(1, 2, 3), np.ones(3)], [(1, 2), np.ones((3, 3))]),
    (Annotated[float, positive("m")], [1e-9, np.float32(2)], [0.0, -1, math.nan, "1", None]),
    (Annotated[float, not_negative()] | None, [0, 1.5, None], [-1e-9, "0"]),
    (Annotated[int, Range(1, 3)], [1, np.int64(3)], [0, 4, 2.0]),
    (Annotated[float, Range(0.0, 1.0, above=True)], [1e-9, 1], [0.0, 1.1]),
    (Annotated[float, Range(0.0, 1.0, below=True)], [0, 0.9], [-0.1, 1.0]),
    (Annotated[Sequence[int], at_least(2)], [(1, 2), [1, 2, 3]], [(), [1], 3]),
    (Annotated[Mapping[str, float], at_least(1)], [{"a": 1}], [{}]),
    (Annotated[Sequence[float], RISING], [(), [1, 2], np.arange(3)], [[1, 1], [2, 1]]),
    (Annotated[Sequence[float], POSITIVE], [[1, 2]], [[1, 0], np.array([-1.0])]),
    (Annotated[Sequence[str], DISTINCT], [(), ["a", "b"]], [["a", "a"]]),
    (Annotated[tuple[int, int], NOT_ZERO], [(0, 1)], [(0, 0)]),
    (Annotated[str | Path, ends_in(".pvd")], ["a.pvd", Path("b/a.PVD")], ["a", "a.pvd/b", 3]),
    (Direction, [(0, 0, 2), np.eye(3)[0]], [(0, 0, 0), (1, 2), np.eye(3)]),
    (Column, [[1.0], np.arange(2.0)], [np.eye(2), 1.0, [[1.0]]]),
    (Curve, [([0, 1], [0, 0])], [([0], [0]), ([1, 0], [0, 1]), ([0, 1], [1, 0]), ([0, 1], [0])]),
    (Sequence[Annotated[int, Range(1)]], [[], [1, 2]], [[1, 0], 1]),
    (Sequence[float], [(), [1, 2], np.ones(4)], ["12", 1.0, [[1.0]], [math.nan], {1.0: 2.0}]),
    (tuple[int, ...], [(0, 1), [2], np.arange(3)], [(0.5,), 1, "1"]),
    (npt.ArrayLike, [1.0, [1, 2], np.ones((2, 2))], ["a", [math.nan], None]),
    (npt.NDArray[np.float64], [np.ones(2)], [[1.0, 2.0]]),
    (Mapping[str, float], [{}, {"a": 1}], [{"a": "b"}, {1: 1.0}, [("a", 1.0)]]),
    (Sequence[Point], [[], (Point(1.0),)], [Point(1.0), [1.0]]),
    (Literal["a", "b"], ["a"], ["c", 1]),
    (Callable[[float], float], [abs, lambda x: x], [1.0, "abs"]),
    (type[Point], [Point], [Point(1.0), int]),
]


@pytest.mark.parametrize(("hint", "good", "bad"), CASES, ids=[str(case[0]) for case in CASES])
def test_types_are_read_as_users_of_numpy_read_them(
    hint: Any, good: Sequence[Any], bad: Sequence[Any]
) -> None:
    kind = kind_of(hint)
    assert kind is not None
    assert [value for value in good if not kind.accepts(value)] == []
    assert [value for value in bad if kind.accepts(value)] == []


def test_numbers_out_of_range_are_named_with_their_unit_and_the_range() -> None:
    @check_arguments
    def sheet(
        width: Annotated[float, positive("m")],
        share: Annotated[float, Range(0.0, 1.0)] = 0.5,
        cells: Annotated[int, Range(2)] = 4,
        ratio: Annotated[float, Range(-1.0, 0.5, above=True)] | None = None,
    ) -> None: ...

    for given, message in (
        ({"width": -2.0}, "width is -2.0 m; give a positive number."),
        ({"width": "wide"}, "width is 'wide'; give a positive number."),
        ({"share": 1.5}, "share is 1.5; give a number between 0 and 1."),
        ({"cells": 1}, "cells is 1; give a whole number of at least 2."),
        ({"ratio": -1.0}, "ratio is -1.0; give a number above -1 and up to 0.5 or None."),
    ):
        with pytest.raises(gx.InputError, match=rf"^sheet: {re.escape(message)}$"):
            sheet(**({"width": 1.0} | given))  # type: ignore[arg-type]


ONE = object()
RELATIONS: list[tuple[Relation, dict[str, Any], dict[str, Any], str]] = [
    (exactly_one("a", "b"), {"a": 0.0}, {}, "a is None and b is None; give one of them"),
    (exactly_one("a", "b"), {"b": 1}, {"a": 1, "b": 2}, "a is 1 and b is 2; give one of them"),
    (at_most_one("a", "c"), {"c": (1,)}, {"a": 1, "c": (1,)}, "a and c are both given; give one"),
    (both_or_none("a", "b"), {}, {"a": 1}, "a is 1 and b is None; give both or none"),
    (only_with("d", "a"), {"d": False}, {"d": True}, "d is given without a; give both, or leave d"),
    (some("a", "c"), {"c": (1,)}, {"c": []}, "a is None and c is []; give one or more"),
    (
        as_many("a", "c"),
        {"a": [1]},
        {"a": [1], "c": [1, 2]},
        "a has 1 and c has 2 entries; give",
    ),
    (rising("a", "b"), {"a": 1, "b": 1}, {"a": 2, "b": 1}, "a is 2 and b is 1; give a larger b"),
    (below("a", "b"), {"a": 1}, {"a": 1, "b": 1}, "a is 1 and b is 1; give a larger b"),
    (different(("a", "b"), give="two"), {"a": 1, "b": 2}, {"a": "x", "b": "x"}, "a and b are the "),
    (each_once("c"), {"c": (1, 2)}, {"c": (ONE, ONE)}, "is given twice; give it once"),
]


@pytest.mark.parametrize(("relation", "good", "bad", "words"), RELATIONS)
def test_relations_between_arguments_are_checked_before_the_call(
    relation: Relation, good: dict[str, Any], bad: dict[str, Any], words: str
) -> None:
    called = []

    @check_arguments(relation)
    def join(a: Any = None, b: Any = None, c: Any = (), d: bool = False) -> None:
        called.append((a, b, c, d))

    @check_arguments(relation)
    @dataclass
    class Joined:
        a: Any = None
        b: Any = None
        c: Any = ()
        d: bool = False

    @check_arguments
    @dataclass
    class Heir(Joined):
        e: int = 0

    makers: list[Callable[..., Any]] = [join, Joined, Heir]
    for make in makers:
        make(**good)
        with pytest.raises(gx.InputError, match=re.escape(words)):
            make(**bad)
    assert len(called) == 1


def test_a_list_that_does_not_rise_is_refused_by_its_first_wrong_entry() -> None:
    @check_arguments
    def table(x: Annotated[Column, RISING]) -> None: ...

    table(np.arange(4.0))
    with pytest.raises(gx.InputError, match=r"table: x is .*, whose number 3 does not fit; give"):
        table([0.0, 1.0, 1.0, 2.0])


def test_infinity_is_taken_where_it_is_the_default() -> None:
    @check_arguments
    def limit(largest: float = math.inf) -> float:
        return largest

    assert limit(float("inf")) == math.inf
    with pytest.raises(gx.InputError, match="largest is nan"):
        limit(math.nan)


def test_calls_that_do_not_fit_name_the_arguments() -> None:
    @check_arguments
    def beam(length: float, width: float, *, name: str = "beam") -> None: ...

    known = r"its arguments are: length, width, name\.$"
    with pytest.raises(gx.InputError, match=r"beam: there is no argument 'size'; " + known):
        beam(1.0, size=2.0)  # type: ignore[call-arg]
    with pytest.raises(gx.InputError, match=r"beam: the argument 'width' is missing; " + known):
        beam(1.0)  # type: ignore[call-arg]
    with pytest.raises(gx.InputError, match=r"3 arguments .*give names after 'width'; " + known):
        beam(1.0, 2.0, "b")  # type: ignore[misc]
    with pytest.raises(gx.InputError, match=r"multiple values for argument 'length'; " + known):
        beam(1.0, 2.0, length=1.0)  # type: ignore[misc]


def test_names_for_type_checkers_are_imported_when_a_value_needs_them() -> None:
    """An annotation may name a class whose module is not loaded: it is, when a value is given."""
    code = (
        "import sys\n"
        "from gossamer_fx.records.probes.points import GasState\n"
        "print('gossamer_fx.mechanics.gas.contract' in sys.modules)\n"
        "try:\n"
        "    GasState(3.0, 'pressure')\n"
        "except ValueError as error:\n"
        "    print(error)\n"
    )
    done = complete([sys.executable, "-c", code])
    expected = "False\nGasState: chamber is 3.0; give a chamber or tank.\n"
    assert done.stdout == expected, done.stdout + done.stderr


def test_the_name_of_a_part_is_in_the_message() -> None:
    with pytest.raises(
        gx.InputError, match=r"^PointMass 'tip': mass is 'heavy'; give a positive number\.$"
    ):
        gx.PointMass("heavy", name="tip")  # type: ignore[arg-type]


def test_inherited_fields_of_dataclasses_are_resolved_in_their_own_module() -> None:
    module = importlib.import_module("gossamer_fx.mechanics.contact.obstacles")
    with pytest.raises(
        gx.InputError, match=r"Plane: friction is 'rough'; give zero or a positive number"
    ):
        module.Plane(point=(0, 0, 0), normal=(0, 0, 1), friction="rough")
