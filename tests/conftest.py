"""Settings of all tests."""

from __future__ import annotations

import signal

import hypothesis

# A busy machine is not a failure.
hypothesis.settings.register_profile(
    "gsvrcodec", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("gsvrcodec")

# Shells start what runs in the background deaf to interrupts, and that is inherited.
signal.signal(signal.SIGINT, signal.default_int_handler)
