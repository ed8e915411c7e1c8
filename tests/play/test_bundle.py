"""Modules as one script."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gsvrcodec.play.bundle import bundle
from gsvrcodec.play.web import WEB
from tests.play.tools import write_pages

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="needs Node.js")


@pytest.fixture
def web(tmp_path: Path) -> Path:
    return write_pages(tmp_path / "web")


def modules(script: str) -> list[str]:
    """The modules of a bundle, in order."""
    return re.findall(r"^// ([\w-]+\.js)$", script, re.MULTILINE)


def result(script: str, *options: str) -> Any:
    """Run a script; return the value that it leaves in `globalThis.result`."""
    code = f"{script}\nconsole.log(JSON.stringify(globalThis.result));\n"
    run = subprocess.run(
        [str(NODE), *options, "-"], input=code, capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)


class TestOrder:
    def test_each_module_is_there_once_after_its_imports(self, web: Path) -> None:
        script = bundle("player.js", web)
        assert modules(script) == ["numbers.js", "text-and-more.js", "player.js"]
        assert modules(bundle("worker.js", web)) == ["numbers.js", "worker.js"]
        assert not re.search(r"^(import|export)\b", script, re.MULTILINE)

    def test_is_the_same_every_time(self, web: Path, tmp_path: Path) -> None:
        again = write_pages(tmp_path / "again")
        assert bundle("player.js", web) == bundle("player.js", again)

    @pytest.mark.parametrize(("importer", "path"), [("numbers", "numbers"), ("player", "player")])
    def test_a_circle_fails(self, web: Path, importer: str, path: str) -> None:
        text = (web / f"{importer}.js").read_text()
        (web / f"{importer}.js").write_text('import { shown } from "./text-and-more.js";\n' + text)
        (web / "text-and-more.js").write_text(f'import {{ x }} from "./{path}.js";\n')
        with pytest.raises(ValueError, match=rf"in a circle: .*{path}\.js$"):
            bundle("player.js", web)


class TestLanguage:
    @pytest.mark.parametrize(
        "line",
        [
            'import "./numbers.js";',
            'import * as numbers from "./numbers.js";',
            "import { double } from './numbers.js';",
            'import { double } from "numbers";',
            'import numbers from "./numbers.js";',
            'export { double } from "./numbers.js";',
            "export default 1;",
            "export let x = 1;",
        ],
    )
    def test_what_is_not_understood_fails(self, web: Path, line: str) -> None:
        (web / "player.js").write_text(f"{line}\n")
        with pytest.raises(ValueError, match=r"player\.js: cannot be bundled: ") as failure:
            bundle("player.js", web)
        assert line in str(failure.value)

    @pytest.mark.parametrize("name", ["halve", "double as twice"])
    def test_what_is_not_exported_fails(self, web: Path, name: str) -> None:
        (web / "player.js").write_text(f'import {{ TWO, {name} }} from "./numbers.js";\n')
        with pytest.raises(ValueError, match=rf"player\.js: numbers\.js does not export {name}"):
            bundle("player.js", web)

    @pytest.mark.parametrize("name", ["none.js", "..", "../player.js"])
    def test_a_missing_module_fails(self, web: Path, name: str) -> None:
        (web / "player.js").write_text(f'import {{ a }} from "./{name}";\n')
        with pytest.raises(ValueError, match=r"no such module|cannot be bundled"):
            bundle("player.js", web)


class TestMarkup:
    def test_nothing_ends_the_element_of_a_page(self, web: Path) -> None:
        script = bundle("player.js", web)
        assert not re.search(r"</script|<!--", script, re.IGNORECASE)
        assert script.count(r"\x3c") == 3

    @needs_node
    def test_strings_mean_the_same(self, web: Path) -> None:
        markup = ["</script>", "<!-- <script>", r"<\/SCRIPT>", "</Script"]
        for options in ([], ["--input-type=module"]):
            assert result(bundle("player.js", web), *options) == ["42 and 2", markup]
            assert result(bundle("worker.js", web), *options) == 8


class TestPackage:
    @pytest.mark.parametrize("entry", ["player.js", "worker.js"])
    def test_has_all_that_it_imports(self, entry: str) -> None:
        names = modules(bundle(entry, WEB))
        assert len(names) == len(set(names))
        assert names[-1] == entry

    @needs_node
    @pytest.mark.parametrize("entry", ["player.js", "worker.js"])
    def test_is_a_sound_script(self, entry: str, tmp_path: Path) -> None:
        script = tmp_path / "bundle.js"
        script.write_text(bundle(entry, WEB), "utf-8")
        subprocess.run([str(NODE), "--check", script], check=True)
