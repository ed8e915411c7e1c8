"""A small player to put together, a server in a thread, and a client of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread

from gsvrcodec.play.collection import open_collection
from gsvrcodec.play.serve import FilmServer, open_server

VALID = Path(__file__).parent.parent / "vectors" / "valid"
FILM = VALID / "black.gsvr"

#: The player, as short as it can be.
PAGES = {
    "player.html": """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>Player</title>
<link rel="stylesheet" href="style.css">
<script type="module" src="player.js"></script>
</head>
<body></body>
</html>
""",
    "gallery.html": "<!doctype html>\n<title>Gallery</title>\n",
    "style.css": "body { color: #fff; }\n",
    "player.js": """// The page.
import { double } from "./numbers.js";
import {
  shown,
  MARKUP,
} from "./text-and-more.js";

globalThis.result = [shown(double(21)), MARKUP];
""",
    "worker.js": 'import { double } from "./numbers.js";\n\nglobalThis.result = double(4);\n',
    "numbers.js": """export const ONE = 1, TWO = 2;

export function double(x) {
  return TWO * x;
}
""",
    "text-and-more.js": """import { TWO } from "./numbers.js";

export const MARKUP = ["</script>", "<!-- <script>", /<\\/SCRIPT>/u.source, `</Script`];

export class Box {}

export async function later() {}

export function shown(x) {
  return `${x} and ${TWO}`;
}
""",
    "notes.txt": "not a part of the player\n",
}


def write_pages(directory: Path, **changed: str) -> Path:
    """Write the short player, some of its files changed, and return its directory."""
    directory.mkdir(exist_ok=True)
    for name, text in (PAGES | changed).items():
        (directory / name).write_text(text, "utf-8")
    return directory


@dataclass(frozen=True)
class Answer:
    """The answer of a server."""

    status: int
    headers: Mapping[str, str]
    content: bytes


@dataclass(frozen=True)
class Client:
    """Asks a server, by a connection of its own for every request."""

    server: FilmServer

    def __call__(self, path: str, *, method: str = "GET", **headers: str) -> Answer:
        """Ask for a path; underscores in names of headers stand for dashes."""
        with closing(self.connect()) as connection:
            spelled = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, headers=spelled)
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.headers), answer.read())

    def connect(self) -> HTTPConnection:
        """Connect to the server."""
        return HTTPConnection("127.0.0.1", self.server.server_address[1], timeout=20)


@contextmanager
def serving(path: Path, web: Path, *, host: str = "127.0.0.1") -> Iterator[Client]:
    """Serve a film or a directory from a thread."""
    with open_server(open_collection(path), host=host, port=0, web=web) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield Client(server)
        finally:
            server.shutdown()
            thread.join()
