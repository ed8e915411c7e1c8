"""The file format as bytes: chunks, header, index; standard library alone."""
