"""Adam, equal to the native core's."""

import triton
import triton.language as tl

NUMBERS = tl.constexpr(1024)


@triton.jit
def adam_update(
    value_ptr,
    gradient_ptr,
    mean_ptr,
    square_ptr,
    rate_ptr,  # (components,)
    n,
    components,
    factor,  # of the rates, with the first moment's bias correction
    beta1,
    beta2,
    correction,  # of the second moment
    epsilon,
):
    """One step over n numbers, whose last axis has `components`."""
    i = tl.program_id(0) * NUMBERS + tl.arange(0, NUMBERS)
    mask = i < n
    gradient = tl.load(gradient_ptr + i, mask=mask, other=0.0)
    mean = tl.load(mean_ptr + i, mask=mask, other=0.0) * beta1 + gradient * (1.0 - beta1)
    square = tl.load(square_ptr + i, mask=mask, other=0.0) * beta2
    square += gradient * gradient * (1.0 - beta2)
    rate = tl.load(rate_ptr + i % components) * factor
    step = rate * mean / (tl.sqrt(square * correction) + epsilon)
    tl.store(mean_ptr + i, mean, mask=mask)
    tl.store(square_ptr + i, square, mask=mask)
    tl.store(value_ptr + i, tl.load(value_ptr + i, mask=mask, other=0.0) - step, mask=mask)
