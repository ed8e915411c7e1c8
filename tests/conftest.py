"""Settings of all tests."""

from __future__ import annotations

import hypothesis

# A busy machine is not a failure.
hypothesis.settings.register_profile("gsvrcodec", deadline=None)
hypothesis.settings.load_profile("gsvrcodec")
