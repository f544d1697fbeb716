"""What a step is, is said by its stress rule alone: no module compares the weight of its end."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import gossamer_fx
from gossamer_fx import GeneralizedAlpha
from gossamer_fx.mechanics.terms.discrete_gradient import AtRest, EndPoint, PathAverage
from gossamer_fx.solve.steppers import VariationalMidpoint

PACKAGE = Path(gossamer_fx.__file__).parent
HOME_OF_RULES = PACKAGE / "mechanics" / "terms" / "discrete_gradient.py"
STEPPERS = PACKAGE / "solve" / "steppers"
WEIGHT = {"alpha", "_alpha", "α", "_α"}
IN_C = re.compile(r"\balpha *(==|!=|[<>])|(==|!=|<=?|(?<!-)>=?) *(\w+(->|\.))?alpha\b")


def compared_weights(source: str) -> list[int]:
    """Lines of Python that compare the weight of the end of a step."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            names = [getattr(one, "attr", getattr(one, "id", "")) for one in operands]
            if WEIGHT & set(names):
                found.append(node.lineno)
    return found


def test_comparisons_are_found() -> None:
    code = "a = rule.alpha == 1\nb = x if 0.5 < self._α else y\nc = abs(alpha) <= 1\n"
    assert compared_weights(code) == [1, 2]
    assert IN_C.search("if (step->alpha == 1)") and IN_C.search("1 > step->alpha")
    assert not IN_C.search("step->alpha * share")


def test_no_module_compares_the_weight_of_a_rule() -> None:
    found = {}
    for path in PACKAGE.rglob("*.py"):
        lines = compared_weights(path.read_text())
        if lines and path != HOME_OF_RULES:
            found[str(path.relative_to(PACKAGE))] = lines
    for path in [*PACKAGE.rglob("*.c"), *PACKAGE.rglob("*.h")]:
        if IN_C.search(path.read_text()):
            found[str(path.relative_to(PACKAGE))] = []
    assert found == {}


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("GeneralizedAlpha", "generalized_alpha.py"),
        ("VariationalMidpoint", "variational.py"),
        ("StressInMiddle", "variational.py"),
    ],
)
def test_an_integrator_is_one_file(name: str, module: str) -> None:
    """No other module of the package knows it; the scene's terms see its rule only."""
    users = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if path != STEPPERS / module and re.search(rf"\b{name}\b", path.read_text())
    ]
    assert users == []


def test_only_statics_are_static() -> None:
    assert AtRest().is_static
    for rule in (
        PathAverage(),
        EndPoint(),
        GeneralizedAlpha(dt=1.0).rule,
        VariationalMidpoint(dt=1.0).rule,
    ):
        assert not rule.is_static


def test_rules_state_what_they_conserve_and_where_they_act() -> None:
    path = PathAverage()
    assert path.conserves and not path.acts_at_end and not path.takes_mid_strain
    end = EndPoint()
    assert end.acts_at_end and not end.conserves
    middle = VariationalMidpoint(dt=1.0).rule
    assert middle.takes_mid_strain and not middle.conserves and not middle.acts_at_end
