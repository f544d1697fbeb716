"""Every argument of every item of a scene is compared at a restart.

Each public item is made twice, the second time with one argument changed, and the descriptions that
checkpoints store must differ.  Arguments that cannot be changed alone are listed with the reason.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import gossamer_fx as gx
from gossamer_fx.records.outputs.output import of_item
from gossamer_fx.records.run.checkpoint import differences
from tests.unit.public_calls import make_inputs, valid_calls

# Compared otherwise: names identify items, meshes have their own comparison, ranks may change.
NOT_COMPARED = ("name", "comm", "mesh")
# Arguments whose other value changes nothing in the scene of the valid call.
WITHOUT_EFFECT = {
    ("Damping", "stiffness_factor"): "the call has a loss factor, with which it is refused",
    ("Fixed", "rotation"): "the call has a direction and a twist, which fix it in any case",
    ("Chamber", "dead_volume"): "the chamber of the call is rigid and has a volume",
}
# Values for arguments whose default is None, or a word.
OTHER_VALUES: dict[str, list[Any]] = {
    "displacement": [lambda X: 1e-3 * X],
    "velocity": [lambda X: 2.0 * X],
    "properties": [{"density": lambda X: 7.0 + 0 * X[0]}],
    "rest_curvature": [np.diag((0.0, 0.0, 1.0)), np.diag((1.0, 0.0, 0.0))],
    "motion": [lambda X, t: 0.1 * t * X, lambda t: (t, 0.0, 0.0)],
    "direction": [lambda X, t: 0.1 * t * X],
    "components": [(0,), (1, 2)],
    "law": [gx.Linear(E=7e9, nu=0.3, density=1.0, thickness=1e-4)],
    "gas": [gx.IdealGas(gamma=1.3, R=300.0)],
    "normal": [(0.0, 1.0, 0.0), True],
    "outside": [gx.gas.Ambient(7e4, 290.0, name="other air")],
    "shadow": ["cone", "none"],
    "gravity": ["J2"],
    "start": [gx.orbit.Elements(7.3e6)],
    "attitude": [((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))],
    "axes": [(0,), (1,), ("x",)],
    "accommodation": [gx.orbit.Accommodation(normal=0.7)],
    "optics": [gx.orbit.Optics(reflectivity=0.3)],
    "group": ["right", "left", "top"],
}
for _end in ("a", "b", "port"):
    OTHER_VALUES[_end] = [gx.Ground((0.1, 0.2, 0.3)), gx.gas.Ambient(3e4, 280.0, name="other air")]


def other_values(argument: str, value: Any) -> Iterator[Any]:
    """Values of the same kind as a given one, which a class may still refuse."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1)
    elif isinstance(value, float):
        yield from (1.1 * value + 0.01, 0.9 * value)
    elif isinstance(value, dict):
        for key, one in value.items():
            for other in other_values(argument, one):
                yield value | {key: other}
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            for other in other_values(field.name, getattr(value, field.name)):
                with suppress(gx.InputError):
                    yield dataclasses.replace(value, **{field.name: other})
    elif isinstance(value, tuple | list | np.ndarray):
        yield from _other_arrays(value)
    elif callable(value):
        yield lambda *given: 7.0 + 0 * given[0]
    yield from OTHER_VALUES.get(argument, ())


def _other_arrays(value: Any) -> Iterator[Any]:
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return
    if numbers.size:
        yield tuple((1.1 * numbers + 0.01).tolist())
        yield 1.1 * numbers


def described(item: Any) -> Any:
    """What a checkpoint stores of an item and of all that it refers to."""
    items = gx.Scene(item).items
    return json.loads(json.dumps({one.name: of_item(one, items) for one in items}))


def scene_items(folder: Path) -> Iterator[tuple[type, dict[str, Any], Any]]:
    """Public classes of items, the arguments of a valid call, and what the call makes."""
    for name, given in sorted(valid_calls(folder, make_inputs(folder)).items()):
        kind = functools.reduce(getattr, name.split("."), gx)
        if not inspect.isclass(kind):
            continue
        # Calls that are refused need something that the list does not have; a scene needs items.
        with suppress(gx.InputError, TypeError, AttributeError):
            item = kind(**given)
            gx.Scene(item)
            yield kind, given, item


def test_another_argument_is_another_scene(tmp_path: Path) -> None:
    tried = 0
    unnoticed: list[str] = []
    for kind, given, item in scene_items(tmp_path):
        usual = described(item)
        assert not list(differences(usual, described(kind(**given)))), kind
        for argument, parameter in inspect.signature(kind).parameters.items():
            if argument in NOT_COMPARED or (kind.__name__, argument) in WITHOUT_EFFECT:
                continue
            for value in other_values(argument, given.get(argument, parameter.default)):
                try:
                    other = described(kind(**given | {argument: value}))
                except Exception:
                    continue  # that value is refused
                tried += 1
                if not list(differences(usual, other)):
                    unnoticed.append(f"{kind.__name__}({argument}={value!r})")
                break
    assert not unnoticed
    assert tried > 180
