"""What is written about the project holds: the README's example and options, pins, samples."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import click
import pytest

from gsvrcodec.cli import dec, enc, info, play, report
from gsvrcodec.encoder import tuned as encoder_tuned
from gsvrcodec.fit import recipe
from gsvrcodec.fit import tuned as fit_tuned
from tests import making

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text("utf-8")
#: Where constants are that were found by trying.
TUNED = (encoder_tuned, fit_tuned, recipe)
COMMANDS = {
    "gsvrenc": enc.command,
    "gsvrdec": dec.command,
    "gsvrinfo": info.command,
    "gsvrreport": report.command,
    "gsvrplay": play.command,
}


def blocks(language: str, page: str = "README.md") -> list[str]:
    """Return the code blocks of one language in a page."""
    text = (ROOT / page).read_text("utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def options(command: click.Command) -> set[str]:
    """Return every spelling of every option of a command."""
    spellings = [(*option.opts, *option.secondary_opts) for option in command.params]
    return {spelling for both in spellings for spelling in both} | {"--help"}


@pytest.mark.parametrize(
    ("page", "printed", "made"),
    [
        ("README.md", r"\(720, 1280, 3\)\ntorch.Size\(\[2, 8, 3, 128, 128\]\)", {"bunny.gsvr"}),
        pytest.param(
            "docs/python.md",
            r"320 180 24\n(.*\n)+epoch 1: 0\.\d+",
            {"bunny.gsvr", "bunny.mp4", "smooth.mp4"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_python_examples_run(page: str, printed: str, made: set[str], tmp_path: Path) -> None:
    """Those of one page are run one after another, as a reader would."""
    (tmp_path / "samples").symlink_to(making.SAMPLES)
    example = tmp_path / "example.py"
    lines = textwrap.indent("\n".join(blocks("python", page)), "    ")
    example.write_text(f"if __name__ == '__main__':\n{lines}")
    run = subprocess.run(
        [sys.executable, "-W", "error", example.name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stderr == ""
    assert re.search(printed, run.stdout), run.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"samples", "example.py", *made}


class TestReadme:
    """It is one page, whose figures were measured."""

    #: Without code, links and names.
    TEXT = re.sub(
        r"```(sh|python).*?```|`[^`\n]+`|\]\([^)]*\)|2D|C\+\+17|Python 3\.11|x26[45]|"
        r"SVT-AV1( preset 8)?|AV1|MP4|Y4M|Apache-2\.0|800\+ FPS|MM '25",
        "",
        README,
        flags=re.DOTALL,
    )

    def test_length(self) -> None:
        before, picture, _ = README.partition("![")
        assert picture
        assert len(before.split()) <= 60
        assert len(README.split()) <= 700

    def test_figures_come_from_the_data(self) -> None:
        """What is written by `tests.benchmarks.readme`, and code, aside."""
        written = re.sub(r"<!-- (\w+) -->.*?<!-- /\1 -->", "", self.TEXT, flags=re.DOTALL)
        assert re.findall(r"\d+", written) == ["8", "8"]  # bits a sample

    def test_it_is_not_a_table_of_figures(self) -> None:
        assert len(re.findall(r"\d[\d.,:]*", self.TEXT)) <= 40


def test_commands_parse() -> None:
    lines = re.split(r"&&|\n", "".join(blocks("sh")).replace("\\\n", " "))
    calls = [shlex.split(line) for line in lines if line.strip()]
    commands = [call for call in calls if call[0] in COMMANDS]
    assert len(commands) >= 3
    for name, *arguments in commands:
        COMMANDS[name].make_context(name, arguments)


def test_options_exist() -> None:
    known = set().union(*(options(command) for command in COMMANDS.values()))
    prose = re.sub(r"--extra-index-url|```.*?```", "", README, flags=re.DOTALL)
    guides = "".join((ROOT / "docs" / f"{name}.md").read_text("utf-8") for name in GUIDES)
    named = set(re.findall(r"`[^`\n]*?(--[a-z-]+)", prose + guides))
    assert len(named) > 30
    assert named <= known


GUIDES = ("encoding", "decoding", "player", "limits")
PAGES = [
    *(path.name for path in ROOT.glob("*.md")),
    *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
]


@pytest.mark.parametrize("page", PAGES)
def test_links_and_paths_exist(page: str) -> None:
    text = (ROOT / page).read_text("utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    paths = re.findall(r"`((?:gsvrcodec|spec|tests|samples)/[\w./]+)`", text)
    for link in links:
        assert ((ROOT / page).parent / link).exists(), link
    for path in paths:
        assert (ROOT / path).exists(), path


def test_the_tuning_table_names_constants() -> None:
    table = (ROOT / "docs" / "tuning.md").read_text("utf-8")
    named = re.findall(r"`([A-Z_]{3,})\.(\w+)`", table)
    assert len(named) > 30
    topics = {name: value for home in TUNED for name, value in vars(home).items()}
    for topic, constant in named:
        assert hasattr(topics[topic], constant), f"{topic}.{constant}"


def test_ci_finds_the_commands_of_the_readme() -> None:
    script = (ROOT / ".ci" / "run").read_text("utf-8")
    words = re.findall(r"readme (\w+)\)", script)
    assert words
    for word in words:
        assert any(word in block for block in blocks("sh")), word


def test_every_dependency_is_pinned_and_explained() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    wanted = [*project["build-system"]["requires"], *project["project"]["dependencies"]]
    for extra in project["project"]["optional-dependencies"].values():
        wanted += extra
    names = {re.split(r"[\[><=]", name)[0] for name in wanted} - {"gsvrcodec"}
    constraints = (ROOT / "constraints.txt").read_text("utf-8").lower().replace("_", "-")
    pinned = set(re.findall(r"^([\w-]+)==", constraints, re.MULTILINE))
    assert names <= pinned
    table = (ROOT / "CONTRIBUTING.md").read_text("utf-8").partition("## Dependencies")[2]
    assert names <= set(re.findall(r"[\w-]+", table))


def test_every_sample_is_attributed() -> None:
    page = (making.SAMPLES / "README.md").read_text("utf-8")
    clips = {path.name for path in making.SAMPLES.iterdir() if path.is_file()} - {"README.md"}
    assert clips == set(re.findall(r"^\| `([^`]+)`", page, re.MULTILINE))
