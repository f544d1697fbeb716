"""The commands of README and of the guides run in order, in one clean folder, as a reader's would.

A command is a line of a block of shell, a line that is indented as code, or code within a sentence.
What takes more than some ten seconds has quick arguments, in `QUICK`, or is run by `./gossamer test
-m slow tests/docs`.

Commands of the other pages and of the records of evidence stand for hours.  Of them,

- `demo NAME WORDS` runs until its first scene is made;
- `run` is compiled with `--dry-run`, and the tests that `test` names are collected (both slow);
- `study` and `validate` run in their quick form, without further words (slow, in
  `test_quick_forms.py`), and so do those of `bench` (`tests/unit/test_benchmarks.py`);
- full forms, `--store`, `--set` and what `tools/nightly.py` does are not run by a test: a record
  has the commit and the day of its run.

`tests/unit/test_site.py` parses the commands of all pages.
"""

from __future__ import annotations

import json
import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

import gossamer_fx as gx
from gossamer_fx.app.cli.demo import demos_of
from tests.hanging import HANG_TIMEOUT

ROOT = Path(gx.__file__).parent.parent
# Pages whose commands a reader types one after the other.
FIRST = ["install.md", "first_steps.md"]
GUIDES = [
    ROOT / "README.md",
    *(ROOT / "docs" / name for name in FIRST),
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
EVIDENCE = [
    path
    for path in sorted((ROOT / "docs").rglob("*.md"))
    if path not in GUIDES and path.name not in ("changelog.md", "contributing.md")
]
RECORDS = sorted((ROOT / "docs" / "evidence").glob("*.toml"))
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^ {4}(\./gossamer[^\n]*)$", re.MULTILINE)
INLINE = re.compile(r"`((?:\./)?gossamer [^`\n]*)`")
# Words that stand for one of the reader.
PLACEHOLDER = re.compile(r"[A-Z]{1,6}(\.\w+)?|\.\.\.|NAME=VALUE.*|folder/.*|scene\.py|FOLDER")
COMMANDS = ("run", "watch", "sweep", "plot", "report", "export", "demo", "doctor", "--help")
# Arguments with which a command of a guide takes seconds.
QUICK = {
    "watch demos/inflatables/pillow.py cells=12 --output out/watched": (
        "watch demos/inflatables/pillow.py cells=4 until=0.02 --output out/watched"
    ),
    "run demos/inflatables/pillow.py cells=12 --output out/exported": (
        "run demos/inflatables/pillow.py cells=4 until=0.02 --output out/exported"
    ),
    "demo pillow": "demo pillow",
    "run demos/inflatables/pillow.py cells=12 --output out/pillow_12": (
        "run demos/inflatables/pillow.py cells=4 until=0.02 --output out/pillow_12"
    ),
    "run demos/films/spinning_sheet.py n=8 until=0.05 --output out/sheet": (
        "run demos/films/spinning_sheet.py n=4 until=0.01 --output out/sheet"
    ),
    "sweep demos/inflatables/pillow.py --over cells=4,8 dt=1e-3,5e-4": (
        "sweep demos/inflatables/pillow.py until=0.004 --over cells=4,6 dt=1e-3,5e-4"
    ),
    "run demos/inflatables/inflate_tube.py cells=6 until=0.005 --output out/tube": (
        "run demos/inflatables/inflate_tube.py cells=6 until=0.002 --output out/tube"
    ),
}


def plain(words: str) -> str:
    """A command without comment, launcher and the end of a sentence."""
    without = re.sub(r"\s+#.*$", "", words).strip()
    return re.sub(r"^(\./)?gossamer\s*", "", without)


def commands_of(page: Path) -> list[str]:
    """The commands of a page without the launcher, in the order in which they stand."""
    text = page.read_text(encoding="utf-8")
    found: list[tuple[int, str]] = []
    blanked = text
    for block in BLOCK.finditer(text):
        blanked = blanked.replace(block[0], " " * len(block[0]), 1)
        if block[1] in ("sh", "bash", "console"):
            lines = block[2].replace("\\\n", " ").splitlines()
            found += [(block.start(), line) for line in lines if line.startswith("./gossamer")]
    for pattern in (INDENTED, INLINE):
        found += [(one.start(), one[1]) for one in pattern.finditer(blanked)]
    return [plain(words) for _, words in sorted(found, key=lambda one: one[0])]


def is_known(word: str) -> bool:
    """Whether a word is one that readers take as it is."""
    return not PLACEHOLDER.fullmatch(word)


def test_all_pages_are_read() -> None:
    """The blocks and sentences of the first pages, in their order."""
    assert commands_of(ROOT / "docs/first_steps.md")[:3] == [
        "demo pillow",
        "run demos/inflatables/pillow.py cells=12 --output out/pillow_12",
        "plot out/pillow_12",
    ]


# ---- the steps of the guides ---------------------------------------------------------------------


def guide_steps(is_slow: bool) -> Iterator[tuple[Path, str]]:
    """Page and command of the guides, in order, those that take seconds or the others."""
    for page in GUIDES:
        for command in commands_of(page):
            words = shlex.split(command)
            is_run = words[:1] and words[0] in COMMANDS and all(map(is_known, words))
            # Without arguments these have nothing to run.
            is_run = is_run and (len(words) > 1 or words[0] in ("doctor", "--help", "demo"))
            takes_long = words[:1] == ["demo"] and command not in QUICK
            takes_long |= words[:1] == ["run"] and command not in QUICK and words[1:2] != []
            takes_long &= not any(word.endswith("pulled.py") for word in words)
            if is_run and takes_long == is_slow:
                yield page, command


def provide_scene(page: Path, command: str, folder: Path) -> None:
    """Write the scene of a page to the file that a command names, as its reader does."""
    for word in shlex.split(command):
        path = folder / word
        if not word.endswith(".py") or path.exists() or word.startswith("demos/"):
            continue
        text = page.read_text(encoding="utf-8")
        scenes = [block[2] for block in BLOCK.finditer(text) if block[1] == "python"]
        [scene] = [one for one in scenes if re.search(r"^def build\(", one, re.MULTILINE)]
        path.write_text(scene, encoding="utf-8")


def run_command(command: str, folder: Path) -> str:
    """Run a command of a guide as a reader would; returns what it prints."""
    words = shlex.split(QUICK.get(command, command))
    environment = os.environ | {"PYTHONPATH": str(ROOT), "BROWSER": "true"}
    if words[0] == "watch":
        program = subprocess.Popen(
            [sys.executable, "-P", "-m", "gossamer_fx", *words],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert program.stdout is not None
        line = program.stdout.readline()
        address = re.search(r"http\S+", line)
        assert address is not None, line
        with urlopen(address[0]) as page:
            assert b"<canvas" in page.read()
        status = ""
        # A scene is computed to its end, so that later commands find its run.
        while not status.startswith("finished") and program.poll() is None:
            with urlopen(f"{address[0]}progress") as answer:
                status = json.loads(answer.read())["status"]
            time.sleep(0.1)
        program.send_signal(signal.SIGINT)
        program.wait(HANG_TIMEOUT)
        return line
    done = subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def run_in_order(steps: Iterator[tuple[Path, str]], folder: Path) -> list[str]:
    """Run commands one after the other, each once, in a folder that has what a clone has."""
    for name in ("demos", "tests", "tools", "gossamer_fx"):
        (folder / name).symlink_to(ROOT / name)
    done: list[str] = []
    for page, command in steps:
        if command in done:
            continue
        provide_scene(page, command, folder)
        run_command(command, folder)
        done.append(command)
    return done


alone = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="commands start programs",
)


# ---- the commands of evidence --------------------------------------------------------------------


def commands_in(record: Any) -> Iterator[str]:
    """The values of all keys "command" of a record."""
    if isinstance(record, list):
        for part in record:
            yield from commands_in(part)
    if isinstance(record, dict):
        for key, part in record.items():
            if key == "command":
                yield part
            else:
                yield from commands_in(part)


def evidence_commands(name: str) -> list[list[str]]:
    """Words after the name of a command, each once, on the pages and in the records of evidence."""
    found = [command for page in EVIDENCE for command in commands_of(page)]
    for path in RECORDS:
        record = tomllib.loads(path.read_text(encoding="utf-8"))
        found += [plain(words) for words in commands_in(record)]
    split = [shlex.split(command) for command in dict.fromkeys(found)]
    return [words[1:] for words in split if words[:1] == [name] and all(map(is_known, words))]


class Started(Exception):
    """A demo has taken its words, and makes its first scene."""


@pytest.mark.parametrize(
    "words", [one for one in evidence_commands("demo") if len(one) > 1], ids=" ".join
)
def test_demos_take_the_words_of_evidence(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*given: object, **named: object) -> None:
        raise Started

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.setattr(gx.Scene, "__init__", stop)
    monkeypatch.setattr(gx.sweep, "run_factorial", stop)
    program = demos_of(ROOT / "demos")[words[0]]
    # Others are refused before they start.
    assert "sys.argv" in program.read_text(encoding="utf-8")
    with pytest.raises(Started):
        runpy.run_path(str(program), run_name="__main__")


@alone
@pytest.mark.slow
def test_the_runs_of_evidence_are_compiled(tmp_path: Path) -> None:
    """Without their ranks, as the test may have one core."""
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    commands = evidence_commands("run")
    assert len(commands) > 10
    for words in commands:
        if "-n" in words:
            place = words.index("-n")
            words = words[:place] + words[place + 2 :]
        # A letter may stand for a number, and an option be named without a scene.
        if words[0].endswith(".py") and all(word.isascii() for word in words):
            run_command(shlex.join(["run", *words, "--dry-run"]), tmp_path)


@alone
@pytest.mark.slow
def test_the_tests_of_evidence_can_be_collected() -> None:
    for words in evidence_commands("test"):
        if not any(word.startswith("tests/") for word in words):
            continue
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "--collect-only", "-q", *words],
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{words}: {done.stdout[-500:]}"


# ---- in order, in a clean folder: the commands of guides -----------------------------------------


@alone
def test_the_commands_of_the_guides_run_in_order(tmp_path: Path) -> None:
    """Each finds what the ones before it have left."""
    done = run_in_order(guide_steps(is_slow=False), tmp_path)
    assert "report out/pillow_12" in done and "export out/exported" in done


@alone
@pytest.mark.slow
def test_the_long_commands_of_the_guides_run(tmp_path: Path) -> None:
    """Demos of the tutorials, and runs without quick arguments, which are only compiled."""

    def steps() -> Iterator[tuple[Path, str]]:
        for page, command in guide_steps(is_slow=True):
            is_run = command.startswith("run ")
            yield page, f"{command} --dry-run" if is_run else command

    assert run_in_order(steps(), tmp_path)
