"""Files that describe the project for indexes, archives and package managers say the same as
pyproject.toml."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import gossamer_fx as gx

ROOT = Path(gx.__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
SPACK = (ROOT / "packaging" / "spack" / "package.py").read_text(encoding="utf-8")


def test_codemeta_and_zenodo_have_the_version_and_the_licence() -> None:
    codemeta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert codemeta["version"] == gx.__version__
    assert codemeta["license"].endswith(PROJECT["license"])
    assert zenodo["license"] == PROJECT["license"]
    assert set(zenodo["keywords"]) <= {*PROJECT["keywords"], *codemeta["keywords"]}


def test_recipes_require_what_pip_requires() -> None:
    for requirement in PROJECT["dependencies"]:
        name = re.split(r"[<>=! ]", requirement)[0]
        assert re.search(rf"^    - {name}\b", CONDA, re.MULTILINE), name
        assert f'"py-{name.replace("_", "-")}"' in SPACK, name
    assert f'version: "{gx.__version__}"' in CONDA


def test_recipes_and_wheels_take_the_same_versions_of_dolfinx_and_python() -> None:
    compatible = (ROOT / "docs" / "compatibility.md").read_text(encoding="utf-8")
    assert "0.9 (Debian 13" in compatible and "0.11 (PyPI" in compatible
    assert "fenics-dolfinx >=0.9,<0.12" in CONDA and "dolfinx@0.9:0.11" in SPACK
    lowest = PROJECT["requires-python"].removeprefix(">=")
    assert f"python >={lowest}" in CONDA and f'"python@{lowest}:"' in SPACK


def test_the_paper_has_the_length_of_its_journal_and_cites_what_it_lists() -> None:
    """The Journal of Open Source Software asks for 750 to 1750 words, and here at most 1000."""
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    body = paper[paper.index("# Summary") : paper.index("# References")]
    assert 750 <= len(body.split()) <= 1000
    listed = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.M))
    assert set(re.findall(r"@(\w+)", body)) == listed
    for picture in re.findall(r"\]\((\S+\.png)\)", body):
        assert (ROOT / "paper" / picture).is_file()
