"""Progress of a command: a bar on a terminal, plain lines elsewhere; on stderr."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from gsvrcodec.encoder.progress import Progress

#: Least interval of the plain lines of `FrameDisplay`, seconds.
_LINE_INTERVAL = 10.0


class _Display:
    """A progress bar with a text beside it, if stderr is a terminal."""

    def __init__(self, *, quiet: bool = False) -> None:
        """Show nothing if `quiet`."""
        self._quiet = quiet
        self._bar: Bar | None = None

    def __enter__(self) -> Self:
        """Start the bar."""
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            self._bar = Progress(
                BarColumn(bar_width=24),
                TextColumn("{task.description}"),
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

    def _show(self, done: int, total: int | None, text: str) -> bool:
        """Update the bar; return whether to print a plain line instead."""
        if self._bar is not None:
            self._bar.update(self._task, completed=done, total=total, description=text)
        return self._bar is None and not self._quiet


class EncodeDisplay(_Display):
    """GOPs and chains done, PSNR, seconds a frame and remaining time, after every GOP."""

    def __call__(self, state: Progress) -> None:
        """Show the state of an encode."""
        more = "" if state.analysed else "+"
        parts = [f"GOP {state.gop}/{state.gops}{more}"]
        parts.append(f"{state.frames_done}/{state.frames} frames")
        if state.workers > 1:
            chains = f"{state.chains_done}/{state.chains}{more} chains"
            parts.append(f"{chains}, {state.workers} workers")
        if state.psnr is not None:
            parts.append(f"{state.psnr:.2f} dB")
        if state.seconds_per_frame is not None:
            parts.append(f"{state.seconds_per_frame:.2f} s/frame")
        if state.eta_seconds is not None:
            parts.append(f"ETA {clock(state.eta_seconds)}")
        text = "  ".join(parts)
        if self._show(state.frames_done, state.frames, text):
            click.echo(text, err=True)


class EncodeJson:
    """Progress of an encode as JSON lines on the standard output (spec/cli.md, "Progress")."""

    def __enter__(self) -> Self:
        """Return the display itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: there is no bar to stop."""

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

    def __init__(self, *, quiet: bool = False) -> None:
        """Show nothing if `quiet`."""
        super().__init__(quiet=quiet)
        self._began = self._shown = time.perf_counter()

    def __call__(self, done: int, total: int | None) -> None:
        """Show the number of frames done; `total` None = not known."""
        now = time.perf_counter()
        frames = f"{done}" if total is None else f"{done}/{total}"
        text = f"{frames} frames  {done / max(now - self._began, 1e-9):.1f} frames/s"
        if self._show(done, total, text) and now - self._shown >= _LINE_INTERVAL:
            self._shown = now
            click.echo(text, err=True)

    def summary(self, frames: int) -> None:
        """Print number of frames, wall time and frames a second."""
        if not self._quiet:
            seconds = max(time.perf_counter() - self._began, 1e-9)
            pace = f"{frames / seconds:.1f} frames/s"
            click.echo(f"{frames} frames in {seconds:.1f} s  {pace}", err=True)


def clock(seconds: float) -> str:
    """Return a time span as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
