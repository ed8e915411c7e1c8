"""Reading and writing of other video formats. Only this package imports PyAV."""

from gsvrcodec.video.colour import Rgb
from gsvrcodec.video.extras import Extras, read_extras
from gsvrcodec.video.output import OutputInfo
from gsvrcodec.video.probe import VideoInfo, probe
from gsvrcodec.video.read import Crop, SourceFrame, VideoReader, open_video, reading_options
from gsvrcodec.video.spool import VideoSource, is_pipe, path_of, rereadable
from gsvrcodec.video.timing import Part, Span
from gsvrcodec.video.write import MUXERS, Writer, muxer_of, open_writer

__all__ = [
    "MUXERS",
    "Crop",
    "Extras",
    "OutputInfo",
    "Part",
    "Rgb",
    "SourceFrame",
    "Span",
    "VideoInfo",
    "VideoReader",
    "VideoSource",
    "Writer",
    "is_pipe",
    "muxer_of",
    "open_video",
    "open_writer",
    "path_of",
    "probe",
    "read_extras",
    "reading_options",
    "rereadable",
]
