"""The contract of compiled terms: a kind that overrides nothing changes nothing, and nothing takes
part by the names of its methods."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import (
    ActiveSet,
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    HistoryVariables,
    Item,
    Multipliers,
    Shown,
    State,
    Term,
)
from tests.small_scenes import run_until

FACETS = (Multipliers, ActiveSet, HistoryVariables, Differentiable, Shown)


class Counter:
    """A helper whose methods happen to have names of the contract."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def commit(self) -> None:
        self.calls.append("commit")

    def update(self, linearly: bool) -> None:
        self.calls.append("update")

    def get_history(self) -> dict[str, Any]:
        self.calls.append("get_history")
        return {}

    def set_history(self, state: dict[str, Any]) -> None:
        self.calls.append("set_history")

    def update_active_set(self) -> None:
        self.calls.append("update_active_set")

    def solids(self) -> list[object]:
        self.calls.append("solids")
        return []


class Idle(CompiledTerms["IdleTerm"]):
    """Overrides nothing, and has a helper."""

    def __init__(self, terms: Sequence[IdleTerm], system: Assembly) -> None:
        self.helper = Counter()


@dataclass(frozen=True, eq=False)
class IdleTerm:
    helper: Counter = field(default_factory=Counter)
    compiler: ClassVar[Compiler] = Idle


@dataclass(frozen=True, eq=False)
class IdleItem(Item):
    name: str = "idle"

    def terms(self, start: State) -> Iterable[Term]:
        yield IdleTerm()


def swing(*items: object) -> gx.Simulation:
    ball = gx.PointMass(1.0, (0.1, 0.2, 0.3), velocity=(0.0, 1.0, 2.0), name="ball")
    spring = gx.connectors.Spring(
        ball.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=50.0, length=0.2
    )
    return run_until(0.1, ball, spring, *items, dt=0.01)


def test_a_kind_that_overrides_nothing_changes_nothing() -> None:
    alone = swing()
    run = swing(IdleItem())
    assert np.array_equal(run.system.unknowns.q0.array_r, alone.system.unknowns.q0.array_r)
    assert run.totals.stored == alone.totals.stored
    assert run.totals.losses == alone.totals.losses == {}
    assert run.iterations == alone.iterations
    assert run.system.matrices.K is None


def test_names_of_methods_enrol_nothing() -> None:
    run = swing(IdleItem())
    run.history.restore(run.history.save())
    [idle] = [kind for kind in run.system.equations.compiled if isinstance(kind, Idle)]
    [term] = [term for term in run.system.unknowns.terms if isinstance(term, IdleTerm)]
    assert not isinstance(idle.helper, FACETS)
    assert idle.helper.calls == term.helper.calls == []
    saved = run.history.save().variables
    assert not [name for name in saved if name == "Idle" or name.endswith("helper")]


def test_the_contract_is_one_of_base_classes() -> None:
    """A structural protocol would enrol whatever has methods of its names: none is checked at run
    time, neither of compiled terms nor of items, outputs and steppers."""
    kinds = [CompiledTerms, *FACETS]
    for folder, _, files in os.walk(Path(gx.__file__).parent):
        for file in files:
            if file.endswith(".py"):
                assert "runtime_checkable" not in (Path(folder) / file).read_text().replace(
                    "is not runtime_checkable", ""
                ).replace("not `runtime_checkable`", ""), file
    assert not any(getattr(kind, "_is_protocol", False) for kind in kinds)
