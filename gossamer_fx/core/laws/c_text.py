"""A traced law as the text of a C function, with derivatives that UFL takes.

Each branch of the law is one of C, so that only the branch that holds is computed.  Expressions
that occur more than once become one variable; common factors of powers are left to the compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ufl.classes import (
    Atan2,
    Conditional,
    Constant,
    Division,
    MathFunction,
    Power,
    Product,
    ScalarValue,
    Sum,
    Variable,
    Zero,
)
from ufl.core.expr import Expr

from gossamer_fx.core.laws.tracing import (
    Branch,
    Leaf,
    NotTraceable,
    Root,
    Slopes,
    partial_derivative,
)

# Names in C of UFL's functions, where they differ
C_FUNCTIONS = {"ln": "log"}

PRELUDE = """#include <math.h>

/* Powers; the compiler knows the exponent where it is a number. */
static inline double power(double x, double n)
{
    if (n == 0.5) return sqrt(x);
    if (n == -0.5) return 1 / sqrt(x);
    if (n == 1.5) return x * sqrt(x);
    if (n == -1.5) return 1 / (x * sqrt(x));
    if (n == -1) return 1 / x;
    if (n == 2) return x * x;
    if (n == -2) return 1 / (x * x);
    if (n == 3) return x * x * x;
    if (n == -3) return 1 / (x * x * x);
    if (n == 4) return x * x * (x * x);
    return pow(x, n);
}
"""

# The step of Newton's method for a root is round-off if it is below the one, or does not fall any
# more below the other, as a share of the root.
ROOT_TOLERANCE = 1e-15
ROOT_ROUND_OFF = 1e-6
MAX_ROOT_ITERATIONS = 200


class _Scope:
    """Statements of a block of C, and the variables that are known in it."""

    def __init__(self, outer: _Scope | None, roots: Sequence[Root]) -> None:
        self.lines: list[str] = []
        self.names: dict[Expr, str] = dict(outer.names) if outer else {}
        self.roots = {_constant(root.unknown): root for root in roots}
        self.depth: int = outer.depth + 1 if outer else 0

    def add(self, expression: Expr, text: str) -> str:
        """Define the variable of an expression."""
        name = f"t{self.depth}_{len(self.lines)}"
        self.lines.append(f"const double {name} = {text};")
        self.names[expression] = name
        return name


def _constant(variable: Expr) -> Expr:
    """The constant of a variable of UFL."""
    return variable.ufl_operands[0]


def _text(expression: Expr, scope: _Scope) -> str:
    """C text of the value of an expression, a name or a number; what it is made of is defined in
    the scope."""
    if isinstance(expression, Variable):
        return _text(expression.ufl_operands[0], scope)
    if isinstance(expression, Zero):
        return "0.0"
    if isinstance(expression, ScalarValue):
        return f"({float(expression)!r})"
    if expression in scope.names:
        return scope.names[expression]
    if isinstance(expression, Constant):
        return _solve(scope.roots[expression], scope)
    if isinstance(expression, Conditional):
        # Of `tracing.at_most`, the only one that makes them
        condition, *sides = expression.ufl_operands
        low, high = (_text(part, scope) for part in condition.ufl_operands)
        holds, fails = (_text(side, scope) for side in sides)
        return scope.add(expression, f"{low} <= {high} ? {holds} : {fails}")
    parts = [_text(part, scope) for part in expression.ufl_operands]
    if isinstance(expression, Sum):
        text = " + ".join(parts)
    elif isinstance(expression, Product):
        text = " * ".join(parts)
    elif isinstance(expression, Division):
        text = " / ".join(parts)
    elif isinstance(expression, Power):
        text = f"power({parts[0]}, {parts[1]})"
    elif isinstance(expression, Atan2):
        text = f"atan2({parts[0]}, {parts[1]})"
    elif isinstance(expression, MathFunction):
        name = expression._name
        text = f"{C_FUNCTIONS.get(name, name)}({parts[0]})"
    else:
        raise NotTraceable(f"C has no {type(expression).__name__}")
    return scope.add(expression, text)


def _solve(root: Root, scope: _Scope) -> str:
    """Define the root of an equation in a scope, and return its name."""
    low = _text(root.low, scope)
    high = _text(root.high, scope)
    unknown = _constant(root.unknown)
    name = f"root{scope.depth}_{len(scope.lines)}"
    inner = _Scope(scope, list(scope.roots.values()))
    inner.names[unknown] = name
    residual = _text(root.residual, inner)
    slope = _text(partial_derivative(root.residual, root.unknown), inner)
    scope.lines.append(
        f"double {name} = {high};\n"
        f"{{\ndouble low = {low}, high = {high}, last = INFINITY;\nint high_sign = 0;\n"
        f"for (int i = 0; i < {MAX_ROOT_ITERATIONS}; ++i) {{\n"
        + "\n".join(inner.lines)
        + f"\nif (i == 0) high_sign = {residual} > 0;\n"
        f"if ({residual} == 0) break;\n"
        f"if (({residual} > 0) == high_sign) high = {name}; else low = {name};\n"
        f"double next = {name} - {residual} / {slope};\n"
        "if (!(next > low && next < high)) next = (low + high) / 2;\n"
        f"const double step = fabs(next - {name});\n"
        f"if (step >= last && last <= {ROOT_ROUND_OFF} * fabs({name})) break;\n"
        f"{name} = next;\nlast = step;\n"
        f"if (step <= {ROOT_TOLERANCE} * fabs(next)) break;\n}}\n}}"
    )
    scope.names[unknown] = name
    return name


def _leaf_text(leaf: Leaf, scope: _Scope, by: Sequence[Expr], orders: int) -> str:
    """Statements that set outputs and derivatives."""
    values = [f"f[{i}] = {_text(output, scope)};" for i, output in enumerate(leaf.outputs)]
    blocks = [*scope.lines, *values]
    if orders > 0:
        slopes = Slopes(leaf.roots)
        first = [[slopes.of(output, one) for one in by] for output in leaf.outputs]
        inner = _Scope(scope, leaf.roots)
        assignments = _assignments("df", [one for row in first for one in row], inner)
        blocks.append(_block("df", [*inner.lines, *assignments]))
    if orders > 1:
        second = [slopes.of(one, other) for row in first for one in row for other in by]
        inner = _Scope(scope, leaf.roots)
        assignments = _assignments("ddf", second, inner)
        blocks.append(_block("ddf", [*inner.lines, *assignments]))
    return "\n".join(blocks)


def _assignments(name: str, expressions: Sequence[Expr], scope: _Scope) -> list[str]:
    """Statements that set the numbers of an array."""
    texts = [_text(expression, scope) for expression in expressions]
    return [f"{name}[{i}] = {text};" for i, text in enumerate(texts)]


def _block(condition: str, lines: Sequence[str]) -> str:
    body = "\n".join(lines)
    return f"if ({condition}) {{\n{body}\n}}"


def _tree_text(tree: Branch | Leaf, outer: _Scope, by: Sequence[Expr], orders: int) -> str:
    """Statements of a branch or leaf, in a separate block."""
    scope = _Scope(outer, tree.roots)
    if isinstance(tree, Leaf):
        return _leaf_text(tree, scope, by, orders)
    sign = "==" if tree.condition.is_equality else "<"
    first = _text(tree.condition.first, scope)
    second = _text(tree.condition.second, scope)
    holds = _tree_text(tree.holds, scope, by, orders)
    fails = _tree_text(tree.fails, scope, by, orders)
    lines = "\n".join(scope.lines)
    return f"{lines}\nif ({first} {sign} {second}) {{\n{holds}\n}} else {{\n{fails}\n}}"


def c_text(tree: Any, inputs: Sequence[Expr], by: Sequence[int], orders: int) -> str:
    """Return the C function `law` of a traced law: it sets outputs f, and df (outputs, by) and ddf
    (outputs, by, by) unless they are null; and `rows`, which does so for each of n rows of inputs.

    Args:
        tree: what `tracing.trace` returns.
        inputs: UFL variables of the inputs.
        by: numbers of the inputs by which derivatives are taken.
        orders: 0 for values alone, 1 for first derivatives, 2 for second ones in addition.

    Raises:
        NotTraceable: it has a function that C has not.
    """
    scope = _Scope(None, [])
    for number, variable in enumerate(inputs):
        scope.names[_constant(variable)] = f"x[{number}]"
    body = _tree_text(tree, scope, [inputs[number] for number in by], orders)
    outputs = _output_count(tree)
    return (
        f"{PRELUDE}\nvoid law(const double *restrict x, double *restrict f, double *restrict df, "
        f"double *restrict ddf)\n{{\n(void)x; (void)df; (void)ddf;\n{body}\n}}\n"
        "\nvoid rows(long n, const double *x, double *f, double *df)\n{\n"
        f"for (long i = 0; i < n; ++i)\nlaw(x + {len(inputs)} * i, f + {outputs} * i, "
        f"df ? df + {outputs * len(by)} * i : 0, 0);\n}}\n"
    )


def _output_count(tree: Branch | Leaf) -> int:
    """How many numbers a traced law returns."""
    return len(tree.outputs) if isinstance(tree, Leaf) else _output_count(tree.holds)
