"""What the repository says of itself agrees: metadata, citation, hooks, guide for contributors."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_citation_is_of_this_version_and_licence() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["cff-version"] == "1.2.0"
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])
    assert [a["name"] for a in citation["authors"]] == [a["name"] for a in PROJECT["authors"]]
    assert citation["keywords"] == PROJECT["keywords"]
    released = f"## [{citation['version']}] - {citation['date-released']}"
    assert released in (ROOT / "CHANGELOG.md").read_text().splitlines()


def test_the_classifiers_name_pythons_that_are_asked_for() -> None:
    wanted = SpecifierSet(PROJECT["requires-python"])
    told = [re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", c) for c in PROJECT["classifiers"]]
    versions = [match[1] for match in told if match]
    assert versions and all(wanted.contains(version) for version in versions)


def test_the_hooks_fetch_nothing_and_run_what_the_environment_has() -> None:
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    hooks = [hook for repo in config["repos"] for hook in repo["hooks"]]
    assert all(repo["repo"] == "local" for repo in config["repos"])
    assert all(hook["language"] == "system" for hook in hooks)
    needed = {Requirement(r).name for r in PROJECT["optional-dependencies"]["dev"]}
    for hook in hooks:
        program, *words = hook["entry"].split()
        if program == "python":
            assert words[0] == "-m" and words[1] in needed, hook["id"]
        else:
            assert shutil.which(program), hook["id"]


def test_the_hook_of_large_files_names_them(tmp_path: Path) -> None:
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    entry = next(h["entry"] for repo in config["repos"] for h in repo["hooks"] if h["id"] == "large-files")
    small, large = tmp_path / "a small file", tmp_path / "a large file"
    small.write_bytes(bytes(1_000_000))
    large.write_bytes(bytes(1_000_001))
    for files, code in (([small], 0), ([large, small], 1)):
        quoted = " ".join(f"'{file}'" for file in files)
        done = subprocess.run(["sh", "-c", f"{entry} {quoted}"], capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert (str(large) in done.stdout) == (large in files) and str(small) not in done.stdout


def test_the_guide_names_files_that_are_there() -> None:
    guide = (ROOT / "CONTRIBUTING.md").read_text()
    paths = {p for p in re.findall(r"[\w./-]+\.(?:py|md|toml)\b", guide) if not p.startswith("test_")}
    assert "tests/repository/test_floors.py" in paths
    assert not [p for p in paths if not (ROOT / p).is_file()]
