"""ASTERIX category 240, radar video: data blocks and their records, to arrays and back. Read `reader` first."""
