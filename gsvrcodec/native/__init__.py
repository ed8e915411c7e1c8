"""The native core: `_core` renders, `_entropy` codes planes."""
