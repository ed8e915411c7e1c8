"""The bitstream: chunks, header, index, recovery, payloads of GOPs."""
