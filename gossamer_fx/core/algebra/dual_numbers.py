"""Dual numbers: values with derivatives, for formulas that are written once and used for both.

A dual number is x + Σ_i x_i ε_i with ε_i ε_j = 0: a value x and its derivatives x_i with respect to
k variables.  Sums, products and powers follow the rules of differentiation (forward mode of
automatic differentiation; Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, ch. 3).

Values may be complex.  A formula that itself takes a derivative by a complex step is then
differentiated exactly, which a second complex step could not do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array

Number = Any  # a dual number, or a real or complex number
Numbers = npt.NDArray[Any]  # of real or complex numbers


class Dual:
    """A value, real or complex, and its derivatives `slopes` (k,) with respect to k variables.
    Comparisons compare real parts of values, so that a formula takes the same branches as for
    numbers."""

    __slots__ = ("slopes", "value")
    # NumPy leaves sums and products of its numbers with dual numbers to this class.
    __array_ufunc__ = None

    def __init__(self, value: complex, slopes: Numbers) -> None:
        self.value = value
        self.slopes = slopes

    @property
    def real(self) -> Dual:
        """The real part, with its derivatives."""
        return Dual(self.value.real, np.real(self.slopes))

    @property
    def imag(self) -> Dual:
        """The imaginary part, with its derivatives."""
        return Dual(self.value.imag, np.imag(self.slopes))

    def expm1(self) -> Dual:
        """exp(x) - 1."""
        return Dual(np.expm1(self.value), np.exp(self.value) * self.slopes)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slopes)

    def __add__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slopes + other.slopes)
        return Dual(self.value + other, self.slopes)

    def __sub__(self, other: Number) -> Dual:
        return self + (-other)

    def __rsub__(self, other: Number) -> Dual:
        return (-self) + other

    def __mul__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            slopes = self.slopes * other.value + self.value * other.slopes
            return Dual(self.value * other.value, slopes)
        return Dual(self.value * other, self.slopes * other)

    def __truediv__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            return self * other**-1
        return Dual(self.value / other, self.slopes / other)

    def __rtruediv__(self, other: Number) -> Dual:
        return self**-1 * other

    def __pow__(self, exponent: Number) -> Dual:
        if isinstance(exponent, Dual):
            fixed = self**exponent.value
            slopes = np.log(self.value) * fixed.value * exponent.slopes
            return Dual(fixed.value, fixed.slopes + slopes)
        slope = exponent * self.value ** (exponent - 1)
        return Dual(self.value**exponent, slope * self.slopes)

    def __rpow__(self, base: complex) -> Dual:
        value = base**self.value
        return Dual(value, np.log(base) * value * self.slopes)

    __radd__ = __add__
    __rmul__ = __mul__

    def __lt__(self, other: Number) -> bool:
        return bool(self.value.real < _value(other).real)

    def __le__(self, other: Number) -> bool:
        return bool(self.value.real <= _value(other).real)

    def __gt__(self, other: Number) -> bool:
        return bool(self.value.real > _value(other).real)

    def __ge__(self, other: Number) -> bool:
        return bool(self.value.real >= _value(other).real)


def _value(number: Number) -> complex:
    """The number itself, or the value of a dual one."""
    return number.value if isinstance(number, Dual) else number


def log(number: Number) -> Number:
    """Natural logarithm of a real, complex or dual number."""
    if isinstance(number, Dual):
        return Dual(np.log(number.value), number.slopes / number.value)
    return np.log(number)


def variables(values: Array) -> Array:
    """The variables of a derivative: k dual numbers (k,), of dtype object, with these values (k,),
    each with the slope 1 for itself and 0 for the others."""
    numbers = np.empty(len(values), dtype=object)
    directions: Array = np.eye(len(values))
    for i in range(len(values)):
        numbers[i] = Dual(float(values[i]), directions[i])
    return numbers


def jacobian(numbers: Array, k: int) -> Array:
    """Derivatives (n, k) of n numbers, dual or plain, with respect to k variables: zero for a plain
    number, the real part where they are complex."""
    rows = [x.slopes.real if isinstance(x, Dual) else np.zeros(k) for x in numbers]
    return np.array(rows).reshape(len(numbers), k)
