"""The server: pages, the list of films, parts of films, and who gets no answer."""

from __future__ import annotations

import json
import logging
import os
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from http.client import IncompleteRead
from pathlib import Path
from urllib.parse import parse_qs, urljoin, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.errors import AddressError
from gsvrcodec.play import serve
from gsvrcodec.play.collection import Collection, open_collection
from gsvrcodec.play.serve import byte_range, open_server
from gsvrcodec.play.web import WEB
from tests.play.tools import FILM, VALID, Client, serving, write_pages

DATA = FILM.read_bytes()
SIZE = len(DATA)
MIB = 2**20

AWKWARD = (
    *("a b.gsvr", "ünï 視頻.gsvr", "100%.gsvr", "%41.gsvr", "#1?x=y&z.gsvr", "a+b.gsvr"),
    *("x'y\"z.gsvr", "<b>.gsvr", "-dash.gsvr", "back\\slash.gsvr", "a:b;c.GSVR", "line\nend.gsvr"),
    os.fsdecode(b"latin \xe9.gsvr"),
)


@pytest.fixture(scope="module")
def web(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pages(tmp_path_factory.mktemp("web"))


@pytest.fixture(scope="module")
def client(web: Path) -> Iterator[Client]:
    """A client of a server of one film."""
    with serving(FILM, web) as client:
        yield client


@pytest.fixture
def films(tmp_path: Path) -> Path:
    """A directory with two films, and with what is none."""
    directory = tmp_path / "films"
    (directory / "sub").mkdir(parents=True)
    (directory / "d.gsvr").mkdir()
    for name in ("b.gsvr", ".hidden.gsvr", "text.txt", "sub/c.gsvr"):
        shutil.copy(FILM, directory / name)
    (directory / "a.gsvr").symlink_to(VALID / "png.gsvr")
    (directory / "broken.gsvr").symlink_to(directory / "none")
    os.mkfifo(directory / "pipe.gsvr")
    shutil.copy(FILM, tmp_path / "outside.gsvr")
    return directory


def large_film(path: Path, size: int = 64 * MIB) -> Path:
    """A file that starts as a film does, and is too large for the buffers of a connection."""
    path.write_bytes(DATA)
    os.truncate(path, size)
    return path


class TestRanges:
    @given(st.none() | st.integers(0, SIZE + 9), st.none() | st.integers(0, SIZE + 9))
    def test_are_slices_of_the_film(
        self, client: Client, first: int | None, last: int | None
    ) -> None:
        spelled = ["" if end is None else str(end) for end in (first, last)]
        answer = client("/films/black.gsvr", Range="bytes=" + "-".join(spelled))
        if first is None:
            meant = None if last is None else DATA[max(0, SIZE - last) :]
        elif last is None:
            meant = DATA[first:]
        else:
            meant = DATA[first : last + 1] if first <= last else None
        if meant is None:
            assert (answer.status, answer.content) == (200, DATA)
        elif meant:
            start = first if first is not None else SIZE - len(meant)
            place = f"bytes {start}-{start + len(meant) - 1}/{SIZE}"
            assert (answer.status, answer.content) == (206, meant)
            assert answer.headers["Content-Range"] == place
        else:
            assert (answer.status, answer.content) == (416, b"")
            assert answer.headers["Content-Range"] == f"bytes */{SIZE}"

    @given(
        st.text(st.characters(codec="latin-1", exclude_categories=["Cc"]))
        | st.text("0123456789-, =;bytes").map("bytes={}".format)
    )
    def test_of_any_spelling_give_the_film_or_a_part(self, header: str) -> None:
        part = byte_range(header, SIZE)
        assert part is None or part.start >= 0
        assert not part or part.stop <= SIZE

    @pytest.mark.parametrize(
        "header",
        [
            *("", "bytes", "bytes=", "bytes=-", "bytes=a-b", "bytes=5-4", "bytes=-1-2", "0-1"),
            *("bytes=0-1,3-4", "frames=0-1", "bytes=0x1-2", "bytes=\u0661-\u0662", "bytes=+1-2"),
            "bytes=0-" + "9" * 10_000,
        ],
    )
    def test_not_understood_are_not_looked_at(self, header: str) -> None:
        assert byte_range(header, SIZE) is None

    def test_of_an_empty_film_are_outside(self) -> None:
        assert not any(byte_range(f"bytes={each}", 0) for each in ("0-", "0-0", "-1"))

    def test_without_one_all_comes(self, client: Client) -> None:
        answer = client("/films/black.gsvr")
        assert (answer.status, answer.content) == (200, DATA)
        assert answer.headers["Accept-Ranges"] == "bytes"
        assert answer.headers["Content-Type"] == "video/x-gsvr"
        assert "Content-Range" not in answer.headers

    def test_the_head_alone_has_no_range(self, client: Client) -> None:
        answer = client("/films/black.gsvr", method="HEAD", Range="bytes=0-1")
        assert (answer.status, answer.content) == (200, b"")
        assert answer.headers["Content-Length"] == str(SIZE)


class TestTags:
    def test_known_content_is_not_sent_again(self, client: Client) -> None:
        tag = client("/films/black.gsvr").headers["ETag"]
        for header in (tag, f'"x", W/{tag}', "*"):
            answer = client("/films/black.gsvr", If_None_Match=header)
            assert (answer.status, answer.content) == (304, b"")
        assert client("/films/black.gsvr", If_None_Match='"x"').status == 200

    def test_a_part_of_a_film_that_was_replaced_is_all_of_it(
        self, web: Path, tmp_path: Path
    ) -> None:
        film = Path(shutil.copy(FILM, tmp_path / "a.gsvr"))
        with serving(film, web) as client:
            tag = client("/films/a.gsvr").headers["ETag"]
            ask = {"Range": "bytes=0-3", "If_Range": tag}
            assert client("/films/a.gsvr", **ask).status == 206
            other = (VALID / "png.gsvr").read_bytes()
            film.write_bytes(other)
            answer = client("/films/a.gsvr", **ask)
            assert (answer.status, answer.content) == (200, other)
            assert answer.headers["ETag"] != tag
            film.unlink()
            assert client("/films/a.gsvr").status == 404
            assert json.loads(client("/films.json").content) == []


class TestConnections:
    def test_are_kept(self, client: Client) -> None:
        with closing(client.connect()) as connection:
            for path in ("/player.html", "/films/black.gsvr", "/films.json", "/"):
                connection.request("GET", path)
                before = connection.sock
                connection.getresponse().read()
                assert connection.sock is before

    def test_a_client_that_goes_away_is_no_failure(
        self, web: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        with serving(large_film(tmp_path / "a.gsvr"), web) as client:
            connection = client.connect()
            connection.request("GET", "/films/a.gsvr")
            assert connection.getresponse().read(SIZE) == DATA
            connection.close()
            assert client("/films/a.gsvr", Range="bytes=0-3").content == DATA[:4]
            time.sleep(0.2)
        assert not caplog.records

    def test_a_film_that_shrinks_ends_the_answer(self, web: Path, tmp_path: Path) -> None:
        film = large_film(tmp_path / "a.gsvr")
        with serving(film, web) as client, closing(client.connect()) as connection:
            connection.request("GET", "/films/a.gsvr")
            answer = connection.getresponse()
            answer.read(SIZE)
            os.truncate(film, SIZE)
            with pytest.raises((IncompleteRead, ConnectionError)):
                answer.read()

    def test_a_failure_is_one_line(
        self, client: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(*_: object) -> None:
            raise ZeroDivisionError("why")

        monkeypatch.setattr(Collection, "films", fail)
        with pytest.raises(ConnectionError):
            client("/films.json")
        assert caplog.messages == ["a request failed: ZeroDivisionError: why"]

    def test_requests_are_not_logged(
        self, client: Client, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
    ) -> None:
        caplog.set_level(logging.INFO)
        client("/")
        client("/none")
        assert not caplog.records
        assert capfd.readouterr() == ("", "")

    @pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT"])
    def test_other_methods_fail(self, client: Client, method: str) -> None:
        assert client("/films/black.gsvr", method=method).status == 501

    def test_what_is_no_request_fails(self, client: Client) -> None:
        address = client.server.server_address[1]
        with socket.create_connection(("127.0.0.1", address), timeout=20) as connection:
            connection.sendall(b"\x16\x03\x01 not HTTP\r\n\r\n")
            assert b"400 Bad request" in connection.makefile("rb").read()


class TestNames:
    def test_any_name_of_one_film(self, web: Path, tmp_path: Path) -> None:
        for name in AWKWARD:
            with serving(Path(shutil.copy(FILM, tmp_path / name)), web) as client:
                start = client("/")
                assert start.status == 302
                page, _, query = start.headers["Location"].partition("?")
                assert page == "player.html"
                (film,) = parse_qs(query)["film"]
                assert client(f"/{film}").content == DATA, name

    def test_any_name_in_a_directory(self, web: Path, tmp_path: Path) -> None:
        for name in AWKWARD:
            (tmp_path / name).write_bytes(DATA + os.fsencode(name))
        with serving(tmp_path, web) as client:
            listed = json.loads(client("/films.json").content)
            assert [film["name"] for film in listed] == sorted(AWKWARD)
            for film in listed:
                # As a browser does: relative to the page.
                path = urlsplit(urljoin("http://a/gallery.html", film["url"])).path
                assert client(path).content == DATA + os.fsencode(film["name"])

    def test_plain_names_stay_plain(self, client: Client) -> None:
        assert client("/").headers["Location"] == "player.html?film=films/black.gsvr"

    def test_one_film_needs_no_suffix(self, web: Path, tmp_path: Path) -> None:
        with serving(Path(shutil.copy(FILM, tmp_path / "film")), web) as client:
            assert client("/films/film").content == DATA


class TestGallery:
    def test_lists_the_films_by_name(self, web: Path, films: Path) -> None:
        with serving(films, web) as client:
            assert client("/").headers["Location"] == "gallery.html"
            answer = client("/films.json")
            assert answer.headers["Content-Type"] == "application/json"
            assert json.loads(answer.content) == [
                {"name": name, "url": f"films/{name}", "bytes": (films / name).stat().st_size}
                for name in ("a.gsvr", "b.gsvr")
            ]

    def test_knows_what_comes_and_goes(self, web: Path, films: Path) -> None:
        with serving(films, web) as client:
            (films / "b.gsvr").rename(films / "c.gsvr")
            names = [film["name"] for film in json.loads(client("/films.json").content)]
            assert names == ["a.gsvr", "c.gsvr"]
            assert client("/films/c.gsvr").content == DATA
            shutil.rmtree(films)
            assert client("/films.json").status == 404


class TestOtherPaths:
    @pytest.mark.parametrize(
        "path",
        [
            *("/films/outside.gsvr", "/films/../outside.gsvr", "/films/..%2foutside.gsvr"),
            *("/films/%2e%2e/outside.gsvr", "/films/..%5coutside.gsvr", "/../outside.gsvr"),
            *("/films/sub/c.gsvr", "/films/sub%2fc.gsvr", "/films//etc/passwd", "/films/"),
            *("/films/.hidden.gsvr", "/films/text.txt", "/films/d.gsvr", "/films/broken.gsvr"),
            *(
                "/films/pipe.gsvr",
                "/films/b.gsvr/",
                "/films/b.gsvr%00",
                "/films/%00.gsvr",
                "/films",
            ),
            *(
                "/films/" + "a" * 5000 + ".gsvr",
                "/b.gsvr",
                "/notes.txt",
                "/none.js",
                "/../serve.py",
            ),
            *("/player.html/", "/x/player.html", "/player%2ehtml", "/%2e%2e/player.html"),
            *("/favicon.ico", "http://127.0.0.1/films.json", "*"),
        ],
        ids=lambda path: path[:30],
    )
    def test_fail(self, web: Path, films: Path, path: str) -> None:
        with serving(films, web) as client:
            answer = client(path)
        assert answer.status == 404
        assert DATA not in answer.content
        assert answer.headers["X-Content-Type-Options"] == "nosniff"


class TestPages:
    @pytest.mark.parametrize(
        ("name", "kind"),
        [("player.html", "text/html"), ("style.css", "text/css"), ("player.js", "text/javascript")],
    )
    def test_have_their_type_and_policy(
        self, client: Client, web: Path, name: str, kind: str
    ) -> None:
        answer = client(f"/{name}?film=films/black.gsvr")
        assert answer.content == (web / name).read_bytes()
        assert answer.headers["Content-Type"] == f"{kind}; charset=utf-8"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cache-Control"] == "no-cache"
        policy = answer.headers["Content-Security-Policy"].split("; ")
        assert {"default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"} <= set(policy)

    def test_of_the_package_are_served(self) -> None:
        with serving(FILM, Path(str(WEB))) as client:
            for file in WEB.iterdir():
                assert client(f"/{file.name}").content == file.read_bytes(), file.name
            assert client("/player.html").status == client("/gallery.html").status == 200


class TestHosts:
    @pytest.mark.parametrize(
        "host",
        [
            "127.0.0.1",
            "127.0.0.1:8787",
            "localhost",
            "LocalHost:80",
            "[::1]",
            "[::1]:1",
            "127.9.9.9",
        ],
    )
    def test_of_the_loopback_are_answered(self, client: Client, host: str) -> None:
        assert client("/player.html", Host=host).status == 200

    @pytest.mark.parametrize(
        "host",
        [
            *(
                "evil.example",
                "evil.example:8787",
                "127.0.0.1.evil.example",
                "localhost.evil.example",
            ),
            *("192.168.0.1", "0.0.0.0", "[::]", "[::1", "@", "", "1"),
        ],
    )
    def test_others_are_refused(self, client: Client, host: str) -> None:
        for path in ("/", "/player.html", "/films.json", "/films/black.gsvr"):
            answer = client(path, Host=host)
            assert answer.status == 403
            assert DATA not in answer.content

    def test_off_the_loopback_all_are_answered(self, web: Path) -> None:
        with serving(FILM, web, host="0.0.0.0") as client:
            assert client("/films/black.gsvr", Host="tv.example").content == DATA
            assert client.server.url == f"http://127.0.0.1:{client.server.server_address[1]}/"


class TestAddresses:
    def test_a_port_that_is_taken_fails(self, client: Client) -> None:
        port = client.server.server_address[1]
        with pytest.raises(AddressError, match=rf"^port {port} of 127\.0\.0\.1 is in use already"):
            open_server(open_collection(FILM), port=port)

    def test_the_default_port_gives_way(
        self, client: Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        port = client.server.server_address[1]
        monkeypatch.setattr(serve, "DEFAULT_PORT", port)
        with open_server(open_collection(FILM)) as server:
            assert server.server_address[1] not in (0, port)

    @pytest.mark.parametrize(
        "host", ["192.0.2.1", "no such host", "a" * 70 + ".example", "1.2.3.4.5"]
    )
    def test_an_address_of_others_fails(self, host: str) -> None:
        with pytest.raises(AddressError, match=r"cannot listen at port \d+ of"):
            open_server(open_collection(FILM), host=host, port=0)

    def test_of_ipv6_stand_in_brackets(self) -> None:
        try:
            server = open_server(open_collection(FILM), host="::1", port=0)
        except AddressError:
            pytest.skip("needs IPv6")
        with server:
            assert server.url == f"http://[::1]:{server.server_address[1]}/"
            assert server.answers_to("localhost")
            assert not server.answers_to("evil.example")
