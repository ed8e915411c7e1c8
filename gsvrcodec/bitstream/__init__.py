"""The file format: chunks, header, index, and the payloads of GOPs and backgrounds."""
