"""The server of the player: pages, a list of films, and films by byte ranges (RFC 9110)."""

from __future__ import annotations

import errno
import gzip
import json
import logging
import os
import re
import socket
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources.abc import Traversable
from ipaddress import ip_address
from pathlib import PurePosixPath
from socketserver import TCPServer, ThreadingMixIn
from typing import Any, cast
from urllib.parse import quote, unquote_to_bytes, urlsplit

from gsvrcodec.errors import AddressError, InputError
from gsvrcodec.play.collection import Collection
from gsvrcodec.play.web import MEDIA_TYPES, WEB

#: Port if none is asked for.
DEFAULT_PORT = 8787

#: Policy of all pages: they load and run content of this server alone.
_POLICY = "; ".join(
    [
        "default-src 'none'",
        *(f"{kind}-src 'self'" for kind in ("script", "style", "worker", "connect")),
        "media-src blob:",
        "img-src 'self' data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    ]
)
_FILM_TYPE = "video/x-gsvr"  # section 2 of the spec
_RANGE = re.compile(r"bytes=([0-9]{0,18})-([0-9]{0,18})", re.IGNORECASE)

_log = logging.getLogger(__name__)


def open_server(
    collection: Collection,
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    web: Traversable = WEB,
) -> FilmServer:
    """Return a server that listens for requests; its `serve_forever` answers them.

    Args:
        collection: The films.
        host: Name or address of this machine. Off the loopback, others can read the films.
        port: 0 = any free port; None = `DEFAULT_PORT`, or any free port if that is taken.
        web: Directory of the pages.

    Raises:
        AddressError: The port is taken, or the address is not one of this machine's.
    """
    if port is None:
        try:
            return FilmServer(collection, host, DEFAULT_PORT, web)
        except AddressError:
            port = 0
    return FilmServer(collection, host, port, web)


class FilmServer(ThreadingMixIn, TCPServer):
    """Serves films and the pages that play them, each connection in a thread of its own.

    `http.server.ThreadingHTTPServer` would ask the DNS for the name of this machine first.

    Args:
        collection: The films.
        host: Name or address of this machine.
        port: 0 = any free port.
        web: Directory of the pages.

    Raises:
        AddressError: The port is taken, or the address is not one of this machine's.
    """

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 64

    def __init__(self, collection: Collection, host: str, port: int, web: Traversable) -> None:
        self.collection = collection
        self.web = web
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            self.address_family, *_, address = found[0]
            super().__init__(cast(tuple[str, int], address), _Handler)
        except (OSError, UnicodeError) as error:
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                what = f"port {port} of {host} is in use already; choose another `port`"
            else:
                reason = getattr(error, "strerror", None) or str(error)
                what = f"cannot listen at port {port} of {host}: {reason.lower()}"
            raise AddressError(what) from error

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the server."""
        address, port = self.server_address[:2]
        ip = ip_address(str(address))
        if ip.is_unspecified:
            ip = ip_address("127.0.0.1" if ip.version == 4 else "::1")
        return f"http://{ip}:{port}/" if ip.version == 4 else f"http://[{ip}]:{port}/"

    def answers_to(self, host: str) -> bool:
        """Whether to answer a request for this host.

        On the loopback, only for names of the loopback: a page from elsewhere, whose own name was
        made to lead here (DNS rebinding), does not get to read the films.
        """
        return not ip_address(str(self.server_address[0])).is_loopback or _is_loopback(host)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log an error in one line; clients that went away are no error."""
        error = sys.exception()
        if not isinstance(error, ConnectionError | TimeoutError):
            _log.warning("a request failed: %s: %s", type(error).__name__, error)


class _Handler(BaseHTTPRequestHandler):
    """Answers the requests of one connection."""

    server: FilmServer

    protocol_version = "HTTP/1.1"
    error_message_format = "%(code)d %(message)s\n"
    error_content_type = "text/plain; charset=utf-8"
    #: Seconds that a connection may idle.
    timeout = 600
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Answer a request; that for the head alone likewise, without the content."""
        path = self.path.partition("?")[0]
        if not self.server.answers_to(self.headers.get("Host", "")):
            self.send_error(HTTPStatus.FORBIDDEN, "this server is for the machine it runs on")
        elif path == "/":
            self._send(HTTPStatus.FOUND, {"Location": self._start_page()})
        elif path == "/films.json":
            self._send_list()
        elif path.startswith("/films/"):
            self._send_film(film_name(path.removeprefix("/")))
        else:
            self._send_file(path.removeprefix("/"))

    do_HEAD = do_GET

    def _start_page(self) -> str:
        collection = self.server.collection
        # The URL of the film, quoted once more as the value of a query.
        film = quote(film_url(collection.path.name))
        return "gallery.html" if collection.directory else f"player.html?film={film}"

    def _send_list(self) -> None:
        try:
            films = self.server.collection.films()
        except InputError:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        listed = [
            {"name": film.name, "url": film_url(film.name), "bytes": film.size_bytes}
            for film in films
        ]
        content = json.dumps(listed).encode("ascii")
        self._send(HTTPStatus.OK, {"Content-Type": "application/json"}, content)

    def _send_file(self, name: str) -> None:
        """Send a page, a style sheet or a script."""
        kind = MEDIA_TYPES.get(PurePosixPath(name).suffix)
        files = {file.name: file for file in self.server.web.iterdir()}
        if kind is None or name not in files:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        content, headers = files[name].read_bytes(), {"Content-Type": kind}
        if "gzip" in self.headers.get("Accept-Encoding", ""):
            content = gzip.compress(content, mtime=0)
            headers["Content-Encoding"] = "gzip"
        self._send(HTTPStatus.OK, headers, content)

    def _send_film(self, name: str) -> None:
        """Send a film, or the part that is asked for."""
        try:
            file = self.server.collection.open(name)
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        with file:
            status = os.fstat(file.fileno())
            size, tag = status.st_size, f'"{status.st_size:x}-{status.st_mtime_ns:x}"'
            headers = {"Accept-Ranges": "bytes", "ETag": tag}
            if _names_tag(self.headers.get("If-None-Match", ""), tag):
                self._send(HTTPStatus.NOT_MODIFIED, headers)
                return
            part = self._wanted(size, tag)
            if part is None:
                code, part = HTTPStatus.OK, range(size)
            elif part:
                code = HTTPStatus.PARTIAL_CONTENT
                headers["Content-Range"] = f"bytes {part.start}-{part.stop - 1}/{size}"
            else:
                headers["Content-Range"] = f"bytes */{size}"
                self._send(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, headers)
                return
            self._send_head(code, headers | {"Content-Type": _FILM_TYPE}, len(part))
            if part and self.command == "GET":
                sent = self.connection.sendfile(file, part.start, len(part))
                # A file that became shorter: the rest of the answer will not come.
                self.close_connection |= sent < len(part)

    def _wanted(self, size: int, tag: str) -> range | None:
        """The bytes that a request wants of a file, as `byte_range`."""
        if self.command != "GET" or self.headers.get("If-Range", tag) != tag:
            return None
        return byte_range(self.headers.get("Range", ""), size)

    def _send(self, code: HTTPStatus, headers: dict[str, str], content: bytes = b"") -> None:
        self._send_head(code, headers, len(content))
        if self.command == "GET":
            self.wfile.write(content)

    def _send_head(self, code: HTTPStatus, headers: dict[str, str], size: int) -> None:
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name, value)
        if code != HTTPStatus.NOT_MODIFIED:
            self.send_header("Content-Length", str(size))
        self.end_headers()

    def end_headers(self) -> None:
        """End the head of an answer, errors included, with the fields that all answers have."""
        self.send_header("Cache-Control", "no-cache")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()

    def version_string(self) -> str:
        """Return the value of the header `Server`."""
        return "gsvrplay"

    def log_message(self, format: str, *args: object) -> None:
        """Log requests at the level of debugging."""
        _log.debug(format, *args)


def film_url(name: str) -> str:
    """Where the server has a film, relative to its pages."""
    return f"films/{quote(os.fsencode(name), safe='')}"


def film_name(url: str) -> str:
    """The inverse of `film_url`, of a URL as the head of a request holds it."""
    return os.fsdecode(unquote_to_bytes(url.removeprefix("films/").encode("latin-1")))


def byte_range(header: str, size: int) -> range | None:
    """The bytes of a file that a Range header asks for, such as `bytes=0-99`.

    Args:
        header: value of the header; empty = there is none.
        size: bytes of the file.

    Returns:
        Empty = outside the file. None = all of it, also if the header has several ranges or is not
        understood (RFC 9110, section 14.2).
    """
    match = _RANGE.fullmatch(header.strip())
    if match is None or match[0].endswith("=-"):
        return None
    first, last = match.groups()
    if not first:
        return range(max(0, size - int(last)), size)
    start, stop = int(first), int(last) + 1 if last else size
    if last and stop <= start:
        return None
    return range(start, min(stop, size))


def _names_tag(header: str, tag: str) -> bool:
    """Whether an If-None-Match header has a tag, or `*`."""
    tags = {each.strip().removeprefix("W/") for each in header.split(",")}
    return not tags.isdisjoint({tag, "*"})


def _is_loopback(host: str) -> bool:
    """Whether a Host header, with or without a port, names the loopback."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False
