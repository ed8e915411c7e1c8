"""The player in a browser, worked as a person does: keys, mouse, fingers, and bad films."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.play.export import export_page
from tests.bitstream.test_long_film import moved
from tests.gops import HEADER, make_payload
from tests.making import BUNNY_SMALL
from tests.vectors import make
from tests.web.conftest import Site, watched

pytestmark = pytest.mark.slow

FILM = "film-sound.gsvr"

#: GOP, frame in it, tau, weight of the next GOP.
Moment = tuple[int, int, float, float]


def until(found: Callable[[], Any], seconds: float = 10) -> Any:
    """Wait until something is found, and return it."""
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.02)
    return value


def moment(page: Any) -> Moment:
    """What is drawn: GOP, frame in it, tau, weight of the next GOP; (-1, -1, 0, 0) = nothing."""
    text = page.evaluate("document.getElementById('picture').dataset.moment ?? '-1 -1 0 0'")
    index, frame, tau, weight = text.split()
    return int(index), int(frame), float(tau), float(weight)


def shows(page: Any, place: tuple[int, int]) -> Any:
    """Wait until a frame, the second number, of a GOP, the first, is drawn."""
    return until(lambda: moment(page)[:2] == place)


def opened(page: Any, site: Site, name: str) -> Any:
    """Open a film and wait for its first picture."""
    page.goto(site.player(name))
    until(lambda: moment(page)[0] >= 0)
    return page


def moments_until(page: Any, done: Callable[[set[Moment]], bool]) -> set[Moment]:
    """Note what is drawn until `done` says of it that it is enough."""
    seen: set[Moment] = set()
    while not done(seen):
        seen.add(moment(page))
    return seen


def sentence(page: Any) -> str:
    """Wait for the sentence over the picture."""
    return str(until(lambda: page.locator("#sentence").text_content()))


def seek(page: Any, share: float) -> None:
    """Drag the slider of time to a share of the film."""
    page.locator("#seek").evaluate(
        """(slider, share) => {
            slider.value = slider.max * share;
            slider.dispatchEvent(new Event("input"));
        }""",
        share,
    )


def facts(page: Any) -> str:
    """The line below the controls."""
    return str(until(lambda: page.locator("#facts").text_content()))


def rendered_size(page: Any) -> tuple[int, int]:
    """The size at which the picture is rendered, when it rests."""
    width, height = re.findall(r"at (\d+)x(\d+)", facts(page))[0]
    return int(width), int(height)


def seconds_shown(page: Any) -> float:
    """The time that the player shows."""
    minutes, seconds = page.locator("#time").text_content().split(" / ")[0].split(":")
    return 60 * int(minutes) + float(seconds)


def at_rest(page: Any) -> NDArray[np.uint8]:
    """The picture as it is seen, when it is rendered at the size of the screen."""
    until(
        lambda: page.locator("#picture").evaluate(
            """(canvas) => {
                const { width, height } = canvas.getBoundingClientRect();
                return canvas.width === Math.round(width * devicePixelRatio)
                    && canvas.height === Math.round(height * devicePixelRatio);
            }"""
        )
    )
    page.wait_for_timeout(300)
    shot = imagecodecs.png_decode(page.locator("#picture").screenshot())
    return np.asarray(shot)[:, :, :3]


class TestPicture:
    def test_is_that_of_the_decoder(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        seen = at_rest(page)
        size = rendered_size(page)
        with gsvrcodec.open(site.films / FILM) as decoder:
            wanted = np.asarray(decoder.render(decoder[0].pts_seconds, size=size))
        left, top = (seen.shape[1] - size[0]) // 2, (seen.shape[0] - size[1]) // 2
        part = seen[top : top + size[1], left : left + size[0]]
        assert np.mean(np.abs(part.astype(int) - wanted)) < 0.1
        assert not seen[:, : max(left - 1, 0)].any()

    def test_pixels_and_rotation_are_respected(self, page: Any, site: Site) -> None:
        opened(page, site, "film-turned.gsvr")
        seen = at_rest(page)
        bright = np.nonzero(seen.max(axis=(0, 2)) > 8)[0]
        with gsvrcodec.open(site.films / "film-turned.gsvr") as decoder:
            metadata = decoder.metadata
        width = metadata.width * float(metadata.sample_aspect)
        sides = [width, float(metadata.height)]
        if metadata.rotation % 180:
            sides.reverse()
        wide = seen.shape[0] * sides[0] / sides[1]
        assert abs(bright[-1] - bright[0] + 1 - min(wide, seen.shape[1])) < 4

    def test_it_is_rendered_anew_at_every_size(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        at_rest(page)
        before = rendered_size(page)
        page.set_viewport_size({"width": 500, "height": 640})
        until(lambda: rendered_size(page)[0] == 500)
        at_rest(page)
        assert rendered_size(page)[0] < before[0]

    def test_zoom_and_pan(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        at_rest(page)
        width = rendered_size(page)[0]
        for _ in range(4):
            page.keyboard.press("+")
        until(lambda: rendered_size(page)[0] > 2 * width)
        enlarged = at_rest(page)
        page.mouse.move(480, 200)
        page.mouse.down()
        page.mouse.move(400, 160, steps=3)
        page.mouse.up()
        moved = at_rest(page)
        # The picture was taken along: the same picture stands elsewhere.
        assert np.mean(np.abs(moved[:-40, :-80].astype(int) - enlarged[40:, 80:])) < 1
        page.mouse.wheel(0, 4000)
        until(lambda: rendered_size(page)[0] == width)


class TestTime:
    def test_200_random_frames(self, page: Any, site: Site) -> None:
        """Each place of the slider shows its frame; frames last from their time to the next."""
        opened(page, site, FILM)
        gops = json.loads((make.VALID / "film-sound.json").read_text())["gops"]
        places = [
            (gop, frame) for gop, each in enumerate(gops) for frame in range(len(each["pts"]))
        ]
        times = [pts - gops[0]["pts"][0] for gop in gops for pts in gop["pts"]]
        chosen = np.random.default_rng(5).integers(0, len(places), 200).tolist()
        missed = page.evaluate(
            """async (wanted) => {
                const slider = document.getElementById("seek");
                const { dataset } = document.getElementById("picture");
                const missed = [];
                for (const [time, place] of wanted) {
                    slider.value = time;
                    slider.dispatchEvent(new Event("input"));
                    const end = performance.now() + 5000;
                    while (!dataset.moment.startsWith(place) && performance.now() < end) {
                        await new Promise((resolve) => requestAnimationFrame(resolve));
                    }
                    if (!dataset.moment.startsWith(place)) missed.push([time, place]);
                }
                return missed;
            }""",
            [[times[n] + 1, f"{places[n][0]} {places[n][1]} "] for n in chosen],
        )
        assert missed == []

    def test_steps(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        seen = [moment(page)[:2]]
        for key in [".", ".", ".", ",", "End", ",", "Home"]:
            page.keyboard.press(key)
            until(lambda: moment(page)[:2] != seen[-1])
            seen.append(moment(page)[:2])
        gops = json.loads((make.VALID / "film-sound.json").read_text())["gops"]
        last = (len(gops) - 1, len(gops[-1]["pts"]) - 1)
        assert seen[:5] == [(0, 0), (0, 1), (0, 2), (0, 3), (0, 2)]
        assert seen[5] == last
        assert seen[6] == (last[0], last[1] - 1)
        assert seen[7] == (0, 0)

    def test_plays_to_the_end_and_anew(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        page.keyboard.press(" ")
        assert page.locator("#play").get_attribute("aria-label") == "Pause"
        until(lambda: page.locator("#play").get_attribute("aria-label") == "Play")
        last = until(lambda: moment(page)[:2] > (0, 0) and moment(page))
        page.locator("#play").click()
        until(lambda: moment(page)[:2] < last[:2])

    def test_loop(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        page.keyboard.press("l")
        seek(page, 0.8)
        page.keyboard.press(" ")
        until(lambda: seconds_shown(page) < 0.3)
        assert page.locator("#play").get_attribute("aria-label") == "Pause"

    def test_slow_motion_shows_pictures_between_frames(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        page.locator("#speed").select_option("0.05")
        page.keyboard.press(" ")
        seen = moments_until(page, lambda seen: len(seen) > 4)
        assert len({place[:2] for place in seen}) < len(seen)
        assert seconds_shown(page) < 0.5

    def test_at_normal_speed_frames_alone_are_shown(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        frames = len(json.loads((make.VALID / "film-sound.json").read_text())["gops"][0]["pts"])
        page.keyboard.press(" ")
        seen = moments_until(page, lambda _: seconds_shown(page) > 0.3)
        for index, frame, tau, weight in seen - {(-1, -1, 0.0, 0.0)}:
            if index == 0:
                assert tau == pytest.approx(2 * frame / (frames - 1) - 1, abs=1e-5)
            assert weight == 0

    def test_variable_frame_rates(self, page: Any, site: Site) -> None:
        """A long frame is shown for long."""
        opened(page, site, "variable-rate.gsvr")
        gops = json.loads((make.VALID / "variable-rate.json").read_text())["gops"]
        end = float(page.locator("#seek").get_attribute("max"))
        first = gops[0]["pts"][0]
        for index, gop in enumerate(gops):
            for frame, (start, stop) in enumerate(zip(gop["pts"], gop["pts"][1:], strict=False)):
                for place in (start, stop - 0.5):
                    seek(page, (place - first + 0.25) / end)
                    shows(page, (index, frame))


class TestLayersAndOutlines:
    def test_layers_add_up(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        counts = {}
        for layer in ["all", "moving", "standing"]:
            page.locator("#layers").select_option(layer)
            page.wait_for_timeout(600)
            counts[layer] = int(re.findall(r"([\d,]+) Gaussians", facts(page))[0].replace(",", ""))
        assert counts["moving"] + counts["standing"] == counts["all"]
        assert 0 < counts["moving"] < counts["all"]

    def test_ellipses(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        plain = at_rest(page)
        page.keyboard.press("g")
        page.wait_for_timeout(500)
        drawn = at_rest(page)
        assert np.mean(np.abs(drawn.astype(int) - plain)) > 5
        page.keyboard.press("g")
        page.wait_for_timeout(500)
        assert np.array_equal(at_rest(page), plain)


class TestSound:
    def test_is_in_step(self, page: Any, site: Site) -> None:
        """The sound's own clock tells the time of the pictures."""
        page.add_init_script(
            """const Plain = Audio; window.sounds = [];
            window.Audio = class extends Plain {
                constructor() { super(); window.sounds.push(this); }
            };"""
        )
        opened(page, site, FILM)
        page.locator("#mute").wait_for()
        page.keyboard.press("l")
        page.keyboard.press(" ")
        off = []
        until(lambda: page.evaluate("sounds[0].currentTime > 0.2 && !sounds[0].paused"))
        for _ in range(10):
            late = page.evaluate(
                """() => [sounds[0].paused, sounds[0].currentTime,
                    Number(document.getElementById("seek").value)]"""
            )
            if not late[0]:
                off.append(abs(late[1] - late[2] * self.tick(site)))
            page.wait_for_timeout(30)
        assert np.median(off) < 0.2
        page.locator("#speed").select_option("2")
        until(lambda: page.evaluate("sounds[0].paused"))

    def tick(self, site: Site) -> float:
        with gsvrcodec.open(site.films / FILM) as decoder:
            return float(decoder.metadata.time_base)


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
        """It says so, and plays what is there when it is asked to."""
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
                writer.add_gop(moved(payload, gop))
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


class TestExport:
    def test_page_plays_from_the_disk(self, page: Any, site: Site, tmp_path: Path) -> None:
        target = tmp_path / "film & page.html"
        export_page(site.films / FILM, target)
        page.goto(target.as_uri())
        until(lambda: moment(page)[0] >= 0)
        assert page.title() == "film-sound.gsvr - gsvrplay"
        page.keyboard.press("End")
        until(lambda: moment(page)[0] > 0)


class TestGallery:
    def test_films_and_their_pictures(self, page: Any, site: Site) -> None:
        page.goto(site.url)
        names = until(lambda: page.locator("#films b").all_text_contents())
        assert names == sorted(path.name for path in site.films.glob("*.gsvr"))
        until(
            lambda: all(
                "x" in text for text in page.locator("#films small").all_text_contents()[:4]
            )
        )
        page.locator("#films a").first.click()
        until(lambda: moment(page)[0] >= 0)
