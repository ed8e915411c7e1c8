"""Chains of small GOPs, for the tests of chains and of what is around them."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.film_target import Aim, FilmTarget
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.rate import bpp_for, crf_of, qscale_at
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.source import ChainFrames
from tests.gops import encoded, make_chain

LENGTHS = (3, 2, 1, 4)
PAYLOADS = make_chain(LENGTHS)
BUDGET = Budget(30)


def ranges(lengths: Sequence[int]) -> list[range]:
    return [range(*pair) for pair in pairwise(accumulate(lengths, initial=0))]


RESULTS = list(map(encoded, ranges(LENGTHS), PAYLOADS))


def frames_of(lengths: Sequence[int] = LENGTHS) -> ChainFrames:
    """Frames of which each is of one level, its number."""
    gops = ranges(lengths)
    return ChainFrames(
        gops,
        [np.stack([np.full((4, 6, 3), number, np.uint8) for number in gop]) for gop in gops],
        [40 * np.arange(gop.start, gop.stop) for gop in gops],
        [np.full(len(gop), 40) for gop in gops],
    )


def driven(
    jobs: Generator[GopJob, EncodedGop, None], results: Sequence[EncodedGop]
) -> list[GopJob]:
    """Answer each job with the next result, and return the jobs."""
    found = [next(jobs)]
    for result in results:
        try:
            found.append(jobs.send(result))
        except StopIteration:
            break
    return found


def chains_of(*lengths: Iterable[int]) -> list[Chain]:
    """Return chains of GOPs of these lengths."""
    chains: list[Chain] = []
    start = 0
    for own in lengths:
        stops = list(accumulate(own, initial=start))
        chains.append([range(*pair) for pair in pairwise(stops)])
        start = stops[-1]
    return chains


def of_rate(
    stats: Sequence[FrameStats],
    *,
    bpp: float | None = None,
    target_psnr: float | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Return settings; in place of `bpp` or a PSNR, the quality that comes to it by the model."""
    if target_psnr is not None:
        bpp = bpp_for(stats, target_psnr)
    return settings if bpp is None else settings | {"crf": crf_of(qscale_at(stats, bpp))}


def of_film(settings: EncodeSettings) -> FilmTarget:
    """Return the target of settings without a size or a PSNR."""
    assert not isinstance(settings.target, Aim)
    return settings.target
