"""From a .gsvr file to pictures; start reading at `decoder.decoder`."""
