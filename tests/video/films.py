"""Small films with sound, subtitles, chapters and titles, and what their packets are."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.video.probe import demuxed

SUBTITLES = """1
00:00:00,100 --> 00:00:00,400
Good <i>morning</i>

2
00:00:00,520 --> 00:00:00,900
Good night
"""


@dataclass(frozen=True)
class Packet:
    """What must come back of a packet."""

    data: bytes
    start: Fraction  #: seconds
    duration: Fraction  #: seconds
    extra: tuple[tuple[str, bytes], ...]  #: such as samples to skip


def film(
    path: Path,
    codec: str = "flac",
    *,
    frames: int = 10,
    start: Fraction = Fraction(0),
    sound_start: Fraction = Fraction(0),
    sound_seconds: Fraction = Fraction(1),
    subtitles: bool = False,
) -> Path:
    """Write noise in picture and sound at 25 frames a second, with titles and two chapters."""
    rng = np.random.default_rng(3)
    text = path.with_suffix(".srt")
    text.write_text(SUBTITLES)
    # Without B-frames, the times of packets are those of pictures.
    with (
        av.open(str(path), "w", container_options={"avoid_negative_ts": "disabled"}) as output,
        av.open(str(text)) as srt,
    ):
        output.metadata["title"] = "A film: \N{SNOWMAN}"
        video = output.add_stream("mpeg4", rate=25, options={"bf": "0"})
        assert isinstance(video, av.VideoStream)
        video.width, video.height, video.pix_fmt = 32, 16, "yuv420p"
        video.time_base = video.codec_context.time_base = Fraction(1, 12800)
        video.metadata["language"] = "isl"
        sound = output.add_stream(codec, rate=44100 if codec != "libopus" else 48000)
        assert isinstance(sound, av.AudioStream)
        sound.metadata.update(language="fra", title="Commentary")
        lines = output.add_stream_from_template(srt.streams[0]) if subtitles else None
        if lines is not None:
            lines.metadata["language"] = "deu"
            lines.disposition = av.stream.Disposition.forced
        output.set_chapters(
            [
                {
                    "id": number,
                    "start": 200 * number,
                    "end": 200 * number + 200,
                    "time_base": Fraction(1, 1000),
                    "metadata": {"title": f"Part {number}"},
                }
                for number in (0, 1)
            ]
        )
        for packet in demuxed(srt, [srt.streams[0]]) if lines is not None else ():
            packet.stream = lines
            output.mux(packet)
        for number in range(frames):
            picture = rng.integers(0, 256, (16, 32, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = int((start + Fraction(number, 25)) * 12800)
            frame.time_base = Fraction(1, 12800)
            output.mux(video.encode(frame))
        rate = sound.codec_context.sample_rate
        for number in range(int(sound_seconds * rate / 1024)):
            noise = rng.normal(0, 0.1, (2, 1024)).astype(np.float32)
            samples = av.AudioFrame.from_ndarray(noise, format="fltp", layout="stereo")
            samples.sample_rate, samples.time_base = rate, Fraction(1, rate)
            samples.pts = round(sound_start * rate) + 1024 * number
            output.mux(sound.encode(samples))
        output.mux([*video.encode(None), *sound.encode(None)])
    text.unlink()
    return path


def mp4_with_subtitles(path: Path) -> Path:
    """Write a second of black with two lines of MP4's own kind, with gaps around them."""
    with av.open(str(path), "w") as output:
        video = output.add_stream("mpeg4", rate=25, options={"bf": "0"})
        assert isinstance(video, av.VideoStream)
        video.width, video.height, video.pix_fmt = 32, 16, "yuv420p"
        lines = output.add_mux_stream("mov_text", time_base=Fraction(1, 1000))
        for start, stop, text in ((100, 400, b"Good morning"), (520, 900, b"Good night")):
            packet = av.Packet(len(text).to_bytes(2) + text)
            packet.pts = packet.dts = start
            packet.duration, packet.time_base = stop - start, Fraction(1, 1000)
            packet.stream = lines
            output.mux(packet)
        for number in range(25):
            frame = av.VideoFrame(32, 16, "yuv420p")
            frame.pts = number
            output.mux(video.encode(frame))
        output.mux(video.encode(None))
    return path


def packets(path: Path) -> list[tuple[str, list[Packet]]]:
    """Return codec and packets of every stream of sound or subtitles."""
    with av.open(str(path)) as container:
        streams = [s for s in container.streams if s.type in ("audio", "subtitle")]
        found: dict[int, list[Packet]] = {stream.index: [] for stream in streams}
        for packet in demuxed(container, streams):
            base = packet.time_base
            found[packet.stream.index].append(
                Packet(
                    data=bytes(packet),
                    start=(packet.pts or 0) * base,
                    duration=(packet.duration or 0) * base,
                    extra=tuple((side.data_type, bytes(side)) for side in packet.iter_sidedata()),
                )
            )
        return [(stream.codec_context.name, found[stream.index]) for stream in streams]


def samples(path: Path) -> tuple[Fraction, NDArray[np.float32]]:
    """Return when the first stream of sound starts, seconds, and all it sounds like."""
    with av.open(str(path)) as container:
        blocks = list(container.decode(audio=0))
    assert blocks[0].pts is not None
    assert blocks[0].time_base is not None
    data = [block.to_ndarray().astype(np.float32) for block in blocks]
    return blocks[0].pts * blocks[0].time_base, np.concatenate(data, axis=1)
