"""From radials to the turns of an antenna, and to the scans that they are. Read `assemble` first."""
