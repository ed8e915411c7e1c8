"""The player with bad films, poor devices, small screens, long films and many seeks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from tests.gops import HEADER, make_payload, moved
from tests.making import BUNNY_SMALL
from tests.web.conftest import Site, watched
from tests.web.driving import (
    FILM,
    at_rest,
    facts,
    moment,
    opened,
    rendered_size,
    seek,
    sentence,
    shows,
    until,
)

pytestmark = pytest.mark.slow


class TestBadFilms:
    @pytest.mark.parametrize(
        ("name", "content", "said"),
        [
            ("foreign.gsvr", BUNNY_SMALL.read_bytes, "signature|no .gsvr|not a"),
            ("empty.gsvr", bytes, "signature|no .gsvr|not a|short"),
        ],
    )
    def test_foreign_files(
        self, page: Any, site: Site, tmp_path: Path, name: str, content: Any, said: str
    ) -> None:
        opened(page, site, FILM)
        (tmp_path / name).write_bytes(content())
        page.locator("#open").set_input_files(tmp_path / name)
        assert re.search(said, sentence(page))
        self.assert_alive(page, site)

    def test_truncated_film(self, page: Any, site: Site, tmp_path: Path) -> None:
        """The player names the damage, and plays the sound part when asked to."""
        opened(page, site, FILM)
        path = tmp_path / "cut.gsvr"
        whole = (site.films / "predicted.gsvr").read_bytes()
        path.write_bytes(whole[: len(whole) * 3 // 4])
        page.locator("#open").set_input_files(path)
        assert "damaged" in sentence(page)
        page.locator("#recover").click()
        until(lambda: "GOP 1 of" in facts(page))
        assert page.locator("#notice").is_hidden()
        self.assert_alive(page, site)

    def test_a_damaged_gop_is_passed_by(self, page: Any, site: Site, tmp_path: Path) -> None:
        opened(page, site, FILM)
        content = bytearray((site.films / FILM).read_bytes())
        with GsvrReader(site.films / FILM) as reader:
            last = [chunk for chunk in reader.chunks if chunk.type == b"GOPD"][-1]
        content[last.offset + 200] ^= 1
        path = tmp_path / "damaged.gsvr"
        path.write_bytes(content)
        page.locator("#open").set_input_files(path)
        until(lambda: page.locator("#notice").is_hidden() and moment(page)[0] == 0)
        page.keyboard.press("End")
        assert "CRC" in sentence(page)
        page.keyboard.press("Home")
        until(lambda: page.locator("#notice").is_hidden())
        self.assert_alive(page, site)

    def test_film_with_jpeg_xl(self, page: Any, site: Site) -> None:
        page.goto(site.player("jxl.gsvr"))
        assert "JPEG XL" in sentence(page)
        assert "--pack" in sentence(page)

    def test_missing_film(self, browser: Any, site: Site) -> None:
        page = browser.new_page()
        page.goto(site.player("none.gsvr"))
        assert "404" in sentence(page)
        page.close()

    def assert_alive(self, page: Any, site: Site) -> None:
        page.locator("#open").set_input_files(site.films / "predicted.gsvr")
        until(lambda: "GOP 1 of 4" in facts(page))
        assert page.locator("#notice").is_hidden()


class TestDevices:
    @pytest.mark.parametrize(
        ("script", "said"),
        [
            ("HTMLCanvasElement.prototype.getContext = () => null", "WebGL 2"),
            ("WebGL2RenderingContext.prototype.getExtension = () => null", "floating-point"),
        ],
    )
    def test_what_is_lacking_is_said(self, page: Any, site: Site, script: str, said: str) -> None:
        page.add_init_script(script)
        page.goto(site.player(FILM))
        assert said in sentence(page)

    def test_a_lost_device_comes_back(self, page: Any, site: Site) -> None:
        page.add_init_script(
            """const get = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (...args) {
                window.context = get.apply(this, args);
                return window.context;
            };"""
        )
        opened(page, site, FILM)
        before = at_rest(page)
        page.evaluate(
            """async () => {
                const way = context.getExtension("WEBGL_lose_context");
                way.loseContext();
                await new Promise((resolve) => setTimeout(resolve, 100));
                way.restoreContext();
            }"""
        )
        page.wait_for_timeout(800)
        assert np.array_equal(at_rest(page), before)

    @pytest.fixture
    def phone(self, browser: Any) -> Iterator[Any]:
        yield from watched(
            browser,
            viewport={"width": 390, "height": 844},
            device_scale_factor=2,
            is_mobile=True,
            has_touch=True,
            color_scheme="dark",
        )

    def test_phone(self, phone: Any, site: Site) -> None:
        """Nothing lies outside of the screen, and fingers work it."""
        opened(phone, site, FILM)
        assert phone.evaluate("document.documentElement.scrollWidth") <= 390
        for control in phone.locator("button:visible, select:visible").all():
            box = control.bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 390
            assert box["y"] + box["height"] <= 844
            assert min(box["width"], box["height"]) >= 32
        phone.touchscreen.tap(195, 200)
        until(lambda: phone.locator("#play").get_attribute("aria-label") == "Pause")

    def test_pinch(self, phone: Any, site: Site) -> None:
        """Two fingers that part enlarge the picture."""
        opened(phone, site, FILM)
        at_rest(phone)
        width = rendered_size(phone)[0]
        session = phone.context.new_cdp_session(phone)
        for kind, apart in [("Start", 20), ("Move", 60), ("Move", 120)]:
            points = [
                {"x": 195 + way * apart, "y": 250, "id": number}
                for number, way in enumerate((-1, 1))
            ]
            event = {"type": f"touch{kind}", "touchPoints": points}
            session.send("Input.dispatchTouchEvent", event)
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        until(lambda: rendered_size(phone)[0] > 2 * width)
        assert phone.locator("#play").get_attribute("aria-label") == "Play"

    def test_every_control_is_reached_by_tab(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        wanted = set(
            page.locator("button:visible, select:visible, input:visible").evaluate_all(
                "all => all.filter((each) => !each.disabled).map((each) => each.id)"
            )
        )
        reached = set()
        for _ in range(len(wanted) + 6):
            page.keyboard.press("Tab")
            reached.add(page.evaluate("document.activeElement.id"))
        assert wanted <= reached
        assert {"play", "seek", "speed", "outlines", "open"} <= wanted

    def test_dark_and_light(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        shades = []
        for scheme in ["dark", "light"]:
            page.emulate_media(color_scheme=scheme)
            shades.append(
                page.evaluate(
                    "getComputedStyle(document.getElementById('controls')).backgroundColor"
                )
            )
        dark, light = (sum(map(int, re.findall(r"\d+", shade))) for shade in shades)
        assert dark < 200 < 600 < light


class TestLongFilm:
    def test_a_seek_reads_little_of_the_film(self, page: Any, site: Site) -> None:
        """Of 48 000 frames, the index and some GOPs are read, in few requests."""
        path = site.films / "long.gsvr"
        payload = make_payload(200, frames=16)
        with path.open("w+b") as file, GsvrWriter(file, HEADER) as writer:
            for gop in range(3000):
                writer.add_gop(moved(payload, gop, 16))
        responses: list[Any] = []
        page.on("response", lambda response: responses.append(response))
        opened(page, site, path.name)
        for share, gop in ((0.9, 2700), (0.3, 900)):
            seek(page, share)
            shows(page, (gop, 0))
        whole = path.stat().st_size
        path.unlink()
        films = [response for response in responses if "/films/" in response.url]
        assert all(response.status == 206 for response in films)
        assert len(films) <= 8
        assert sum(int(response.headers["content-length"]) for response in films) < whole / 4


class TestMemory:
    def test_1000_seeks(self, page: Any, site: Site) -> None:
        """Neither script nor device hold more after 1000 seeks than after 200."""
        opened(page, site, "predicted.gsvr")
        session = page.context.new_cdp_session(page)

        def seeks(count: int) -> int:
            page.evaluate(
                """async (count) => {
                    const slider = document.getElementById("seek");
                    for (let n = 0; n < count; n++) {
                        slider.value = slider.max * ((n * 0.618) % 1);
                        slider.dispatchEvent(new Event("input"));
                        await new Promise((resolve) => requestAnimationFrame(resolve));
                    }
                }""",
                count,
            )
            session.send("HeapProfiler.collectGarbage")
            usage: dict[str, int] = session.send("Runtime.getHeapUsage")
            return usage["usedSize"] + usage.get("backingStorageSize", 0)

        before = seeks(200)
        assert seeks(800) - before < 2**21
