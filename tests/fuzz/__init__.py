"""Fuzzing by hand, guided by what code is reached."""
