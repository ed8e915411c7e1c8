"""From the frames of one GOP to its Gaussians; nothing else."""
