"""Radar images: folders and ZIP archives of screenshots, their times, masks and colours, as a source of frames."""
