"""Progress of a command: a bar on a terminal, plain lines elsewhere; on stderr."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

from gsvrcodec.cli.common import counted

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from gsvrcodec.encoder.progress import Progress

#: Least interval of plain lines that say nothing new, seconds.
_LINE_INTERVAL = 10.0

#: Widths of the bar, cells.
_NARROW, _WIDE = 8, 24


class _Display:
    """A progress bar with a text beside it, if stderr is a terminal."""

    def __init__(self, *, quiet: bool = False) -> None:
        """Show nothing if `quiet`."""
        self._quiet = quiet
        self._bar: Bar | None = None
        self._began = self._shown = time.perf_counter()

    def __enter__(self) -> Self:
        """Start the bar."""
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

            self._column = BarColumn(bar_width=_WIDE)
            self._bar = Progress(
                SpinnerColumn(),
                self._column,
                TextColumn("{task.description}", markup=False),
                console=Console(stderr=True),
            )
            self._task = self._bar.add_task("", total=None)
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the bar and leave it on the screen."""
        if self._bar is not None:
            self._bar.stop()

    def _show(self, done: int, total: int | None, parts: Sequence[str], *, new: bool) -> None:
        """Show how far it is.

        Args:
            done: of `total`, which may be unknown.
            total: length of the bar.
            parts: of the text, the least wanted first; a narrow terminal leaves these out.
            new: whether this deserves a plain line, though the last one is not long ago.
        """
        if self._bar is not None:
            text, room = fitted(parts, self._bar.console.width - len("x ") - 1)
            self._column.bar_width = room
            self._bar.update(self._task, completed=done, total=total, description=text)
        elif not self._quiet and (new or time.perf_counter() - self._shown >= _LINE_INTERVAL):
            self._shown = time.perf_counter()
            click.echo("  ".join(parts), err=True)


class EncodeDisplay(_Display):
    """Phase, frames, PSNR, bits a second, seconds a frame and remaining time."""

    def __init__(self, *, quiet: bool = False) -> None:
        """Show nothing if `quiet`."""
        super().__init__(quiet=quiet)
        self._last: tuple[str, int] | None = None

    def loading(self) -> None:
        """Show that the encode is about to begin."""
        self._show(0, None, ["loading"], new=False)

    def __call__(self, state: Progress) -> None:
        """Show the state of an encode."""
        stage = state.phase, state.gop
        new, self._last = stage != self._last, stage
        if state.phase == "analysing":
            known = state.frames > 0 and state.frames >= state.frames_analysed
            expected = f"/{state.frames}" if known else ""
            text = [f"analysing  {state.frames_analysed}{expected} frames"]
            if known and state.eta_seconds is not None:
                text.append(f"ETA about {clock(state.eta_seconds)}")
            self._show(state.frames_analysed, state.frames or None, text, new=new)
        elif state.phase == "verifying":
            self._show(state.frames, state.frames, ["verifying"], new=new)
        else:
            self._show(state.frames_done, state.frames, _figures(state), new=new)


def _figures(state: Progress) -> list[str]:
    """Return what there is to say of an encode that fits, the least wanted first."""
    more = "" if state.analysed else "+"
    parts = []
    if state.workers > 1:
        parts.append(f"{state.chains_done}/{state.chains}{more} chains, {state.workers} workers")
    parts.append(f"GOP {state.gop}/{state.gops}{more}")
    first = " of a first pass" if state.phase == "measuring" else ""
    parts.append(f"{state.frames_done}/{state.frames} frames{first}")
    if state.psnr is not None:
        parts.append(f"{state.psnr:.2f} dB")
    if state.bitrate is not None:
        parts.append(f"{state.bitrate / 1000:.4g} kbit/s")
    if state.seconds_per_frame is not None:
        parts.append(f"{state.seconds_per_frame:.2f} s/frame")
    if state.eta_seconds is not None:
        about = "about " if state.seconds_per_frame is None else ""
        parts.append(f"ETA {about}{clock(state.eta_seconds)}")
    return parts


def fitted(parts: Sequence[str], width: int) -> tuple[str, int]:
    """Return as many of the last parts as fit on a line, and the cells that are left for a bar.

    Args:
        parts: the least wanted first.
        width: of the line, cells.
    """
    text = ""
    for count in range(len(parts), 0, -1):
        text = "  ".join(parts[-count:])
        if width - len(text) - 1 >= _NARROW:
            break
    return text, min(max(width - len(text) - 1, _NARROW), _WIDE)


class EncodeJson:
    """Progress of an encode as JSON lines on the standard output (spec/cli.md, "Progress")."""

    def __enter__(self) -> Self:
        """Return the display itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: there is no bar to stop."""

    def loading(self) -> None:
        """Do nothing: JSON is for what an encode says."""

    def __call__(self, state: Progress) -> None:
        """Print the state of an encode."""
        self._print("progress", asdict(state))

    def done(self, result: dict[str, Any]) -> None:
        """Print the result of the encode."""
        self._print("done", result)

    def _print(self, event: str, content: dict[str, Any]) -> None:
        click.echo(json.dumps({"event": event, **content}))
        sys.stdout.flush()


class FrameDisplay(_Display):
    """Frames done, number of all frames, and frames a second."""

    def __call__(self, done: int, total: int | None) -> None:
        """Show the number of frames done; `total` None = not known."""
        seconds = time.perf_counter() - self._began
        frames = f"{done}" if total is None else f"{done}/{total}"
        parts = [f"{frames} frames", f"{done / max(seconds, 1e-9):.1f} frames/s"]
        if total and done:
            parts.append(f"ETA {clock(seconds / done * max(0, total - done))}")
        self._show(done, total, parts, new=False)

    def summary(self, frames: int) -> None:
        """Print number of frames, wall time and frames a second."""
        if not self._quiet:
            seconds = max(time.perf_counter() - self._began, 1e-9)
            pace = f"{frames / seconds:.1f} frames/s"
            click.echo(f"{counted(frames, 'frame')} in {seconds:.1f} s  {pace}", err=True)


def clock(seconds: float) -> str:
    """Return a time span as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
