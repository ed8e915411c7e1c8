"""The model of a GOP: attributes, quantiser, storage order, time, pyramid; NumPy alone."""
