"""Pictures of the renderer in WebGL 2, against those of the decoder on the CPU."""

from __future__ import annotations

import base64
import json
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.model.reconstruction import Blending
from tests.vectors import make
from tests.web.conftest import Site
from tests.web.films import plates_alone, random_film, random_plate

pytestmark = pytest.mark.slow

#: Streams with planes that a browser cannot decode.
FOREIGN = {"jxl", "sixteen-bits"}
STREAMS = sorted({path.stem for path in make.VALID.glob("*.gsvr")} - FOREIGN)


def described(name: str) -> list[dict[str, Any]]:
    """The pictures of a conformance stream, and three between its frames."""
    pictures: list[dict[str, Any]] = json.loads((make.VALID / f"{name}.json").read_text())[
        "pictures"
    ]
    return pictures


def rendered(
    page: Any, site: Site, name: str, pictures: list[dict[str, Any]], bits: int
) -> list[NDArray[np.uint8]]:
    """Render pictures in the page; return their codes, (H, W, 3)."""
    result = page.evaluate(
        "([url, pictures, bits]) => harness.render(url, pictures, bits)",
        [f"films/{name}", pictures, bits],
    )
    assert result["bits"] == bits
    assert result["error"] == 0
    codes = []
    for picture, text in zip(pictures, result["found"], strict=True):
        raw = base64.b64decode(text.partition(",")[2])
        shape = (picture["height"], picture["width"], 4)
        codes.append(np.frombuffer(raw, np.uint8).reshape(shape)[:, :, :3])
    return codes


def assert_alike(found: NDArray[np.uint8], wanted: NDArray[np.uint8], most: int) -> None:
    """No sample is more than `most` codes off; the spec's class allows 1, in few samples."""
    assert np.abs(found.astype(int) - wanted).max(initial=0) <= most


def on_cpu(name: Path, picture: dict[str, Any], **options: Any) -> NDArray[np.uint8]:
    """The same picture by the decoder on the CPU."""
    with gsvrcodec.open(name, device="cpu", bit_depth=8, **options) as decoder:
        seconds = Fraction(picture["time"]) * decoder.metadata.time_base
        codes = decoder.render(seconds, size=(picture["width"], picture["height"]))
        return np.asarray(codes)


def after_first(path: Path, pictures: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The pictures with times as the player counts them: from the first timestamp of the film."""
    with gsvrcodec.open(path) as decoder:
        first = decoder.metadata.begin_seconds / decoder.metadata.time_base
    return [picture | {"time": float(Fraction(picture["time"]) - first)} for picture in pictures]


def part(page: Any, name: str, rotation: int, mirrored: bool) -> NDArray[np.uint8]:
    """140x100 pixels of the first picture of a film at 482x270, turned, from 57, 81 on."""
    text = page.evaluate(
        "([url, turn, mirrored]) => harness.part(url, turn, mirrored)",
        [f"films/{name}", rotation, mirrored],
    )
    raw = base64.b64decode(text.partition(",")[2])
    return np.frombuffer(raw, np.uint8).reshape(100, 140, 4)[:, :, :3]


def cut(whole: NDArray[np.uint8], rotation: int, mirrored: bool) -> NDArray[np.uint8]:
    """The same part of a whole picture."""
    turned = np.rot90(whole[:, ::-1] if mirrored else whole, -rotation // 90)
    return turned[81:181, 57:197]


class TestConformance:
    @pytest.mark.parametrize("name", STREAMS)
    @pytest.mark.parametrize(("bits", "most"), [(32, 1), (16, 2)])
    def test_pictures_are_those_of_the_cpu(
        self, bench: Any, site: Site, name: str, bits: int, most: int
    ) -> None:
        path = site.films / f"{name}.gsvr"
        pictures = described(name)
        found = rendered(bench, site, path.name, after_first(path, pictures), bits)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture), most)


class TestBlendings:
    """Random Gaussians on all levels, carried over and passing from GOP to GOP."""

    @pytest.mark.parametrize("blending", ["mean", "sum"])
    @pytest.mark.parametrize("bits", [32, 16])
    @pytest.mark.parametrize("spread", [1, 6])
    def test_frames_and_passages(
        self, bench: Any, site: Site, blending: Blending, bits: int, spread: float
    ) -> None:
        path = site.films / f"random-{blending}-{spread}.gsvr"
        path.write_bytes(random_film(blending, spread=spread))
        # Of the passages from 120 to 160 and 280 to 320, the second is a cross-fade.
        pictures = [
            {"time": time, "width": width, "height": height}
            for time in (0, 40, 120, 131, 159, 160, 200, 299, 320, 440)
            for width, height in ((64, 48), (93, 70), (40, 30))
        ]
        found = rendered(bench, site, path.name, pictures, bits)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture), 1)


class TestPlates:
    """Pictures behind the Gaussians of a chain, and of the next chain another one, or none."""

    @pytest.mark.parametrize("bits", [32, 16])
    @pytest.mark.parametrize(("seeds", "spread"), [((1, 2), 1), ((1, 2), 6), ((1, None), 1)])
    def test_frames_and_passages(
        self, bench: Any, site: Site, bits: int, seeds: tuple[int, int | None], spread: float
    ) -> None:
        plates = [None if seed is None else random_plate(seed) for seed in seeds]
        path = site.films / f"plates-{seeds[1]}-{spread}.gsvr"
        path.write_bytes(random_film("mean", spread=spread, plates=plates))
        pictures = [
            {"time": time, "width": width, "height": height}
            for time in (0, 40, 131, 200, 320, 440)
            for width, height in ((64, 48), (93, 70), (40, 30), (7, 5), (150, 20), (1, 1))
        ]
        found = rendered(bench, site, path.name, pictures, bits)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture), 1)

    def test_cross_fade(self, bench: Any, site: Site) -> None:
        path = site.films / "plates-alone.gsvr"
        path.write_bytes(plates_alone())
        pictures = [{"time": time, "width": 64, "height": 48} for time in (0, 131, 150, 160)]
        found = rendered(bench, site, path.name, pictures, 32)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture), 1)
        assert np.mean(found[0]) + 5 < np.mean(found[1]) < np.mean(found[2]) - 5

    @pytest.mark.parametrize(("layers", "cpu"), [("moving", "dynamic"), ("standing", "static")])
    def test_they_stand(self, bench: Any, site: Site, layers: str, cpu: str) -> None:
        path = site.films / "plates-layers.gsvr"
        path.write_bytes(random_film("mean", plates=[random_plate(1), None]))
        pictures = [
            {"time": time, "width": 64, "height": 48, "options": {"layers": layers}}
            for time in (0, 131, 200)
        ]
        found = rendered(bench, site, path.name, pictures, 32)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture, layers=cpu), 1)

    def test_a_part_is_cut_from_the_whole(self, bench: Any, site: Site) -> None:
        path = site.films / "plates-part.gsvr"
        path.write_bytes(random_film("mean", plates=[random_plate(1), None]))
        whole = on_cpu(path, {"time": 0, "width": 482, "height": 270})
        assert_alike(part(bench, path.name, 90, True), cut(whole, 90, True), 1)

    def test_a_chain_has_one(self, bench: Any, site: Site) -> None:
        """A plate is decoded once, and comes to the page once, however its GOPs are asked for."""
        path = site.films / "plates-chain.gsvr"
        path.write_bytes(random_film("mean", plates=[random_plate(1), random_plate(2)]))
        assert bench.evaluate("url => harness.plates(url)", f"films/{path.name}") == {
            "decoded": 2,
            "asked": 2,
            "shared": [True, True, False],
        }


class TestBetweenGops:
    """Pictures at moments that no GOP describes, which the spec leaves free."""

    @pytest.mark.parametrize("name", ["predicted", "predicted-entropy", "film-sound"])
    def test_passages_and_cross_fades(self, bench: Any, site: Site, name: str) -> None:
        path = site.films / f"{name}.gsvr"
        with gsvrcodec.open(path) as decoder:
            size = (decoder.metadata.width, decoder.metadata.height)
        gops = json.loads((make.VALID / f"{name}.json").read_text())["gops"]
        pictures = []
        for before, after in pairwise(gops):
            last, first = before["pts"][-1], after["pts"][0]
            pictures.append(
                {"time": last + Fraction(first - last, 4), "width": size[0], "height": size[1]}
            )
        found = rendered(bench, site, path.name, after_first(path, pictures), 32)
        for picture, codes in zip(pictures, found, strict=True):
            assert_alike(codes, on_cpu(path, picture), 1)


class TestLayers:
    @pytest.mark.parametrize(("layers", "cpu"), [("moving", "dynamic"), ("standing", "static")])
    def test_layers_are_those_of_the_decoder(
        self, bench: Any, site: Site, layers: str, cpu: str
    ) -> None:
        path = site.films / "film-sound.gsvr"
        picture = {"time": 0, "width": 320, "height": 180}
        asked = after_first(path, [picture])[0] | {"options": {"layers": layers}}
        (codes,) = rendered(bench, site, path.name, [asked], 32)
        assert codes.any()
        assert_alike(codes, on_cpu(path, picture, layers=cpu), 1)


class TestViews:
    """Parts of a picture on a screen: enlarged, turned or mirrored."""

    @pytest.mark.parametrize("rotation", [0, 90, 180, 270])
    @pytest.mark.parametrize("mirrored", [False, True])
    def test_a_part_is_cut_from_the_whole(
        self, bench: Any, site: Site, rotation: int, mirrored: bool
    ) -> None:
        """A magnified part of a turned picture has the codes of the whole one, rendered at once."""
        path = site.films / "film-odd.gsvr"
        whole = on_cpu(
            path, {"time": described("film-odd")[0]["time"], "width": 482, "height": 270}
        )
        assert_alike(part(bench, path.name, rotation, mirrored), cut(whole, rotation, mirrored), 1)
