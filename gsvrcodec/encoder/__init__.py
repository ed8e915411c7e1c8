"""From a video to a .gsvr file; `encoder.encode` tells the story."""
