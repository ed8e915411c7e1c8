"""Everything that an encode can be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from difflib import get_close_matches
from types import UnionType
from typing import (
    Any,
    Literal,
    Self,
    TypedDict,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from gsvrcodec.encoder.film import Structure
from gsvrcodec.encoder.film_target import (
    Aim,
    ConstantQuality,
    FilmSize,
    FilmTarget,
    MeanPsnr,
    Numbers,
)
from gsvrcodec.encoder.rate import qscale_of
from gsvrcodec.encoder.tuned import CRF, PROCESSES
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.recipe import Deform, FitOptions, Flow, Profile
from gsvrcodec.fit.tuned import EFFORT
from gsvrcodec.limits import Limits
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.video import Part

Preset = Literal["fastest", "medium", "slow", "slowest"]
Pack = Literal["auto", "entropy", "jxl", "png", "deflate"]

DEFAULT_CRF = 26.0


class EncodeOptions(TypedDict, total=False):
    """The fields of `EncodeSettings` as keyword arguments of `gsvrcodec.encode`."""

    params: int | None
    gaussians: int | None
    crf: float | None
    bpp: float | None
    bitrate: int | None
    target_size: int | None
    target_psnr: float | None
    preset: Preset
    time_budget: float | None
    profile: Profile
    deform: Deform
    gop: int | Literal["adaptive"]
    gop_min: int
    gop_max: int | None
    keyint: float
    flow: Flow
    plates: bool
    qat: bool
    pack: Pack
    seed: int
    threads: int
    device: str
    workers: int
    crop: tuple[int, int, int | None, int | None] | None
    start_frame: int
    frames: int | None
    start_seconds: float | None
    stop_seconds: float | None
    rate: float | None
    bake_rotation: bool
    deinterlace: bool
    audio: bool
    subtitles: bool


@dataclass(frozen=True, slots=True)
class Execution:
    """Where an encode runs, which changes none of its bytes; see `EncodeSettings`."""

    threads: int = 0  #: native threads; 0 = GSVR_THREADS or all cores
    device: str = "auto"  #: that fits
    workers: int = 0  #: chains side by side; 0 = by cores


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodeSettings:
    """What an encode is asked for: the keyword arguments of `gsvrcodec.encode`."""

    params: int | None = None  #: most stored numbers in the whole file; key GOPs only
    gaussians: int | None = None  #: Gaussians in each GOP; of these seven at most one is given
    #: constant quality, 0 to 51; 6 more are half the bits or less; None = by the others of the
    #: seven, or `DEFAULT_CRF`
    crf: float | None = None
    bpp: float | None = None  #: bits a pixel and frame, copied streams left out
    bitrate: int | None = None  #: bits a second, copied streams left out
    target_size: int | None = None  #: bytes of the whole file
    target_psnr: float | None = None  #: dB, mean over all frames
    preset: Preset = "medium"  #: optimisation effort; excludes `time_budget`
    time_budget: float | None = None  #: seconds a frame for the whole encode; None = by preset
    profile: Profile = "main"  #: "paper" = the publication as it stands, for comparison
    deform: Deform = "hybrid"  #: parts of the deformation field in use
    gop: int | Literal["adaptive"] = "adaptive"  #: frames in a GOP, or by motion
    gop_min: int = 4  #: shortest adaptive GOP between cuts, frames
    gop_max: int | None = None  #: longest adaptive GOP, frames; None = the longer the fewer bits
    #: longest time from one key GOP, or one that needs another for its plate alone, to the next,
    #: seconds; 0 = every GOP is a key GOP
    keyint: float = 4.0
    flow: Flow = "dis"  #: optical flow for slicing and motion start
    plates: bool = True  #: pictures behind the Gaussians where the source stands still
    qat: bool = True  #: fine-tune under the quantisation to come
    pack: Pack = "auto"  #: plane codecs to choose from; "auto" = smallest for each plane
    seed: int = 0  #: of every random choice
    threads: int = 0  #: native threads; 0 = GSVR_THREADS or all cores
    device: str = "auto"  #: that fits: "cpu", "cuda", "cuda:N"; "auto" = the first usable GPU
    workers: int = 0  #: chains of GOPs fitted side by side; 0 = by cores
    #: width, height, x, y in pixels; x and y None = centre
    crop: tuple[int, int, int | None, int | None] | None = None
    start_frame: int = 0  #: first frame to encode
    frames: int | None = None  #: frames to encode; None = to the end
    #: what starts at this time or later; seconds on the clock of the timestamps
    start_seconds: float | None = None
    stop_seconds: float | None = None  #: what starts before this time
    rate: float | None = None  #: frames a second of pictures and raw streams; None = 25, or guessed
    bake_rotation: bool = False  #: turn and mirror the pictures as a player would
    deinterlace: bool = False  #: make whole pictures of interlaced ones
    audio: bool = True  #: copy the source's sound
    subtitles: bool = True  #: copy the source's subtitles

    def __post_init__(self) -> None:
        """Check each value, and that they do not contradict each other.

        Raises:
            UsageError: naming the argument.
        """
        for name, hint in get_type_hints(type(self)).items():
            _check_type(name, getattr(self, name), hint)
        given = self._sizes
        if len(given) > 1:
            raise UsageError(f"`{given[0]}` and `{given[1]}` exclude each other; give one")
        if self.profile == "paper" and not isinstance(self.target, Numbers):
            raise UsageError(
                f"`profile='paper'` has fixed steps and cannot meet `{given[0]}`; "
                "give `params` or `gaussians`"
            )
        if self.time_budget is not None and self.preset != _DEFAULT_PRESET:
            raise UsageError("`preset` and `time_budget` exclude each other; give one")
        for name, low in _LOWEST.items():
            value = getattr(self, name)
            if isinstance(value, int) and value < low:
                raise UsageError(f"`{name}` must be at least {low}, not {value}")
        for name, high in _HIGHEST.items():
            value = getattr(self, name)
            if isinstance(value, int) and value > high:
                raise UsageError(f"`{name}` must be at most {high}, not {value}")
        for name, unit in _POSITIVE.items():
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise UsageError(f"`{name}` must be above 0 {unit}, not {value}")
        if self.crf is not None and not 0 <= self.crf <= CRF.highest:
            raise UsageError(f"`crf` must be 0 to {CRF.highest:g}, not {self.crf}")
        if not 0 <= self.keyint < float("inf"):
            raise UsageError(f"`keyint` must be 0 or more seconds, not {self.keyint}")
        if self.gop_max is not None and self.gop_min > self.gop_max:
            raise UsageError(
                f"`gop_min={self.gop_min}` is more than `gop_max={self.gop_max}`; lower it"
            )

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> Self:
        """Return the settings of keyword arguments; a UsageError names the wrong one."""
        names = [field.name for field in fields(cls)]
        for name in options:
            if name not in names:
                near = get_close_matches(name, names, 1, 0.7)
                meant = f"; did you mean `{near[0]}`?" if near else ""
                raise UsageError(f"`{name}` is not an argument of `encode`{meant}")
        return cls(**options)

    @property
    def quality(self) -> float | None:
        """The constant quality, by default if nothing else says how large the file is to be."""
        by_default = self.profile == "main" and not self._sizes
        return DEFAULT_CRF if by_default else self.crf

    @property
    def has_quality(self) -> bool:
        """Whether the quality of GOPs is given, whatever bits they take."""
        return self.quality is not None or self.target_psnr is not None

    def at_quality(self, crf: float) -> Self:
        """Return the same with a constant quality in place of a size or a PSNR."""
        return replace(self, crf=crf, bpp=None, bitrate=None, target_size=None, target_psnr=None)

    @property
    def target(self) -> FilmTarget | Aim:
        """What the file is to take or to reach."""
        if self.quality is not None:
            return ConstantQuality(self.quality)
        if self.target_psnr is not None:
            return MeanPsnr(self.target_psnr)
        for argument in _FILE_SIZES:
            if (value := getattr(self, argument)) is not None:
                return FilmSize(argument, value)
        # What the numbers of the publication's profile take is not known.
        return Numbers(self.params if self.profile == "main" else None, self.gaussians)

    @property
    def has_plates(self) -> bool:
        """Whether GOPs may have plates."""
        return self.plates and not isinstance(self.target, Numbers)

    @property
    def structure(self) -> Structure:
        """Which GOPs the file has.

        How many numbers a predicted GOP stores is known only when it is fitted, so that `params`
        excludes them. The GOPs of a chain make up for each other where a size is to be met. Where
        numbers are given GOPs end by motion, as published: short ones would have few Gaussians.
        """
        predicts = self.profile == "main" and self.params is None
        keyint, parted = self.keyint * predicts, self.has_quality
        by_motion = isinstance(self.target, Numbers)
        effort = EFFORT.frame_visits[self.preset] / min(EFFORT.frame_visits.values())
        return Structure(self.gop, self.gop_min, self.gop_max, keyint, parted, by_motion, effort)

    @property
    def execution(self) -> Execution:
        """Where the encode runs."""
        return Execution(self.threads, self.device, self.workers)

    @property
    def predicts(self) -> bool:
        """Whether GOPs may be predicted from the one before."""
        return self.structure.keyint > 0

    @property
    def shares_out(self) -> bool:
        """Whether bits, numbers or time are shared out over the whole film."""
        if self.time_budget is not None:
            return True
        match self.target:
            case Aim() | Numbers(gaussians=None):
                return True
        return False

    @property
    def frame_visits(self) -> float:
        """How often a fit visits each frame, without a wall time.

        A high quality has more Gaussians, which take longer.
        """
        visits = float(EFFORT.frame_visits[self.preset])
        if self.quality is None:
            return visits
        return visits * max(1.0, 1 / qscale_of(self.quality))

    def expected_pace(self, pixels: int, workers: int = 1) -> float:
        """Return the wall time that a frame of so many pixels is expected to take, seconds."""
        on_two_cores = PROCESSES.step_seconds * self.frame_visits * pixels
        return self.time_budget or on_two_cores / max(1.0, workers / 2)

    @property
    def _sizes(self) -> list[str]:
        """What was given that says how large the file is to be."""
        return [name for name in _SIZES if getattr(self, name) is not None]

    @property
    def copied_kinds(self) -> tuple[str, ...]:
        """The kinds of streams to copy."""
        chosen = {"audio": self.audio, "subtitle": self.subtitles}
        return tuple(kind for kind, wanted in chosen.items() if wanted)

    @property
    def part(self) -> Part:
        """The part of the film to encode; raises a UsageError if it is none."""
        return Part(self.start_frame, self.frames, self.start_seconds, self.stop_seconds)

    @property
    def blending(self) -> Blending:
        """How pictures are formed: the publication adds, this codec takes weighted means."""
        return "sum" if self.profile == "paper" else "mean"

    @property
    def fit_options(self) -> FitOptions:
        """How GOPs are fitted."""
        return FitOptions(deform=self.deform, flow=self.flow, tune=self.qat)

    def recorded(self) -> dict[str, Any]:
        """What the file keeps: all that shapes its content."""
        kept = {name: value for name, value in asdict(self).items() if name not in _EXECUTION}
        return kept | {"crf": self.quality}


def _check_type(name: str, value: object, hint: Any) -> None:
    """Raise a UsageError if a value is not of its type."""
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            allowed = ", ".join(get_args(hint))
            raise UsageError(f"`{name}` must be one of {allowed}, not {value!r}")
        return
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if not any(_is(value, kind) for kind in kinds):
        wanted = " or ".join(_KINDS[kind] for kind in kinds if kind in _KINDS)
        raise UsageError(f"`{name}` must be {_WORDS.get(name, wanted)}, not {value!r}")


def _is(value: object, kind: Any) -> bool:
    """Return whether a value is of a type without a union; a truth value is no number."""
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    if kind in (int, float):
        return isinstance(value, (int, kind)) and not isinstance(value, bool)
    if get_origin(kind) is tuple:
        return isinstance(value, (tuple, list)) and len(value) == len(get_args(kind))
    return isinstance(value, kind)


#: Types in words.
_KINDS = {int: "a whole number", float: "a number", bool: "True or False", str: "text"}
#: Arguments of several types, in words.
_WORDS = {
    "gop": "'adaptive' or a number of frames",
    "crop": "(width, height, x, y) in pixels, x and y None for the centre",
}
_DEFAULT_PRESET: Preset = "medium"
_FILE_SIZES: tuple[Literal["bpp", "bitrate", "target_size"], ...] = (
    "bpp",
    "bitrate",
    "target_size",
)
#: What says how large the file is to be.
_SIZES = ("params", "gaussians", "crf", *_FILE_SIZES, "target_psnr")
_EXECUTION = {field.name for field in fields(Execution)}
_POSITIVE = {
    "time_budget": "seconds",
    "bpp": "bits a pixel",
    "bitrate": "bits a second",
    "target_size": "bytes",
    "target_psnr": "dB",
}
_LOWEST = {
    "params": 1,
    "gaussians": 1,
    "gop": 1,
    "gop_min": 1,
    "gop_max": 1,
    "seed": 0,
    "threads": 0,
    "workers": 0,
    "start_frame": 0,
    "frames": 1,
}
#: What decoders take without being told otherwise.
_HIGHEST = {
    "gaussians": Limits().gaussians,
    "gop": Limits().gop_frames,
    "gop_max": Limits().gop_frames,
}
