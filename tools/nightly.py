"""Checks that take too long for each change: ./gossamer python tools/nightly.py [jitter|mutants].

    jitter     quick forms of studies from starts that are moved by 1e-6 of the size of the scene,
               ten times each: none may end by an error or hang; how many have figures that differ
               from the stored ones is said.  The whole output of each run that does not end well
               is in out/nightly
    mutants    the code of laws, contact and gas with one small error at a time: at least 85 % of a
               sample must fail a test; those that do not are compared with tools/survivors.json.
               Only those files of tests are run that call the function with the error: the others
               cannot find it

Without a word both are run.  The exit code is 0 if all holds, else 1.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from packages import ROOT
from run_tests import AS_A_RANK

SURVIVORS = ROOT / "tools" / "survivors.json"

# Folder of the outputs of runs that do not end well, one file each.
OUTPUTS = ROOT / "out" / "nightly"

# Share of the mutants that tests have to find.
LEAST_FOUND = 0.85

# Time [s] after which a study hangs.
LONGEST = 600

# A file of tests hangs after this time [s], and this many times its time without an error:
# compilers and other programs of a busy computer need time, too.
LONGEST_START = 60
LONGEST_RATIO = 5

# Time [s] for a run that hangs to end itself.
PATIENCE = 10

# Letters of a word of a file's name by which tests of the file are recognised.
MIN_WORD = 4

# Files of each part, and the tests that are to find errors in them.
PARTS = {
    "laws": (
        "gossamer_fx/mechanics/materials",
        (
            "tests/unit/test_materials.py",
            "tests/unit/test_orthotropic.py",
            "tests/unit/test_law_kernel.py",
            "tests/unit/test_step_means.py",
            "tests/unit/test_elastica.py",
            "tests/statics/test_rubber.py",
            "tests/statics/test_orthotropic_plates.py",
            "tests/statics/test_cauchy_stress.py",
            "tests/statics/test_thermal_expansion.py",
            "tests/bodies/test_fabric.py",
            "tests/statics/test_elastica_law.py",
            "tests/statics/test_orthotropic_panels.py",
            "tests/statics/test_wrinkle_maps.py",
            "tests/statics/test_wrinkled_films.py",
            "tests/conservation/test_orthotropic_films.py",
        ),
    ),
    "contact": (
        "gossamer_fx/mechanics/contact",
        (
            "tests/contact",
            "tests/statics/test_contact_at_rest.py",
            "tests/unit/test_solids_seen.py",
        ),
    ),
    "gas": (
        "gossamer_fx/mechanics/gas",
        (
            "tests/unit/test_gas.py",
            "tests/unit/test_gas_openings.py",
            "tests/unit/test_gas_sources.py",
            "tests/unit/test_gas_mixtures.py",
            "tests/unit/test_gas_coupling.py",
            "tests/unit/test_film_heat.py",
            "tests/unit/test_mesh_orientation.py",
            "tests/bodies/test_sewn_chambers.py",
            "tests/convergence/test_balloon.py",
            "tests/convergence/test_ideal_gas.py",
            "tests/statics/test_gas_at_rest.py",
            "tests/statics/test_paths_with_gas.py",
            "tests/conservation/test_compartments.py",
            "tests/conservation/test_gradients_with_gas.py",
        ),
    ),
}

OTHER_OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


# ---- mutants -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Mutant:
    """One small error: the file below the root, the function, number and text of the line, the
    expression before and after, and the whole file with it."""

    path: str
    function: str
    line: int
    source: str
    before: str
    after: str
    text: str

    @property
    def key(self) -> str:
        return f"{self.path}: {self.source}: {self.before} -> {self.after}"


def mutant_of(path: Path, number: int) -> Mutant:
    """One mutant of a Python file: an operator or comparison that is another one, or a number that
    is larger by one.  Docstrings, annotations, messages and checks of arguments stay."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    function, node = list(_places(tree))[number]
    before = ast.unparse(node)
    _change(node)
    return Mutant(
        path=str(path.relative_to(ROOT)),
        function=function,
        line=node.lineno,
        source=text.splitlines()[node.lineno - 1].strip(),
        before=before,
        after=ast.unparse(node),
        text=ast.unparse(tree),
    )


def _places(tree: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Names of functions, and expressions of their bodies that can be changed."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        skipped: set[int] = set()
        for statement in function.body:
            for node in ast.walk(statement):
                if id(node) in skipped:
                    continue
                is_check = isinstance(node, ast.Call) and ast.unparse(node.func).startswith("check")
                if is_check or isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef):
                    skipped.update(id(inner) for inner in ast.walk(node))
                    continue
                if isinstance(node, ast.AnnAssign):
                    skipped.update(id(inner) for inner in ast.walk(node.annotation))
                if _can_change(node):
                    yield function.name, node


def _can_change(node: ast.AST) -> TypeGuard[ast.expr]:
    """Whether `_change` knows an error in a node."""
    if isinstance(node, ast.BinOp):
        return type(node.op) in OTHER_OPERATORS
    if isinstance(node, ast.Compare):
        return type(node.ops[0]) in OTHER_OPERATORS
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    return isinstance(node, ast.BoolOp)


def _change(node: ast.expr) -> None:
    """Make a small error in an expression."""
    # The types of operators do not matter: each kind has others of its kind only.
    changed: Any = node
    if isinstance(node, ast.BinOp | ast.BoolOp):
        changed.op = OTHER_OPERATORS[type(node.op)]()
    elif isinstance(node, ast.Compare):
        changed.ops[0] = OTHER_OPERATORS[type(node.ops[0])]()
    elif isinstance(node, ast.Constant):
        changed.value = changed.value + 1


def sample(part: str, count: int, seed: int) -> list[Mutant]:
    """Some mutants of a part, each of all its mutants with the same chance."""
    folder, _ = PARTS[part]
    chosen = random.Random(seed)
    files = sorted((ROOT / folder).rglob("*.py"))
    places = []
    for path in files:
        number = sum(1 for _ in _places(ast.parse(path.read_text(encoding="utf-8"))))
        places += [(path, k) for k in range(number)]
    return [mutant_of(path, k) for path, k in chosen.sample(places, min(count, len(places)))]


# A file of tests, which notes the functions of a folder that it calls.
NOTING = """
import json, sys
import pytest

folder, out, *words = sys.argv[1:]
called = set()
monitoring = sys.monitoring

def note(code, offset):
    if code.co_filename.startswith(folder):
        called.add((code.co_filename[len(folder):], code.co_name))
    return monitoring.DISABLE

monitoring.use_tool_id(monitoring.COVERAGE_ID, "nightly")
monitoring.register_callback(monitoring.COVERAGE_ID, monitoring.events.PY_START, note)
monitoring.set_events(monitoring.COVERAGE_ID, monitoring.events.PY_START)
code = pytest.main(words)
with open(out, "w") as file:
    json.dump(sorted(called), file)
sys.exit(code)
"""

PYTEST_WORDS = ("-x", "-q", "-m", "not slow")


@dataclass(frozen=True)
class TestFile:
    """A file of tests without any error: its path below the root, the time [s] that it takes, and
    the functions that it calls, as pairs of a file and a name."""

    path: str
    seconds: float
    called: frozenset[tuple[str, str]]


def files_of(tests: Sequence[str]) -> list[str]:
    """The files of some tests and folders of tests."""
    files: list[Path] = []
    for name in tests:
        given = ROOT / name
        files += sorted(given.rglob("test_*.py")) if given.is_dir() else [given]
    return [str(path.relative_to(ROOT)) for path in files]


def run_unchanged(tree: Path, path: str) -> TestFile | None:
    """Run a file of tests in a copy of the project; None if a test fails."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "called.json"
        command = [sys.executable, "-c", NOTING, f"{tree}/", str(out), *PYTEST_WORDS, path]
        if _fails(tree, command):
            return None
        called = frozenset((file, name) for file, name in json.loads(out.read_text()))
    return TestFile(path, time.monotonic() - started, called)


def nearest_first(mutant: Mutant, files: Sequence[TestFile]) -> list[TestFile]:
    """The files of tests that call the function of a mutant: first those whose name has a word of
    the name of its file, which are likely to find it, then those that take less time."""
    words = [word for word in Path(mutant.path).stem.split("_") if len(word) >= MIN_WORD]

    def order(file: TestFile) -> tuple[bool, float]:
        is_far = not any(word.rstrip("s") in Path(file.path).stem for word in words)
        return is_far, file.seconds

    callers = [file for file in files if (mutant.path, mutant.function) in file.called]
    return sorted(callers, key=order)


def is_found(mutant: Mutant, tree: Path, files: Sequence[TestFile]) -> bool:
    """Whether a test in a copy of the project fails with a mutant: on one rank, or one that is
    marked mpi on two, as of `./gossamer test`.  One that hangs counts as found."""
    callers = nearest_first(mutant, files)
    marked = [file for file in callers if "mark.mpi" in (tree / file.path).read_text("utf-8")]
    target = tree / mutant.path
    original = target.read_text(encoding="utf-8")
    target.write_text(mutant.text, encoding="utf-8")
    try:
        for file in callers:
            command = [sys.executable, "-m", "pytest", *PYTEST_WORDS, file.path]
            longest = LONGEST_START + LONGEST_RATIO * file.seconds
            if _fails(tree, command, longest):
                return True
        if not marked:
            return False
        command = ["mpirun", "-n", "2", sys.executable, "tools/run_tests.py", AS_A_RANK]
        command += ["-x", "-q", "-m", "mpi and not slow", *(file.path for file in marked)]
        longest = LONGEST_START + LONGEST_RATIO * sum(file.seconds for file in marked)
        return _fails(tree, command, longest)
    finally:
        target.write_text(original, encoding="utf-8")


def _fails(tree: Path, command: Sequence[str], longest: float = math.inf) -> bool:
    """Whether a command on the code of a copy of the project fails, or does not end within a time
    [s]."""
    # The copy comes first, whatever the environment adds to the path.
    environment = dict(os.environ, PYTHONPATH=f"{tree}:{os.environ.get('PYTHONPATH', '')}")
    limit = None if math.isinf(longest) else longest
    with subprocess.Popen(
        command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        try:
            return process.wait(limit) != 0
        except subprocess.TimeoutExpired:
            # mpirun ends its ranks if it is asked to, but leaves them behind if it is killed.
            process.terminate()
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
            return True


def run_mutants(parts: Sequence[str], count: int, seed: int) -> bool:
    """Try a sample of mutants of each part; returns whether enough were found, and no survivor is
    new."""
    # Of each part the survivors by their keys, with the reason for which each is left.
    known = json.loads(SURVIVORS.read_text(encoding="utf-8"))
    all_well = True
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "project"
        shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns(".git", "out"))
        for part in parts:
            files = []
            for path in files_of(PARTS[part][1]):
                file = run_unchanged(tree, path)
                if file is None:
                    # Tests that fail without any mutant would find all of them.
                    print(f"{part}: {path} fails without any mutant", flush=True)
                    all_well = False
                else:
                    files.append(file)
            survivors = []
            tried = sample(part, count, seed)
            for mutant in tried:
                found = is_found(mutant, tree, files)
                words = "found" if found else "NOT FOUND"
                print(f"{part}: line {mutant.line} of {mutant.key}: {words}", flush=True)
                if not found:
                    survivors.append(mutant.key)
            rate = 1 - len(survivors) / len(tried)
            low, high = interval(len(tried) - len(survivors), len(tried))
            print(
                f"{part}: {rate:.0%} of {len(tried)} mutants found "
                f"(95 % interval {low:.0%} to {high:.0%})",
                flush=True,
            )
            new = sorted(set(survivors) - set(known.get(part, ())))
            for key in new:
                print(f"{part}: not in {SURVIVORS.name}: {key}", flush=True)
            all_well = all_well and rate >= LEAST_FOUND and not new
    return all_well


def interval(hits: int, tries: int) -> tuple[float, float]:
    """Wilson's interval of 95 % for a rate of which some tries are known."""
    z = 1.96
    rate = hits / tries
    middle = (rate + z**2 / (2 * tries)) / (1 + z**2 / tries)
    half = z / (1 + z**2 / tries) * math.sqrt(rate * (1 - rate) / tries + z**2 / (4 * tries**2))
    return max(middle - half, 0.0), min(middle + half, 1.0)


# ---- jitter --------------------------------------------------------------------------------------

# Move of each free coordinate over the size of the scene.
JITTER = 1e-6

# A study in this process, whose scenes start from moved nodes.
JITTERED = """
import sys
import numpy as np
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.steppers.history import MOTION, History

seed, name, out = int(sys.argv[1]), sys.argv[2], sys.argv[3]
generator = np.random.default_rng(seed)
compile_scene = Scene.compile

def compile_jittered(self, *args, **options):
    system = compile_scene(self, *args, **options)
    if system.equations.constraints is None and not system.equations.active_sets:
        size = system.unknowns.initial.extent()
        noise = {JITTER} * size * generator.uniform(-1, 1, len(system.unknowns.q0.array_r))
        noise[system.unknowns.supports.held] = 0.0
        history = History(system)
        history.restore(history.save(MOTION).moved_by(noise))
        for scalars in system.equations.scalar_unknowns:
            scalars.start()
    return system

Scene.compile = compile_jittered
from demos.studies.__main__ import main
sys.exit(main([name, "--quick", "--out", out]))
"""


def run_from_moved_start(script: str, name: str, seed: int) -> tuple[str, str]:
    """Verdict and whole output of the quick form of a study, run by a script in a process of its
    own."""
    with tempfile.TemporaryDirectory() as out:
        try:
            ended = subprocess.run(
                [sys.executable, "-c", script, str(seed), name, out],
                cwd=ROOT,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=LONGEST,
                check=False,
            )
        except subprocess.TimeoutExpired as stopped:
            # The output of a process that is stopped is bytes, whatever was asked for.
            output = (stopped.stdout or b"").decode(errors="replace")
            return f"HANGS for {LONGEST} s", output
    if ended.returncode == 0:
        return "well", ended.stdout
    if "Traceback (most recent call last)" in ended.stdout:
        return "FAILED", ended.stdout
    return "other figures", ended.stdout


def store(name: str, output: str) -> Path:
    """Write the output of a run into a file; returns its path."""
    OUTPUTS.mkdir(parents=True, exist_ok=True)
    path = OUTPUTS / f"{name}.txt"
    path.write_text(output, encoding="utf-8")
    return path


def run_jitter(names: Sequence[str], times: int, first: int) -> bool:
    """Run quick forms of studies from moved starts, whose random numbers have the seeds from
    `first` on; returns whether none ended by an error or hung.
    Prints the rate with the upper bound of its 95 % interval, and how many have other figures: a
    figure that is round-off, exact, or measured from the start differs from a start that is moved.
    """
    studies = sorted(path.stem for path in (ROOT / "demos/studies").glob("*.py"))
    chosen = names or [name for name in studies if not name.startswith("_")]
    script = JITTERED.replace("{JITTER}", repr(JITTER))
    failures = []
    differences = []
    tries = 0
    # All studies once, then all once more: a run that is cut short has tried each of them.
    for seed in range(first, first + times):
        for name in chosen:
            tries += 1
            verdict, output = run_from_moved_start(script, name, seed)
            print(f"jitter: {name}, start {seed}: {verdict}", flush=True)
            if verdict == "well":
                continue
            if verdict == "other figures":
                differences.append(name)
            else:
                failures.append(name)
            print(f"  output in {store(f'jitter_{name}_{seed}', output)}", flush=True)
    _, high = interval(len(failures), tries)
    print(
        f"jitter: {len(failures)} of {tries} runs failed; at most {high:.1%} with 95 %; "
        f"{len(differences)} had other figures: {', '.join(sorted(set(differences)))}",
        flush=True,
    )
    return not failures


def main(words: Sequence[str]) -> int:
    """Run what the words ask for; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="?", choices=("jitter", "mutants"))
    parser.add_argument("names", nargs="*", help="studies, or parts of the code")
    parser.add_argument("--times", type=int, default=10, help="starts of each study")
    parser.add_argument("--count", type=int, default=40, help="mutants of each part")
    parser.add_argument("--seed", type=int, default=0, help="of the sample, or of the first start")
    options = parser.parse_args(words)
    is_well = True
    if options.what in (None, "jitter"):
        is_well = run_jitter(options.names if options.what else (), options.times, options.seed)
    if options.what in (None, "mutants"):
        parts = options.names if options.what and options.names else list(PARTS)
        is_well = run_mutants(parts, options.count, options.seed) and is_well
    return int(not is_well)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
