"""Writes spec/api.md from signatures, docstrings and comments: `python -m tests.api_page`."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

import gsvrcodec
from gsvrcodec import errors
from gsvrcodec.decoder.export import DecodeResult
from gsvrcodec.encoder.progress import Progress
from gsvrcodec.encoder.results import EncodeResult, GopStats
from gsvrcodec.encoder.settings import EncodeSettings

PAGE = Path(__file__).parent.parent / "spec" / "api.md"

_INTRODUCTION = """\
# The Python package

`import gsvrcodec` is quick: each public name is imported at its first use. What is not on this
page may change without a word. `python -m tests.api_page` writes the page from the docstrings.
"""

#: Chapters: title, and what is in each.
_CHAPTERS: tuple[tuple[str, tuple[Any, ...]], ...] = (
    (
        "Encode",
        (gsvrcodec.encode, EncodeSettings, EncodeResult, GopStats, Progress, gsvrcodec.Cluster),
    ),
    (
        "Decode",
        (
            *(gsvrcodec.open, gsvrcodec.Decoder, gsvrcodec.Frame, gsvrcodec.FrameBatch),
            *(gsvrcodec.Metadata, gsvrcodec.Limits, gsvrcodec.decode, DecodeResult),
        ),
    ),
    ("Train", (gsvrcodec.ClipDataset,)),
    (
        "Errors",
        tuple(
            each
            for each in vars(errors).values()
            if inspect.isclass(each) and issubclass(each, errors.GsvrError)
        ),
    ),
)

#: Types that signatures name, and their modules.
_TYPES = {
    "VideoSource": "gsvrcodec.video.spool",
    "Readable": "gsvrcodec.bitstream.source",
    "RequestedSize": "gsvrcodec.decoder.pictures",
    "Codes": "gsvrcodec.render.backend",
    "Layers": "gsvrcodec.model.layers",
    "Policy": "gsvrcodec.dataset",
    "Preset": "gsvrcodec.encoder.settings",
    "Pack": "gsvrcodec.encoder.settings",
    "Profile": "gsvrcodec.fit.recipe",
    "Deform": "gsvrcodec.fit.recipe",
    "Flow": "gsvrcodec.fit.recipe",
}

#: Special methods that are part of what a class is used by, and how.
_SPECIAL = {"__len__": "len({0})", "__getitem__": "{0}[{1}]", "__iter__": "iter({0})"}

#: What is public for other packages of ours.
_HIDDEN = re.compile(
    r"EncodeSettings\..*|Limits\.check.*|Metadata\.(of|extended|span|ticks|shown)|\w+\._(?!_init__).*"
)

_ITEM = re.compile(r"(\*{0,2}[\w, ]+): (.*)", re.DOTALL)
_FIELD = re.compile(r" {4}(\w+: [^#]*?)\s*(?:#: (.*))?")
_WIDTH = 96


def page() -> str:
    """Return the page."""
    parts = [_INTRODUCTION]
    for title, members in _CHAPTERS:
        parts.append(f"## {title}\n")
        for member in members:
            parts += _member(member)
        parts.append("")
    parts.append("## Types\n")
    parts += (_alias(name, module) for name, module in _TYPES.items())
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)) + "\n"


def _member(member: Any) -> Iterator[str]:
    """Yield the paragraphs of a function or a class."""
    node = ast.parse(inspect.getsource(member)).body[0]
    assert isinstance(node, ast.FunctionDef | ast.ClassDef)
    if inspect.isclass(member) and issubclass(member, errors.GsvrError):
        yield _error(member, ast.get_docstring(node) or "")
        return
    home = "gsvrcodec" if member.__name__ in gsvrcodec.__all__ else member.__module__
    yield f"### `{home}.{member.__name__}`\n"
    if isinstance(node, ast.FunctionDef):
        yield _code(_call(member.__name__, node))
        yield _prose(ast.get_docstring(node))
        return
    yield _prose(ast.get_docstring(node))
    methods = [
        each
        for each in node.body
        if isinstance(each, ast.FunctionDef)
        and (each.name in _SPECIAL or not _HIDDEN.fullmatch(f"{node.name}.{each.name}"))
        and "overload" not in _decorators(each)
    ]
    short = [*_fields(inspect.getsource(member)), *filter(None, map(_short, methods))]
    for method in methods:
        if method.name == "__init__" and "Args:" in (ast.get_docstring(method) or ""):
            yield _code(_call(node.name, method, returns=False))
            yield _prose(ast.get_docstring(method))
    if short:
        yield "\n".join(short) + "\n"
    for method in methods:
        if method.name != "__init__" and _short(method) is None:
            yield f"#### `{node.name}.{method.name}`\n"
            yield _code(_call(method.name, method))
            yield _prose(ast.get_docstring(method))


def _error(member: type[errors.GsvrError], docstring: str) -> str:
    """Return the entry of an error, with its attributes."""
    above = ", ".join(f"`{base.__name__}`" for base in member.__bases__)
    text, _, arguments = docstring.partition("\n\nArgs:\n")
    entry = f"* `{member.__name__}` ({above}; exit code {member.exit_code}): {_joined(text)}"
    inner = _items(textwrap.dedent(arguments)) if arguments else ()
    return "\n".join([entry, *(f"  {item}" for item in inner)])


def _short(node: ast.FunctionDef) -> str | None:
    """Return the line of a property or a special method; None = it is another method."""
    text = _joined(ast.get_docstring(node) or "")
    if node.name in _SPECIAL:
        return f"* `{_SPECIAL[node.name].format('...', ', '.join(_arguments(node)))}`: {text}"
    if "property" in _decorators(node):
        return f"* `{node.name}: {_source(node.returns)}`: {text}"
    return None


def _decorators(node: ast.FunctionDef) -> list[str]:
    return [ast.unparse(each) for each in node.decorator_list]


def _call(name: str, node: ast.FunctionDef, *, returns: bool = True) -> str:
    """Return a signature, an argument a line if it is long."""
    arguments = _arguments(node)
    end = f" -> {_source(node.returns)}" if returns else ""
    line = f"{name}({', '.join(arguments)}){end}"
    if len(line) <= _WIDTH:
        return line
    lines = "".join(f"    {argument},\n" for argument in arguments)
    return f"{name}(\n{lines}){end}"


def _arguments(node: ast.FunctionDef) -> list[str]:
    """Return the arguments of a function but `self`, with types and defaults."""
    given = node.args
    positional = [*given.posonlyargs, *given.args]
    defaults = [None] * (len(positional) - len(given.defaults)) + list(given.defaults)
    found = [
        _argument(each, default)
        for each, default in zip(positional, defaults, strict=True)
        if each.arg not in ("self", "cls")
    ]
    if given.kwonlyargs:
        found.append("*")
        pairs = zip(given.kwonlyargs, given.kw_defaults, strict=True)
        found += [_argument(each, default) for each, default in pairs]
    if given.kwarg:
        found.append(f"**{_argument(given.kwarg, None)}")
    return found


def _argument(node: ast.arg, default: ast.expr | None) -> str:
    kind = f": {_source(node.annotation)}" if node.annotation else ""
    return f"{node.arg}{kind}" + (f" = {_source(default)}" if default else "")


def _source(node: ast.expr | None) -> str:
    return "" if node is None else ast.unparse(node).replace("'", '"')


def _fields(source: str) -> Iterator[str]:
    """Yield the fields of a dataclass with their comments, "#:" behind a field or above it."""
    above: list[str] = []
    body = takewhile(lambda line: not re.match(r" {4}(def |@)", line), source.splitlines())
    for line in body:
        if line.startswith("    #: "):
            above.append(line.removeprefix("    #: "))
        elif (match := _FIELD.fullmatch(line)) and match[1]:
            comment = " ".join([*above, *filter(None, [match[2]])])
            declared = re.sub(r"field\(default=(\w+).*\)", r"\1", match[1].replace("builtins.", ""))
            yield f"* `{declared}`" + (f": {comment}" if comment else "")
            above = []


def _prose(docstring: str | None) -> str:
    """Return a docstring as Markdown; arguments and errors become lists."""
    lines = []
    for block in (docstring or "").split("\n\n"):
        title, _, rest = block.partition("\n")
        if title.endswith(":") and rest.startswith("    "):
            lines.append(f"{'Arguments' if title == 'Args:' else title[:-1]}:\n")
            inner = textwrap.dedent(rest)
            lines.append(_joined(inner) if title == "Returns:" else "\n".join(_items(inner)))
            lines[-1] += "\n"
        elif block.startswith("    "):
            lines.append(_code(textwrap.dedent(block)))
        else:
            lines.append(block.replace("\n", " ") + "\n")
    return "\n".join(lines)


def _items(text: str) -> Iterator[str]:
    """Yield the items of a section, with lists in them one level deeper."""
    for item in re.split(r"\n(?! )", text):
        match = _ITEM.fullmatch(item)
        head, rest = (f"`{match[1]}`: ", match[2]) if match else ("", item)
        first, *inner = re.split(r"\n *\* ", rest)
        yield f"* {head}{_joined(first)}"
        yield from (f"  * {_joined(each)}" for each in inner)


def _joined(text: str) -> str:
    return re.sub(r"\s*\n\s*", " ", text)


def _code(text: str) -> str:
    return f"```python\n{text}\n```\n"


def _alias(name: str, module: str) -> str:
    """Return the entry of a type that has a name."""
    source = inspect.getsource(importlib.import_module(module))
    match = re.search(
        rf"((?:^#:.*\n)*)^{name} = (.*?(?:\[\n.*?^\])?)(?:  #: (.*))?$", source, re.MULTILINE
    )
    assert match, name
    comment = _joined(re.sub(r"^#: ", "", match[1], flags=re.MULTILINE)).strip() or match[3] or ""
    return f"* `{name} = {match[2]}`" + (f": {comment}" if comment else "")


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
