"""maritrack: what trackers make of maritime radar recordings, and why."""

__version__ = "0.1.0"
