"""Cases: an experiment as a data file, with inputs, measured values and what is asked of a
prediction.

A case file is TOML and holds data only: it names one of the models of `demos/validation/models`,
and nothing in it is executed.  `docs/measured.md` explains its format, so that other programs can
read it.

    format = 1
    name = "hiad_71"                  of its results; letters, digits and underscores
    title, source, licence            one line each
    peer                              what the errors `peer_error` belong to (optional)
    model = "braided_tube"
    evidence = "experiment"           or "theory", or "program" for another program (optional)
    family = "beams"                  cases that tables and the picture show together (optional)
    quick_tests = ["1 up, 69 kPa"]    those of the quick form
    [expected_warnings]               of the program: a reason by a part of the text (optional)
    "inner forces" = "the film is slack before it is inflated"
    [inputs]                          of all tests
    length = {value = 3.2, unit = "m"}
    [[tests]]
    name = "1 up, 69 kPa"
    [tests.inputs]                    of this test; they replace those of all tests
    pressure = {value = 68.9, unit = "kPa"}
    [[tests.measured]]
    quantity = "load"                 what the model predicts under this name
    kind = "load"                     of quantities that are counted together (optional)
    evidence = "theory"               if it is another than that of the case (optional)
    not_counted = "..."               why it does not count: it was calibrated, say (optional)
    not_converged = "..."             what a finer mesh does; such a quantity is a miss (optional)
    y = {value = [...], unit = "N"}   measured values, or one number
    x = {value = [...], unit = "mm"}  of a curve
    range = [25, 125]                 of x, in its unit, in which a curve is compared
    labels = ["La", "Lb"]             of values that are not a curve (optional)
    reference = 39.5                  in the unit of y: errors are relative to it, and not to each
                                      measured value, for curves through zero (optional)
    tolerance = 0.05                  asked of the mean relative error, or
    accepted = [0.05, 0.25]           asked of the mean of predicted/measured - 1
    quick_accepted = [0.0, 0.3]       the same, or of the mean relative error, of the quick form
    peer_error = 0.032                mean relative error of the peer (optional)

How uncertain inputs and measured values are stands in `[[uncertainties]]`, `[exact]` and `[finer]`:
see `uncertainty`.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from demos.validation.engine.uncertainty import KINDS, RELATIVE, Statement, Uncertainty
from demos.validation.engine.units import UNITS, conversion_factor
from gossamer_fx.extend import InputError, check

# Of case files.  A reader refuses files of a later format, whose entries it may misunderstand.
FORMAT = 1

# Largest case file [bytes].  The parser is slow, so that a file of any size would stop the program.
MAX_FILE_SIZE = 4_000_000

# Parts of a name with points in between.
_MAX_PARTS = 100

# What a prediction is compared with.
EVIDENCE = ("experiment", "theory", "program")

# Words of a file that are printed, drawn or part of a file name.
NAME = re.compile(r"[a-z0-9_]{1,60}")
TEST_NAME = re.compile(r"[A-Za-z0-9_°.,+/ -]{1,80}")
MAX_LINE_LENGTH = 400

Array = np.ndarray


@dataclass(frozen=True)
class Measured:
    """Measured values of one quantity, and what is asked of a prediction.

    Attributes:
        quantity: name of what is predicted.
        y: measured values (n,), in `unit`.
        unit: of `y`.
        x: abscissae (n,) of a curve, in `x_unit`; None for values that are not a curve.
        x_unit: of `x`.
        x_range: part of the abscissa in which curves are compared.
        labels: names of the values.
        reference: what errors are relative to, in `unit`; not a number for each measured value.
        accepted: smallest and largest relative error that is accepted.
        quick_accepted: the same on the mesh of the quick form.
        is_mean_of_sizes: whether `accepted` is of the mean size of the errors, or else of their
            mean.
        peer_error: mean size of the relative errors of the peer; not a number if it is not known.
        kind: of quantities that are counted together, e.g. "load"; may be empty.
        evidence: one of `EVIDENCE`.
        not_counted: why it is not a prediction; empty if it is one.
        not_converged: what a finer mesh does to the error; empty if it changes it by less than a
            third.
    """

    quantity: str
    y: Array
    unit: str
    x: Array | None
    x_unit: str
    x_range: tuple[float, float]
    labels: tuple[str, ...]
    reference: float
    accepted: tuple[float, float]
    quick_accepted: tuple[float, float]
    is_mean_of_sizes: bool
    peer_error: float
    kind: str = ""
    evidence: str = EVIDENCE[0]
    not_counted: str = ""
    not_converged: str = ""


@dataclass(frozen=True)
class Inputs:
    """The inputs of one test, which a model asks for by name and unit.

    Attributes:
        where: case and test, for messages.
        values: the tables {value, unit} of the file, by name.
    """

    where: str
    values: Mapping[str, Any]

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def number(self, name: str, unit: str, *, above: float = -math.inf) -> float:
        """One finite number in a unit, larger than `above`.

        Raises:
            InputError: it is missing, or is not such a number, or has a unit of another dimension.
        """
        found = self._array(name, unit, dimensions=0)
        # Compared in the unit of the model, which the message shows, whatever that of the file is.
        value = float(found)
        check(
            value > above, f"{self.where}: {name} is {value:g} {unit}; give a number > {above:g}."
        )
        return value

    def whole(self, name: str, *, least: int = 1) -> int:
        """A whole number of at least `least`, without a unit."""
        value = self.number(name, "1")
        check(
            value == round(value) and value >= least,
            f"{self.where}: {name} is {value:g}; give a whole number of at least {least}.",
        )
        return round(value)

    def numbers(self, name: str, unit: str) -> Array:
        """Finite numbers (n,) in a unit."""
        return self._array(name, unit, dimensions=1)

    def table(self, name: str, unit: str, columns: int) -> Array:
        """Finite numbers (n, columns) in a unit."""
        found = self._array(name, unit, dimensions=2)
        check(
            found.shape[1] == columns,
            f"{self.where}: {name} has {found.shape[1]} columns; give {columns}.",
        )
        return found

    def word(self, name: str, choices: tuple[str, ...]) -> str:
        """One of some words."""
        value = self._entry(name)
        check(
            value in choices,
            f"{self.where}: {name} is {_short(value)}; give one of {', '.join(choices)}.",
        )
        return str(value)

    def _entry(self, name: str) -> Any:
        check(name in self.values, f"{self.where}: the input '{name}' is missing; add it.")
        return self.values[name]

    def _array(self, name: str, unit: str, dimensions: int) -> Array:
        # Case, test and entry, so that an author finds the number from the message alone.
        where = f"{self.where}: {name}"
        value, own_unit = _quantity(where, self._entry(name))
        found = _finite(where, value, dimensions)
        return found * conversion_factor(own_unit, unit, where)


@dataclass(frozen=True)
class Test:
    """One test of an experiment.

    Attributes:
        name: within its case.
        inputs: what the model may know.
        measured: what was measured; the model does not see it.
        digest: of inputs and model; a stored result of other inputs is not used.
    """

    # pytest would take the class for tests
    __test__ = False

    name: str
    inputs: Inputs
    measured: tuple[Measured, ...]
    digest: str


@dataclass(frozen=True)
class Case:
    """An experiment: see the module for the file.

    Attributes:
        name, title, source, licence, peer: words of the file.
        model: name of the model.
        family: of the cases that are shown together; default the words of the model's name.
        tests: in the order of the file.
        quick_tests: names of those of the quick form.
        expected_warnings: reasons by a part of the text of a warning.
        statement: how uncertain inputs and measured values are.
    """

    name: str
    title: str
    source: str
    licence: str
    peer: str
    model: str
    family: str
    tests: tuple[Test, ...]
    quick_tests: tuple[str, ...]
    expected_warnings: Mapping[str, str]
    statement: Statement = field(default_factory=Statement)

    def chosen(self, quick: bool) -> list[Test]:
        """The tests of the quick or the full form."""
        return [test for test in self.tests if not quick or test.name in self.quick_tests]

    def with_only(self, only: str) -> Case:
        """The case whose quick form has in addition the tests whose name contains a text.

        Raises:
            InputError: no test has such a name.
        """
        if not only:
            return self
        # All tests, since one that is not of the quick form may be asked for by name.
        names = [test.name for test in self.tests]
        wanted = [name for name in names if only in name]
        check(
            bool(wanted),
            f"No test of '{self.name}' has '{only}' in its name; give a part of one of: "
            f"{'; '.join(names)}.",
        )
        # A dictionary keeps the order, and drops tests that are of the quick form anyway.
        return replace(self, quick_tests=tuple(dict.fromkeys([*self.quick_tests, *wanted])))


def read_case(path: Path, models: list[str]) -> Case:
    """Read a case file.

    Args:
        path: of the file.
        models: names of the models that a case may have.

    Raises:
        InputError: the file does not exist, it is not TOML, an entry is missing, unknown or of
            another kind.
    """
    where = f"'{path}'"
    data = _parsed(path, where)
    known = {"format", "name", "title", "source", "licence", "model", "peer", "quick_tests"}
    known |= {"family", "evidence", "inputs", "tests", "expected_warnings"}
    known |= {"uncertainties", "exact", "finer"}
    _check_keys(where, data, known)
    version = data.get("format")
    check(version == FORMAT, f"{where}: format is {_short(version)}; this program reads {FORMAT}.")
    name = _line(where, data, "name")
    # Results are stored in files of this name.
    check(
        NAME.fullmatch(name) is not None,
        f"{where}: name is '{name}'; give up to 60 small letters, digits and underscores.",
    )
    model = _line(where, data, "model")
    check(model in models, f"{where}: model is '{model}'; give one of {', '.join(models)}.")
    shared = _mapping(where, data.get("inputs", {}), "inputs")
    tests = data.get("tests")
    check(
        isinstance(tests, list) and len(tests) > 0,
        f"{where}: there are no tests; add one as [[tests]].",
    )
    evidence = _evidence(where, data, EVIDENCE[0])
    found = tuple(_test(where, model, evidence, shared, test) for test in tests)
    # Stored results belong to tests by their names.
    names = [test.name for test in found]
    repeated = {one for one in names if names.count(one) > 1}
    check(not repeated, f"{where}: several tests have the name '{min(repeated, default='')}'.")
    # One test shows that the model works, unless the case says which ones do.
    quick_tests = data.get("quick_tests", names[:1])
    check(
        isinstance(quick_tests, list) and all(one in names for one in quick_tests),
        f"{where}: quick_tests is {_short(quick_tests)}; give names of its tests.",
    )
    return Case(
        name=name,
        title=_line(where, data, "title"),
        source=_line(where, data, "source"),
        licence=_line(where, data, "licence"),
        peer=_line(where, data, "peer", default=""),
        model=model,
        family=_line(where, data, "family", default=model.replace("_", " ")),
        tests=found,
        quick_tests=tuple(quick_tests),
        expected_warnings={
            part: _words(f"{where}: reason of '{_short(part)}'", reason)
            for part, reason in _mapping(
                where, data.get("expected_warnings", {}), "expected_warnings"
            ).items()
        },
        statement=_statement(where, data, found),
    )


def with_inputs(case: Case, changes: Mapping[str, float]) -> Case:
    """The case with other numbers as inputs of all its tests.

    Args:
        case: the case.
        changes: numbers by the name of the input, in the unit that the case has, or in that of the
            model if the case leaves this input out.

    Raises:
        InputError: an input that is not one number, or that neither the case nor its model has.
    """
    model = importlib.import_module(f"demos.validation.models.{case.model}")
    optional = getattr(model, "OPTIONAL_INPUTS", {})
    known = set(optional).union(*(test.inputs.values for test in case.tests))
    for name in changes:
        check(
            name in known,
            f"Case '{case.name}' has no input '{name}'; set one of {', '.join(sorted(known))}.",
        )
    tests = []
    for test in case.tests:
        # A copy: the case that is given stays as it is.
        values = dict(test.inputs.values)
        for name, number in changes.items():
            old = values.get(name, {"value": 0.0, "unit": optional.get(name, "1")})
            is_number = isinstance(old, dict) and isinstance(old.get("value"), int | float)
            check(
                is_number,
                f"{test.inputs.where}: '{name}' is not one number; set another input.",
            )
            values[name] = {**old, "value": number}
        inputs = Inputs(test.inputs.where, values)
        tests.append(
            # With a separate digest, so that results of the file's inputs are not taken for it.
            replace(
                test,
                inputs=inputs,
                digest=digest_of(case.model, values),
            )
        )
    return replace(case, tests=tuple(tests))


def digest_of(model: str, values: Mapping[str, Any]) -> str:
    """A short text that differs if a model or its inputs differ."""
    # Sorted, so that the order of entries in the file does not matter; JSON has no dates.
    text = json.dumps(
        [model, values],
        sort_keys=True,
        default=str,
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _parts_of_name(line: str) -> int:
    """The largest number of words in a line of TOML that follow each other with points in between,
    without a blank or comma, as the parts of a name do."""
    most = 0
    count = 0
    for word in line.split("."):
        count += 1
        most = max(most, count)
        if re.search(r"[\s,]", word.strip()):
            count = 0
    return most


def _parsed(path: Path, where: str) -> dict[str, Any]:
    """The data of a TOML file."""
    check(
        path.is_file(), f"There is no case file {where}; give a name, or the path of a TOML file."
    )
    size = path.stat().st_size
    check(
        size <= MAX_FILE_SIZE,
        f"{where} has {size} bytes; a case file has at most {MAX_FILE_SIZE}.",
    )
    try:
        text = path.read_text(encoding="utf-8")
        # Python takes minutes for a name of thousands of parts.
        check(
            all(_parts_of_name(line) <= _MAX_PARTS for line in text.splitlines()),
            f"{where} has a name of more than {_MAX_PARTS} parts; a case file has three levels.",
        )
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        # Further lines of the parser show parts of the file, which may be long.
        words = str(error).splitlines()[0]
        raise InputError(f"{where} is not a TOML file ({words}); correct it.") from error
    except RecursionError as error:
        raise InputError(f"{where} is nested too deeply; a case file has three levels.") from error


def _evidence(where: str, data: Mapping[str, Any], default: str) -> str:
    """What a prediction is compared with."""
    found = data.get("evidence", default)
    check(
        found in EVIDENCE,
        f"{where}: evidence is {_short(found)}; give one of {', '.join(EVIDENCE)}.",
    )
    return str(found)


def _test(where: str, model: str, evidence: str, shared: Mapping[str, Any], data: Any) -> Test:
    """One entry of `tests`, whose measured values are evidence of some kind."""
    entry = _mapping(where, data, "each of tests")
    _check_keys(
        f"{where}, tests",
        entry,
        {"name", "inputs", "measured"},
    )
    name = _line(f"{where}, tests", entry, "name")
    check(
        TEST_NAME.fullmatch(name) is not None,
        f"{where}: a test has the name '{name}'; give letters, digits, spaces and ._,+/- only.",
    )
    here = f"{where}, test '{name}'"
    # Inputs of the test replace those of all tests.
    values = {**shared, **_mapping(here, entry.get("inputs", {}), "inputs")}
    digest = digest_of(model, values)
    measured = entry.get("measured")
    check(
        isinstance(measured, list) and len(measured) > 0,
        f"{here}: nothing is measured; add [[tests.measured]].",
    )
    found = tuple(_measured(here, evidence, item) for item in measured)
    # A prediction has one value or curve under each name.
    quantities = [item.quantity for item in found]
    check(
        len(set(quantities)) == len(quantities),
        f"{here}: a quantity is measured twice; give each its name.",
    )
    return Test(name, Inputs(here, values), found, digest)


def _measured(where: str, evidence: str, data: Any) -> Measured:
    """One entry of `tests.measured`, which is evidence of the kind of the case unless it says
    otherwise."""
    entry = _mapping(where, data, "each of measured")
    known = {"quantity", "y", "x", "range", "labels", "tolerance", "accepted"}
    known |= {"reference", "quick_accepted", "peer_error"}
    known |= {"kind", "evidence", "not_counted", "not_converged"}
    _check_keys(where, entry, known)
    quantity = _line(where, entry, "quantity")
    here = f"{where}, measured '{quantity}'"
    check("y" in entry, f"{here}: y is missing; add the measured values.")
    # One number is an array of one value from here on.
    y_value, unit = _quantity(f"{here}: y", entry["y"])
    y = np.atleast_1d(
        _finite(
            f"{here}: y",
            y_value,
            dimensions=int(isinstance(y_value, list)),
        )
    )
    compared = y
    x: Array | None = None
    x_unit = ""
    x_range = (-math.inf, math.inf)
    if "x" in entry:
        x_value, x_unit = _quantity(f"{here}: x", entry["x"])
        x = _finite(f"{here}: x", x_value, dimensions=1)
        # Interpolation between the points needs abscissae in rising order.
        rises = x.shape == y.shape and len(x) > 1 and bool((np.diff(x) > 0).all())
        check(rises, f"{here}: x does not rise, or has another length than y; give rising values.")
        x_range = _pair(
            here,
            entry,
            "range",
            default=(float(x[0]), float(x[-1])),
        )
        check(
            x[0] <= x_range[0] < x_range[1] <= x[-1],
            f"{here}: range is {list(x_range)}; let it be within x, from {x[0]:g} to {x[-1]:g}.",
        )
        # A curve may begin at zero load, outside of the range.
        inside = x[(x > x_range[0]) & (x < x_range[1])]
        compared = np.interp(
            [x_range[0], *inside, x_range[1]],
            x,
            y,
        )
    reference = math.nan
    if "reference" in entry:
        reference = _number(f"{here}: reference", entry["reference"])
        check(reference > 0, f"{here}: reference is {reference:g}; give a number > 0.")
    check(
        len(compared) > 0 and ("reference" in entry or bool((compared != 0).all())),
        f"{here}: y has zeros or no values; relative errors need values that are not zero.",
    )
    labels = entry.get("labels", [])
    check(
        isinstance(labels, list) and len(labels) in (0, len(y)),
        f"{here}: labels is {_short(labels)}; give as many words as values.",
    )
    # The one is asked of the mean size of the errors, the other of their mean with signs.
    tolerance = entry.get("tolerance")
    check(
        tolerance is None or "accepted" not in entry,
        f"{here}: both tolerance and accepted are given; give one of them.",
    )
    if tolerance is not None:
        accepted = (0.0, _number(f"{here}: tolerance", tolerance))
    else:
        accepted = _pair(
            here,
            entry,
            "accepted",
            default=(-math.inf, math.inf),
        )
    return Measured(
        quantity=quantity,
        y=y,
        unit=unit,
        x=x,
        x_unit=x_unit,
        x_range=x_range,
        labels=tuple(_words(f"{here}: labels", label) for label in labels),
        reference=reference,
        accepted=accepted,
        quick_accepted=_pair(here, entry, "quick_accepted", default=accepted),
        is_mean_of_sizes="accepted" not in entry,
        peer_error=_number(
            f"{here}: peer_error",
            entry.get("peer_error", math.nan),
            finite=False,
        ),
        kind=_line(here, entry, "kind", default=""),
        evidence=_evidence(here, entry, evidence),
        not_counted=_line(here, entry, "not_counted", default=""),
        not_converged=_line(here, entry, "not_converged", default=""),
    )


# ---- uncertainties -------------------------------------------------------------------------------


def _statement(where: str, data: Mapping[str, Any], tests: tuple[Test, ...]) -> Statement:
    """What the file states about uncertainty."""
    entries = data.get("uncertainties", [])
    check(
        isinstance(entries, list),
        f"{where}: uncertainties is {_short(entries)}; write [[uncertainties]].",
    )
    inputs = {name for test in tests for name in test.inputs.values}
    quantities = {one.quantity for test in tests for one in test.measured}
    found = tuple(_uncertainty(f"{where}, uncertainties", entry, tests) for entry in entries)
    exact = _mapping(where, data.get("exact", {}), "exact")
    unknown = {name for one in found for name in one.inputs} | set(exact)
    unknown = (unknown - inputs) | {one.quantity for one in found if not one.inputs} - quantities
    check(
        not unknown,
        f"{where}: {_short(min(unknown, default=''))} of [[uncertainties]] or [exact] is not an "
        "input or a measured quantity; correct the name.",
    )
    statement = Statement(
        uncertainties=found,
        exact={
            name: _words(f"{where}: reason of exact {name}", reason)
            for name, reason in exact.items()
        },
        finer={
            name: _number(f"{where}: finer {name}", number)
            for name, number in _mapping(where, data.get("finer", {}), "finer").items()
        },
    )
    for test in tests:
        names = [name for one in statement.of_inputs(test.name) for name in one.inputs]
        names += list(exact)
        repeated = {name for name in names if names.count(name) > 1}
        check(
            not repeated,
            f"{where}, test '{test.name}': '{min(repeated, default='')}' has several entries of "
            "[[uncertainties]] or [exact]; give one.",
        )
    return statement


def _uncertainty(where: str, data: Any, tests: tuple[Test, ...]) -> Uncertainty:
    """One entry of `uncertainties`."""
    entry = _mapping(where, data, "each")
    known = {"inputs", "quantity", "tests", "half_width", "standard", "kind", "source"}
    _check_keys(where, entry, known)
    check(
        ("inputs" in entry) != ("quantity" in entry),
        f"{where}: an entry has both or none of inputs and quantity; give one of them.",
    )
    inputs = entry.get("inputs", [])
    check(
        isinstance(inputs, list) and (len(inputs) > 0 or "quantity" in entry),
        f"{where}: inputs is {_short(inputs)}; give a list of names.",
    )
    names = tuple(_words(f"{where}: inputs", name) for name in inputs)
    quantity = _line(where, entry, "quantity", default="")
    here = f"{where}, '{quantity or ', '.join(names)}'"
    chosen = entry.get("tests", [])
    check(
        isinstance(chosen, list) and all(name in [one.name for one in tests] for name in chosen),
        f"{here}: tests is {_short(chosen)}; give names of tests.",
    )
    check(
        ("half_width" in entry) != ("standard" in entry),
        f"{here}: an entry has both or none of half_width and standard; give one of them.",
    )
    is_standard = "standard" in entry
    size = _mapping(here, entry["standard" if is_standard else "half_width"], "the number")
    _check_keys(here, size, {"value", "unit"})
    number = _number(here, size.get("value"))
    check(number > 0, f"{here}: the number is {number:g}; give one > 0, or an entry of [exact].")
    unit = size.get("unit")
    check(
        unit == RELATIVE or unit in UNITS,
        f"{here}: unit is {_short(unit)}; give '{RELATIVE}' or one of {', '.join(UNITS)}.",
    )
    kind = entry.get("kind")
    check(kind in KINDS, f"{here}: kind is {_short(kind)}; give one of {', '.join(KINDS)}.")
    return Uncertainty(
        inputs=names,
        quantity=quantity,
        tests=tuple(chosen),
        size=number,
        unit=str(unit),
        is_standard=is_standard,
        kind=str(kind),
        source=_line(here, entry, "source"),
    )


# ---- parts of a file -----------------------------------------------------------------------------


def _check_keys(where: str, data: Mapping[str, Any], known: set[str]) -> None:
    """A key with a typing error would otherwise have no effect."""
    unknown = sorted(set(data) - known)
    listed = ", ".join(sorted(known))
    check(not unknown, f"{where}: '{_short(unknown[:1])}' is unknown; the keys are {listed}.")


def _mapping(where: str, data: Any, name: str) -> Mapping[str, Any]:
    check(isinstance(data, dict), f"{where}: {name} is {_short(data)}; give a table of TOML.")
    return data


def _line(where: str, data: Mapping[str, Any], name: str, default: str | None = None) -> str:
    """One line of printable text."""
    if name not in data and default is not None:
        return default
    check(name in data, f"{where}: '{name}' is missing; add it.")
    return _words(f"{where}: {name}", data[name])


def _words(where: str, text: Any) -> str:
    """Printable text: control characters would act on a terminal."""
    is_line = isinstance(text, str) and text.isprintable() and 0 < len(text) <= MAX_LINE_LENGTH
    check(
        is_line,
        f"{where} is {_short(text)}; give one line of at most {MAX_LINE_LENGTH} letters.",
    )
    return str(text)


def _quantity(where: str, data: Any) -> tuple[Any, str]:
    """Value and unit of a table {value, unit}."""
    entry = _mapping(where, data, "it")
    _check_keys(where, entry, {"value", "unit"})
    check(
        {"value", "unit"} <= set(entry),
        f"{where} has no value or no unit; write {{value = ..., unit = ...}}.",
    )
    unit = _words(f"{where}: unit", entry["unit"])
    check(unit in UNITS, f"{where}: unit is '{unit}'; give one of {', '.join(UNITS)}.")
    return entry["value"], unit


def _finite(where: str, value: Any, dimensions: int) -> Array:
    """Finite numbers in an array of so many dimensions."""
    shape = ("one number", "a list of numbers", "a list of rows")[dimensions]
    # Rows of different lengths make no array.
    try:
        found = np.array(value)
        is_right = found.dtype.kind in "if" and found.ndim == dimensions
        is_right = is_right and bool(np.isfinite(found).all())
    except ValueError:
        is_right = False
    check(is_right, f"{where} is {_short(value)}; give {shape}, all finite.")
    return found.astype(float)


def _number(where: str, value: Any, *, finite: bool = True) -> float:
    # Truth values are whole numbers in Python, but not in TOML.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    check(
        is_number and (not finite or math.isfinite(value)),
        f"{where} is {_short(value)}; give a number.",
    )
    return float(value)


def _pair(
    where: str, data: Mapping[str, Any], name: str, default: tuple[float, float]
) -> tuple[float, float]:
    """Two rising numbers."""
    if name not in data:
        return default
    found = _finite(
        f"{where}: {name}",
        data[name],
        dimensions=1,
    )
    check(
        found.shape == (2,) and found[0] < found[1],
        f"{where}: {name} is {_short(data[name])}; give two rising numbers.",
    )
    return float(found[0]), float(found[1])


def _short(value: Any) -> str:
    """A value as a few printable letters."""
    text = repr(value)
    if len(text) > 60:
        text = text[:57] + "..."
    return text
