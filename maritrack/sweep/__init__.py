"""Many runs: sweeps over settings and seeds, batches of recordings, and the table of what came of them."""
