"""The player in a browser: pictures, time, layers, sound, and films as a person opens them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.play.export import export_page
from tests.vectors import make
from tests.web.conftest import Site
from tests.web.driving import (
    FILM,
    at_rest,
    facts,
    moment,
    moments_until,
    opened,
    rendered_size,
    seconds_shown,
    seek,
    shows,
    until,
)
from tests.web.films import random_film, random_plate

pytestmark = pytest.mark.slow


class TestPicture:
    def test_is_that_of_the_decoder(self, page: Any, site: Site) -> None:
        opened(page, site, FILM)
        self.assert_first(page, site.films / FILM)

    def test_has_its_plate_in_a_page_from_the_disk(
        self, page: Any, tmp_path: Path, site: Site
    ) -> None:
        path, target = site.films / "plates-player.gsvr", tmp_path / "plates.html"
        path.write_bytes(random_film("mean", plates=[random_plate(1), None]))
        export_page(path, target)
        page.goto(target.as_uri())
        until(lambda: moment(page)[0] >= 0)
        self.assert_first(page, path)

    def assert_first(self, page: Any, film: Path) -> None:
        """The first picture of a film is seen, and black beside it."""
        seen = at_rest(page)
        size = rendered_size(page)
        with gsvrcodec.open(film) as decoder:
            wanted = np.asarray(decoder.render(decoder[0].pts_seconds, size=size))
        left, top = (seen.shape[1] - size[0] + 1) // 2, (seen.shape[0] - size[1] + 1) // 2
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
        page.evaluate(
            """() => {
                const play = document.getElementById("play");
                window.labels = [];
                new MutationObserver(() => labels.push(play.getAttribute("aria-label")))
                    .observe(play, { attributeFilter: ["aria-label"] });
            }"""
        )
        page.keyboard.press(" ")
        until(lambda: page.evaluate("labels") == ["Pause", "Play"])
        last = until(lambda: moment(page)[:2] > (0, 0) and moment(page))
        page.locator("#speed").select_option("0.05")  # slow enough that the beginning is seen
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
