"""Version of the FFmpeg that is used."""

from __future__ import annotations

import av


def ffmpeg_version() -> str:
    """Return the version that FFmpeg gives itself, and that of its codec library."""
    codec = ".".join(map(str, av.library_versions["libavcodec"]))
    return f"{av.ffmpeg_version_info} (libavcodec {codec})"
