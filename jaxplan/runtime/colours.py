"""Colours of devices and zones, the same in figures, viewer and exports."""

COLOURS = (
    *("#0072B2", "#E69F00", "#882255", "#56B4E9", "#332288", "#117733"),
    *("#CC79A7", "#9F00FF", "#A9A960", "#4C004C", "#9F66FF"),
)
"""Colours of devices, in the order of a spacecraft's devices; told apart by the colour-blind, too."""
KEEP_OUT, KEEP_IN = "#B2182B", "#1B7837"
"""Colours of zones to stay out of, and of zones to stay in."""
