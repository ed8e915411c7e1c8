"""Passes over a film: its GOPs are planned and fitted, to be kept, or only to be measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass

from gsvrcodec.encoder.chain import all_tasks
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Section
from gsvrcodec.encoder.first_pass import Plan, Taken
from gsvrcodec.encoder.lookahead import Lookahead
from gsvrcodec.encoder.plan import Budget, plan
from gsvrcodec.encoder.progress import Meter
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.run import Runner
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.source import ChainReader


@dataclass(frozen=True, slots=True)
class Passes:
    """Passes over one film."""

    lookahead: Lookahead  #: of the film
    size: tuple[int, int]  #: width and height, pixels
    reader: Callable[[], ChainReader]  #: begins to read the film
    runner: Runner
    meter: Callable[[Checkpoint, float], Meter]  #: of a pass, by its GOPs and when it began

    def fitted(
        self,
        settings: EncodeSettings,
        kept: Checkpoint,
        began: float,
        aims: Plan | None = None,
    ) -> Iterator[EncodedGop]:
        """Keep each GOP that is missing, then yield it.

        Args:
            settings: Of the pass.
            kept: GOPs that are finished.
            began: `time.perf_counter()` when the time budget did.
            aims: What GOPs are to do; None = any.
        """

        def budgets_of(section: Section) -> list[Budget]:
            stats, seconds = self.lookahead.stats, section.seconds
            found = plan(section.chains, stats, self.size, settings, seconds=seconds)
            return found if aims is None else aims.budgets(found)

        sections, at_once = self.lookahead.sections(), self.runner.at_once()
        tasks = all_tasks(sections, budgets_of, settings, kept, began, self.reader(), at_once)
        with closing(self.runner.run(tasks)) as finished:
            for done in finished:
                kept.add(done)
                yield done

    def measured(self, settings: EncodeSettings) -> Taken:
        """Return what the GOPs of the film take, and reach, at a constant quality."""
        assert settings.crf is not None
        with Checkpoint(None, {}, resume=False, restart=False) as kept:
            began = time.perf_counter()
            meter = self.meter(kept, began)
            meter.workers = self.runner.at_once
            meter.report("measuring")
            for _ in self.fitted(settings, kept, began):
                meter.report("measuring")
            gops = self.lookahead.gops
            psnrs = [kept.figures(gop).psnr for gop in gops]
            return Taken.by(settings.crf, map(kept.payload, gops), psnrs, share=settings.predicts)
