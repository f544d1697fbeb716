"""A law in symbols: a plain Python function is run with UFL expressions in place of numbers.

A comparison of symbols has no answer.  The law is therefore run once for each way through its
comparisons, and gives a tree: conditions, and at its leaves the outputs as UFL expressions without
a branch.  Every leaf is then differentiated by itself.  `ufl.conditional` in the law would not do:
UFL's derivative of it is the sum over both sides times 0 or 1, and 0 times an infinite slope of the
side that does not hold is nan, as at equal pressures on both sides of an orifice.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.classes import Zero
from ufl.core.expr import Expr

# A real number, a complex one for derivatives by complex steps, or a symbol
Number = Any

# More branches than this are a loop over something that ends by a comparison.
MAX_BRANCHES = 400
MAX_COMPARISONS = 60

# Halvings of an interval in `root`: from 1 to below 1e-300.
MAX_BISECTIONS = 1100

# Newton iterations after them, by which complex steps of what the equation depends on reach the
# root; the error of a difference as slope, some 1e-9, is their factor of convergence.
POLISHING = 3
RELATIVE_STEP = 1e-6

# Numbers of the constants of unknowns, behind those of inputs
FIRST_UNKNOWN = 10**6

# UFL's constants belong to a mesh, of which nothing is used.  Its number is given, so that those of
# meshes that are made later do not depend on laws.
_DOMAIN = ufl.Mesh(basix.ufl.element("P", "interval", 1, shape=(1,)), ufl_id=0)


class NotTraceable(Exception):
    """A law cannot be written in symbols; its text says why."""


class _Undecided(BaseException):
    """A comparison without an answer ends a run of a law; not even `except Exception` of the law
    catches it."""

    def __init__(self, condition: Condition) -> None:
        super().__init__()
        self.condition = condition


@dataclass(frozen=True)
class Condition:
    """first < second, or first == second if `is_equality`."""

    first: Expr
    second: Expr
    is_equality: bool = False


@dataclass(frozen=True)
class Root:
    """The unknown of an equation of a law: `residual`, of which `unknown` is a variable, is zero
    between `low` and `high`."""

    unknown: Expr
    residual: Expr
    low: Expr
    high: Expr


@dataclass(frozen=True)
class Leaf:
    """Outputs of a law where all conditions on the way are decided."""

    outputs: list[Expr]
    roots: list[Root]


@dataclass(frozen=True)
class Branch:
    """A condition, and what follows if it holds and if not."""

    condition: Condition
    holds: Branch | Leaf
    fails: Branch | Leaf
    roots: list[Root]


def partial_derivative(expression: Expr, variable: Expr) -> Expr:
    """The partial derivative by a variable, roots held."""
    derivative: Expr = apply_derivatives(ufl.diff(expression, variable))
    return derivative


class Slopes:
    """Derivatives of the expressions of one leaf by inputs, those through roots included."""

    def __init__(self, roots: Sequence[Root]) -> None:
        self._roots = roots
        self._of_roots: dict[tuple[int, Expr], Expr] = {}

    def of(self, expression: Expr, variable: Expr, known: int | None = None) -> Expr:
        """The derivative by an input, of an expression of the first `known` roots."""
        count = len(self._roots) if known is None else known
        total = partial_derivative(expression, variable)
        for number, root in enumerate(self._roots[:count]):
            through = partial_derivative(expression, root.unknown)
            if not isinstance(through, Zero):
                total = total + through * self._of_root(number, variable)
        return total

    def _of_root(self, number: int, variable: Expr) -> Expr:
        """The derivative of a root: its residual stays zero."""
        key = number, variable
        if key not in self._of_roots:
            root = self._roots[number]
            slope = partial_derivative(root.residual, root.unknown)
            self._of_roots[key] = -self.of(root.residual, variable, number) / slope
        return self._of_roots[key]


class Symbol:
    """A real number of which only the UFL expression is known.

    NumPy's functions of one number take it, such as `np.sqrt` and `np.log`.
    """

    def __init__(self, expression: Expr) -> None:
        self.expression = expression

    @property
    def real(self) -> Symbol:
        """Itself; the imaginary part is zero."""
        return self

    def _combine(self, other: Number, operation: Callable[[Any, Any], Expr]) -> Symbol:
        return Symbol(operation(self.expression, _expression(other)))

    def __add__(self, other: Number) -> Symbol:
        return self._combine(other, operator.add)

    def __sub__(self, other: Number) -> Symbol:
        return self._combine(other, operator.sub)

    def __rsub__(self, other: Number) -> Symbol:
        return Symbol(_expression(other) - self.expression)

    def __mul__(self, other: Number) -> Symbol:
        return self._combine(other, operator.mul)

    def __truediv__(self, other: Number) -> Symbol:
        return self._combine(other, operator.truediv)

    def __rtruediv__(self, other: Number) -> Symbol:
        return Symbol(_expression(other) / self.expression)

    def __pow__(self, other: Number) -> Symbol:
        return self._combine(other, operator.pow)

    def __rpow__(self, other: Number) -> Symbol:
        return Symbol(_expression(other) ** self.expression)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Symbol:
        return Symbol(-self.expression)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return -self if self < 0 else self

    def __lt__(self, other: Number) -> bool:
        return _ask(self.expression, _expression(other))

    def __ge__(self, other: Number) -> bool:
        return not _ask(self.expression, _expression(other))

    def __gt__(self, other: Number) -> bool:
        return _ask(_expression(other), self.expression)

    def __le__(self, other: Number) -> bool:
        return not _ask(_expression(other), self.expression)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Symbol | int | float):
            return False
        return _ask(self.expression, _expression(other), is_equality=True)

    def __bool__(self) -> bool:
        return self != 0.0

    __hash__ = None  # type: ignore[assignment]

    def sqrt(self) -> Symbol:
        """√x."""
        return Symbol(ufl.sqrt(self.expression))

    def exp(self) -> Symbol:
        """e^x."""
        return Symbol(ufl.exp(self.expression))

    def expm1(self) -> Symbol:
        """e^x - 1, in the form that does not cancel."""
        # Far below zero the product would be zero times infinity.
        if self < -50:
            return self.exp() - 1
        half = self.expression / 2
        return Symbol(2 * ufl.exp(half) * ufl.sinh(half))

    def log(self) -> Symbol:
        """The natural logarithm."""
        return Symbol(ufl.ln(self.expression))

    def sin(self) -> Symbol:
        """The sine."""
        return Symbol(ufl.sin(self.expression))

    def cos(self) -> Symbol:
        """The cosine."""
        return Symbol(ufl.cos(self.expression))

    def tan(self) -> Symbol:
        """The tangent."""
        return Symbol(ufl.tan(self.expression))

    def tanh(self) -> Symbol:
        """The hyperbolic tangent."""
        return Symbol(ufl.tanh(self.expression))

    def arctan(self) -> Symbol:
        """The angle of a tangent [rad]."""
        return Symbol(ufl.atan(self.expression))

    def arctan2(self, other: Number) -> Symbol:
        """The angle [rad] of a point with itself as second coordinate and the other as first."""
        return self._combine(other, ufl.atan2)


class _Run:
    """One run of a law: the answers that are given to its comparisons, and the equations of it that
    have to be solved."""

    def __init__(self, answers: dict[Condition, bool], unknowns: list[Expr]) -> None:
        """`unknowns` are those of all runs of a law: in each of them the same, so that conditions
        on them are."""
        self.answers = answers
        self.roots: list[Root] = []
        self._unknowns = unknowns

    def answer(self, condition: Condition) -> bool:
        """Whether a condition holds; ends the run if that is not decided yet."""
        if condition in self.answers:
            return self.answers[condition]
        opposite = Condition(condition.second, condition.first, condition.is_equality)
        if condition.is_equality and opposite in self.answers:
            return self.answers[opposite]
        if self.answers.get(opposite, False):
            return False
        raise _Undecided(condition)

    def unknown(self) -> Expr:
        """The variable of the next equation."""
        if len(self.roots) == len(self._unknowns):
            self._unknowns.append(
                ufl.variable(ufl.Constant(_DOMAIN, count=FIRST_UNKNOWN + len(self.roots)))
            )
        return self._unknowns[len(self.roots)]


# The run of a law in symbols that is under way
_run: ContextVar[_Run | None] = ContextVar("run", default=None)


def _expression(number: Number) -> Expr:
    """A symbol or real number as a UFL expression."""
    if isinstance(number, Symbol):
        return number.expression
    if isinstance(number, complex):
        raise NotTraceable("it computes with complex numbers")
    if not math.isfinite(number):
        raise NotTraceable("a number in it is not finite")
    return ufl.as_ufl(float(number) if not isinstance(number, int) else number)


def _ask(first: Expr, second: Expr, *, is_equality: bool = False) -> bool:
    """Whether first < second, or both are equal, in the run that is under way."""
    if first == second:
        return is_equality
    run = _run.get()
    if run is None:
        raise NotTraceable("it compares symbols outside of a run")
    return run.answer(Condition(first, second, is_equality))


def root(residual: Callable[[Number], Number], low: Number, high: Number) -> Number:
    """The number between `low` and `high` at which an equation of a law has the residual zero.

    The law gives its equation, and the derivatives of the root are those of the implicit function.
    In C it is solved by Newton's method within an interval that is halved where that leaves it.

    Args:
        residual: excess of the equation, of one number; of different sign at both ends, and finite
            at `high`.  It may not compare numbers that depend on its argument.
        low, high: ends of the interval.

    Example:
        >>> round(root(lambda x: x * x - 2.0, 1.0, 2.0), 12)
        1.414213562373
    """
    run = _run.get()
    if run is None:
        return _solved(residual, low, high)
    ends = (_expression(low), _expression(high))
    unknown = run.unknown()
    run.roots.append(Root(unknown, _excess(residual, unknown), *ends))
    return Symbol(unknown)


def _excess(residual: Callable[[Number], Number], unknown: Expr) -> Expr:
    """The excess of an equation for its unknown."""
    try:
        return _expression(residual(Symbol(unknown)))
    except _Undecided as undecided:
        condition = undecided.condition
        if _contains(condition.first, unknown) or _contains(condition.second, unknown):
            raise NotTraceable("an equation of it compares its unknown") from undecided
        raise


def at_most(first: Number, second: Number, holds: Number, fails: Number) -> Number:
    """`holds` if first ≤ second, else `fails`, for values whose derivatives are finite on both
    sides: in symbols both are computed, and the law has no further branch.  Of arrays each entry is
    chosen by itself.

    Example:
        >>> at_most(1.0, 2.0, holds=3.0, fails=4.0)
        3.0
    """
    given = (first, second, holds, fails)
    if any(isinstance(number, np.ndarray) for number in given):
        return np.where(first <= second, holds, fails)
    if not any(isinstance(number, Symbol) for number in given):
        return holds if first.real <= second.real else fails
    low, high, yes, no = (_expression(number) for number in given)
    return Symbol(ufl.conditional(ufl.le(low, high), yes, no))


def _contains(expression: Expr, part: Expr) -> bool:
    """Whether a part occurs in an expression."""
    return any(one == part for one in ufl.corealg.traversal.unique_pre_traversal(expression))


def _solved(residual: Callable[[Number], Number], low: Number, high: Number) -> Number:
    """`root` of numbers, real or complex."""
    left = float(low.real)
    right = float(high.real)
    is_positive_right = residual(right).real > 0
    for _ in range(MAX_BISECTIONS):
        middle = (left + right) / 2
        if middle in (left, right):
            break
        if (residual(middle).real > 0) == is_positive_right:
            right = middle
        else:
            left = middle
    found: Number = (left + right) / 2
    step = RELATIVE_STEP * found
    slope = (residual(found + step).real - residual(found - step).real) / (2 * step)
    for _ in range(POLISHING):
        found = found - residual(found) / slope
    return found


def inputs_of(count: int) -> list[Expr]:
    """The inputs of a law as UFL variables."""
    return [ufl.variable(ufl.Constant(_DOMAIN, count=number)) for number in range(count)]


def trace(law: Callable[..., Any], inputs: Sequence[Expr]) -> Branch | Leaf:
    """Return the outputs of a law, one number or several, for UFL expressions as its arguments.

    Raises:
        NotTraceable: the law needs numbers, or has too many branches.
    """
    symbols = [Symbol(expression) for expression in inputs]
    count = 0
    unknowns: list[Expr] = []

    def follow(answers: dict[Condition, bool]) -> Branch | Leaf:
        nonlocal count
        count += 1
        if count > MAX_BRANCHES or len(answers) > MAX_COMPARISONS:
            raise NotTraceable("it has too many branches")
        run = _Run(answers, unknowns)
        token = _run.set(run)
        try:
            outputs = law(*symbols)
        except _Undecided as undecided:
            condition = undecided.condition
        # What is not meant for symbols may fail in any way.
        except Exception as error:
            raise NotTraceable(f"{type(error).__name__}: {error}") from error
        else:
            several = outputs if isinstance(outputs, tuple | list) else [outputs]
            return Leaf([_expression(output) for output in several], run.roots)
        finally:
            _run.reset(token)
        holds = follow({**answers, condition: True})
        fails = follow({**answers, condition: False})
        return Branch(condition, holds, fails, run.roots)

    return follow({})


def with_slopes(tree: Branch | Leaf, by: Sequence[Expr]) -> Branch | Leaf:
    """A traced law with the derivatives of its first output by some inputs as further outputs."""
    if isinstance(tree, Leaf):
        slopes = Slopes(tree.roots)
        further = [slopes.of(tree.outputs[0], variable) for variable in by]
        return Leaf([*tree.outputs, *further], tree.roots)
    holds = with_slopes(tree.holds, by)
    return Branch(tree.condition, holds, with_slopes(tree.fails, by), tree.roots)


def as_ufl(law: Callable[..., Any], *arguments: Expr) -> Expr:
    """Return a law with one output as a UFL expression for forms, with `ufl.conditional` for its
    branches.

    Args:
        law: a function of real numbers, of which each has a UFL expression as argument.
        arguments: scalar UFL expressions.

    Raises:
        NotTraceable: the law needs numbers, has too many branches, or has to solve an equation.
    """

    def expression(tree: Branch | Leaf) -> Expr:
        if tree.roots:
            raise NotTraceable("it solves an equation, which UFL cannot")
        if isinstance(tree, Leaf):
            return tree.outputs[0]
        compare = ufl.eq if tree.condition.is_equality else ufl.lt
        condition = compare(tree.condition.first, tree.condition.second)
        return ufl.conditional(condition, expression(tree.holds), expression(tree.fails))

    return expression(trace(law, arguments))
