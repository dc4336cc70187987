"""AIS checked by radar: which ships a run confirms, which it should see and does not, and which tell no AIS."""
