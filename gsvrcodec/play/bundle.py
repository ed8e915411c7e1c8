"""JavaScript modules that import each other, as one script that imports nothing.

Each module becomes a function that is called once and returns what others import from it. Of the
language, as much is understood as the modules of the player use: `import { a, b } from "./x.js";`,
also over several lines, and `export` before a function, a class or constants, with the names on the
same line; either begins its line, and no other line begins with one of the two words.
"""

from __future__ import annotations

import re
from importlib.resources.abc import Traversable

_IMPORT = re.compile(r'^import \{([\w$,\s]*)\} from "\./([\w.-]+)";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async function|function|class|const)\b)", re.MULTILINE)
_NOT_UNDERSTOOD = re.compile(r"^(?:import|export)\b.*$", re.MULTILINE)

#: Text that would end the script element around a script too early, or keep it open.
_MARKUP = re.compile(r"<(?=/script|!--)", re.IGNORECASE)


def bundle(entry: str, web: Traversable) -> str:
    """Return a module and all that it imports as one script, to stand inside a page.

    The script works as a module and as a classic script alike. Its bytes depend on those of the
    modules only.

    Args:
        entry: File name of the module.
        web: Directory of the modules.

    Raises:
        ValueError: A module is missing, imports itself by way of others or what is not exported,
            or is written in a way that is not understood.
    """
    modules: dict[str, str] = {}
    _gather(modules, entry, (), web)
    wanted = _wanted(modules)
    # Numbered, because not every file name makes a variable.
    variables = {name: f"module{number}" for number, name in enumerate(modules)}

    def constant(found: re.Match[str]) -> str:
        return f"const {{ {', '.join(_split(found[1]))} }} = {variables[found[2]]};"

    parts = ['"use strict";']
    for name, text in modules.items():
        body = _EXPORT.sub("", _IMPORT.sub(constant, text))
        if other := _NOT_UNDERSTOOD.search(body):
            raise ValueError(f"{name}: cannot be bundled: {other[0]}")
        exports = f"return {{ {', '.join(sorted(wanted[name]))} }};"
        parts.append(f"// {name}\nconst {variables[name]} = (() => {{\n{body}\n{exports}\n}})();")
    # In strings, templates and regular expressions, where alone this may stand, it means the same.
    return _MARKUP.sub(r"\\x3c", "\n".join([*parts, ""]))


def _gather(
    modules: dict[str, str], name: str, importers: tuple[str, ...], web: Traversable
) -> None:
    """Add the text of a module to `modules`, after those that it imports.

    Args:
        modules: Text by file name.
        name: File name of the module.
        importers: The modules that led here, from the entry on.
        web: Directory of the modules.
    """
    if name in modules:
        return
    path = (*importers, name)
    if name in importers:
        raise ValueError(f"modules import each other in a circle: {' > '.join(path)}")
    file = web.joinpath(name)
    if not file.is_file():
        raise ValueError(f"no such module: {' > '.join(path)}")
    text = file.read_text("utf-8")
    for found in _IMPORT.finditer(text):
        _gather(modules, found[2], path, web)
    modules[name] = text


def _wanted(modules: dict[str, str]) -> dict[str, set[str]]:
    """The names that others import from each module."""
    wanted: dict[str, set[str]] = {name: set() for name in modules}
    for name, text in modules.items():
        for names, imported in _IMPORT.findall(text):
            for each in _split(names):
                if not re.search(rf"^export .*\b{re.escape(each)}\b", modules[imported], re.M):
                    raise ValueError(f"{name}: {imported} does not export {each}")
                wanted[imported].add(each)
    return wanted


def _split(names: str) -> list[str]:
    """The names between the braces of an import."""
    return [name for each in names.split(",") if (name := each.strip())]
