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
    pace_ptr,  # factors of the rates, if PACED
    n,
    components,
    factor_ptr,  # (1,), of the rates
    step_ptr,  # (1,), number of this step, from 1
    beta1,
    beta2,
    epsilon,
    agreeing,  # factor of a step of a number that the gradient agrees with
    opposing,  # factor of one that it opposes
    PACED: tl.constexpr,
):
    """One step over n numbers, whose last axis has `components`."""
    i = tl.program_id(0) * NUMBERS + tl.arange(0, NUMBERS)
    mask = i < n
    # What the bias of the two moments is corrected by.
    number = tl.load(step_ptr)
    factor = tl.load(factor_ptr) / (1.0 - tl.exp2(number * tl.log2(beta1)))
    correction = 1.0 / (1.0 - tl.exp2(number * tl.log2(beta2)))
    gradient = tl.load(gradient_ptr + i, mask=mask, other=0.0)
    mean = tl.load(mean_ptr + i, mask=mask, other=0.0) * beta1 + gradient * (1.0 - beta1)
    square = tl.load(square_ptr + i, mask=mask, other=0.0) * beta2
    square += gradient * gradient * (1.0 - beta2)
    rate = tl.load(rate_ptr + i % components) * factor
    if PACED:
        rate *= tl.load(pace_ptr + i, mask=mask, other=0.0)
    rate *= tl.where(mean * gradient > 0.0, agreeing, opposing)
    step = rate * mean / (tl.sqrt(square * correction) + epsilon)
    tl.store(mean_ptr + i, mean, mask=mask)
    tl.store(square_ptr + i, square, mask=mask)
    tl.store(value_ptr + i, tl.load(value_ptr + i, mask=mask, other=0.0) - step, mask=mask)
