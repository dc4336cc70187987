"""Studies over grids of settings: which pair clusters best, which settings track best."""
