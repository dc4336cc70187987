"""Folders laid out like DLR's real-world marine radar data set (doi 10.26090/rwmr), as far as its layout is known."""
