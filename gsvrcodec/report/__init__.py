"""Metrics, the rate-distortion report, and what is in a file."""
