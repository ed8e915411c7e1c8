"""Settings of all tests."""

from __future__ import annotations

import signal

import hypothesis
import pytest

# A busy machine is not a failure.
hypothesis.settings.register_profile(
    "gsvrcodec", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("gsvrcodec")

# Shells start what runs in the background deaf to interrupts, and that is inherited.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def exact_x264(monkeypatch: pytest.MonkeyPatch) -> None:
    """x264 without assembly: its AVX-512 code does not give the same bytes each time."""
    from gsvrcodec.report import reference
    from tests.benchmarks import x264

    usual = reference.encoder_options

    def options(chosen: reference.Reference, crf: float) -> dict[str, str]:
        return usual(chosen, crf) | {"x264-params": "asm=0"}

    for module in (reference, x264):
        monkeypatch.setattr(module, "encoder_options", options)
