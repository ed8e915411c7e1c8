"""What a file can be read from: paths, bytes, file objects, URLs and pipes."""

from __future__ import annotations

import io
import os
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import fsspec
import pytest

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.source import Pipe, open_source, path_of
from gsvrcodec.errors import CorruptError, InputError
from tests.gops import make_chain, make_file
from tests.vectors.make import VALID

CHAIN = make_chain()
FILE = make_file(CHAIN)


class Server(ThreadingHTTPServer):
    """Serves FILE at /film.gsvr by ranges, and counts the bytes."""

    sent = 0
    ranges = True


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_HEAD(self) -> None:
        self.answer(body=False)

    def do_GET(self) -> None:
        self.answer(body=True)

    def answer(self, *, body: bool) -> None:
        if self.path != "/film.gsvr":
            self.send_error(404)
            return
        asked = self.server.ranges and re.fullmatch(
            r"bytes=(\d+)-(\d*)", self.headers.get("Range", "")
        )
        data = FILE[int(asked[1]) : int(asked[2]) + 1 if asked[2] else None] if asked else FILE
        self.send_response(206 if asked else 200)
        self.send_header("Content-Length", str(len(data)))
        if asked:
            self.send_header("Accept-Ranges", "bytes")
            first = int(asked[1])
            self.send_header("Content-Range", f"bytes {first}-{first + len(data) - 1}/{len(FILE)}")
        self.end_headers()
        if body:
            self.server.sent += len(data)  # before the reader goes on
            self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def url(server: Server, name: str = "film.gsvr") -> str:
    return f"http://127.0.0.1:{server.server_port}/{name}"


def payloads(reader: GsvrReader) -> list[bytes]:
    return [reader.read_gop(position) for position in range(len(reader.gops))]


class TestKinds:
    def test_path(self, tmp_path: Path) -> None:
        path = tmp_path / "a.gsvr"
        path.write_bytes(FILE)
        for where in (path, str(path)):
            with GsvrReader(where) as reader:
                assert payloads(reader) == CHAIN
                assert reader.name == path_of(where) == str(path)

    def test_bytes(self) -> None:
        with GsvrReader(FILE) as reader:
            assert payloads(reader) == CHAIN
            assert reader.name == "<bytes>"
            assert path_of(FILE) is None

    def test_a_file_object_stays_open(self, tmp_path: Path) -> None:
        path = tmp_path / "a.gsvr"
        path.write_bytes(FILE)
        with path.open("rb") as file:
            file.seek(100)
            with GsvrReader(file) as reader:
                assert payloads(reader) == CHAIN
                assert reader.name == str(path)
            assert not file.closed

    def test_the_decoder_takes_them_too(self) -> None:
        data = (VALID / "predicted.gsvr").read_bytes()
        with gsvrcodec.open(data) as one, gsvrcodec.open(io.BytesIO(data)) as other:
            assert (one[3].data == other[3].data).all()

    def test_missing_file_fails(self) -> None:
        with pytest.raises(InputError, match=r"no/such\.gsvr: no such file"):
            open_source("no/such.gsvr")

    def test_directory_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="is a directory"):
            open_source(tmp_path)

    def test_a_file_that_becomes_shorter_fails(self) -> None:
        file = io.BytesIO(FILE)
        source = open_source(file)
        file.truncate(100)
        with pytest.raises(InputError, match="became shorter"):
            source.read(90, 20)


class TestUrl:
    def test_reads_what_it_needs(self, server: Server) -> None:
        with GsvrReader(url(server)) as reader:
            opened = server.sent
            header, index = reader.chunks[0].end, len(FILE) - reader.gops[-1].chunk.end
            # Three chunk heads are read twice, and a byte tells whether the server gives ranges.
            assert header + index <= opened <= header + index + 3 * 16 + 1
            assert reader.read_gop(2) == CHAIN[2]
            assert server.sent == opened + len(CHAIN[2]) + 20
            assert payloads(reader) == CHAIN
            assert reader.name == url(server)

    def test_film(self, server: Server) -> None:
        with gsvrcodec.open(url(server)) as remote, gsvrcodec.open(FILE) as local:
            assert (remote[6].data == local[6].data).all()

    def test_a_server_without_ranges(self, server: Server) -> None:
        """It is read front to back, as a pipe is."""
        server.ranges = False
        with gsvrcodec.open(url(server)) as remote, gsvrcodec.open(FILE) as local:
            assert not remote.complete
            assert (remote[6].data == local[6].data).all()
            assert len(remote) == len(local)

    def test_another_filesystem(self) -> None:
        with fsspec.open("memory://film.gsvr", "wb") as file:
            file.write(FILE)
        with GsvrReader("memory://film.gsvr") as reader:
            assert payloads(reader) == CHAIN

    def test_missing_fails(self, server: Server) -> None:
        with pytest.raises(InputError, match=r"http://.*/other\.gsvr: no such file"):
            open_source(url(server, "other.gsvr"))

    def test_no_server_fails(self) -> None:
        with pytest.raises(InputError, match=r"http://127\.0\.0\.1:9/film\.gsvr: "):
            open_source("http://127.0.0.1:9/film.gsvr")

    def test_unknown_protocol_fails(self) -> None:
        with pytest.raises(InputError, match=r"gopher://host/film\.gsvr: Protocol not known"):
            open_source("gopher://host/film.gsvr")

    def test_a_server_that_goes_away_fails(self, server: Server) -> None:
        with GsvrReader(url(server)) as reader:
            server.RequestHandlerClass = BaseHTTPRequestHandler
            with pytest.raises(InputError, match="http://"):
                reader.read_gop(0)


@pytest.fixture
def ends() -> Iterator[tuple[Pipe, io.FileIO]]:
    """A pipe to read from, and the end that is written to."""
    read, write = os.pipe()
    with open(read, "rb") as reader, io.FileIO(write, "w") as writer:  # noqa: PTH123
        source = open_source(reader)
        assert isinstance(source, Pipe)
        yield source, writer
        source.close()


class TestPipe:
    def test_takes_no_more_than_it_needs(self, ends: tuple[Pipe, io.FileIO]) -> None:
        source, writer = ends
        writer.write(b"12345")
        assert source.read(1, 3) == b"234"
        assert source.reaches(5)
        assert source.arriving
        writer.write(b"67")
        writer.close()
        assert source.read(4, 3) == b"567"
        assert source.read(0, 2) == b"12"
        assert not source.reaches(8)
        assert not source.arriving
        assert source.size == 7

    def test_reader_gives_each_gop_as_it_comes(self, ends: tuple[Pipe, io.FileIO]) -> None:
        source, writer = ends
        stream = (VALID / "stream.gsvr").read_bytes()
        with GsvrReader(stream) as whole:
            first, second = (gop.chunk.end for gop in whole.gops)
            wanted = payloads(whole)
        writer.write(stream[:first])
        with GsvrReader(source._pipe) as reader:
            assert payloads(reader) == wanted[:1]
            assert not reader.complete
            writer.write(stream[first:second])
            assert reader.grow()
            assert payloads(reader) == wanted
            writer.close()
            assert not reader.grow()
            assert reader.complete
            assert not reader.recovered  # the rest has not been written

    @pytest.mark.parametrize("name", ["stream", "predicted"])
    def test_a_whole_file(self, ends: tuple[Pipe, io.FileIO], name: str) -> None:
        source, writer = ends
        data = (VALID / f"{name}.gsvr").read_bytes()
        writer.write(data + b"what follows is not read")
        with GsvrReader(source._pipe) as reader, GsvrReader(data) as whole:
            reader.to_the_end()
            assert reader.gops == whole.gops
            assert payloads(reader) == payloads(whole)
            assert reader.warnings == ()

    def test_a_cut_file_that_is_no_stream_is_damaged(self, ends: tuple[Pipe, io.FileIO]) -> None:
        source, writer = ends
        writer.write(FILE[:-60])
        writer.close()
        with GsvrReader(source._pipe) as reader:
            reader.to_the_end()
            assert reader.recovered
            assert payloads(reader) == CHAIN

    def test_nothing_fails(self, ends: tuple[Pipe, io.FileIO]) -> None:
        source, writer = ends
        writer.close()
        with pytest.raises(CorruptError, match="it is empty"):
            GsvrReader(source._pipe)
