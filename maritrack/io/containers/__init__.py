"""What CAT240 is packed in: captures, FINAL, MCAP and gzip, read and written. Read `kinds`, then `capture` first."""
