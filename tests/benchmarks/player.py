"""The player in a browser without a GPU: `python -m tests.benchmarks.player`.

Encodes the sample and the benchmark clip, and measures in Chromium, whose SwiftShader renders on
the CPU: unpacking a GOP beside the native decoder and beside the time that the GOP plays, pictures
a second, the time to the first picture of an exported page, and the time to a random GOP of an
opened film of which nothing is in memory, which is what a seek takes besides rendering. For a GPU
it counts the samples of Gaussians that a frame takes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import threading
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

import gsvrcodec
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.reconstruction import CUTOFF, DILATION, MIN_VARIANCE, UPSAMPLING
from gsvrcodec.play.collection import open_collection
from gsvrcodec.play.export import export_page
from gsvrcodec.play.serve import open_server
from tests.benchmarks.machine import command, commit, machine
from tests.making import BUNNY, BUNNY_SMALL
from tests.web.conftest import ARGUMENTS, find_browser

HARNESS = Path(__file__).parent.parent / "web" / "harness.js"
#: Repeats of everything; medians are printed.
ROUNDS = 5
SEEKS = 60

#: Half a side of a quad, sigmas: where the weight of a Gaussian is zero.
REACH = float(np.sqrt(-2 * np.log(CUTOFF)))


def encode(folder: Path) -> dict[str, Path]:
    """Return the sample, 3M parameters at 1280x640, and a long film of 640x320; encode them."""
    films = {name: folder / f"{name}.gsvr" for name in ("sample", "bunny-3M", "bunny-640x320")}
    if all(path.exists() for path in films.values()):
        return films
    gsvrcodec.encode(BUNNY_SMALL, films["sample"])
    gsvrcodec.encode(
        BUNNY, films["bunny-3M"], preset="fastest", params=3_000_000, crop=(1280, 640, 0, 40)
    )
    gsvrcodec.encode(BUNNY, films["bunny-640x320"], preset="fastest", crop=(640, 320, 320, 200))
    return films


def native_unpacking(path: Path) -> list[float]:
    """Seconds that the native decoder takes for each GOP, medians."""
    rounds = []
    for _ in range(ROUNDS):
        taken = []
        with GsvrReader(path) as reader:
            unpacker = GopUnpacker(reader, Limits())
            for position in range(len(reader.gops)):
                start = time.perf_counter()
                unpacker.unpack(position)
                taken.append(time.perf_counter() - start)
        rounds.append(taken)
    return [median(times) for times in zip(*rounds, strict=True)]


def unpacking(page: Page, name: str) -> dict[str, Any]:
    """Seconds that the decoder in the page takes for each GOP, and how long each plays."""
    result: dict[str, Any] = page.evaluate(
        """async ([name, rounds]) => {
            const url = new URL(`films/${name}`, location.href).href;
            const all = [];
            let plays = [];
            for (let round = 0; round < rounds; round++) {
                const film = await harness.openFilm(url);
                const { Timeline } = await import("/timeline.js");
                const line = new Timeline(film.header, film.gops);
                plays = film.gops.map(({ start }, k) =>
                    ((film.gops[k + 1]?.start ?? line.end) - start) * line.tick);
                const times = [];
                for (let k = 0; k < film.gops.length; k++) {
                    const begin = performance.now();
                    await film.gop(k);
                    times.push((performance.now() - begin) / 1000);
                }
                all.push(times);
            }
            return { all, plays };
        }""",
        [name, ROUNDS],
    )
    first, *rest = result["all"]
    warm = [median(times) for times in zip(*rest, strict=True)]
    return {"first": first, "warm": warm, "plays": result["plays"]}


def pictures_a_second(page: Page, name: str, width: int, height: int) -> float:
    """Pictures that SwiftShader renders in a second: all frames of the first GOP, to the last."""
    milliseconds: list[float] = page.evaluate(
        """async ([name, width, height, rounds]) => {
            const { Renderer } = await import("/renderer.js");
            const { View } = await import("/view.js");
            const film = await harness.openFilm(new URL(`films/${name}`, location.href).href);
            const gop = await film.gop(0);
            const canvas = document.createElement("canvas");
            [canvas.width, canvas.height] = [width, height];
            const renderer = new Renderer(canvas);
            const scene = renderer.scene(gop);
            const coded = [film.header.width, film.header.height];
            const view = new View({ coded, frame: [width, height], screen: [width, height] });
            const times = [];
            for (let n = 0; n <= 12 * rounds; n++) {
                const begin = performance.now();
                renderer.clear();
                renderer.draw(scene, (n % 12) / 6 - 1, view);
                renderer.read(0, 0, 1, 1);
                times.push(performance.now() - begin);
            }
            return times.slice(1);
        }""",
        [name, width, height, ROUNDS],
    )
    return 1000 / median(milliseconds)


def first_picture(browser: Browser, path: Path) -> float:
    """Seconds from opening an exported page in a new tab to its first picture."""
    taken = []
    for _ in range(ROUNDS):
        page = browser.new_page(viewport={"width": 960, "height": 640})
        start = time.perf_counter()
        page.goto(path.as_uri(), wait_until="commit")
        while not page.evaluate("document.getElementById('picture')?.dataset.moment"):
            time.sleep(0.005)
        taken.append(time.perf_counter() - start)
        page.close()
    return median(taken)


def seeks(page: Page, name: str) -> list[float]:
    """Seconds for random GOPs of a film of which nothing is unpacked, with all of their chains."""
    milliseconds: list[float] = page.evaluate(
        """async ([name, count]) => {
            const times = [];
            for (let n = 0; n < count; n++) {
                const film = await harness.openFilm(new URL(`films/${name}`, location.href).href);
                const begin = performance.now();
                await film.gop(Math.floor(((n * 0.618034) % 1) * film.gops.length));
                times.push(performance.now() - begin);
            }
            return times;
        }""",
        [name, SEEKS],
    )
    return [each / 1000 for each in milliseconds]


def fragments(gop: Gop, coded: tuple[int, int]) -> tuple[int, float]:
    """Gaussians, and samples of their quads in a frame of the coded size (section 8.4)."""
    logs = gop.log_scale.astype(np.float64)
    bounds = np.log([2.0, 4.0, 8.0, 16.0]).astype(np.float32)
    level = (logs.min(axis=1)[:, None] >= bounds).sum(axis=1)[:, None]
    area = 4.0**level
    squared = np.exp(2 * logs)
    fine = squared + DILATION
    coarse = np.maximum(squared - UPSAMPLING * area, MIN_VARIANCE * area)
    sides = 2 * (REACH * np.sqrt(np.where(level == 0, fine, coarse) / area) + 0.07)
    return len(logs), float(np.minimum(sides.prod(axis=1), coded[0] * coded[1] / area[:, 0]).sum())


def measure(folder: Path) -> dict[str, Any]:
    """Measure everything; return what is printed and kept."""
    films = encode(folder)
    server = open_server(open_collection(folder), port=0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    found: dict[str, Any] = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser(), args=ARGUMENTS)
        found["browser"] = browser.version
        page = browser.new_page()
        page.add_init_script(path=HARNESS)
        page.goto(f"{server.url}player.html")
        for name, path in films.items():
            native, own = native_unpacking(path), unpacking(page, path.name)
            found[f"unpacking {name}"] = {"native": native, **own}
        sides = {"sample": (320, 180), "bunny-640x320": (640, 320), "bunny-3M": (1280, 640)}
        for name, side in sides.items():
            rate = pictures_a_second(page, films[name].name, *side)
            found[f"pictures a second {name}"] = rate
        export_page(films["sample"], folder / "sample.html", overwrite=True)
        found["page bytes"] = (folder / "sample.html").stat().st_size
        found["first picture"] = first_picture(browser, folder / "sample.html")
        found["seek"] = seeks(page, films["bunny-640x320"].name)
        browser.close()
    for name, path in films.items():
        with GsvrReader(path) as reader:
            gop = GopUnpacker(reader, Limits()).unpack(0).gop
            coded = (reader.header.width, reader.header.height)
        found[f"samples {name}"] = fragments(gop, coded)
    server.shutdown()
    return found


def show(found: dict[str, Any]) -> None:
    """Print the measurements."""
    print(f"Chromium {found['browser']}, SwiftShader")
    for name, value in found.items():
        if name.startswith("unpacking"):
            share = max(t / p for t, p in zip(value["first"], value["plays"], strict=True))
            warm = max(t / p for t, p in zip(value["warm"], value["plays"], strict=True))
            times = median(w / n for w, n in zip(value["warm"], value["native"], strict=True))
            print(
                f"{name}: {1000 * median(value['warm']):.1f} ms a GOP, at worst {warm:.1%} of its"
                f" playing time ({share:.1%} the first time), {times:.1f} times the native decoder"
            )
        elif name.startswith("pictures"):
            print(f"{name}: {value:.1f}")
        elif name.startswith("samples"):
            print(f"{name}: {value[0]:,} Gaussians, {value[1] / 1e6:.2f} million a frame")
    print(
        f"first picture of a page of {found['page bytes']:,} bytes: {found['first picture']:.2f} s"
    )
    waits = sorted(found["seek"])
    print(f"random GOP: {1000 * median(waits):.0f} ms, at worst {1000 * waits[-1]:.0f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="also write the measurements to this file")
    parser.add_argument("--films", type=Path, help="folder of the films, to be used again")
    arguments = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        found = measure(arguments.films or Path(folder))
    show(found)
    if arguments.json:
        about = {
            "machine": machine(),
            "command": command("tests.benchmarks.player"),
            "commit": commit(),
        }
        arguments.json.write_text(json.dumps(about | found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
