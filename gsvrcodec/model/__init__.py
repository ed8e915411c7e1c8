"""What a GOP is: attributes, quantiser, order, time, pyramid; NumPy alone."""
