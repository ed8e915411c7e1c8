"""Inspection of files, rate-distortion reports, comparison with other encoders."""
