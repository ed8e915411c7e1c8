"""Clips for training, beside H.264: `python -m tests.benchmarks.dataloader SOURCE FILE.gsvr`.

A `DataLoader` with two workers asks for random clips of 16 frames: ours by `ClipDataset`, H.264 by
PyAV's `seek` and decoding up to the last frame of the clip, to uint8 tensors (T, 3, H, W) both;
and by torchcodec, if it is installed. x264 (preset medium) has encoded the same frames at the PSNR
of the file, with a key frame every 2, as data sets for robots have them, every 12, and with its
default distance, 250 at most. Every reader has a thread in each worker and keeps its file open. As
a decoder of ours keeps the GOPs it has seen last, a second row gives the speed of decoders that are
opened anew for each clip.

In each round all readers are asked for the same clips; a first round, which starts the workers, is
not timed. `--size` scales the pictures: ours are rendered at that size, the others decoded and
scaled by swscale, or by torchcodec. Of torchcodec's wheels 0.11 to 0.13 load with the CPU build of
PyTorch 2.13; earlier ones do not, and later ones need libraries of CUDA.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import av
import click
import torch
from av.video.reformatter import VideoReformatter
from torch.utils.data import DataLoader, Dataset, Sampler

from gsvrcodec import ClipDataset
from gsvrcodec.cli.values import size as picture_size
from tests.benchmarks import x264
from tests.benchmarks.footage import read
from tests.benchmarks.machine import command, commit, machine

#: Clips of a batch.
BATCH = 2

KEYS = (2, 12, None)

OURS, OURS_COLD = "gsvr", "gsvr, no GOP in memory"

Size = tuple[int, int] | None


class ColdClips(ClipDataset):
    """Clips of films that are opened for each."""

    def __getitem__(self, index: int) -> Any:
        """Return a clip."""
        self.close()
        return super().__getitem__(index)


class AvClips(Dataset[torch.Tensor]):
    """Clips of a video file, through PyAV."""

    def __init__(self, path: Path, frames: int, size: Size) -> None:
        self._path, self._frames, self._size = str(path), frames, size
        with av.open(self._path) as container:
            packets = container.demux(container.streams.video[0])
            self._pts = sorted(packet.pts for packet in packets if packet.pts is not None)
        self._open: Any = None

    def __len__(self) -> int:
        return len(self._pts) - self._frames + 1

    def __getitem__(self, index: int) -> torch.Tensor:
        if self._open is None:
            container = av.open(self._path)
            container.streams.video[0].thread_count = 1
            self._open = container, VideoReformatter()
        container, reformatter = self._open
        width, height = self._size or (None, None)
        stream = container.streams.video[0]
        first, clip = self._pts[index], []
        container.seek(first, stream=stream)
        for frame in container.decode(stream):
            if frame.pts >= first:
                rgb = reformatter.reformat(frame, width, height, "rgb24").to_ndarray()
                clip.append(torch.from_numpy(rgb))
                if len(clip) == self._frames:
                    break
        return torch.stack(clip).permute(0, 3, 1, 2)


class TorchcodecClips(Dataset[torch.Tensor]):
    """Clips of a video file, through torchcodec."""

    def __init__(self, path: Path, frames: int, size: Size, length: int) -> None:
        self._path, self._frames, self._size = str(path), frames, size
        self._length = length
        self._decoder: Any = None

    def __len__(self) -> int:
        return self._length - self._frames + 1

    def __getitem__(self, index: int) -> torch.Tensor:
        if self._decoder is None:
            from torchcodec import decoders, transforms  # type: ignore[import-not-found]

            scaled = [transforms.Resize(self._size[::-1])] if self._size else []
            self._decoder = decoders.VideoDecoder(self._path, transforms=scaled)
        frames: torch.Tensor = self._decoder[index : index + self._frames]
        return frames


class RandomStarts(Sampler[int]):
    """Clip numbers, drawn anew for each round: the same for every reader."""

    def __init__(self, clips: int, count: int) -> None:
        self._clips, self._count, self.seed = clips, count, 0

    def __iter__(self) -> Iterator[int]:
        generator = torch.Generator().manual_seed(self.seed)
        return iter(torch.randint(self._clips, (self._count,), generator=generator).tolist())

    def __len__(self) -> int:
        return self._count


class Reader:
    """A `DataLoader` of one dataset; its workers live on from round to round."""

    def __init__(self, clips: Dataset[Any], count: int, batches: int, workers: int) -> None:
        self._starts = RandomStarts(count, BATCH * batches)
        self._loader = DataLoader(
            clips,
            BATCH,
            sampler=self._starts,
            num_workers=workers,
            persistent_workers=workers > 0,
            multiprocessing_context="fork" if workers else None,
        )

    def speed(self, seed: int) -> float:
        """Return frames a second of one round."""
        self._starts.seed = seed
        start = time.perf_counter()
        frames = sum(int(batch.shape[0] * batch.shape[1]) for batch in self._loader)
        return frames / (time.perf_counter() - start)


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--clip", default=16, show_default=True, type=click.IntRange(min=1), help="Frames.")
@click.option("--batches", default=20, show_default=True, type=click.IntRange(min=1))
@click.option("--workers", default=2, show_default=True, type=click.IntRange(min=0))
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(min=1))
@click.option("--size", metavar="WxH", type=picture_size, help="Scale the pictures.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(
    source: Path,
    file: Path,
    clip: int,
    batches: int,
    workers: int,
    repeats: int,
    size: Size,
    output: Path | None,
) -> None:
    """Compare clips of FILE with clips of H.264 of the same frames of SOURCE."""
    footage, own = read(source, file)
    quality = footage.psnr(own.pictures())
    if size is not None and min(size) < 1:
        raise click.UsageError("both sides of --size must be given")
    count = own.frames - clip + 1
    if count < 1:
        raise click.UsageError(f"{file} has {own.frames} frames, fewer than a clip")
    encodes: dict[str, x264.Encode] = {}
    datasets: dict[str, Dataset[Any]] = {
        OURS: ClipDataset(file, frames=clip, step=1, size=size),
        OURS_COLD: ColdClips(file, frames=clip, step=1, size=size),
    }
    with tempfile.TemporaryDirectory() as folder:
        for key in KEYS:
            name = x264.label(key)
            path = Path(folder) / f"key-{key}.mp4"
            encodes[name] = x264.match(footage, path, key, quality, "psnr")
            datasets[f"{name}, PyAV"] = AvClips(path, clip, size)
            if find_spec("torchcodec") is not None:
                name = f"{name}, torchcodec"
                datasets[name] = TorchcodecClips(path, clip, size, own.frames)
        readers = {name: Reader(clips, count, batches, workers) for name, clips in datasets.items()}
        rounds: dict[str, list[float]] = {name: [] for name in readers}
        for seed in range(repeats + 1):
            for name, reader in readers.items():
                speed = reader.speed(seed)
                if seed:
                    rounds[name].append(speed)
        del readers, reader  # and with them the workers
    width, height = size or (footage.info.width, footage.info.height)
    print(machine())
    print(
        f"{file.name}: {own.frames} frames of {footage.info.width}x{footage.info.height}, "
        f"{own.bpp:.4f} bpp, {quality:.2f} dB; clips of {clip} frames of {width}x{height}, "
        f"{workers} workers"
    )
    for name, encode in encodes.items():
        print(f"{name}: CRF {encode.crf:g}, {encode.bpp:.4f} bpp, {encode.psnr:.2f} dB")
    print(f"{'frames a second':40}{'median':>9}{'least':>9}{'most':>9}{'ours over it':>14}")
    speeds = {name: median(values) for name, values in rounds.items()}
    for name, values in rounds.items():
        print(
            f"{name:40}{speeds[name]:9.1f}{min(values):9.1f}{max(values):9.1f}"
            f"{speeds[OURS] / speeds[name]:14.2f}"
        )
    if output is not None:
        document: dict[str, Any] = {
            "machine": machine(),
            "commit": commit(),
            "load": os.getloadavg()[0],
            "command": command("tests.benchmarks.dataloader"),
            "source": source.name,
            "file": file.name,
            "frames": own.frames,
            "bpp": own.bpp,
            "psnr": quality,
            "clip": clip,
            "workers": workers,
            "size": [width, height],
            "x264": {
                name: {"crf": encode.crf, "bpp": encode.bpp, "psnr": encode.psnr}
                for name, encode in encodes.items()
            },
            "frames_a_second": speeds,
            "rounds": rounds,
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
