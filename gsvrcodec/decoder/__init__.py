"""From a .gsvr file to pictures; `decoder.decoder` is where to start."""
