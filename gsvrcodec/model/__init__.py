"""What a GOP is and how it becomes bytes: attributes, quantiser, order, timing, packing."""
