"""Video files of other formats, in and out. PyAV is imported here and nowhere else."""

from gsvrcodec.video.colour import Rgb
from gsvrcodec.video.output import OutputInfo
from gsvrcodec.video.probe import VideoInfo, probe
from gsvrcodec.video.read import Crop, SourceFrame, VideoReader, open_video
from gsvrcodec.video.write import MUXERS, Writer, muxer_of, open_writer

__all__ = [
    "MUXERS",
    "Crop",
    "OutputInfo",
    "Rgb",
    "SourceFrame",
    "VideoInfo",
    "VideoReader",
    "Writer",
    "muxer_of",
    "open_video",
    "open_writer",
    "probe",
]
