"""Version of PyAV's FFmpeg."""

from __future__ import annotations

from av import ffmpeg_version_info, library_versions


def ffmpeg_version() -> str:
    """Return the version of FFmpeg and of its codec library."""
    codec = ".".join(map(str, library_versions["libavcodec"]))
    return f"{ffmpeg_version_info} (libavcodec {codec})"
