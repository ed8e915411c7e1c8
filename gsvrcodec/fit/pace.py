"""How fast each Gaussian is optimised, in the rates of the recipe."""

from __future__ import annotations

import torch

from gsvrcodec.fit.field import GRIDS, MOTION, Field, Tensors
from gsvrcodec.fit.recipe import Recipe


def paces(field: Field, recipe: Recipe, size: tuple[int, int]) -> Tensors:
    """Factors of the rates of each Gaussian.

    What is new in a predicted GOP has further to go than what is carried over. Fast motion is known
    less exactly than slow motion; what stands still has to stay where it is.

    Args:
        field: Parameters of the fit.
        recipe: Rates.
        size: Width and height of the coded frame, pixels.

    Returns:
        By the names of attributes: (N, 1), or (N,) where an attribute has one component.
    """
    found: Tensors = {}
    if field.carried is not None and recipe.new != 1:
        new = 1 + (recipe.new - 1) * (1 - field.carried)
        for name in field.raw.keys() - set(GRIDS):
            found[name] = new if field.raw[name].dim() > 1 else new[:, 0]
    if recipe.fast and "linear" in field.raw:
        pixels = torch.tensor(size, device=field.backend.device) / 2
        way = torch.linalg.vector_norm(field.raw["linear"] * pixels, dim=1, keepdim=True)
        factor = 1 + recipe.fast * way / (way + recipe.fast_px)
        for name in MOTION:
            found[name] = factor * found[name] if name in found else factor
    return found
